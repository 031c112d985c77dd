"""Types of arrays, and what is asked of arrays everywhere: spans of truth, distances along a polyline, directions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]
Records = npt.NDArray[Any]
"""Records of a dtype with fields."""

SHORTEST_PIECE_M = 0.05  # of a line: what is shorter is none, and points this close to a cut are left out
ANGLE_STEP_RAD, DIRECTION_STEP = math.pi / 2**40, 1.0 / 2**46
"""Processors differ in the last of 16 digits, and what is laid or measured by an angle would differ with it."""


def find_true_spans(flags: npt.ArrayLike) -> Integers:
    """First index and one past the last of every run of true in `flags` (n,): spans (k, 2)."""
    changes = np.diff(np.asarray(flags, dtype=np.bool_), prepend=False, append=False)
    return np.flatnonzero(changes).reshape(-1, 2)


def measure_along(points: Floats) -> Floats:
    """Distances (n,) along a polyline (n, 2) from its first point."""
    along, steps = np.zeros(len(points)), points[1:] - points[:-1]
    np.cumsum(np.hypot(steps[:, 0], steps[:, 1]), out=along[1:])
    return along


def locate_at(points: Floats, along: Floats, distances_m: Any) -> Floats:
    """Places (k, 2) on a polyline (n, 2) at distances along it (k,), given those of its points."""
    places = np.empty((np.size(distances_m), 2))
    for axis in (0, 1):
        places[:, axis] = np.interp(distances_m, along, points[:, axis])
    return places


def cut_line(points: Floats, first_m: float, last_m: float) -> Floats:
    """The part of a polyline (n, 2) between two distances along it."""
    along = measure_along(points)
    inner = points[(along > first_m + SHORTEST_PIECE_M) & (along < last_m - SHORTEST_PIECE_M)]
    ends = locate_at(points, along, (first_m, last_m))
    return np.concatenate([ends[:1], inner, ends[1:]])


def compute_angles(vectors: Floats) -> Floats:
    """Mathematical angles (n,) of vectors (n, 2), -pi to pi, the same on every processor."""
    angles: Floats = np.arctan2(vectors[:, 1], vectors[:, 0])
    return round_to_steps(angles, ANGLE_STEP_RAD)


def build_directions(angles: Floats | float) -> Floats:
    """Unit vectors (..., 2) along mathematical angles (...), the same on every processor."""
    return round_to_steps(np.stack([np.cos(angles), np.sin(angles)], axis=-1), DIRECTION_STEP)


def round_to_steps(values: Floats, step: float) -> Floats:
    """The nearest whole numbers of steps."""
    return np.rint(values / step) * step
