"""How sure a simulated plan is: its legs and gates as a graph, random inputs drawn through it, the answer.

    settings   what varies, by how much, and where the figure comes from
    rain       when it begins to rain: a time, times with percentages, members of an ensemble, a rate
    streams    random numbers by name: the same for every plan of one seed
    graph      seconds that every leg takes, and who waits for whom, from a run
    planned_order  gates that keep the planned order wherever two tractors come by the same place
    cutting    legs cut where a tractor has to wait on the way along one
    events     stops and breakdowns on the driven clock of a tractor
    draws      longest path through the graph, all draws at once
    answer     probability with its interval, quantiles, what drives the spread, ground done in the mean
    physics    some draws driven in full, beside what the graph says of them
"""
