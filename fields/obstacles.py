"""What stands in a field: poles, ditches and ponds, and the ground that is left when a margin is kept to them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import shapely

from fields.errors import FieldError

POINT, LINE, AREA = "Point", "LineString", "Polygon"
USUAL_RADIUS_M = {"pole": 0.25, "post": 0.25, "mast": 1.0, "tree": 1.0, "manhole": 0.5, "well": 1.0}
USUAL_WIDTH_M = {"ditch": 1.5, "drain": 0.5, "fence": 0.2, "wall": 0.5, "hedge": 2.0, "pipe": 0.5}
"""What a pole or a ditch measures where its file does not say; assumed, meant to be rather too large."""
MOST_M = 1000.0
MITRE_LIMIT = 2.0
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


def ground_left(
    boundary: shapely.Polygon, obstacles: tuple[Obstacle, ...], margin_m: float
) -> tuple[shapely.Polygon, float]:
    """The largest piece of a field when a margin is kept to its holes and obstacles; and the area of the others (m2).

    The polygon is empty where nothing is left.
    """
    holes = [widened(shapely.Polygon(hole), margin_m) for hole in boundary.interiors]
    blocked = shapely.union_all([*holes, *(one.widened(margin_m) for one in obstacles)], grid_size=GRID_M)
    rest = shapely.difference(shapely.Polygon(boundary.exterior), blocked, grid_size=GRID_M)
    parts = [part for part in shapely.get_parts(rest) if part.geom_type == AREA]
    if not parts:
        return shapely.Polygon(), 0.0
    largest = max(parts, key=lambda part: part.area)
    return largest, math.fsum(part.area for part in parts) - largest.area
