"""Rounds of the headland before the tracks of a plan or after them, whatever strategy wrote it.

All tractors drive their shares of the rounds at once; nobody begins with what comes second before all others are
through with what comes first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from strategies.errors import StrategyError
from strategies.job import Job
from strategies.laps import Shift, link, shift_of
from strategies.legs import driven_legs, mission_from
from strategies.paths import Pose
from strategies.shifts import shared
from vehicle.missions import TURN, WAY, Gate, Leg, Mission, Plan

FIRST, LAST = "first", "last"
ORDERS = (FIRST, LAST)
ARRIVED_M = 0.2  # a tractor counts as through this far before the end of a leg


@dataclass(frozen=True)
class _Whole:
    """All legs of a tractor; those from `border` on are driven when the others are through with what comes first."""

    legs: tuple[Leg, ...]
    border: int


def with_rounds(job: Job, plan: Plan, order: str) -> Plan:
    """The plan with the rounds of the job driven "first", from the outside in, or "last", from the inside out.

    Raises StrategyError where no way leads from the rounds to the tracks or back.
    """
    if not job.rounds:
        return plan
    first = order == FIRST
    ends = [mission.start if first else _end(mission) for mission in plan.missions]
    begin = job.layout.field.entrance if first else (ends[0][:2] if job.tractors == 1 else None)
    shifts = [shift_of(job, share) for share in shared(job, outside_in=first, begin=begin)]
    own = _dealt(shifts, ends, first)
    wholes = [_joined(job, *three, first=first) for three in zip(plan.missions, own, ends, strict=True)]
    moved = [len(whole.legs) - len(mission.legs) if first else 0 for whole, mission in zip(wholes, plan.missions, strict=True)]
    legs = [_renumbered(whole.legs, moved) for whole in wholes]
    for tractor, whole in enumerate(wholes):
        if whole.border < len(whole.legs):
            gates = _through(wholes, tractor)
            legs[tractor][whole.border] = replace(legs[tractor][whole.border], may_wait=True).with_gates(gates)
    left = math.fsum(shift.left_m for shift in shifts if shift)
    notes = {**plan.notes, "headland": order, "rounds": max(lap.number for lap in job.rounds), "left_m": round(left, 1)}
    return Plan(tuple(mission_from(each) for each in legs), notes)


def driven_s(plan: Plan) -> float:
    """Seconds of the tractor that has most to drive, if nobody waits and all keep to the speeds of their legs."""
    return max(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs) for mission in plan.missions)


def _end(mission: Mission) -> Pose:
    """Pose at the end of a mission, facing along its last segment."""
    last = mission.legs[-1]
    (x0, y0), (x, y) = last.points[-2], last.points[-1]
    return float(x), float(y), math.atan2(last.gear * (y - y0), last.gear * (x - x0))


def _dealt(shifts: list[Shift | None], ends: list[Pose], first: bool) -> list[Shift | None]:
    """Which tractor drives which share: the pairs that are nearest to each other first."""
    places = [None if shift is None else (shift.end if first else shift.start) for shift in shifts]
    pairs = sorted(
        (math.inf if place is None else round(math.dist(place[:2], end[:2]), 3), tractor, share)
        for share, place in enumerate(places)
        for tractor, end in enumerate(ends)
    )
    own: dict[int, int] = {}
    for _, tractor, share in pairs:
        if tractor not in own and share not in own.values():
            own[tractor] = share
    return [shifts[own[tractor]] for tractor in range(len(ends))]


def _joined(job: Job, mission: Mission, shift: Shift | None, end: Pose, *, first: bool) -> _Whole:
    """The legs of a tractor with its share of the rounds."""
    if shift is None:
        return _Whole(mission.legs, 0 if first else len(mission.legs))
    a, b = (shift.end, end) if first else (end, shift.start)
    way = link(job, a, b)
    if way is None:
        there, back = ("rounds", "tracks") if first else ("tracks", "rounds")
        raise StrategyError(
            f"No way of turning radius {job.manner.radius_m:.1f} m leads from the {there} to the {back} (at {a[0]:.0f}, "
            f"{a[1]:.0f} m) inside the field; a wider headland may."
        )
    one, two = (shift.legs, mission.legs) if first else (mission.legs, shift.legs)
    between = driven_legs(job, way, replace(two[0].task, kind=WAY if way.kind == "route" else TURN))
    return _Whole((*one, *between, *two), len(one))


def _renumbered(legs: tuple[Leg, ...], moved: list[int]) -> list[Leg]:
    """Legs whose gates and follow orders count the legs that were put before those they name."""
    return [
        replace(
            leg,
            gates=tuple(replace(gate, leg=gate.leg + moved[gate.tractor]) for gate in leg.gates),
            follow=leg.follow and replace(leg.follow, leg=leg.follow.leg + moved[leg.follow.tractor]),
        )
        for leg in legs
    ]


def _through(wholes: list[_Whole], me: int) -> list[Gate]:
    """Gates that open when all others are through with what comes first."""
    return [
        Gate(other, whole.border - 1, max(0.0, whole.legs[whole.border - 1].length_m - ARRIVED_M))
        for other, whole in enumerate(wholes)
        if other != me and whole.border > 0
    ]
