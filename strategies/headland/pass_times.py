"""How long one tractor takes for the headland passes, in closed form: for comparing layouts before moves are known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

from fields.layout.headland_passes import HeadlandPass, HeadlandPassSide
from strategies.headland.corners import compute_missed_m2, compute_tangent_m, compute_worked_reach_m, find_corner_paths
from strategies.program.field_job import FieldJob


def estimate_passes_s(job: FieldJob) -> float:
    """Estimated seconds for all passes: their sides, their corners, and from each pass to the next a turn."""
    turns_s = job.driving_rules.turn_s[1] * max(0, len(job.headland_passes) - 1)
    sides_m = math.fsum(headland_pass.length_m for headland_pass in job.headland_passes)
    corners = (corner for headland_pass in job.headland_passes for corner in _list_corners(headland_pass))
    corners_s = math.fsum(_estimate_corner_s(job, *corner) for corner in corners)
    return sides_m / job.driving_rules.work_speed_mps + corners_s + turns_s


def _list_corners(headland_pass: HeadlandPass) -> Iterator[tuple[HeadlandPassSide, HeadlandPassSide]]:
    """The sides before and after every corner."""
    yield from pairwise(headland_pass.sides)
    if headland_pass.is_closed:
        yield headland_pass.sides[-1], headland_pass.sides[0]


def _estimate_corner_s(job: FieldJob, before: HeadlandPassSide, after: HeadlandPassSide) -> float:
    """Extra seconds of a corner: worked whole with a path between its sides, or in an arc that misses its tip."""
    rules, width_m, turn_rad = job.driving_rules, job.layout.width_m, before.end_turn_rad
    end_m, begin_m = (reach_m + rules.tool_m for reach_m in compute_worked_reach_m(turn_rad, width_m))
    begin = begin_m * math.cos(turn_rad), begin_m * math.sin(turn_rad), turn_rad
    paths = find_corner_paths((end_m, 0.0, 0.0), begin, rules.radius_m)
    options_s = [job.connector.costs.compute_time_s(path) for path in paths]
    touch_m = compute_tangent_m(turn_rad, rules.radius_m)
    if 2.0 * touch_m <= min(before.length_m, after.length_m):
        arc_m = rules.radius_m * abs(turn_rad) - 2.0 * touch_m
        missed_m2 = compute_missed_m2(turn_rad, width_m, rules.radius_m)
        options_s.append(arc_m / rules.work_speed_mps + missed_m2 * job.finishing_rate_s_per_m2)
    return min(options_s, default=0.0)
