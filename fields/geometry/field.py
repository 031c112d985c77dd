"""The field itself: boundary, obstacles, entrance and ground zones in a local metric frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from dataclasses import field as member
from functools import cached_property

import numpy as np
import numpy.typing as npt
import shapely
from shapely.geometry.polygon import orient

from fields.arrays import Floats
from fields.errors import FieldError, mark_parameter
from fields.geometry.arithmetic import EDGE_M
from fields.geometry.coordinates import MIN_FIELD_AREA_M2
from fields.geometry.field_lines import (
    MAX_OVERHANG_M,
    EdgeOverhang,
    GuidanceLine,
    HeadlandEdge,
    check_fence_opening,
    compute_overhang_region,
)
from fields.geometry.geodesy import DEGREES_CRS, project
from fields.geometry.obstacles import Obstacle, WorkableGround, compute_workable_ground
from fields.geometry.overlays import subtract, subtract_area, unite

MIN_REPORTED_M2 = 1.0
HOLE_NAME = "a hole of the field"
MIN_WORKED_SHARE = 0.1  # of the ground; with less, the margin is too wide for the field
FENCED_CAUSES = "Obstacles and fences"
SMALLER_MARGIN_SHARES = (0.5, 0.25, 0.1, 0.0)  # of a margin that is too wide, tried for advice
MIN_FENCE_MARGIN_M = 0.2  # error of the guidance, so that fences are never touched


@dataclass(frozen=True)
class GroundZone:
    """An area with a ground of its own.

    Attributes:
        name: ground name, for example ``"soil"`` or ``"asphalt"``.
        polygon: extent in metres, in the frame of the field.
    """

    name: str
    polygon: shapely.Polygon

    def __post_init__(self) -> None:
        if not self.name.strip():
            raise FieldError("A ground zone has an empty name; give it a ground such as 'asphalt'.")
        object.__setattr__(self, "polygon", _check_polygon(self.polygon, f"ground zone '{self.name}'"))


@dataclass(frozen=True)
class Field:
    """A field in metres, x east and y north.

    Attributes:
        name: name of the field.
        boundary: counter-clockwise valid polygon, metres; its holes are obstacles. ``compute_ground_with_margin`` cuts
            ``obstacles`` out of it.
        crs: projected system of the metres, such as ``"EPSG:32654"``; None for local metres.
        origin_m: easting and northing (whole metres) that were subtracted from every coordinate.
        entrance: point where tractors enter, metres, or None.
        ground_zones: where zones overlap, the first one counts.
        default_ground: ground outside all zones.
        source: where the boundary comes from, in words.
        remarks: sentences on unexpected content of the file; ignored when fields are compared.
        obstacles: obstacles in or beside the field, without the holes of the boundary.
        small_obstacles: obstacles with their margin that swaths are driven round; within `boundary`, but not part of
            `workable_region`.
        fences: sides of the outline that no part of a machine may cross, lines in metres.
        edge_overhangs: parts of the outline over which machines may reach farther, or less far, than over the rest.
        original_boundary: the boundary before `compute_ground_with_margin`; None if nothing was subtracted.
        margin_boundary: the boundary with the margin only, without extra distance; None if it is the same.
        service_point: place where tanks are filled or emptied, metres, or None.
        guidance_lines: lines from the field file.
        headland_edges: inner edges of headlands from the field file; plans lay their own headlands.
        cut_off_parts: pieces that obstacles and their margins separate from the boundary, without what is done.
        elevation: path of the file with heights that the field file names, or None.
        done: ground that is worked already; None where nothing is.

    Raises FieldError where the boundary is empty, not a polygon or crosses itself.
    """

    name: str
    boundary: shapely.Polygon
    crs: str | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)
    entrance: tuple[float, float] | None = None
    ground_zones: tuple[GroundZone, ...] = ()
    default_ground: str = "soil"
    source: str = ""
    remarks: tuple[str, ...] = member(default=(), compare=False)
    obstacles: tuple[Obstacle, ...] = ()
    small_obstacles: tuple[shapely.Polygon, ...] = ()
    fences: tuple[shapely.LineString, ...] = ()
    edge_overhangs: tuple[EdgeOverhang, ...] = ()
    original_boundary: shapely.Polygon | None = None
    margin_boundary: shapely.Polygon | None = None
    service_point: tuple[float, float] | None = None
    guidance_lines: tuple[GuidanceLine, ...] = ()
    headland_edges: tuple[HeadlandEdge, ...] = ()
    cut_off_parts: tuple[shapely.Polygon, ...] = ()
    elevation: str | None = None
    done: shapely.Geometry | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "boundary", _check_polygon(self.boundary, f"field '{self.name}'"))

    @property
    def area_m2(self) -> float:
        """Area without the obstacles and what is done, square metres."""
        return float(self.due_region.area)

    @property
    def area_ha(self) -> float:
        """Area without the obstacles and what is done, hectares."""
        return self.area_m2 / 10_000.0

    @cached_property
    def workable_region(self) -> shapely.Polygon:
        """The ground to be worked: everything up to the margin except small obstacles."""
        if not self.small_obstacles:
            return self.margin_boundary or self.boundary
        return orient(subtract(self.margin_boundary or self.boundary, unite(self.small_obstacles)), 1.0)

    @cached_property
    def region_without_obstacles(self) -> shapely.Geometry:
        """The field without its obstacles, but with margins and cut-off parts: the reference for shares of area."""
        if self.original_boundary is None:
            return self.boundary
        return subtract(shapely.Polygon(self.original_boundary.exterior), unite(self.solid_obstacles))

    @cached_property
    def due_region(self) -> shapely.Geometry:
        """The field without its obstacles and without the ground that is done: what a plan is to work."""
        whole = self.region_without_obstacles
        return whole if self.done is None else subtract_area(whole, self.done)

    @property
    def whole_boundary(self) -> shapely.Polygon:
        """The boundary as it was drawn, before margins, obstacles and parts cut off were subtracted."""
        return self.original_boundary or self.boundary

    @cached_property
    def solid_obstacles(self) -> tuple[shapely.Geometry, ...]:
        """The ground under obstacles and holes of the outline, without a margin."""
        holes = self.whole_boundary.interiors
        return (*(shapely.Polygon(hole) for hole in holes), *(one.shape for one in self.obstacles))

    def compute_overhang_region(self, overhang_m: float) -> shapely.Geometry:
        """The ground over which parts of machines may reach: `overhang_m` beyond open edges, or what they allow."""
        outline = self.whole_boundary
        return compute_overhang_region(outline, self.fences, self.edge_overhangs, overhang_m)

    def open_edges(self) -> Field:
        """The field with MAX_OVERHANG_M, farther than machines reach, over edges without an overhang of their own."""
        outline = shapely.LineString(self.whole_boundary.exterior.coords)
        everywhere = EdgeOverhang(outline, MAX_OVERHANG_M)
        is_open = everywhere in self.edge_overhangs
        return self if is_open else replace(self, edge_overhangs=(everywhere, *self.edge_overhangs))

    @property
    def obstacle_names(self) -> tuple[str, ...]:
        """What sentences call the solid obstacles."""
        names = [str(one)[0].lower() + str(one)[1:] for one in self.obstacles]
        return (*[HOLE_NAME] * (len(self.solid_obstacles) - len(names)), *names)

    @property
    def cut_off_m2(self) -> float:
        """Area of the parts that obstacles cut off, square metres."""
        return math.fsum(part.area for part in self.cut_off_parts)

    @property
    def area_without_margin_m2(self) -> float:
        """Largest connected area without obstacles and fences, margin 0, square metres."""
        if self.original_boundary is None:
            return float(self.boundary.area)
        return float(compute_workable_ground(self.original_boundary, self._list_margin_obstacles()).boundary.area)

    def _list_margin_obstacles(self, fence_m: float = EDGE_M) -> tuple[Obstacle, ...]:
        """What a margin is kept to, besides holes: obstacles, and fences as obstacles that reach so far."""
        return (*self.obstacles, *(Obstacle("fence", line, fence_m) for line in self.fences))

    def compute_ground_with_margin(
        self, margin_m: float, max_small_m: float = 0.0, extra_margin_m: float = 0.0
    ) -> Field:
        """The field reduced to the ground that may be worked, with a margin to obstacles, holes and fences.

        Obstacles less than `max_small_m` across stay within the boundary as `small_obstacles`. The boundary keeps
        `extra_margin_m` more from all others, as machines swing out in bends, and at least MIN_FENCE_MARGIN_M from
        fences. If obstacles divide the field, the largest part is kept, and a remark gives the area of the others.

        Raises FieldError where the margin is out of range or wider than the field, too little ground remains, or a
        fence has no opening.
        """
        check_fence_opening(self.boundary, self.fences, self.entrance, self.name)
        _check_margin(margin_m, self)
        if not self.obstacles and not self.fences and not (self.boundary.interiors and (margin_m or max_small_m)):
            return self
        obstacles = self._list_margin_obstacles(max(EDGE_M, MIN_FENCE_MARGIN_M - margin_m))

        def apply_margin(metres: float) -> WorkableGround:
            margins_m = [metres] * (len(self.boundary.interiors) + len(obstacles))
            return compute_workable_ground(self.boundary, obstacles, margins_m, max_small_m, extra_margin_m)

        workable = apply_margin(margin_m)
        if workable.boundary.area < MIN_FIELD_AREA_M2:
            causes = FENCED_CAUSES if self.fences else "Obstacles"
            raise FieldError(
                f"{causes} with a margin ({mark_parameter('margin_m')}) of {margin_m:g} m leave "
                f"{workable.boundary.area:.3g} m2 of field '{self.name}' in one piece; a field needs at least "
                f"{MIN_FIELD_AREA_M2:g} m2, so {_advise_on_margin(margin_m, self, apply_margin)}."
            )
        if _is_mostly_margin(workable, margin_m, self):
            raise FieldError(
                f"The margin ({mark_parameter('margin_m')}) of {margin_m:g} m is too wide for field '{self.name}': it "
                f"leaves {_measure_worked_m2(workable):.0f} of {_measure_free_m2(self):.0f} m2 in one piece; "
                f"{_advise_on_margin(margin_m, self, apply_margin)}."
            )
        field = self._replace_cut_off_parts(workable.cut_off_parts)
        return replace(
            field,
            boundary=workable.boundary,
            margin_boundary=None if workable.margin_boundary is workable.boundary else workable.margin_boundary,
            small_obstacles=workable.small_obstacles,
            original_boundary=self.whole_boundary,
        )

    def mark_done(self, done: shapely.Geometry) -> Field:
        """The field with ground that is done, of which no part is cut off any more."""
        left = [part for whole in self.cut_off_parts for part in shapely.get_parts(subtract_area(whole, done))]
        return replace(self._replace_cut_off_parts(tuple(left)), done=done)

    def _replace_cut_off_parts(self, parts: tuple[shapely.Polygon, ...]) -> Field:
        """The field with other parts that obstacles cut off, and with the remark on these."""
        earlier = _list_cut_off_remarks(self.cut_off_m2)
        cut_off_m2 = math.fsum(part.area for part in parts)
        remarks = (*(one for one in self.remarks if one not in earlier), *_list_cut_off_remarks(cut_off_m2))
        return replace(self, remarks=remarks, cut_off_parts=parts if cut_off_m2 >= MIN_REPORTED_M2 else ())

    def find_ground_at(self, x: float, y: float) -> str:
        """Name of the ground at the point (x, y) in metres; the edge of a zone belongs to it."""
        for zone in self.ground_zones:
            if shapely.intersects_xy(zone.polygon, x, y):
                return zone.name
        return self.default_ground

    def to_wgs84(self, xy: npt.ArrayLike) -> Floats:
        """Longitude and latitude in degrees, shape (n, 2), of local points in metres, shape (n, 2).

        Raises FieldError where the field is not georeferenced (``crs`` is None) or the shape is wrong.
        """
        if self.crs is None:
            raise FieldError(
                f"Field '{self.name}' is in local metres without a place on the earth; "
                "use a boundary in longitude and latitude to get positions."
            )
        points = np.asarray(xy, dtype=np.float64)
        if points.ndim != 2 or points.shape[1] != 2:
            raise FieldError(f"Points of shape {points.shape} are not pairs; pass an array of shape (n, 2).")
        return project(points + np.asarray(self.origin_m), self.crs, DEGREES_CRS)

    def locate_place(self, place: tuple[float, float]) -> tuple[float, float] | None:
        """A place in metres of the field, given in longitude and latitude, or in the metres of its file without them.

        None for degrees that are not on the earth.
        """
        points = np.array([place], dtype=np.float64)
        if self.crs is not None:
            if not (-180.0 <= place[0] <= 180.0 and -90.0 <= place[1] <= 90.0):
                return None
            points = project(points, DEGREES_CRS, self.crs)
        x, y = (points[0] - np.asarray(self.origin_m)).tolist()
        return x, y


def _check_margin(margin_m: float, field: Field) -> None:
    """Refuse a margin below 0, or one wider than a field without obstacles."""
    if not (math.isfinite(margin_m) and margin_m >= 0.0):
        raise FieldError(f"The margin ({mark_parameter('margin_m')}) is {margin_m:g} m; it must be 0 or more.")
    if field.obstacles or field.fences:
        return  # checked later, by the remaining ground
    x, y = shapely.get_coordinates(shapely.minimum_rotated_rectangle(field.boundary))[:3].T
    across_m = float(np.hypot(np.diff(x), np.diff(y)).min())
    if margin_m >= across_m:
        raise FieldError(
            f"The margin ({mark_parameter('margin_m')}) is {margin_m:g} m, but field '{field.name}' is only "
            f"{across_m:.0f} m across; use less than {0.5 * across_m:.0f} m."
        )


def _measure_worked_m2(workable: WorkableGround) -> float:
    return float(workable.margin_boundary.area) - math.fsum(part.area for part in workable.small_obstacles)


def _measure_free_m2(field: Field) -> float:
    return replace(field, original_boundary=field.boundary).area_without_margin_m2


def _is_mostly_margin(workable: WorkableGround, margin_m: float, field: Field) -> bool:
    """Whether a margin takes nearly all ground that obstacles and fences leave."""
    worked_m2 = _measure_worked_m2(workable)
    if margin_m == 0.0 or worked_m2 >= MIN_WORKED_SHARE * field.boundary.area:
        return False
    return worked_m2 < MIN_WORKED_SHARE * _measure_free_m2(field)


def _advise_on_margin(margin_m: float, field: Field, apply: Callable[[float], WorkableGround]) -> str:
    """The widest of some smaller margins that leaves a field, tried; else the obstacles themselves leave none."""
    for smaller_m in (round(share * margin_m, 2) for share in SMALLER_MARGIN_SHARES):
        workable = apply(smaller_m)
        if workable.boundary.area >= MIN_FIELD_AREA_M2 and not _is_mostly_margin(workable, smaller_m, field):
            return f"use a margin of {smaller_m:g} m or less"
    return "check the obstacles"


def _check_polygon(polygon: shapely.Polygon, label: str) -> shapely.Polygon:
    """The polygon, counter-clockwise; raises FieldError if it is not a valid polygon."""
    if not isinstance(polygon, shapely.Polygon):
        raise FieldError(f"The outline of {label} is a {type(polygon).__name__}; give one shapely Polygon.")
    if polygon.is_empty or not polygon.is_valid:
        reason = "it is empty" if polygon.is_empty else shapely.is_valid_reason(polygon)
        raise FieldError(f"The outline of {label} is not a valid polygon ({reason}); redraw it there.")
    return orient(polygon, 1.0)


def _list_cut_off_remarks(cut_off_m2: float) -> tuple[str, ...]:
    """The sentence on ground that obstacles cut off; none on too little to tell."""
    if cut_off_m2 < MIN_REPORTED_M2:
        return ()
    return (f"Obstacles cut off {cut_off_m2:.0f} m2 of the field: no machine gets there from the rest.",)
