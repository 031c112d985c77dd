"""The field itself: boundary, obstacles, entrance and ground zones in a local metric frame."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from dataclasses import field as member
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from fields.errors import FieldError, named
from fields.fences import check_way_in
from fields.guidance import GuidanceLine
from fields.headlands import HeadlandEdge
from fields.obstacles import Ground, Obstacle, ground_left
from fields.outline import SMALLEST_M2
from fields.projection import project

FloatArray = npt.NDArray[np.float64]

LEAST_TOLD_M2 = 1.0
LEAST_KEPT = 0.1  # of the ground, or a margin is wider than the field
FENCE_M = 0.001  # half of what a fence itself takes
LEAST_FENCE_MARGIN_M = 0.2  # what guidance may err by: a smaller margin would be crossed
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
        boundary: counter-clockwise valid polygon, metres; its holes are obstacles. Those of ``obstacles`` are cut out
            of it by ``clear_of_obstacles``.
        crs: projected system the metres belong to, such as ``"EPSG:32654"``; None for local metres.
        origin_m: easting and northing (whole metres) that were subtracted from every coordinate.
        entrance: point where tractors enter, metres, or None.
        grounds: ground zones; where they overlap the first one counts.
        obstacles: what stands in or beside the field, holes of the boundary aside.
        small: what tracks are driven round, the margin included; in the boundary, but not in `ground`.
        fences: sides of the outline that nothing of a machine may cross, lines in metres.
        outline: the boundary before margins were kept and obstacles cut out of it; None where nothing was.
        beyond: the boundary where it is drawn in by no more than the margin; None where it is the same.
        cut_off: pieces that obstacles and the margin to them part from the boundary.
        default_ground: ground wherever no zone lies.
        lines: guidance lines that came with it.
        headlands: inner edges of headlands that came with it; plans have headlands of their own.
        refill: place where tanks are filled or emptied, metres, or None.
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
    obstacles: tuple[Obstacle, ...] = ()
    small: tuple[shapely.Polygon, ...] = ()
    fences: tuple[shapely.LineString, ...] = ()
    outline: shapely.Polygon | None = None
    beyond: shapely.Polygon | None = None
    refill: tuple[float, float] | None = None
    lines: tuple[GuidanceLine, ...] = ()
    headlands: tuple[HeadlandEdge, ...] = ()
    cut_off: tuple[shapely.Polygon, ...] = ()

    def __post_init__(self) -> None:
        label = f"field '{self.name}'"
        boundary, remark = _plain(_sound(self.boundary, label), label)
        object.__setattr__(self, "boundary", boundary)
        object.__setattr__(self, "remarks", (*self.remarks, *remark))

    @property
    def area_m2(self) -> float:
        """Area without the obstacles, square metres."""
        return float(self.whole.area)

    @property
    def area_ha(self) -> float:
        """Area without the obstacles, hectares."""
        return self.area_m2 / 10_000.0

    @cached_property
    def ground(self) -> shapely.Polygon:
        """What is to be worked: all up to the margin but what tracks are driven round."""
        if not self.small:
            return self.beyond or self.boundary
        return orient(shapely.difference(self.beyond or self.boundary, shapely.union_all(self.small)), 1.0)

    @cached_property
    def whole(self) -> shapely.Geometry:
        """The field without its obstacles, margins and what they cut off included: what shares are counted of."""
        if self.outline is None:
            return self.boundary
        return shapely.difference(shapely.Polygon(self.outline.exterior), shapely.union_all(self.solid))

    @cached_property
    def solid(self) -> tuple[shapely.Geometry, ...]:
        """The ground that holes of the outline and obstacles take themselves, without a margin."""
        holes = (self.outline or self.boundary).interiors
        return (*(shapely.Polygon(hole) for hole in holes), *(one.shape for one in self.obstacles))

    @property
    def cut_off_m2(self) -> float:
        """Area of what obstacles cut off, square metres."""
        return math.fsum(part.area for part in self.cut_off)

    @property
    def without_margin_m2(self) -> float:
        """What obstacles and fences themselves leave in one piece, square metres."""
        if self.outline is None:
            return float(self.boundary.area)
        return float(ground_left(self.outline, self._kept, 0.0).boundary.area)

    @property
    def _kept(self) -> tuple[Obstacle, ...]:
        """What a margin is kept to beside holes: obstacles, and fences as thin ones."""
        return (*self.obstacles, *(Obstacle("fence", line, FENCE_M) for line in self.fences))

    def clear_of_obstacles(self, margin_m: float, small_m: float = 0.0, swing_m: float = 0.0) -> Field:
        """The field whose boundary is the ground that may be worked: a margin is kept to obstacles, holes and fences.

        Those less than `small_m` across stay in the boundary and become `small`. The boundary keeps `swing_m` more to
        all others: so far more than half its width a machine reaches out of a bend. To fences LEAST_FENCE_MARGIN_M is
        kept in any case. Where obstacles cut the field in pieces the largest is kept, and a remark tells what the
        others measure.

        Raises:
            FieldError: the margin is out of range or wider than the field, too little ground is left, or a fence has
                no way in.
        """
        check_way_in(self.boundary, self.fences, self.entrance, self.name)
        _check_margin(margin_m, self)
        if not self.obstacles and not self.fences and not (self.boundary.interiors and (margin_m or small_m)):
            return self
        fence_m = max(FENCE_M, LEAST_FENCE_MARGIN_M - margin_m)
        kept = (*self.obstacles, *(Obstacle("fence", line, fence_m) for line in self.fences))
        left = ground_left(self.boundary, kept, margin_m, small_m, swing_m)
        if left.boundary.area < SMALLEST_M2:
            what = "Obstacles and fences" if self.fences else "Obstacles"
            raise FieldError(
                f"{what} with a margin ({named('margin_m')}) of {margin_m:g} m leave {left.boundary.area:.3g} m2 of "
                f"field '{self.name}' in one piece; a field needs at least {SMALLEST_M2:g} m2, so check the obstacles "
                "or use a smaller margin."
            )
        _check_left(left, margin_m, self)
        cut_off_m2 = math.fsum(part.area for part in left.cut_off)
        told = f"Obstacles cut off {cut_off_m2:.0f} m2 of the field, which are not worked."
        remarks = (*self.remarks, told) if cut_off_m2 >= LEAST_TOLD_M2 else self.remarks
        return replace(
            self,
            boundary=left.boundary,
            beyond=None if left.beyond is left.boundary else left.beyond,
            small=left.small,
            outline=self.outline or self.boundary,
            remarks=remarks,
            cut_off=left.cut_off if cut_off_m2 >= LEAST_TOLD_M2 else (),
        )

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


def _check_margin(margin_m: float, field: Field) -> None:
    """Refuse a margin that is none, or that no place of a field could keep even to a single post."""
    if not (math.isfinite(margin_m) and margin_m >= 0.0):
        raise FieldError(f"The margin ({named('margin_m')}) is {margin_m:g} m; it must be 0 or more.")
    if field.obstacles or field.fences:
        return  # told by what is left
    x, y = shapely.get_coordinates(shapely.minimum_rotated_rectangle(field.boundary))[:3].T
    across_m = float(np.hypot(np.diff(x), np.diff(y)).min())
    if margin_m >= across_m:
        raise FieldError(
            f"The margin ({named('margin_m')}) is {margin_m:g} m and field '{field.name}' {across_m:.0f} m across; use "
            "a smaller margin."
        )


def _check_left(left: Ground, margin_m: float, field: Field) -> None:
    """Refuse a margin that takes nearly all of what obstacles and fences themselves leave."""
    worked_m2 = left.beyond.area - math.fsum(part.area for part in left.small)
    if margin_m == 0.0 or worked_m2 >= LEAST_KEPT * field.boundary.area:
        return
    bare_m2 = replace(field, outline=field.boundary).without_margin_m2
    if worked_m2 < LEAST_KEPT * bare_m2:
        raise FieldError(
            f"The margin ({named('margin_m')}) of {margin_m:g} m is too wide for field '{field.name}': it leaves "
            f"{worked_m2:.0f} of {bare_m2:.0f} m2 in one piece; use a smaller margin."
        )


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
