"""What the formations of a site have in common, whatever their rule: found for the first that asks, then remembered.

Rounds are put in order, those without room for their tractors are dropped, and the other lines are shared out. Whatever
is dropped, the search begins anew with a fresh table of moves, so that nothing depends on what was asked before.

Places of all rounds are clear of tractors that come to a round and of those that leave it. Where rows come and leave
one after another, who stands in its place is in the way of rows behind it only, and who stands in the queue in that of
rows ahead of it. To the first round and from the last they come and go in any order.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from strategies.formations.columns import find_runs, list_columns
from strategies.formations.passing import LINE_STEP_M, PassageTracer, PassingWay
from strategies.formations.round_order import DirectedRound, join_rounds, order_rounds, sketch_rounds
from strategies.formations.rounds import (
    ColumnRound,
    ColumnTraffic,
    compute_needed_length_m,
    divide_runs,
    get_row,
    place_tractors,
)
from strategies.formations.tours import FormationTour, share_lines, sketch_tours
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.move_table import MoveTable
from strategies.programmes.site_moves import SiteMoves
from vehicle.sim.path_conflicts import ClearanceCheck

ADVICE = "use fewer tractors, or split-field or interleaved"
T = TypeVar("T")
Dropped = frozenset[ColumnRound]


@dataclass(frozen=True, eq=False)
class OrderedRounds:
    """Rounds in order by moves of a table, and the tours that they are part of, none before lines are shared out."""

    table: MoveTable
    rounds: tuple[DirectedRound, ...]
    tours: tuple[FormationTour, ...] = ()


@dataclass(frozen=True)
class FleetOrder:
    """How many tractors work in formation, with the headland first or last ("" for any), and whether `in_rows`."""

    tractors: int
    headland: str
    in_rows: bool

    @property
    def ends(self) -> tuple[bool, bool]:
        """Whether the formation comes from the entrance, and goes home from its last round."""
        return self.headland != HEADLAND_FIRST, self.headland in ("", HEADLAND_FIRST)


@dataclass(frozen=True, eq=False)
class FormationSite:
    """The formations of a site; all that raise StrategyError do so where there is none.

    Attributes:
        moves: between the lines of the site.
        check: tells who stands in whose way.
    """

    moves: SiteMoves
    check: ClearanceCheck
    _known: dict[Hashable, Any] = field(default_factory=dict)

    def sketch(self, fleet: FleetOrder) -> OrderedRounds:
        """All rounds and tours as they are likely to be, before anything is driven for them."""

        def find() -> OrderedRounds:
            table = MoveTable(self.moves)
            rounds = sketch_rounds(table, self._list_rounds(fleet.tractors), fleet.ends)
            return OrderedRounds(table, tuple(rounds), tuple(sketch_tours(table, rounds, fleet.headland)))

        return self._recall((fleet.tractors, fleet.headland, "sketched"), find)

    def share(self, fleet: FleetOrder) -> OrderedRounds:
        """The rounds that have room and the tours that they are part of."""
        return self._recall((fleet, "shared"), lambda: self._share_with_room(fleet))

    def _recall(self, key: Hashable, find: Callable[[], T]) -> T:
        """What was found for a key, or refused."""
        if key not in self._known:
            try:
                self._known[key] = find()
            except StrategyError as refusal:
                self._known[key] = refusal
        found: T | StrategyError = self._known[key]
        if isinstance(found, StrategyError):
            raise found
        return found

    @cached_property
    def _tracer(self) -> PassageTracer:
        return PassageTracer(self.moves.site, self.check)

    def _share_with_room(self, fleet: FleetOrder) -> OrderedRounds:
        dropped: Dropped = frozenset()
        while True:
            dropped = self._drop_cramped(fleet, dropped)
            placed, cramped = self._place(self._share(fleet, dropped), fleet.in_rows)
            if cramped is None:
                return placed
            dropped |= {cramped}

    def _drop_cramped(self, fleet: FleetOrder, dropped: Dropped) -> Dropped:
        """The rounds dropped, with those that lack room before other lines are shared out."""
        while True:
            _, cramped = self._place(self._order(fleet, dropped), fleet.in_rows)
            if cramped is None:
                return dropped
            dropped |= {cramped}

    def _place(self, ordered: OrderedRounds, in_rows: bool) -> tuple[OrderedRounds, ColumnRound | None]:
        """Rounds with their places, and the one that lacks most room, if any does."""
        placed = place_rounds(ordered.table, ordered.rounds, ordered.tours, self._tracer, in_rows=in_rows)
        return replace(ordered, rounds=tuple(placed)), find_cramped_round(placed)

    def _order(self, fleet: FleetOrder, dropped: Dropped) -> OrderedRounds:
        """All rounds but those dropped in their best order."""
        key = fleet.tractors, fleet.headland, dropped, "ordered"
        return self._recall(key, lambda: self._order_on(MoveTable(self.moves), fleet, dropped))

    def _order_on(self, table: MoveTable, fleet: FleetOrder, dropped: Dropped) -> OrderedRounds:
        remaining = [one for one in self._list_rounds(fleet.tractors) if one not in dropped]
        directed = order_rounds(table, remaining, fleet.ends) if remaining else []
        if not directed:
            raise StrategyError(
                f"No round of {fleet.tractors} tractors has room clear of those that pass it; {ADVICE}."
            )
        return OrderedRounds(table, tuple(directed))

    def _share(self, fleet: FleetOrder, dropped: Dropped) -> OrderedRounds:
        """All rounds but those dropped in order, and the tours that they are part of."""

        def share() -> OrderedRounds:
            ordered = self._order(fleet, dropped)
            table = ordered.table
            while True:
                tours = share_lines(table, ordered.rounds, fleet.headland, self.check)
                if tours:
                    return OrderedRounds(table, tuple(join_rounds(table, ordered.rounds)), tuple(tours))
                ordered = self._order_on(table, fleet, dropped)  # what was struck is no move any more

        return self._recall((fleet.tractors, fleet.headland, dropped, "shared"), share)

    def _list_rounds(self, tractors: int) -> list[ColumnRound]:
        return self._recall(tractors, lambda: self._divide(tractors))

    def _divide(self, tractors: int) -> list[ColumnRound]:
        """The rounds of a number of tractors."""
        rules = self.moves.site.rules
        columns = self._recall("columns", lambda: list_columns(MoveTable(self.moves)))
        if not columns:
            raise StrategyError(f"A formation needs straight tracks side by side, and those here are curved; {ADVICE}.")
        rounds = divide_runs(find_runs(columns, self.moves.site.width_m), tractors, rules)
        if not rounds:
            rows = max(get_row(tractor, tractors) for tractor in range(tractors))
            raise StrategyError(
                f"A formation of {tractors} tractors needs {tractors} tracks of at least "
                f"{compute_needed_length_m(rules, rows):.1f} m side by side, and the field has none; {ADVICE}."
            )
        return rounds


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
                partial(find, before, step_m=LINE_STEP_M),
                partial(find, behind, step_m=-LINE_STEP_M),
                comers[tractor].join_m,
                leavers[tractor].leave_m,
            )
        )
    return traffic
