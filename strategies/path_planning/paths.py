"""Drivable paths made of straights and circular arcs, and the lane through an entrance.

A path is a start pose and a list of segments of constant curvature, driven forwards or in reverse. Everything here is
exact geometry: nothing is sampled until a caller asks for a polyline.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.ops import nearest_points

from fields.arrays import DIRECTION_STEP, build_directions, round_to_steps
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.primitives import SNAP, TAU

Pose = tuple[float, float, float]
"""x (m, east), y (m, north) and the heading of the vehicle as a mathematical angle (rad, ccw from x)."""

Points = NDArray[np.float64]

PATH_KINDS = ("route", "u", "omega", "switch-back")
_SAME_POSE_DIGITS = 3  # relative poses are told apart to a millimetre or microradian
EDGE_INSET_M = 0.2  # paths begin and end this far inside the outline, so that nobody stops beyond it


@dataclass(frozen=True, slots=True)
class PathSegment:
    """One piece of constant curvature: length_m >= 0, curvature in 1/m, gear +1 forward or -1 reverse.

    Positive curvature turns left (ccw) while driving forward; driven in reverse the same curvature turns the heading
    clockwise.
    """

    length_m: float
    curvature: float
    gear: int


@dataclass(frozen=True, slots=True)
class DrivePath:
    """A start pose followed by segments; `kind` is "u", "omega", "switch-back" or "route"."""

    start: Pose
    segments: tuple[PathSegment, ...]
    kind: str

    def to_rows(self) -> Points:
        """Its segments as rows of length, curvature and gear (n, 3), as the compiled search uses them."""
        pieces = [(segment.length_m, segment.curvature, float(segment.gear)) for segment in self.segments]
        return np.array(pieces, float).reshape(-1, 3)

    @property
    def length_m(self) -> float:
        """Driven length, forward and reverse together (m)."""
        return math.fsum(s.length_m for s in self.segments)

    @property
    def reverse_m(self) -> float:
        """Length driven in reverse (m)."""
        return math.fsum(s.length_m for s in self.segments if s.gear < 0)

    @property
    def reversals(self) -> int:
        """Number of gear changes inside the path."""
        return sum(p.gear != q.gear for p, q in zip(self.segments, self.segments[1:], strict=False))

    @property
    def end(self) -> Pose:
        """Pose at the end of the last segment."""
        pose = self.start
        for segment in self.segments:
            pose = advance_along_segment(pose, segment)
        return pose

    def list_segment_starts(self) -> Iterator[Pose]:
        """Pose at the start of every segment."""
        pose = self.start
        for segment in self.segments:
            yield pose
            pose = advance_along_segment(pose, segment)

    def sample(self, step_m: float = 0.25) -> list[tuple[int, Points]]:
        """One polyline per run of equal gear, as (gear, points of shape (n, 2)), at most step_m apart.

        Ends of segments are met exactly, and each polyline begins where the one before ended. A path without segments
        has no polylines. Raises StrategyError if step_m is not positive.
        """
        if not step_m > 0.0:
            raise StrategyError(f"Sampling step {step_m} m must be above zero; use for instance 0.25.")
        runs: list[tuple[int, list[Points]]] = []
        for pose, segment in zip(self.list_segment_starts(), self.segments, strict=True):
            points = sample_arc(pose, segment, max(1, math.ceil(segment.length_m / step_m - 1e-9)))
            if runs and runs[-1][0] == segment.gear:
                runs[-1][1].append(points[1:])
            else:
                runs.append((segment.gear, [points]))
        return [(gear, np.concatenate(pieces)) for gear, pieces in runs]


def advance_along_segment(pose: Pose, segment: PathSegment) -> Pose:
    """Pose after driving the whole segment from `pose`; the heading comes back in [-pi, pi]."""
    x, y, heading = pose
    run = segment.gear * segment.length_m
    half = 0.5 * segment.curvature * run
    chord = run * (math.sin(half) / half if half else 1.0)
    angle = heading + half
    return (
        x + chord * math.cos(angle),
        y + chord * math.sin(angle),
        math.remainder(heading + 2.0 * half, TAU),
    )


def sample_arc(pose: Pose, segment: PathSegment, pieces: int) -> Points:
    """Points that cut the segment driven from `pose` into equal pieces, shape (pieces + 1, 2)."""
    run = np.linspace(0.0, segment.gear * segment.length_m, pieces + 1)
    half = 0.5 * segment.curvature * run
    chord = run * round_to_steps(np.sinc(half / math.pi), DIRECTION_STEP) if segment.curvature else run
    return np.array(pose[:2]) + chord[:, None] * build_directions(pose[2] + half)


def merge_segments(start: Pose, segments: Iterable[PathSegment], kind: str) -> DrivePath:
    """A path without empty segments, with neighbours of equal curvature and gear merged."""
    merged: list[PathSegment] = []
    for segment in segments:
        if segment.length_m <= SNAP:
            continue
        last = merged[-1] if merged else None
        if last and last.curvature == segment.curvature and last.gear == segment.gear:
            merged[-1] = PathSegment(last.length_m + segment.length_m, last.curvature, last.gear)
        else:
            merged.append(segment)
    return DrivePath(start, tuple(merged), kind)


def shift_pose_ahead(pose: Pose, distance_m: float) -> Pose:
    """The pose straight ahead of `pose` (behind it when the distance is negative)."""
    x, y, heading = pose
    return x + distance_m * math.cos(heading), y + distance_m * math.sin(heading), heading


def place_in_frame(a: Pose, b: Pose) -> tuple[float, float, float]:
    """Pose b as seen from pose a, to a millimetre and a microradian."""
    dx, dy, cosine, sine = b[0] - a[0], b[1] - a[1], math.cos(a[2]), math.sin(a[2])
    turn = math.remainder(b[2] - a[2], 2.0 * math.pi)
    x, y = dx * cosine + dy * sine, dy * cosine - dx * sine
    return round(x, _SAME_POSE_DIGITS), round(y, _SAME_POSE_DIGITS), round(turn, 2 * _SAME_POSE_DIGITS)


def build_path_from_rows(start: Pose, rows: Points, kind: str) -> DrivePath:
    """A path from a pose by its segments (n, 3): length m, curvature 1/m, gear; those of no length are left out."""
    segments = (PathSegment(length, curvature, 1 if gear > 0.0 else -1) for length, curvature, gear in rows.tolist())
    return merge_segments(start, segments, kind)


@dataclass(frozen=True)
class EntranceLane:
    """The lane through the entrance: where the guided point comes in, just inside the outline, and straight on for
    `lead_m` to where the body has room for turns."""

    in_pose: Pose
    lead_m: float

    @property
    def out_pose(self) -> Pose:
        """Where a tractor leaves, heading out."""
        x, y, heading = self.in_pose
        return x, y, math.remainder(heading + math.pi, 2.0 * math.pi)


def build_entrance_lane(
    outline: shapely.Polygon, free: shapely.Geometry, entrance: tuple[float, float]
) -> EntranceLane:
    """The lane at an entrance on the outline, or where the outline is nearest to it.

    It heads for the nearest place in `free`, where the guided point may be.
    """
    edge = nearest_points(outline.exterior, shapely.Point(entrance))[0]
    goal = nearest_points(free, edge)[0]
    off_m = math.dist((goal.x, goal.y), (edge.x, edge.y))
    pose = (float(edge.x), float(edge.y), math.atan2(goal.y - edge.y, goal.x - edge.x))
    inset_m = min(EDGE_INSET_M, 0.5 * off_m)
    return EntranceLane(shift_pose_ahead(pose, inset_m), off_m - inset_m)
