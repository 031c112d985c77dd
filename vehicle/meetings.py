"""Where two tractors would be too close on their ways, whenever they are there: outlines at poses along both.

Circles round blocks of poses, and round blocks of blocks, tell which poses need a look at all. Of those the boxes round
whole tractors are tried first, and distances are worked out only where these do not stand clear of each other.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.clearance import beside, corners_to_box
from vehicle.jit import compiled

BLOCK = 16  # poses under one enclosing circle, and circles under one larger one
ROUNDING_M = 1e-9  # what stands clear by less is looked at more closely
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
def _close(one, other, reach) -> bool:  # type: ignore[no-untyped-def]
    """Whether two circles are nearer to each other than `reach`."""
    dx, dy, limit = one[0] - other[0], one[1] - other[1], reach + one[2] + other[2]
    return dx * dx + dy * dy < limit * limit  # type: ignore[no-any-return]


@compiled
def _clear_m(dx, dy, cos, sin, turn_cos, turn_sin, rear, front, half, orear, ofront, ohalf) -> float:  # type: ignore[no-untyped-def]
    """How far a box is at the least from another: the widest gap along the first one's axes; negative without one.

    The first lies along (cos, sin), the second is at (dx, dy) from it and turned by the angle of turn_cos, turn_sin.
    """
    middle, length = 0.5 * (orear + ofront), 0.5 * (ofront - orear)
    ahead = dx * cos + dy * sin + middle * turn_cos
    aside = dy * cos - dx * sin + middle * turn_sin
    long = length * abs(turn_cos) + ohalf * abs(turn_sin)
    wide = length * abs(turn_sin) + ohalf * abs(turn_cos)
    return max(ahead - long - front, rear - ahead - long, abs(aside) - wide - half)  # type: ignore[no-any-return]


@compiled
def _boxes(model, whole):  # type: ignore[no-untyped-def]
    """Rear, front and half width of the box round a tractor with its implement, of the tractor, of the implement."""
    whole[1, 0], whole[1, 1], whole[1, 2] = model.tail, model.nose, model.half_width
    whole[2, 0], whole[2, 1], whole[2, 2] = model.tool_tail, model.tool_front, model.tool_half_width
    whole[0, 0] = min(model.tail, model.tool_tail)
    whole[0, 1] = max(model.nose, model.tool_front)
    whole[0, 2] = max(model.half_width, model.tool_half_width)


@compiled
def _too_near(a, b, ahead_a, ahead_b, boxes, model, clearance, beside_clearance) -> bool:  # type: ignore[no-untyped-def]
    """Whether two poses cannot be taken at once; as vehicle.clearance has it, but without a distance where none counts."""
    acos, asin, bcos, bsin = ahead_a[0], ahead_a[1], ahead_b[0], ahead_b[1]
    dx, dy = b.x - a.x, b.y - a.y
    cos, sin = acos * bcos + asin * bsin, acos * bsin - asin * bcos
    limit, aligned = clearance, False
    for i in range(3):
        for j in range(3):
            if (i == 0) != (j == 0):
                continue
            p, q = boxes[i], boxes[j]
            clear = max(
                _clear_m(dx, dy, acos, asin, cos, sin, p[0], p[1], p[2], q[0], q[1], q[2]),
                _clear_m(-dx, -dy, bcos, bsin, cos, -sin, q[0], q[1], q[2], p[0], p[1], p[2]),
            )
            if clear >= limit + ROUNDING_M:
                if i == 0:
                    return False
                continue
            if i == 0:
                if beside(a, model, b, model):
                    aligned, limit = True, min(clearance, beside_clearance)
                if aligned and clear >= limit + ROUNDING_M:
                    return False
                continue
            if corners_to_box(a.x, a.y, acos, asin, p[0], p[1], p[2], b.x, b.y, bcos, bsin, q[0], q[1], q[2]) < limit:
                return True
            if corners_to_box(b.x, b.y, bcos, bsin, q[0], q[1], q[2], a.x, a.y, acos, asin, p[0], p[1], p[2]) < limit:
                return True
    return False


@compiled
def _meetings(  # type: ignore[no-untyped-def]
    a, b, ahead_a, ahead_b, near_a, near_b, far_b, models, clearance, beside_clearance, found
) -> int:
    """Number of rows; as many as there is room for are written to `found`."""
    model, boxes, blocks = models[0], np.empty((3, 3)), np.empty(len(near_b), dtype=np.int64)
    _boxes(model, boxes)
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
                    if not _too_near(a[i], b[j], ahead_a[i], ahead_b[j], boxes, model, clearance, beside_clearance):
                        continue
                    if last != j - 1:
                        count += 1
                        if count <= len(found):
                            found[count - 1, 0], found[count - 1, 1] = i, j
                    if count <= len(found):
                        found[count - 1, 2] = j
                    last = j
    return count
