"""Unions, intersections and differences of areas: fast where GEOS gets them right, on a grid where it does not.

Overlays on a grid never lose ground but take five times as long, and may fail on shapes that are not valid, as buffers
with sharp corners may be: they may cross themselves, and are repaired then. Without a grid GEOS may fail as well
(`subtract`, `intersect` and `unite` then use one), and it may lose area where edges nearly coincide, or take neighbours
for one another, for which functions of areas check every result.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats
from fields.geometry.arithmetic import EDGE_M, GRID_M, SLIVER_M2

ROUNDING_SHARE = 1e-7  # of an area: a smaller difference may be rounding
Areas = npt.NDArray[np.object_]


def extract_polygons(shape: shapely.Geometry) -> shapely.Geometry:
    """The polygons of a geometry, without lines and points left by cleaning or cutting."""
    parts = shapely.get_parts(shape)
    if shape.geom_type == "GeometryCollection":
        parts = shapely.get_parts(parts)
    return shapely.multipolygons(parts[shapely.area(parts) > 0.0])


def subtract(shapes: Any, others: Any) -> Any:
    """What of shapes, one or an array, lies outside others."""
    return _overlay(shapely.difference, shapes, others)


def intersect(shapes: Any, others: Any) -> Any:
    """What of shapes, one or an array, lies in others."""
    return _overlay(shapely.intersection, shapes, others)


def unite(shapes: Iterable[shapely.Geometry]) -> shapely.Geometry:
    """The union of shapes, areas or lines, each group of them that touch one another by itself."""
    parts = np.array([*shapes], dtype=np.object_)
    try:
        return shapely.disjoint_subset_union_all(parts)
    except shapely.errors.GEOSException:
        return unite_on_grid(parts)


def _overlay(cut: Callable[..., Any], *shapes: Any) -> Any:
    try:
        return cut(*shapes)
    except shapely.errors.GEOSException:
        return _overlay_on_grid(cut, *shapes)


def subtract_on_grid(shapes: Any, others: Any) -> Any:
    """What of shapes, one or an array, lies outside others; no ground is lost."""
    return _overlay_on_grid(shapely.difference, shapes, others)


def intersect_on_grid(shapes: Any, others: Any) -> Any:
    """What of shapes, one or an array, lies in others; no ground is lost."""
    return _overlay_on_grid(shapely.intersection, shapes, others)


def unite_on_grid(shapes: Iterable[shapely.Geometry]) -> shapely.Geometry:
    """The union of shapes, areas or lines; no ground is lost."""
    return _overlay_on_grid(shapely.union_all, np.array([*shapes], dtype=np.object_))


def _overlay_on_grid(cut: Callable[..., Any], *shapes: Any) -> Any:
    try:
        return cut(*shapes, grid_size=GRID_M)
    except shapely.errors.GEOSException:
        return cut(*map(_repair, shapes), grid_size=GRID_M)


def _repair(shapes: Any) -> Any:
    """Shapes, one or an array, made valid; of areas without the lines that narrow places become."""
    if isinstance(shapes, np.ndarray):
        return np.array([_repair(one) for one in shapes], dtype=np.object_)
    valid = shapely.make_valid(shapes, method="structure", keep_collapsed=False)
    return extract_polygons(valid) if shapely.get_dimensions(valid) == 2 else valid


def unite_areas(areas: Areas) -> shapely.Geometry:
    """The union of areas (n,), as polygons; slivers that cutting left are no ground."""
    parts = shapely.get_parts(areas)
    areas = parts[shapely.area(parts) > SLIVER_M2]
    union = extract_polygons(unite(areas))
    if _covers_all_areas(union, areas):
        return union
    return extract_polygons(unite_on_grid(_repair(areas)))


def _covers_all_areas(union: shapely.Geometry, areas: Areas) -> bool:
    """Whether every corner of every polygon, and a point inside each, lies in the union."""
    if not len(areas):
        return True
    shapely.prepare(union)
    corners = shapely.get_coordinates(areas)
    outside = corners[~shapely.intersects_xy(union, corners)]  # few, so few points must be created
    places = (shapely.points(outside), shapely.point_on_surface(areas))
    return bool(union.is_valid and all(shapely.dwithin(union, some, EDGE_M).all() for some in places))


def subtract_area(area: shapely.Geometry, part: shapely.Geometry) -> shapely.Geometry:
    """The part of an area outside another one, as polygons."""
    remainder = extract_polygons(subtract(area, part))
    # True only where the part lies wholly in the area.
    is_complete = abs(remainder.area + part.area - area.area) <= ROUNDING_SHARE * area.area
    return remainder if is_complete else _split_area(area, part)[1]


def clip_area(area: shapely.Geometry, part: shapely.Geometry) -> shapely.Geometry:
    """The part of an area inside another one, as polygons."""
    return _split_area(area, part)[0]


def clip_all_areas(areas: Areas, part: shapely.Geometry | Areas) -> Areas:
    """The parts of areas (n,) inside another one, or one each (n,), all in one go but for those that need a grid."""
    parts = np.broadcast_to(part, areas.shape)
    try:
        inside, outside = shapely.intersection(areas, parts), shapely.difference(areas, parts)
        is_wrong = ~_adds_up(areas, parts, inside, outside)
    except shapely.errors.GEOSException:
        inside, is_wrong = areas.copy(), np.ones(len(areas), dtype=bool)
    mixed = is_wrong | (shapely.get_type_id(inside) == shapely.GeometryType.GEOMETRYCOLLECTION)
    inside[mixed] = [clip_area(*one) for one in zip(areas[mixed], parts[mixed], strict=True)]
    return np.asarray(inside, dtype=np.object_)


def drop_slivers(parts: Areas, min_width_m: float) -> Areas:
    """The polygons without those that fit in a strip narrower than `min_width_m`, along a line to the farthest corner.

    Nothing of that width is lost with them. There are thousands between swaths, which would slow down overlays.
    """
    return parts[measure_widths_m(parts) >= min_width_m - GRID_M]


def measure_widths_m(parts: Areas) -> Floats:
    """How wide (n,) a strip each of the polygons fits in, along the line from a corner to the farthest one."""
    if not len(parts):
        return np.empty(0)
    points, owner = shapely.get_coordinates(shapely.get_exterior_ring(parts), return_index=True)
    first = np.searchsorted(owner, np.arange(len(parts)))
    off = points - points[first][owner]
    away = np.hypot(*off.T)
    farthest = np.lexsort((away, owner))[np.append(first[1:], len(points)) - 1]
    along = off[farthest] / np.maximum(away[farthest], GRID_M)[:, None]
    aside = along[owner, 0] * off[:, 1] - along[owner, 1] * off[:, 0]
    return np.asarray(np.maximum.reduceat(aside, first) - np.minimum.reduceat(aside, first), dtype=np.float64)


def _split_area(area: shapely.Geometry, part: shapely.Geometry) -> tuple[shapely.Geometry, shapely.Geometry]:
    """The parts of an area inside and outside another one; their areas add up."""
    inside, outside = extract_polygons(intersect(area, part)), extract_polygons(subtract(area, part))
    if _adds_up(area, part, inside, outside):
        return inside, outside
    valid = _repair(area), _repair(part)
    return extract_polygons(intersect_on_grid(*valid)), extract_polygons(subtract_on_grid(*valid))


def _adds_up(area: Any, part: Any, inside: Any, outside: Any) -> Any:
    """Whether what is inside and outside a part makes up the area, and what is inside lies in the part and the area."""
    is_lossless = abs(shapely.area(inside) + shapely.area(outside) - shapely.area(area)) <= (
        ROUNDING_SHARE * shapely.area(area)
    )
    place = shapely.point_on_surface(inside)
    lies_in_both = shapely.dwithin(place, part, EDGE_M) & shapely.dwithin(place, area, EDGE_M)
    return is_lossless & (shapely.is_empty(inside) | lies_in_both)
