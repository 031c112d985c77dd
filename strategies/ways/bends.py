"""Tracks and rounds bent round small obstacles with the implement down.

The line is left in two arcs and a straight between them, the obstacle passed on the side that asks for less, and the
line taken up again the same way:

    deviation d, radius R     angle a = arccos(1 - d / 2R), at most STEEPEST
    straight between arcs     c = (d - 2R (1 - cos a)) / sin a
    along the line            2R sin a + c cos a
    driven                    2R a + c

The whole deviation is kept from where the nose comes up to the obstacle until the implement is past it. What leaves no
room for that is told, so that a track is cut there.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import shapely

Points = npt.NDArray[np.float64]
Span = tuple[float, float]

STEEPEST = math.radians(45.0)
STEP_M = 0.25
OUTLINE_M = 0.5  # steps along the outline of an obstacle
SMOOTH_M = 1.5  # a round's heading is looked at so far to either side
BEYOND_M = 40.0  # lines are drawn on so far, to see what stands near their ends
SLACK_M2 = 0.1  # of ground outside the field or taken by something else, rounding
CLEAR_M = 0.01
MOST_JOINED = 12


@dataclass(frozen=True)
class BendRules:
    """Radius of the arcs, and what the machine reaches from its guided point: to either side, ahead and behind (m)."""

    radius_m: float
    half_m: float
    nose_m: float
    tail_m: float


@dataclass(frozen=True)
class Bend:
    """A deviation from a line: kept from `begin_m` to `end_m` along it, positive to the left (m)."""

    begin_m: float
    end_m: float
    aside_m: float
    radius_m: float

    @property
    def angle_rad(self) -> float:
        """By how much the heading leaves that of the line."""
        return min(math.acos(max(1.0 - abs(self.aside_m) / (2.0 * self.radius_m), 0.0)), STEEPEST)

    @property
    def straight_m(self) -> float:
        """Length of the straight between two arcs."""
        left = abs(self.aside_m) - 2.0 * self.radius_m * (1.0 - math.cos(self.angle_rad))
        return max(left, 0.0) / math.sin(self.angle_rad)

    @property
    def lead_m(self) -> float:
        """Distance along the line in which it is left, or taken up again."""
        return 2.0 * self.radius_m * math.sin(self.angle_rad) + self.straight_m * math.cos(self.angle_rad)

    @property
    def first_m(self) -> float:
        """Where the line is left."""
        return self.begin_m - self.lead_m

    @property
    def last_m(self) -> float:
        """Where it is taken up again."""
        return self.end_m + self.lead_m

    @property
    def longer_m(self) -> float:
        """By how much the way is longer than the line."""
        return 2.0 * (2.0 * self.radius_m * self.angle_rad + self.straight_m - self.lead_m)

    def points(self) -> Points:
        """Distance along the line and aside of it, (n, 2), from where it is left to where it is taken up again."""
        angle, radius = self.angle_rad, self.radius_m
        turn = np.linspace(0.0, angle, max(2, math.ceil(radius * angle / STEP_M) + 1))
        arc = radius * np.column_stack([np.sin(turn), 1.0 - np.cos(turn)])
        lead = np.array([self.lead_m, abs(self.aside_m)])
        leave = np.concatenate([arc, (lead - arc)[::-1]])
        back = np.array([self.last_m, 0.0]) + np.array([-1.0, 1.0]) * leave[::-1]
        way = np.concatenate([np.array([self.first_m, 0.0]) + leave, back])
        way[:, 1] *= math.copysign(1.0, self.aside_m)
        keep = np.concatenate([[True], np.diff(way[:, 0]) > 1e-6])
        return np.asarray(way[keep])


@dataclass(frozen=True, eq=False)
class Bent:
    """A way along a line: its points (n, 2), and how far along the line each of them is (n,), rising (m)."""

    along_m: Points
    points: Points

    def between(self, first_m: float, last_m: float) -> Points:
        """The way between two distances along the line, (k, 2)."""
        inside = (self.along_m > first_m + 1e-6) & (self.along_m < last_m - 1e-6)
        ends = np.array([[np.interp(at, self.along_m, axis) for axis in self.points.T] for at in (first_m, last_m)])
        return np.concatenate([ends[:1], self.points[inside], ends[1:]])


class Bender:
    """Bends lines round obstacles (polygons, their margin included) inside a room (the ground that may be worked)."""

    def __init__(self, obstacles: Sequence[shapely.Polygon], room: shapely.Geometry, rules: BendRules) -> None:
        self.rules = rules
        self._obstacles = np.array(obstacles, dtype=np.object_)
        self._tree = shapely.STRtree(self._obstacles)
        self._outlines = [shapely.get_coordinates(shapely.segmentize(each, OUTLINE_M)) for each in obstacles]
        self._room = room
        shapely.prepare(room)

    def bent(self, points: Points) -> tuple[Bent | None, list[Span]]:
        """The way along a polyline (n, 2) that keeps clear; None where it is the polyline itself.

        With it the stretches, along the polyline and apart from each other, where obstacles leave no room for a bend.
        """
        line = Line(points)
        near = self._near(shapely.LineString(line.drawn_on), 0.0)
        if not near:
            return None, []
        groups = [group for number in near if (group := self._places(line, [number])) is not None]
        if not groups:
            return None, []
        bends, blocked = self._sorted_out(line, groups)
        return (line.bent(bends) if bends else None), blocked

    def _near(self, line: shapely.Geometry, more_m: float) -> list[int]:
        """Numbers of the obstacles that the machine would touch along a line."""
        found = self._tree.query(line, predicate="dwithin", distance=self.rules.half_m + more_m - CLEAR_M)
        return sorted(int(number) for number in found)

    def _places(self, line: Line, numbers: list[int]) -> _Group | None:
        """A group of obstacles as seen from a line; None where nothing of it is in the way."""
        along, aside = line.seen(np.concatenate([self._outlines[number] for number in numbers]))
        inside = np.abs(aside) < self.rules.half_m - CLEAR_M
        if not inside.any():
            return None
        low, high = float(along[inside].min()), float(along[inside].max())
        if high + self.rules.tail_m <= 0.0 or low - self.rules.nose_m >= line.length_m:
            return None
        return _Group(tuple(numbers), along, aside, (low, high))

    def _sorted_out(self, line: Line, groups: list[_Group]) -> tuple[list[Bend], list[Span]]:
        """Bends, none of which meets another, and the spans of groups that there is no bend for."""
        done: list[tuple[_Group, Bend | None]] = []
        waiting = sorted(groups, key=lambda group: group.span)
        while waiting:
            group = waiting.pop(0)
            group, bend = self._best(line, group)
            met = [pair for pair in done if pair[0].meets(group) or _overlap(pair[1], bend)]
            done = [pair for pair in done if not any(pair is other for other in met)]
            numbers = sorted({*group.numbers, *(number for pair in met for number in pair[0].numbers)})
            joined = self._places(line, numbers) if len(numbers) > len(group.numbers) else None
            if joined is None:
                done.append((group, bend))
            elif len(numbers) > MOST_JOINED:
                done.append((joined, None))
            else:
                waiting.insert(0, joined)
        blocked = sorted(group.span for group, bend in done if bend is None)
        return [bend for _, bend in sorted(done, key=lambda pair: pair[0].span) if bend is not None], blocked

    def _best(self, line: Line, group: _Group) -> tuple[_Group, Bend | None]:
        """The bend with the least deviation that has room; it may take in what stands where the line is left for."""
        options: list[tuple[float, int, _Group, Bend]] = []
        for bend in self._bends(group):
            grown = group
            while bend.first_m >= 0.0 and bend.last_m <= line.length_m:
                others = self._others(line, grown, bend)
                if not others and self._has_room(line, bend):
                    options.append((round(abs(bend.aside_m), 6), len(options), grown, bend))
                wider = self._places(line, sorted({*grown.numbers, *others})) if others else None
                if wider is None or len(wider.numbers) > MOST_JOINED:
                    break
                grown = wider
                bend = next(each for each in self._bends(grown) if each.aside_m * bend.aside_m > 0.0)
        if not options:
            return group, None
        _, _, grown, bend = min(options, key=lambda option: option[:2])
        return grown, bend

    def _bends(self, group: _Group) -> Iterable[Bend]:
        """Past a group on its left and on its right."""
        rules = self.rules
        for side in (1.0, -1.0):
            aside = side * group.aside
            there = aside > CLEAR_M - rules.half_m
            low, high = float(group.along[there].min()), float(group.along[there].max())
            deviation = float(aside[there].max()) + rules.half_m
            yield Bend(low - rules.nose_m, high + rules.tail_m, side * deviation, rules.radius_m)

    def _others(self, line: Line, group: _Group, bend: Bend) -> list[int]:
        """Obstacles of no part in a group that the machine would touch along its bend."""
        way = shapely.LineString(line.placed(bend.points()))
        return [number for number in self._near(way, 0.0) if number not in group.numbers]

    def _has_room(self, line: Line, bend: Bend) -> bool:
        """Whether the machine leaves the room no farther along a bend than it would along the line."""
        ways = line.placed(bend.points()), line.placed(np.array([[bend.first_m, 0.0], [bend.last_m, 0.0]]))
        swaths = [shapely.LineString(way).buffer(self.rules.half_m - CLEAR_M, cap_style="flat") for way in ways]
        outside = [shapely.difference(swath, self._room) for swath in swaths]
        beyond = shapely.difference(outside[0], shapely.buffer(outside[1], CLEAR_M))
        return bool(beyond.area <= SLACK_M2)


@dataclass(frozen=True, eq=False)
class _Group:
    """Obstacles passed in one bend: their outlines along and aside of a line (n,), and what of it they take."""

    numbers: tuple[int, ...]
    along: Points
    aside: Points
    span: Span

    def meets(self, other: _Group) -> bool:
        return bool(set(self.numbers) & set(other.numbers))


def _overlap(a: Bend | None, b: Bend | None) -> bool:
    return a is not None and b is not None and a.first_m < b.last_m and b.first_m < a.last_m


class Line:
    """A polyline with what lies along and aside of it."""

    def __init__(self, points: Points) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T)
        self.points = points[np.concatenate([[True], steps > 1e-9])]
        self._place = np.concatenate([[0.0], np.cumsum(steps[steps > 1e-9])])
        self.length_m = float(self._place[-1])
        ends = [self.points[0] - self.points[1], self.points[-1] - self.points[-2]]
        first, last = (BEYOND_M * end / np.hypot(*end) for end in ends)
        self.drawn_on = np.concatenate([[self.points[0] + first], self.points, [self.points[-1] + last]])
        self._along = np.concatenate([[-BEYOND_M], self._place, [self.length_m + BEYOND_M]])

    def at(self, along: Points) -> Points:
        """Points at distances along the line, drawn on straight at its ends, (n, 2)."""
        return np.column_stack([np.interp(along, self._along, axis) for axis in self.drawn_on.T])

    def normal(self, along: Points) -> Points:
        """Unit vectors to the left of the line, (n, 2)."""
        ahead = self.at(along + SMOOTH_M) - self.at(along - SMOOTH_M)
        ahead /= np.hypot(*ahead.T)[:, None]
        return np.column_stack([-ahead[:, 1], ahead[:, 0]])

    def seen(self, places: Points) -> tuple[Points, Points]:
        """How far along and aside of the line, to the left, places (n, 2) are."""
        line = shapely.LineString(self.drawn_on)
        along = shapely.line_locate_point(line, shapely.points(places)) - BEYOND_M
        aside = np.einsum("nk,nk->n", places - self.at(along), self.normal(along))
        return along, aside

    def placed(self, way: Points) -> Points:
        """Points (n, 2) of a way given along and aside of the line."""
        return self.at(way[:, 0]) + way[:, 1, None] * self.normal(way[:, 0])

    def bent(self, bends: Sequence[Bend]) -> Bent:
        """The line with bends in place of what they leave of it."""
        along, points = [self._place], [self.points]
        keep = np.ones(len(self._place), dtype=bool)
        for bend in bends:
            keep &= (self._place < bend.first_m - 1e-6) | (self._place > bend.last_m + 1e-6)
            way = bend.points()
            if len(self.points) > 2:
                way = _finer(way)
            along.append(way[:, 0])
            points.append(self.placed(way))
        along[0], points[0] = self._place[keep], self.points[keep]
        order = np.argsort(np.concatenate(along), kind="stable")
        return Bent(np.concatenate(along)[order], np.concatenate(points)[order])


def _finer(way: Points) -> Points:
    """A way along a curved line, with points at every step of it."""
    steps = max(2, math.ceil((way[-1, 0] - way[0, 0]) / STEP_M) + 1)
    along = np.unique(np.round(np.concatenate([way[:, 0], np.linspace(way[0, 0], way[-1, 0], steps)]), 9))
    return np.column_stack([along, np.interp(along, way[:, 0], way[:, 1])])
