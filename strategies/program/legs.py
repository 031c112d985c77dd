"""Swaths and paths as legs of a mission."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from fields.layout.swaths import Swath
from strategies.path_planning.paths import DrivePath, Pose
from strategies.program.field_job import FieldJob, SwathPass
from vehicle.missions.plan import DRIVE_IN, SWATH, Leg, LegTask, Mission

PATH_STEP_M = 0.25
MIN_LEG_M = 0.05
MIN_STEP_M = 1e-3  # of a path: no leg begins with a shorter one, which would give it no direction


def make_swath_task(kind: str, swath: Swath) -> LegTask:
    """The task of a leg that works a swath or leads to it."""
    return LegTask(kind, swath.line, swath.piece)


def build_straight_leg(
    job: FieldJob, a: Pose, start_m: float, end_m: float, task: LegTask, *, may_wait: bool = False
) -> Leg:
    """A leg between two distances ahead of a pose: work at work speed, anything else at turn speed.

    It is straight, except on a curved swath and in bends round small obstacles of the pass that begins at the pose;
    distances are along the swath.
    """
    bent_line = job.obstacle_bends.bent_lines.get(a[:2])
    if bent_line is None:
        ahead = np.array([math.cos(a[2]), math.sin(a[2])])
        points = np.array([a[:2] + start_m * ahead, a[:2] + end_m * ahead])
    else:
        points = bent_line.cut_between(start_m, end_m)
    return Leg(
        points=points,
        speed_mps=job.driving_rules.work_speed_mps if task.is_work else job.driving_rules.turn_speed_mps,
        implement=task.is_work,
        ground=_find_ground(job, points),
        task=task,
        may_wait=may_wait,
    )


def build_path_legs(job: FieldJob, path: DrivePath, task: LegTask) -> list[Leg]:
    """A path with the implement up as one leg per gear, for a task."""
    return [
        Leg(
            points=points,
            speed_mps=job.driving_rules.get_path_speed_mps(gear),
            gear=gear,
            ground=_find_ground(job, points),
            task=task,
        )
        for gear, points in path.sample(PATH_STEP_M)
        if float(np.hypot(*np.diff(points, axis=0).T).sum()) > MIN_LEG_M
    ]


def add_wait_points(legs: Sequence[Leg], every_m: float) -> list[Leg]:
    """The same legs with a place to wait before each, and about every `every_m` metres on those driven forwards."""
    split_legs: list[Leg] = []
    for leg in legs:
        steps_m = np.hypot(*np.diff(leg.points, axis=0).T)
        distances_m = np.concatenate(([0.0], np.cumsum(steps_m)))
        parts = max(1, round(distances_m[-1] / every_m)) if leg.gear > 0 else 1
        cuts = np.searchsorted(distances_m, distances_m[-1] * np.arange(1, parts) / parts)
        cuts = cuts[steps_m[np.minimum(cuts, len(steps_m) - 1)] > MIN_STEP_M]
        for a, b in pairwise([0, *sorted(set(cuts.tolist()) - {0, len(distances_m) - 1}), len(distances_m) - 1]):
            may_wait = leg.may_wait if a == 0 and split_legs and split_legs[-1].gear != leg.gear else True
            part = replace(leg, points=leg.points[a : b + 1], may_wait=may_wait)
            split_legs.append(part.copy_with_length(float(steps_m[a:b].sum())))
    return split_legs


def _find_ground(job: FieldJob, points: np.ndarray) -> str:
    x, y = points[len(points) // 2]
    return job.layout.field.find_ground_at(float(x), float(y))


def build_swath_legs(job: FieldJob, swath_pass: SwathPass) -> list[Leg]:
    """Drive in until the implement is over the headland line, then work to the far line.

    The last part is a leg of its own, so that a tractor can wait before it, clear of the headland.
    """
    entry, tool_m = job.get_entry_pose(swath_pass), job.driving_rules.tool_m
    end_m = swath_pass.swath.length_m + tool_m
    hold_m = max(end_m - job.driving_rules.hold_back_m, 0.5 * (tool_m + end_m))
    work_task = make_swath_task(SWATH, swath_pass.swath)
    return [
        build_straight_leg(job, entry, 0.0, tool_m, make_swath_task(DRIVE_IN, swath_pass.swath)),
        build_straight_leg(job, entry, tool_m, hold_m, work_task),
        build_straight_leg(job, entry, hold_m, end_m, work_task, may_wait=True),
    ]


def make_mission(legs: Sequence[Leg]) -> Mission:
    """The legs as a mission in which the tractor may wait before it starts."""
    return Mission((legs[0].copy_with(may_wait=True), *legs[1:]))
