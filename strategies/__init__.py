"""Strategies: how a fleet shares a field. Each turns a job into a plan of legs and gates and knows no clock.

    paths, turns       geometry of turns in closed form
    connect, routes    the quickest drivable way between two poses inside the field
    job                what a strategy is given: layout, manner of driving, ways
    sequence           the order in which one tractor takes its tracks
    legs               tracks and turns as legs
    separate           split-field and interleaved
    formation          row-by-row and col-by-col, with the waiting queue
    registry           the names
"""
