"""Strategies: how a fleet shares a field. Each turns a job into a plan of legs and gates and knows no clock.

    paths, turns            geometry of turns in closed form
    sizing, timing          the headland that turns need; the seconds they take, simulated
    words, search           the words that join two poses, and the best that fits, compiled
    connect, routes         the quickest drivable way between two poses inside the field
    chains                  the quickest chain of poses of such a way, compiled
    bends, around           lines bent round small obstacles; tracks bent, or cut where no bend fits
    fence                   whether the whole machine stays inside a fence on a way
    job                     what a strategy is given: layout, manner of driving, ways
    sequence                the order in which one tractor takes its tracks
    table, tours            seconds between passes by the ways driven; orders searched over them
    bounds, circuit         what no order can undercut; few tracks proven
    shares                  blocks of lines for a fleet, balanced
    rounds, shifts, laps, corners   the headland in rounds: when, who, how along it, how round its corners
    legs                    tracks and turns as legs, each with its task
    separate                what strategies share whose tractors each have tracks of their own
    formation               what strategies share whose tractors work abreast: rounds, places, the queue, the rest
    grouping, clear_rounds  tracks in rounds and what is left over; rounds clear of each other's ways
    promise                 the corners a formation may begin at, in order
    abreast, clearing       places of one round; where a tractor stands clear of ways past it
    queueing, leftover      legs and gates of rounds and queues; tracks one of the tractors works alone
    care                    a formation driven and mended where two of its tractors meet
    passages, releases      passing the headland, measured; when to leave the queue, optimised
    record, names, registry what a strategy is to others; all of them by name

    split_field, interleaved, row_by_row, col_by_col, row_by_row_optimised    one strategy each

To add a strategy, write strategies/<name>.py with a record `STRATEGY = Strategy("<name>", words, build)` (dashes of the
name are underscores in the file's) and add its name to NAMES in names.py. `build` takes a Job and returns a Plan:
order the tracks (sequence), write each tractor's passes (legs.mission_of, or pass_legs and turn_legs) and add gates
where one waits for another. Help texts, choices, candidates and reports take it from there. A strategy that must drive
to know what is best has a `refine` as well, which is handed a `simulate` (row_by_row_optimised shows one).
"""
