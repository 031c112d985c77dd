"""Outlines of more points than a field has corners, or that cross themselves, reduced to what a machine can follow.

A line within reach of the drawn one is kept on the safe side of it: the ground of a field shrinks, an obstacle grows.
"""

from __future__ import annotations

import numpy as np
import shapely

from fields.arrays import Floats
from fields.errors import FieldError
from fields.geometry.arithmetic import GRID_M, MACHINE_WIDTH_M, MITRE_LIMIT
from fields.geometry.overlays import subtract_on_grid, unite_on_grid

TURNING_CIRCLE_M = 12.0
"""Of a usual tractor; along shorter sides than this on average, headland passes wind and planning takes long."""
MAX_POINTS = 100
"""An outline of so many points is planned as it is drawn, however short its sides."""
TOLERANCES_M = (0.05, 0.1, 0.2, 0.4, 0.8)
"""The least is what guidance keeps to; the last is about half a machine, beyond which nothing can be smoothed."""
MAX_CHANGED_SHARE = 0.1
"""Of the area; an outline that changes by more describes another field."""


def clean_outline(
    rings: list[Floats], label: str, *, is_obstacle: bool = False
) -> tuple[shapely.Polygon, tuple[str, ...]] | None:
    """The polygon of an outer ring and its holes in metres, and a remark if it had to be cleaned.

    Rings with few enough points that do not cross themselves stay as they are. None if the rings make no valid polygon,
    as cleaning would change more than MAX_CHANGED_SHARE of the area.

    Raises FieldError where a field without crossings has so many spikes that cleaning would change more than that.
    """
    drawn = shapely.Polygon(rings[0], rings[1:])
    cleaned_rings = [_clean_ring(shapely.Polygon(ring), is_obstacle is (k == 0)) for k, ring in enumerate(rings)]
    (outer, *holes), tolerances_m = zip(*cleaned_rings, strict=True)
    cleaned = shapely.Polygon(outer.exterior, [*outer.interiors, *(hole.exterior for hole in holes)])
    if cleaned.equals_exact(drawn):
        return (drawn, ()) if drawn.is_valid else None
    if not cleaned.is_valid:
        cleaned = find_largest_polygon(subtract_on_grid(outer, unite_on_grid(holes)))
    valid = _repair(drawn)
    changed_m2, points = float(shapely.symmetric_difference(cleaned, valid).area), _count_points(drawn)
    if cleaned.is_empty or (changed_m2 > MAX_CHANGED_SHARE * valid.area and not (is_obstacle and drawn.is_valid)):
        if not drawn.is_valid:
            return None
        raise FieldError(
            f"The outline of {label} has {points} points, and without its spikes it would change by {changed_m2:.0f} "
            f"of {valid.area:.0f} m2; redraw it with fewer points."
        )
    tolerance_m, moved_m = max(TOLERANCES_M[0], *tolerances_m), _compute_distance_m(np.concatenate(rings), cleaned)
    remark = (
        f"The outline of {label} was cleaned to {100 * tolerance_m:.0f} cm: {_count_points(cleaned)} of its {points} "
        f"points remain, the farthest of the others is {moved_m:.2f} m from the new line, and the area changed by "
        f"{round(cleaned.area - valid.area) + 0.0:.0f} m2."
    )
    return cleaned, (remark,)


def _clean_ring(ring: shapely.Polygon, grow: bool) -> tuple[shapely.Polygon, float]:
    """A ring with few enough points, within the drawn one or, with `grow`, around it, and the tolerance it took."""
    shape = ring if ring.is_valid else find_largest_polygon(_repair(ring))
    if shape.is_empty:
        return ring, 0.0
    return (shape, 0.0) if _has_few_points(shape) else _simplify_ring(shape, grow)


def _repair(shape: shapely.Polygon) -> shapely.Geometry:
    return shape if shape.is_valid else shapely.make_valid(shape, method="structure", keep_collapsed=False)


def _simplify_ring(ring: shapely.Polygon, grow: bool) -> tuple[shapely.Polygon, float]:
    """The ring at the least tolerance that leaves few enough points, and that tolerance.

    Where the line is only dense, points are dropped. Where it is rough, ground is dropped that is too narrow for a
    machine, so that what remains is smooth.
    """
    cleaned = _simplify_on_one_side(ring, TOLERANCES_M[0] / 2.0, 0.0, grow)  # and moved by as much
    if _has_few_points(cleaned):
        return cleaned, TOLERANCES_M[0]
    reach_m = MACHINE_WIDTH_M / 2.0
    core = ring.simplify(TOLERANCES_M[0])
    for share in (0.125, 0.125, 0.25, 0.5):  # small steps first, as each leaves less for the next
        core = core.buffer(share * (reach_m if grow else -reach_m), quad_segs=4)
        core = find_largest_polygon(core).simplify(TOLERANCES_M[0] / 4.0)
    for tolerance_m in TOLERANCES_M:
        cleaned = _simplify_on_one_side(core, tolerance_m, reach_m, grow)
        if _has_few_points(cleaned, TURNING_CIRCLE_M):
            break
    return cleaned, tolerance_m


def _has_few_points(shape: shapely.Polygon, side_m: float = MACHINE_WIDTH_M) -> bool:
    return _count_points(shape) <= max(MAX_POINTS, float(shape.convex_hull.length) / side_m)


def _count_points(shape: shapely.Polygon) -> int:
    """The points of a polygon, those where its rings close counted once."""
    return int(shapely.get_num_coordinates(shape)) - 1 - len(shape.interiors)


def _simplify_on_one_side(core: shapely.Polygon, tolerance_m: float, reach_m: float, grow: bool) -> shapely.Polygon:
    """A core simplified, then moved back by what it was offset, less what simplifying moved it to the wrong side."""
    line = core.simplify(tolerance_m)
    if line.is_empty:
        return line
    back_m = reach_m - _compute_distance_m(shapely.get_coordinates(core), line)
    if abs(back_m) <= GRID_M:
        return line
    return find_largest_polygon(line.buffer(-back_m if grow else back_m, join_style="mitre", mitre_limit=MITRE_LIMIT))


def _compute_distance_m(points: Floats, shape: shapely.Polygon) -> float:
    """The distance of the farthest of the points, shape (n, 2), from the outline of a polygon."""
    corners, ring = shapely.get_coordinates(shapely.get_parts(shape.boundary), return_index=True)
    sides = shapely.linestrings(np.stack([corners[:-1], corners[1:]], axis=1)[ring[:-1] == ring[1:]])
    _, distances_m = shapely.STRtree(sides).query_nearest(shapely.points(points), return_distance=True)
    return float(distances_m.max())


def list_polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons among the parts of a geometry."""
    return [part for part in shapely.get_parts(shape).tolist() if isinstance(part, shapely.Polygon)]


def find_largest_polygon(shape: shapely.Geometry) -> shapely.Polygon:
    """The largest polygon among the parts of a geometry; empty without any."""
    return max(list_polygons(shape), key=lambda part: part.area, default=shapely.Polygon())
