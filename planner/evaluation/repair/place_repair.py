"""Slower driving where a run touches an obstacle, crosses a fence or leaves the field: there, and only there.

Legs of any task are cut around the place, so that the rest of a swath or headland pass keeps its speed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import ContactPlace, find_contact_places
from planner.evaluation.ground.coverage import locate_antenna
from planner.evaluation.repair.turn_trial import cut_leg_between
from vehicle.missions.plan import Leg, LegGate, Mission, Plan
from vehicle.missions.run import SimulationRun

SLOW_FACTORS = (0.6, 0.36)  # times the speed driven at the place
MAX_ROUNDS = 4
MIN_SPEED_MPS = 0.4
MAX_SLOW_SHARE = 0.9  # of the driven speed: less is not worth cutting legs
MIN_GAIN_M = 0.01  # in the sum of all depths
LEAD_M, TAIL_M = 6.0, 3.0  # driven slowly before and behind a place; braking comes before
BRAKING_MPS2 = 0.35
MIN_PART_M = 1.0  # shorter parts of legs are not cut off
SPEED_ROWS = 10  # of the 10 Hz record around a place, over which its speed is measured
Resolve = Callable[[Plan], tuple[SimulationRun, str | None]]
"""Simulates a plan with conflicts between tractors resolved: the run, and why it is not feasible."""


@dataclass(frozen=True)
class SlowedPlace:
    """A place that is passed more slowly so that nothing is touched there, and the speed."""

    place: ContactPlace
    speed_mps: float


@dataclass(frozen=True)
class _SlowSpan:
    """A part of a mission to be driven at most at a speed: distances along all of its legs (m)."""

    from_m: float
    to_m: float
    speed_mps: float


def slow_at_places(
    run: SimulationRun, context: PlanningContext, resolve: Resolve
) -> tuple[SimulationRun, tuple[ContactPlace, ...], tuple[SlowedPlace, ...]]:
    """The run driven slower where it touches something if that helps, the places that remain, and the slow ones."""
    places = find_contact_places(run, context)
    slowed: list[SlowedPlace] = []
    for _ in range(MAX_ROUNDS):
        better = next(_iter_better_runs(run, places, context, resolve), None) if places else None
        if better is None:
            break
        run, places, slow_now = better
        slowed += slow_now
    return run, places, tuple(slowed)


def _iter_better_runs(run, places, context, resolve):  # type: ignore[no-untyped-def]
    """Runs at lower speeds that reach less deep, the quickest first."""
    for factor in SLOW_FACTORS:
        plan, slowed = slow_down_plan(run, places, context, factor)
        if not slowed:
            return
        slower_run, fault = resolve(plan)
        if fault is not None or slower_run.contacts:
            continue
        remaining = find_contact_places(slower_run, context)
        if sum_depths_m(remaining) <= sum_depths_m(places) - MIN_GAIN_M:
            yield slower_run, remaining, slowed


def sum_depths_m(places: Sequence[ContactPlace]) -> float:
    """Sum (m) of how deep places are reached into."""
    return math.fsum(place.depth_m for place in places)


def slow_down_plan(
    run: SimulationRun, places: Sequence[ContactPlace], context: PlanningContext, factor: float
) -> tuple[Plan, list[SlowedPlace]]:
    """The plan of a run with a share of the driven speed at some places; those that cannot be slowed are left out."""
    plan, slowed = run.plan, []
    for tractor in sorted({place.tractor for place in places}):
        spans = []
        for place in places:
            span = _find_slow_span(run, place, context, factor) if place.tractor == tractor else None
            if span is not None:
                spans.append(span)
                slowed.append(SlowedPlace(place, span.speed_mps))
        plan = _slow_mission(plan, tractor, spans) if spans else plan
    return plan, slowed


def _find_slow_span(
    run: SimulationRun, place: ContactPlace, context: PlanningContext, factor: float
) -> _SlowSpan | None:
    """The part of a mission around a place, and a share of the speed driven there; None if it is slow already."""
    poses, step_s = run.get_poses(place.tractor), float(run.time_s[1] - run.time_s[0])
    around = poses[max(0, place.first_row - SPEED_ROWS) : place.last_row + SPEED_ROWS, :2]
    driven_mps = float(np.hypot(*np.diff(around, axis=0).T).max(initial=0.0)) / step_s
    speed_mps = max(MIN_SPEED_MPS, factor * driven_mps)
    if speed_mps >= MAX_SLOW_SHARE * driven_mps:
        return None
    first_m, last_m = (_locate_row_m(run, place.tractor, row, context) for row in (place.first_row, place.last_row))
    braking_m = (driven_mps**2 - speed_mps**2) / (2.0 * BRAKING_MPS2)
    return _SlowSpan(first_m - LEAD_M - braking_m, last_m + TAIL_M, speed_mps)


def _locate_row_m(run: SimulationRun, tractor: int, row: int, context: PlanningContext) -> float:
    """How far (m) a tractor is along all legs of its mission at a row of the record."""
    legs, number = run.plan.missions[tractor].legs, int(run.get_leg_numbers(tractor)[row])
    number = min(number, len(legs) - 1)
    antenna = shapely.Point(locate_antenna(run.get_poses(tractor)[[row]], context)[0])
    along_m = float(shapely.line_locate_point(shapely.LineString(legs[number].points), antenna))
    return math.fsum(leg.length_m for leg in legs[:number]) + along_m


def _slow_mission(plan: Plan, tractor: int, spans: Sequence[_SlowSpan]) -> Plan:
    """The plan with parts of a mission driven more slowly. Legs that are followed, or follow, are not cut."""
    legs = plan.missions[tractor].legs
    followed = {
        leg.follow.leg
        for mission in plan.missions
        for leg in mission.legs
        if leg.follow is not None and leg.follow.tractor == tractor
    }
    parts: list[list[Leg]] = []
    start_m = 0.0
    for number, leg in enumerate(legs):
        is_whole = number in followed or leg.follow is not None
        parts.append(_cut_slow_parts(leg, start_m, spans, is_whole))
        start_m += leg.length_m
    return replace_legs_by_parts(plan, tractor, parts)


def _cut_slow_parts(leg: Leg, start_m: float, spans: Sequence[_SlowSpan], is_whole: bool) -> list[Leg]:
    """A leg that begins `start_m` along its mission, as parts of which those in the spans are slower."""
    cuts_m = sorted({0.0, leg.length_m, *(m - start_m for span in spans for m in (span.from_m, span.to_m))})
    cuts_m = [m for m in cuts_m if m in (0.0, leg.length_m) or MIN_PART_M < m < leg.length_m - MIN_PART_M]
    cuts_m = [0.0, leg.length_m] if is_whole else [a for a, b in pairwise(cuts_m) if b - a > 0.01] + [leg.length_m]
    parts = []
    for first_m, last_m in pairwise(cuts_m):
        part = leg if (first_m, last_m) == (0.0, leg.length_m) else cut_leg_between(leg, first_m, last_m)
        a, b = start_m + first_m, start_m + last_m
        inside = [span for span in spans if min(b, span.to_m) - max(a, span.from_m) > min(0.5 * (b - a), MIN_PART_M)]
        speed_mps = min([leg.speed_mps, *(span.speed_mps for span in inside)])
        parts.append(part if speed_mps == leg.speed_mps else replace(part, speed_mps=speed_mps))
    first = replace(parts[0], gates=leg.gates, stand_s=leg.stand_s, may_wait=leg.may_wait)
    rest = [replace(part, gates=(), stand_s=0.0, may_wait=False) for part in parts[1:]]
    return [leg] if len(parts) == 1 and parts[0] is leg else [first, *rest]


def replace_legs_by_parts(plan: Plan, tractor: int, parts: Sequence[Sequence[Leg]]) -> Plan:
    """The plan with each leg of a mission replaced by its parts; gates, follow orders and service stops move along."""
    if all(len(one) == 1 for one in parts):
        missions = list(plan.missions)
        missions[tractor] = Mission(tuple(one[0] for one in parts))
        return replace(plan, missions=tuple(missions))
    first_numbers = np.cumsum([0, *(len(one) for one in parts)]).tolist()

    def renumber_gate(gate: LegGate) -> LegGate:
        if gate.tractor != tractor:
            return gate
        number, after_m = first_numbers[gate.leg], gate.after_m
        for part in parts[gate.leg][:-1]:
            if after_m <= part.length_m:
                break
            number, after_m = number + 1, after_m - part.length_m
        return replace(gate, leg=number, after_m=after_m)

    def renumber_leg(leg: Leg) -> Leg:
        follow = leg.follow
        if follow is not None and follow.tractor == tractor:
            follow = replace(follow, leg=first_numbers[follow.leg])
        return replace(leg, gates=tuple(map(renumber_gate, leg.gates)), follow=follow)

    missions = [
        Mission(tuple(leg if not leg.gates and leg.follow is None else renumber_leg(leg) for leg in mission.legs))
        for mission in plan.missions
    ]
    missions[tractor] = Mission(tuple(leg for one in parts for leg in one))
    refills = plan.notes.get("refills")
    notes = (
        plan.notes if refills is None else {**plan.notes, "refills": _renumber_stops(refills, tractor, first_numbers)}
    )
    return replace(plan, missions=tuple(missions), notes=notes)


def _renumber_stops(
    refills: Sequence[Mapping[str, Any]], tractor: int, first_numbers: Sequence[int]
) -> list[dict[str, Any]]:
    """The notes on service stops with the legs of a tractor renumbered."""
    return [
        {**stop, "leg": first_numbers[stop["leg"]]} if stop["tractor"] == tractor + 1 else dict(stop)
        for stop in refills
    ]


def describe_slowed_places(slowed: Sequence[SlowedPlace]) -> str | None:
    """One remark on where a plan is driven more slowly; None without such places."""
    if not slowed:
        return None
    speed_kmh = 3.6 * min(one.speed_mps for one in slowed)
    names = list(dict.fromkeys(one.place.name for one in slowed))
    if len(names) > 2:
        names = [*names[:2], f"{len(names) - 2} more"]
    where = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"drives {speed_kmh:.2g} km/h beside {where}"
