"""Where two tractors would be too close on their ways, whenever they are there: outlines at poses along both."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.clearance import beside, outline_distance
from vehicle.jit import compiled

BLOCK = 16  # poses under one enclosing circle
POSE = np.dtype([("x", "f8"), ("y", "f8"), ("angle", "f8"), ("model", "i8")])
Array = npt.NDArray[Any]


def poses_of(rows: Array) -> Array:
    """POSE records (n,) of x, y (m) and angle (rad), shape (n, 3)."""
    poses = np.zeros(len(rows), dtype=POSE)
    for column, name in enumerate(("x", "y", "angle")):
        poses[name] = rows[:, column]
    return poses


def meetings(a: Array, b: Array, models: Array, clearance_m: float, beside_clearance_m: float) -> Array:
    """Pairs (k, 2) of places in `a` and in `b`, POSE records, that two tractors cannot take at once.

    As in vehicle.clearance those are nearer than `clearance_m`, or than `beside_clearance_m` where they are beside each
    other. `models` (1,) is the record of their kind.
    """
    found = np.empty((4096, 2), dtype=np.int64)
    while True:
        count = _meetings(a, b, _circles(a), _circles(b), models, clearance_m, beside_clearance_m, found)
        if count <= len(found):
            return found[:count]
        found = np.empty((count, 2), dtype=np.int64)


def _circles(poses: Array) -> Array:
    """Centre and radius of a circle round each block of poses (m, 3)."""
    starts = np.arange(0, len(poses), BLOCK)
    sizes = np.diff(np.append(starts, len(poses)))
    x, y = (np.add.reduceat(poses[name], starts) / sizes for name in ("x", "y"))
    away = np.hypot(poses["x"] - np.repeat(x, sizes), poses["y"] - np.repeat(y, sizes))
    return np.column_stack([x, y, np.maximum.reduceat(away, starts)])


@compiled
def _meetings(  # type: ignore[no-untyped-def]
    a, b, circles_a, circles_b, models, clearance, beside_clearance, found
) -> int:
    """Number of pairs; as many as there is room for are written to `found`."""
    model = models[0]
    reach, count = 2.0 * model.reach + max(clearance, beside_clearance), 0
    for p in range(len(circles_a)):
        for q in range(len(circles_b)):
            dx, dy = circles_a[p, 0] - circles_b[q, 0], circles_a[p, 1] - circles_b[q, 1]
            limit = reach + circles_a[p, 2] + circles_b[q, 2]
            if dx * dx + dy * dy >= limit * limit:
                continue
            for i in range(p * BLOCK, min((p + 1) * BLOCK, len(a))):
                for j in range(q * BLOCK, min((q + 1) * BLOCK, len(b))):
                    dx, dy = a[i].x - b[j].x, a[i].y - b[j].y
                    if dx * dx + dy * dy >= reach * reach:
                        continue
                    distance = outline_distance(a[i], model, b[j], model)
                    if distance >= clearance:
                        continue
                    if distance >= beside_clearance and beside(a[i], model, b[j], model):
                        continue
                    if count < len(found):
                        found[count, 0], found[count, 1] = i, j
                    count += 1
    return count
