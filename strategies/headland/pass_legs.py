"""One tractor's share of the headland passes as legs.

Where two sides of a pass are not joined by an arc with the implement down, a path with it up leads from one to the
next; a side that no path reaches is left out and its length counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from strategies.headland.corner_choice import cut_polyline, get_end_pose
from strategies.headland.pass_shares import HeadlandSegment
from strategies.headland.raised_paths import find_quickest_turn, find_raised_path
from strategies.headland.strips import MIN_SIDE_M, HeadlandStrip, build_strips
from strategies.path_planning.paths import DrivePath, Pose
from strategies.program.field_job import FieldJob
from strategies.program.legs import add_wait_points, build_path_legs
from vehicle.missions.plan import ROUTE, TURN, Leg

Points = npt.NDArray[np.float64]

SHORT_SIDE_WIDTHS = 5.0  # working widths; a shorter side may be left out if it leads nowhere
TRIMS_M = ((0.0, 0.0), (0.0, 5.0), (5.0, 0.0), (5.0, 5.0), (10.0, 10.0))  # trimmed before and after a corner
EDGE_TRIMS_M = ((0.0, 2.0), (2.0, 0.0), (2.0, 2.0), *TRIMS_M[1:])  # the same to keep off an open edge
MAX_EDGE_DETOUR_S = 60.0  # a path that keeps off an open edge may cost this much more
WAIT_POINT_STEP_M = 40.0  # between places to wait along a side

_Connection = tuple[HeadlandStrip, DrivePath, HeadlandStrip]


@dataclass(frozen=True)
class HeadlandLegs:
    """What one tractor drives of the passes: its legs, the poses where they begin and end, and the metres left out."""

    legs: tuple[Leg, ...]
    start: Pose
    end: Pose
    unworked_m: float = 0.0


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
    driven_strips: list[tuple[HeadlandStrip, DrivePath | None]] = []
    unworked_m, is_last_left_out = 0.0, False
    for strip in build_strips(job, share):
        if not driven_strips or (strip.joined_in and not is_last_left_out):
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
                job, get_end_pose(driven_strips[-1][0].points, -1), get_end_pose(strip.points, 0), allow_rim=True
            )
            connection = None if path is None else (driven_strips[-1][0], path, strip)
        is_last_left_out = connection is None
        if connection is None:
            unworked_m += strip.length_m
            continue
        driven_strips[-1] = connection[0], driven_strips[-1][1]
        driven_strips.append((connection[2], connection[1]))
    return _join_strips(job, driven_strips, unworked_m) if driven_strips else None


def _join_strips(
    job: FieldJob, driven_strips: list[tuple[HeadlandStrip, DrivePath | None]], unworked_m: float
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
        get_end_pose(driven_strips[0][0].points, 0),
        get_end_pose(driven_strips[-1][0].points, -1),
        unworked_m,
    )


def _connect_strips(job: FieldJob, last: HeadlandStrip, strip: HeadlandStrip) -> _Connection | None:
    """The path from one strip to the next, and both strips; where it is tight, their ends are trimmed for a turn."""
    first = next(_iter_trimmed_connections(job, last, strip, TRIMS_M), None)
    if first is not None and not job.has_overhang(first[1]):
        return first
    path = find_raised_path(job, get_end_pose(last.points, -1), get_end_pose(strip.points, 0))
    whole = None if path is None else (last, path, strip)
    if first is None:
        return whole
    options = [one for one in (whole, *_iter_trimmed_connections(job, last, strip, EDGE_TRIMS_M)) if one is not None]
    clear = [one for one in options if not job.has_overhang(one[1]) and not job.crosses_fence(one[1])]
    best = min(clear, key=lambda one: round(_compute_connection_cost_s(job, last, strip, one), 6), default=first)
    gain_s = _compute_connection_cost_s(job, last, strip, best) - _compute_connection_cost_s(job, last, strip, first)
    return best if gain_s <= MAX_EDGE_DETOUR_S else first


def _compute_connection_cost_s(
    job: FieldJob, last: HeadlandStrip, strip: HeadlandStrip, connection: _Connection
) -> float:
    """Seconds of a path between two strips and of finishing the ends that were trimmed for it."""
    trimmed_last, path, trimmed_next = connection
    trimmed_m = last.length_m - trimmed_last.length_m + strip.length_m - trimmed_next.length_m
    finishing_s = trimmed_m * job.layout.width_m * job.finishing_rate_s_per_m2
    return job.connector.costs.compute_time_s(path) + finishing_s - trimmed_m / job.driving_rules.work_speed_mps


def _iter_trimmed_connections(
    job: FieldJob, last: HeadlandStrip, strip: HeadlandStrip, trims_m: Sequence[tuple[float, float]]
) -> Iterator[_Connection]:
    """The quickest turns between two strips trimmed at their ends, where there are any."""
    for end_trim_m, start_trim_m in trims_m:
        if end_trim_m + MIN_SIDE_M < last.length_m and start_trim_m + MIN_SIDE_M < strip.length_m:
            trimmed_last, trimmed_next = _trim_strip(last, 0.0, end_trim_m), _trim_strip(strip, start_trim_m, 0.0)
            path = find_quickest_turn(job, get_end_pose(trimmed_last.points, -1), get_end_pose(trimmed_next.points, 0))
            if path is not None:
                yield trimmed_last, path, trimmed_next


def _trim_strip(strip: HeadlandStrip, first_m: float, last_m: float) -> HeadlandStrip:
    """A strip shortened by `first_m` at its beginning and `last_m` at its end."""
    if not first_m and not last_m:
        return strip
    length = float(np.hypot(*np.diff(strip.points, axis=0).T).sum())
    points = cut_polyline(strip.points, first_m, max(length - last_m, first_m + 0.5 * MIN_SIDE_M))
    return replace(strip, points=points, length_m=strip.length_m - first_m - last_m)


def _build_working_legs(job: FieldJob, strip: HeadlandStrip) -> list[Leg]:
    """The legs of a strip, with places to wait before it, along a long one, and before its last part."""
    length = float(np.hypot(*np.diff(strip.points, axis=0).T).sum())
    hold_m = max(length - job.driving_rules.hold_back_m, 0.5 * length)
    ends = [0.0, length] if strip.joined_out else [0.0, *_place_wait_points_m(hold_m), length]
    parts = list(pairwise(ends))
    legs = []
    for index, (first, last) in enumerate(parts):
        points = cut_polyline(strip.points, first, last)
        x, y = points[len(points) // 2]
        ground = job.layout.field.find_ground_at(float(x), float(y))
        may_wait = index > 0 or not strip.joined_in
        legs.append(Leg(points, job.driving_rules.work_speed_mps, 1, True, ground, strip.task, may_wait))
    return legs


def _place_wait_points_m(hold_m: float) -> list[float]:
    """Where along a side a tractor may wait, up to the last place (m)."""
    count = max(1, round(hold_m / WAIT_POINT_STEP_M))
    return [hold_m * part / count for part in range(1, count + 1)]
