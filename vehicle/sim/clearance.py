"""Distances between the outlines of tractors (a tractor box and an implement box each), and which are near others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from fields.arrays import Floats
from vehicle.jit import compile_function

NEAR_MARGIN_M = 0.5  # covers the speed gained between two checks
LEAVE_MARGIN_M = 0.5  # hysteresis, so that no tractor alternates at every check
ROUNDING_M = 1e-9  # smaller gaps are computed more closely
CONTACT_M = 0.05  # a distance that counts as contact
STANDING_ERROR_M = 0.01  # of a distance between two that stand, which is not to become smaller
PARALLEL_SINE = math.sin(math.radians(10.0))


@compile_function
def compute_point_distance(px: float, py: float, rear: float, front: float, half: float) -> float:
    """Distance from a point to the box [rear, front] x [-half, half]; 0 inside."""
    dx = max(rear - px, px - front, 0.0)
    dy = max(abs(py) - half, 0.0)
    return math.sqrt(dx * dx + dy * dy)


@compile_function
def compute_corner_distance(a, ahead_a, box, b, ahead_b, other_box) -> float:  # type: ignore[no-untyped-def]
    """Smallest distance of the four corners of a box of `a` to one of `b`.

    Boxes are rear, front and half width, `ahead_a` and `ahead_b` cosine and sine of the angles.
    """
    (acos, asin), (bcos, bsin) = ahead_a, ahead_b
    best = 1e9
    for corner in range(4):
        forward = box[1] if corner < 2 else box[0]
        left = box[2] if corner % 2 == 0 else -box[2]
        x = a.x + forward * acos - left * asin - b.x
        y = a.y + forward * asin + left * acos - b.y
        along, across = x * bcos + y * bsin, y * bcos - x * bsin
        best = min(best, compute_point_distance(along, across, other_box[0], other_box[1], other_box[2]))
    return best


@compile_function
def compute_axis_gap_m(x, y, cos, sin, box, other_box):  # type: ignore[no-untyped-def]
    """The widest gap between two boxes along the first one's axes (m); negative where they overlap in both.

    Boxes are rear, front and half width. The second tractor is at (x, y) as the first one sees it, and turned by an
    angle of this cos and sin.
    """
    middle, length = 0.5 * (other_box[0] + other_box[1]), 0.5 * (other_box[1] - other_box[0])
    ahead, aside = x + middle * cos, abs(y + middle * sin)
    long = length * abs(cos) + other_box[2] * abs(sin)
    wide = length * abs(sin) + other_box[2] * abs(cos)
    return max(ahead - long - box[1], box[0] - ahead - long, aside - wide - box[2])


@compile_function
def get_boxes(model):  # type: ignore[no-untyped-def]
    """Rear, front and half width of three boxes: tractor with implement, tractor, implement."""
    body = (model.tail, model.nose, model.half_width)
    tool = (model.tool_tail, model.tool_front, model.tool_half_width)
    whole = (min(body[0], tool[0]), max(body[1], tool[1]), max(body[2], tool[2]))
    return whole, body, tool


@compile_function
def compute_relative_pose(a, b, ahead_a, ahead_b):  # type: ignore[no-untyped-def]
    """Two poses as each sees the other: (x, y) for the first and for the second, cos and sin of the angle between."""
    (acos, asin), (bcos, bsin) = ahead_a, ahead_b
    dx, dy = b.x - a.x, b.y - a.y
    return (
        dx * acos + dy * asin,
        dy * acos - dx * asin,
        -dx * bcos - dy * bsin,
        dx * bsin - dy * bcos,
        acos * bcos + asin * bsin,
        acos * bsin - asin * bcos,
    )


@compile_function
def compute_box_gap_m(relative_pose, box, other_box):  # type: ignore[no-untyped-def]
    """The widest gap between two boxes along the axes of either (m); negative exactly where they overlap."""
    x, y, back_x, back_y, cos, sin = relative_pose
    return max(
        compute_axis_gap_m(x, y, cos, sin, box, other_box),
        compute_axis_gap_m(back_x, back_y, cos, -sin, other_box, box),
    )


@compile_function
def compute_distance_below(a, am, b, bm, limit) -> float:  # type: ignore[no-untyped-def]
    """Distance (m) between the outlines of two tractors if it is less than `limit`; else 1e9, or the distance.

    Boxes without a gap along any of their axes overlap, even if no corner is inside the other box. Otherwise the
    distance is that of a corner; it is not computed where the gap shows that it is too large.
    """
    ahead_a, ahead_b = (math.cos(a.angle), math.sin(a.angle)), (math.cos(b.angle), math.sin(b.angle))
    relative_pose = compute_relative_pose(a, b, ahead_a, ahead_b)
    whole, body, tool = get_boxes(am)
    other_whole, other_body, other_tool = get_boxes(bm)
    best = 1e9
    if compute_box_gap_m(relative_pose, whole, other_whole) >= limit + ROUNDING_M:
        return best
    for i in range(2):
        box = body if i == 0 else tool
        for j in range(2):
            other_box = other_body if j == 0 else other_tool
            gap = compute_box_gap_m(relative_pose, box, other_box)
            if gap < -ROUNDING_M:
                return 0.0
            if gap >= min(limit, best) + ROUNDING_M:
                continue
            best = min(
                best,
                compute_corner_distance(a, ahead_a, box, b, ahead_b, other_box),
                compute_corner_distance(b, ahead_b, other_box, a, ahead_a, box),
            )
    return best


@compile_function
def compute_outline_distance(a, am, b, bm) -> float:  # type: ignore[no-untyped-def]
    """Distance (m) between the outlines of tractors, states `a` and `b`, models `am` and `bm`; 0 where they cross."""
    return compute_distance_below(a, am, b, bm, math.inf)


@compile_function
def is_beside(a, am, b, bm) -> bool:  # type: ignore[no-untyped-def]
    """Whether two tractors are on nearly parallel lines, and neither tractor is in line with any part of the other.

    This is how they work neighbouring swaths, queue there and pass each other.
    """
    acos, asin, bcos, bsin = math.cos(a.angle), math.sin(a.angle), math.cos(b.angle), math.sin(b.angle)
    if abs(acos * bsin - asin * bcos) > PARALLEL_SINE:
        return False
    dx, dy = b.x - a.x, b.y - a.y
    aside = min(abs(acos * dy - asin * dx), abs(bcos * dy - bsin * dx))
    in_line = max(
        am.half_width + max(bm.half_width, bm.tool_half_width), bm.half_width + max(am.half_width, am.tool_half_width)
    )
    return aside > in_line  # type: ignore[no-any-return]


@compile_function
def compute_start_limit(start_distance: float, clearance: float) -> float:
    """How near two may come that began `start_distance` apart and part (m): no nearer than they stood, and those that
    touch may not drive."""
    return min(clearance, max(start_distance - STANDING_ERROR_M, CONTACT_M))


def build_start_distances(enters: Sequence[bool]) -> Floats:
    """What `find_too_close` is to note of each pair (n, n) before its first check; whoever `enters` begins off the
    field, and keeps the clearance at once."""
    absent = np.array(enters, np.bool_)
    return np.where(absent[:, None] | absent, np.inf, 0.0)


@compile_function
def find_too_close(  # type: ignore[no-untyped-def]
    states, models, clearances, start_distances, clearance, beside_clearance
) -> tuple[float, int, int]:
    """Update the smallest clearance so far per tractor; return the pair that is closest of those too close.

    Two are too close within `clearance`, or within `beside_clearance` if they are beside each other; if none are, the
    distance returned is 1e9. Those that began nearer may be as near as compute_start_limit says until they have been
    apart by the clearance, or both have left the circles in which they stood: `start_distances` (n, n) becomes how far
    apart two began, in place of 0, and infinite once they have parted. Pairs whose enclosing circles are farther apart
    than `clearance` and than the smallest clearance of either so far are skipped, as are tractors off the field.
    """
    best, first, second = 1e9, -1, -1
    for i in range(len(states)):
        a = states[i]
        if a.away == 1:
            continue
        for j in range(i):
            b = states[j]
            if b.away == 1:
                continue
            relevant_m = max(clearances[i], clearances[j], clearance)
            limit = relevant_m + models[a.model].reach + models[b.model].reach
            dx, dy = a.x - b.x, a.y - b.y
            if dx * dx + dy * dy >= limit * limit:
                start_distances[i, j] = math.inf
                continue
            distance = compute_distance_below(a, models[a.model], b, models[b.model], relevant_m)
            clearances[i] = min(clearances[i], distance)
            clearances[j] = min(clearances[j], distance)
            if distance >= clearance:
                start_distances[i, j] = math.inf
            elif start_distances[i, j] == 0.0:
                start_distances[i, j] = distance
            least = clearance
            if a.progress < models[a.model].reach or b.progress < models[b.model].reach:
                least = compute_start_limit(start_distances[i, j], clearance)
            if distance >= min(least, best):
                continue
            if distance >= beside_clearance and is_beside(a, models[a.model], b, models[b.model]):
                continue
            best, first, second = distance, j, i
    return best, first, second


@compile_function
def mark_contact_candidates(states, models, interval, present, required) -> bool:  # type: ignore[no-untyped-def]
    """Mark in `required` (n,) every tractor that could touch another before the next check; whether `present` differs.

    Two are near when their enclosing circles could meet within twice the distance that both drive in the `interval` (s)
    between two checks; tractors that are `present` already must be a little farther apart to leave.
    """
    for i in range(len(states)):
        required[i] = False
    for i in range(len(states)):
        a = states[i]
        if a.away == 1:
            continue
        for j in range(i):
            if required[i] and required[j]:
                continue
            b = states[j]
            if b.away == 1:
                continue
            limit = models[a.model].reach + models[b.model].reach + NEAR_MARGIN_M
            limit += 2.0 * interval * (abs(a.forward) + abs(b.forward))
            if present[i] and present[j]:
                limit += LEAVE_MARGIN_M
            dx, dy = a.x - b.x, a.y - b.y
            if dx * dx + dy * dy < limit * limit:
                required[i] = required[j] = True
    return (required != present).any()  # type: ignore[no-any-return]
