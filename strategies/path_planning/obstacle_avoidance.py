"""Swaths and headland passes among small obstacles: bent round them with the implement down, or cut at them.

The line is left in two arcs and a straight between them, the obstacle passed on the side that needs less, and the line
rejoined the same way:

    deviation d, radius R     angle a = arccos(1 - d / 2R), at most MAX_ANGLE_RAD
    straight between arcs     c = (d - 2R (1 - cos a)) / sin a
    along the line            2R sin a + c cos a
    driven                    2R a + c

The whole deviation is held from where the nose reaches the obstacle until the implement is past it. Where there is no
room for that, the swath is cut.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
import shapely

from fields.layout.swaths import Layout, Swath

Points = npt.NDArray[np.float64]
Span = tuple[float, float]

MAX_ANGLE_RAD = math.radians(45.0)
STEP_M = 0.25
OUTLINE_STEP_M = 0.5  # steps along the outline of an obstacle
SMOOTHING_M = 1.5  # distance to either side over which a heading is measured
EXTENSION_M = 40.0  # lines are extended by this to find obstacles near their ends
SLACK_M2 = 0.1  # rounding, of ground outside the workable area
CLEARANCE_TOLERANCE_M = 0.01
MAX_JOINED_OBSTACLES = 12


@dataclass(frozen=True)
class BendRules:
    """Radius of the arcs, and how far the machine reaches from its guided point to the side, ahead and behind (m)."""

    radius_m: float
    half_width_m: float
    nose_m: float
    tail_m: float

    @property
    def turning_room_m(self) -> float:
        """Room between an obstacle and the end of a line that is cut there, to turn aside."""
        return self.radius_m + self.nose_m + self.tail_m


@dataclass(frozen=True)
class Bend:
    """A deviation from a line, held from `begin_m` to `end_m` along it, positive to the left (m)."""

    begin_m: float
    end_m: float
    aside_m: float
    radius_m: float

    @property
    def angle_rad(self) -> float:
        """By how much the heading differs from that of the line."""
        return min(math.acos(max(1.0 - abs(self.aside_m) / (2.0 * self.radius_m), 0.0)), MAX_ANGLE_RAD)

    @property
    def straight_m(self) -> float:
        """Length of the straight between two arcs."""
        remaining_m = abs(self.aside_m) - 2.0 * self.radius_m * (1.0 - math.cos(self.angle_rad))
        return max(remaining_m, 0.0) / math.sin(self.angle_rad)

    @property
    def lead_m(self) -> float:
        """Distance along the line on which it is left, or rejoined."""
        return 2.0 * self.radius_m * math.sin(self.angle_rad) + self.straight_m * math.cos(self.angle_rad)

    @property
    def leave_at_m(self) -> float:
        """Where the line is left."""
        return self.begin_m - self.lead_m

    @property
    def rejoin_at_m(self) -> float:
        """Where the line is rejoined."""
        return self.end_m + self.lead_m

    def sample_points(self) -> Points:
        """Distance along the line and offset from it, (n, 2), from where the line is left to where it is rejoined."""
        angle, radius = self.angle_rad, self.radius_m
        turn = np.linspace(0.0, angle, max(2, math.ceil(radius * angle / STEP_M) + 1))
        arc = radius * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
        lead = np.array([self.lead_m, abs(self.aside_m)])
        leave = np.concatenate([arc, (lead - arc)[::-1]])
        back = np.array([self.rejoin_at_m, 0.0]) + np.array([-1.0, 1.0]) * leave[::-1]
        bend_points = np.concatenate([np.array([self.leave_at_m, 0.0]) + leave, back])
        bend_points[:, 1] *= math.copysign(1.0, self.aside_m)
        is_kept = np.concatenate([[True], np.diff(bend_points[:, 0]) > 1e-6])
        return np.asarray(bend_points[is_kept])


@dataclass(frozen=True, eq=False)
class BentLine:
    """A path along a line: its points (n, 2), and how far along the line each of them is (n,), increasing (m)."""

    distance_m: Points
    points: Points

    def cut_between(self, first_m: float, last_m: float) -> Points:
        """The path between two distances along the line, (k, 2)."""
        inside = (self.distance_m > first_m + 1e-6) & (self.distance_m < last_m - 1e-6)
        ends = np.array(
            [[np.interp(place_m, self.distance_m, axis) for axis in self.points.T] for place_m in (first_m, last_m)]
        )
        return np.concatenate([ends[:1], self.points[inside], ends[1:]])


class LineBender:
    """Bends lines round obstacles (polygons including their margin) inside the area that may be worked."""

    def __init__(self, obstacles: Sequence[shapely.Polygon], workable_area: shapely.Geometry, rules: BendRules) -> None:
        self.rules = rules
        self._obstacles = np.array(obstacles, dtype=np.object_)
        self._obstacle_tree = shapely.STRtree(self._obstacles)
        self._outlines = [
            shapely.get_coordinates(shapely.segmentize(obstacle, OUTLINE_STEP_M)) for obstacle in obstacles
        ]
        self._workable_area = workable_area
        shapely.prepare(workable_area)

    def bend_polyline(self, points: Points) -> tuple[BentLine | None, list[Span]]:
        """The path along a polyline (n, 2) that stays clear, None if it is the polyline itself; and blocked spans.

        Blocked spans are distances along the polyline, apart from each other, where obstacles leave no room for a bend.
        """
        line = Polyline(points)
        near_obstacles = self._find_near_obstacles(shapely.LineString(line.extended_points))
        if not near_obstacles:
            return None, []
        groups = [group for number in near_obstacles if (group := self._build_group(line, [number])) is not None]
        if not groups:
            return None, []
        bends, blocked_spans = self._choose_group_bends(line, groups)
        return (line.apply_bends(bends) if bends else None), blocked_spans

    def _find_near_obstacles(self, line: shapely.Geometry) -> list[int]:
        """Numbers of the obstacles that the machine would touch along a line."""
        near_obstacles = self._obstacle_tree.query(
            line, predicate="dwithin", distance=self.rules.half_width_m - CLEARANCE_TOLERANCE_M
        )
        return sorted(int(number) for number in near_obstacles)

    def _build_group(self, line: Polyline, numbers: list[int]) -> _ObstacleGroup | None:
        """A group of obstacles as seen from a line; None if none of it is in the way."""
        along, aside = line.project(np.concatenate([self._outlines[number] for number in numbers]))
        inside = np.abs(aside) < self.rules.half_width_m - CLEARANCE_TOLERANCE_M
        if not inside.any():
            return None
        low_m, high_m = float(along[inside].min()), float(along[inside].max())
        if high_m + self.rules.tail_m <= 0.0 or low_m - self.rules.nose_m >= line.length_m:
            return None
        return _ObstacleGroup(tuple(numbers), along, aside, (low_m, high_m))

    def _choose_group_bends(self, line: Polyline, groups: list[_ObstacleGroup]) -> tuple[list[Bend], list[Span]]:
        """Bends that do not overlap, and the spans of groups without a possible bend."""
        settled: list[tuple[_ObstacleGroup, Bend | None]] = []
        waiting = sorted(groups, key=lambda group: group.span)
        while waiting:
            group = waiting.pop(0)
            group, bend = self._find_best_bend(line, group)
            met_pairs = [pair for pair in settled if pair[0].overlaps_group(group) or _is_overlapping(pair[1], bend)]
            settled = [pair for pair in settled if not any(pair is met_pair for met_pair in met_pairs)]
            numbers = sorted({*group.numbers, *(number for pair in met_pairs for number in pair[0].numbers)})
            joined_group = self._build_group(line, numbers) if len(numbers) > len(group.numbers) else None
            if joined_group is None:
                settled.append((group, bend))
            elif len(numbers) > MAX_JOINED_OBSTACLES:
                settled.append((joined_group, None))
            else:
                waiting.insert(0, joined_group)
        blocked_spans = sorted(group.span for group, bend in settled if bend is None)
        return [bend for _, bend in sorted(settled, key=lambda pair: pair[0].span) if bend is not None], blocked_spans

    def _find_best_bend(self, line: Polyline, group: _ObstacleGroup) -> tuple[_ObstacleGroup, Bend | None]:
        """The bend with the least deviation that has room; its group grows by obstacles that stand beside the line."""
        options: list[tuple[float, int, _ObstacleGroup, Bend]] = []
        for bend in self._list_bends(group):
            grown_group = group
            while bend.leave_at_m >= 0.0 and bend.rejoin_at_m <= line.length_m:
                other_obstacles = self._find_other_obstacles(line, grown_group, bend)
                if not other_obstacles and self._has_room(line, bend):
                    options.append((round(abs(bend.aside_m), 6), len(options), grown_group, bend))
                wider_group = (
                    self._build_group(line, sorted({*grown_group.numbers, *other_obstacles}))
                    if other_obstacles
                    else None
                )
                if wider_group is None or len(wider_group.numbers) > MAX_JOINED_OBSTACLES:
                    break
                grown_group = wider_group
                bend = next(
                    candidate for candidate in self._list_bends(grown_group) if candidate.aside_m * bend.aside_m > 0.0
                )
        if not options:
            return group, None
        _, _, grown_group, bend = min(options, key=lambda option: option[:2])
        return grown_group, bend

    def _list_bends(self, group: _ObstacleGroup) -> Iterable[Bend]:
        """The bends past a group, on its left and on its right."""
        rules = self.rules
        for side in (1.0, -1.0):
            aside = side * group.aside_m
            is_in_way = aside > CLEARANCE_TOLERANCE_M - rules.half_width_m
            low, high = float(group.along_m[is_in_way].min()), float(group.along_m[is_in_way].max())
            deviation_m = float(aside[is_in_way].max()) + rules.half_width_m
            yield Bend(low - rules.nose_m, high + rules.tail_m, side * deviation_m, rules.radius_m)

    def _find_other_obstacles(self, line: Polyline, group: _ObstacleGroup, bend: Bend) -> list[int]:
        """Obstacles outside a group that the machine would touch along its bend."""
        driven_line = shapely.LineString(line.place_points(bend.sample_points()))
        return [number for number in self._find_near_obstacles(driven_line) if number not in group.numbers]

    def _has_room(self, line: Polyline, bend: Bend) -> bool:
        """Whether the machine leaves the workable area no farther along a bend than along the line."""
        driven_lines = (
            line.place_points(bend.sample_points()),
            line.place_points(np.array([[bend.leave_at_m, 0.0], [bend.rejoin_at_m, 0.0]])),
        )
        covered = [
            shapely.LineString(driven_line).buffer(self.rules.half_width_m - CLEARANCE_TOLERANCE_M, cap_style="flat")
            for driven_line in driven_lines
        ]
        outside = [shapely.difference(covered_area, self._workable_area) for covered_area in covered]
        beyond = shapely.difference(outside[0], shapely.buffer(outside[1], CLEARANCE_TOLERANCE_M))
        return bool(beyond.area <= SLACK_M2)


@dataclass(frozen=True, eq=False)
class _ObstacleGroup:
    """Obstacles passed in one bend: their outlines along and beside a line (n,), and the span they block."""

    numbers: tuple[int, ...]
    along_m: Points
    aside_m: Points
    span: Span

    def overlaps_group(self, other_group: _ObstacleGroup) -> bool:
        return bool(set(self.numbers) & set(other_group.numbers))


def _is_overlapping(a: Bend | None, b: Bend | None) -> bool:
    return a is not None and b is not None and a.leave_at_m < b.rejoin_at_m and b.leave_at_m < a.rejoin_at_m


class Polyline:
    """A polyline that converts between points and distances along and beside it."""

    def __init__(self, points: Points) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T)
        self.points = points[np.concatenate([[True], steps > 1e-9])]
        self._distances_m = np.concatenate([[0.0], np.cumsum(steps[steps > 1e-9])])
        self.length_m = float(self._distances_m[-1])
        ends = [self.points[0] - self.points[1], self.points[-1] - self.points[-2]]
        first, last = (EXTENSION_M * end / np.hypot(*end) for end in ends)
        self.extended_points = np.concatenate([[self.points[0] + first], self.points, [self.points[-1] + last]])
        self._extended_distances_m = np.concatenate([[-EXTENSION_M], self._distances_m, [self.length_m + EXTENSION_M]])

    def locate(self, along_m: Points) -> Points:
        """Points at distances along the line, extended straight at its ends, (n, 2)."""
        return np.column_stack(
            [np.interp(along_m, self._extended_distances_m, axis) for axis in self.extended_points.T]
        )

    def compute_normals(self, along_m: Points) -> Points:
        """Unit vectors to the left of the line, (n, 2)."""
        ahead = self.locate(along_m + SMOOTHING_M) - self.locate(along_m - SMOOTHING_M)
        ahead /= np.hypot(*ahead.T)[:, None]
        return np.column_stack([-ahead[:, 1], ahead[:, 0]])

    def project(self, places: Points) -> tuple[Points, Points]:
        """Distances along the line and beside it, to the left, of places (n, 2)."""
        line = shapely.LineString(self.extended_points)
        along = shapely.line_locate_point(line, shapely.points(places)) - EXTENSION_M
        aside = np.einsum("nk,nk->n", places - self.locate(along), self.compute_normals(along))
        return along, aside

    def place_points(self, offset_points: Points) -> Points:
        """Points (n, 2) of a path given along and beside the line."""
        return self.locate(offset_points[:, 0]) + offset_points[:, 1, None] * self.compute_normals(offset_points[:, 0])

    def apply_bends(self, bends: Sequence[Bend]) -> BentLine:
        """The line with its bends."""
        distances_m, point_arrays = [self._distances_m], [self.points]
        is_kept = np.ones(len(self._distances_m), dtype=bool)
        for bend in bends:
            is_kept &= (self._distances_m < bend.leave_at_m - 1e-6) | (self._distances_m > bend.rejoin_at_m + 1e-6)
            bend_points = bend.sample_points()
            if len(self.points) > 2:
                bend_points = _refine_points(bend_points)
            distances_m.append(bend_points[:, 0])
            point_arrays.append(self.place_points(bend_points))
        distances_m[0], point_arrays[0] = self._distances_m[is_kept], self.points[is_kept]
        order = np.argsort(np.concatenate(distances_m), kind="stable")
        return BentLine(np.concatenate(distances_m)[order], np.concatenate(point_arrays)[order])


def _refine_points(offset_points: Points) -> Points:
    """A path along a curved line, with points at every STEP_M."""
    steps = max(2, math.ceil((offset_points[-1, 0] - offset_points[0, 0]) / STEP_M) + 1)
    along = np.unique(
        np.round(
            np.concatenate([offset_points[:, 0], np.linspace(offset_points[0, 0], offset_points[-1, 0], steps)]), 9
        )
    )
    return np.column_stack([along, np.interp(along, offset_points[:, 0], offset_points[:, 1])])


MIN_SWATH_M = 5.0  # least length of the parts of a cut swath
Point = tuple[float, float]


@dataclass(frozen=True, eq=False)
class ObstacleBends:
    """Bent paths along swaths, by the point where a pass of the swath begins, and the bender for other lines.

    Curved swaths have paths here whether or not obstacles stand near them.
    """

    bent_lines: Mapping[Point, BentLine] = field(default_factory=dict)
    bender: LineBender | None = None


def bend_swaths(layout: Layout, bender: LineBender, tool_m: float) -> tuple[Layout, ObstacleBends]:
    """The swaths as they can be driven among the obstacles of a bender, in either direction.

    A pass is driven `tool_m` past the end of its swath. A swath that cannot be bent in both directions ends before the
    obstacle, with room to turn aside or that of a headland if it is less, and continues as far behind it. Where that
    leaves none, all stay as they are laid: work lines are cut to where the body has room.
    """
    swaths: list[Swath] = []
    bent_lines: dict[Point, BentLine] = {}
    room_m = min(layout.headland_m, bender.rules.turning_room_m)
    for swath in layout.swaths:
        for piece in _cut_swath(swath, bender, tool_m, room_m, bent_lines):
            number = swaths[-1].piece + 1 if swaths and swaths[-1].line == swath.line else 0
            swaths.append(replace(piece, piece=number))
    if not swaths:
        return layout, ObstacleBends({}, bender)
    return replace(layout, swaths=tuple(swaths)), ObstacleBends(bent_lines, bender)


def follow_curved_swaths(layout: Layout, tool_m: float) -> ObstacleBends:
    """The paths along the curved swaths of a layout without small obstacles."""
    return ObstacleBends(
        {
            start: Polyline(_build_driven_line(swath, direction, tool_m)).apply_bends([])
            for swath in layout.swaths
            if swath.via_m
            for start, direction in ((swath.start_m, 1), (swath.end_m, -1))
        }
    )


def find_clear_parts(points: Points, bender: LineBender) -> list[tuple[Points, float]] | None:
    """The parts of a polyline (n, 2) that can be driven, bent, with their lengths along it; None if all of it can."""
    polyline = Polyline(points)
    bent_line, blocked_spans = bender.bend_polyline(points)
    if bent_line is None and not blocked_spans:
        return None
    driven_line = bent_line or polyline.apply_bends([])
    clear_spans = (
        list(_find_clear_spans(blocked_spans, polyline.length_m, bender.rules.turning_room_m))
        if blocked_spans
        else [(0.0, polyline.length_m)]
    )
    return [(driven_line.cut_between(first, last), last - first) for first, last in clear_spans]


def _cut_swath(
    swath: Swath, bender: LineBender, tool_m: float, room_m: float, bent_lines: dict[Point, BentLine]
) -> Iterator[Swath]:
    """The parts of a swath that can be driven, from its start on; adds bent paths to `bent_lines`."""
    bend_results = [bender.bend_polyline(_build_driven_line(swath, direction, tool_m)) for direction in (1, -1)]
    blocked_spans = [
        *bend_results[0][1],
        *((swath.length_m - high, swath.length_m - low) for low, high in bend_results[1][1]),
    ]
    if blocked_spans:
        for first, last in _find_clear_spans(blocked_spans, swath.length_m, room_m):
            yield from _cut_swath(_cut_part(swath, first, last), bender, tool_m, room_m, bent_lines)
        return
    for start, direction, (bent_line, _) in zip((swath.start_m, swath.end_m), (1, -1), bend_results, strict=True):
        if bent_line is None and swath.via_m:
            bent_line = Polyline(_build_driven_line(swath, direction, tool_m)).apply_bends([])
        if bent_line is not None:
            bent_lines[start] = bent_line
    yield swath


def _build_driven_line(swath: Swath, direction: int, tool_m: float) -> np.ndarray:
    """What the guided point drives along a swath without obstacles, (n, 2): straight on beyond its end."""
    points = swath.points_m[::direction]
    ahead = points[-1] - points[-2]
    return np.concatenate([points[:-1], [points[-1] + ahead * tool_m / math.hypot(*ahead)]])


def _find_clear_spans(spans: list[Span], length_m: float, room_m: float) -> Iterator[Span]:
    """The parts of a length outside the spans and the room for turning on either side of them."""
    first = 0.0
    for low, high in sorted(spans):
        if low - room_m - first >= MIN_SWATH_M:
            yield first, low - room_m
        first = max(first, high + room_m)
    if length_m - first >= MIN_SWATH_M:
        yield first, length_m


def _cut_part(swath: Swath, first_m: float, last_m: float) -> Swath:
    """A swath between two distances along it."""
    if swath.via_m:
        points = Polyline(swath.points_m).apply_bends([]).cut_between(first_m, last_m).tolist()
    else:
        ends = np.array([swath.start_m, swath.end_m])
        ahead = (ends[1] - ends[0]) / swath.length_m
        points = [(ends[0] + first_m * ahead).tolist(), (ends[0] + last_m * ahead).tolist()]
    start = swath.start_m if first_m <= 0.0 else (points[0][0], points[0][1])
    end = swath.end_m if last_m >= swath.length_m else (points[-1][0], points[-1][1])
    return replace(swath, start_m=start, end_m=end, via_m=tuple((x, y) for x, y in points[1:-1]))
