"""The corners a formation may begin at, the most promising first."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

from strategies.formations.grouping import CORNERS, Corner, Grouping, Round, divided, grouping
from strategies.formations.leftover import leader_of, order_alone
from strategies.job import Job, Pass

NEAR = 1.05  # corners whose estimates are this close are told apart by the ways they would really drive


def corners_by_promise(job: Job) -> list[Corner]:
    """The four corners to begin at, the one first from which rounds and turns are estimated to take least.

    The estimate depends on the shape of the field only, not on its place or heading. It is made once for all jobs of a
    site with so many tractors.
    """
    key = "corners", job.tractors, job.corner, job.layout.field.entrance, job.layout.tracks
    if key not in job.formations:
        job.formations[key] = _by_promise(job)
    return list(job.formations[key])


def _by_promise(job: Job) -> list[Corner]:
    parts = divided(job)
    tours = {corner: grouping(replace(job, corner=corner), parts) for corner in CORNERS}
    estimates = {corner: tour.seconds if tour.rounds else math.inf for corner, tour in tours.items()}
    limit = NEAR * min(estimates.values())
    near = [corner for corner in CORNERS if estimates[corner] <= limit < math.inf]
    driven = {corner: driven_s(job, tours[corner]) for corner in near} if len(near) > 1 else {}
    return sorted(
        CORNERS, key=lambda corner: (corner not in near, round(driven.get(corner, 0.0), 2), round(estimates[corner], 3))
    )


def driven_s(job: Job, found: Grouping) -> float:
    """Seconds for a grouping by the ways that would be driven, row after row; infinite where there is none."""
    work = sum(max(slot.this.track.length for slot in slots) for slots in found.rounds)
    turns = sum(_turns_s(job, before, after) for before, after in pairwise(found.rounds))
    if not found.rounds:
        return math.inf
    turns += job.gate_time(found.rounds[0][0].this, found.rounds[-1][-1].this)
    alone = order_alone(job, found)
    work += sum(this.track.length for this in alone)
    turns += sum(_way_s(job, a, b) for a, b in pairwise([leader_of(found.rounds[-1]).this, *alone]))
    return work / job.manner.work_speed_mps + turns


def _turns_s(job: Job, before: Round, after: Round) -> float:
    """Seconds until the tractors of one round are in the next, row after row."""
    last = {slot.tractor: slot.this for slot in before}
    rows: dict[int, float] = {}
    for slot in after:
        if slot.tractor in last:
            rows[slot.row] = max(rows.get(slot.row, 0.0), _way_s(job, last[slot.tractor], slot.this))
    return sum(rows.values())


def _way_s(job: Job, a: Pass, b: Pass) -> float:
    """Seconds of the way between two passes."""
    way = job.way(job.exit(a), job.entry(b))
    return math.inf if way is None else job.connector.cost(way)
