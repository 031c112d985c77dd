"""Tours whose moves were all driven well: search, drive what the tours use, strike what fails, search on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from strategies.programmes.move_estimates import NO_MOVE_S
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem, compute_cost_s, search_programmes

Floats = npt.NDArray[np.float64]
Tours = list[list[int]]

MOST_ROUNDS = 80  # of searching and driving
WORTH_SHARE = 0.003  # of the cost: what might still be gained by driving more moves, at least


def search_driven_tours(
    table: MoveTable,
    pose_problem: Callable[[Floats], OrderProblem],
    list_moves: Callable[[Tours], Sequence[tuple[int, int]]],
    can_be_driven: Callable[[Tours], bool],
    seed: int = 1,
    start: Tours | None = None,
) -> Tours:
    """The best tours whose moves were all driven well and that can be driven as a whole; empty without any.

    `pose_problem` takes the costs (n + 1, n + 1) of moves, `list_moves` gives the pairs of nodes that tours move
    between; the search begins with `start`. Ends when no tours that may use moves not yet driven promise to be clearly
    cheaper than the best of those that were.
    """

    def pose_proven() -> OrderProblem:
        return pose_problem(np.where(table.get_proven_mask(), table.cost_s, NO_MOVE_S))

    tours = start
    best, best_s, is_settled = Tours(), math.inf, True
    for number in range(MOST_ROUNDS):
        problem, before = pose_problem(table.estimate_costs()), tours if number else None
        tours = search_programmes(problem, problem.kicks if is_settled else 0, seed + number, tours)
        if is_settled and compute_cost_s(problem, tours) >= best_s - WORTH_SHARE * best_s:
            if can_be_driven(best):
                return best
            best_s = math.inf
        are_driven = table.prove(list_moves(tours))
        is_settled = are_driven or tours == before or number == MOST_ROUNDS - 1
        if not is_settled:
            continue
        proven = pose_proven()
        settled = tours if are_driven else search_programmes(proven, proven.kicks, seed + number, tours)
        settled_s = compute_cost_s(proven, settled)
        if settled_s < best_s:
            best, best_s, tours = settled, settled_s, settled
    while best and not can_be_driven(best):
        proven = pose_proven()
        tours = search_programmes(proven, proven.kicks, seed, best)
        best = Tours() if tours == best else tours
    return best
