"""The tours of tractors that work in formation: the rounds as one piece each, and all other lines shared out.

Headland sides and columns left over are worked by whoever has time, before the formation or after it. For the search a
tractor's way through all rounds is one line that only it may drive, in one direction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise

import numpy as np

from fields.arrays import Flags, Floats, Integers
from strategies.formations.round_order import DirectedRound
from strategies.path_planning.errors import SOLITARY_STRATEGIES, StrategyError
from strategies.programmes.driven_search import search_driven_tours, search_estimated_tours
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_search import OrderProblem, count_clashes
from strategies.programmes.programme import list_pairs, prove_short_runs
from strategies.programmes.stages import find_first_tasks
from strategies.programmes.waiting_places import find_clashes
from strategies.site.site import LEFT_FACTOR
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.sim.path_conflicts import ClearanceCheck

FORMATION_VALUE_S = 1e5  # leaving the formation is dearer than any other line


@dataclass(frozen=True, eq=False)
class FormationTour:
    """The nodes of a tractor: those before its rounds, those of its rounds, and those after them."""

    before: tuple[int, ...]
    rounds: tuple[int, ...]
    after: tuple[int, ...]

    @property
    def nodes(self) -> tuple[int, ...]:
        """All in order."""
        return self.before + self.rounds + self.after


@dataclass(frozen=True, eq=False)
class _Pieces:
    """What the search puts in order: lines of the table, then the way of every tractor through the rounds.

    Attributes:
        table: lines and moves.
        clashes: nodes of the table (2, n, n) of which no two tractors may begin or end with both; None: any may.
        lines: numbers of the lines that are not in rounds.
        chains: per tractor its nodes in all rounds.
        chain_s: seconds that the rounds take.
    """

    table: MoveTable
    clashes: Flags | None
    lines: tuple[int, ...]
    chains: tuple[tuple[int, ...], ...]
    chain_s: float

    def pose_problem(self, order: str, costs: Floats) -> OrderProblem:
        """The problem of all tractors, with the headland first or last."""
        table, tractors = self.table, len(self.chains)
        kept = [table.lines[line] for line in self.lines]
        nodes = [2 * line + way for line in self.lines for way in (0, 1)]
        # For every node of the search the nodes of the table with which it begins and ends.
        entries, exits = (nodes + [chain[end] for chain in self.chains for _ in (0, 1)] for end in (0, -1))
        backwards = np.arange(2 * len(kept) + 1, len(entries), 2)
        moves: Floats = costs[np.ix_(exits, entries)]
        moves[backwards], moves[:, backwards] = np.inf, np.inf
        has_lane, speed = table.site.lane is not None, table.site.rules.work_speed_mps
        own_s = np.array([line.own_m2 for line in kept]) * table.site.work_s_per_m2
        allowed = np.ones((tractors, len(kept) + tractors), bool)
        allowed[:, len(kept) :] = np.eye(tractors, dtype=bool)
        ends_s = [np.repeat(row[None] * has_lane, tractors, axis=0) for row in (costs[-1, entries], costs[exits, -1])]
        clashes = self.clashes
        if clashes is not None:
            clashes = np.array([clashes[side][np.ix_(ends, ends)] for side, ends in enumerate((entries, exits))])
        return OrderProblem(
            move_s=moves,
            work_s=np.concatenate([[line.length_m / speed for line in kept], np.full(tractors, self.chain_s)]),
            value_s=np.concatenate([LEFT_FACTOR * own_s, np.full(tractors, FORMATION_VALUE_S)]),
            begin_s=ends_s[0],
            end_s=ends_s[1],
            allowed=allowed,
            stage=self._list_stages(order),
            clashes=clashes,
        )

    def list_moves(self, tours: list[list[int]]) -> list[tuple[int, int]]:
        """The moves that tours of the search use, as pairs of nodes of the table."""
        return list_pairs(self.table, [self.expand(tour).nodes for tour in tours])

    def _list_stages(self, order: str) -> Integers:
        """Columns left over follow the rounds, headland sides come before or after both as what comes first says."""
        first = find_first_tasks(self.table.site, self.table.lines, order)
        tasks = [self.table.lines[line].task for line in self.lines]
        stages = [2 if task.kind != HEADLAND_PASS else 0 if task in first else 3 for task in tasks]
        return np.array(stages + [1] * len(self.chains))

    def expand(self, tour: Sequence[int]) -> FormationTour:
        """A tour of the search as nodes of the table."""
        split = 2 * len(self.lines)
        place = next((place for place, node in enumerate(tour) if node >= split), len(tour))
        chain = self.chains[(tour[place] - split) // 2] if place < len(tour) else ()
        before, after = (
            [2 * self.lines[node // 2] + node % 2 for node in part] for part in (tour[:place], tour[place + 1 :])
        )
        return FormationTour(tuple(before), chain, tuple(after))


def sketch_tours(table: MoveTable, rounds: Sequence[DirectedRound], order: str) -> list[FormationTour]:
    """The tours of all tractors by estimated moves: nothing is driven, and nobody is in anybody's way.

    Raises StrategyError where some tractor does not get to the rounds.
    """
    pieces = _cut_pieces(table, rounds)
    found, _ = search_estimated_tours(table, partial(pieces.pose_problem, order), pieces.list_moves)
    return _expand_tours(pieces, found)


def share_lines(
    table: MoveTable, rounds: Sequence[DirectedRound], order: str, stands_in_way: ClearanceCheck
) -> list[FormationTour]:
    """The tours of all tractors, whose moves were all driven well; lines in none are left.

    None at all where a drive over short lines strikes a move between rounds, which then need another order. Raises
    StrategyError where some tractor does not get to the rounds.
    """
    pieces = _cut_pieces(table, rounds, find_clashes(table.moves, stands_in_way) if table.site.lane is None else None)
    pose_problem = partial(pieces.pose_problem, order)

    def can_be_driven(tours: list[list[int]]) -> bool:
        if count_clashes(pose_problem(table.cost_s), tours):
            return False
        return False not in [prove_short_runs(table, pieces.expand(tour).nodes) for tour in tours]

    found = search_driven_tours(table, pose_problem, pieces.list_moves, can_be_driven)
    if not all(table.is_proven(u, v) for chain in pieces.chains for u, v in pairwise(chain)):
        return []
    best = _expand_tours(pieces, found)
    return [_keep_connected(table, tour) for tour in best]


def _cut_pieces(table: MoveTable, rounds: Sequence[DirectedRound], clashes: Flags | None = None) -> _Pieces:
    """The ways of all tractors through rounds, and the lines in none of these."""
    tractors = range(len(rounds[0].one.columns))
    chains = tuple(tuple(node for each in rounds for node in each.list_nodes(k)) for k in tractors)
    in_rounds = {node // 2 for chain in chains for node in chain}
    lines = tuple(number for number in range(len(table.lines)) if number not in in_rounds)
    return _Pieces(table, clashes, lines, chains, _estimate_rounds_s(table, rounds))


def _expand_tours(pieces: _Pieces, found: list[list[int]]) -> list[FormationTour]:
    """Tours of the search as nodes of the table; raises StrategyError where one does not lead through the rounds."""
    tours = [pieces.expand(tour) for tour in found]
    if not tours or not all(tour.rounds for tour in tours):
        raise StrategyError(
            f"No path leads {len(pieces.chains)} tractors to tracks they could work side by side; use fewer tractors, "
            f"or {SOLITARY_STRATEGIES}."
        )
    return tours


def _estimate_rounds_s(table: MoveTable, rounds: Sequence[DirectedRound]) -> float:
    """About how long the rounds take, with the moves of the slowest tractor between them (s)."""
    work_s = sum(each.one.longest_m for each in rounds) / table.site.rules.work_speed_mps
    tractors = range(len(rounds[0].one.columns))
    moves_s = sum(
        sum(float(table.cost_s[a.list_nodes(k)[-1], b.list_nodes(k)[0]]) for k in tractors) for a, b in pairwise(rounds)
    )
    return work_s + moves_s


def _keep_connected(table: MoveTable, tour: FormationTour) -> FormationTour:
    """The stretch of a tour round its rounds all of whose moves were driven well."""
    joints = list(pairwise(tour.before + tour.rounds[:1]))
    first = 1 + max((k for k, pair in enumerate(joints) if not table.is_proven(*pair)), default=-1)
    joints = list(pairwise(tour.rounds[-1:] + tour.after))
    last = next((k for k, pair in enumerate(joints) if not table.is_proven(*pair)), len(tour.after))
    return FormationTour(tour.before[first:], tour.rounds, tour.after[:last])
