"""Triangle formation (thesis, section 6.3): neighbouring tracks are worked abreast, rows 10 m apart.

Tracks are grouped into rounds (grouping), each with its places (abreast); at the headland the rows queue inside their
tracks (queueing). When a tractor may leave the queue is what the strategies differ in; they hand it over. Tracks that
leave no room for a formation are worked by one tractor alone (leftover).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from strategies.errors import StrategyError, too_many
from strategies.formations.abreast import Slot, missing_m, needed_m, slots_of
from strategies.formations.clear_rounds import AS_WRITTEN, Changes, clear_grouping
from strategies.formations.grouping import CORNERS, Grouping, Round, divided, grouping, runs_of
from strategies.formations.leftover import held_clear, order_alone, work_alone
from strategies.formations.queueing import Draft, Marks, Queue, lay_rounds, stay_back
from strategies.job import Job, Pass
from strategies.legs import mission_from
from vehicle.missions import Plan

FORMATION_REPAIRS = 8  # a formation has its own queue: where that needs more mending, the field does not suit it


@dataclass(frozen=True)
class Formation:
    """A formation plan with what is needed to time its queues: per round, the slots and the marks per tractor.

    `moved` tells for each round whether the tractors come to it from afar, one after another; `alone` are the passes
    that one of them works after the last round, `changes` what it was written with.
    """

    plan: Plan
    rounds: tuple[tuple[Slot, ...], ...]
    marks: Mapping[tuple[int, int], Marks]
    moved: tuple[bool, ...]
    alone: tuple[Pass, ...]
    changes: Changes = AS_WRITTEN

    @property
    def slots(self) -> Iterator[tuple[int, Slot]]:
        """Every slot with the number of its round."""
        return ((number, slot) for number, slots in enumerate(self.rounds) for slot in slots)


def form(
    job: Job, name: str, queue: Queue, *, move_up: bool = True, changes: Changes = AS_WRITTEN
) -> Formation:
    """The plan of a formation whose tractors leave the queue as `queue` says; raises StrategyError.

    Without `move_up` each tractor stays at its first place in the queue until it is released. `changes` are what
    driving it has shown to be needed.
    """
    found = _checked(job, clear_grouping(job, changes))
    order = order_alone(job, found)
    rounds = held_clear(job, found.rounds, order)
    draft = Draft(job, rounds, found.moved, {}, [[] for _ in range(job.tractors)])
    lay_rounds(draft, queue, move_up=move_up)
    apart = {slot.tractor for slots in rounds if len(slots) == 1 for slot in slots}
    if order:
        apart.add(work_alone(draft, order))
    else:
        stay_back(draft)
    notes = {"strategy": name, "tractors": job.tractors, **_share(job, found, apart)}
    plan = Plan(tuple(mission_from(own) for own in draft.legs), notes)
    return Formation(plan, tuple(map(tuple, rounds)), draft.marks, tuple(draft.moved), tuple(order), changes)


def _share(job: Job, found: Grouping, apart: set[int]) -> dict[str, object]:
    """Which share of all track length is driven by two or more abreast (percent), and who drives the rest."""
    if job.tractors == 1:
        return {}
    abreast = math.fsum(slot.this.track.length for slots in found.rounds if len(slots) > 1 for slot in slots)
    share = 100.0 * abreast / math.fsum(track.length for track in job.layout.tracks)
    return {"formation_pct": round(share, 3), "apart": [tractor + 1 for tractor in sorted(apart)]}


def _checked(job: Job, found: Grouping) -> Grouping:
    """The grouping where it has a round of all tractors; raises StrategyError where it has none."""
    if any(len(slots) == job.tractors for slots in found.rounds):
        return found
    count = len(job.layout.tracks)
    if count < job.tractors:
        raise too_many(job.tractors, count)
    raise StrategyError(f"{_no_room(job)}; {_advice(job)}.")


def _no_room(job: Job) -> str:
    """Why there is no round of all tractors: where it lacks least, how much room there would have to be."""
    tight = _tightest(job)
    if tight is None:
        return (
            f"Nowhere do {job.tractors} tracks of {needed_m(job, min(job.tractors, 2)):.1f} m or more lie side by "
            f"side, as a formation of {job.tractors} tractors needs them"
        )
    track = min((slot.this.track for slot in tight), key=lambda track: track.length)
    rows, gap = max(slot.row for slot in tight), job.manner.gap_m
    shape = f"a formation of {rows} rows {gap:g} m apart with its queue" if rows > 1 else "a queue at its end"
    return (
        f"Track {track.line} is {track.length:.1f} m long, too short for {shape}: that takes "
        f"{needed_m(job, rows):.1f} m where tracks end side by side, and lacks {missing_m(tight):.1f} m here"
    )


def _tightest(job: Job) -> Round | None:
    """The round of all tractors that lacks least room."""
    rounds = [
        slots_of(job, [Pass(track, way) for track in run[first : first + job.tractors]])
        for run in runs_of(job)
        for first in range(len(run) - job.tractors + 1)
        for way in (1, -1)
    ]
    return min(rounds, key=lambda slots: round(missing_m(slots), 3), default=None)


def _advice(job: Job) -> str:
    """The largest smaller formation that has room somewhere, if there is one, and other strategies."""
    corners = CORNERS if job.corner is None else (job.corner,)
    for tractors in range(job.tractors - 1, 1, -1):
        parts = divided(replace(job, tractors=tractors))
        for corner in corners:
            found = grouping(replace(job, tractors=tractors, corner=corner), parts)
            if any(len(slots) == tractors for slots in found.rounds):
                return f"use {tractors} tractors, or split-field or interleaved"
    other = "use split-field or interleaved"
    return f"no smaller formation fits either, {other}" if job.tractors > 2 else other
