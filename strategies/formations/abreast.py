"""Tracks worked abreast in one round: who drives which, their places in formation and in the queue, and the room.

Rows lead from the middle, a gap apart (thesis, section 6.3). At the end of a round they queue inside their tracks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate

from strategies.formations.clearing import Blocked
from strategies.job import Job, Pass

SHORTEST_M = 0.1


@dataclass(frozen=True)
class Slot:
    """One tractor in one round: its row (1 leads), the neighbour it follows, its pass.

    Along the track, from its beginning: `place_m` where it takes its place in formation, `hold_m` where it first
    waits in the queue, `up_m` where after that, as it moves up, and `queue_m` where the queue begins.
    """

    tractor: int
    row: int
    neighbour: int | None
    this: Pass
    place_m: float
    hold_m: float
    queue_m: float
    up_m: tuple[float, ...] = ()


@dataclass(frozen=True)
class Passing:
    """Where on its track a tractor would stand in the way of others: of those that come to the round, and leave it.

    It takes its place `ahead_m` farther on and waits `back_m` farther back than it otherwise would.
    """

    come: Blocked
    leave: Blocked
    ahead_m: float = 0.0
    back_m: float = 0.0

    def place(self, place_m: float) -> float:
        """The first clear place in formation from one on."""
        return self.come.after(place_m + self.ahead_m)

    def hold(self, hold_m: float) -> float:
        """The last clear place to wait up to one."""
        return self.leave.before(hold_m - self.back_m)


def slots_of(job: Job, passes: Sequence[Pass], passing: Sequence[Passing] | None = None) -> list[Slot]:
    """Slots of one round on neighbouring tracks, at most one per tractor; those left over stay out at the sides.

    Places are set from the last row forwards, each a gap ahead of the row behind it, and clear of those `passing`.
    """
    offset = (job.tractors - len(passes)) // 2
    leader = (job.tractors - 1) // 2 - offset
    rows = [abs(index - leader) + 1 for index in range(len(passes))]
    along = [begins_at(job, this) for this in passes]
    own = [start + job.manner.tool_m for start in along]
    place = list(own)
    members: list[list[int]] = [[] for _ in range(max(rows) + 2)]
    for index, row in enumerate(rows):
        members[row].append(index)
    for row in range(max(rows), 0, -1):
        behind = [place[i] + job.manner.gap_m for i in members[row + 1]]
        for index in members[row]:
            place[index] = max([own[index], *behind])
            if passing:
                place[index] = along[index] + passing[index].place(place[index] - along[index])
    ends = [start + this.track.length for start, this in zip(own, passes, strict=True)]
    before_row = list(accumulate((min((ends[i] for i in row), default=math.inf) for row in members), min))
    slots = []
    for index, this in enumerate(passes):
        front = min(ends[index], before_row[rows[index] - 1])
        queue_m, place_m = front - along[index], place[index] - along[index]
        hold_m = queue_m - max((rows[index] - 1) * job.manner.gap_m, job.manner.hold_back_m)
        ups = [queue_m - row * job.manner.gap_m for row in range(rows[index] - 2, 0, -1)]
        if passing:
            hold_m, ups = passing[index].hold(hold_m), [passing[index].hold(up) for up in ups]
        before = [hold_m, *ups]
        up_m = tuple(up for up, last in zip(ups, before, strict=False) if up > last + SHORTEST_M)
        neighbour = None if rows[index] == 1 else offset + index + (1 if index < leader else -1)
        slots.append(Slot(offset + index, rows[index], neighbour, this, place_m, hold_m, queue_m, up_m))
    return slots


def missing_m(slots: Sequence[Slot]) -> float:
    """Metres a round lacks between the places in formation and those in the queue; 0 or less when it lacks none."""
    return max(slot.place_m + SHORTEST_M - slot.hold_m for slot in slots)


def needed_m(job: Job, rows: int) -> float:
    """Length of the shortest track on which so many rows have room, where tracks end side by side."""
    gap, hold = job.manner.gap_m, job.manner.hold_back_m
    return SHORTEST_M + max((rows - row) * gap + max((row - 1) * gap, hold) for row in range(1, rows + 1))


def begins_at(job: Job, this: Pass) -> float:
    """Where a pass begins, measured in its direction of travel."""
    x, y, heading = job.entry(this)
    return x * math.cos(heading) + y * math.sin(heading)
