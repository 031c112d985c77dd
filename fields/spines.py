"""A line down the middle of a narrow strip."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import shapely

FloatArray = npt.NDArray[np.float64]

SHORTEST = 2.0  # widths
STEP = 1.0  # widths between places where the middle is taken
SMOOTH = 0.1  # of the width: so far the line may leave the middle


def spine(strip: shapely.Polygon, width_m: float) -> FloatArray | None:
    """The middle of a strip narrower than the width, from end to end, shape (n, 2); None where it is too short.

    The strip is cut square to its longer axis, and the line runs through the middles of the cuts.
    """
    corner, along, length, across = _frame(strip)
    if length < SHORTEST * width_m:
        return None
    pieces = max(2, math.ceil(length / (STEP * width_m)))
    aside = np.array([-along[1], along[0]])
    at = np.clip(np.linspace(0.0, length, pieces + 1), 0.01 * length, 0.99 * length)
    foot = corner + at[:, None] * along
    cuts = shapely.linestrings(np.stack([foot - aside, foot + (across + 1.0) * aside], axis=1))
    middles = shapely.centroid(shapely.intersection(strip, cuts))
    points = shapely.get_coordinates(middles[~shapely.is_empty(middles)])
    if len(points) < 2:
        return None
    return np.asarray(shapely.LineString(points).simplify(SMOOTH * width_m).coords)[:, :2]


def _frame(strip: shapely.Polygon) -> tuple[FloatArray, FloatArray, float, float]:
    """A corner of the smallest rectangle about the strip, the direction of its long side, and both its sides (m)."""
    box = np.asarray(shapely.minimum_rotated_rectangle(strip).exterior.coords)[:, :2]
    if shapely.LinearRing(box).is_ccw is False:
        box = box[::-1]
    first, second = math.dist(box[0], box[1]), math.dist(box[1], box[2])
    if first < second:
        box, first, second = np.roll(box[:-1], -1, axis=0), second, first
    return box[0], (box[1] - box[0]) / first, first, second
