"""Obstacles of a field file in local metres, their sizes checked."""

from __future__ import annotations

from typing import Any

import numpy as np
import shapely

from fields.document import Document, RawObstacle, RawPolygon
from fields.errors import FieldError
from fields.frame import Frame
from fields.obstacles import AREA, MOST_M, POINT, USUAL_RADIUS_M, USUAL_WIDTH_M, Obstacle
from fields.outline import polygon, position, rings
from fields.reading import brief


def read_obstacle(raw: RawObstacle, frame: Frame, label: str) -> Obstacle:
    """One obstacle; raises FieldError where its coordinates or its size cannot be used."""
    name = raw.keys[0] if raw.keys else ""
    kind = str(raw.properties.get("kind") or "").strip().lower()
    what = f"obstacle '{name or kind}' of {label}" if name or kind else f"an obstacle of {label}"
    if raw.form == AREA:
        parts = [frame.local(part) for part in rings(raw.coordinates, what)]
        return Obstacle(kind or "area", polygon(parts, what), name=name)
    if raw.form == POINT:
        place = frame.local(np.array([position(raw.coordinates, what)]))[0]
        return Obstacle(kind or "point", shapely.Point(place), _size(raw, "radius_m", kind, USUAL_RADIUS_M, what), name)
    line = raw.coordinates if isinstance(raw.coordinates, list) else []
    if len(line) < 2:
        raise FieldError(f"The line of {what} has {len(line)} positions; a LineString needs 2 or more.")
    points = frame.local(np.array([position(entry, what) for entry in line]))
    width_m = _size(raw, "width_m", kind, USUAL_WIDTH_M, what)
    return Obstacle(kind or "line", shapely.LineString(points), width_m / 2.0, name)


def _size(raw: RawObstacle, key: str, kind: str, usual: dict[str, float], what: str) -> float:
    """Radius or width of an obstacle: its own, else the usual one of its kind."""
    value = raw.properties.get(key)
    if value is None and kind in usual:
        return usual[kind]
    if value is None:
        raise FieldError(
            f"The {raw.form} of {what} has no '{key}'; give one, or a 'kind' that has a usual one: {', '.join(usual)}."
        )
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= MOST_M:
        raise FieldError(f"The '{key}' of {what} is {brief(value)}; it must be a number above 0, at most {MOST_M:g}.")
    return float(value)


def polygons_inside(document: Document, chosen: RawPolygon, frame: Frame, shape: shapely.Polygon) -> list[Obstacle]:
    """Other polygons of a file that lie wholly inside the chosen one: nobody works one field within another."""
    inside = []
    for raw in document.polygons:
        ring = None if raw is chosen else _outer(raw, frame, shape)
        if ring is not None and shapely.contains_properly(shape, ring):
            inside.append(Obstacle("area", ring, name=raw.keys[0] if raw.keys else ""))
    return inside


def _outer(raw: RawPolygon, frame: Frame, shape: shapely.Polygon) -> shapely.Polygon | None:
    """The outline of a polygon that may lie inside a shape; None where it does not, or is unusable."""
    try:
        first: Any = raw.coordinates[0][0]
        place = frame.local(np.array([position(first, "")]))[0]
        if not shapely.intersects_xy(shapely.box(*shape.bounds), *place):
            return None
        ring = shapely.Polygon(frame.local(rings(raw.coordinates, "")[0]))
    except (FieldError, TypeError, LookupError):
        return None
    return ring if ring.is_valid else None
