"""Headings where none was logged: the course of the antenna, and the angle from the heading to that course.

The rear axle follows the antenna like a load on a rod, so its direction is a tractrix of the antenna's path. Over a
straight piece of length s the angle b between rod and path shrinks as tan(b/2) exp(-s/length).
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.series import measure_spread
from vehicle.jit import compile_function

# Chosen: a chord that noise alone makes as long in one of 600 rows has no direction; a tractor that stands has none.
_STANDING_SIGMAS = 3.6
# Chosen, m/s and share of the fastest pace: held positions and tight bends look like noise, which is not so fast.
_DRIVING_MPS, _MOST_NOISE_SHARE = 0.5, 0.3
COURSE_CHORD_S = 0.6  # one centimetre of antenna noise is one degree of course at walking pace
_INITIAL_PATH_S = 1.0  # of the path, from which the initial angle of the rod is estimated
_MOST_ANGLE_RAD = math.radians(60.0)  # no tractor turns tighter


def _estimate_position_noise(east: Array, north: Array) -> float:
    """Return the standard deviation (m) of positions from row to row, from their third differences."""
    thirds = np.concatenate([np.diff(east, 3), np.diff(north, 3)])
    return measure_spread(thirds) / math.sqrt(20.0) if len(thirds) else 0.0


def compute_course(time: Array, east: Array, north: Array) -> tuple[Array, Array]:
    """Return course over ground (continuous) and speed from positions, over chords of COURSE_CHORD_S."""
    before, after = time - 0.5 * COURSE_CHORD_S, time + 0.5 * COURSE_CHORD_S
    before, after = np.maximum(before, time[0]), np.minimum(after, time[-1])
    dx = np.interp(after, time, east) - np.interp(before, time, east)
    dy = np.interp(after, time, north) - np.interp(before, time, north)
    pace = np.hypot(dx, dy) / (after - before)
    angle = np.arctan2(dy, dx)
    noise_pace = _STANDING_SIGMAS * math.sqrt(2.0) * _estimate_position_noise(east, north) / COURSE_CHORD_S
    fastest = float(pace.max())
    if fastest > _DRIVING_MPS:
        noise_pace = min(noise_pace, _MOST_NOISE_SHARE * fastest)
    moving = np.flatnonzero(pace > max(0.3 * float(np.median(pace)), noise_pace))
    if len(moving) == 0:
        return np.zeros(len(time)), pace
    course: Array = np.interp(np.arange(len(time)), moving, np.unwrap(angle[moving]))
    return course, pace


def compute_course_offset(time: Array, course: Array, pace: Array, length: float) -> Array:
    """Return the angle (k, rad) from the heading to the antenna's course.

    `length` (m) is the distance from the rear axle to the antenna, negative where the antenna trails the axle.
    """
    out = np.zeros(len(time))
    if length == 0.0 or len(time) < 2:
        return out
    distances = 0.5 * (pace[1:] + pace[:-1]) * np.diff(time)
    if length > 0.0:
        _compute_pulled_rod_angles(
            course, distances, length, _compute_initial_angle(time, course, distances, length), out
        )
        return out
    # Behind the axle the rod is pushed, which is unstable; backwards in time it is pulled.
    reversed_course, reversed_distances = course[::-1].copy(), distances[::-1].copy()
    _compute_pulled_rod_angles(
        reversed_course,
        reversed_distances,
        -length,
        _compute_initial_angle(time[-1] - time[::-1], reversed_course, reversed_distances, -length),
        out,
    )
    return out[::-1].copy()


def _compute_initial_angle(time: Array, course: Array, distances: Array, length: float) -> float:
    """Return the angle at the first row, as on a circle with the curvature of the path there."""
    rows = min(int(np.searchsorted(time, _INITIAL_PATH_S)), len(distances))
    path_length = float(distances[:rows].sum())
    bend = float(course[rows] - course[0]) / path_length if path_length > 0.1 * length else 0.0
    most_sine = math.sin(_MOST_ANGLE_RAD)
    return math.asin(min(max(length * bend, -most_sine), most_sine))


@compile_function
def _compute_pulled_rod_angles(course, distances, length, first, out) -> None:  # type: ignore[no-untyped-def]
    """Return the angles (k,) between path and rod, pulled along courses (k,) and distances between them (k - 1,)."""
    out[0] = angle = first
    for k in range(len(distances)):
        turned = 0.5 * (course[k + 1] - course[k])
        angle = 2.0 * math.atan(math.tan(0.5 * (angle + turned)) * math.exp(-distances[k] / length)) + turned
        out[k + 1] = angle
