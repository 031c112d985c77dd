"""One tractor's share of the headland passes as legs.

The implement works behind the guided point, so a side ends when the tractor is past its corner. A square corner is
worked whole: on, up, back, round and back again, down. A round one is driven through with the implement down. Where
neither fits, any path from one side to the next is taken; a side that no path reaches is left out and its length
counted.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, pairwise, product
from typing import Any, TypeGuard

import numpy as np
import numpy.typing as npt
import shapely

from strategies.headland.corners import build_corner_arc, compute_tangent_m, compute_worked_reach_m, find_corner_paths
from strategies.headland.pass_shares import HeadlandSegment
from strategies.path_planning.connector import Connector
from strategies.path_planning.obstacle_avoidance import find_clear_parts
from strategies.path_planning.paths import DrivePath, Pose, join_paths, make_straight_path, shift_pose_ahead
from strategies.program.field_job import FieldJob
from strategies.program.legs import PATH_STEP_M, add_wait_points, build_path_legs
from vehicle.missions.plan import HEADLAND_PASS, ROUTE, TURN, Leg, LegTask

Points = npt.NDArray[np.float64]

SHORT_SIDE_WIDTHS = 5.0  # working widths; a shorter side may be left out if it leads nowhere
MIN_SIDE_M = 2.0  # a shorter side is worked by the corners at its ends
MAX_REVERSALS = 4  # a path with more turns on the spot in arcs too short to follow
TRIMS_M = ((0.0, 0.0), (0.0, 5.0), (5.0, 0.0), (5.0, 5.0), (10.0, 10.0))  # trimmed before and after a corner
PULL_BACK_STEP_M = 0.25  # steps in which the end of a side is pulled back into the field
MAX_CORNER_RADII = 6.0  # radii by which a path through a corner may exceed the distance of its ends
WAIT_POINT_STEP_M = 40.0  # between places to wait along a side
BACK_UP_M = (0.0, 1.5, 3.0, 5.0, 8.0)  # straight back from a pose that no path joins


@dataclass(frozen=True)
class HeadlandLegs:
    """What one tractor drives of the passes: its legs, the poses where they begin and end, and the metres left out."""

    legs: tuple[Leg, ...]
    start: Pose
    end: Pose
    unworked_m: float = 0.0


@dataclass(frozen=True, eq=False)
class _Strip:
    """A segment as the guided point drives it (n, 2), and whether arcs with the implement down lead to and from it."""

    points: Points
    task: LegTask
    length_m: float
    joined_in: bool
    joined_out: bool


def get_headland_legs(job: FieldJob, share: Sequence[HeadlandSegment]) -> HeadlandLegs | None:
    """The legs of a share, built once for all jobs of a field; None if nothing of it can be driven."""
    pass_key = tuple(
        (headland_pass.number, headland_pass.ring, len(headland_pass.sides)) for headland_pass in job.headland_passes
    )
    key = pass_key, tuple(_build_segment_key(segment) for segment in share)
    if key not in job.headland_leg_cache:
        own_job = replace(job, turn_counts={})
        job.headland_leg_cache[key] = _build_headland_legs(own_job, share), own_job.turn_counts
    headland_legs, turn_counts = job.headland_leg_cache[key]
    for kind, count in turn_counts.items():
        job.turn_counts[kind] = job.turn_counts.get(kind, 0) + count
    return headland_legs  # type: ignore[no-any-return]


def _build_segment_key(segment: HeadlandSegment) -> tuple[Any, ...]:
    """A key that distinguishes a segment from all others of a field, also from its reverse."""
    first, last = segment.headland_pass.sides[segment.side].points[[0, -1]].tolist()
    return (
        segment.headland_pass.number,
        segment.headland_pass.ring,
        segment.side,
        segment.first_m,
        segment.last_m,
        *first,
        *last,
    )


def _build_headland_legs(job: FieldJob, share: Sequence[HeadlandSegment]) -> HeadlandLegs | None:
    """As `get_headland_legs`, without the cache.

    Where no path leads on from a side, a short one of the two it would join is left out. Where both are long, the
    tractor takes any path there is, however near the edge of the field; if there is none, the next side is left out.
    """
    driven_strips: list[tuple[_Strip, DrivePath | None]] = []
    unworked_m = 0.0
    for strip in _build_strips(job, share):
        if not driven_strips or strip.joined_in:
            driven_strips.append((strip, None))
            continue
        connection = _connect_strips(job, driven_strips[-1][0], strip)
        last_length_m, short_m = driven_strips[-1][0].length_m, SHORT_SIDE_WIDTHS * job.layout.width_m
        if connection is None and len(driven_strips) > 1 and last_length_m <= min(short_m, strip.length_m):
            connection = _connect_strips(job, driven_strips[-2][0], strip)
            if connection is not None:
                unworked_m += driven_strips.pop()[0].length_m
        if connection is None and strip.length_m > short_m:
            path = find_raised_path(
                job, _get_end_pose(driven_strips[-1][0].points, -1), _get_end_pose(strip.points, 0), allow_rim=True
            )
            connection = None if path is None else (driven_strips[-1][0], path, strip)
        if connection is None:
            unworked_m += strip.length_m
            continue
        driven_strips[-1] = connection[0], driven_strips[-1][1]
        driven_strips.append((connection[2], connection[1]))
    return _join_strips(job, driven_strips, unworked_m) if driven_strips else None


def _join_strips(
    job: FieldJob, driven_strips: list[tuple[_Strip, DrivePath | None]], unworked_m: float
) -> HeadlandLegs:
    """The legs of strips, each with the path that leads to it."""
    legs: list[Leg] = []
    for strip, path in driven_strips:
        if path is not None:
            job.turn_counts[path.kind] = job.turn_counts.get(path.kind, 0) + 1
            task = replace(strip.task, kind=ROUTE if path.kind == "route" else TURN)
            path_legs = build_path_legs(job, path, task)
            legs += path_legs if task.kind == TURN else add_wait_points(path_legs, WAIT_POINT_STEP_M)
        legs += _build_working_legs(job, strip)
    return HeadlandLegs(
        tuple(legs),
        _get_end_pose(driven_strips[0][0].points, 0),
        _get_end_pose(driven_strips[-1][0].points, -1),
        unworked_m,
    )


def _connect_strips(job: FieldJob, last: _Strip, strip: _Strip) -> tuple[_Strip, DrivePath, _Strip] | None:
    """The path from one strip to the next, and both strips; where it is tight, their ends are trimmed for a turn."""
    for end_trim_m, start_trim_m in TRIMS_M:
        if end_trim_m + MIN_SIDE_M < last.length_m and start_trim_m + MIN_SIDE_M < strip.length_m:
            trimmed_last, trimmed_next = _trim_strip(last, 0.0, end_trim_m), _trim_strip(strip, start_trim_m, 0.0)
            path = _find_quickest_turn(
                job, _get_end_pose(trimmed_last.points, -1), _get_end_pose(trimmed_next.points, 0)
            )
            if path is not None:
                return trimmed_last, path, trimmed_next
    path = find_raised_path(job, _get_end_pose(last.points, -1), _get_end_pose(strip.points, 0))
    return None if path is None else (last, path, strip)


def _trim_strip(strip: _Strip, first_m: float, last_m: float) -> _Strip:
    """A strip shortened by `first_m` at its beginning and `last_m` at its end."""
    if not first_m and not last_m:
        return strip
    length = float(np.hypot(*np.diff(strip.points, axis=0).T).sum())
    points = _cut_polyline(strip.points, first_m, max(length - last_m, first_m + 0.5 * MIN_SIDE_M))
    return replace(strip, points=points, length_m=strip.length_m - first_m - last_m)


def find_raised_path(
    job: FieldJob, a: Pose, b: Pose, *, allow_rim: bool = False, keep_to_headland: bool = False
) -> DrivePath | None:
    """The path with the implement up from the end of a side or swath to the beginning of another; None for none.

    With `allow_rim` the implement may reach over the edge of the field all along the path. With `keep_to_headland` a
    path beside the swaths is taken however much longer it is, because others may stand on their swaths.
    """
    rim = job.rim_connector or job.connector
    if keep_to_headland and job.headland_connector is not None:
        path = job.headland_connector.connect(a, b)
        if _is_followable(path) and not job.crosses_fence(path):
            return path
    candidates = chain((_find_quickest_turn(job, a, b),), _find_paths_with_straights(job, rim, a, b))
    followable: list[DrivePath] = []
    for candidate in candidates:
        if _is_followable(candidate):
            followable.append(candidate)
            if not job.crosses_fence(candidate):
                break
    path = _pick_clear_path(job, followable) or rim.connect_directly(a, b)
    if job.crosses_fence(path):
        path = job.find_path(a, b)
    if not _is_followable(path) and allow_rim:
        path = rim.connect(a, b)
    return path if _is_followable(path) else None


def _find_quickest_turn(job: FieldJob, a: Pose, b: Pose) -> DrivePath | None:
    """The quickest of the paths through a corner and the turns from one pose to another."""
    rim = job.rim_connector or job.connector
    paths = [
        path for path in find_corner_paths(a, b, job.driving_rules.radius_m) if rim.can_reverse or not path.reverse_m
    ]
    max_length_m = math.dist(a[:2], b[:2]) + MAX_CORNER_RADII * job.driving_rules.radius_m
    timed = [
        (rim.costs.compute_time_s(path), path) for path in paths if path.length_m <= max_length_m and rim.fits(path)
    ]
    turn = job.find_turn(a, b)
    if turn is not None:
        timed.append((rim.compute_cost_s(turn), turn))
    return _pick_clear_path(job, [path for _, path in sorted(timed, key=lambda pair: round(pair[0], 6))])


def _pick_clear_path(job: FieldJob, paths: list[DrivePath]) -> DrivePath | None:
    """The first path that touches neither fence nor obstacle, else the first that touches no fence."""
    if not paths or job.fence is None:
        return paths[0] if paths else None
    clear_path = next((path for path in paths if not job.crosses_fence(path)), None)
    return clear_path or next((path for path in paths if not job.crosses_fence(path, fences_only=True)), None)


def _is_followable(path: DrivePath | None) -> TypeGuard[DrivePath]:
    """Whether there is a path and a tractor can be expected to follow it."""
    return path is not None and path.reversals <= MAX_REVERSALS


def _find_backed_up_ends(job: FieldJob, rim: Connector, a: Pose, b: Pose) -> Iterator[tuple[DrivePath, DrivePath]]:
    """Pairs of a straight back from a and one back to b between which a path may be looked for, the shortest first."""
    steps_m = BACK_UP_M if rim.can_reverse else BACK_UP_M[:1]
    leads = [
        path for lead_m in steps_m if _is_free(job, (path := make_straight_path(a, -lead_m)).end) and rim.fits(path)
    ][:2]
    tails = [
        path
        for tail_m in steps_m
        if _is_free(job, (path := make_straight_path(shift_pose_ahead(b, tail_m), -tail_m)).start) and rim.fits(path)
    ][:2]
    yield from sorted(product(leads, tails), key=lambda pair: pair[0].length_m + pair[1].length_m)


def _is_free(job: FieldJob, pose: Pose) -> bool:
    return bool(shapely.dwithin(job.connector.free, shapely.Point(pose[:2]), 1e-3))


def _find_paths_with_straights(job: FieldJob, rim: Connector, a: Pose, b: Pose) -> Iterator[DrivePath]:
    """Paths after a straight back from a and before one to b, the shortest straights first.

    If no path leads from one of these places to the other, none does from a few metres farther back either.
    """
    for lead, tail in _find_backed_up_ends(job, rim, a, b):
        path = _find_path_between(job, lead, tail)
        if path is None:
            return
        yield path


def _find_path_between(job: FieldJob, lead: DrivePath, tail: DrivePath) -> DrivePath | None:
    path = job.find_path(lead.end, tail.start)
    return None if path is None else join_paths((lead, path, tail), path.kind)


def _build_strips(job: FieldJob, share: Sequence[HeadlandSegment]) -> list[_Strip]:
    """The segments of a share as they are driven; those that their corners already work are left out."""
    arcs = [_find_working_arc(job, a, b) for a, b in pairwise(share)]
    strips = []
    for index, segment in enumerate(share):
        arc_in, arc_out = arcs[index - 1] if index else None, arcs[index] if index < len(arcs) else None
        first, last = _find_working_extent_m(job, segment)
        side = segment.headland_pass.sides[segment.side]
        radius = job.driving_rules.radius_m
        if arc_in is not None:
            first = compute_tangent_m(side.start_turn_rad, radius)
        if arc_out is not None:
            last = side.length_m - compute_tangent_m(side.end_turn_rad, radius)
        if last - first < MIN_SIDE_M and arc_in is None and arc_out is None:
            continue
        points = _cut_polyline(segment.line, first, last)
        if arc_out is not None:
            points = np.concatenate([points, *(run[1:] for _, run in arc_out.sample(PATH_STEP_M))])
        task = LegTask(HEADLAND_PASS, segment.headland_pass.number, _number_side(job, segment))
        strips += _bend_strip(job, _Strip(points, task, segment.length_m, arc_in is not None, arc_out is not None))
    return strips


def _bend_strip(job: FieldJob, strip: _Strip) -> list[_Strip]:
    """A strip bent round small obstacles; in pieces where there is no room for that."""
    if job.obstacle_bends.bender is None:
        return [strip]
    parts = find_clear_parts(strip.points, job.obstacle_bends.bender)
    if parts is None:
        return [strip]
    last = len(parts) - 1
    return [
        _Strip(points, strip.task, length_m, strip.joined_in and index == 0, strip.joined_out and index == last)
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
    side, tool_m = segment.headland_pass.sides[segment.side], job.driving_rules.tool_m
    begin = (
        compute_worked_reach_m(side.start_turn_rad, job.layout.width_m)[1]
        if segment.first_m is None
        else segment.first_m
    )
    if segment.last_m is None:
        end = side.length_m + compute_worked_reach_m(side.end_turn_rad, job.layout.width_m)[0]
    else:
        end = segment.last_m
    first, last, line = begin + tool_m, end + tool_m, segment.line
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
    return first, last


def _has_room(job: FieldJob, line: Points, distance_m: float) -> bool:
    return bool(
        shapely.covers((job.rim_connector or job.connector).free, shapely.Point(_get_point_at(line, distance_m)))
    )


def _get_pose_at(line: Points, distance_m: float) -> Pose:
    """Pose at a distance along a polyline, extended straight beyond its ends."""
    return _get_end_pose(_cut_polyline(line, distance_m - PULL_BACK_STEP_M, distance_m), -1)


def _find_working_arc(job: FieldJob, a: HeadlandSegment, b: HeadlandSegment) -> DrivePath | None:
    """The arc that joins two segments with the implement down; None if corners are square or it does not fit."""
    is_same_pass = (a.headland_pass.number, a.headland_pass.ring) == (b.headland_pass.number, b.headland_pass.ring)
    if job.square_corners or not is_same_pass or a.last_m is not None or b.first_m is not None:
        return None
    side, after = a.headland_pass.sides[a.side], b.headland_pass.sides[b.side]
    if (a.side + 1) % len(a.headland_pass.sides) != b.side or a.has_no_corner:
        return None
    touch_m = compute_tangent_m(side.end_turn_rad, job.driving_rules.radius_m)
    ends = [math.dist(*side.points[-2:]), math.dist(*after.points[:2])]
    if touch_m > min(ends) or touch_m > 0.5 * min(side.length_m, after.length_m):
        return None
    x, y, heading = _get_end_pose(side.points, -1)
    arc = build_corner_arc((x, y), heading, side.end_turn_rad, job.driving_rules.radius_m)
    return arc if job.connector.fits(arc) else None


def _build_working_legs(job: FieldJob, strip: _Strip) -> list[Leg]:
    """The legs of a strip, with places to wait before it, along a long one, and before its last part."""
    length = float(np.hypot(*np.diff(strip.points, axis=0).T).sum())
    hold_m = max(length - job.driving_rules.hold_back_m, 0.5 * length)
    ends = [0.0, length] if strip.joined_out else [0.0, *_place_wait_points_m(hold_m), length]
    parts = list(pairwise(ends))
    legs = []
    for index, (first, last) in enumerate(parts):
        points = _cut_polyline(strip.points, first, last)
        x, y = points[len(points) // 2]
        ground = job.layout.field.find_ground_at(float(x), float(y))
        may_wait = index > 0 or not strip.joined_in
        legs.append(Leg(points, job.driving_rules.work_speed_mps, 1, True, ground, strip.task, may_wait))
    return legs


def _place_wait_points_m(hold_m: float) -> list[float]:
    """Where along a side a tractor may wait, up to the last place (m)."""
    count = max(1, round(hold_m / WAIT_POINT_STEP_M))
    return [hold_m * part / count for part in range(1, count + 1)]


def _get_point_at(line: Points, distance_m: float) -> tuple[float, float]:
    x, y = _cut_polyline(line, distance_m, distance_m)[0]
    return float(x), float(y)


def _cut_polyline(line: Points, first_m: float, last_m: float) -> Points:
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


def _get_end_pose(points: Points, end: int) -> Pose:
    """Pose at the first (0) or the last (-1) point of a polyline, facing along it."""
    a, b = (points[0], points[1]) if end == 0 else (points[-2], points[-1])
    x, y = points[end]
    return float(x), float(y), math.atan2(b[1] - a[1], b[0] - a[0])
