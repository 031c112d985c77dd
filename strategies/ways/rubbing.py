"""Whether the boxes of a machine come near lines while its guided point drives a way, compiled.

Thousands of turns beside obstacles are looked at before an order of tracks is searched: so one is followed step by step
without any geometry being made of it.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely

from vehicle.clearance import point_box
from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]
AT_ONCE = 32  # steps of a way held against the same stretches


def stretches_of(lines: shapely.Geometry) -> Floats:
    """The straight stretches of lines, (n, 4): x and y of both ends."""
    points, owner = shapely.get_coordinates(shapely.get_parts(lines), return_index=True)
    joined = np.flatnonzero(owner[1:] == owner[:-1])
    return np.ascontiguousarray(np.column_stack([points[joined], points[joined + 1]]))


@compiled
def stretch_to_box(ax, ay, bx, by, low, high, half) -> float:  # type: ignore[no-untyped-def]
    """Distance from the stretch between two points to the box [low, high] x [-half, half]; 0 where they meet."""
    best = min(point_box(ax, ay, low, high, half), point_box(bx, by, low, high, half))
    dx, dy = bx - ax, by - ay
    first, last = 0.0, 1.0  # the part of the stretch that is inside, as far as both pairs of sides tell
    for place, step, least, most in ((ax, dx, low, high), (ay, dy, -half, half)):
        if step == 0.0:
            if place < least or place > most:
                first = 2.0
            continue
        one, other = (least - place) / step, (most - place) / step
        first, last = max(first, min(one, other)), min(last, max(one, other))
    if first <= last:
        return 0.0
    square = dx * dx + dy * dy
    for corner in range(4):
        x, y = (low if corner % 2 == 0 else high), (-half if corner < 2 else half)
        share = 0.0
        if square > 0.0:
            share = min(max(((x - ax) * dx + (y - ay) * dy) / square, 0.0), 1.0)
        best = min(best, math.hypot(x - ax - share * dx, y - ay - share * dy))
    return best


@compiled
def boxes_near(x, y, heading, boxes, stretches, near, count, far_m, spare_m):  # type: ignore[no-untyped-def]
    """Whether a box of a machine with its axle at a pose is within `spare_m` of one of the stretches `near`.

    No place of its boxes is `far_m` or farther from the axle, less `spare_m`.
    """
    cosine, sine = math.cos(heading), math.sin(heading)
    for k in range(count):
        ax, ay = stretches[near[k], 0] - x, stretches[near[k], 1] - y
        bx, by = stretches[near[k], 2] - x, stretches[near[k], 3] - y
        if (ax > far_m and bx > far_m) or (ax < -far_m and bx < -far_m):
            continue
        if (ay > far_m and by > far_m) or (ay < -far_m and by < -far_m):
            continue
        a, aside = ax * cosine + ay * sine, ay * cosine - ax * sine
        b, bside = bx * cosine + by * sine, by * cosine - bx * sine
        for box in range(len(boxes)):
            low, high, half = boxes[box, 0], boxes[box, 1], boxes[box, 2]
            if max(a, b) < low - spare_m or min(a, b) > high + spare_m:
                continue
            if max(aside, bside) < -half - spare_m or min(aside, bside) > half + spare_m:
                continue
            if stretch_to_box(a, aside, b, bside, low, high, half) <= spare_m:
                return True
    return False


@compiled
def _within(stretches, x, y, reach_m, near):  # type: ignore[no-untyped-def]
    """Number of the stretches whose bounds are within reach of a place; which they are is written to `near`."""
    return _still_within(stretches, np.arange(len(stretches)), len(stretches), x, y, reach_m, near)


@compiled
def _still_within(stretches, near, many, x, y, reach_m, close):  # type: ignore[no-untyped-def]
    """Number of those stretches of the first `many` in `near` within reach of a place; they are written to `close`."""
    count = 0
    for place in range(many):
        k = near[place]
        west, east = min(stretches[k, 0], stretches[k, 2]), max(stretches[k, 0], stretches[k, 2])
        south, north = min(stretches[k, 1], stretches[k, 3]), max(stretches[k, 1], stretches[k, 3])
        if west <= x + reach_m and east >= x - reach_m and south <= y + reach_m and north >= y - reach_m:
            close[count] = k
            count += 1
    return count


@compiled
def rubs(ends, pieces, boxes, stretches, guide_m, reach_m, spare_m, step_m):  # type: ignore[no-untyped-def]
    """Whether the machine comes within `spare_m` of a stretch (n, 4) anywhere on a way.

    The way leads from one of the poses `ends` (2, 3) to the other in pieces (k, 3) of length, curvature and gear. It is
    looked at every `step_m` and where pieces end: forwards the rear axle trails the guided point, `guide_m` ahead of
    it, in reverse it keeps to the way. `boxes` (m, 3) are from where to where ahead of the axle, and half the width;
    nothing of them is farther than `reach_m` from the guided point.
    """
    px, py, heading = ends[0, 0], ends[0, 1], ends[0, 2]
    length = 0.0
    for k in range(len(pieces)):
        length += pieces[k, 0]
    near, close = np.empty(len(stretches), dtype=np.int64), np.empty(len(stretches), dtype=np.int64)
    # No place of a way is farther from the middle of its ends than half its length.
    far_m = reach_m + guide_m + spare_m
    count = _within(stretches, 0.5 * (px + ends[1, 0]), 0.5 * (py + ends[1, 1]), 0.5 * length + far_m, near)
    if count == 0:
        return False
    x, y = px - guide_m * math.cos(heading), py - guide_m * math.sin(heading)
    if boxes_near(x, y, heading, boxes, stretches, near, count, far_m, spare_m):
        return True
    for k in range(len(pieces)):
        bend, gear = pieces[k, 1], pieces[k, 2]
        steps = max(1, math.ceil(pieces[k, 0] / step_m - 1e-9))
        fx, fy, qx, qy = px, py, px, py
        for number in range(1, steps + 1):
            if number % AT_ONCE == 1:  # so many steps lead no farther than this
                some = _still_within(stretches, near, count, qx, qy, far_m + guide_m + (AT_ONCE + 1) * step_m, close)
            run = gear * pieces[k, 0] * number / steps
            half = 0.5 * bend * run
            chord = run * (math.sin(half) / half if half != 0.0 else 1.0)
            nx, ny = fx + chord * math.cos(heading + half), fy + chord * math.sin(heading + half)
            if gear < 0.0:
                angle = math.atan2(qy - ny, qx - nx)
                x, y = nx - guide_m * math.cos(angle), ny - guide_m * math.sin(angle)
            else:
                dx, dy = nx - x, ny - y
                angle, apart = math.atan2(dy, dx), math.hypot(dx, dy)
                x, y = nx - guide_m * dx / apart, ny - guide_m * dy / apart
            if some and boxes_near(x, y, angle, boxes, stretches, close, some, far_m, spare_m):
                return True
            qx, qy = nx, ny
        px, py, heading = qx, qy, heading + bend * gear * pieces[k, 0]
    return False
