"""What stands in a field: poles, ditches and ponds, and the ground that is left when a margin is kept to them."""

from __future__ import annotations

from dataclasses import dataclass

import shapely

from fields.errors import FieldError

POINT, LINE, AREA = "Point", "LineString", "Polygon"
USUAL_RADIUS_M = {"pole": 0.25, "post": 0.25, "mast": 1.0, "tree": 1.0, "manhole": 0.5, "well": 1.0}
USUAL_WIDTH_M = {"ditch": 1.5, "drain": 0.5, "fence": 0.2, "wall": 0.5, "hedge": 2.0, "pipe": 0.5}
"""What a pole or a ditch measures where its file does not say; assumed, meant to be rather too large."""
MOST_M = 1000.0
MITRE_LIMIT = 2.0
LEAST_LEFT = 0.5  # of the ground, where a wider distance is kept
GRID_M = 1e-6  # without a grid GEOS leaves slivers where edges all but coincide


@dataclass(frozen=True)
class Obstacle:
    """Something that nothing of a tractor or implement may touch.

    Attributes:
        kind: what it is in one word, such as ``"pole"``.
        geometry: Point, LineString or Polygon in metres, in the frame of the field.
        half_m: how far it reaches beyond the geometry: radius of a point, half the width of a line, 0 for a polygon.
        name: its name, possibly empty.

    Raises:
        FieldError: the geometry is another one, empty or crosses itself, or the size is out of range.
    """

    kind: str
    geometry: shapely.Geometry
    half_m: float = 0.0
    name: str = ""

    def __post_init__(self) -> None:
        form = self.geometry.geom_type
        if form not in (POINT, LINE, AREA):
            raise FieldError(f"{self} is a {form}; give a {POINT}, {LINE} or {AREA}.")
        if self.geometry.is_empty or not self.geometry.is_valid:
            raise FieldError(f"{self} is not a clean {form}; draw it anew.")
        least_m = 0.0 if form == AREA else 1e-3
        if not least_m <= self.half_m <= MOST_M:
            raise FieldError(f"{self} reaches {self.half_m:g} m beyond its {form}; use {least_m:g} to {MOST_M:g} m.")

    def __str__(self) -> str:
        return f"Obstacle '{self.name}' ({self.kind})" if self.name else f"An obstacle ({self.kind})"

    @property
    def shape(self) -> shapely.Geometry:
        """The ground it takes."""
        return self.widened(0.0)

    def widened(self, margin_m: float) -> shapely.Geometry:
        """The ground within a margin of it; corners are mitred, which keeps rather more."""
        return widened(self.geometry, self.half_m + margin_m)


def widened(geometry: shapely.Geometry, by_m: float) -> shapely.Geometry:
    """Everything within a distance of a geometry."""
    if geometry.geom_type == POINT:
        return geometry.buffer(by_m)
    return geometry.buffer(by_m, cap_style="square", join_style="mitre", mitre_limit=MITRE_LIMIT)


@dataclass(frozen=True)
class Ground:
    """What of a field may be worked.

    Attributes:
        boundary: the largest piece left by everything that interrupts tracks; empty where nothing is left.
        beyond: the same piece up to the margin, where the boundary is drawn in farther.
        small: what tracks are driven round, each apart, the margin included; it is not cut out of `boundary`.
        cut_off: the other pieces.
    """

    boundary: shapely.Polygon
    beyond: shapely.Polygon
    small: tuple[shapely.Polygon, ...]
    cut_off: tuple[shapely.Polygon, ...]


def ground_left(
    boundary: shapely.Polygon,
    obstacles: tuple[Obstacle, ...],
    margin_m: float,
    small_m: float = 0.0,
    swing_m: float = 0.0,
) -> Ground:
    """The ground that is left of a field when a margin is kept to its holes and obstacles.

    What is less than `small_m` across, and neither on the edge of the field nor within two margins of anything larger,
    is small. The boundary keeps `swing_m` more to what is not, unless too little were left of it.
    """
    outline = shapely.Polygon(boundary.exterior)
    bare = [(shapely.Polygon(hole), 0.0) for hole in boundary.interiors]
    bare += [(one.geometry, one.half_m) for one in obstacles]
    wide = [widened(geometry, half_m + margin_m) for geometry, half_m in bare]
    blocked = _polygons(shapely.union_all(wide, grid_size=GRID_M))
    small = [part for part in blocked if _is_small(part, outline, margin_m, small_m)]
    large = [part for part in blocked if not any(part is one for one in small)]
    parts = _polygons(shapely.difference(outline, shapely.union_all(large, grid_size=GRID_M), grid_size=GRID_M))
    if not parts:
        return Ground(shapely.Polygon(), shapely.Polygon(), (), ())
    largest = max(parts, key=lambda part: part.area)
    within = tuple(part for part in small if shapely.contains_properly(largest, part))
    cut_off = tuple(part for part in parts if part is not largest)
    inner = _farther(largest, large, swing_m) if swing_m else largest
    return Ground(inner, largest, within, cut_off)


def _farther(ground: shapely.Polygon, taken: list[shapely.Polygon], by_m: float) -> shapely.Polygon:
    """The largest piece of the ground farther than a distance from what is taken; all of it where little is left."""
    wide = shapely.union_all([widened(part, by_m) for part in taken], grid_size=GRID_M)
    parts = _polygons(shapely.difference(ground, wide, grid_size=GRID_M))
    largest = max(parts, key=lambda part: part.area, default=shapely.Polygon())
    return largest if largest.area >= LEAST_LEFT * ground.area else ground


def _is_small(part: shapely.Polygon, outline: shapely.Polygon, margin_m: float, small_m: float) -> bool:
    """Whether ground taken, its margin included, is less than `small_m` across without that, and clear of the edge."""
    across_m = 2.0 * shapely.minimum_bounding_radius(part) - 2.0 * margin_m
    return bool(round(across_m, 6) < small_m and shapely.contains_properly(outline, part))


def _polygons(shape: shapely.Geometry) -> list[shapely.Polygon]:
    """The polygons among the parts of a geometry."""
    return [part for part in shapely.get_parts(shape) if part.geom_type == AREA]
