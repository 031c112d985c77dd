"""Which hand an outline shows, and which way it points along a line.

Choices made by these come out mirrored on a mirrored field, and turn and shift with it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

GAUSS = ((-math.sqrt(0.6), 5 / 18), (0.0, 8 / 18), (math.sqrt(0.6), 5 / 18))  # exact for polynomials up to degree five
MARK_M = 10.0
EVEN = 1e-6  # in radii of gyration: what is nearer to 0 is symmetric but for rounding; a small hole tells little more


def handedness(rings: Sequence[FloatArray], marks: Sequence[tuple[float, float]] = ()) -> int:
    """1 or -1 for rings (n, 2) in metres, closed or not; the mirror image has the other one, 1 if they are symmetric.

    `marks` are places that count as MARK_M of outline each.

    Moments of the outline about its centroid in its principal axes, x'y'(x'^2 - y'^2) and, where that is even, those of
    third order, change their sign when it is mirrored and nothing when it is moved.
    """
    points, weights = _weighed(rings, marks)
    _, axes = np.linalg.eigh((points * weights[:, None]).T @ points)
    if np.linalg.det(axes) < 0.0:
        axes[:, 0] = -axes[:, 0]
    across, along = (points @ axes).T
    fourth = float(weights @ (across * along * (along**2 - across**2)))
    third = float(
        (weights @ along**3) * (weights @ (along**2 * across)) + (weights @ across**3) * (weights @ (across**2 * along))
    )
    return next((1 if one > 0.0 else -1 for one in (fourth, third) if abs(one) > EVEN), 1)


def onward(bearing_rad: float, rings: Sequence[FloatArray], marks: Sequence[tuple[float, float]] = ()) -> float:
    """A direction (radians), or the one against it, in (-pi, pi]: the way in which rings (n, 2) reach out farther.

    Where they reach as far both ways, the one with that on its left to which they reach out farther; the one given
    where that is even too, as then the rings look the same from either end. `marks` are as in `handedness`.
    """
    points, weights = _weighed(rings, marks)
    cosine, sine = math.cos(bearing_rad), math.sin(bearing_rad)
    along, across = points @ (cosine, sine), points @ (-sine, cosine)
    tells = float(weights @ along**3), float(weights @ across**3)
    if next((one for one in tells if abs(one) > EVEN), 1.0) > 0.0:
        return bearing_rad
    return bearing_rad + math.pi if bearing_rad <= 0.0 else bearing_rad - math.pi


def _weighed(rings: Sequence[FloatArray], marks: Sequence[tuple[float, float]]) -> tuple[FloatArray, FloatArray]:
    """Points on rings and marks about their centroid, in radii of gyration (n, 2), and their shares (n,)."""
    places = [_places(ring) for ring in rings]
    points = np.concatenate([one for one, _ in places] + [np.array(marks).reshape(-1, 2)])
    weights = np.concatenate([one for _, one in places] + [np.full(len(marks), MARK_M)])
    weights = weights / weights.sum()
    points = points - weights @ points
    return points / np.sqrt(weights @ (points**2).sum(axis=1)), weights


def _places(ring: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Points on the edges of a ring (3 n, 2) and how many metres each stands for (3 n,)."""
    ends = np.roll(ring, -1, axis=0)
    middle, half = 0.5 * (ring + ends), 0.5 * (ends - ring)
    length = np.hypot(*(ends - ring).T)
    points = np.concatenate([middle + at * half for at, _ in GAUSS])
    return points, np.concatenate([share * length for _, share in GAUSS])
