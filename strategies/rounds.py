"""Rounds of the headland before the tracks of a plan or after them, whatever strategy wrote it.

All tractors drive their shares of the rounds at once; nobody begins with what comes second before all others are
through with what comes first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from strategies.errors import StrategyError
from strategies.job import Job
from strategies.laps import Shift, link, shift_of
from strategies.legs import driven_legs, mission_from
from strategies.paths import Pose
from strategies.shifts import Stretch, shared
from vehicle.missions import ROUND, TURN, WAY, Gate, Leg, Mission, Plan

FIRST, LAST = "first", "last"
ORDERS = (FIRST, LAST)
ORIGINS = 12  # places tried for the first border between sectors
WELL_BEGUN_M = 15.0  # a tractor on its first side of a round leaves room behind it from here on
ARRIVED_M = 0.2  # a tractor counts as through this far before the end of a leg


@dataclass(frozen=True)
class _Whole:
    """All legs of a tractor; those from `border` on are driven when the others are through with what comes first.

    `before` legs stand before those of the strategy.
    """

    legs: tuple[Leg, ...]
    border: int
    before: int


def with_rounds(job: Job, plan: Plan, order: str, in_turn: int = 0) -> Plan:
    """The plan with the rounds of the job driven "first", from the outside in, or "last", from the inside out.

    With `in_turn` 1 a tractor goes on to what comes second only when the one before it has begun with it, with -1 only
    when the one after it has; meanwhile it waits before the last stretch of its last track, or at the end of its
    rounds. Raises StrategyError where no way leads from the rounds to the tracks or back.
    """
    if not job.rounds:
        return plan
    first = order == FIRST
    ends = [mission.start if first else _end(mission) for mission in plan.missions]
    shifts = [shift_of(job, share) for share in _shares(job, ends, first)]
    meet = [None if shift is None else (shift.end if first else shift.start)[:2] for shift in shifts]
    own = [shifts[share] for share in _dealt(meet, ends)]
    wholes = [_joined(job, *three, first=first) for three in zip(plan.missions, own, ends, strict=True)]
    if in_turn and not first:
        wholes = [_held_back(whole) for whole in wholes]
    moved = [whole.before for whole in wholes]
    legs = [_renumbered(whole.legs, moved) for whole in wholes]
    for tractor, whole in enumerate(wholes):
        if whole.border < len(whole.legs):
            gates = _through(wholes, tractor) + _begun(wholes, tractor, in_turn)
            legs[tractor][whole.border] = replace(legs[tractor][whole.border], may_wait=True).with_gates(gates)
    left = math.fsum(shift.left_m for shift in shifts if shift)
    notes = {**plan.notes, "headland": order, "rounds": max(lap.number for lap in job.rounds), "left_m": round(left, 1)}
    return Plan(tuple(mission_from(each) for each in legs), notes)


def _shares(job: Job, ends: list[Pose], first: bool) -> list[list[Stretch]]:
    """The rounds shared out so that the way to or from the tracks is short for the tractor that has the longest."""
    if job.tractors == 1:
        return shared(job, outside_in=first, begin=job.layout.field.entrance if first else ends[0][:2])
    begin = job.layout.field.entrance
    options = [shared(job, outside_in=first, begin=begin, origin=place / ORIGINS) for place in range(ORIGINS)]

    def farthest(shares: list[list[Stretch]]) -> float:
        meet = [(share[-1].end if first else share[0].start) if share else None for share in shares]
        pairs = zip(_dealt(meet, ends), ends, strict=True)
        return round(max(math.dist(place, end[:2]) for share, end in pairs if (place := meet[share]) is not None), 2)

    return min(options, key=farthest)


def _end(mission: Mission) -> Pose:
    """Pose at the end of a mission, facing along its last segment."""
    last = mission.legs[-1]
    (x0, y0), (x, y) = last.points[-2], last.points[-1]
    return float(x), float(y), math.atan2(last.gear * (y - y0), last.gear * (x - x0))


def _dealt(places: Sequence[tuple[float, ...] | None], ends: list[Pose]) -> list[int]:
    """Which share each tractor drives: the pairs that are nearest to each other first."""
    pairs = sorted(
        (math.inf if place is None else round(math.dist(place, end[:2]), 3), tractor, share)
        for share, place in enumerate(places)
        for tractor, end in enumerate(ends)
    )
    own: dict[int, int] = {}
    for _, tractor, share in pairs:
        if tractor not in own and share not in own.values():
            own[tractor] = share
    return [own[tractor] for tractor in range(len(ends))]


def _joined(job: Job, mission: Mission, shift: Shift | None, end: Pose, *, first: bool) -> _Whole:
    """The legs of a tractor with its share of the rounds."""
    if shift is None:
        return _Whole(mission.legs, 0 if first else len(mission.legs), 0)
    a, b = (shift.end, end) if first else (end, shift.start)
    way = link(job, a, b, anyhow=True)
    if way is None:
        there, back = ("rounds", "tracks") if first else ("tracks", "rounds")
        raise StrategyError(
            f"No way of turning radius {job.manner.radius_m:.1f} m leads from the {there} to the {back} (at "
            f"{a[0]:.0f}, {a[1]:.0f} m) inside the field; a wider headland may."
        )
    one, two = (shift.legs, mission.legs) if first else (mission.legs, shift.legs)
    between = driven_legs(job, way, replace(two[0].task, kind=WAY if way.kind == "route" else TURN))
    return _Whole((*one, *between, *two), len(one), len(one) + len(between) if first else 0)


def _held_back(whole: _Whole) -> _Whole:
    """The same legs for a tractor that waits before the last stretch of its last track, clear of the headland."""
    hold = next((leg for leg in range(whole.border - 1, 0, -1) if whole.legs[leg].may_wait), whole.border)
    return replace(whole, border=hold) if whole.border < len(whole.legs) else whole


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


def _begun(wholes: list[_Whole], me: int, in_turn: int) -> list[Gate]:
    """A gate that opens when the tractor before this one is where it waits for others, or through with its first leg.

    Those that drive farthest before they first wait go first, or last when `in_turn` is -1; 0 is for no turns.
    """
    if not in_turn:
        return []
    settled = [_settled(whole) for whole in wholes]
    turn = sorted(range(len(wholes)), key=lambda one: (-settled[one][1], one))[::in_turn]
    place = turn.index(me)
    if place == 0:
        return []
    other, leg = turn[place - 1], settled[turn[place - 1]][0]
    begun = wholes[other].legs[leg]
    most = WELL_BEGUN_M if begun.task.kind == ROUND else math.inf
    return [Gate(other, leg, min(max(0.0, begun.length_m - ARRIVED_M), most))]


def _settled(whole: _Whole) -> tuple[int, float]:
    """The leg with which a tractor has begun what comes second, and the metres of that up to it."""
    legs, begin = whole.legs, max(whole.border, whole.before)
    if not whole.before:
        begin = next((leg for leg in range(begin, len(legs)) if legs[leg].task.kind == ROUND), len(legs) - 1)
    last = next((leg for leg in range(begin, min(begin + 4, len(legs))) if legs[leg].gates), begin + 1) - 1
    return last, math.fsum(leg.length_m for leg in legs[begin : last + 1])
