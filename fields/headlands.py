"""Headlands that came with a field: inner edges of the ground for turning, and how far from the boundary they run."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import shapely

from fields.document import Document
from fields.errors import FieldError
from fields.frame import Frame
from fields.outline import position

APART_M = 5.0
"""So close are the points at which the width is taken."""
LEAST_M = 0.5
"""What runs nearer to the boundary is the boundary, written once more as the outer edge of the headland."""


@dataclass(frozen=True)
class HeadlandEdge:
    """The inner edge of a headland, in metres in the frame of the field, and its distance from the boundary or a hole.

    The width is that at the nearest place of it, in the middle (median), and at the farthest.
    """

    line: shapely.LineString
    least_m: float
    usual_m: float
    most_m: float


def headland_edges(document: Document, frame: Frame, shape: shapely.Polygon) -> tuple[HeadlandEdge, ...]:
    """Headland edges of a file that lie on this field, in its order; those that cannot be used are left out."""
    found = []
    for raw in document.headlands:
        try:
            points = frame.local(np.array([position(entry, "a headland") for entry in raw.coordinates]))
        except (FieldError, TypeError, ValueError):
            continue
        if len(points) < 3 or not np.ptp(points, axis=0).any():
            continue
        line = shapely.LineString(points)
        if not shape.contains(line.centroid) and not shape.intersects(line):
            continue
        places = shapely.points(shapely.get_coordinates(shapely.segmentize(line, APART_M)))
        away_m = shapely.distance(places, shape.boundary)
        if np.median(away_m) >= LEAST_M:
            found.append(HeadlandEdge(line, float(away_m.min()), float(np.median(away_m)), float(away_m.max())))
    return tuple(found)
