"""Swaths along contours: lines at even distances from one smooth line that follows a contour of the ground.

The guide is a contour whose heading is smoothed until neither it nor any line beside it bends more tightly than
tractors turn. Places are measured along the guide (s) and to its left (d). In these coordinates swaths are straight and
parallel, so that the same rules lay them; back on the ground neighbours are their spacing apart everywhere, as d is a
distance. With the curvature k of the guide, positive to the left, the line at d has the curvature k / (1 - k d).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from fields.arrays import Floats, build_directions, compute_angles
from fields.geometry.arithmetic import multiply
from fields.geometry.field import Field
from fields.geometry.overlays import intersect_on_grid
from fields.layout.headland_passes import compute_inner_region
from fields.layout.parallel_lines import PatternRules, compute_axes, fill_region
from fields.layout.swaths import Layout, Swath, build_swaths, number_from_longer_side, orient_bearing_by_outline
from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.slopes import cut_into_steps, interpolate_gradients, trace_height

STEP_M = 1.0  # between the points of guides and swaths
HEIGHT_SHARES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the ground below the contours that are tried as guides
SMOOTHING_M = (5.0, 10.0, 20.0, 40.0, 80.0, 160.0)  # standard deviations tried, along the contour
MIN_CONTOUR_SHARE = 0.25  # of the root of the area: shorter contours say little about the field
STRAIGHT_M = 0.01  # swaths that leave their chord by less are straight
DISTANCE_TOLERANCE_M = 0.1  # a line that is nearer to the guide by more comes round to it again
NEWTON_STEPS = 3


@dataclass(frozen=True, eq=False)
class GuideCurve:
    """A smooth line, straight beyond its ends: points (n, 2), STEP_M apart, and headings (n,) in radians, unwrapped."""

    points: Floats
    headings: Floats

    @property
    def length_m(self) -> float:
        """Length between the ends."""
        return STEP_M * (len(self.points) - 1)

    @cached_property
    def curvatures(self) -> Floats:
        """Curvature of each step (n - 1,), positive to the left, 1/m."""
        return np.asarray(np.diff(self.headings) / STEP_M)

    def build_line(self, reach_m: float) -> shapely.LineString:
        """The guide with straight ends of `reach_m`."""
        ends = np.array([[-reach_m, 0.0], [self.length_m + reach_m, 0.0]])
        first, last = self.place(ends)
        return shapely.LineString(np.concatenate([[first], self.points, [last]]))

    def place(self, measured: Floats) -> Floats:
        """Points (n, 2) on the ground from places along and beside the guide (n, 2)."""
        along = measured[:, 0]
        stations = STEP_M * np.arange(len(self.points))
        inside = np.clip(along, 0.0, self.length_m)
        heading = np.interp(inside, stations, self.headings)
        ahead = build_directions(heading)
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        foot = np.column_stack([np.interp(inside, stations, axis) for axis in self.points.T])
        placed: Floats = foot + (along - inside)[:, None] * ahead + measured[:, 1:] * left
        return placed

    def locate(self, points: Floats) -> Floats:
        """Places along and beside the guide (n, 2) of points on the ground (n, 2): those nearest to the guide."""
        reach_m = float(np.hypot(*np.ptp(np.concatenate([points, self.points]), axis=0))) + STEP_M
        along = shapely.line_locate_point(self.build_line(reach_m), shapely.points(points)) - reach_m
        for _ in range(NEWTON_STEPS):
            inside = np.clip(along, 0.0, self.length_m)
            heading = np.interp(inside, STEP_M * np.arange(len(self.points)), self.headings)
            offset = points - self.place(np.column_stack([along, np.zeros(len(along))]))
            cosine, sine = build_directions(heading).T
            ahead = offset[:, 0] * cosine + offset[:, 1] * sine
            beside = offset[:, 1] * cosine - offset[:, 0] * sine
            step = np.clip((along / STEP_M).astype(np.int64), 0, len(self.curvatures) - 1)
            curvature = np.where(along == inside, self.curvatures[step], 0.0)
            along = along + ahead / np.maximum(1.0 - curvature * beside, 0.1)
        return np.column_stack([along, beside])


def lay_contour_swaths(
    field: Field,
    grid: ElevationGrid,
    width_m: float,
    headland_passes: int,
    radius_m: float,
    min_spacing_m: float = 0.0,
) -> Layout:
    """Lay swaths along contours inside worked headland passes; none where no contour leads through the field.

    Of the contours and smoothings tried, the one is taken whose swaths climb least per metre.

    `grid` has the heights of the field. Lines are at most the working width `width_m` apart, at least the smaller of
    that and `min_spacing_m`, and bend no more tightly than `radius_m`; the headland has 1 or more `headland_passes`.
    """
    depth_m = headland_passes * width_m
    region = compute_inner_region(field, depth_m)
    rules = PatternRules.inside_headland(region, width_m, min_spacing_m)
    best: tuple[float, float, tuple[Swath, ...]] = (math.inf, 0.0, ())
    for contour in () if region.is_empty else _iter_contours(grid, region):
        for one in _iter_guides(contour, region, max(radius_m, 0.5 * width_m)):
            guide = _orient_guide(one, field)
            swaths = _lay_along_guide(guide, region, rules, field.entrance)
            climb = round(measure_climb(swaths, grid), 6) if swaths else math.inf
            if climb < best[0]:
                best = climb, _compute_mean_heading(guide), swaths
    _, bearing_rad, swaths = best
    return Layout(field, bearing_rad, width_m, depth_m, swaths, region, headland_passes, min_spacing_m=min_spacing_m)


def measure_climb(swaths: tuple[Swath, ...], grid: ElevationGrid) -> float:
    """Mean size of the slope along swaths (m/m), each metre counted once."""
    steps = [cut_into_steps(swath.points_m) for swath in swaths]
    middles = np.concatenate([middle for middle, _ in steps])
    vectors = np.concatenate([vector for _, vector in steps])
    climbs = np.abs((interpolate_gradients(grid, middles) * vectors).sum(axis=1))
    return float(climbs.sum() / np.hypot(*vectors.T).sum())


def _iter_contours(grid: ElevationGrid, region: shapely.Geometry) -> Iterator[Floats]:
    """The longest open contour (n, 2) through a region at each of several heights."""
    inside = grid.frame.find_inside(region)
    if not inside.any():
        return
    heights = np.unique(np.round(np.quantile(grid.heights_m[inside], HEIGHT_SHARES), 6))
    for height_m in heights.tolist():
        pieces = [points for points in trace_height(grid, height_m) if math.dist(points[0], points[-1]) > STEP_M]
        lengths = [intersect_on_grid(shapely.LineString(points), region).length for points in pieces]
        if lengths and max(lengths) >= MIN_CONTOUR_SHARE * math.sqrt(region.area):
            yield pieces[int(np.argmax(lengths))]


def _iter_guides(contour: Floats, region: shapely.Geometry, radius_m: float) -> Iterator[GuideCurve]:
    """Guides along a contour that may have swaths at any place of a region: the least smoothed, and a straight one."""
    for smoothing_m in SMOOTHING_M:
        guide = smooth_contour(contour, smoothing_m)
        if guide is not None and _has_room_to_bend(guide, region, radius_m):
            yield guide
            break
    chord = contour[-1] - contour[0]
    heading = math.atan2(chord[1], chord[0])
    along = STEP_M * np.arange(max(2, math.ceil(math.hypot(*chord) / STEP_M)))
    middle = contour.mean(axis=0)
    points = middle + (along - 0.5 * along[-1])[:, None] * compute_axes(heading)[0]
    yield GuideCurve(points, np.full(len(points), heading))


def smooth_contour(contour: Floats, smoothing_m: float) -> GuideCurve | None:
    """A guide along a contour (n, 2): its heading, smoothed along it by a Gaussian; None if it is too short for that.

    Straight lines and arcs keep their shape, as the heading is continued at its ends as it runs there. The guide has
    the middle and the mean direction of the contour.
    """
    line = shapely.LineString(contour)
    count = int(line.length / STEP_M)
    reach = math.ceil(3.0 * smoothing_m / STEP_M)
    if count <= reach + 1:
        return None
    stations = STEP_M * np.arange(count + 1)
    spare_m = line.length - stations[-1]  # half of it is left out at each end: longer steps would bend the guide more
    places = shapely.get_coordinates(shapely.line_interpolate_point(line, 0.5 * spare_m + stations))
    steps = np.diff(places, axis=0)
    headings = np.unwrap(compute_angles(steps))
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * STEP_M / smoothing_m) ** 2)
    continued = np.concatenate(
        [2.0 * _fit_end(headings, reach) - headings[reach:0:-1], headings,
         2.0 * _fit_end(headings[::-1], reach) - headings[-2 : -reach - 2 : -1]]
    )  # fmt: skip
    smooth = multiply(np.lib.stride_tricks.sliding_window_view(continued, len(kernel)), kernel / kernel.sum())
    points = np.concatenate([[[0.0, 0.0]], np.cumsum(STEP_M * build_directions(smooth), 0)])
    ends = 1.5 * smooth[[0, -1]] - 0.5 * smooth[[1, -2]]
    node_headings = np.concatenate([ends[:1], 0.5 * (smooth[1:] + smooth[:-1]), ends[1:]])
    return _move_onto(GuideCurve(points, node_headings), places)


def _fit_end(headings: Floats, reach: int) -> float:
    """The heading at the beginning of a row of them, by a straight fit over the first of them."""
    some = headings[: max(reach, 4)]
    middle = 0.5 * (len(some) - 1)
    away = np.arange(len(some)) - middle
    return float(some.mean() - middle * multiply(away, some) / multiply(away, away))


def _move_onto(guide: GuideCurve, places: Floats) -> GuideCurve:
    """The guide turned and moved so that its points lie as near to as many places (n, 2) as they can (Kabsch)."""
    own, other = guide.points - guide.points.mean(axis=0), places - places.mean(axis=0)
    turn = math.atan2(float((own[:, 0] * other[:, 1] - own[:, 1] * other[:, 0]).sum()), float((own * other).sum()))
    return GuideCurve(multiply(own, compute_axes(turn)) + places.mean(axis=0), guide.headings + turn)


def _has_room_to_bend(guide: GuideCurve, region: shapely.Geometry, radius_m: float) -> bool:
    """Whether lines beside a guide keep a radius at every distance that a region has from it."""
    beside = guide.locate(shapely.get_coordinates(shapely.segmentize(region, 5.0 * STEP_M)))[:, 1]
    left_m, right_m = max(float(beside.max()), 0.0), max(-float(beside.min()), 0.0)
    curvatures = guide.curvatures
    return bool(curvatures.max() <= 1.0 / (radius_m + left_m) and -curvatures.min() <= 1.0 / (radius_m + right_m))


def _compute_mean_heading(guide: GuideCurve) -> float:
    """The mean direction of a guide in (-pi, pi]."""
    return math.atan2(*build_directions(guide.headings).mean(axis=0)[::-1].tolist())


def _orient_guide(guide: GuideCurve, field: Field) -> GuideCurve:
    """The guide in the direction in which the outline of a field points."""
    heading = _compute_mean_heading(guide)
    if abs(math.remainder(orient_bearing_by_outline(field, heading) - heading, math.tau)) < 0.5 * math.pi:
        return guide
    return GuideCurve(guide.points[::-1], guide.headings[::-1] + math.pi)


def _lay_along_guide(
    guide: GuideCurve, region: shapely.Geometry, rules: PatternRules, entrance: tuple[float, float] | None
) -> tuple[Swath, ...]:
    """The swaths of a guide over a region; none where they come round to it again, or where none fits."""
    measured = shapely.transform(shapely.segmentize(region, STEP_M), guide.locate)
    pattern = fill_region(shapely.make_valid(measured), 0.0, rules)
    if pattern is None:
        return ()
    measured_swaths = build_swaths(pattern, np.eye(2))
    swaths = tuple(_bend_swath(swath, guide) for swath in measured_swaths)
    line = guide.build_line(math.dist(region.bounds[:2], region.bounds[2:]))
    shapely.prepare(line)
    for swath, straight in zip(swaths, measured_swaths, strict=True):
        distances = shapely.distance(line, shapely.points(swath.points_m[::5]))
        if float(np.abs(distances - abs(straight.start_m[1])).max()) > DISTANCE_TOLERANCE_M:
            return ()
    return number_from_longer_side(swaths, entrance)


def _bend_swath(swath: Swath, guide: GuideCurve) -> Swath:
    """A swath on the ground, from one along and beside a guide."""
    count = max(2, math.ceil(swath.length_m / STEP_M) + 1)
    points = guide.place(np.linspace(swath.start_m, swath.end_m, count))
    ends = (float(points[0, 0]), float(points[0, 1])), (float(points[-1, 0]), float(points[-1, 1]))
    chord = shapely.LineString(ends)
    if float(shapely.distance(chord, shapely.points(points)).max()) < STRAIGHT_M:
        return replace(swath, start_m=ends[0], end_m=ends[1])
    return replace(swath, start_m=ends[0], end_m=ends[1], via_m=tuple(map(tuple, points[1:-1].tolist())))
