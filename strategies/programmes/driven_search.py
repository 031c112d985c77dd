"""Tours by estimated moves, and tours whose moves were all driven well: search, drive what they use, strike what fails,
search on."""

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
PoseProblem = Callable[[Floats], OrderProblem]
ListMoves = Callable[[Tours], Sequence[tuple[int, int]]]
BarClashes = Callable[[Tours], bool]

MOST_ROUNDS = 80  # of searching and driving
NEAR_NODES = 8  # whose moves from a node are estimated first
ESTIMATE_ROUNDS = 3  # of searching and asking what the moves of the tours cost
REFINING = 2  # times fewer perturbations once tours are known
WORTH_SHARE = 0.003  # of the cost: what might still be gained by driving more moves, at least


def search_estimated_tours(
    table: MoveTable, pose_problem: PoseProblem, list_moves: ListMoves, start: Tours | None = None
) -> tuple[Tours, float]:
    """The best tours by moves that were estimated, and their cost: nothing is driven.

    `pose_problem`, `list_moves` and `start` as in `search_driven_tours`.
    """
    table.estimate(list_moves(_list_near(pose_problem(table.cost_s))))
    table.estimate(list_moves(start or []))
    tours = start
    for number in range(ESTIMATE_ROUNDS):
        tours = search_programmes(pose_problem(table.estimate_costs()), 0, 1 + number, tours)
        if not table.estimate(list_moves(tours)):
            break
    problem = pose_problem(np.where(table.is_estimated, table.cost_s, NO_MOVE_S))
    tours = search_programmes(problem, problem.kicks, 1, tours)
    return tours, compute_cost_s(problem, tours)


def _list_near(problem: OrderProblem) -> Tours:
    """Pairs of near nodes of lines that the same tractor may work."""
    lines = np.arange(len(problem.move_s)) // 2
    may_follow = (problem.allowed.T.astype(int) @ problem.allowed)[np.ix_(lines, lines)] > 0
    move_s = np.where(may_follow & (lines[:, None] != lines), problem.move_s, NO_MOVE_S)
    nearest = np.argsort(move_s, axis=1, kind="stable")[:, :NEAR_NODES]
    nodes, places = np.nonzero(np.take_along_axis(move_s, nearest, axis=1) < NO_MOVE_S)
    near: Tours = np.column_stack([nodes, nearest[nodes, places]]).tolist()
    return near


def search_driven_tours(
    table: MoveTable,
    pose_problem: PoseProblem,
    list_moves: ListMoves,
    can_be_driven: Callable[[Tours], bool],
    seed: int = 1,
    start: Tours | None = None,
    bar_clashes: BarClashes = lambda _: False,
) -> Tours:
    """The best tours whose moves were all driven well and that can be driven as a whole; empty without any.

    `pose_problem` takes the costs (n + 1, n + 1) of moves, `list_moves` gives the pairs of nodes that tours move
    between; the search begins with `start`. `bar_clashes` says whether tractors of tours begin or end in each other's
    way, and bars such places from all that is posed next. Ends when no tours that may use moves not yet driven promise
    to be clearly cheaper than the best of those that were.
    """

    def get_proven_s() -> Floats:
        return np.where(table.get_proven_mask(), table.cost_s, NO_MOVE_S)

    tours = start
    best, best_s, is_settled = Tours(), math.inf, True
    for number in range(MOST_ROUNDS):
        before, refining = tours if number else None, 1 if tours is None else REFINING
        costs, share = table.estimate_costs(), 1.0 / refining if is_settled else 0.0
        tours, cost_s = _search_apart(pose_problem, bar_clashes, costs, share, seed + number, tours)
        if is_settled and cost_s >= best_s - WORTH_SHARE * best_s:
            if can_be_driven(best):
                return best
            best_s = math.inf
        are_driven = table.prove(list_moves(tours))
        is_settled = are_driven or tours == before or number == MOST_ROUNDS - 1
        if not is_settled:
            continue
        settled, settled_s = tours, compute_cost_s(pose_problem(get_proven_s()), tours)
        if not are_driven:
            settled, settled_s = _search_apart(pose_problem, bar_clashes, get_proven_s(), 1.0, seed + number, tours)
        if settled_s < best_s:
            best, best_s, tours = settled, settled_s, settled
    while best and not can_be_driven(best):
        tours, _ = _search_apart(pose_problem, bar_clashes, get_proven_s(), 1.0, seed, best)
        best = Tours() if tours == best else tours
    return best


def _search_apart(
    pose_problem: PoseProblem, bar_clashes: BarClashes, costs: Floats, share: float, seed: int, start: Tours | None
) -> tuple[Tours, float]:
    """Tours by these costs of moves and their own cost, by a `share` of the perturbations of a thorough search.

    Where tractors then begin or end in each other's way, the tours are improved without those places, until none do or
    there is nowhere else. Without perturbations tours are on the way to others, and may clash.
    """
    problem = pose_problem(costs)
    tours, before = search_programmes(problem, int(share * problem.kicks), seed, start), None
    while share and bar_clashes(tours) and tours != before:
        problem, before = pose_problem(costs), tours
        tours = search_programmes(problem, 0, seed, before)
    return tours, compute_cost_s(problem, tours)
