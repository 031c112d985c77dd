"""What each tractor of a run does, one thing after another: the list that its driver takes along.

Legs of one track, side, turn or way are one step, the drive-in included; what is interrupted by a wait is two.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from reports.results import Step
from vehicle.layout import FINISHED, STANDING, WAITING
from vehicle.missions import DRIVE, DRIVE_IN, ENTER, LEAVE, REFILL, ROUND, TRACK, TURN, WAY, Leg, Plan, Task
from vehicle.run import Run

CORNER, WAIT, TO_REFILL = "corner", "wait", "refill-way"  # steps that no task is called like
LEAST_WAIT_S = 3.0  # a shorter stop is part of what it interrupts
ROUND_TRIP = 0.5  # ends so near each other, as a share of the length between them, give no direction
SWING_RAD = math.radians(20.0)  # a turn that first swings out by more is an omega
PARALLEL = 0.02  # tracks of one cell lead aside from each other by no larger share of their length
LEAST_SPACING = 0.5  # of the width: lines of one cell are never nearer
LONGEST_TURN_M = 60.0  # a longer one is a way, whatever it looks like
U_RAD, BULB_RAD = math.radians(135.0), math.radians(225.0)  # a turn by less is no U; one by more is a bulb
FOUND_M = 1e-3

Rows = npt.NDArray[np.int64]


@dataclass(frozen=True)
class _Names:
    """What it takes to name a step: lines with several pieces, and how far lines are apart."""

    lettered: frozenset[int]
    width_m: float


@dataclass(frozen=True)
class _Stretch:
    """Rows of the record from `first` up to `last`, in a group of legs, driven, waiting, or standing for a refill."""

    group: int
    waits: bool
    stands: bool
    first: int
    last: int


def steps_of(run: Run, width_m: float) -> tuple[tuple[Step, ...], ...]:
    """The steps of every tractor, in order; `width_m` is that of the implement."""
    names = _Names(_lettered(run.plan), width_m)
    return tuple(tuple(_steps(run, tractor, names)) for tractor in range(run.plan.tractors))


def track_names(places: Iterable[tuple[int, int]]) -> tuple[str, ...]:
    """What tracks, given by (line, piece) from 0, are called: 14, or 14a and 14b where a line has several pieces."""
    places = tuple(places)
    several = {line for line, piece in places if piece}
    return tuple(f"{line + 1}{_letter(piece) if line in several else ''}" for line, piece in places)


def _letter(piece: int) -> str:
    """a to z, then aa, ab, ..."""
    return (_letter(piece // 26 - 1) if piece >= 26 else "") + chr(ord("a") + piece % 26)


def _lettered(plan: Plan) -> frozenset[int]:
    """Lines with several pieces."""
    tasks = (leg.task for mission in plan.missions for leg in mission.legs)
    return frozenset(task.number for task in tasks if task.number is not None and task.piece and task.kind == TRACK)


def _round(task: Task) -> bool:
    return task.kind == ROUND


def _steps(run: Run, tractor: int, names: _Names) -> Iterator[Step]:
    legs = run.plan.missions[tractor].legs
    groups = _groups(legs)
    begun: set[int] = set()
    for stretch in _stretches(run, tractor, groups):
        step = _placed(run, tractor, stretch)
        if stretch.stands:
            yield replace(step, kind=REFILL, amount=_amount(run, tractor, stretch))
            continue
        if stretch.waits:
            yield replace(step, for_tractors=_waited_for(run, tractor, stretch))
            continue
        members = np.flatnonzero(groups == stretch.group)
        named = _named(legs, int(members[0]), int(members[-1]), names)
        yield replace(
            named, from_s=step.from_s, seconds=step.seconds, length_m=step.length_m, x_m=step.x_m, y_m=step.y_m,
            again=stretch.group in begun,
        )  # fmt: skip
        begun.add(stretch.group)


def _groups(legs: Sequence[Leg]) -> Rows:
    """For every leg the number of the step it belongs to (n,)."""
    group, groups = 0, [0]
    for before, after in pairwise(legs):
        alike = _manner(before.task) == _manner(after.task)
        group += not alike or not (before.task.same_goal(after.task) or after.task.kind in (ENTER, LEAVE))
        groups.append(group)
    return np.array(groups, dtype=np.int64)


def _manner(task: Task) -> str:
    """Legs of a step have the same: what leads over the headland line is part of the track."""
    if task.works or task.kind == DRIVE_IN:
        return ROUND if _round(task) else TRACK
    return WAY if task.kind in (TURN, WAY) else task.kind


def _stretches(run: Run, tractor: int, groups: Rows) -> Iterator[_Stretch]:
    """Driving and standing in order of time; short stops count as what they interrupt."""
    status, group = run.status(tractor), groups[run.leg(tractor)]
    end = int(np.argmax(status == FINISHED)) if (status == FINISHED).any() else len(status)
    step_s = float(run.time_s[1] - run.time_s[0]) if len(run.time_s) > 1 else 0.0
    waits = _long(status[:end] == WAITING, math.ceil(LEAST_WAIT_S / step_s - 1e-9) if step_s else 1)
    stands = status[:end] == STANDING
    keys = 3 * group[:end] + np.where(stands, 2, waits)
    cuts = [0, *(np.flatnonzero(np.diff(keys)) + 1).tolist(), end]
    for first, last in pairwise(cuts):
        if last > first:
            yield _Stretch(int(group[first]), bool(waits[first]), bool(stands[first]), first, last)


def _long(flags: npt.NDArray[np.bool_], least: int) -> npt.NDArray[np.bool_]:
    """The flags without runs of fewer than `least`."""
    edges = np.flatnonzero(np.diff(np.concatenate(([0], flags.astype(np.int8), [0]))))
    kept = np.zeros(len(flags), dtype=bool)
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        kept[first:last] = last - first >= least
    return kept


def _placed(run: Run, tractor: int, stretch: _Stretch) -> Step:
    """A wait with the time, length and place of a stretch."""
    first, last = stretch.first, min(stretch.last, len(run.time_s) - 1)
    path = run.poses(tractor)[first : last + 1, :2]
    driven = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))))
    x, y = path[int(np.searchsorted(driven, 0.5 * driven[-1]))]
    seconds = float(run.time_s[last] - run.time_s[first])
    return Step(WAIT, None, "", float(run.time_s[first]), seconds, float(driven[-1]), float(x), float(y))


def _amount(run: Run, tractor: int, stretch: _Stretch) -> float | None:
    """What is filled in at a stop, below 0 what is taken out; None where the plan does not say."""
    leg = int(run.leg(tractor)[stretch.first])
    noted = (one for one in run.plan.notes.get("refills", ()) if (one["tractor"], one["leg"]) == (tractor + 1, leg))
    sign = -1.0 if run.plan.notes.get("collects") else 1.0
    return next((sign * float(one["amount"]) for one in noted), None)


def _waited_for(run: Run, tractor: int, stretch: _Stretch) -> tuple[int, ...]:
    """The tractors, from 1, whose gates are not known to be open when a wait begins; else the one that is followed."""
    legs, here = run.plan.missions[tractor].legs, int(run.leg(tractor)[stretch.first])
    started = bool((run.status(tractor)[: stretch.first] != WAITING).any())
    ahead = legs[here + 1].gates if started and here + 1 < len(legs) else () if started else legs[here].gates
    shut = {gate.tractor + 1 for gate in ahead if int(run.leg(gate.tractor)[stretch.first]) <= gate.leg}
    follow = legs[here].follow
    return tuple(sorted(shut)) or (() if follow is None else (follow.tractor + 1,))


def _named(legs: Sequence[Leg], first: int, last: int, names: _Names) -> Step:
    """What the legs from `first` to `last` are, without time and place."""
    task, manner = legs[first].task, _manner(legs[first].task)
    goal = _next_work(legs, first)
    on_round = _round(legs[goal].task) if goal is not None else False
    step = Step(manner, None, "", 0.0, 0.0, 0.0, 0.0, 0.0)
    if manner == REFILL:
        return replace(step, kind=TO_REFILL)
    if manner == ENTER and goal is not None:
        task = legs[goal].task
    if manner in (DRIVE, LEAVE) or task.number is None:
        return replace(step, kind=manner if manner in (ENTER, LEAVE) else DRIVE)
    led = replace(step, number=task.number + (not on_round), to_round=on_round)
    led = replace(led, part=str(task.piece + 1) if on_round else _part(task, names.lettered))
    driven = legs[first : last + 1]
    if manner == ENTER:
        return led
    if manner in (ROUND, TRACK):
        return replace(led, bearing_deg=_bearing_deg(driven))
    before = legs[first - 1].task if first else None
    way = any(leg.task.kind == WAY for leg in driven) or sum(leg.length_m for leg in driven) > LONGEST_TURN_M
    corner = not way and on_round and before is not None and _round(before) and before.number == task.number
    over = _over(legs, first - 1, goal, names.width_m) if first and goal is not None and not way else None
    kind = CORNER if corner else WAY if way else TURN
    return replace(led, kind=kind, over=over, shape="" if way else _shape(driven))


def _over(legs: Sequence[Leg], before: int, after: int, width_m: float) -> int | None:
    """How many tracks a turn leads over; None where that is not from one track of a cell to another."""
    a, b = legs[before], legs[after]
    if a.task.kind != TRACK or b.task.kind != TRACK or a.task.number is None or b.task.number is None:
        return None
    tracks = abs(a.task.number - b.task.number)
    along = a.points[-1] - a.points[-2]
    along = along / float(np.hypot(*along))
    ahead, off = b.points[-1] - b.points[0], b.points[0] - a.points[-1]
    aside_m, apart_m = (abs(float(along[0] * step[1] - along[1] * step[0])) for step in (ahead, off))
    parallel = aside_m <= PARALLEL * b.length_m
    spaced = LEAST_SPACING * tracks * width_m <= apart_m <= (tracks + 1.0 - LEAST_SPACING) * width_m
    return tracks if tracks and parallel and spaced else None


def _next_work(legs: Sequence[Leg], first: int) -> int | None:
    return next((leg for leg in range(first, len(legs)) if legs[leg].task.works), None)


def _part(task: Task, lettered: frozenset[int]) -> str:
    return _letter(task.piece) if task.number in lettered else ""


def _bearing_deg(legs: Sequence[Leg]) -> float | None:
    """Direction from the beginning to the end, clockwise from north; None for what leads back to where it began."""
    begin, end = legs[0].points[0], legs[-1].points[-1]
    east, north = (end - begin).tolist()
    length = sum(leg.length_m for leg in legs)
    if math.hypot(east, north) < max(ROUND_TRIP * length, FOUND_M):
        return None
    return math.degrees(math.atan2(east, north)) % 360.0


def _shape(legs: Sequence[Leg]) -> str:
    """What a way looks like: backing up, a bulb or swinging out first, or bending one way only."""
    if any(leg.gear < 0 for leg in legs):
        return "switch-back"
    points = np.concatenate([legs[0].points, *(leg.points[1:] for leg in legs[1:])])
    steps = np.diff(points, axis=0)
    steps = steps[np.hypot(*steps.T) > FOUND_M]
    bends = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    left, right = float(bends[bends > 0].sum()), float(-bends[bends < 0].sum())
    if max(left, right) < U_RAD:
        return ""
    return "omega" if min(left, right) > SWING_RAD or max(left, right) > BULB_RAD else "u"
