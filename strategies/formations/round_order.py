"""The order and direction of rounds: a tour of one whole formation, by moves that were driven well.

A round is a node in either direction. Between two rounds every row takes as long as its slowest tractor's move, one row
after another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from fields.arrays import Floats, Integers
from strategies.formations.rounds import ColumnRound, RoundPlace, get_row, place_tractors
from strategies.moves.move import Move
from strategies.programmes.driven_search import (
    ListMoves,
    PoseProblem,
    Tours,
    search_driven_tours,
    search_estimated_tours,
)
from strategies.programmes.move_table import MoveTable, split_apart
from strategies.programmes.order_search import OrderProblem
from strategies.programmes.order_tours import ANY_WAY_S

ROUND_VALUE_S = 2.0 * ANY_WAY_S  # a round that can be reached is worth any drive


@dataclass(frozen=True, eq=False)
class DirectedRound:
    """A round as it is driven.

    Attributes:
        way: direction of its columns.
        places: where its tractors stand.
        moves: by which they come from the round before; none to the first.
        come_s: seconds of these, or of those that are estimated.
        is_afar: whether its tractors come from elsewhere, one after another.
    """

    one: ColumnRound
    way: int
    places: tuple[RoundPlace, ...] = ()
    moves: tuple[Move, ...] = ()
    come_s: tuple[float, ...] = ()
    is_afar: bool = False

    def list_nodes(self, tractor: int) -> tuple[int, ...]:
        """The nodes of a tractor."""
        return self.one.columns[tractor].list_nodes(self.way)


def order_rounds(table: MoveTable, rounds: Sequence[ColumnRound], ends: tuple[bool, bool]) -> list[DirectedRound]:
    """The rounds in their best order; those that no move reaches are left out.

    `ends` says whether the formation comes from the entrance, and goes home from it.
    """
    pose_problem, list_moves = _pose(table, rounds, ends)
    sketched, _ = search_estimated_tours(table, pose_problem, list_moves)
    tours = search_driven_tours(table, pose_problem, list_moves, lambda tours: True, start=sketched)

    def are_joined(a: int, b: int) -> bool:
        return all(table.is_proven(u, v) for u, v in _list_moves(rounds, a, b))

    joined = split_apart(tours[0] if tours else [], are_joined)
    longest = max(joined, key=lambda part: round(sum(rounds[node // 2].length_m for node in part), 3))
    return join_rounds(table, [DirectedRound(rounds[node // 2], node % 2) for node in longest])


def join_rounds(table: MoveTable, order: Sequence[DirectedRound]) -> list[DirectedRound]:
    """Rounds with the moves from one to the next, which were all driven well."""
    joined = [*order[:1]]
    for before, after in pairwise(order):
        pairs = zip(before.one.list_last_nodes(before.way), after.one.list_first_nodes(after.way), strict=True)
        moves = [move for u, v in pairs if (move := table.get_move(u, v)) is not None]
        come_s = tuple(move.drive_s for move in moves)
        joined.append(replace(after, moves=tuple(moves), come_s=come_s, is_afar=before.one.run != after.one.run))
    return joined


def sketch_rounds(table: MoveTable, rounds: Sequence[ColumnRound], ends: tuple[bool, bool]) -> list[DirectedRound]:
    """About the best order of all rounds, by estimated moves, where nobody is in anybody's way: nothing is driven."""
    ((tour,), _) = search_estimated_tours(table, *_pose(table, rounds, ends))
    order = list[DirectedRound]()
    for number, node in enumerate(tour):
        one, way = rounds[node // 2], node % 2
        places = tuple(place_tractors(one, way, table.site.rules))
        pairs = _list_moves(rounds, tour[number - 1], node) if number else []
        come_s = tuple(table.moves.estimates.estimate_s(pairs, is_charged=False).tolist())
        is_afar = bool(order) and order[-1].one.run != one.run
        order.append(DirectedRound(one, way, places, come_s=come_s, is_afar=is_afar))
    return order


def _pose(table: MoveTable, rounds: Sequence[ColumnRound], ends: tuple[bool, bool]) -> tuple[PoseProblem, ListMoves]:
    """The problem of the order of rounds, and the moves of its tours, as searches take them."""

    def list_moves(tours: Tours) -> list[tuple[int, int]]:
        return [move for tour in tours for move in _list_tour_moves(table, rounds, ends, tour)]

    return partial(_pose_problem, table, rounds, ends), list_moves


def _list_moves(rounds: Sequence[ColumnRound], a: int, b: int) -> list[tuple[int, int]]:
    """Per tractor the nodes of the move between two directed rounds."""
    leaving = rounds[a // 2].list_last_nodes(a % 2)
    return list(zip(leaving, rounds[b // 2].list_first_nodes(b % 2), strict=True))


def _list_tour_moves(
    table: MoveTable, rounds: Sequence[ColumnRound], ends: tuple[bool, bool], tour: Sequence[int]
) -> list[tuple[int, int]]:
    """The moves of all tractors through rounds, with those from the entrance and home where they lead there."""
    moves = [pair for a, b in pairwise(tour) for pair in _list_moves(rounds, a, b)]
    if tour and table.site.lane is not None:
        first, last = tour[0], tour[-1]
        moves += [(table.gate, node) for node in rounds[first // 2].list_first_nodes(first % 2) if ends[0]]
        moves += [(node, table.gate) for node in rounds[last // 2].list_last_nodes(last % 2) if ends[1]]
    return moves


def _pose_problem(
    table: MoveTable, rounds: Sequence[ColumnRound], ends: tuple[bool, bool], costs: Floats
) -> OrderProblem:
    begins = np.array([one.list_first_nodes(way) for one in rounds for way in (0, 1)])
    lasts = np.array([one.list_last_nodes(way) for one in rounds for way in (0, 1)])
    comes, goes = (end and table.site.lane is not None for end in ends)
    has_none = np.zeros((1, len(begins)))
    places, runs = np.arange(len(begins)) // 2, np.repeat([one.run for one in rounds], 2)
    leaves_furrow = (abs(np.subtract.outer(places, places)) > 1) & (runs[:, None] == runs)
    return OrderProblem.from_moves(
        _sum_rows(costs[lasts[:, None, :], begins[None, :, :]]) + table.site.furrow_s * leaves_furrow,
        np.array([one.longest_m for one in rounds]) / table.site.rules.work_speed_mps,
        np.full(len(rounds), ROUND_VALUE_S),
        costs[-1, begins].max(axis=1)[None] if comes else _estimate_ways_s(table, begins)[None],
        costs[lasts, -1].max(axis=1)[None] if goes else has_none,
    )


def _estimate_ways_s(table: MoveTable, begins: Integers) -> Floats:
    """Seconds (n,) straight from the entrance to where rounds begin; zeros without one."""
    entrance = table.site.layout.field.entrance
    if entrance is None:
        return np.zeros(len(begins))
    places = np.array(table.moves.begins)[begins, :2]
    ways_s: Floats = np.hypot(*np.moveaxis(places - entrance, -1, 0)).min(axis=1) / table.site.rules.turn_speed_mps
    return ways_s


def _sum_rows(move_s: Floats) -> Floats:
    """Seconds (...) of all rows one after another, from those of every tractor (..., n)."""
    count = move_s.shape[-1]
    rows = np.array([get_row(tractor, count) for tractor in range(count)])
    seconds: Floats = sum(
        (move_s[..., rows == row].max(axis=-1) for row in range(1, int(rows.max()) + 1)), np.zeros(move_s.shape[:-1])
    )
    return seconds
