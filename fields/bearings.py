"""Directions worth trying for the tracks of a field."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely

FloatArray = npt.NDArray[np.float64]

SIMPLIFY_M = 1.0
MERGE_RAD = math.radians(1.0)
PARALLEL_RAD = 1e-6
TIE = 1e-9
"""Lengths and areas this close, relatively, count as equal."""
AT_ONCE = 1000
"""Edges compared with all others at a time, which bounds the memory."""
MOST = 24
"""Directions tried, or twice as many when their edges are equally long; a curve has one per vertex."""


def candidate_bearings(boundary: shapely.Polygon) -> list[float]:
    """Directions of the boundary edges and of the smallest rectangles around the field.

    Directions within one degree of a longer one are dropped, and only the longest survive. Equal lengths
    never push each other out, so that the set turns and mirrors with the field.

    Returns:
        mathematical angles in radians in [0, pi), the direction with the longest edge first.
    """
    angle, length = _edge_directions(boundary)
    alive = np.ones(len(angle), dtype=bool)
    chosen: list[int] = []
    for i in np.lexsort((angle, -length)).tolist():
        shorter = length < length[i] * (1.0 - TIE)
        if len(chosen) >= 2 * MOST or (len(chosen) >= MOST and length[i] < length[chosen[MOST - 1]] * (1.0 - TIE)):
            break
        if alive[i]:
            chosen.append(i)
            turn = _turn(angle, angle[i])
            alive &= ~((turn < PARALLEL_RAD) | ((turn < MERGE_RAD) & shorter))
    kept: list[float] = angle[chosen].tolist()
    return kept + [one for one in _rectangle_directions(boundary) if not _near(one, kept)]


def _edge_directions(boundary: shapely.Polygon) -> tuple[FloatArray, FloatArray]:
    """Angle in [0, pi) and length of the edges of the simplified boundary; parallel edges count together."""
    angles, lengths = [], []
    plain = boundary.simplify(SIMPLIFY_M)
    for loop in (plain.exterior, *plain.interiors):
        step = np.diff(np.asarray(loop.coords)[:, :2], axis=0)
        angles.append(np.arctan2(step[:, 1], step[:, 0]) % math.pi)
        lengths.append(np.hypot(step[:, 0], step[:, 1]))
    angle, length = np.concatenate(angles), np.concatenate(lengths)
    keep = length > 1e-9
    angle, length = angle[keep], length[keep]
    rows = (angle[start : start + AT_ONCE, None] for start in range(0, len(angle), AT_ONCE))
    together = [(_turn(some, angle[None, :]) < PARALLEL_RAD) @ length for some in rows]
    return angle, np.concatenate(together)


def _rectangle_directions(boundary: shapely.Polygon) -> list[float]:
    """Long sides of the rotated rectangles of least area; several when their areas are equal.

    One side of the smallest rectangle lies along an edge of the convex hull (Freeman and Shapira 1975).
    """
    hull = np.asarray(boundary.convex_hull.exterior.coords)[:, :2]
    step = np.diff(hull, axis=0)
    angle = np.arctan2(step[:, 1], step[:, 0]) % math.pi
    along = hull @ np.stack([np.cos(angle), np.sin(angle)])
    across = hull @ np.stack([-np.sin(angle), np.cos(angle)])
    size = np.stack([np.ptp(along, axis=0), np.ptp(across, axis=0)])
    area = size[0] * size[1]
    least = np.flatnonzero(area <= area.min() * (1.0 + TIE))[:MOST]
    quarter = np.where(size[0] >= size[1], 0.0, math.pi / 2)
    return sorted(((angle + quarter) % math.pi)[least].tolist())


def _near(angle: float, others: list[float]) -> bool:
    return any(_turn(angle, other) < PARALLEL_RAD for other in others)


def _turn(a: npt.ArrayLike, b: npt.ArrayLike) -> FloatArray:
    """Angle between two directions without sense, 0 to pi / 2."""
    gap: FloatArray = np.abs(np.asarray(a) - np.asarray(b)) % math.pi
    return np.asarray(np.minimum(gap, math.pi - gap))
