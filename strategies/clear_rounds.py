"""Rounds of a formation whose tractors wait clear of each other's ways from round to round.

A tractor waits in the queue while those before it leave, and in its place while those after it come.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from strategies.abreast import Passing, Slot, missing_m, slots_of
from strategies.clearing import Floats, blocked_on, poses_on
from strategies.grouping import Barred, Grouping, Round, grouping, key_of
from strategies.job import Job

MOST_BARRED = 20  # rounds taken apart for want of room; what is left is driven as it is


def clear_grouping(job: Job) -> Grouping:
    """The grouping of a job with every round clear of the ways to it and from it; rounds without room taken apart."""
    barred: Barred = frozenset()
    while True:
        found = grouping(job, barred)
        rounds = _cleared(job, found.rounds)
        tight = frozenset(key_of(slots) for slots in rounds if missing_m(slots) > 0.0)
        if not tight or len(barred) >= MOST_BARRED:
            kept = [new if missing_m(new) <= 0.0 else old for new, old in zip(rounds, found.rounds, strict=True)]
            return replace(found, rounds=kept)
        barred |= tight


def _cleared(job: Job, rounds: list[Round]) -> list[Round]:
    """The rounds with places and queues clear of those who pass, which may leave them no room."""
    ways = _ways(job, rounds)
    cleared = []
    for number, slots in enumerate(rounds):
        passing = []
        for slot in slots:
            come = [
                ways[number, other.tractor]
                for other in slots
                if other is not slot and other.row >= slot.row and (number, other.tractor) in ways
            ]
            leave = list(_leaving(rounds, ways, number, slot))
            passing.append(Passing(blocked_on(job, slot.this, come), blocked_on(job, slot.this, leave)))
        cleared.append(slots_of(job, [slot.this for slot in slots], passing))
    return cleared


def _ways(job: Job, rounds: list[Round]) -> dict[tuple[int, int], Floats]:
    """The poses on the way of every tractor to each of its rounds but the first, where there is a way."""
    ways: dict[tuple[int, int], Floats] = {}
    last: dict[int, Slot] = {}
    for number, slots in enumerate(rounds):
        for slot in slots:
            before = last.get(slot.tractor)
            path = before and job.way(job.exit(before.this), job.entry(slot.this))
            if path:
                ways[number, slot.tractor] = poses_on(path)
            last[slot.tractor] = slot
    return ways


def _leaving(rounds: list[Round], ways: dict[tuple[int, int], Floats], number: int, slot: Slot) -> Iterator[Floats]:
    """The ways of others that drive on while a tractor waits at the end of a round."""
    for later in range(number + 1, len(rounds)):
        mine = any(other.tractor == slot.tractor for other in rounds[later])
        for other in rounds[later]:
            before = other.tractor != slot.tractor and (not mine or other.row <= slot.row)
            if before and (later, other.tractor) in ways:
                yield ways[later, other.tractor]
        if mine:
            return
