"""Places of all rounds, clear of tractors that come to a round and of those that leave it.

Where rows come and leave one after another, who stands in its place is in the way of rows behind it only, and who
stands in the queue in that of rows ahead of it. To the first round and from the last they come and go in any order.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from strategies.formations.passing import Floats, find_clear_place, trace_body
from strategies.formations.round_order import DirectedRound
from strategies.formations.rounds import ColumnRound, ColumnTraffic, FindPlace, get_row, place_tractors
from strategies.formations.tours import FormationTour
from strategies.lines.work_line import cut_line, locate_at, measure_along
from strategies.programmes.move_table import MoveTable
from strategies.programmes.waiting_places import StandsInWay

LINE_STEP_M = 1.0  # between poses along the lines before the first round and after the last


@dataclass(frozen=True, eq=False)
class _Passage:
    """A tractor on its way to a round or from it: its poses (n, 3), and what its move cuts from either column."""

    poses: Floats
    leave_m: float = 0.0
    join_m: float = 0.0


def place_rounds(
    table: MoveTable,
    order: Sequence[DirectedRound],
    tours: Sequence[FormationTour] | None,
    stands_in_way: StandsInWay,
    *,
    in_rows: bool,
) -> list[DirectedRound]:
    """The rounds of an order with their places, for the tours that they are part of where these are known.

    Tractors come and leave `in_rows`, or in any order.
    """
    tractors = len(order[0].one.columns)
    nowhere = [_Passage(np.empty((0, 3)))] * tractors
    between = [_list_passages(table, before, after) for before, after in pairwise(order)]
    coming = [nowhere if tours is None else [_trace_arrival(table, tour) for tour in tours], *between]
    leaving = [*between, nowhere if tours is None else [_trace_departure(table, tour) for tour in tours]]
    placed = []
    for number, each in enumerate(order):
        is_first, is_last = not in_rows or number == 0, not in_rows or number == len(order) - 1
        traffic = [
            _find_traffic(table, each, tractor, (coming[number], is_first), (leaving[number], is_last), stands_in_way)
            for tractor in range(tractors)
        ]
        placed.append(replace(each, places=tuple(place_tractors(each.one, each.way, table.site.rules, traffic))))
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
    return _Passage(trace_body(table.site, move.path), move.leave_m, move.join_m)


def _trace_arrival(table: MoveTable, tour: FormationTour) -> _Passage:
    """On the last part of the line before the rounds, where a tractor may wait, and from there on."""
    gate = [] if table.site.lane is None else [table.gate]
    before = [*gate, *tour.before]
    if not before:
        return _Passage(np.empty((0, 3)))
    move = _trace_move(table, before[-1], tour.rounds[0])
    if before[-1] == table.gate:
        return move
    return replace(move, poses=np.concatenate([_trace_line(table, before[-1], at_end=True), move.poses]))


def _trace_departure(table: MoveTable, tour: FormationTour) -> _Passage:
    """To the line after the rounds, and on its first part."""
    gate = [] if table.site.lane is None else [table.gate]
    after = [*tour.after, *gate]
    if not after:
        return _Passage(np.empty((0, 3)))
    move = _trace_move(table, tour.rounds[-1], after[0])
    if after[0] == table.gate:
        return move
    return replace(move, poses=np.concatenate([move.poses, _trace_line(table, after[0], at_end=False)]))


def _trace_line(table: MoveTable, node: int, *, at_end: bool) -> Floats:
    """Poses (n, 3) on the part of a line within a machine's length of where a tractor may wait at its end, or begin."""
    site, path = table.site, table.lines[node // 2].paths[node % 2]
    whole_m, reach_m = float(measure_along(path)[-1]), site.rules.hold_back_m + site.rules.length_m
    first_m = max(0.0, whole_m - reach_m) if at_end else 0.0
    part = cut_line(path, first_m, min(whole_m, first_m + reach_m))
    along = measure_along(part)
    places = locate_at(part, along, np.linspace(0.0, along[-1], 2 + int(along[-1] / LINE_STEP_M)))
    headings = np.arctan2(*np.diff(places, axis=0).T[::-1])
    back_m = site.body.guide_m - site.axle_m
    return np.column_stack([places[1:] - back_m * np.column_stack([np.cos(headings), np.sin(headings)]), headings])


def _find_traffic(
    table: MoveTable,
    each: DirectedRound,
    tractor: int,
    coming: tuple[Sequence[_Passage], bool],
    leaving: tuple[Sequence[_Passage], bool],
    stands_in_way: StandsInWay,
) -> ColumnTraffic:
    """Who passes a tractor in its place and in its queue; the flags say whether others do so in any order."""
    count = len(each.one.columns)
    row, begin = get_row(tractor, count), each.one.columns[tractor].get_ends(each.way)[0]

    def find_clear(passages: Sequence[_Passage], passes: Callable[[int], bool], forwards: bool) -> FindPlace:
        poses = [passages[k].poses for k in range(count) if k != tractor and passes(get_row(k, count))]
        poses = [each for each in poses if len(each)]
        return lambda place_m: find_clear_place(table.site, stands_in_way, begin, poses, place_m, forwards)

    (comers, in_any_order), (leavers, out_in_any_order) = coming, leaving
    return ColumnTraffic(
        find_clear(comers, lambda other: in_any_order or other >= row, True),
        find_clear(leavers, lambda other: out_in_any_order or other <= row, False),
        comers[tractor].join_m,
        leavers[tractor].leave_m,
    )
