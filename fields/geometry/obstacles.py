"""Obstacles such as poles, ditches and ponds: read from field files, checked, cut out of the ground with a margin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from dataclasses import field as member

import shapely

from fields.errors import MAX_NAMED, FieldError, shorten_value
from fields.feature_words import find_name
from fields.geometry.arithmetic import MITRE_LIMIT
from fields.geometry.coordinates import FieldFrame, build_polygon, parse_rings
from fields.geometry.outline_cleaning import clean_outline, find_largest_polygon, list_polygons
from fields.geometry.overlays import subtract_on_grid, unite_on_grid
from fields.raw_document import RawShape
from fields.text_files import count_noun

POINT, LINE, AREA = "Point", "LineString", "Polygon"
DEFAULT_RADIUS_M = {"pole": 0.25, "post": 0.25, "mast": 1.0, "tree": 1.0, "manhole": 0.5, "well": 1.0}
DEFAULT_WIDTH_M = {"ditch": 1.5, "drain": 0.5, "fence": 0.2, "wall": 0.5, "hedge": 2.0, "pipe": 0.5}
"""Sizes of obstacles if their file gives none; assumed, rather too large than too small."""
MAX_OBSTACLE_M = 1000.0
MAX_BESIDE_M = 20.0  # machines that turn in the field do not reach obstacles farther away


@dataclass(frozen=True)
class Obstacle:
    """Something that no part of a tractor or implement may touch.

    Attributes:
        kind: one word such as ``"pole"``.
        geometry: Point, LineString or Polygon in metres, in the frame of the field.
        half_width_m: extent beyond the geometry: radius of a point, half the width of a line, 0 for a polygon.
        name: its name, possibly empty.
        is_assumed: its file does not say that it is an obstacle; ignored when obstacles are compared.
        number: by which it can be left out: its place among the obstacles of its file, from 1; None for others.
        remark: what was cleaned of its outline.

    Raises FieldError where the geometry has another type, is empty or crosses itself, or the size is out of range.
    """

    kind: str
    geometry: shapely.Geometry
    half_width_m: float = 0.0
    name: str = ""
    is_assumed: bool = member(default=False, compare=False)
    number: int | None = member(default=None, compare=False)
    remark: str = member(default="", compare=False)

    def __post_init__(self) -> None:
        geometry_type = self.geometry.geom_type
        if geometry_type not in (POINT, LINE, AREA):
            raise FieldError(f"{self} is a {geometry_type}; give a {POINT}, {LINE} or {AREA}.")
        if self.geometry.is_empty or not self.geometry.is_valid:
            raise FieldError(f"{self} is not a valid {geometry_type}; redraw it.")
        min_m = 0.0 if geometry_type == AREA else 1e-3
        if not min_m <= self.half_width_m <= MAX_OBSTACLE_M:
            raise FieldError(
                f"{self} extends {self.half_width_m:g} m beyond its {geometry_type}; use {min_m:g} to "
                f"{MAX_OBSTACLE_M:g} m."
            )

    def __str__(self) -> str:
        return f"Obstacle '{self.name}' ({self.kind})" if self.name else f"An obstacle ({self.kind})"

    @property
    def shape(self) -> shapely.Geometry:
        """The ground that it covers."""
        return self.buffer_by(0.0)

    def buffer_by(self, margin_m: float) -> shapely.Geometry:
        """The ground within a margin of it; corners are mitred, which is slightly more."""
        return buffer_geometry(self.geometry, self.half_width_m + margin_m)


def buffer_geometry(geometry: shapely.Geometry, distance_m: float) -> shapely.Geometry:
    """Everything within a distance of a geometry."""
    if geometry.geom_type == POINT:
        return geometry.buffer(distance_m)
    return geometry.buffer(distance_m, cap_style="square", join_style="mitre", mitre_limit=MITRE_LIMIT)


@dataclass(frozen=True)
class WorkableGround:
    """The ground of a field that may be worked.

    Attributes:
        boundary: the largest piece left by large obstacles; empty if nothing is left.
        margin_boundary: the same piece with the margin only, without the extra margin of `boundary`.
        small_obstacles: obstacles with their margins that swaths are driven round; not cut out of `boundary`.
        cut_off_parts: the other pieces.
    """

    boundary: shapely.Polygon
    margin_boundary: shapely.Polygon
    small_obstacles: tuple[shapely.Polygon, ...]
    cut_off_parts: tuple[shapely.Polygon, ...]


def compute_workable_ground(
    boundary: shapely.Polygon,
    obstacles: tuple[Obstacle, ...],
    margins_m: Sequence[float] = (),
    max_small_m: float = 0.0,
    extra_margin_m: float = 0.0,
) -> WorkableGround:
    """The ground of a field that remains with a margin round each of its holes and obstacles, in this order.

    Without margins they are 0. An obstacle is small if it is less than `max_small_m` across and neither on the edge of
    the field nor within two margins of a large one. The boundary keeps `extra_margin_m` more from large ones, unless
    too little would remain.
    """
    outline = shapely.Polygon(boundary.exterior)
    shapes = [(shapely.Polygon(hole), 0.0) for hole in boundary.interiors]
    shapes += [(one.geometry, one.half_width_m) for one in obstacles]
    margins_m = margins_m or [0.0] * len(shapes)
    buffered = [
        buffer_geometry(geometry, half_m + margin_m)
        for (geometry, half_m), margin_m in zip(shapes, margins_m, strict=True)
    ]
    blocked = list_polygons(unite_on_grid(buffered))
    tree = shapely.STRtree(buffered)
    part_margins_m = [max(margins_m[number] for number in tree.query(part, "intersects")) for part in blocked]
    small = [
        part
        for part, margin_m in zip(blocked, part_margins_m, strict=True)
        if round(2.0 * shapely.minimum_bounding_radius(part) - 2.0 * margin_m, 6) < max_small_m
        and shapely.contains_properly(outline, part)
    ]
    large = [part for part in blocked if not any(part is one for one in small)]
    parts = list_polygons(subtract_on_grid(outline, unite_on_grid(large)))
    if not parts:
        return WorkableGround(shapely.Polygon(), shapely.Polygon(), (), ())
    largest = max(parts, key=lambda part: part.area)
    small_inside = tuple(part for part in small if shapely.contains_properly(largest, part))
    cut_off_parts = tuple(part for part in parts if part is not largest)
    inner = _shrink_from_obstacles(largest, large, extra_margin_m) if extra_margin_m else largest
    return WorkableGround(inner, largest, small_inside, cut_off_parts)


def _shrink_from_obstacles(
    ground: shapely.Polygon, large_obstacles: list[shapely.Polygon], distance_m: float
) -> shapely.Polygon:
    """The largest piece of the ground beyond a distance from obstacles; all of it if less than half would remain."""
    buffered = unite_on_grid([buffer_geometry(part, distance_m) for part in large_obstacles])
    largest = find_largest_polygon(subtract_on_grid(ground, buffered))
    return largest if largest.area >= 0.5 * ground.area else ground


def parse_obstacle(raw: RawShape, frame: FieldFrame, label: str) -> Obstacle:
    """One obstacle; raises FieldError if its coordinates or its size cannot be used."""
    name = find_name(raw.properties) or (raw.keys[0] if raw.keys else "")
    kind = str(raw.properties.get("kind") or "").strip().lower()
    description = f"obstacle '{name or kind}' of {label}" if name or kind else f"an obstacle of {label}"
    if raw.geometry_type == AREA:
        parts = [frame.to_local(part) for part in parse_rings(raw.coordinates, description)]
        shape, remarks = clean_outline(parts, description, is_obstacle=True) or (build_polygon(parts, description), ())
        return Obstacle(kind or "area", shape, name=name, remark=" ".join(remarks))
    if raw.geometry_type == POINT:
        place = frame.read_points(raw, description)[0]
        radius_m = _parse_size_m(raw, "radius_m", kind, DEFAULT_RADIUS_M, description)
        return Obstacle(kind or "point", shapely.Point(place), radius_m, name)
    line = frame.read_points(raw, description)
    if len(line) < 2:
        raise FieldError(f"The line of {description} has {len(line)} positions; a LineString needs 2 or more.")
    width_m = _parse_size_m(raw, "width_m", kind, DEFAULT_WIDTH_M, description)
    return Obstacle(kind or "line", shapely.LineString(line), width_m / 2.0, name)


def _parse_size_m(raw: RawShape, key: str, kind: str, defaults_m: dict[str, float], description: str) -> float:
    """Radius or width of an obstacle: its own, else the default of its kind."""
    value = raw.properties.get(key)
    if value is None and kind in defaults_m:
        return defaults_m[kind]
    if value is None:
        raise FieldError(
            f"The {raw.geometry_type} of {description} has no '{key}'; give it, or a 'kind' with a default: "
            f"{', '.join(defaults_m)}."
        )
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value <= MAX_OBSTACLE_M:
        raise FieldError(
            f"The '{key}' of {description} is {shorten_value(value)}; it must be a number above 0, at most "
            f"{MAX_OBSTACLE_M:g}."
        )
    return float(value)


def select_obstacles(
    obstacles: Sequence[Obstacle], shape: shapely.Polygon, multiple_fields: bool, label: str
) -> tuple[tuple[Obstacle, ...], tuple[str, ...]]:
    """Obstacles in and close beside a field, and remarks on those outside.

    In a file of several fields, obstacles of other fields are only counted. Raises FieldError if all obstacles of a
    single field are away from it: then its coordinates or theirs are wrong.
    """
    outline = shapely.Polygon(shape.exterior)
    distances = [(obstacle, float(outline.distance(obstacle.shape))) for obstacle in obstacles]
    selected = tuple(obstacle for obstacle, away_m in distances if away_m <= MAX_BESIDE_M)
    far_away = [(str(obstacle), away_m) for obstacle, away_m in distances if away_m > MAX_BESIDE_M]
    close_beside = [str(obstacle) for obstacle, away_m in distances if 0.0 < away_m <= MAX_BESIDE_M]
    if multiple_fields:
        verb = "is" if len(far_away) == 1 else "are"
        skipped = f"{count_noun(len(far_away), 'obstacle')} of {label} {verb} away from this field and {verb} skipped."
        return selected, (skipped,) if far_away else ()
    if far_away and len(far_away) == len(distances):
        nearest_m = min(away_m for _, away_m in far_away)
        raise FieldError(
            f"{_join_names([name for name, _ in far_away])} of {label} {'lies' if len(far_away) == 1 else 'all lie'} "
            f"outside the field, {nearest_m:.0f} m away{'' if len(far_away) == 1 else ' or more'}; check the "
            "coordinates (easting or longitude first), or remove the role 'obstacle'."
        )
    remarks = []
    if far_away:
        is_single = len(far_away) == 1
        names = _join_names([f"{name}, {away_m:.0f} m away," if is_single else name for name, away_m in far_away])
        verbs = ("lies", "is") if is_single else ("lie", "are")
        remarks.append(f"{names} {verbs[0]} outside the field and {verbs[1]} skipped.")
    if close_beside:
        subject = f"{_join_names(close_beside)} {'stands' if len(close_beside) == 1 else 'stand'}"
        remarks.append(f"{subject} beside the field, not in it; machines that reach over the boundary keep clear.")
    return selected, tuple(remarks)


def _join_names(names: Sequence[str]) -> str:
    """The first few names, and how many more there are."""
    shown_names = [name if place == 0 else name[0].lower() + name[1:] for place, name in enumerate(names[:MAX_NAMED])]
    remainder = [f"{len(names) - MAX_NAMED} more"] if len(names) > MAX_NAMED else []
    parts = [*shown_names, *remainder]
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"
