"""The field itself: boundary, obstacles, entrance and ground zones in a local metric frame."""

from __future__ import annotations

from dataclasses import dataclass
from dataclasses import field as member

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from fields.errors import FieldError
from fields.projection import project

FloatArray = npt.NDArray[np.float64]

USUAL_POINTS, MOST_POINTS = 2_000, 5_000
FINEST_M, COARSEST_M = 0.01, 0.16
"""A centimetre is less than any receiver tells; at 16 cm an outline still is that of the same field."""


@dataclass(frozen=True)
class GroundZone:
    """A part of the surroundings with a ground of its own.

    Attributes:
        name: ground name, for example ``"soil"`` or ``"asphalt"``.
        polygon: extent in metres, in the frame of the field.
    """

    name: str
    polygon: shapely.Polygon

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise FieldError("A ground zone has an empty name; give it a ground such as 'asphalt'.")
        object.__setattr__(self, "polygon", _sound(self.polygon, f"ground zone '{self.name}'"))


@dataclass(frozen=True)
class Field:
    """A field in metres, x east and y north.

    Attributes:
        name: name of the field.
        boundary: counter-clockwise valid polygon, metres; its holes are obstacles.
        crs: projected system the metres belong to, such as ``"EPSG:32654"``; None for local metres.
        origin_m: easting and northing (whole metres) that were subtracted from every coordinate.
        entrance: point where tractors enter, metres, or None.
        grounds: ground zones; where they overlap the first one counts.
        default_ground: ground wherever no zone lies.
        source: where the boundary comes from, in words.
        remarks: sentences on what was read otherwise than a person might expect; equal fields may differ in them.

    A boundary of more than USUAL_POINTS points is simplified to FINEST_M, one of more than MOST_POINTS further, up to
    COARSEST_M; a remark says so.

    Raises:
        FieldError: the boundary is empty, not a polygon, crosses itself or has too many points even so.
    """

    name: str
    boundary: shapely.Polygon
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    entrance: tuple[float, float] | None = None
    grounds: tuple[GroundZone, ...] = ()
    default_ground: str = "soil"
    source: str = ""
    remarks: tuple[str, ...] = member(default=(), compare=False)

    def __post_init__(self) -> None:
        label = f"field '{self.name}'"
        boundary, remark = _plain(_sound(self.boundary, label), label)
        object.__setattr__(self, "boundary", boundary)
        object.__setattr__(self, "remarks", (*self.remarks, *remark))

    @property
    def area_m2(self) -> float:
        """Area without the obstacles, square metres."""
        return float(self.boundary.area)

    @property
    def area_ha(self) -> float:
        """Area without the obstacles, hectares."""
        return self.area_m2 / 10_000.0

    def ground_at(self, x: float, y: float) -> str:
        """Name of the ground under the point (x, y) in metres; an edge belongs to its zone."""
        for zone in self.grounds:
            if shapely.intersects_xy(zone.polygon, x, y):
                return zone.name
        return self.default_ground

    def to_wgs84(self, xy: npt.ArrayLike) -> FloatArray:
        """Longitude and latitude in degrees, shape (n, 2), of local points in metres, shape (n, 2).

        Raises:
            FieldError: the field has no place on the earth (``crs`` is None) or the shape is wrong.
        """
        if self.crs is None:
            raise FieldError(
                f"Field '{self.name}' is in local metres without a place on the earth; "
                "use a boundary in longitude and latitude to get positions."
            )
        points = np.asarray(xy, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise FieldError(f"Points of shape {points.shape} are not pairs; pass an array of shape (n, 2).")
        return project(points + np.asarray(self.origin_m), self.crs, "EPSG:4326")


def _plain(polygon: shapely.Polygon, label: str) -> tuple[shapely.Polygon, tuple[str, ...]]:
    """An outline that can be worked with in reasonable time, and what there is to say about it."""
    points = shapely.get_num_coordinates(polygon)
    if points <= USUAL_POINTS:
        return polygon, ()
    tolerance, plain = FINEST_M, polygon.simplify(FINEST_M)
    while shapely.get_num_coordinates(plain) > MOST_POINTS and tolerance < COARSEST_M:
        tolerance *= 2.0
        plain = polygon.simplify(tolerance)
    left = shapely.get_num_coordinates(plain)
    if left > MOST_POINTS:
        raise FieldError(
            f"The outline of {label} has {left} points even when it is simplified to {100 * tolerance:.0f} cm; a field "
            f"may have {MOST_POINTS}, so simplify it first."
        )
    if left == points:
        return polygon, ()
    told = f"The outline of {label} was simplified to {100 * tolerance:.0f} cm: {left} of its {points} points are left."
    return orient(plain, 1.0), (told,)


def _sound(polygon: shapely.Polygon, label: str) -> shapely.Polygon:
    """The polygon counter-clockwise, or a refusal when it is not a valid polygon."""
    if not isinstance(polygon, shapely.Polygon):
        raise FieldError(f"The outline of {label} is a {type(polygon).__name__}; give one shapely Polygon.")
    if polygon.is_empty or not polygon.is_valid:
        reason = "it is empty" if polygon.is_empty else shapely.is_valid_reason(polygon)
        raise FieldError(f"The outline of {label} is not a valid polygon ({reason}); redraw it there.")
    return orient(polygon, 1.0)
