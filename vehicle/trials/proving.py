"""Drives that show whether a tractor file holds together: circles, a straight track, a change of lane, a turn."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

from vehicle.calibration import drive_circle
from vehicle.circles import CIRCLE_SPEED_MPS, Circle
from vehicle.gnss import default_table
from vehicle.ground import ground_names
from vehicle.learnt import without_logs
from vehicle.missions import TRACK, TURN, Leg, Mission, Plan, Task
from vehicle.run import DONE
from vehicle.tractor import Implement, Tractor
from vehicle.trials.drive import follow
from vehicle.trials.paths import straight
from vehicle.world import simulate

Array = npt.NDArray[np.float64]
GROUND = "soil"
LANE_M, LANE_AT_M, LANE_LENGTH_M, SETTLED_M = 1.0, 20.0, 100.0, 0.05
TRACK_M, SETTLING_M = 100.0, 20.0
WIDER = 1.08  # plans turn that much wider than full lock, so that guidance has something to correct with
BEFORE_M, AFTER_M, LONGEST_S = 15.0, 25.0, 600.0
ARC_POINTS = 91


@dataclass(frozen=True, eq=False)
class Round:
    """A circle at a fixed wheel angle (degrees, positive right) beside the radius the file asks for (m)."""

    ground: str
    steering_deg: float
    asked_m: float
    circle: Circle


@dataclass(frozen=True, eq=False)
class Lane:
    """A straight track followed by one LANE_M to its right.

    `weaving_m` is the largest error on the first, with the errors of an RTK receiver, in its second half,
    `settled_m` the way until the second is kept to SETTLED_M (None: never), `beyond_m` how far the tractor gets
    beyond it.
    """

    track: Array
    weaving_m: float
    settled_m: float | None
    beyond_m: float


@dataclass(frozen=True, eq=False)
class Half:
    """A half circle between two tracks: radius, path, track (t, 2), and how far that got off the path (None: stuck)."""

    radius_m: float
    path: Array
    track: Array
    off_m: float | None


def circles(tractor: Tractor) -> tuple[Round, ...]:
    """Full and half lock to both sides on every ground whose radii the file has, without what logs taught.

    [radius] is measured before logs are: effects come on top of it.
    """
    tractor, lock = without_logs(tractor), tractor.max_steering_deg
    return tuple(
        Round(ground, angle, tractor.power_law(ground).radius_m(angle), drive_circle(tractor, angle, ground))
        for ground in ground_names()
        if ground in tractor.radius
        for angle in (lock, -lock, 0.5 * lock, -0.5 * lock)
    )


def ackermann_m(tractor: Tractor) -> float:
    """Radius of the antenna's circle at full lock by wheelbase and wheel angle alone."""
    across = tractor.wheelbase_m / math.tan(math.radians(tractor.max_steering_deg))
    return math.hypot(tractor.antenna_forward_m, across)


def lanes(tractor: Tractor) -> Lane:
    """A straight track, then one beside it, at the thesis's speed on soil."""
    seconds = LANE_LENGTH_M / CIRCLE_SPEED_MPS
    plain = straight(TRACK_M, CIRCLE_SPEED_MPS, GROUND)
    first = follow(tractor, plain, seconds=seconds, position_errors=default_table()).place()
    weaving = np.abs(first[first[:, 1] > 0.5 * TRACK_M, 0])
    jump = (LANE_AT_M, LANE_M)
    path = straight(LANE_LENGTH_M, CIRCLE_SPEED_MPS, GROUND)
    track = follow(tractor, path, seconds=2.0 * seconds, jump=jump).place()
    end = LANE_LENGTH_M - SETTLING_M
    far = np.nonzero((np.abs(track[:, 0] - LANE_M) > SETTLED_M) & (track[:, 1] < end))[0]
    reached = bool((track[:, 1] >= end).any())
    settled = float(track[far[-1], 1]) - LANE_AT_M if reached else math.inf
    known = settled < end - LANE_AT_M - 1.0
    beyond = max(float(track[:, 0].max()) - LANE_M, 0.0)
    return Lane(track, float(weaving.max(initial=0.0)), settled if known else None, beyond)


def half_circle(tractor: Tractor) -> Half:
    """From one track to another and half a circle between them, as wide as plans take it."""
    radius = WIDER * tractor.smallest_radius_m(GROUND)
    turned = np.linspace(0.0, math.pi, ARC_POINTS)
    arc = radius * np.stack([1.0 - np.cos(turned), np.sin(turned)], axis=1)
    across = 2.0 * radius
    ways = (np.array([[0.0, -BEFORE_M], [0.0, 0.0]]), arc, np.array([[across, 0.0], [across, -AFTER_M]]))
    legs = tuple(
        Leg(points, CIRCLE_SPEED_MPS, ground=GROUND, task=Task(kind), implement=kind == TRACK)
        for points, kind in zip(ways, (TRACK, TURN, TRACK), strict=True)
    )
    run = simulate(Plan((Mission(legs),)), tractor, Implement(), max_time_s=LONGEST_S)
    path = np.concatenate(ways)
    place, angle = run.poses(0)[:, :2], run.poses(0)[:, 2:]
    ahead = tractor.antenna_forward_m - tractor.rear_axle_m
    track = place + ahead * np.hstack([np.cos(angle), np.sin(angle)])
    if run.outcome != DONE:
        return Half(radius, path, track, None)
    off = shapely.distance(shapely.points(track), shapely.LineString(path))
    return Half(radius, path, track, float(off.max()))
