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
