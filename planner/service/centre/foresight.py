"""Where tractors will be in the next seconds: along released legs, or on the arc that they are steered on."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
import numpy.typing as npt

from planner.service.centre.course import Course
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import AUTOMATIC, MANUAL, REMOTE, Report, TractorState
from vehicle.tractor import Tractor

Array = npt.NDArray[np.float64]
STEP_S = 0.5
STRAIGHT_RAD = 1e-4


class Virtual(Protocol):
    """What virtual tractors say of real ones, in metres of the plan at the guided point; None for what is not known."""

    def place(self, number: int) -> tuple[float, float] | None:
        """Where a tractor is by now."""

    def path(self, number: int, times_s: Array) -> Array | None:
        """Poses (steps, 3) of a tractor at times from now on if it is driven on as it is told now."""


class NoTwins:
    """Nothing is known but what tractors report."""

    def place(self, number: int) -> tuple[float, float] | None:
        """None."""

    def path(self, number: int, times_s: Array) -> Array | None:
        """None."""


def moments(rules: Rules) -> Array:
    """The times (steps,) ahead that are looked at, from 0."""
    return np.arange(0.0, rules.ahead_s + 0.5 * STEP_S, STEP_S)


def standing(report: Report, rules: Rules) -> Array:
    """The poses (steps, 3) of an antenna that stays where it is."""
    return np.tile([report.x_m, report.y_m, report.heading_rad], (len(moments(rules)), 1))


def foreseen(
    state: TractorState, course: Course, tractor: Tractor, rules: Rules, *, going: bool = False,
    twin: Array | None = None,
) -> Array:  # fmt: skip
    """Poses (steps, 3) of the antenna at `moments`: x, y (m) and mathematical heading (rad) of the tractor.

    With `going` it is foreseen to drive on at the speed of its leg, whatever holds it now. `twin` is the path that its
    twin foretells, for one that is driven by hand: the twin knows how slowly steering and engine obey.
    """
    report = state.report
    assert report is not None
    times = moments(rules)
    if report.mode == AUTOMATIC or going:
        speed = max(abs(report.speed_mps), abs(report.speed_command_mps))
        metres = speed * times
        if going:
            metres = max(speed, course.legs[min(state.leg, len(course.legs) - 1)].speed_mps) * times
        elif state.holds:
            metres = np.minimum(metres, braking_m(speed, rules))
        poses = course.along(min(state.leg, len(course.legs) - 1), state.leg_m, metres.tolist(), state.released)
        poses[0] = report.x_m, report.y_m, report.heading_rad
        return poses
    if twin is not None and report.mode in (REMOTE, MANUAL):
        return twin
    return arc(report, tractor, report.velocity_mps, steering_of(report), rules)


def steering_of(report: Report) -> float:
    """The wheel angle of a report: measured where it is, else commanded."""
    return report.steering_command_rad if report.steering_rad is None else report.steering_rad


def arc(report: Report, tractor: Tractor, velocity_mps: float, steering_rad: float, rules: Rules) -> Array:
    """Poses (steps, 3) at a held speed and wheel angle (positive right): the rear axle on a circle of the wheelbase."""
    times = moments(rules)
    ahead = tractor.antenna_forward_m
    x = report.x_m - ahead * math.cos(report.heading_rad)
    y = report.y_m - ahead * math.sin(report.heading_rad)
    curvature = -math.tan(steering_rad) / (tractor.front_axle_m + tractor.rear_axle_m)
    heading = report.heading_rad + curvature * velocity_mps * times
    if abs(curvature) < STRAIGHT_RAD:
        rear = np.column_stack([x + velocity_mps * times * math.cos(report.heading_rad),
                                y + velocity_mps * times * math.sin(report.heading_rad)])  # fmt: skip
    else:
        radius = 1.0 / curvature
        rear = np.column_stack([x + radius * (np.sin(heading) - math.sin(report.heading_rad)),
                                y - radius * (np.cos(heading) - math.cos(report.heading_rad))])  # fmt: skip
    return np.column_stack([rear[:, 0] + ahead * np.cos(heading), rear[:, 1] + ahead * np.sin(heading), heading])


def braking_m(speed_mps: float, rules: Rules) -> float:
    """Metres to a standstill."""
    return speed_mps * speed_mps / (2.0 * rules.deceleration_mps2)


def braking_s(speed_mps: float, rules: Rules) -> float:
    """Seconds (of the simulated clock) in which a tractor stands once it is told to, the reaction included."""
    return abs(speed_mps) / rules.deceleration_mps2 + rules.reaction_s * rules.times


def centres(poses: Array, tractor: Tractor) -> Array:
    """Poses of the centre of mass from poses (..., 3) of the antenna."""
    guide = tractor.antenna_forward_m - tractor.rear_axle_m
    moved = poses.copy()
    moved[..., 0] -= guide * np.cos(poses[..., 2])
    moved[..., 1] -= guide * np.sin(poses[..., 2])
    return moved
