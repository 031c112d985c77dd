"""What a search for tours is about, and tours by estimated moves, and tours whose moves were all driven well: search,
drive what they use, strike what fails, search on."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem, compute_cost_s, search_programmes
from strategies.programmes.order_tours import ANY_WAY_S, NEIGHBOURS, NO_MOVE_S
from strategies.programmes.waiting_places import find_clashes
from strategies.site.site import LEFT_FACTOR
from vehicle.missions.plan import SWATH
from vehicle.sim.path_conflicts import ClearanceCheck


@dataclass(frozen=True, eq=False)
class TourProblem:
    """The tours of a fleet over the n lines of a table.

    Attributes:
        table: lines, and moves between them as far as the search knows them.
        allowed: (tractors, n) which lines a tractor may work.
        stages: (n,) which lines come first.
        charged_s: (2 n + 1, 2 n + 1) what moves between nodes cost more than they take.
        served_s: (n,) how long a tractor takes to be served for each line, so that all finish together; None: no time.
        check: with it no two tractors of a field without an entrance begin or end where they never get on.
    """

    table: MoveTable
    allowed: Flags
    stages: Sequence[int]
    charged_s: Floats
    served_s: Floats | None = None
    check: ClearanceCheck | None = None

    @property
    def tractors(self) -> int:
        """How many tours there are."""
        return len(self.allowed)

    @property
    def clashes(self) -> Flags | None:
        """The nodes (2, 2 n, 2 n) of which no two tractors may begin (0) or end (1) with both, as far as the search
        knows; None for a single one, and with an entrance to wait outside."""
        table, check = self.table, self.check
        if check is None or table.site.lane is not None or self.tractors == 1:
            return None
        if check not in table.clashes:
            table.clashes[check] = find_clashes(table.moves, check).copy()
        return table.clashes[check]

    def pose(self, costs: Floats) -> OrderProblem:
        """The search for the tours with costs (2 n + 1, 2 n + 1) of moves, without charges."""
        moves, lines, site = self.table.moves, self.table.lines, self.table.site
        may, stage = self._place_starts()
        own_s = np.array([line.own_m2 for line in lines]) * site.work_s_per_m2
        extra_s = np.zeros(len(lines)) if self.served_s is None else self.served_s
        is_barred = np.array([not line.both_ways and way == 1 for line in lines for way in (0, 1)], bool)
        costs = costs + self.charged_s
        ends_s = [
            np.repeat(np.where(is_barred, np.inf, row)[None], len(may), axis=0)
            for row in ((costs[-1, :-1], costs[:-1, -1]) if site.lane is not None else moves.edge_ways_s)
        ]
        starts = list(moves.starts)
        ends_s[0][:, starts], ends_s[0][: len(starts)] = np.inf, np.inf
        ends_s[0][range(len(starts)), starts] = 0.0
        is_track = np.array([line.task.kind == SWATH for line in lines], bool)
        is_start = np.isin(np.arange(len(lines)), np.array(starts) // 2)
        return OrderProblem(
            move_s=costs[:-1, :-1],
            work_s=np.array([line.length_m for line in lines]) / site.rules.work_speed_mps + extra_s,
            # No track is left for the order of furrows, nor what a tractor begins with for its way home.
            value_s=LEFT_FACTOR * own_s + extra_s + 2.0 * site.furrow_s * is_track + ANY_WAY_S * is_start,
            begin_s=ends_s[0],
            end_s=ends_s[1],
            allowed=may,
            stage=stage,
            clashes=self.clashes,
            turns_runs=site.furrow_s > 0.0,
        )

    def _place_starts(self) -> tuple[Flags, Integers]:
        """What tractors may work and when, with every start for its own tractor and in the first stage."""
        lines = [node // 2 for node in self.table.starts]
        may, stage = self.allowed.copy(), np.array(self.stages, np.int64)
        may[:, lines], stage[lines] = False, stage.min(initial=0)
        may[range(len(lines)), lines] = True
        return may, stage


Tours = list[list[int]]
PoseProblem = Callable[[Floats], OrderProblem]
ListMoves = Callable[[Tours], Sequence[tuple[int, int]]]

MOST_ROUNDS = 80  # of searching and driving
ESTIMATE_ROUNDS = 3  # of searching and asking what the moves of the tours cost
OTHERS = 4  # moves that are tried for one that failed, from where it leads and to where
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
    move_s = _bar_useless(problem, problem.move_s)
    nearest = np.argsort(move_s, axis=1, kind="stable")[:, :NEIGHBOURS]
    nodes, places = np.nonzero(np.take_along_axis(move_s, nearest, axis=1) < NO_MOVE_S)
    near: Tours = np.column_stack([nodes, nearest[nodes, places]]).tolist()
    return near


def _bar_useless(problem: OrderProblem, move_s: Floats) -> Floats:
    """Seconds of moves, NO_MOVE_S between the nodes of a line, and of lines that no tractor may work both."""
    lines = np.arange(len(move_s)) // 2
    may_follow = (problem.allowed.T.astype(int) @ problem.allowed)[np.ix_(lines, lines)] > 0
    return np.where(may_follow & (lines[:, None] != lines), move_s, NO_MOVE_S)


def _list_others(table: MoveTable, problem: OrderProblem, tours: Tours, list_moves: ListMoves) -> list[tuple[int, int]]:
    """The cheapest moves that may take the place of those of tours that no drive found good."""
    move_s = _bar_useless(problem, problem.tabulate_moves()[0])

    def list_joins(pairs: Tours) -> list[tuple[int, int]]:
        return [move for move in list_moves(pairs) if table.gate not in move]

    def list_cheapest(seconds: Floats) -> list[int]:
        return [node for node in np.argsort(seconds, kind="stable")[:OTHERS].tolist() if seconds[node] < NO_MOVE_S]

    pairs = [[u, v] for tour in tours for u, v in pairwise(tour)]
    failed = [pair for pair in pairs if not all(table.is_proven(*move) for move in list_joins([pair]))]
    onward = [[u, v] for u, _ in failed for v in list_cheapest(move_s[u])]
    return list_joins(onward + [[u, v] for _, v in failed for u in list_cheapest(move_s[:, v])])


def search_driven_tours(
    table: MoveTable,
    pose_problem: PoseProblem,
    list_moves: ListMoves,
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
        kicks = problem.kicks if tours is None else problem.kicks // 2  # once tours are known
        tours = search_programmes(problem, kicks if is_settled else 0, seed + number, tours)
        if is_settled and compute_cost_s(problem, tours) >= best_s - WORTH_SHARE * best_s:
            if can_be_driven(best):
                return best
            best_s = math.inf
        are_driven = table.prove(list_moves(tours))
        if not are_driven:
            table.prove(_list_others(table, problem, tours, list_moves), are_chosen=False)
        is_settled = are_driven or tours == before or number == MOST_ROUNDS - 1
        if not is_settled:
            continue
        proven = pose_proven()
        settled = tours if are_driven else search_programmes(proven, proven.kicks, seed + number, tours)
        settled_s = compute_cost_s(proven, settled)
        if settled_s < best_s:
            best, best_s, tours = settled, settled_s, settled
    for _ in range(MOST_ROUNDS):
        if not best or can_be_driven(best):
            return best
        proven = pose_proven()
        tours = search_programmes(proven, proven.kicks, seed, best)
        best = Tours() if tours == best else tours
    return Tours()
