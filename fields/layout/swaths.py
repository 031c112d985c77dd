"""Swaths on a field: evenly spaced parallel lines that end where the headland begins, and the ground beside them.

A headland is either room for turning at the ends of swaths, or worked in passes all along the outline.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from dataclasses import field as member
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely

from fields.arrays import Floats
from fields.errors import FieldError, mark_parameter
from fields.geometry.arithmetic import CURVE_M, EDGE_M, GRID_M, MIN_SWATH_LENGTH_M, MITRE_LIMIT, multiply
from fields.geometry.coordinates import MAX_LOCAL_M
from fields.geometry.field import Field
from fields.geometry.overlays import subtract, subtract_on_grid, unite, unite_on_grid
from fields.layout.bearings import choose_longer_reach_direction, list_candidate_bearings
from fields.layout.cells import Cell, convert_to_compass_deg
from fields.layout.headland_passes import compute_inner_region
from fields.layout.parallel_lines import (
    OUTER_LINE_SHIFTS,
    PatternRules,
    SwathPattern,
    collect_edges,
    compute_axes,
    fill_region,
    find_best_pattern,
    is_better,
)

MAX_LINES = 20_000
MIN_THICKNESS_M = 1e-5
"""Thinner parts of the inner region are rounding errors."""
SAME_M = 0.01  # lines that differ by less are equally long, or equally far from the entrance
WIDTH_STEP_M = 0.5  # of widths that are advised, of machines and of headlands
SHALLOWER_SHARES = (0.75, 0.5, 0.25, 0.0)  # of the headland beyond half a width, tried where it leaves no track
PROMISING_COST_RATIO = 1.25
"""To the cheapest direction: within this, a direction may still win once its outer lines are shifted."""


@dataclass(frozen=True)
class Swath:
    """One swath, given by its centre line: straight, or curved where it has places on the way.

    Attributes:
        line: number of the parallel line, counted across each cell, cell after cell.
        piece: 0 and up along +u where a hole or a notch interrupts the line.
        start_m, end_m: ends of the centre line, metres; end - start points along +u.
        cell_number: number of its cell.
        via_m: places of a curved centre line between its ends, metres.
    """

    line: int
    piece: int
    start_m: tuple[float, float]
    end_m: tuple[float, float]
    cell_number: int = 1
    via_m: tuple[tuple[float, float], ...] = member(default=(), compare=False, repr=False)

    @property
    def points_m(self) -> Floats:
        """The centre line, shape (n, 2)."""
        return np.array([self.start_m, *self.via_m, self.end_m])

    @cached_property
    def length_m(self) -> float:
        """Length in metres."""
        if self.via_m:
            return float(np.hypot(*np.diff(self.points_m, axis=0).T).sum())
        return math.dist(self.start_m, self.end_m)


@dataclass(frozen=True)
class Layout:
    """The swaths of a field.

    Attributes:
        field: the field they are laid on.
        bearing_rad: direction +u of the swaths of the largest cell as a mathematical angle, radians: in (-pi/2, pi/2],
            or with headland passes the way the outline points (`bearings.choose_longer_reach_direction`), so that it
            turns with the
            field.
        width_m: working width, the largest spacing of the lines of a cell.
        headland_m: room beyond the ends of the swaths, along them.
        swaths: sorted by line and piece; line numbers are unique across cells. None if the headland passes take all.
        inner_region: where the centre lines of swaths may be; with headland passes, the ground inside these.
        headland_passes: number of worked headland passes; 0 if the headland is only room for turning.
        cells: parts of `inner_region` with swaths in one direction, in order of their numbers; by default a single one,
            none without swaths.
        min_spacing_m: inside headland passes, the smallest spacing of lines, but at most the width.
    """

    field: Field
    bearing_rad: float
    width_m: float
    headland_m: float
    swaths: tuple[Swath, ...]
    inner_region: shapely.Geometry
    headland_passes: int = 0
    cells: tuple[Cell, ...] = ()
    min_spacing_m: float = 0.0

    def __post_init__(self) -> None:
        if self.swaths and not self.cells:
            object.__setattr__(self, "cells", (Cell(1, self.bearing_rad, self.inner_region),))

    @property
    def track_count(self) -> int:
        """Number of lines with swaths, each of one piece or several."""
        return len({swath.line for swath in self.swaths})

    @property
    def bearing_deg(self) -> float:
        """Direction of the swaths of the largest cell clockwise from north, degrees in [0, 180)."""
        return convert_to_compass_deg(self.bearing_rad)

    @property
    def total_length_m(self) -> float:
        """Total length of all swaths, metres."""
        return math.fsum(swath.length_m for swath in self.swaths)


def measure_min_spacing_m(layout: Layout) -> float:
    """The least distance of neighbouring swaths (m); below the width where swaths are evenly spaced."""
    spacing_m = layout.width_m
    for before, swath in pairwise(layout.swaths):
        if swath.line != before.line + 1:
            continue
        distances_m = _measure_distances_m(before, swath)
        spread_m = CURVE_M if before.via_m or swath.via_m else EDGE_M
        if len(distances_m) and np.ptp(distances_m) < spread_m and distances_m[0] > 0.5 * layout.width_m:
            # at the points of a curve steps sag to either side, so the middle of their distances is that of the lines
            is_curved = before.via_m or swath.via_m
            spacing_m = min(spacing_m, float(np.median(distances_m) if is_curved else distances_m[0]))
    return spacing_m


def _measure_distances_m(before: Swath, swath: Swath) -> Floats:
    """Distances (n,) of a swath from the line of another; of a curved one those beside it, not beyond its ends."""
    if before.via_m or swath.via_m:
        line, points = shapely.LineString(before.points_m), shapely.points(swath.points_m)
        along = shapely.line_locate_point(line, points)
        is_beside = (along > 0.0) & (along < line.length)
        return np.asarray(shapely.distance(line, points)[is_beside])
    ends = np.array([swath.start_m, swath.end_m]) - before.start_m
    along = (np.array(before.end_m) - before.start_m) / before.length_m
    return np.asarray(np.abs(along[0] * ends[:, 1] - along[1] * ends[:, 0]))


def lay_swaths(
    field: Field,
    width_m: float,
    headland_m: float,
    bearing_deg: float | None = None,
    headland_passes: int = 0,
    min_spacing_m: float = 0.0,
) -> Layout:
    """Lay parallel swaths on a field.

    The boundary (obstacles included) is first shrunk by half the width; every chord along the swaths is then shortened
    at both ends by headland - width / 2. The distance to an edge at the angle a to the swaths is thus
    width / 2 + (headland - width / 2) |sin a|: the full headland where swaths end at right angles, half a width where
    they run alongside. Pieces below MIN_SWATH_LENGTH_M are dropped; with headland passes they are extended to it.

    The outer lines touch the lateral extremes of the shrunk boundary, or are shifted inwards by less than a width
    where that saves more than it leaves uncovered (a notch or a bulge in the side).

    Args:
        width_m: working width.
        headland_m: room for turning along the swaths; with 0 they run up to the boundary.
        bearing_deg: direction clockwise from north; None tries the directions of the boundary and of the
            smallest rectangle around it and takes the one with the least estimated driving.
        headland_passes: worked passes of the headland. With any, the headland is as deep as they are wide, all along
            the outline and every hole, and swaths cover all ground inside it, also along oblique edges: none where
            that is too little.
        min_spacing_m: with headland passes, the smallest spacing of lines, but at most the width; with a machine's
            width plus clearance, machines can pass each other on neighbouring swaths.

    Raises FieldError where a value is out of range, or no swath fits between headlands left for turning.
    """
    _check_layout_request(width_m, headland_m, bearing_deg)
    region = _inset_boundary(field, width_m)
    if headland_passes:
        return _lay_inside_headland(field, width_m, headland_passes, bearing_deg, min_spacing_m)
    edges = collect_edges(region)
    trim_m = max(headland_m - width_m / 2.0, 0.0) + GRID_M
    rules = PatternRules(width_m, trim_m, MIN_SWATH_LENGTH_M, GRID_M, field.area_m2)
    choice = _choose_pattern(field, edges, rules, bearing_deg)
    if choice is None:
        advice = _advise_on_turning_room(field, edges, rules, bearing_deg)
        raise FieldError(
            f"No track of {MIN_SWATH_LENGTH_M:g} m fits field '{field.name}' ({field.area_ha:.3g} ha) with a headland "
            f"of {headland_m:g} m{_describe_bearing(bearing_deg)}; {advice}."
        )
    bearing_rad, pattern = choice
    inner = _trim_region(region, edges, compute_axes(bearing_rad), trim_m)
    swaths = number_from_longer_side(build_swaths(pattern, compute_axes(bearing_rad)), field.entrance)
    return Layout(field, bearing_rad, width_m, headland_m, swaths, inner)


def _advise_on_turning_room(field: Field, edges: Floats, rules: PatternRules, bearing_deg: float | None) -> str:
    """What leaves a track between two headlands: another bearing or less headland where either does, tried."""
    free = _choose_pattern(field, edges, rules, None) if bearing_deg is not None else None
    if free is not None:
        return f"use a bearing ({mark_parameter('bearing_deg')}) of {convert_to_compass_deg(free[0]):.0f} degrees"
    for share in SHALLOWER_SHARES:
        shallower = replace(rules, trim_m=share * rules.trim_m)
        if _choose_pattern(field, edges, shallower, bearing_deg) is not None:
            headland_m = share * (rules.trim_m - GRID_M) + 0.5 * rules.width_m
            return f"use a headland ({mark_parameter('headland_m')}) of {headland_m:.1f} m"
    return _advise_on_width(field)


def _advise_on_width(field: Field) -> str:
    """How narrow an implement gets into the widest place of the field."""
    radius_m = float(shapely.maximum_inscribed_circle(field.boundary).length)
    steps = math.ceil(2.0 * radius_m / WIDTH_STEP_M) - 1
    if steps < 1:
        return "check the outline, as no implement is narrow enough"
    return f"use an implement ({mark_parameter('width_m')}) of {steps * WIDTH_STEP_M:g} m or less"


def check_width(field: Field, width_m: float) -> None:
    """Raise FieldError for a working width with which no track, or too many, would fit a field."""
    _check_layout_request(width_m, 0.0, None)
    _inset_boundary(field, width_m)


def _inset_boundary(field: Field, width_m: float) -> shapely.Geometry:
    """The boundary shrunk by half the width; refuses a width with which no track, or too many, would fit."""
    region = field.boundary.buffer(GRID_M - width_m / 2.0, join_style="mitre", mitre_limit=MITRE_LIMIT)
    if region.is_empty:
        fix = _advise_on_width(field)
        raise FieldError(
            f"Field '{field.name}' is nowhere wider than the working width of {width_m:g} m; {fix}."
            if field.original_boundary is None
            else f"Without its obstacles and their margins, field '{field.name}' is nowhere wider than the working "
            f"width of {width_m:g} m; check the obstacles, or {fix}.",
            parameter="width_m",
        )
    span_m = math.dist(region.bounds[:2], region.bounds[2:])
    if span_m > MAX_LINES * width_m:
        raise FieldError(
            f"A working width of {width_m:g} m would give more than {MAX_LINES} tracks on field '{field.name}', which "
            f"is {span_m:.0f} m across; give the width in metres.",
            parameter="width_m",
        )
    return region


def _lay_inside_headland(
    field: Field, width_m: float, headland_passes: int, bearing_deg: float | None, min_spacing_m: float
) -> Layout:
    """Swaths over all ground inside the headland passes; none where no room is left for any."""
    region = compute_inner_region(field, headland_passes * width_m)
    edges = collect_edges(region)
    rules = PatternRules.inside_headland(region, width_m, min_spacing_m)
    shorter = replace(rules, min_length_m=MIN_THICKNESS_M)
    choice = _choose_pattern(field, edges, rules, bearing_deg) or _choose_pattern(field, edges, shorter, bearing_deg)
    bearing_rad = orient_bearing_by_outline(field, choice[0] if choice else _list_bearings(field, bearing_deg)[0])
    pattern, depth_m = fill_region(region, bearing_rad, rules), headland_passes * width_m
    laid = () if pattern is None else build_swaths(pattern, compute_axes(bearing_rad))
    swaths = number_from_longer_side(laid, field.entrance) if laid else ()
    return Layout(field, bearing_rad, width_m, depth_m, swaths, region, headland_passes, min_spacing_m=min_spacing_m)


def _check_layout_request(width_m: float, headland_m: float, bearing_deg: float | None) -> None:
    """Refuse values out of range."""
    if not (math.isfinite(width_m) and width_m > 0.0):
        raise FieldError(f"The working width is {width_m} m; give a width above 0 m.", parameter="width_m")
    if not 0.0 <= headland_m <= MAX_LOCAL_M:
        raise FieldError(f"The headland is {headland_m:g} m; give 0 to {MAX_LOCAL_M:g} m.", parameter="headland_m")
    if bearing_deg is not None and not math.isfinite(bearing_deg):
        raise FieldError(
            f"The bearing is {bearing_deg}; give degrees clockwise from north, or none.", parameter="bearing_deg"
        )


def _choose_pattern(
    field: Field, edges: Floats, rules: PatternRules, bearing_deg: float | None
) -> tuple[float, SwathPattern] | None:
    """Direction in (-pi/2, pi/2] and pattern: for the given bearing, or the cheapest of the candidates.

    Candidates are first compared without shifts, and only promising ones in full. With equal cost and length the one
    with the longest edge, which comes first, wins.
    """
    angles = _list_bearings(field, bearing_deg)
    if bearing_deg is None:
        angles = _select_promising_bearings(angles, edges, rules)
    best: tuple[float, SwathPattern] | None = None
    for angle in angles:
        pattern = find_best_pattern(multiply(edges, compute_axes(angle).T), rules, OUTER_LINE_SHIFTS)
        if pattern is not None and (best is None or is_better(pattern, best[1])):
            best = angle, pattern
    return best


def _list_bearings(field: Field, bearing_deg: float | None) -> list[float]:
    """The given bearing as a mathematical angle, or those of the boundary with that of the longest edge first."""
    if bearing_deg is None:
        return list_candidate_bearings(field.boundary)
    return [math.radians(90.0 - bearing_deg % 180.0)]


def _select_promising_bearings(angles: list[float], edges: Floats, rules: PatternRules) -> list[float]:
    """The directions, in order and in (-pi/2, pi/2], whose pattern without shifts is nearly the cheapest."""
    patterns = [(angle, find_best_pattern(multiply(edges, compute_axes(angle).T), rules)) for angle in angles]
    cost = [(angle, teeth.cost_m) for angle, teeth in patterns if teeth is not None]
    limit = min((value for _, value in cost), default=0.0) * PROMISING_COST_RATIO
    return [normalise_bearing(angle) for angle, value in cost if value <= limit]


def orient_bearing_by_outline(field: Field, bearing_rad: float) -> float:
    """A direction or its opposite, in (-pi, pi]: the way the outline of a field with its holes points."""
    outline = field.boundary
    rings = [np.asarray(ring.coords)[:-1, :2] for ring in (outline.exterior, *outline.interiors)]
    return choose_longer_reach_direction(bearing_rad, rings, [] if field.entrance is None else [field.entrance])


def normalise_bearing(angle_rad: float) -> float:
    """An undirected angle in [0, pi), moved to (-pi/2, pi/2]."""
    return angle_rad - math.pi if angle_rad > math.pi / 2.0 + 1e-12 else angle_rad


def build_swaths(pattern: SwathPattern, axes: Floats) -> tuple[Swath, ...]:
    """The pieces of a pattern as swaths in metres; empty lines before the first piece are not counted."""
    q = pattern.offsets_m[pattern.line_index]
    start = multiply(np.column_stack([pattern.start_m, q]), axes)
    end = multiply(np.column_stack([pattern.end_m, q]), axes)
    swaths: list[Swath] = []
    for line, a, b in zip(
        (pattern.line_index - pattern.line_index[0]).tolist(), start.tolist(), end.tolist(), strict=True
    ):
        piece = swaths[-1].piece + 1 if swaths and swaths[-1].line == line else 0
        swaths.append(Swath(line, piece, (a[0], a[1]), (b[0], b[1])))
    return tuple(swaths)


def number_from_longer_side(swaths: tuple[Swath, ...], entrance: tuple[float, float] | None) -> tuple[Swath, ...]:
    """Swaths with lines counted from the side where they are longer, whatever the orientation of the field.

    Where both sides look the same, from that of the entrance.
    """
    lengths_m = np.bincount([swath.line for swath in swaths], [swath.length_m for swath in swaths])
    leads_m = (lengths_m - lengths_m[::-1]).tolist()
    if entrance is not None:
        ends = [shapely.LineString(swath.points_m) for swath in (swaths[0], swaths[-1])]
        first_m, last_m = shapely.distance(ends, shapely.Point(entrance)).tolist()
        leads_m.append(last_m - first_m)
    lead_m = next((lead_m for lead_m in leads_m if abs(lead_m) > SAME_M), 0.0)
    return reverse_line_numbers(swaths) if lead_m < 0.0 else swaths


def reverse_line_numbers(swaths: tuple[Swath, ...]) -> tuple[Swath, ...]:
    """Swaths with lines counted from the other side."""
    last = swaths[-1].line
    reversed_swaths = (replace(track, line=last - track.line) for track in swaths)
    return tuple(sorted(reversed_swaths, key=lambda track: (track.line, track.piece)))


def _trim_region(region: shapely.Geometry, edges: Floats, frame: Floats, trim_m: float) -> shapely.Geometry:
    """The region without the ground within ``trim_m`` of its edge, measured along the swaths."""
    reach = trim_m * frame[0]
    slanted = np.abs(multiply(edges[:, 1] - edges[:, 0], frame[1])) > 1e-9
    if not slanted.any():
        return region
    a, b = edges[slanted, 0], edges[slanted, 1]
    swept = shapely.polygons(np.stack([a - reach, b - reach, b + reach, a + reach], axis=1))
    # Without a grid GEOS loses whole pieces when it unites shapes with nearly coincident edges.
    blocked = unite_on_grid(swept)
    parts = shapely.get_parts(subtract_on_grid(region, blocked))
    return unite_on_grid(parts[shapely.area(parts) > MIN_THICKNESS_M * shapely.length(parts)])


def _describe_bearing(bearing_deg: float | None) -> str:
    return "" if bearing_deg is None else f" at bearing {bearing_deg:g} degrees"


def compute_free_space(field: Field, margin_m: float) -> shapely.Geometry:
    """Where the guided point may be: the field shrunk by a margin, obstacles included; may be empty or in parts.

    Corners that point inwards are passed in an arc: with sharp ones a neck is closed that leaves the margin on either
    side.
    """
    open_ground = subtract(field.boundary, unite(field.small_obstacles)) if field.small_obstacles else field.boundary
    return open_ground.buffer(-margin_m)
