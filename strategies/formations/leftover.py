"""Tracks a formation leaves over: the leader of its last round works them after it, the others stand clear.

The others wait in their last tracks, before the last stretch, until the leader works the last of them.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fields.layout import Track
from strategies.formations.abreast import SHORTEST_M, Slot
from strategies.formations.clearing import Floats, blocked_on, poses_on
from strategies.formations.grouping import Grouping, Round
from strategies.formations.queueing import Draft
from strategies.job import Job, Pass
from strategies.legs import pass_legs, turn_legs
from strategies.orders.sequence import searched
from strategies.orders.table import TurnTable
from vehicle.missions import DRIVE_IN


class _After(TurnTable):
    """Seconds between tracks that are worked when a tractor has finished a pass."""

    def __init__(self, job: Job, tracks: list[Track], before: Pass) -> None:
        self.before = before
        super().__init__(job, tracks)

    def ends(self) -> npt.NDArray[np.float64]:
        """Estimated seconds from the pass before to the beginning of every pass; none from their ends (2, 2 n)."""
        first = [round(self.job.turn_time(self.before, one), 3) for one in self.passes]
        return np.array([first, [0.0] * len(first)])

    def work_out_ends(self, order: list[int]) -> bool:
        """Nothing: the tractor is on the field already, and goes on to others from there."""
        return False


def leader_of(slots: Round) -> Slot:
    """The slot of the first row."""
    return next(slot for slot in slots if slot.row == 1)


def order_alone(job: Job, found: Grouping) -> list[Pass]:
    """The tracks left over in the order and direction in which the leader of the last round works them."""
    if not found.alone:
        return []
    before = leader_of(found.rounds[-1]).this
    key = "alone", before, tuple(found.alone)
    if key not in job.formations:
        part = replace(job, layout=replace(job.layout, tracks=tuple(found.alone)))
        job.formations[key] = searched(found.alone, part, _After(part, found.alone, before), proven=False).order
    return list(job.formations[key])


def held_clear(job: Job, rounds: list[Round], order: list[Pass]) -> list[Round]:
    """The rounds with the others waiting clear of the leader where it works what is left over, if there is room."""
    if not order:
        return rounds
    leader = leader_of(rounds[-1])
    ways = _driven(job, [leader.this, *order])
    last = {slot.tractor: number for number, slots in enumerate(rounds) for slot in slots}
    held = []
    for number, slots in enumerate(rounds):
        idle = {slot.tractor for slot in slots if last[slot.tractor] == number} - {leader.tractor}
        held.append([_further_back(job, slot, ways) if slot.tractor in idle else slot for slot in slots])
    return held


def _further_back(job: Job, slot: Slot, ways: list[Floats]) -> Slot:
    hold_m = blocked_on(job, slot.this, ways).before(slot.hold_m)
    return replace(slot, hold_m=hold_m, up_m=()) if hold_m >= slot.place_m + SHORTEST_M else slot


def _driven(job: Job, order: list[Pass]) -> list[Floats]:
    """The poses on all tracks of an order but the first, and on the ways between them."""
    driven = []
    for a, b in pairwise(order):
        path = job.way(job.exit(a), job.entry(b))
        if path is not None:
            driven.append(poses_on(path))
        driven.append(np.array([(*job.entry(b), 0.0), (*job.exit(b), 0.0)]))
    return driven


def work_alone(draft: Draft, order: list[Pass]) -> int:
    """Let the leader of the last round work these passes after it; which tractor that is."""
    job, leader = draft.job, leader_of(draft.rounds[-1])
    legs = draft.legs[leader.tractor]
    for a, b in pairwise([leader.this, *order]):
        legs += turn_legs(job, a, b) + pass_legs(job, b)
    begun = max(index for index, leg in enumerate(legs) if leg.task.kind == DRIVE_IN)
    for other in sorted(set(draft.last) - {leader.tractor}):
        draft.wait(other, draft.last_stretch(other), [draft.ended(leader.tractor, begun)])
    return leader.tractor
