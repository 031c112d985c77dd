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

from strategies.headland.corner_choice import (
    WorkingArc,
    choose_arc,
    choose_arc_past,
    cut_polyline,
    find_working_extent_m,
)
from strategies.headland.pass_shares import HeadlandSegment
from strategies.path_planning.obstacle_avoidance import find_clear_parts
from strategies.path_planning.turn_kinds import AUTO_CORNERS
from strategies.program.field_job import FieldJob
from strategies.program.legs import PATH_STEP_M
from vehicle.missions.plan import HEADLAND_PASS, MAX_JOINT_GAP_M, LegTask

Points = npt.NDArray[np.float64]

MAX_MISSED_SHARE = 0.005  # of the field, by round corners of headland passes
MISSED_GROUND_PRICES = (1.0, 3.0, 9.0, 27.0, 81.0)  # times what missed ground is charged in the ranking
MIN_SIDE_M = 2.0  # a shorter side is worked by the corners at its ends


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
    segments, arcs = _join_by_worthwhile_arcs(job, share)
    strips = []
    for index, segment in enumerate(segments):
        arc_in, arc_out = arcs[index - 1] if index else None, arcs[index]
        first, last = find_working_extent_m(job, segment)
        if arc_in is not None:
            first = arc_in.join_m
        if arc_out is not None:
            last = segment.headland_pass.sides[segment.side].length_m - arc_out.leave_m
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


def _join_by_worthwhile_arcs(
    job: FieldJob, share: Sequence[HeadlandSegment]
) -> tuple[list[HeadlandSegment], list[WorkingArc | None]]:
    """As `_join_by_arcs`, at the lowest price of missed ground at which the corners do not miss more than may be.

    Where all together would matter, the corners are square that miss most for the time they save.
    """
    pass_m = math.fsum(headland_pass.length_m for headland_pass in job.headland_passes)
    share_of_passes = math.fsum(segment.length_m for segment in share) / max(pass_m, MIN_SIDE_M)
    allowed_m2 = MAX_MISSED_SHARE * min(share_of_passes, 1.0) * job.layout.field.area_m2
    prices = MISSED_GROUND_PRICES if job.corners == AUTO_CORNERS else (1.0,)
    for price in prices:
        segments, arcs = _join_by_arcs(replace(job, missed_ground_price=price), share)
        if math.fsum(arc.missed_m2 for arc in arcs if arc is not None) <= allowed_m2:
            break
    return segments, arcs


def _join_by_arcs(
    job: FieldJob, share: Sequence[HeadlandSegment]
) -> tuple[list[HeadlandSegment], list[WorkingArc | None]]:
    """The segments without short ones that an arc leads past, and after each the arc to the next one or None."""
    segments, arcs, index = list[HeadlandSegment](), list[WorkingArc | None](), 0
    while index < len(share):
        rest = share[index : index + 3]
        past = choose_arc_past(job, *rest) if len(rest) == 3 else None
        segments.append(share[index])
        arcs.append(past or (choose_arc(job, *rest[:2]) if len(rest) > 1 else None))
        index += 1 if past is None else 2
    return segments, arcs


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
