"""Rounds of the headland before the tracks of a plan or after them, whatever strategy wrote it.

All tractors drive their shares of the rounds at once. Nobody works a track before all others are through with their
rounds, or a round before all others are on their last track.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from strategies.errors import StrategyError
from strategies.headland.laps import Shift, link, shift_of
from strategies.headland.shifts import Stretch, shared
from strategies.job import Job
from strategies.legs import driven_legs, mission_from, with_stops
from strategies.ways.paths import Pose
from vehicle.missions import THROUGH_M, TRACK, TURN, WAY, Gate, Leg, Mission, Plan

FIRST, LAST = "first", "last"
ORDERS = (FIRST, LAST)
ORIGINS = 12  # places tried for the first border between sectors
SAME_M = 20.0  # of rounds: what borders in an awkward place leave out beyond this is not given up for a short way
STOPS_M = 10.0  # a tractor may be kept waiting so often on its way between rounds and tracks


@dataclass(frozen=True)
class _Whole:
    """All legs of a tractor; others may do what comes second when it is at leg `border`.

    From leg `begin` on it does so itself. `before` legs stand before those of the strategy.
    """

    legs: tuple[Leg, ...]
    border: int
    begin: int
    before: int


@dataclass(frozen=True)
class Passage:
    """How a fleet goes on from what comes first to what comes second.

    `beside` keeps all to the headland. With `alone` one tractor drives all rounds, after the tracks only, and the
    others wait for it before the last stretch of theirs.
    """

    beside: bool = False
    alone: bool = False


PASSAGES = (Passage(), Passage(beside=True), Passage(True, alone=True))
"""From the quickest to those that keep tractors apart where the others do not."""


def with_rounds(job: Job, plan: Plan, order: str, passage: Passage = PASSAGES[0]) -> Plan:
    """The plan with the rounds of the job driven "first", from the outside in, or "last", from the inside out.

    Raises StrategyError where no way leads from the rounds to the tracks or back.
    """
    if not job.rounds:
        return plan
    first = order == FIRST
    ends = [mission.start if first else mission.end for mission in plan.missions]
    shifts = [shift_of(job, share) for share in _shares(job, ends, first, passage)]
    meet = [None if shift is None else (shift.end if first else shift.start)[:2] for shift in shifts]
    own = [shifts[share] for share in _dealt(meet, ends)]
    parts = zip(plan.missions, own, ends, strict=True)
    wholes = [_joined(job, *three, first=first, passage=passage) for three in parts]
    moved = [whole.before for whole in wholes]
    legs = [renumbered(whole.legs, moved) for whole in wholes]
    for tractor, whole in enumerate(wholes):
        if whole.begin < len(whole.legs):
            leg = legs[tractor][whole.begin].linked(may_wait=True)
            legs[tractor][whole.begin] = leg.with_gates(_gates(wholes, own, tractor, first, passage))
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
        return [Gate(worker, last, max(0.0, wholes[worker].legs[last].length_m - THROUGH_M))]
    return _through(wholes, tractor)


def _shares(job: Job, ends: list[Pose], first: bool, passage: Passage) -> list[list[Stretch]]:
    """The rounds shared out so that the way to or from the tracks is short for the tractor that has the longest.

    What passages do not tell apart is worked out once, and so is what a plan asks for that is written again.
    """
    laps = tuple((lap.number, lap.ring, len(lap.sides)) for lap in job.rounds)
    key = laps, job.tractors, first, passage.alone, tuple(ends)
    if key not in job.sharings:
        job.sharings[key] = _nearest_shares(job, ends, first, passage)
    return job.sharings[key]  # type: ignore[no-any-return]


def _nearest_shares(job: Job, ends: list[Pose], first: bool, passage: Passage) -> list[list[Stretch]]:
    if job.tractors == 1 or passage.alone:
        begin = job.layout.field.entrance if first else ends[0][:2]
        whole = shared(replace(job, tractors=1), outside_in=first, begin=begin)
        return whole + [[] for _ in range(job.tractors - 1)]
    options = [_sharing(job, first, place / ORIGINS) for place in range(ORIGINS)]
    driven = [sum(stretch.length_m for share in shares for stretch in share) for shares in options]
    options = [shares for shares, metres in zip(options, driven, strict=True) if metres > max(driven) - SAME_M]

    def farthest(shares: list[list[Stretch]]) -> float:
        meet = [(share[-1].end if first else share[0].start) if share else None for share in shares]
        away = [_from_gate_m(job, share, first) for share in shares]
        pairs = zip(_dealt(meet, ends), ends, strict=True)
        ways = (math.dist(place, end[:2]) + away[n] for n, end in pairs if (place := meet[n]) is not None)
        return round(max(ways), 2)

    return min(options, key=farthest)


def _from_gate_m(job: Job, share: list[Stretch], first: bool) -> float:
    """How far the way in or out is that a share of the rounds has before it or after it (m); 0 without an entrance."""
    if job.gate is None or not share:
        return 0.0
    return math.dist(job.gate.at[:2], share[0].start if first else share[-1].end)


def _sharing(job: Job, outside_in: bool, origin: float) -> list[list[Stretch]]:
    """The rounds shared out with borders counted from a place, worked out once."""
    key = job.tractors, outside_in, origin
    if key not in job.sharings:
        begin = job.layout.field.entrance
        job.sharings[key] = shared(job, outside_in=outside_in, begin=begin, origin=origin)
    return job.sharings[key]  # type: ignore[no-any-return]


def _dealt(places: Sequence[tuple[float, ...] | None], ends: list[Pose]) -> list[int]:
    """Which share each tractor drives: the pairs that are nearest to each other first, to the millimetre."""
    at = np.array([(math.inf, math.inf) if place is None else place for place in places])
    east, north = (np.array([end[:2] for end in ends])[:, None] - at).transpose(2, 0, 1)
    own: dict[int, int] = {}
    free = [True] * len(places)
    for pair in np.argsort(np.rint(1000.0 * np.hypot(east, north)), axis=None, kind="stable").tolist():
        tractor, share = divmod(pair, len(places))
        if tractor not in own and free[share]:
            own[tractor], free[share] = share, False
    return [own[tractor] for tractor in range(len(ends))]


def _joined(
    job: Job, mission: Mission, shift: Shift | None, end: Pose, *, first: bool, passage: Passage
) -> _Whole:
    """The legs of a tractor with its share of the rounds.

    Before the tracks it waits inside its own, clear of the headland, if there is room to get there; after them before
    the last stretch of its last one.
    """
    if shift is None:
        hold = _last_hold(mission.legs) if passage.alone else len(mission.legs)
        return _Whole(mission.legs, 0, 0, 0) if first else _Whole(mission.legs, _last_track(mission.legs), hold, 0)
    a, b = (shift.end, end) if first else (end, shift.start)
    way = link(job, a, b, anyhow=True, beside=passage.beside)
    if way is None:
        there, back = ("rounds", "tracks") if first else ("tracks", "rounds")
        raise StrategyError(
            f"No way of turning radius {job.manner.radius_m:.1f} m leads from the {there} to the {back} (at "
            f"{a[0]:.0f}, {a[1]:.0f} m) inside the field; a wider headland may."
        )
    task = (mission if first else shift).legs[0].task
    between = with_stops(driven_legs(job, way, replace(task, kind=WAY if way.kind == "route" else TURN)), STOPS_M)
    if not first:
        legs = (*mission.legs, *between, *shift.legs)
        return _Whole(legs, _last_track(mission.legs), _last_hold(mission.legs), 0)
    before = len(shift.legs) + len(between)
    tracks = (mission.legs[0].linked(gates=()), *mission.legs[1:])  # whoever comes first may go in first
    begin = next((n for n, leg in enumerate(tracks) if leg.task.kind == TRACK), 0)
    return _Whole((*shift.legs, *between, *tracks), len(shift.legs), before + begin, before)


def _last_track(legs: Sequence[Leg]) -> int:
    """The first leg that works the last track."""
    return 1 + max((number for number, leg in enumerate(legs) if leg.task.kind != TRACK), default=-1)


def _last_hold(legs: Sequence[Leg]) -> int:
    """The last leg before which a tractor may be kept waiting; the number of legs where there is none."""
    return next((leg for leg in range(len(legs) - 1, 0, -1) if legs[leg].may_wait), len(legs))


def renumbered(legs: Sequence[Leg], moved: list[int]) -> list[Leg]:
    """Legs whose gates and follow orders count the legs that were put before those they name."""
    return [
        leg.linked(
            gates=tuple(Gate(gate.tractor, gate.leg + moved[gate.tractor], gate.after_m) for gate in leg.gates),
            follow=leg.follow and replace(leg.follow, leg=leg.follow.leg + moved[leg.follow.tractor]),
        )
        if leg.gates or leg.follow
        else leg
        for leg in legs
    ]


def _through(wholes: list[_Whole], me: int) -> list[Gate]:
    """Gates that open when all others are through with what comes first, or on their last track."""
    return [
        Gate(other, whole.border - 1, max(0.0, whole.legs[whole.border - 1].length_m - THROUGH_M))
        for other, whole in enumerate(wholes)
        if other != me and whole.border > 0
    ]
