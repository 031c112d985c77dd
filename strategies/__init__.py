"""Strategies: how a fleet shares a field. Each turns a FieldJob into a plan of legs and gates.

To add one, write strategies/<name>.py (underscores for the dashes of the name) with a record STRATEGY
(program.strategy_record) and add the name to STRATEGY_NAMES in names.py. Its `build` takes a FieldJob and returns a
Plan; one that simulates to find its best plan also has a `refine` (row_by_row_optimised is an example). Strategies of
other packages: planner/guide/strategies.md.
"""
