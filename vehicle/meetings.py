"""Where two tractors would be too close on their ways, whenever they are there: outlines at poses along both.

Circles round blocks of poses, and round blocks of blocks, tell which poses need a look at all. Of those the boxes round
whole tractors are tried first, and distances are worked out only where these do not stand clear of each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.clearance import (
    PARALLEL,
    ROUNDING_M,
    beside,
    boxes_of,
    corners_to_box,
    gap_either_way_m,
    seen_from_both,
)
from vehicle.jit import compiled, unowned

BLOCK = 16  # poses under one enclosing circle, and circles under one larger one
POSE = np.dtype([("x", "f8"), ("y", "f8"), ("angle", "f8"), ("model", "i8")])
Array = npt.NDArray[Any]


def poses_of(rows: Array) -> Array:
    """POSE records (n,) of x, y (m) and angle (rad), shape (n, 3)."""
    poses = np.zeros(len(rows), dtype=POSE)
    for column, name in enumerate(("x", "y", "angle")):
        poses[name] = rows[:, column]
    return poses


class Trail:
    """The poses of a way (POSE records) with all that does not depend on whom it meets.

    `ahead` (n, 2) are their directions; `near` and `far` (m, 3) centres and radii of circles round blocks of poses and
    round blocks of these.
    """

    def __init__(self, poses: Array) -> None:
        self.poses = poses
        self.ahead = np.column_stack([np.cos(poses["angle"]), np.sin(poses["angle"])])
        self.near = _circles(np.column_stack([poses["x"], poses["y"], np.zeros(len(poses))]))
        self.far = _circles(self.near)


def meetings(a: Trail, b: Trail, models: Array, clearance_m: float, beside_clearance_m: float) -> Array:
    """Places that two tractors cannot take at once: rows (k, 3) of one in `a`, the first and the last of some in `b`.

    Rows are in order of the place in `a`, and then of those in `b`. As in vehicle.clearance the two are nearer than
    `clearance_m`, or than `beside_clearance_m` where they are beside each other. `models` (1,) is the record of their
    kind.
    """
    found = np.empty((1024, 3), dtype=np.int64)
    while True:
        count = _meetings(
            a.poses, b.poses, a.ahead, b.ahead, a.near, b.near, b.far, models, clearance_m, beside_clearance_m, found
        )
        if count <= len(found):
            return found[:count]
        found = np.empty((count, 3), dtype=np.int64)


def _circles(circles: Array) -> Array:
    """Centre and radius of a circle round each block of circles (m, 3)."""
    starts = np.arange(0, len(circles), BLOCK)
    sizes = np.diff(np.append(starts, len(circles)))
    x, y = (np.add.reduceat(circles[:, column], starts) / sizes for column in (0, 1))
    away = np.hypot(circles[:, 0] - np.repeat(x, sizes), circles[:, 1] - np.repeat(y, sizes)) + circles[:, 2]
    return np.column_stack([x, y, np.maximum.reduceat(away, starts)])


@compiled
def _close(one, other, reach):  # type: ignore[no-untyped-def]
    """Whether two circles are nearer to each other than `reach`."""
    dx, dy, limit = one[0] - other[0], one[1] - other[1], reach + one[2] + other[2]
    return dx * dx + dy * dy < limit * limit


@compiled
def _near(a, b, ahead_a, ahead_b, seen, box, other, limit):  # type: ignore[no-untyped-def]
    """Whether a box of one tractor is nearer than `limit` to one of another, which it sees as told by `seen`."""
    gap = gap_either_way_m(seen, box, other)
    if gap < -ROUNDING_M or gap >= limit + ROUNDING_M:
        return gap < 0.0
    (acos, asin), (bcos, bsin) = ahead_a, ahead_b
    rear, front, half = box
    orear, ofront, ohalf = other
    if corners_to_box(a.x, a.y, acos, asin, rear, front, half, b.x, b.y, bcos, bsin, orear, ofront, ohalf) < limit:
        return True
    return (
        corners_to_box(b.x, b.y, bcos, bsin, orear, ofront, ohalf, a.x, a.y, acos, asin, rear, front, half) < limit
    )


@compiled
def _too_near(a, b, ahead_a, ahead_b, boxes, model, clearance, beside_clearance):  # type: ignore[no-untyped-def]
    """Whether two poses cannot be taken at once, without a distance where none counts."""
    (acos, asin), (bcos, bsin) = ahead_a, ahead_b
    seen = seen_from_both(a, b, acos, asin, bcos, bsin)
    whole, body, tool = boxes
    gap = gap_either_way_m(seen, whole, whole)
    limit = clearance
    if gap < limit + ROUNDING_M and abs(seen[5]) <= PARALLEL + ROUNDING_M and beside(a, model, b, model):
        limit = min(clearance, beside_clearance)
    if gap >= limit + ROUNDING_M:
        return False
    return (
        _near(a, b, ahead_a, ahead_b, seen, tool, tool, limit)
        or _near(a, b, ahead_a, ahead_b, seen, body, body, limit)
        or _near(a, b, ahead_a, ahead_b, seen, tool, body, limit)
        or _near(a, b, ahead_a, ahead_b, seen, body, tool, limit)
    )


@compiled
def _meetings(  # type: ignore[no-untyped-def]
    a, b, ahead_a, ahead_b, near_a, near_b, far_b, models, clearance, beside_clearance, found
):
    """Number of rows; as many as there is room for are written to `found`."""
    a, b, ahead_a, ahead_b = unowned(a), unowned(b), unowned(ahead_a), unowned(ahead_b)
    near_a, near_b, far_b = unowned(near_a), unowned(near_b), unowned(far_b)
    model, boxes, blocks = models[0], boxes_of(models[0]), np.empty(len(near_b), dtype=np.int64)
    reach, count = 2.0 * model.reach + max(clearance, beside_clearance), 0
    for p in range(len(near_a)):
        some = 0
        for far in range(len(far_b)):
            if _close(near_a[p], far_b[far], reach):
                for q in range(far * BLOCK, min((far + 1) * BLOCK, len(near_b))):
                    if _close(near_a[p], near_b[q], reach):
                        blocks[some] = q
                        some += 1
        for i in range(p * BLOCK, min((p + 1) * BLOCK, len(a)) if some > 0 else 0):
            last = -2
            for k in range(some):
                q = blocks[k]
                for j in range(q * BLOCK, min((q + 1) * BLOCK, len(b))):
                    dx, dy = a[i].x - b[j].x, a[i].y - b[j].y
                    if dx * dx + dy * dy >= reach * reach:
                        continue
                    first, second = (ahead_a[i, 0], ahead_a[i, 1]), (ahead_b[j, 0], ahead_b[j, 1])
                    if not _too_near(a[i], b[j], first, second, boxes, model, clearance, beside_clearance):
                        continue
                    if last != j - 1:
                        count += 1
                        if count <= len(found):
                            found[count - 1, 0], found[count - 1, 1] = i, j
                    if count <= len(found):
                        found[count - 1, 2] = j
                    last = j
    return count
