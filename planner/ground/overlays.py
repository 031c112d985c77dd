"""Unions and differences of swept ground: quick where GEOS keeps all of it, on a grid where it does not.

Overlays on a grid never lose ground, and take five times as long. Without one GEOS may lose area where edges all but
coincide; whether it did is looked at afterwards.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import shapely

GRID_M = 1e-6
NEAR_M = 1e-3  # corners of what is united lie in the union or so near to it
TINY_M = 1e-6
LOST = 1e-7  # of an area: so much may be rounding
Areas = npt.NDArray[np.object_]


def only_areas(shape: shapely.Geometry) -> shapely.Geometry:
    """The polygons of a geometry, without lines and points that cleaning or cutting has left in it."""
    parts = shapely.get_parts(shape)
    if shape.geom_type == "GeometryCollection":
        parts = shapely.get_parts(parts)
    return shapely.multipolygons(parts[shapely.area(parts) > 0.0])


def united(areas: Areas) -> shapely.Geometry:
    """The union of areas (n,), as polygons."""
    try:
        whole = only_areas(shapely.union_all(areas))
    except shapely.errors.GEOSException:
        return only_areas(shapely.union_all(shapely.make_valid(areas), grid_size=GRID_M))
    return whole if _holds(whole, areas) else only_areas(shapely.union_all(areas, grid_size=GRID_M))


def _holds(whole: shapely.Geometry, areas: Areas) -> bool:
    """Whether every corner of every area, and a place inside each, is in the whole."""
    areas = areas[shapely.area(areas) > 0.0]
    if not len(areas):
        return True
    shapely.prepare(whole)
    corners = shapely.get_coordinates(areas)
    outside = corners[~shapely.intersects_xy(whole, corners)]  # few: others need no point made
    places = (shapely.points(outside), shapely.point_on_surface(areas))
    return bool(whole.is_valid and all(shapely.dwithin(whole, some, NEAR_M).all() for some in places))


def left_of(whole: shapely.Geometry, part: shapely.Geometry) -> shapely.Geometry:
    """What of a geometry does not lie in another one, as polygons."""
    try:
        left = only_areas(shapely.difference(whole, part))
    except shapely.errors.GEOSException:
        return _split(whole, part)[1]
    kept = abs(left.area + part.area - whole.area) <= LOST * whole.area  # where all of the part lies in the whole
    return left if kept else _split(whole, part)[1]


def within(whole: shapely.Geometry, part: shapely.Geometry) -> shapely.Geometry:
    """What of a geometry lies in another one, as polygons."""
    return _split(whole, part)[0]


def without_slivers(parts: Areas, least_m: float) -> Areas:
    """The polygons without those in a strip narrower than `least_m` along the line from a corner to the farthest one.

    Nothing that wide is lost with them. Between swaths there are thousands, and buffers and overlays take their time.
    """
    if not len(parts):
        return parts
    points, owner = shapely.get_coordinates(shapely.get_exterior_ring(parts), return_index=True)
    first = np.searchsorted(owner, np.arange(len(parts)))
    off = points - points[first][owner]
    away = np.hypot(*off.T)
    farthest = np.lexsort((away, owner))[np.append(first[1:], len(points)) - 1]
    along = off[farthest] / np.maximum(away[farthest], TINY_M)[:, None]
    aside = along[owner, 0] * off[:, 1] - along[owner, 1] * off[:, 0]
    return parts[np.maximum.reduceat(aside, first) - np.minimum.reduceat(aside, first) >= least_m - TINY_M]


def _split(whole: shapely.Geometry, part: shapely.Geometry) -> tuple[shapely.Geometry, shapely.Geometry]:
    """A geometry as what lies in another one and what does not: together they measure what it does."""
    cut = shapely.intersection, shapely.difference
    try:
        inside, outside = (only_areas(one(whole, part)) for one in cut)
        if abs(inside.area + outside.area - whole.area) <= LOST * whole.area:
            return inside, outside
    except shapely.errors.GEOSException:  # where buffers have left edges that cross by a rounding
        whole, part = shapely.make_valid(whole), shapely.make_valid(part)
    inside, outside = (only_areas(one(whole, part, grid_size=GRID_M)) for one in cut)
    return inside, outside
