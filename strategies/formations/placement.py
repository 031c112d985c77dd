"""Places of all rounds, clear of tractors that come to a round and of those that leave it.

Between rounds the rows come and leave one after another: who stands in its place is in the way of rows behind it only,
who stands in the queue in that of rows ahead of it. To the first round and from the last tractors come and go in any
order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from strategies.formations.passing import Floats, find_blocked_spans, sample_poses
from strategies.formations.round_order import DirectedRound
from strategies.formations.rounds import ColumnRound, PassingSpans, get_row, place_tractors
from strategies.formations.tours import FormationTour
from strategies.lines.work_line import cut_line, measure_along
from strategies.programmes.move_table import MoveTable

LINE_STEP_M = 1.0  # between poses along the lines before the first round and after the last


@dataclass(frozen=True, eq=False)
class _Passage:
    """A tractor on its way to a round or from it: its poses (n, 4), and what its move cuts from either column."""

    poses: Floats
    leave_m: float = 0.0
    join_m: float = 0.0


def place_rounds(
    table: MoveTable, order: Sequence[DirectedRound], tours: Sequence[FormationTour]
) -> list[DirectedRound]:
    """The rounds of an order with their places, for the tours that they are part of."""
    between = [_list_passages(table, before, after) for before, after in pairwise(order)]
    coming = [[_trace_arrival(table, tour) for tour in tours], *between]
    leaving = [*between, [_trace_departure(table, tour) for tour in tours]]
    placed = []
    for number, each in enumerate(order):
        is_first, is_last = number == 0, number == len(order) - 1
        passing = [
            _find_passing(table, each, tractor, (coming[number], is_first), (leaving[number], is_last))
            for tractor in range(len(tours))
        ]
        placed.append(replace(each, places=tuple(place_tractors(each.one, each.way, table.site.rules, passing))))
    return placed


def find_cramped_round(placed: Sequence[DirectedRound]) -> ColumnRound | None:
    """The round that lacks most room between its places and its queue; None where all have room."""
    missing_m = [max(place.missing_m for place in each.places) for each in placed]
    worst = int(np.argmax(np.round(missing_m, 3)))
    return placed[worst].one if missing_m[worst] > 0.0 else None


def _list_passages(table: MoveTable, before: DirectedRound, after: DirectedRound) -> list[_Passage]:
    return [
        _trace_move(table, before.list_nodes(tractor)[-1], after.list_nodes(tractor)[0])
        for tractor in range(len(before.one.columns))
    ]


def _trace_move(table: MoveTable, u: int, v: int) -> _Passage:
    move = table.get_move(u, v)
    assert move is not None  # tours use moves that exist
    return _Passage(sample_poses(move.path), move.leave_m, move.join_m)


def _trace_arrival(table: MoveTable, tour: FormationTour) -> _Passage:
    """On the last part of the line before the rounds, where a tractor may wait, and from there on."""
    gate = [] if table.site.lane is None else [table.gate]
    before = [*gate, *tour.before]
    if not before:
        return _Passage(np.empty((0, 4)))
    move = _trace_move(table, before[-1], tour.rounds[0])
    if before[-1] == table.gate:
        return move
    return replace(move, poses=np.concatenate([_trace_line(table, before[-1], at_end=True), move.poses]))


def _trace_departure(table: MoveTable, tour: FormationTour) -> _Passage:
    """To the line after the rounds, and on its first part."""
    gate = [] if table.site.lane is None else [table.gate]
    after = [*tour.after, *gate]
    if not after:
        return _Passage(np.empty((0, 4)))
    move = _trace_move(table, tour.rounds[-1], after[0])
    if after[0] == table.gate:
        return move
    return replace(move, poses=np.concatenate([move.poses, _trace_line(table, after[0], at_end=False)]))


def _trace_line(table: MoveTable, node: int, *, at_end: bool) -> Floats:
    """Poses (n, 4) on the part of a line that lies within a machine's length of its end, or of its begin."""
    path, reach_m = table.lines[node // 2].paths[node % 2], table.site.rules.hold_back_m + table.site.rules.length_m
    whole_m = float(measure_along(path)[-1])
    part = (
        cut_line(path, max(0.0, whole_m - reach_m), whole_m) if at_end else cut_line(path, 0.0, min(reach_m, whole_m))
    )
    ahead = np.diff(part, axis=0)
    lengths_m, headings = np.hypot(*ahead.T), np.arctan2(ahead[:, 1], ahead[:, 0])
    steps = [np.arange(0.0, length_m, LINE_STEP_M) / length_m for length_m in lengths_m]
    places = np.concatenate([part[k] + share[:, None] * ahead[k] for k, share in enumerate(steps)])
    owners = np.repeat(headings, [len(share) for share in steps])
    return np.column_stack([places, owners, np.zeros(len(places))])


def _find_passing(
    table: MoveTable,
    each: DirectedRound,
    tractor: int,
    coming: tuple[Sequence[_Passage], bool],
    leaving: tuple[Sequence[_Passage], bool],
) -> PassingSpans:
    """Who passes a tractor in its place and in its queue; the flags say whether others do so in any order."""
    count = len(each.one.columns)
    row, begin = get_row(tractor, count), each.one.columns[tractor].get_ends(each.way)[0]

    def list_poses(passages: Sequence[_Passage], passes: Callable[[int], bool]) -> list[Floats]:
        return [passages[k].poses for k in range(count) if k != tractor and passes(get_row(k, count))]

    (comers, in_any_order), (leavers, out_in_any_order) = coming, leaving
    return PassingSpans(
        find_blocked_spans(table.site, begin, list_poses(comers, lambda other: in_any_order or other >= row)),
        find_blocked_spans(table.site, begin, list_poses(leavers, lambda other: out_in_any_order or other <= row)),
        comers[tractor].join_m,
        leavers[tractor].leave_m,
    )
