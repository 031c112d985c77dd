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
NEARLY_M = 30.0  # one that follows another in a formation stops farther behind than its leg goes
ARRIVED_M = 0.2  # a tractor counts as through this far before the end of a leg


@dataclass(frozen=True)
class _Whole:
    """All legs of a tractor; those from `border` on are driven when the others are through with what comes first.

    `before` legs stand before those of the strategy.
    """

    legs: tuple[Leg, ...]
    border: int
    before: int


@dataclass(frozen=True)
class Passage:
    """How a fleet goes on from what comes first to what comes second.

    `beside` keeps all to the headland. `turn` 1 lets them go one after another, those first that have farthest to drive
    before they wait for others, -1 these last, 0 all at once; meanwhile the others wait before the last stretch of
    their last track, or at the end of their rounds. With `alone` one tractor drives all rounds, after the tracks only,
    and the others wait for it before the last stretch of theirs.
    """

    beside: bool = False
    turn: int = 0
    alone: bool = False


PASSAGES = (
    Passage(), Passage(beside=True), Passage(turn=1), Passage(True, 1), Passage(turn=-1), Passage(True, -1),
    Passage(True, 1, alone=True),
)  # fmt: skip
"""From the quickest to those that keep tractors apart where the others do not."""


def with_rounds(job: Job, plan: Plan, order: str, passage: Passage = PASSAGES[0]) -> Plan:
    """The plan with the rounds of the job driven "first", from the outside in, or "last", from the inside out.

    Raises StrategyError where no way leads from the rounds to the tracks or back.
    """
    if not job.rounds:
        return plan
    first = order == FIRST
    ends = [mission.start if first else _end(mission) for mission in plan.missions]
    shifts = [shift_of(job, share) for share in _shares(job, ends, first, passage)]
    meet = [None if shift is None else (shift.end if first else shift.start)[:2] for shift in shifts]
    own = [shifts[share] for share in _dealt(meet, ends)]
    parts = zip(plan.missions, own, ends, strict=True)
    wholes = [_joined(job, *three, first=first, beside=passage.beside) for three in parts]
    if passage.turn and not first:
        wholes = [_held_back(whole, passage) for whole in wholes]
    moved = [whole.before for whole in wholes]
    legs = [_renumbered(whole.legs, moved) for whole in wholes]
    for tractor, whole in enumerate(wholes):
        if whole.border < len(whole.legs):
            leg = replace(legs[tractor][whole.border], may_wait=True)
            legs[tractor][whole.border] = leg.with_gates(_gates(wholes, own, tractor, first, passage))
    left = math.fsum(shift.left_m for shift in shifts if shift)
    notes = {**plan.notes, "headland": order, "rounds": max(lap.number for lap in job.rounds), "left_m": round(left, 1)}
    return Plan(tuple(mission_from(each) for each in legs), notes)


def _gates(
    wholes: list[_Whole], own: list[Shift | None], tractor: int, first: bool, passage: Passage
) -> list[Gate]:
    """What a tractor waits for before it goes on."""
    if passage.alone and own[tractor] is None:
        worker = next(index for index, shift in enumerate(own) if shift is not None)
        last = len(wholes[worker].legs) - 1
        return [Gate(worker, last, max(0.0, wholes[worker].legs[last].length_m - ARRIVED_M))]
    through = _through(wholes, tractor, NEARLY_M if passage.turn and not first else ARRIVED_M)
    return through if passage.alone else through + _begun(wholes, tractor, passage.turn)


def _shares(job: Job, ends: list[Pose], first: bool, passage: Passage) -> list[list[Stretch]]:
    """The rounds shared out so that the way to or from the tracks is short for the tractor that has the longest."""
    if job.tractors == 1 or passage.alone:
        begin = job.layout.field.entrance if first else ends[0][:2]
        whole = shared(replace(job, tractors=1), outside_in=first, begin=begin)
        return whole + [[] for _ in range(job.tractors - 1)]
    options = [_sharing(job, first, place / ORIGINS) for place in range(ORIGINS)]

    def farthest(shares: list[list[Stretch]]) -> float:
        meet = [(share[-1].end if first else share[0].start) if share else None for share in shares]
        pairs = zip(_dealt(meet, ends), ends, strict=True)
        return round(max(math.dist(place, end[:2]) for share, end in pairs if (place := meet[share]) is not None), 2)

    return min(options, key=farthest)


def _sharing(job: Job, outside_in: bool, origin: float) -> list[list[Stretch]]:
    """The rounds shared out with borders counted from a place, worked out once."""
    key = job.tractors, outside_in, origin
    if key not in job.sharings:
        begin = job.layout.field.entrance
        job.sharings[key] = shared(job, outside_in=outside_in, begin=begin, origin=origin)
    return job.sharings[key]  # type: ignore[no-any-return]


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


def _joined(job: Job, mission: Mission, shift: Shift | None, end: Pose, *, first: bool, beside: bool) -> _Whole:
    """The legs of a tractor with its share of the rounds."""
    if shift is None:
        return _Whole(mission.legs, 0 if first else len(mission.legs), 0)
    a, b = (shift.end, end) if first else (end, shift.start)
    way = link(job, a, b, anyhow=True, beside=beside)
    if way is None:
        there, back = ("rounds", "tracks") if first else ("tracks", "rounds")
        raise StrategyError(
            f"No way of turning radius {job.manner.radius_m:.1f} m leads from the {there} to the {back} (at "
            f"{a[0]:.0f}, {a[1]:.0f} m) inside the field; a wider headland may."
        )
    one, two = (shift.legs, mission.legs) if first else (mission.legs, shift.legs)
    between = driven_legs(job, way, replace(two[0].task, kind=WAY if way.kind == "route" else TURN))
    return _Whole((*one, *between, *two), len(one), len(one) + len(between) if first else 0)


def _held_back(whole: _Whole, passage: Passage) -> _Whole:
    """The same legs for a tractor that waits before the last stretch of its last track, clear of the headland."""
    hold = next((leg for leg in range(whole.border - 1, 0, -1) if whole.legs[leg].may_wait), whole.border)
    return replace(whole, border=hold) if passage.alone or whole.border < len(whole.legs) else whole


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


def _through(wholes: list[_Whole], me: int, short_m: float) -> list[Gate]:
    """Gates that open when all others are through with what comes first, but for some metres."""
    return [
        Gate(other, whole.border - 1, max(0.0, whole.legs[whole.border - 1].length_m - short_m))
        for other, whole in enumerate(wholes)
        if other != me and whole.border > 0
    ]


def _begun(wholes: list[_Whole], me: int, in_turn: int) -> list[Gate]:
    """A gate that opens when the tractor before this one is where it waits for others, or through with its first leg.

    `in_turn` is as in Passage.
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
