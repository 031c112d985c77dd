"""What the best programme of one tractor is likely to cost, by moves in closed form: nothing is driven."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strategies.programmes.move_estimates import NO_MOVE_S
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import compute_cost_s, search_programmes
from strategies.programmes.programme import list_pairs, pose_problem
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.stages import list_stages

ROUNDS = 3  # of searching and asking what the moves of the tour cost
KICKS = 10  # of the last search


def estimate_cost_s(moves: SiteMoves, orders: Sequence[str]) -> float:
    """Seconds in which one tractor works all lines of a site, with the time to finish those that it leaves.

    Headland and swaths come in the cheapest of some orders, "" for any. Charges for what drivers avoid are included.
    """
    table = MoveTable(moves)
    return min(_search_cost_s(table, list_stages(moves.lines, order)) for order in orders)


def _search_cost_s(table: MoveTable, stages: Sequence[int]) -> float:
    """The cost of the best tour that is found, its lines in stages, by moves that were estimated."""
    moves, count = table.moves, len(table.lines)
    stage, may, none_s = np.array(stages, np.int64), np.ones((1, count), bool), np.zeros(count)
    tours: list[list[int]] | None = None
    for number in range(ROUNDS):
        problem = pose_problem(moves, table.estimate_costs(), stage, may, none_s)
        tours = search_programmes(problem, 0, 1 + number, tours)
        if not table.estimate(list_pairs(moves, tours)):
            break
    problem = pose_problem(moves, np.where(table.is_estimated, table.cost_s, NO_MOVE_S), stage, may, none_s)
    return compute_cost_s(problem, search_programmes(problem, KICKS, 1, tours))
