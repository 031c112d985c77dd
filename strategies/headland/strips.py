"""The sides of headland passes as the guided point drives them, with the implement down.

The implement works behind the guided point, so a side ends when the tractor is past its corner. A square corner is
worked whole: on, up, back, round and back again, down. A round one is driven through with the implement down.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt
import shapely

from strategies.headland.corners import (
    build_corner_arc,
    compute_missed_m2,
    compute_tangent_m,
    compute_worked_reach_m,
)
from strategies.headland.pass_shares import HeadlandSegment
from strategies.headland.raised_paths import find_quickest_turn
from strategies.names import ROUND_CORNERS, SQUARE_CORNERS
from strategies.path_planning.obstacle_avoidance import find_clear_parts
from strategies.path_planning.paths import DrivePath, Pose
from strategies.program.field_job import FieldJob
from strategies.program.legs import PATH_STEP_M
from vehicle.missions.plan import HEADLAND_PASS, MAX_JOINT_GAP_M, LegTask

Points = npt.NDArray[np.float64]

MIN_SIDE_M = 2.0  # a shorter side is worked by the corners at its ends
ARC_RADIUS_FACTORS = (1.0, 1.15, 1.35, 1.7)  # times the planned radius: wider arcs swing out less
PULL_BACK_STEP_M = 0.25  # steps in which the end of a side is pulled back into the field


@dataclass(frozen=True, eq=False)
class HeadlandStrip:
    """A segment as the guided point drives it (n, 2), and whether arcs with the implement down lead to and from it."""

    points: Points
    task: LegTask
    length_m: float
    joined_in: bool
    joined_out: bool


def build_strips(job: FieldJob, share: Sequence[HeadlandSegment]) -> list[HeadlandStrip]:
    """The segments of a share as they are driven; those that their corners already work are left out."""
    arcs = [_choose_arc(job, a, b) for a, b in pairwise(share)]
    strips = []
    for index, segment in enumerate(share):
        arc_in, arc_out = arcs[index - 1] if index else None, arcs[index] if index < len(arcs) else None
        first, last = _find_working_extent_m(job, segment)
        side = segment.headland_pass.sides[segment.side]
        if arc_in is not None:
            first = arc_in.touch_m
        if arc_out is not None:
            last = side.length_m - arc_out.touch_m
        if last - first < MIN_SIDE_M and arc_in is None and arc_out is None:
            continue
        points = cut_polyline(segment.line, first, last)
        if arc_out is not None:
            points = np.concatenate([points, *(run[1:] for _, run in arc_out.path.sample(PATH_STEP_M))])
        task = LegTask(HEADLAND_PASS, segment.headland_pass.number, _number_side(job, segment))
        strips += _bend_strip(
            job, HeadlandStrip(points, task, segment.length_m, arc_in is not None, arc_out is not None)
        )
    return _part_cut_strips(strips)


def _part_cut_strips(strips: list[HeadlandStrip]) -> list[HeadlandStrip]:
    """The strips as joined only where they meet: obstacles may have cut off the arc between two."""
    meet = [
        a.joined_out and b.joined_in and math.dist(a.points[-1], b.points[0]) <= MAX_JOINT_GAP_M
        for a, b in pairwise(strips)
    ]
    return [
        replace(strip, joined_in=joined_in, joined_out=joined_out)
        for strip, joined_in, joined_out in zip(strips, [False, *meet], [*meet, False], strict=False)
    ]


def _bend_strip(job: FieldJob, strip: HeadlandStrip) -> list[HeadlandStrip]:
    """A strip bent round small obstacles; in pieces where there is no room for that."""
    if job.obstacle_bends.bender is None:
        return [strip]
    parts = find_clear_parts(strip.points, job.obstacle_bends.bender)
    if parts is None:
        return [strip]
    last = len(parts) - 1
    return [
        HeadlandStrip(points, strip.task, length_m, strip.joined_in and index == 0, strip.joined_out and index == last)
        for index, (points, length_m) in enumerate(parts)
    ]


def _number_side(job: FieldJob, segment: HeadlandSegment) -> int:
    """Number of a side among all sides of passes with the same number, the same in whichever direction it is driven."""
    same_number = [
        headland_pass for headland_pass in job.headland_passes if headland_pass.number == segment.headland_pass.number
    ]
    sides_before = sum(
        len(headland_pass.sides) for headland_pass in same_number if headland_pass.ring < segment.headland_pass.ring
    )
    headland_pass = next(
        (headland_pass for headland_pass in same_number if headland_pass.ring == segment.headland_pass.ring),
        segment.headland_pass,
    )
    ends = segment.headland_pass.sides[segment.side].points[[0, -1]]
    is_reversed = not np.array_equal(headland_pass.sides[segment.side].points[[0, -1]], ends)
    return sides_before + (len(headland_pass.sides) - 1 - segment.side if is_reversed else segment.side)


def _find_working_extent_m(job: FieldJob, segment: HeadlandSegment) -> tuple[float, float]:
    """Where the guided point is along a side when the implement is lowered and lifted, within the field (m)."""
    side, line = segment.headland_pass.sides[segment.side], segment.line
    first, last = _compute_whole_extent_m(job, segment)
    while last > side.length_m and not _has_room(job, line, last):
        last -= PULL_BACK_STEP_M
    while first < 0.0 and not _has_room(job, line, first):
        first += PULL_BACK_STEP_M
    if job.fence is not None:
        middle = 0.5 * side.length_m
        while last > middle and job.fence.has_pose_contact(_get_pose_at(line, last)):
            last -= PULL_BACK_STEP_M
        while first < middle and job.fence.has_pose_contact(_get_pose_at(line, first)):
            first += PULL_BACK_STEP_M
    if job.open_edge is None:
        return first, last
    return _pull_off_edge_m(job, segment, first, 1), _pull_off_edge_m(job, segment, last, -1)


def _compute_whole_extent_m(job: FieldJob, segment: HeadlandSegment) -> tuple[float, float]:
    """Where the guided point is along a side when the implement must be lowered and lifted to miss no ground (m)."""
    side, width_m, tool_m = segment.headland_pass.sides[segment.side], job.layout.width_m, job.driving_rules.tool_m
    first, last = segment.first_m, segment.last_m
    if first is None:
        first = compute_worked_reach_m(side.start_turn_rad, width_m)[1]
    if last is None:
        last = side.length_m + compute_worked_reach_m(side.end_turn_rad, width_m)[0]
    return first + tool_m, last + tool_m


def _pull_off_edge_m(job: FieldJob, segment: HeadlandSegment, distance_m: float, direction: int) -> float:
    """The place nearest to one on a side, in a direction along it, where nothing reaches too far over an open edge (m).

    The place itself where nothing is gained within two lengths of the machine or half the side.
    """
    assert job.open_edge is not None
    room_m = min(2.0 * job.open_edge.body.reach_m, 0.5 * segment.headland_pass.sides[segment.side].length_m)
    for step in range(int(room_m / PULL_BACK_STEP_M) + 1):
        pulled_m = distance_m + direction * step * PULL_BACK_STEP_M
        if not job.open_edge.has_pose_contact(_get_pose_at(segment.line, pulled_m)):
            return pulled_m
    return distance_m


def _has_room(job: FieldJob, line: Points, distance_m: float) -> bool:
    return bool(
        shapely.covers((job.rim_connector or job.connector).free, shapely.Point(_get_point_at(line, distance_m)))
    )


def _get_pose_at(line: Points, distance_m: float) -> Pose:
    """Pose at a distance along a polyline, extended straight beyond its ends."""
    return get_end_pose(cut_polyline(line, distance_m - PULL_BACK_STEP_M, distance_m), -1)


@dataclass(frozen=True)
class _Arc:
    """An arc round a corner with the implement down, where it leaves the sides, and what it costs.

    The costs (s) are those of driving it and of finishing the ground it misses, less those of the sides from where it
    leaves them to their corner.
    """

    path: DrivePath
    touch_m: float
    cost_s: float


def _choose_arc(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> _Arc | None:
    """The arc that joins two segments with the implement down; None where their corner is square."""
    if job.corners == SQUARE_CORNERS or not _is_corner_between(a, b):
        return None
    radius_m = job.driving_rules.radius_m
    arcs = [arc for factor in ARC_RADIUS_FACTORS if (arc := _build_arc(job, a, b, factor * radius_m)) is not None]
    best = min(arcs, key=lambda arc: round(arc.cost_s, 6), default=None)
    if best is None or job.corners == ROUND_CORNERS:
        return best
    return best if round(best.cost_s, 6) <= round(_compute_square_cost_s(job, a, b), 6) else None


def _is_corner_between(a: HeadlandSegment, b: HeadlandSegment) -> bool:
    """Whether a segment ends at a corner of its pass where another begins."""
    is_same_pass = (a.headland_pass.number, a.headland_pass.ring) == (b.headland_pass.number, b.headland_pass.ring)
    if not is_same_pass or a.last_m is not None or b.first_m is not None or a.has_no_corner:
        return False
    return (a.side + 1) % len(a.headland_pass.sides) == b.side


def _build_arc(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment, radius_m: float) -> _Arc | None:
    """The arc of a radius between two segments that meet at a corner; None if it does not fit."""
    side, after = a.headland_pass.sides[a.side], b.headland_pass.sides[b.side]
    touch_m = compute_tangent_m(side.end_turn_rad, radius_m)
    ends = [math.dist(*side.points[-2:]), math.dist(*after.points[:2])]
    if touch_m > min(ends) or touch_m > 0.5 * min(side.length_m, after.length_m):
        return None
    x, y, heading = get_end_pose(side.points, -1)
    path = build_corner_arc((x, y), heading, side.end_turn_rad, radius_m)
    if not job.connector.fits(path) or job.has_overhang(path):
        return None
    is_inside = a.headland_pass.number > 1
    missed_m2 = compute_missed_m2(side.end_turn_rad, job.layout.width_m, radius_m, inside_round=is_inside)
    driven_s = job.connector.costs.compute_time_s(path) - 2.0 * touch_m / job.driving_rules.work_speed_mps
    return _Arc(path, touch_m, driven_s + missed_m2 * job.finishing_rate_s_per_m2)


def _compute_square_cost_s(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> float:
    """What a square corner costs (s), as that of an arc; infinite if no path leads through it that may be driven."""
    side, rules = a.headland_pass.sides[a.side], job.driving_rules
    last, first = _find_working_extent_m(job, a)[1], _find_working_extent_m(job, b)[0]
    path = find_quickest_turn(job, _get_pose_at(a.line, last), _get_pose_at(b.line, first))
    if path is None or job.has_overhang(path):
        return math.inf
    missed_m = _compute_whole_extent_m(job, a)[1] - last + first - _compute_whole_extent_m(job, b)[0]
    driven_s = (last - side.length_m - first) / rules.work_speed_mps + job.connector.costs.compute_time_s(path)
    return driven_s + missed_m * job.layout.width_m * job.finishing_rate_s_per_m2


def _get_point_at(line: Points, distance_m: float) -> tuple[float, float]:
    x, y = cut_polyline(line, distance_m, distance_m)[0]
    return float(x), float(y)


def cut_polyline(line: Points, first_m: float, last_m: float) -> Points:
    """A polyline (n, 2) between two distances along it, extended straight where they lie beyond its ends."""
    steps = np.hypot(*np.diff(line, axis=0).T)
    line = line[np.concatenate(([True], steps > 1e-9))]
    steps = steps[steps > 1e-9]
    distances_m = np.concatenate(([0.0], np.cumsum(steps)))
    ends = []
    for distance_m in (first_m, last_m):
        k = int(np.clip(np.searchsorted(distances_m, distance_m) - 1, 0, len(steps) - 1))
        ends.append(line[k] + (distance_m - distances_m[k]) / steps[k] * (line[k + 1] - line[k]))
    between = line[(distances_m > first_m + 1e-6) & (distances_m < last_m - 1e-6)]
    return np.concatenate([ends[:1], between, ends[1:]])


def get_end_pose(points: Points, end: int) -> Pose:
    """Pose at the first (0) or the last (-1) point of a polyline, facing along it."""
    a, b = (points[0], points[1]) if end == 0 else (points[-2], points[-1])
    x, y = points[end]
    return float(x), float(y), math.atan2(b[1] - a[1], b[0] - a[0])
