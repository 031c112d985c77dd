"""Strategies: how a fleet shares a field. Each says who may work which lines, or puts them in order itself.

To add one, write strategies/<name>.py (underscores for the dashes of the name) with a record STRATEGY
(strategy_record), and its row in planner/guide/headlands.md. Its `deal` says which work lines each tractor may have;
one whose tractors keep beside one another has a `formation` instead (row_by_row is an example). Strategies of other
packages: planner/guide/strategies.md.
"""
