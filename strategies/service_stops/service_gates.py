"""Stops in the legs of tractors at which tanks are refilled or emptied, gates that let one tractor at a time be served,
what the notes of a plan hold of its stops, and what its tractors carry.

Of a plan that does not say what a tractor carries, the most work that any of its tractors does with one load is taken
as a load.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from fields.geometry.arithmetic import ROUNDING
from strategies.path_planning.paths import Pose
from strategies.rules.supply import PLACE, Supply
from vehicle.missions.plan import DRIVE_IN, REFILL, Leg, LegGate, Mission, NotedStop, Plan

SERVICE_CLEAR_M = 20.0  # a place is free when the tractor before has driven this far from it
WAIT_POINT_STEP_M = SERVICE_CLEAR_M  # between places to wait on the path to a place and back, with several tractors
MOVED_OFF_M = 0.5  # a service vehicle is free when the tractor before has driven this far


@dataclass(frozen=True)
class ServiceStop:
    """Before leg `leg` the tank is refilled or emptied by `amount` (l or kg; kWh of a battery).

    The tractor may wait for its turn before leg `hold_leg`.
    """

    leg: int
    hold_leg: int
    amount: float


def find_waiting_leg(legs: Sequence[Leg], least: int) -> int:
    """The last leg before a stop, from `least` on, before which a tractor may wait; else the path to the stop."""
    work_legs = (number for number in range(len(legs) - 1, least - 1, -1) if legs[number].may_wait)
    return next(work_legs, len(legs))


def note_stops(plan: Plan, stops: Sequence[Sequence[ServiceStop]], supply: Supply) -> Plan:
    """The plan with the stops of its tractors in its notes."""
    noted = tuple(
        NotedStop(number, stop.leg, round(stop.amount, 3), *mission.legs[stop.leg].points[0].tolist())
        for number, (mission, own) in enumerate(zip(plan.missions, stops, strict=True))
        for stop in own
    )
    return replace(plan, notes=replace(plan.notes, stops=noted, collects=supply.collects, service=supply.service))


@dataclass
class _ServiceClock:
    """When each tractor begins its legs at the earliest (s), and when it has finished the last of them."""

    legs: list[list[Leg]]
    begun_s: list[list[float]]
    free_s: list[float]

    def compute_ready_s(self, tractor: int) -> float:
        """When a tractor can begin its next leg (s); infinite if that is not known, or it has none."""
        number = len(self.begun_s[tractor])
        if number == len(self.legs[tractor]):
            return math.inf
        return max(
            [self.free_s[tractor], *(self._compute_opening_s(gate) for gate in self.legs[tractor][number].gates)]
        )

    def _compute_opening_s(self, gate: LegGate) -> float:
        begun_s = self.begun_s[gate.tractor]
        if gate.leg >= len(begun_s):
            return math.inf
        leg = self.legs[gate.tractor][gate.leg]
        return begun_s[gate.leg] + leg.standing_s + min(gate.after_m, leg.length_m) / leg.speed_mps

    def begin_leg(self, tractor: int, begin_s: float) -> None:
        """Let a tractor begin its next leg."""
        leg = self.legs[tractor][len(self.begun_s[tractor])]
        self.begun_s[tractor].append(begin_s)
        self.free_s[tractor] = begin_s + leg.standing_s + leg.length_m / leg.speed_mps


def add_service_gates(plan: Plan, stops: Iterable[Sequence[ServiceStop]], supply: Supply) -> Plan:
    """The plan with gates by which its tractors are served one at a time, if only one can be, as they would arrive.

    Tractors are moved leg by leg in the order of time at the speeds of their legs, so whoever waits does so for one
    that moves on: no two wait for each other.
    """
    if not supply.one_at_a_time or plan.tractors <= 1:
        return plan
    legs = [list(mission.legs) for mission in plan.missions]
    clock = _ServiceClock(legs, [[] for _ in legs], [0.0] * len(legs))
    waits_afar = supply.served_at == PLACE
    stops_by_leg = [{stop.hold_leg if waits_afar else stop.leg: stop for stop in of_tractor} for of_tractor in stops]
    queued_legs: set[tuple[int, int]] = set()
    last_served: tuple[int, LegGate] | None = None
    while True:
        ready_s = [round(clock.compute_ready_s(tractor), 3) for tractor in range(len(legs))]
        tractor = ready_s.index(min(ready_s))
        number = len(clock.begun_s[tractor])
        if math.isinf(ready_s[tractor]):
            return replace(plan, missions=tuple(Mission(tuple(tractor_legs)) for tractor_legs in legs))
        if number not in stops_by_leg[tractor] or (tractor, number) in queued_legs:
            clock.begin_leg(tractor, ready_s[tractor])
            continue
        queued_legs.add((tractor, number))
        if last_served is not None and last_served[0] != tractor:
            legs[tractor][number] = legs[tractor][number].copy_with_gates([last_served[1]])
        last_served = tractor, _build_leaving_gate(legs[tractor], tractor, stops_by_leg[tractor][number], supply)


def _build_leaving_gate(legs: Sequence[Leg], tractor: int, stop: ServiceStop, supply: Supply) -> LegGate:
    """Gate that opens when a tractor has left where it is served."""
    leg, distance_m = stop.leg, SERVICE_CLEAR_M if supply.served_at == PLACE else MOVED_OFF_M
    while distance_m > legs[leg].length_m and leg + 1 < len(legs) and legs[leg].task.kind != DRIVE_IN:
        distance_m -= legs[leg].length_m
        leg += 1
    return LegGate(tractor, leg, max(0.0, min(distance_m, legs[leg].length_m)))


def infer_supply(missions: Sequence[Sequence[Leg]], width_m: float, served_at: str) -> Supply | None:
    """What tractors with these legs carry, in square metres worked; None if none of them stops.

    A load is the most that one works between two stops. `served_at` is used if no leg leads to a place.
    """
    stops_s = [leg.stand_s for legs in missions for leg in legs if leg.stand_s > 0.0]
    if not stops_s:
        return None
    max_load_m = max(metres for legs in missions for metres in _list_worked_between_stops_m(legs))
    return Supply(
        max_load_m * (1.0 + ROUNDING) * width_m,
        1.0,
        max(stops_s),
        served_at=PLACE if list_service_points(missions) else served_at,
    )


def _list_worked_between_stops_m(legs: Sequence[Leg]) -> Iterator[float]:
    """Metres worked between stops."""
    worked_m = 0.0
    for leg in legs:
        if leg.stand_s > 0.0:
            yield worked_m
            worked_m = 0.0
        worked_m += leg.length_m * leg.implement
    yield worked_m


def list_service_points(missions: Sequence[Sequence[Leg]]) -> tuple[Pose, ...]:
    """The distinct poses in which tractors with these legs stand at a place."""
    points: dict[Pose, None] = {}
    for legs in missions:
        for before, leg in pairwise(legs):
            if leg.stand_s > 0.0 and before.task.kind == REFILL:
                (x, y), (x1, y1) = leg.points[:2].tolist()
                points.setdefault((x, y, math.atan2(leg.gear * (y1 - y), leg.gear * (x1 - x))))
    return tuple(points)


def list_stops(legs: Sequence[Leg], supply: Supply, width_m: float) -> tuple[ServiceStop, ...]:
    """The stops in some legs with their amounts, and where a tractor may wait for its turn before each."""
    numbers = [number for number, leg in enumerate(legs) if leg.stand_s > 0.0]
    loads = [supply.compute_legs_need(legs[a:b], width_m) for a, b in pairwise([0, *numbers, len(legs)])]
    stops = list[ServiceStop]()
    for number, amount in zip(numbers, supply.include_trips().list_amounts(loads), strict=True):
        approach_leg = number
        while approach_leg > 0 and legs[approach_leg - 1].task.kind == REFILL:
            approach_leg -= 1
        hold_leg = find_waiting_leg(legs[:approach_leg], stops[-1].leg + 1 if stops else 0)
        stops.append(ServiceStop(number, hold_leg, amount))
    return tuple(stops)
