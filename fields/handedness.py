"""Which hand an outline shows: choices made by it come out mirrored on a mirrored field, and turn and shift with it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

GAUSS = ((-math.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (math.sqrt(0.6), 5 / 18))  # exact for polynomials up to degree five
MARK_M = 10.0
EVEN = 1e-4  # of the fourth power of the outline's radius of gyration: what is nearer to 0 is symmetric


def handedness(rings: Sequence[FloatArray], marks: Sequence[tuple[float, float]] = ()) -> int:
    """1 or -1 for rings (n, 2) in metres, closed or not; the mirror image has the other one, 1 if they are symmetric.

    `marks` are places that count as MARK_M of outline each.

    Moments of the outline about its centroid in its principal axes, x'y'(x'^2 - y'^2) and, where that is even, those of
    third order, change their sign when it is mirrored and nothing when it is moved.
    """
    places = [_places(ring) for ring in rings]
    points = np.concatenate([one for one, _ in places] + [np.array(marks).reshape(-1, 2)])
    weights = np.concatenate([one for _, one in places] + [np.full(len(marks), MARK_M)])
    weights = weights / weights.sum()
    points = points - weights @ points
    _, axes = np.linalg.eigh((points * weights[:, None]).T @ points)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    across, along = (points @ axes / np.sqrt(weights @ (points**2).sum(axis=1))).T
    fourth = float(weights @ (across * along * (along**2 - across**2)))
    third = float(
        (weights @ along**3) * (weights @ (along**2 * across)) + (weights @ across**3) * (weights @ (across**2 * along))
    )
    return next((1 if one > 0.0 else -1 for one in (fourth, third) if abs(one) > EVEN), 1)


def _places(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points on the edges of a ring (3 n, 2) and how many metres each stands for (3 n,)."""
    ends = np.roll(ring, -1, axis=0)
    middle, half = 0.5 * (ring + ends), 0.5 * (ends - ring)
    length = np.hypot(*(ends - ring).T)
    points = np.concatenate([middle + at * half for at, _ in GAUSS])
    return points, np.concatenate([share * length for _, share in GAUSS])
