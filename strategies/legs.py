"""Tracks and turns as legs of a mission."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fields.layout import Track
from strategies.errors import NoWayError
from strategies.job import Job, Pass
from strategies.ways.paths import Path, Pose
from vehicle.missions import DRIVE_IN, TRACK, TURN, WAY, Leg, Mission, Task

STEP_M = 0.25
SHORTEST_LEG_M = 0.05


def task_on(kind: str, track: Track) -> Task:
    """The task of a leg that works a track or leads to it."""
    return Task(kind, track.line, track.piece)


def straight_leg(job: Job, a: Pose, start_m: float, end_m: float, task: Task, *, may_wait: bool = False) -> Leg:
    """A leg between two distances ahead of a pose: work at work speed, anything else at turn speed.

    It is straight but for small obstacles that a pass beginning at the pose is driven round; distances are always those
    along the track. The same one is written once for all plans of a site.
    """
    key = a, start_m, end_m, task, may_wait
    if key not in job.legs:
        job.legs[key] = _straight_leg(job, a, start_m, end_m, task, may_wait)
    return job.legs[key]  # type: ignore[no-any-return]


def _straight_leg(job: Job, a: Pose, start_m: float, end_m: float, task: Task, may_wait: bool) -> Leg:
    bent = job.around.bent.get(a[:2])
    if bent is None:
        ahead = np.array([math.cos(a[2]), math.sin(a[2])])
        points = np.array([a[:2] + start_m * ahead, a[:2] + end_m * ahead])
    else:
        points = bent.between(start_m, end_m)
    return Leg(
        points=points,
        speed_mps=job.manner.work_speed_mps if task.works else job.manner.turn_speed_mps,
        implement=task.works,
        ground=_ground(job, points),
        task=task,
        may_wait=may_wait,
    )


def way_legs(job: Job, path: Path, goal: Track) -> list[Leg]:
    """A turn or route to a track as one leg per gear; one with direction changes is all driven at manoeuvring speed.

    The same one is written once for all plans of a site; its path is kept, as that is what it is known by.
    """
    key = id(path), goal.line, goal.piece
    kept = job.legs.get(key)
    if kept is None or kept[0] is not path:
        legs = driven_legs(job, path, task_on(WAY if path.kind == "route" else TURN, goal))
        job.legs[key] = path, tuple(legs)
    return list(job.legs[key][1])


def driven_legs(job: Job, path: Path, task: Task) -> list[Leg]:
    """A way with the implement up as one leg per gear, for a task."""
    manner = job.manner
    speed = manner.reverse_speed_mps if path.reverse_m else manner.turn_speed_mps
    return [
        Leg(
            points=points,
            speed_mps=speed,
            gear=gear,
            ground=_ground(job, points),
            task=task,
        )
        for gear, points in path.sample(STEP_M)
        if float(np.hypot(*np.diff(points, axis=0).T).sum()) > SHORTEST_LEG_M
    ]


def with_stops(legs: Sequence[Leg], every_m: float) -> list[Leg]:
    """The same legs with a place to wait before each, and about every so many metres on those driven forwards."""
    stopping: list[Leg] = []
    for leg in legs:
        steps_m = np.hypot(*np.diff(leg.points, axis=0).T)
        along = np.concatenate(([0.0], np.cumsum(steps_m)))
        parts = max(1, round(along[-1] / every_m)) if leg.gear > 0 else 1
        cuts = np.searchsorted(along, along[-1] * np.arange(1, parts) / parts)
        for a, b in pairwise([0, *sorted(set(cuts.tolist()) - {0, len(along) - 1}), len(along) - 1]):
            may_wait = leg.may_wait if a == 0 and stopping and stopping[-1].gear != leg.gear else True
            part = replace(leg, points=leg.points[a : b + 1], may_wait=may_wait)
            stopping.append(part.measured(float(steps_m[a:b].sum())))
    return stopping


def _ground(job: Job, points: np.ndarray) -> str:
    x, y = points[len(points) // 2]
    return job.layout.field.ground_at(float(x), float(y))


def pass_legs(job: Job, this: Pass) -> list[Leg]:
    """Drive in until the implement is over the headland line, then work to the far line.

    The last stretch is a leg of its own, so that a tractor can be told to give way before it, clear of the headland.
    """
    entry, tool, end = job.entry(this), job.manner.tool_m, this.track.length + job.manner.tool_m
    hold = max(end - job.manner.hold_back_m, 0.5 * (tool + end))
    work = task_on(TRACK, this.track)
    return [
        straight_leg(job, entry, 0.0, tool, task_on(DRIVE_IN, this.track)),
        straight_leg(job, entry, tool, hold, work),
        straight_leg(job, entry, hold, end, work, may_wait=True),
    ]


def turn_legs(job: Job, a: Pass, b: Pass) -> list[Leg]:
    """The way between two passes; refuses when none fits the field."""
    path = job.way(job.exit(a), job.entry(b))
    if path is None:
        x, y, _ = job.exit(a)
        raise NoWayError(
            f"No way of turning radius {job.manner.radius_m:.1f} m leads from track {a.track.line} to track "
            f"{b.track.line} (at {x:.0f}, {y:.0f} m) inside the field; a wider headland or another turn may.",
            (a.track, b.track),
        )
    job.used[path.kind] = job.used.get(path.kind, 0) + 1
    return way_legs(job, path, b.track)


def mission_of(job: Job, order: list[Pass]) -> Mission:
    """The mission of a tractor that works its passes in order without waiting for anyone."""
    legs = pass_legs(job, order[0])
    for a, b in pairwise(order):
        legs += turn_legs(job, a, b) + pass_legs(job, b)
    return mission_from(legs)


def mission_from(legs: Sequence[Leg]) -> Mission:
    """These legs as a mission; a tractor may be kept waiting before it starts at all."""
    return Mission((legs[0].linked(may_wait=True), *legs[1:]))
