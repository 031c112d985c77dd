"""What the formations of a site have in common, whatever their rule: found for the first that asks, then remembered.

Rounds are put in order, those without room for their tractors are dropped, and the other lines are shared out. Whatever
is dropped, the search begins anew with a fresh table of moves, so that nothing depends on what was asked before.

Places of all rounds are clear of tractors that come to a round and of those that leave it. Where rows come and leave
one after another, who stands in its place is in the way of rows behind it only, and who stands in the queue in that of
rows ahead of it. To the first round and from the last they come and go in any order. A way is traced once, and then
compared with all places that are asked about.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Any, TypeVar

import numpy as np

from fields.arrays import Flags, Floats, compute_angles, cut_line, measure_along
from strategies.formations.columns import find_runs, list_columns
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
from strategies.moves.move import Move
from strategies.path_planning.errors import SOLITARY_STRATEGIES, StrategyError
from strategies.path_planning.paths import DrivePath, Pose
from strategies.path_planning.turn_kinds import HEADLAND_FIRST
from strategies.programmes.move_table import MoveTable
from strategies.programmes.site_moves import SiteMoves
from strategies.programmes.waiting_places import sample_poses
from strategies.site.ground import CELL_M
from strategies.site.site import Site
from vehicle.sim.path_conflicts import ClearanceCheck, PosePath, build_poses

OFF_LINE_M = 4.0  # beyond the end of a move, on which a tractor is off its line
PLACE_STEP_M, MOST_STEPS = 1.0, 100  # between places that are tried
ADVICE = f"use fewer tractors, or {SOLITARY_STRATEGIES}"
T = TypeVar("T")
Dropped = frozenset[ColumnRound]


def _trace_body(site: Site, path: DrivePath) -> Floats:
    """Poses (n, 3) of the centre of mass along a path of the guided point, and beyond its end until it has settled.

    Forwards the axle trails the guided point, in reverse the body lies along the path.
    """
    settled = replace(path, segments=(*path.segments, replace(path.segments[-1], length_m=OFF_LINE_M, curvature=0.0)))
    guide_m, poses = site.body.guide_m, list[tuple[float, float, float]]()
    angle = path.start[2]
    x, y = path.start[0] - guide_m * math.cos(angle), path.start[1] - guide_m * math.sin(angle)
    for gear, points in settled.sample(CELL_M):
        headings = compute_angles(np.diff(points, axis=0)).tolist()
        for (px, py), heading in zip(points.tolist(), [*headings, headings[-1]], strict=True):
            angle = math.atan2(py - y, px - x) if gear > 0 else heading + math.pi
            x, y = px - guide_m * math.cos(angle), py - guide_m * math.sin(angle)
            poses.append((x + site.axle_m * math.cos(angle), y + site.axle_m * math.sin(angle), angle))
    return np.array(poses)


def _trace_line(site: Site, path: Floats, *, at_end: bool) -> Floats:
    """Poses (n, 3) on the part of a line within a machine's length of where a tractor may wait at its end, or begin."""
    whole_m, reach_m = float(measure_along(path)[-1]), site.rules.hold_back_m + site.rules.length_m
    first_m = max(0.0, whole_m - reach_m) if at_end else 0.0
    return sample_poses(cut_line(path, first_m, min(whole_m, first_m + reach_m)), site.back_m)


@dataclass(frozen=True, eq=False)
class PassingWay:
    """A tractor on its way to a round or from it: poses (n, 3), and what its move cuts from either column (m)."""

    poses: Floats
    leave_m: float = 0.0
    join_m: float = 0.0

    @cached_property
    def path(self) -> PosePath:
        """Its poses as they are compared with places."""
        return PosePath(build_poses(self.poses))

    @cached_property
    def circle(self) -> tuple[float, float, float]:
        """Centre and radius of a circle round all poses (m)."""
        x, y = self.poses[:, :2].mean(axis=0).tolist()
        return x, y, float(np.hypot(*(self.poses[:, :2] - (x, y)).T).max())

    def is_near(self, x: float, y: float, reach_m: float) -> bool:
        """Whether it may come nearer to a place than that; never if it has no poses."""
        if not len(self.poses):
            return False
        u, v, radius_m = self.circle
        return math.hypot(x - u, y - v) < radius_m + reach_m


@dataclass(eq=False)
class PassageTracer:
    """The passages of a site, and the places on columns clear of them; a way is traced once."""

    site: Site
    check: ClearanceCheck
    _moves: dict[Move, PassingWay] = field(default_factory=dict)

    def trace_move(self, move: Move) -> PassingWay:
        """The way of a move."""
        if move not in self._moves:
            self._moves[move] = PassingWay(_trace_body(self.site, move.path), move.leave_m, move.join_m)
        return self._moves[move]

    def trace_arrival(self, table: MoveTable, before: Sequence[int], first: int) -> PassingWay:
        """On the last part of the line before the rounds, where a tractor may wait, and from there on."""
        nodes = [*self._list_gate(table), *before]
        if not nodes:
            return PassingWay(np.empty((0, 3)))
        return self._trace_way(table, (nodes[-1], first), nodes[-1], at_end=True)

    def trace_departure(self, table: MoveTable, last: int, after: Sequence[int]) -> PassingWay:
        """To the line after the rounds, and on its first part."""
        nodes = [*after, *self._list_gate(table)]
        if not nodes:
            return PassingWay(np.empty((0, 3)))
        return self._trace_way(table, (last, nodes[0]), nodes[0], at_end=False)

    def _list_gate(self, table: MoveTable) -> list[int]:
        return [] if self.site.lane is None else [table.gate]

    def _trace_way(self, table: MoveTable, pair: tuple[int, int], node: int, *, at_end: bool) -> PassingWay:
        """A move, with part of the line of one of its nodes unless that is the entrance."""
        move = table.get_move(*pair)
        assert move is not None  # tours use moves that exist
        way = self.trace_move(move)
        if node == table.gate:
            return way
        parts = [_trace_line(self.site, table.lines[node // 2].paths[node % 2], at_end=at_end), way.poses]
        return replace(way, poses=np.concatenate(parts if at_end else parts[::-1]))

    def find_clear_place(self, begin: Pose, passages: Sequence[PassingWay], place_m: float, step_m: float) -> float:
        """The first place on a column from its begin, a distance on and then in steps, that is in nobody's way (m).

        With a step to spare, as nobody stops and drives quite as planned; infinite where there is none.
        """
        if not math.isfinite(place_m):
            return place_m
        for count in (1, MOST_STEPS):  # mostly the first will do
            along_m: Floats = place_m + step_m * np.arange(-1.0, count)
            blocked = self._find_blocked(begin, along_m, passages)
            clear = np.flatnonzero(~(blocked[1:] | blocked[:-1]))
            if len(clear):
                return float(along_m[1 + clear[0]])
        return math.copysign(math.inf, step_m)

    def _find_blocked(self, begin: Pose, along_m: Floats, passages: Sequence[PassingWay]) -> Flags:
        """At which distances along a column from its begin one stands in the way of any passage."""
        x, y, heading = begin
        ahead_m = along_m - self.site.back_m
        ways = x + ahead_m * math.cos(heading), y + ahead_m * math.sin(heading)
        u, v = (0.5 * float(way[0] + way[-1]) for way in ways)
        reach_m = self.check.reach_m + 0.5 * abs(float(along_m[-1] - along_m[0]))
        near = [one.path for one in passages if one.is_near(u, v, reach_m)]
        if not near:
            return np.zeros(len(along_m), bool)
        return self.check.find_blocked(np.column_stack([*ways, np.full(len(along_m), heading)]), near)


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
        placed = _place_rounds(ordered.table, ordered.rounds, ordered.tours, self._tracer, in_rows=in_rows)
        missing_m = [max(place.missing_m for place in each.places) for each in placed]
        worst = int(np.argmax(np.round(missing_m, 3)))
        return replace(ordered, rounds=tuple(placed)), placed[worst].one if missing_m[worst] > 0.0 else None

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


def _place_rounds(
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
                partial(find, before, step_m=PLACE_STEP_M),
                partial(find, behind, step_m=-PLACE_STEP_M),
                comers[tractor].join_m,
                leavers[tractor].leave_m,
            )
        )
    return traffic
