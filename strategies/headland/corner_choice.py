"""How headland passes turn at corners: square, in an arc with the implement down, or past a short side.

Costs are the seconds of driving and of finishing the ground that is missed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

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
from strategies.path_planning.paths import DrivePath, Pose
from strategies.path_planning.turn_kinds import ROUND_CORNERS, SQUARE_CORNERS
from strategies.program.field_job import FieldJob

Points = npt.NDArray[np.float64]

ARC_RADIUS_FACTORS = (1.0, 1.15, 1.35, 1.7)  # times the planned radius: wider arcs swing out less
ARC_STEP_M = 0.25  # between the points of an arc whose strip is compared
SHORT_SIDE_RADII = 2.5  # planned radii: shorter sides may be passed by one arc
MIN_ARC_SINE = 0.05  # lines that cross at a smaller angle are not joined by an arc
PULL_BACK_STEP_M = 0.25  # steps in which the end of a side is pulled back into the field


def find_working_extent_m(job: FieldJob, segment: HeadlandSegment) -> tuple[float, float]:
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
    first = compute_worked_reach_m(side.start_turn_rad, width_m)[1]
    last = side.length_m + compute_worked_reach_m(side.end_turn_rad, width_m)[0]
    return first + tool_m, last + tool_m


def _pull_off_edge_m(job: FieldJob, segment: HeadlandSegment, distance_m: float, direction: int) -> float:
    """The place nearest to one on a side, in a direction along it, where nothing reaches too far over an open edge (m).

    The place itself where nothing is gained within two lengths of the machine or half the side. A short side may be
    left altogether.
    """
    assert job.open_edge is not None
    room_m, side_m = 2.0 * job.open_edge.body.reach_m, segment.headland_pass.sides[segment.side].length_m
    if side_m > SHORT_SIDE_RADII * job.driving_rules.radius_m:
        room_m = min(room_m, 0.5 * side_m)
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
class WorkingArc:
    """An arc from one side to another with the implement down, and what it costs.

    It leaves the first side `leave_m` before its end and joins the other `join_m` after its beginning. The costs (s)
    are less those of the parts of the sides that it stands for, with the ground finished that it misses.
    """

    path: DrivePath
    leave_m: float
    join_m: float
    cost_s: float
    missed_m2: float


def choose_arc(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> WorkingArc | None:
    """The arc that joins two segments with the implement down; None where their corner is square."""
    if job.corners == SQUARE_CORNERS or not _is_corner_between(a, b):
        return None
    best = _find_cheapest_arc(job, a, b)
    if best is None or job.corners == ROUND_CORNERS:
        return best
    return best if round(best.cost_s, 6) <= round(_compute_square_cost_s(job, a, b), 6) else None


def choose_arc_past(job: FieldJob, a: HeadlandSegment, short: HeadlandSegment, b: HeadlandSegment) -> WorkingArc | None:
    """The arc from one segment to another past a short one between; None where that is better driven by itself."""
    radius_m = job.driving_rules.radius_m
    if short.length_m > SHORT_SIDE_RADII * radius_m or job.corners == SQUARE_CORNERS:
        return None
    if not (_is_corner_between(a, short) and _is_corner_between(short, b)) or a is b:
        return None
    best = _find_cheapest_arc(job, a, b)
    if best is None:
        return None
    single_s = _compute_corner_cost_s(job, a, short) + _compute_corner_cost_s(job, short, b)
    single_s += short.length_m / job.driving_rules.work_speed_mps
    return best if round(best.cost_s, 6) <= round(single_s, 6) else None


def _compute_corner_cost_s(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> float:
    """What a corner costs (s), driven in whichever way is chosen."""
    arc = choose_arc(job, a, b)
    return _compute_square_cost_s(job, a, b) if arc is None else arc.cost_s


def _is_corner_between(a: HeadlandSegment, b: HeadlandSegment) -> bool:
    """Whether a segment ends at a corner of its pass where another begins."""
    is_same_pass = (a.headland_pass.number, a.headland_pass.ring) == (b.headland_pass.number, b.headland_pass.ring)
    return is_same_pass and not a.has_no_corner and (a.side + 1) % len(a.headland_pass.sides) == b.side


def _find_cheapest_arc(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> WorkingArc | None:
    """The arc between two segments that costs least; None if none fits.

    Where a short side lies between them, the arc turns past it: it is as wide as to leave the first side at its end.
    """
    pose, goal = get_end_pose(a.line, -1), get_end_pose(b.line, 0)
    turn_rad = math.remainder(goal[2] - pose[2], 2.0 * math.pi)
    sine = math.sin(turn_rad)
    if abs(sine) < MIN_ARC_SINE:
        return None
    east_m, north_m = goal[0] - pose[0], goal[1] - pose[1]
    beyond_m = (east_m * math.sin(goal[2]) - north_m * math.cos(goal[2])) / sine  # from the end of a to the crossing
    before_m = (east_m * math.sin(pose[2]) - north_m * math.cos(pose[2])) / sine  # from the beginning of b back to it
    reach_m = max(beyond_m, -before_m, 0.0)
    least_m = max(job.driving_rules.radius_m, reach_m / math.tan(0.5 * abs(turn_rad)))
    arcs = (_build_arc(job, a, b, (beyond_m, -before_m), turn_rad, factor * least_m) for factor in ARC_RADIUS_FACTORS)
    return min((arc for arc in arcs if arc is not None), key=lambda arc: round(arc.cost_s, 6), default=None)


def _build_arc(
    job: FieldJob,
    a: HeadlandSegment,
    b: HeadlandSegment,
    gaps_m: tuple[float, float],
    turn_rad: float,
    radius_m: float,
) -> WorkingArc | None:
    """The arc of a radius between two segments whose lines cross `gaps_m` off their ends; None if it does not fit."""
    touch_m = compute_tangent_m(turn_rad, radius_m)
    leave_m, join_m = (touch_m - gap_m for gap_m in gaps_m)
    side, after = a.headland_pass.sides[a.side].points, b.headland_pass.sides[b.side].points
    if leave_m > math.dist(*side[-2:]) or join_m > math.dist(*after[:2]):
        return None
    if leave_m > 0.5 * a.length_m or join_m > 0.5 * b.length_m:
        return None
    x, y, heading = get_end_pose(side, -1)
    corner = x + gaps_m[0] * math.cos(heading), y + gaps_m[0] * math.sin(heading)
    path = build_corner_arc(corner, heading, turn_rad, radius_m)
    if not job.connector.fits(path) or job.has_overhang(path):
        return None
    driven_s = job.connector.costs.compute_time_s(path) - (leave_m + join_m) / job.driving_rules.work_speed_mps
    missed_m2 = _compute_arc_missed_m2(job, a, b, path, turn_rad)
    return WorkingArc(path, leave_m, join_m, driven_s + missed_m2 * job.finishing_rate_s_per_m2, missed_m2)


def _compute_arc_missed_m2(
    job: FieldJob, a: HeadlandSegment, b: HeadlandSegment, path: DrivePath, turn_rad: float
) -> float:
    """Ground (m2) that an arc misses: at one corner in closed form, past a short side by what its strip would cover."""
    width_m, is_inside = job.layout.width_m, a.headland_pass.number > 1
    if (a.side + 1) % len(a.headland_pass.sides) == b.side:
        radius_m = 1.0 / abs(path.segments[0].curvature)
        return compute_missed_m2(turn_rad, width_m, radius_m, inside_round=is_inside)
    short = a.headland_pass.sides[(a.side + 1) % len(a.headland_pass.sides)].points
    corners = [path.start[:2], *short.tolist(), path.end[:2]]
    strip = shapely.LineString(corners).buffer(0.5 * width_m, cap_style="flat", join_style="mitre")
    arc_line = shapely.LineString(np.concatenate([points for _, points in path.sample(ARC_STEP_M)]))
    return float(shapely.difference(strip, arc_line.buffer(0.5 * width_m, cap_style="flat")).area)


def _compute_square_cost_s(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> float:
    """What a square corner costs (s), as that of an arc; infinite if no path leads through it that may be driven."""
    side, rules = a.headland_pass.sides[a.side], job.driving_rules
    last, first = find_working_extent_m(job, a)[1], find_working_extent_m(job, b)[0]
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
