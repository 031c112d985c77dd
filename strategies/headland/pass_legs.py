"""The headland passes as the legs of one tractor, for the estimate of a layout.

Where two sides of a pass are not joined by an arc with the implement down, a path with it up leads from one to the
next; a side that no path reaches is left out and its length counted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from strategies.headland.corner_choice import cut_polyline, get_end_pose
from strategies.headland.pass_shares import HeadlandSegment
from strategies.headland.raised_paths import find_quickest_turn, find_raised_path
from strategies.headland.strips import MIN_SIDE_M, HeadlandStrip, build_strips
from strategies.path_planning.paths import DrivePath
from strategies.program.field_job import FieldJob
from strategies.program.legs import build_path_legs
from vehicle.missions.plan import ROUTE, TURN, Leg

Points = npt.NDArray[np.float64]

SHORT_SIDE_WIDTHS = 5.0  # working widths; a shorter side may be left out if it leads nowhere
TRIMS_M = ((0.0, 0.0), (0.0, 5.0), (5.0, 0.0), (5.0, 5.0), (10.0, 10.0))  # trimmed before and after a corner
EDGE_TRIMS_M = ((0.0, 2.0), (2.0, 0.0), (2.0, 2.0), *TRIMS_M[1:])  # the same to keep off an open edge
MAX_EDGE_DETOUR_S = 60.0  # a path that keeps off an open edge may cost this much more

_Connection = tuple[HeadlandStrip, DrivePath, HeadlandStrip]


@dataclass(frozen=True)
class HeadlandLegs:
    """What a tractor drives of the passes: its legs, and the metres left out."""

    legs: tuple[Leg, ...]
    unworked_m: float


def build_headland_legs(job: FieldJob, segments: Sequence[HeadlandSegment]) -> HeadlandLegs | None:
    """The legs of some sides; None if nothing of them can be driven.

    Where no path leads on from a side, a short one of the two it would join is left out. Where both are long, the
    tractor takes any path there is, however near the edge of the field; if there is none, the next side is left out.
    """
    driven_strips: list[tuple[HeadlandStrip, DrivePath | None]] = []
    unworked_m, is_last_left_out = 0.0, False
    for strip in build_strips(job, segments):
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
            task = replace(strip.task, kind=ROUTE if path.kind == "route" else TURN)
            legs += build_path_legs(job, path, task)
        legs.append(_build_working_leg(job, strip))
    return HeadlandLegs(tuple(legs), unworked_m)


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


def _build_working_leg(job: FieldJob, strip: HeadlandStrip) -> Leg:
    x, y = strip.points[len(strip.points) // 2].tolist()
    ground = job.layout.field.find_ground_at(x, y)
    return Leg(strip.points, job.driving_rules.work_speed_mps, 1, True, ground, strip.task)
