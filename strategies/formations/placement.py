"""Places of all rounds, clear of tractors that come to a round and of those that leave it.

Where rows come and leave one after another, who stands in its place is in the way of rows behind it only, and who
stands in the queue in that of rows ahead of it. To the first round and from the last they come and go in any order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from strategies.formations.passing import PassageTracer, PassingWay
from strategies.formations.round_order import DirectedRound
from strategies.formations.rounds import ColumnRound, ColumnTraffic, get_row, place_tractors
from strategies.formations.tours import FormationTour
from strategies.programmes.move_table import MoveTable

CLEAR_STEP_M = 1.0  # between the places that are tried


def place_rounds(
    table: MoveTable,
    order: Sequence[DirectedRound],
    tours: Sequence[FormationTour],
    tracer: PassageTracer,
    *,
    in_rows: bool,
) -> list[DirectedRound]:
    """The rounds of an order with their places, for the tours that they are part of, none where these are not known.

    Tractors come and leave `in_rows`, or in any order.
    """
    nowhere = [PassingWay(np.empty((0, 3)))] * len(order[0].one.columns)
    between = [list(map(tracer.trace_move, after.moves)) for after in order[1:]]
    arrivals = [tracer.trace_arrival(table, tour.before, tour.rounds[0]) for tour in tours]
    departures = [tracer.trace_departure(table, tour.rounds[-1], tour.after) for tour in tours]
    coming, leaving = [arrivals or nowhere, *between], [*between, departures or nowhere]
    placed = []
    for number, each in enumerate(order):
        is_first, is_last = not in_rows or number == 0, not in_rows or number == len(order) - 1
        traffic = _list_traffic(each, tracer, (coming[number], is_first), (leaving[number], is_last))
        placed.append(replace(each, places=tuple(place_tractors(each.one, each.way, table.site.rules, traffic))))
    return placed


def find_cramped_round(placed: Sequence[DirectedRound]) -> ColumnRound | None:
    """The round that lacks most room between its places and its queue; None where all have room."""
    missing_m = [max(place.missing_m for place in each.places) for each in placed]
    worst = int(np.argmax(np.round(missing_m, 3)))
    return placed[worst].one if missing_m[worst] > 0.0 else None


def _list_traffic(
    each: DirectedRound,
    tracer: PassageTracer,
    coming: tuple[Sequence[PassingWay], bool],
    leaving: tuple[Sequence[PassingWay], bool],
) -> list[ColumnTraffic]:
    """Who passes every tractor in its place and in its queue; the flags say whether others do so in any order."""
    (comers, in_any_order), (leavers, out_in_any_order) = coming, leaving
    rows = [get_row(tractor, len(comers)) for tractor in range(len(comers))]
    traffic = []
    for tractor, (row, column) in enumerate(zip(rows, each.one.columns, strict=True)):
        others = [k for k in range(len(rows)) if k != tractor]
        before = [comers[k] for k in others if in_any_order or rows[k] >= row]
        behind = [leavers[k] for k in others if out_in_any_order or rows[k] <= row]
        find = partial(tracer.find_clear_place, column.get_ends(each.way)[0])
        traffic.append(
            ColumnTraffic(
                partial(find, before, step_m=CLEAR_STEP_M),
                partial(find, behind, step_m=-CLEAR_STEP_M),
                comers[tractor].join_m,
                leavers[tractor].leave_m,
            )
        )
    return traffic
