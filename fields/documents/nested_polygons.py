"""Polygons of a file that lie within another: ponds and woods of a field, its zones, or a second outline of it.

Plans treat the first as obstacles, and none is offered as a field of its own. Fields within the outline of a farm are.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import shapely

from fields.errors import FieldError
from fields.feature_words import NOTE, OBSTACLE, find_meaning, find_name
from fields.geometry.assumed_obstacles import MAX_UNKNOWN_FEATURES
from fields.geometry.coordinates import FieldFrame, parse_position, parse_rings
from fields.geometry.obstacles import Obstacle
from fields.geometry.outline_cleaning import clean_outline
from fields.raw_document import FieldDocument, RawShape

MAX_INSIDE_SHARE = 0.5
"""Of the area of a field: polygons within it that cover more are no obstacles, nor are too many without names."""


def select_inside_obstacles(
    inside: Sequence[tuple[RawShape, shapely.Polygon, str]], shape: shapely.Polygon, ignore: Callable[[str, str], None]
) -> list[Obstacle]:
    """Polygons within a field that are obstacles; `ignore` is told the reason and name of the others."""
    are_obstacles = _judge_inside_polygons([(raw, ring.area / shape.area) for raw, ring, _ in inside])
    obstacles = []
    for (raw, ring, remark), is_obstacle in zip(inside, are_obstacles, strict=True):
        name = find_name(raw.properties) or (raw.keys[0] if raw.keys else "")
        if is_obstacle:
            kind = find_meaning(raw.properties).kind or "area"
            obstacles.append(Obstacle(kind, ring, name=name, is_assumed=True, remark=remark))
        else:
            ignore("inner outline or zone", f"'{name}'" if name else "a Polygon")
    return obstacles


def _judge_inside_polygons(inside: Sequence[tuple[RawShape, float]]) -> list[bool]:
    """For each polygon within a field, with its share of the area, whether it is an obstacle."""
    uses = [find_meaning(raw.properties).use for raw, _ in inside]
    unknown_shares = [share for (_, share), use in zip(inside, uses, strict=True) if use not in (OBSTACLE, NOTE)]
    are_few = len(unknown_shares) <= MAX_UNKNOWN_FEATURES and math.fsum(unknown_shares) <= MAX_INSIDE_SHARE
    return [
        share <= MAX_INSIDE_SHARE and (use == OBSTACLE or (use != NOTE and are_few))
        for (_, share), use in zip(inside, uses, strict=True)
    ]


def find_parent_polygons(polygons: Sequence[RawShape]) -> dict[int, int]:
    """For polygons that are no fields, as they lie within another, the position of the field.

    Compared in the coordinates of the file; polygons that cannot be used lie nowhere.
    """
    if len(polygons) < 2:
        return {}
    shapes = np.array([_build_plane_polygon(raw) for raw in polygons], dtype=object)
    areas = shapely.area(shapes)
    tree = shapely.STRtree(shapes)
    outer, inner = tree.query(shapes, "contains_properly")
    parents: dict[int, int] = {}
    for parent in sorted(set(outer.tolist()), key=lambda one: -areas[one]):
        if parent in parents:
            continue
        children = inner[outer == parent].tolist()
        shares = [float(areas[child] / areas[parent]) for child in children]
        are_obstacles = _judge_inside_polygons([(polygons[c], s) for c, s in zip(children, shares, strict=True)])
        for child, share, is_obstacle in zip(children, shares, are_obstacles, strict=True):
            if is_obstacle or share > MAX_INSIDE_SHARE or find_meaning(polygons[child].properties).use == NOTE:
                parents.setdefault(child, parent)
    return parents


def _build_plane_polygon(raw: RawShape) -> shapely.Geometry:
    """A polygon in the coordinates of the file, empty if they cannot be used."""
    try:
        rings = [np.array(ring, dtype=np.float64)[:, :2] for ring in raw.coordinates]
        shape = shapely.Polygon(rings[0], rings[1:])
    except (TypeError, ValueError, LookupError, OverflowError, shapely.errors.GEOSException):
        return shapely.Polygon()
    return shape if shape.is_valid else shapely.make_valid(shape, method="structure", keep_collapsed=False)


def find_inside_polygons(
    document: FieldDocument, chosen: RawShape, frame: FieldFrame, shape: shapely.Polygon
) -> list[tuple[RawShape, shapely.Polygon, str]]:
    """Other polygons of a file within the chosen one, their outlines in local metres, and what was cleaned of these."""
    inside = []
    for raw in document.polygons:
        cleaned = None if raw is chosen else _parse_outer_ring(raw, frame, shape)
        if cleaned is not None and shapely.contains_properly(shape, cleaned[0]):
            inside.append((raw, cleaned[0], " ".join(cleaned[1])))
    return inside


def _parse_outer_ring(
    raw: RawShape, frame: FieldFrame, shape: shapely.Polygon
) -> tuple[shapely.Polygon, tuple[str, ...]] | None:
    """The cleaned outline of a polygon that may be inside a shape; None if it is not, or not usable."""
    try:
        first: Any = raw.coordinates[0][0]
        place = frame.to_local(np.array([parse_position(first, "")]))[0]
        if not shapely.intersects_xy(shapely.box(*shape.bounds), *place):
            return None
        points = frame.to_local(parse_rings(raw.coordinates, "")[0])
    except (FieldError, TypeError, LookupError):
        return None
    return clean_outline([points], f"obstacle '{raw.key}'", is_obstacle=True)
