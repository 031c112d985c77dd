"""Who comes too near to whom on ways foreseen: outlines of all tractors at poses of the same times."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.clearance import beside, outline_distance
from vehicle.jit import compiled
from vehicle.meetings import POSE

Array = npt.NDArray[Any]


def approaches(
    poses: npt.NDArray[np.float64], there: npt.NDArray[np.bool_], model: Array, clearance_m: float, beside_m: float
) -> list[tuple[int, int, int, float]]:
    """Pairs (i, j, k, metres) of tractors i < j that are too near at step k, the first such step of each pair.

    `poses` (n, steps, 3) are x, y (m) and angle (rad) of the centres of mass at common times, `there` (n,) who is on
    the field, `model` (1,) the record of their kind. Too near is as in vehicle.clearance.
    """
    records = _records(poses)
    rows = np.empty((max(len(poses) * (len(poses) - 1) // 2, 1), 4))
    count = _approaches(records, there, model, clearance_m, beside_m, rows)
    return [(int(i), int(j), int(k), float(metres)) for i, j, k, metres in rows[:count]]


def distances(one: npt.NDArray[np.float64], other: npt.NDArray[np.float64], model: Array) -> npt.NDArray[np.float64]:
    """Metres (steps,) between the outlines of two tractors at poses (steps, 3) of common times."""
    out = np.empty(len(one))
    _distances(_records(one[None])[0], _records(other[None])[0], model, out)
    return out


def _records(poses: npt.NDArray[np.float64]) -> Array:
    records = np.zeros(poses.shape[:2], dtype=POSE)
    for column, name in enumerate(("x", "y", "angle")):
        records[name] = poses[:, :, column]
    return records


@compiled
def _approaches(poses, there, model, clearance, beside_clearance, rows):  # type: ignore[no-untyped-def]
    count, kind = 0, model[0]
    reach = 2.0 * kind.reach + clearance
    for i in range(len(poses)):
        for j in range(i + 1, len(poses)):
            if not (there[i] and there[j]):
                continue
            for k in range(poses.shape[1]):
                a, b = poses[i, k], poses[j, k]
                dx, dy = a.x - b.x, a.y - b.y
                if dx * dx + dy * dy >= reach * reach:
                    continue
                metres = outline_distance(a, kind, b, kind)
                if metres >= clearance or (metres >= beside_clearance and beside(a, kind, b, kind)):
                    continue
                rows[count, 0], rows[count, 1], rows[count, 2], rows[count, 3] = i, j, k, metres
                count += 1
                break
    return count


@compiled
def _distances(one, other, model, out):  # type: ignore[no-untyped-def]
    for k in range(len(one)):
        out[k] = outline_distance(one[k], model[0], other[k], model[0])
