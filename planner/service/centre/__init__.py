"""The control centre of one fleet: what tractors report goes in, orders and a picture for operators come out.

Nothing here knows a network or a clock; times are handed in.

    centre        the whole: reports, and what time brings about
    operated      what operators order
    seeing        obstacles that are told of, and those that nobody can read
    core          plan, states, orders and events that wait to be taken
    fleet_plan    a saved plan with machines, times and ground
    remaining     what is left of a fleet, taken out of it
    replanning    the rest of a failed tractor's tracks for the others, simulated
    waiting       where tractors of such a plan may wait
    handing_over  who takes over which of them
    course        the legs of one tractor: lengths, times, places on them
    tractors      report and state of one tractor, and what may hold it
    releasing     which legs may be driven: base and horizon
    forecast      when everybody will be done
    chances       how likely that is in time
    foresight     where everybody will be in a few seconds
    obeying       who drives on though told to stand
    plausible     who cannot be where it says
    guard         fence, distances, and what a remote command may do
    nearness      how long those that are too near stand
    obstacles     what stands in the way, and which legs it blocks
    leases        who drives which tractor
    alarms        what has to be seen
    painting      what has been worked
    progress      the state of a fleet as plain values, for a restart
    orders        what leaves the centre
    rules         by what distances and times all this goes
"""
