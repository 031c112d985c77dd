"""Heading and speed of a tractor of which only the positions of the antenna were logged.

An antenna ahead of the rear axle leaves the axle's track in bends: it is farther out, faster, and its course points
into the bend. The rear axle follows it without sliding aside, like a load on a rod: its direction is a tractrix of the
antenna's path. Over a straight piece of length s the angle b between rod and path shrinks as tan(b/2) exp(-s/length).
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.jit import compiled
from vehicle.measured.logs.record import Array

_FIRST_S = 1.0  # of the path, that tell how far the rod is off where it begins
_MOST_OFF = math.radians(60.0)  # no tractor turns tighter


def towed(time: Array, course: Array, pace: Array, length: float) -> Array:
    """How far the antenna's course (k,) turns off the heading (k,), rad, as both have signs.

    `length` (m) is that from the rear axle to the antenna, negative where the antenna comes behind the axle on its way.
    """
    out = np.zeros(len(time))
    if length == 0.0 or len(time) < 2:
        return out
    way = 0.5 * (pace[1:] + pace[:-1]) * np.diff(time)
    if length > 0.0:
        _follow(course, way, length, _first(time, course, way, length), out)
        return out
    # Behind the axle the rod is pushed, which tells nothing on the way: driven backwards in time it is drawn.
    back, ways = course[::-1].copy(), way[::-1].copy()
    _follow(back, ways, -length, _first(time[-1] - time[::-1], back, ways, -length), out)
    return out[::-1].copy()


def _first(time: Array, course: Array, way: Array, length: float) -> float:
    """The angle at the first row, as on a circle of the curvature that the path has there."""
    rows = min(int(np.searchsorted(time, _FIRST_S)), len(way))
    driven = float(way[:rows].sum())
    bend = float(course[rows] - course[0]) / driven if driven > 0.1 * length else 0.0
    most = math.sin(_MOST_OFF)
    return math.asin(min(max(length * bend, -most), most))


@compiled
def _follow(course, way, length, first, out) -> None:  # type: ignore[no-untyped-def]
    """Angles (k,) of the path with a rod that is drawn along courses (k,) and ways between them (k - 1,)."""
    out[0] = off = first
    for k in range(len(way)):
        turned = 0.5 * (course[k + 1] - course[k])
        off = 2.0 * math.atan(math.tan(0.5 * (off + turned)) * math.exp(-way[k] / length)) + turned
        out[k + 1] = off
