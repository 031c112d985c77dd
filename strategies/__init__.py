"""Strategies: how a fleet shares a field. Each turns a job into a plan of legs and gates and knows no clock.

    ways                    how a tractor gets from one pose to another
    job                     what a strategy is given: layout, manner of driving, ways
    legs                    tracks and turns as legs, each with its task
    timing                  the seconds that turns take, simulated
    orders                  which track next, and which tractor takes it
    headland                the rounds round the field and its holes
    supply                  what a tractor carries and uses at work
    refilling               refills, and loads to be brought away: orders in loads, ways to the place, the queue there
    entrance                the ways from the entrance to where work begins, and back
    separate                what strategies share whose tractors each have tracks of their own
    formations              what strategies share whose tractors work abreast
    record, names, registry what a strategy is to others; all of them by name

    split_field, interleaved, row_by_row, col_by_col, row_by_row_optimised    one strategy each

To add a strategy, write strategies/<name>.py with a record `STRATEGY = Strategy("<name>", words, build)` (dashes of the
name are underscores in the file's) and add its name to NAMES in names.py. `build` takes a Job and returns a Plan:
order the tracks (orders.sequence), write each tractor's passes (legs.mission_of, or pass_legs and turn_legs) and add
gates where one waits for another. Help texts, choices, candidates and reports take it from there. A strategy that must
drive to know what is best has a `refine` as well, which is handed a `simulate` (row_by_row_optimised shows one).
"""
