"""The parts of a field between which a machine cannot drive: divided by obstacles, or by necks narrower than it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import shapely
from shapely.geometry.polygon import orient

from fields.errors import FieldError, mark_parameter
from fields.geometry.arithmetic import CURVE_M, MITRE_LIMIT
from fields.geometry.field import Field
from fields.geometry.obstacles import compute_workable_ground
from fields.geometry.outline_cleaning import find_largest_polygon, list_polygons
from fields.geometry.overlays import intersect_on_grid, subtract_on_grid, unite_on_grid

MIN_PART_SHARE, MIN_PART_M2 = 0.01, 300.0  # smaller parts are not listed
LINK_REACH_M = 100.0  # from the shortest line between two parts to the middle of the neck


@dataclass(frozen=True, eq=False)
class Neck:
    """The narrowest place on the widest way between two parts: its width (m, 0 without a way) and where it is."""

    width_m: float
    x_m: float
    y_m: float


@dataclass(frozen=True, eq=False)
class FieldPart:
    """A part of a field: its number from 1, the largest first, its ground, and the neck to part 1, None for that."""

    number: int
    region: shapely.Polygon
    neck: Neck | None = None


def list_field_parts(field: Field, margin_m: float, width_m: float) -> tuple[FieldPart, ...]:
    """The parts of a field for machines of a width, with a margin to obstacles; only one if nothing divides it.

    A part is where the middle of a machine can be, and half its width around it. Small parts are left out.
    """
    boundary = field.whole_boundary
    margins_m = [margin_m] * (len(boundary.interiors) + len(field.obstacles))
    workable = compute_workable_ground(boundary, field.obstacles, margins_m)
    ground = unite_on_grid([workable.margin_boundary, *workable.cut_off_parts])
    half_m = 0.5 * width_m
    cores = list_polygons(_shrink(ground, half_m))
    grown = [core.buffer(half_m, join_style="mitre", mitre_limit=MITRE_LIMIT) for core in cores]
    pieces = [find_largest_polygon(intersect_on_grid(one, ground)) for one in grown]
    regions = [orient(piece, 1.0) for piece in pieces]
    least_m2 = max(MIN_PART_M2, MIN_PART_SHARE * field.area_m2)
    pairs = [(core, region) for core, region in zip(cores, regions, strict=True) if region.area >= least_m2]
    pairs.sort(key=lambda pair: (-round(pair[1].area, 3), pair[1].bounds))
    return tuple(
        FieldPart(number, region, None if number == 1 else find_neck(ground, pairs[0][0], core, half_m))
        for number, (core, region) in enumerate(pairs, start=1)
    )


def cut_field_part(field: Field, margin_m: float, width_m: float, number: int) -> Field:
    """The field reduced to one of its parts, without an entrance that is not on it.

    Raises FieldError if the field has no part of this number.
    """
    parts = list_field_parts(field, margin_m, width_m)
    if not 1 <= number <= len(parts):
        noun = "only one part" if len(parts) == 1 else f"{len(parts)} parts"
        raise FieldError(
            f"The field '{field.name}' has {noun} for machines {width_m:g} m wide, so there is no part "
            f"({mark_parameter('part')}) {number}; use 1 to {len(parts)}."
        )
    if len(parts) == 1:
        return field
    region = parts[number - 1].region
    is_reached = field.entrance is not None and region.dwithin(shapely.Point(field.entrance), 1.0)
    obstacles = tuple(one for one in field.obstacles if one.shape.dwithin(region, width_m))
    fences = tuple(
        part
        for fence in field.fences
        for part in shapely.get_parts(fence.intersection(region.buffer(margin_m + 1.0))).tolist()
        if isinstance(part, shapely.LineString) and part.length > 1.0
    )
    return replace(
        field,
        name=f"{field.name}, part {number}",
        boundary=region,
        entrance=field.entrance if is_reached else None,
        obstacles=obstacles,
        fences=fences,
    )


def find_neck(ground: shapely.Geometry, main_core: shapely.Polygon, core: shapely.Polygon, half_m: float) -> Neck:
    """The neck between two cores that lie apart in the ground shrunk by `half_m`, by bisecting how far it is shrunk."""
    ends = [shapely.point_on_surface(one) for one in (main_core, core)]
    low_m, high_m = 0.0, half_m
    if not _is_joined(ground, ends):
        nearest = shapely.shortest_line(*(_find_piece(list_polygons(ground), end) for end in ends))
        return Neck(0.0, *nearest.interpolate(0.5, normalized=True).coords[0])
    while high_m - low_m > 0.5 * CURVE_M:
        middle_m = 0.5 * (low_m + high_m)
        low_m, high_m = (middle_m, high_m) if _is_joined(_shrink(ground, middle_m), ends) else (low_m, middle_m)
    apart = _shrink(ground, high_m)
    link = subtract_on_grid(_shrink(ground, low_m), apart.buffer(2.0 * (high_m - low_m)))
    nearest = shapely.shortest_line(*(_find_piece(list_polygons(apart), end) for end in ends))
    links = [part for part in list_polygons(link) if part.dwithin(nearest, LINK_REACH_M)]
    place = nearest.interpolate(0.5, normalized=True)
    if links:
        place = shapely.point_on_surface(min(links, key=lambda part: part.distance(place)))
    return Neck(2.0 * low_m, place.x, place.y)


def _shrink(ground: shapely.Geometry, distance_m: float) -> shapely.Geometry:
    return ground.buffer(-distance_m, join_style="mitre", mitre_limit=MITRE_LIMIT)


def _find_piece(pieces: list[shapely.Polygon], place: shapely.Point) -> shapely.Polygon:
    """The piece that holds a place, or is nearest to it."""
    return min(pieces, key=lambda piece: piece.distance(place))


def _is_joined(ground: shapely.Geometry, ends: list[shapely.Point]) -> bool:
    """Whether two places lie in the same piece of the ground."""
    pieces = list_polygons(ground)
    return _find_piece(pieces, ends[0]) is _find_piece(pieces, ends[1])
