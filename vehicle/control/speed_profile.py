"""How fast a path can be driven: limits by its bends, the steering system, the tyres and the brakes.

Four rules, each for a place on a path of curvature k (1/m) with the wheels at an angle d (rad):

    bend      v <= sqrt(a / |k|)            a: lateral acceleration that load, comfort and tyres allow
    steering  v <= rate * W / |change|      the wheels turn by `change` (rad) within the steering distance W
    return    v <= rate * W / (f |d|)       the wheels could be straight again within the lookahead of turns, W / f
    brakes    v^2 <= v_next^2 + 2 b s       b: deceleration, s: distance to the next place

A tractor that is off its path is limited by the angle its wheels then have or are told (compute_correction_speed).

Guidance looks ahead and so smooths what a path asks for at once. Curvature is therefore the mean over W, which is in
proportion to the lookahead of turns; a step of curvature becomes a ramp of length W, which leaves the path by k W^2/24.
The same limits hold when a turn is estimated, when it is simulated, and in a plan that a real tractor drives.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from vehicle.jit import compile_function
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.tractor import Tractor
from vehicle.records import GRAVITY_MPS2

# Times the lookahead of turns. Measured: S-bends of 4 to 10 m radius, and arcs of 4 to 6 m, are lost from 1.7 on.
STEERING_DISTANCE_FACTOR = 1.4
TYRE_SHARE = 0.5  # of the side friction at which a front wheel slides
BRAKE_SHARE = 0.8  # of the largest deceleration: the speed lags behind its target
KINK_REACH_M = 0.5  # an angle between two segments is turned within this distance of it
MIN_LIMIT_MPS = 0.3  # a kink is driven at least at this speed
MIN_CORRECTION_MPS = 1.0
MAX_LIMIT_MPS = 1000.0  # where nothing limits the speed
UNLIMITED_MPS = math.inf  # a path that is not limited at all


@dataclass(frozen=True)
class DrivingLimits:
    """What limits the speed of a tractor in bends.

    `lateral_mps2` is the largest lateral acceleration on a ground, `steering_mps` the speed (m/s) at which the wheels
    turn by one radian within the steering distance `window_m`. On an arc of radius R they are at atan(`length_m` / R):
    that is the wheelbase without slip, more on soft ground.
    """

    lateral_mps2: float
    steering_mps: float
    window_m: float
    length_m: float
    deceleration_mps2: float


UNLIMITED = DrivingLimits(1e9, 1e9, 0.0, 1.0, 1e9)
"""Every bend at any speed: for distances, and where a time is compared without limits."""


def build_driving_limits(tractor: Tractor, ground: str) -> DrivingLimits:
    """The limits of a tractor on a ground."""
    tyres = GROUNDS[find_ground_index(ground)]
    window_m = STEERING_DISTANCE_FACTOR * tractor.guidance.turn_lookahead_m
    length_m = tractor.wheelbase_m
    if ground in tractor.radius:  # wider circles at full lock than without slip
        lock_m = tractor.compute_smallest_radius_m(ground) * math.tan(math.radians(tractor.max_steering_deg))
        length_m = max(length_m, lock_m)
    sliding_mps2 = GRAVITY_MPS2 * tyres.front_slope_per_deg * tyres.front_limit_deg
    return DrivingLimits(
        min(tractor.speed.max_lateral_mps2, TYRE_SHARE * sliding_mps2),
        math.radians(tractor.steering.rate_deg_per_s) * window_m,
        window_m,
        length_m,
        BRAKE_SHARE * tractor.speed.max_acceleration_mps2,
    )


@compile_function
def compute_straight_time_s(length, speed, start_speed, end_speed, acceleration) -> float:  # type: ignore[no-untyped-def]
    """Seconds on a straight between two bends: speeding up to `speed` if it is long enough, and slowing down again."""
    top = math.sqrt(acceleration * length + 0.5 * (start_speed * start_speed + end_speed * end_speed))
    if top < speed:
        return (2.0 * top - start_speed - end_speed) / acceleration  # type: ignore[no-any-return]
    gained = (speed - start_speed) ** 2 + (speed - end_speed) ** 2
    return length / speed + gained / (2.0 * speed * acceleration)  # type: ignore[no-any-return]


@compile_function
def compute_bend_limit(curvature: float, wheel: float, change: float, lateral: float, steering: float) -> float:
    """Largest speed (m/s) at a curvature (1/m), with the wheels at an angle and turning by `change` (rad) within the
    steering distance.
    """
    limit = MAX_LIMIT_MPS
    if curvature != 0.0:
        limit = min(math.sqrt(lateral / abs(curvature)), steering / (STEERING_DISTANCE_FACTOR * abs(wheel)))
    if change > 0.0:
        limit = min(limit, steering / change)
    return max(limit, MIN_LIMIT_MPS)


@compile_function
def measure_turned_angles(points, turned) -> None:  # type: ignore[no-untyped-def]
    """Write to `turned` (n, 2) the angle (rad, left positive) turned before each point of a polyline, and at it."""
    turned[:] = 0.0
    before, total = 0.0, 0.0
    for k in range(len(points) - 1):
        heading = math.atan2(points[k + 1, 1] - points[k, 1], points[k + 1, 0] - points[k, 0])
        angle = 0.0 if k == 0 else heading - before
        angle -= 2.0 * math.pi * np.round(angle / (2.0 * math.pi))
        turned[k, 0], turned[k, 1] = total, angle
        total += angle
        before = heading
    turned[len(points) - 1, 0] = total


@compile_function
def _read_turned_angle(distances, turned, at, place) -> tuple[float, int]:  # type: ignore[no-untyped-def]
    """The angle turned up to a distance, and the last point before it, searched from `place` on.

    The angle at a point is turned evenly from KINK_REACH_M before it to as far after it, or from and to the middles of
    the segments where these are nearer: on an arc evenly all along.
    """
    last = len(distances) - 1
    while place < last and distances[place + 1] <= at:
        place += 1
    if place >= last:
        return turned[last, 0] + turned[last, 1], place
    if at <= distances[0]:
        return 0.0, place
    span, driven = distances[place + 1] - distances[place], at - distances[place]
    reach = min(0.5 * span, KINK_REACH_M)
    angle = turned[place, 0] + turned[place, 1] * (0.5 + 0.5 * min(driven / reach, 1.0))
    return angle + turned[place + 1, 1] * 0.5 * max(1.0 - (span - driven) / reach, 0.0), place


@compile_function
def limit_by_bends(points, distances, lateral, length, steering, window, limits) -> None:  # type: ignore[no-untyped-def]
    """Write the limits by bends and steering at the points of a polyline (n, 2 or more) to `limits` (n,).

    `distances` (n,) are along the polyline; `lateral` and `length` (n,) are the largest lateral acceleration and the
    steering length there. The wheels begin to turn half of the steering distance `window` before a bend and are done
    half of it later than planned, so a limit holds that far to either side.
    """
    count = len(points)
    turned, places, angles = np.empty((count, 2)), np.zeros(4, np.int64), np.empty(4)
    own_limits = np.empty(count)
    measure_turned_angles(points, turned)
    for k in range(count):
        for side in range(4):
            at = distances[k] + (side - 1.5) * window
            angles[side], places[side] = _read_turned_angle(distances, turned, at, places[side])
        behind = math.atan(length[k] * (angles[1] - angles[0]) / window)
        here = (angles[2] - angles[1]) / window
        ahead = math.atan(length[k] * (angles[3] - angles[2]) / window)
        wheel = math.atan(length[k] * here)
        change = abs(wheel - behind) + abs(ahead - wheel)
        limits[k] = own_limits[k] = compute_bend_limit(here, wheel, change, lateral[k], steering)
    for k in range(count):
        later = k + 1
        while later < count and distances[later] - distances[k] <= 0.5 * window:
            limits[k], limits[later] = min(limits[k], own_limits[later]), min(limits[later], own_limits[k])
            later += 1


@compile_function
def compute_correction_speed(angle: float, wheel_pace: float) -> float:
    """Largest speed (m/s) with the wheels at an angle, or on their way to it: straight again within the lookahead.

    At `wheel_pace` (m/s) they turn by one radian within the lookahead of turns. A tractor that is far off its path
    slows down by this; at speed it would weave.
    """
    return max(wheel_pace / angle, MIN_CORRECTION_MPS) if angle > 0.0 else MAX_LIMIT_MPS


@compile_function
def limit_by_brakes(distances, deceleration, limits) -> None:  # type: ignore[no-untyped-def]
    """Lower `limits` (n,) to those from which a tractor can brake in time for the next one."""
    for k in range(len(limits) - 2, -1, -1):
        way = distances[k + 1] - distances[k]
        limits[k] = min(limits[k], math.sqrt(limits[k + 1] * limits[k + 1] + 2.0 * deceleration * way))
