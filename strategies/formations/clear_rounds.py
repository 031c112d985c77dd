"""Rounds of a formation whose tractors wait clear of each other's ways from round to round.

A tractor waits in the queue while those before it leave, and in its place while those after it come.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from strategies.formations.abreast import Passing, Slot, missing_m, slots_of
from strategies.formations.clearing import Floats, blocked_on, poses_on
from strategies.formations.grouping import Barred, Grouping, Round, divided, grouping, key_of
from strategies.job import Job, Pass

Ways = dict[tuple[int, int], Floats | None]
"""Poses on the way to a round by its number and tractor, None where there is no way; none for the first of each."""

HERE: Floats = np.empty((0, 4))
MOST_BARRED = 20  # rounds taken apart for want of room; what is left is driven as it is


@dataclass(frozen=True)
class Changes:
    """What driving has shown: by pass, how much farther on a place and farther back a queue must be; rounds barred."""

    ahead_m: Mapping[Pass, float] = field(default_factory=dict)
    back_m: Mapping[Pass, float] = field(default_factory=dict)
    barred: Barred = frozenset()


AS_WRITTEN = Changes()


def clear_grouping(job: Job, changes: Changes = AS_WRITTEN) -> Grouping:
    """The grouping of a job with every round clear of the ways to it and from it; rounds without room taken apart.

    That of a formation as it is first written is worked out once for all jobs of a site.
    """
    if changes is not AS_WRITTEN:
        return _clear_grouping(job, changes)
    key = "clear", job.tractors, job.corner, job.layout.field.entrance, job.layout.tracks
    if key not in job.formations:
        job.formations[key] = _clear_grouping(job, changes)
    return job.formations[key]  # type: ignore[no-any-return]


def _clear_grouping(job: Job, changes: Changes) -> Grouping:
    barred = changes.barred
    while True:
        found = grouping(job, divided(job, barred))
        ways = _ways(job, found.rounds)
        rounds = _cleared(job, found.rounds, ways, changes)
        unfit = frozenset(
            key_of(slots)
            for number, slots in enumerate(rounds)
            if missing_m(slots) > 0.0 or any(ways.get((number, slot.tractor), HERE) is None for slot in slots)
        )
        if not unfit or len(barred) >= len(changes.barred) + MOST_BARRED:
            kept = [new if missing_m(new) <= 0.0 else old for new, old in zip(rounds, found.rounds, strict=True)]
            return replace(found, rounds=kept)
        barred |= unfit


def _cleared(job: Job, rounds: list[Round], ways: Ways, changes: Changes) -> list[Round]:
    """The rounds with places and queues clear of those who pass, which may leave them no room."""
    cleared = []
    for number, slots in enumerate(rounds):
        passing = []
        for slot in slots:
            blocked = blocked_on(job, slot.this, _coming(slots, ways, number, slot)), blocked_on(
                job, slot.this, _leaving(rounds, ways, number, slot)
            )
            ahead_m, back_m = changes.ahead_m.get(slot.this, 0.0), changes.back_m.get(slot.this, 0.0)
            passing.append(Passing(*blocked, ahead_m, back_m))
        cleared.append(slots_of(job, [slot.this for slot in slots], passing))
    return cleared


def _ways(job: Job, rounds: list[Round]) -> Ways:
    """The poses on the way of every tractor to each of its rounds but the first."""
    ways: Ways = {}
    last: dict[int, Slot] = {}
    for number, slots in enumerate(rounds):
        for slot in slots:
            if slot.tractor in last:
                path = job.way(job.exit(last[slot.tractor].this), job.entry(slot.this))
                ways[number, slot.tractor] = None if path is None else poses_on(path)
            last[slot.tractor] = slot
    return ways


def _coming(slots: Round, ways: Ways, number: int, slot: Slot) -> Iterator[Floats]:
    """The ways of others that come to a round while a tractor is in its place."""
    early = (number, slot.tractor) not in ways  # it stands there from the start
    for other in slots:
        way = ways.get((number, other.tractor))
        if way is not None and other is not slot and (early or other.row >= slot.row):
            yield way


def _leaving(rounds: list[Round], ways: Ways, number: int, slot: Slot) -> Iterator[Floats]:
    """The ways of others that drive on while a tractor waits at the end of a round."""
    for later in range(number + 1, len(rounds)):
        mine = any(other.tractor == slot.tractor for other in rounds[later])
        for other in rounds[later]:
            way = ways.get((later, other.tractor))
            if way is not None and other.tractor != slot.tractor and (not mine or other.row <= slot.row):
                yield way
        if mine:
            return
