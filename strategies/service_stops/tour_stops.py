"""The stops of one tractor on its tour of work lines: what its loads take, what a stop costs, and which are made.

Those of least time are found exactly, by dynamic programming over the gaps between the lines. Gap k is before line k;
gap 0 is the start and gap n the end of a tour of n lines. A load that begins in gap i and ends in gap j takes what the
way on from gap i takes, the lines i to j - 1 with the moves between them, and the way off in gap j. Who comes sooner is
never served later, so the least time to every gap is enough to know.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import accumulate, pairwise

import numpy as np

from fields.geometry.arithmetic import ROUNDING
from strategies.moves.drives import build_path_legs
from strategies.moves.move import Move
from strategies.path_planning.errors import StrategyError
from strategies.programmes.move_table import MoveTable
from strategies.programmes.order_tours import NO_MOVE_S
from strategies.rules.supply import PLACE, Supply
from strategies.service_stops.service_gates import SERVICE_CLEAR_M
from strategies.service_stops.stop_moves import StopMoves, Trip
from strategies.service_stops.tour_parts import TourPart, cut_at_wait_points, measure_line_need
from vehicle.missions.plan import ROUTE, Leg, LegTask

Span = tuple[float, float]
COST_TOLERANCE_S = 1e-6
WaitEstimate = Callable[[int, float], float]
"""Seconds that a tractor waits to be served in a gap, given the seconds taken by stops before it."""


@dataclass(frozen=True)
class TourNeeds:
    """What the parts of a tour of n lines take of a load.

    Attributes:
        lines: (n) of every line.
        moves: (n) of the move to every line that is driven without a stop; nothing for the first.
        ways_off: (n + 1) of the way to be served in each gap; in the last one out of the field.
        ways_on: (n + 1) of the way on from there to the line; in the first gap into the field.
    """

    lines: Sequence[float]
    moves: Sequence[float]
    ways_off: Sequence[float]
    ways_on: Sequence[float]

    def list_loads(self, gaps: Sequence[int]) -> list[float]:
        """What the loads take if there is a stop in each of some gaps."""
        return [
            math.fsum([*self.lines[i:k], *self.moves[i + 1 : k], self.ways_on[i], self.ways_off[k]])
            for i, k in pairwise([0, *gaps, len(self.lines)])
        ]


def choose_stops(
    needs: TourNeeds, costs_s: Sequence[float], capacity: float, estimate_wait_s: WaitEstimate
) -> tuple[int, ...] | None:
    """The gaps to stop in for the least sum of costs and waits; None if no stops are enough.

    `costs_s` (n) are the extra seconds of a stop in each gap; the first load is whole. Of equal sums the one with later
    stops is taken.
    """
    count, most = len(needs.lines), capacity * (1.0 + ROUNDING)
    longest = most - min(0.0, min(needs.ways_on) + min(needs.ways_off))  # a bend may cut the line before a stop
    begun_s = [0.0] + [math.inf] * count
    came_from = [0] * (count + 1)
    for end in range(1, count + 1):
        least_s, between = math.inf, 0.0
        for start in range(end - 1, -1, -1):
            between += needs.lines[start] + (needs.moves[start + 1] if start + 1 < end else 0.0)
            if between > longest:
                break
            load = between + needs.ways_on[start] + needs.ways_off[end]
            if load <= most and begun_s[start] < least_s - COST_TOLERANCE_S:
                least_s, came_from[end] = begun_s[start], start
        if math.isfinite(least_s) and end < count:
            least_s += costs_s[end] + estimate_wait_s(end, least_s)
        begun_s[end] = least_s
    if math.isinf(begun_s[count]):
        return None
    gaps, gap = list[int](), came_from[count]
    while gap:
        gaps.append(gap)
        gap = came_from[gap]
    return tuple(reversed(gaps))


@dataclass(frozen=True)
class Detour:
    """A stop in a gap, or the least that one can take where its moves are not found yet.

    Attributes:
        extra_s, cost_s: seconds more than without a stop, and with all charges; both without the time to be served.
        arrive_s: seconds to the place.
        off, on: what the ways to the place and on from there take of a load; less than nothing where lines are cut.
        arrive, depart: their moves; None where not found, and where a tractor is served at the end of its line.
    """

    extra_s: float
    cost_s: float
    arrive_s: float
    off: float
    on: float
    arrive: Move | None = None
    depart: Move | None = None


NOWHERE = Detour(NO_MOVE_S, NO_MOVE_S, NO_MOVE_S, math.inf, math.inf)


@dataclass(frozen=True)
class TourStop:
    """A stop before part `gap` of a tour: what is filled in, and how long that takes (s)."""

    gap: int
    detour: Detour
    amount: float
    stand_s: float


@dataclass(eq=False)
class TourGaps:
    """What a stop costs in the gaps between the parts of a tour, and what the parts take of a load.

    Attributes:
        moves: to places and on; without a place a tractor is served at the end of a line.
        busy_spans: when others are served (from, to; s) and this tractor waits.
        is_rough: whether ways not yet found are estimated, for comparing tours; else they are found where needed.
    """

    table: MoveTable
    supply: Supply
    tour: Sequence[TourPart]
    moves: StopMoves | None
    busy_spans: Sequence[Span] = ()
    is_rough: bool = False
    _detours: dict[int, Detour] = field(default_factory=dict)
    _bounds: dict[int, Detour] = field(default_factory=dict)

    @cached_property
    def load_supply(self) -> Supply:
        """The supply whose loads hold the ways to places too."""
        return self.supply.include_trips()

    @cached_property
    def parts(self) -> list[TourPart]:
        """The parts of the tour in order, as short as stops may be made between them."""
        return cut_at_wait_points(self.table, self.tour)

    @cached_property
    def line_needs(self) -> dict[int, float]:
        """What the whole line of every node of the tour takes of a load."""
        return {part.node: measure_line_need(self.table, self.supply, part.node) for part in self.tour}

    def is_inside_line(self, gap: int) -> bool:
        """Whether the part after a gap goes on where that before it ends."""
        return 0 < gap < len(self.parts) and self.parts[gap - 1].leads_to(self.parts[gap])

    @cached_property
    def direct_moves(self) -> list[Move | None]:
        """The move in every gap without a stop; None inside a line, where none was driven, and where no entrance is."""
        return [self._find_direct_move(gap) for gap in range(len(self.parts) + 1)]

    def _find_direct_move(self, gap: int) -> Move | None:
        gate, count = self.table.gate, len(self.parts)
        is_whole = (gap == 0 or self.parts[gap - 1].is_last) and (gap == count or self.parts[gap].is_first)
        u, v = self.parts[gap - 1].node if gap else gate, self.parts[gap].node if gap < count else gate
        if not is_whole or (gate in (u, v) and self.table.site.lane is None) or not self.table.is_proven(u, v):
            return None
        return self.table.get_move(u, v)

    @property
    def has_ends(self) -> bool:
        """Whether moves lead into the field and out of it, where it has an entrance."""
        ends = (0, len(self.parts)) if self.parts[0].node not in self.table.starts else (len(self.parts),)
        return self.table.site.lane is None or all(self.direct_moves[gap] is not None for gap in ends)

    @cached_property
    def direct_times_s(self) -> list[tuple[float, float]]:
        """Seconds of the move in every gap without a stop, and with all charges; nothing where there is none."""
        return [(0.0, 0.0) if move is None else (move.drive_s, move.cost_s) for move in self.direct_moves]

    @cached_property
    def part_needs(self) -> list[float]:
        """What every part takes of a load."""
        return [self.measure_part_need(part) for part in self.parts]

    def measure_part_need(self, part: TourPart) -> float:
        """What a part takes of a load; where a tractor stands, what it has used before."""
        if part.is_stand:
            return self.table.moves.get_used(part.node)
        return self.share_need(part, part.last_m - part.first_m)

    def share_need(self, part: TourPart, length_m: float) -> float:
        """What so many metres of the line of a part take of a load."""
        return length_m / part.line_m * self.line_needs[part.node]

    @cached_property
    def direct_needs(self) -> list[float]:
        """What the move in every gap takes without a stop, less what it saves on the lines that it cuts."""
        return [0.0 if one is None else self._measure_move_need(gap, one) for gap, one in enumerate(self.direct_moves)]

    @property
    def mean_move_need(self) -> float:
        """What a move between two lines takes in the mean, without what moves save on the lines that they cut."""
        count = sum(part.is_last for part in self.parts) - 1
        return sum(max(need, 0.0) for need in self.direct_needs[1:-1]) / max(count, 1)

    @property
    def total_need(self) -> float:
        """What the whole tour takes without a stop."""
        return math.fsum(self.part_needs) + math.fsum(self.direct_needs)

    def _measure_need(self, legs: Sequence[Leg]) -> float:
        return self.supply.compute_legs_need(legs, self.table.site.width_m)

    def _measure_move_need(self, gap: int, move: Move) -> float:
        """What a move in a gap takes of a load."""
        need = self._measure_need(build_path_legs(self.table.site, move.path, LegTask(ROUTE), is_work=move.is_work))
        for cut_m, number in ((move.leave_m, gap - 1), (move.join_m, gap)):
            if cut_m:
                need -= self.share_need(self.parts[number], cut_m)
        return need

    @cached_property
    def finishes_s(self) -> list[float]:
        """When the part before each gap is finished without any stop (s)."""
        speed = self.table.site.rules.work_speed_mps
        seconds = [
            self.direct_times_s[gap][0] + (part.last_m - part.first_m) / speed for gap, part in enumerate(self.parts)
        ]
        return list(accumulate(seconds, initial=0.0))

    @property
    def driven_s(self) -> float:
        """Seconds of the whole tour without any stop."""
        return self.finishes_s[-1] + self.direct_times_s[-1][0]

    def get_detour(self, gap: int) -> Detour:
        """The best stop in a gap; NOWHERE if no move leads to a place and on."""
        if gap not in self._detours:
            self._detours[gap] = self._serve_here(gap) if self.moves is None else self._find_detour(gap, self.moves)
        return self._detours[gap]

    def get_bound(self, gap: int) -> Detour:
        """The best stop in a gap if it is known, else the least that it can take."""
        if gap in self._detours or self.moves is None:
            return self.get_detour(gap)
        if gap not in self._bounds:
            self._bounds[gap] = self._bound_detour(gap, self.moves)
        return self._bounds[gap]

    def _serve_here(self, gap: int) -> Detour:
        """A stop at the end of a part, which the move after it may cut."""
        if not self.is_passable(gap):
            return NOWHERE
        move = self.direct_moves[gap]
        cut = 0.0 if move is None else self.share_need(self.parts[gap - 1], move.leave_m)
        return Detour(0.0, 0.0, 0.0, -cut, self.direct_needs[gap] + cut)

    def _find_detour(self, gap: int, moves: StopMoves) -> Detour:
        found, (direct_s, direct_cost_s) = [NOWHERE], self.direct_times_s[gap]
        for way_off, way_on in self._list_trips(gap, moves):
            arrive = moves.get_move(way_off)
            depart = None if arrive is None else moves.get_move(way_on)
            if arrive is not None and depart is not None:
                extra_s = arrive.drive_s + depart.drive_s - direct_s
                cost_s = arrive.cost_s + depart.cost_s - direct_cost_s
                off, on = self._measure_move_need(gap, arrive), self._measure_move_need(gap, depart)
                found.append(Detour(extra_s, cost_s, arrive.drive_s, off, on, arrive, depart))
        return min(found, key=lambda detour: round(detour.cost_s, 3))

    def _bound_detour(self, gap: int, moves: StopMoves) -> Detour:
        """The least that a stop can take: straight to the place and on at the speed of turns."""
        trips, speed = self._list_trips(gap, moves), self.table.site.rules.turn_speed_mps
        off_m, on_m = (min(moves.bound_flight_m(both[end]) for both in trips) for end in (0, 1))
        off, on = (
            self._measure_need([Leg(np.array([[0.0, 0.0], [flight_m, 0.0]]), speed)]) if flight_m > 0.0 else 0.0
            for flight_m in (off_m, on_m)
        )
        direct_s, direct_cost_s = self.direct_times_s[gap]
        ways_s = (off_m + on_m) / speed
        if self.is_rough:
            ways_s = min(sum(moves.estimate_s(trip) for trip in both) for both in trips)
        return Detour(ways_s - direct_s, ways_s - direct_cost_s, off_m / speed, off, on)

    def _list_trips(self, gap: int, moves: StopMoves) -> list[tuple[Trip, Trip]]:
        """For every place the trips to it from a gap and on."""
        before, after = self.parts[gap - 1], self.parts[gap]
        return moves.list_trips((before.node, before.last_m), (after.node, after.first_m))

    def compute_stop_cost_s(self, gap: int) -> float:
        """Extra seconds of a stop in a gap with all charges, and the time to be served; the least where not found."""
        detour = self.get_bound(gap)
        if math.isinf(detour.off):
            return NO_MOVE_S
        return detour.cost_s + self.load_supply.compute_stop_s(detour.off + detour.on - self.direct_needs[gap])

    @cached_property
    def mean_stand_s(self) -> float:
        """How long a stop takes in the mean (s)."""
        return self.supply.estimate_stop_s(self.total_need)

    def find_service_span(self, gap: int, later_s: float) -> Span:
        """When a tractor is served in a gap (from, to; s), given the delay by stops before.

        At a place from when it sets out for it until it is clear of it. It waits for those who were there before it;
        who comes later waits for it.
        """
        blocked_s = self.mean_stand_s
        if self.moves is not None:
            blocked_s += self.get_bound(gap).arrive_s + SERVICE_CLEAR_M / self.table.site.rules.turn_speed_mps
        ready = self.finishes_s[gap] + later_s
        begin = max([ready, *(last for first, last in self.busy_spans if first <= ready)])
        return begin, begin + blocked_s

    def compute_wait_s(self, gap: int, later_s: float) -> float:
        """How long a tractor waits for its turn in a gap (s)."""
        return self.find_service_span(gap, later_s)[0] - self.finishes_s[gap] - later_s

    def is_passable(self, gap: int) -> bool:
        """Whether a gap can be driven without a stop."""
        return self.is_inside_line(gap) or self.direct_moves[gap] is not None

    def build_needs(self) -> TourNeeds:
        """What the parts of the tour take of a load, as far as known."""
        count = len(self.parts)
        detours = [self.get_bound(gap) for gap in range(1, count)]
        ways_off = [0.0, *(detour.off for detour in detours), self.direct_needs[count]]
        ways_on = [self.direct_needs[0], *(detour.on for detour in detours), 0.0]
        moves = [self.direct_needs[gap] if gap == 0 or self.is_passable(gap) else math.inf for gap in range(count)]
        return TourNeeds(self.part_needs, moves, ways_off, ways_on)

    def choose_gaps(self) -> tuple[int, ...] | None:
        """The gaps to stop in; None if no stops are enough. Moves are found only where the cheapest stops use them."""
        while True:
            costs_s = [0.0, *(self.compute_stop_cost_s(gap) for gap in range(1, len(self.parts)))]
            gaps = choose_stops(self.build_needs(), costs_s, self.load_supply.capacity, self.compute_wait_s)
            unknown = [gap for gap in gaps or () if gap not in self._detours]
            if self.is_rough or not unknown:
                return gaps
            for gap in unknown:
                self.get_detour(gap)

    def measure_cost_s(self, gaps: Sequence[int]) -> float:
        """Seconds of all moves of the tour and of the stops in some gaps, with all charges."""
        return math.fsum(cost_s for _, cost_s in self.direct_times_s) + math.fsum(map(self.compute_stop_cost_s, gaps))

    def list_stops(self) -> tuple[TourStop, ...]:
        """The stops of the tour; raises StrategyError if no stops are enough."""
        gaps = self.choose_gaps()
        if gaps is None:
            raise StrategyError(self._explain_no_stops())
        amounts = self.load_supply.list_amounts(self.build_needs().list_loads(gaps))
        stops = []
        for gap, amount in zip(gaps, amounts, strict=True):
            stops.append(TourStop(gap, self.get_detour(gap), amount, self.supply.compute_stop_s(amount)))
        return tuple(stops)

    def list_service_spans(self, stops: Sequence[TourStop]) -> list[Span]:
        """When the tractor is expected to be served (from, to; s)."""
        spans, later_s = list[Span](), 0.0
        for stop in stops:
            spans.append(self.find_service_span(stop.gap, later_s))
            later_s += self.compute_wait_s(stop.gap, later_s) + stop.detour.extra_s + stop.stand_s
        return spans

    def _explain_no_stops(self) -> str:
        """Why no stops are enough, and what helps."""
        largest = max(self.part_needs)
        if largest > self.load_supply.capacity or self.supply.served_at != PLACE:
            return self.supply.explain_small_load(largest)
        x, y = self.supply.place or (0.0, 0.0)
        return (
            f"No path with a turning radius of {self.table.site.rules.radius_m:.1f} m leads to the place of service at "
            f"({x:.0f}, {y:.0f}) m and back before a load is used up; use another place, or the headland."
        )
