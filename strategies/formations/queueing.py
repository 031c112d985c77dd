"""A formation plan while it is written: legs of every round, the queue at its end, and who waits for whom.

At the headland the rows queue inside their tracks, a gap apart, and move up. When all are in place in the next round,
all start together (Eq. 6.1 keeps the distance).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from strategies.formations.abreast import SHORTEST_M, Slot
from strategies.job import Job
from strategies.legs import straight_leg, task_on, turn_legs
from vehicle.missions import DRIVE_IN, THROUGH_M, TRACK, Follow, Gate, Leg

MOVED_ON = 0.8  # share of the gap after which the place in front counts as free


@dataclass(frozen=True)
class Marks:
    """Leg numbers of one tractor in one round.

    `release` is the first leg after the queue of the round before, `turned` the last leg of the turn, `placed` the leg
    that ends at the place in formation, `work` the leg worked in formation, `queue` the legs after it up to the end of
    the track: moving up, then the last stretch.
    """

    release: int
    turned: int
    placed: int
    work: int
    queue: tuple[int, ...]


@dataclass(frozen=True)
class Draft:
    """A formation plan while it is written.

    Per round the slots and whether the tractors come to it from afar (`moved`); the marks by round and tractor; per
    tractor its legs so far, and in `last` the last round it has a part in with its slot there.
    """

    job: Job
    rounds: list[list[Slot]]
    moved: list[bool]
    marks: dict[tuple[int, int], Marks]
    legs: list[list[Leg]]
    last: dict[int, tuple[int, Slot]] = field(default_factory=dict)

    def in_place(self, number: int, tractor: int) -> Gate:
        """Gate that opens when a tractor is at its place in formation in a round."""
        return self.ended(tractor, self.marks[number, tractor].placed)

    def turned(self, number: int, tractor: int) -> Gate:
        """Gate that opens when a tractor has finished its turn into a round."""
        return self.ended(tractor, self.marks[number, tractor].turned)

    def wait(self, tractor: int, leg: int, gates: list[Gate]) -> None:
        """Let a tractor wait for gates before one of its legs."""
        self.legs[tractor][leg] = self.legs[tractor][leg].with_gates(gates)

    def ended(self, tractor: int, leg: int) -> Gate:
        """Gate that opens when a tractor is all but at the end of a leg."""
        return Gate(tractor, leg, max(0.0, self.legs[tractor][leg].length_m - THROUGH_M))

    def last_stretch(self, tractor: int) -> int:
        """The leg with which a tractor ends the last round it has a part in."""
        return self.marks[self.last[tractor][0], tractor].queue[-1]


def past_release(legs: Sequence[Leg], marks: Marks, tractor: int, metres: float) -> Gate:
    """Gate at a distance past the release of a tractor into a round, on whichever of its legs that is."""
    leg = marks.release
    while leg < len(legs) - 1 and metres > legs[leg].length_m:
        metres -= legs[leg].length_m
        leg += 1
    return Gate(tractor, leg, min(metres, legs[leg].length_m))


Queue = Callable[[Draft, int, Slot], list[Gate]]
"""The gates a tractor waits for, in a round and as a slot of it, before it leaves the queue of the round before."""


def lay_rounds(draft: Draft, queue: Queue, *, move_up: bool) -> None:
    """Write the legs of all rounds with the gates of their queues.

    Without `move_up` each tractor stays at its first place in the queue until it is released.
    """
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            _lay_round(draft, number, slot, move_up)
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            _hold(draft, _one_by_one if draft.moved[number] else queue, number, slot)
    if move_up:
        _move_up(draft)


def stay_back(draft: Draft) -> None:
    """A tractor without a track in the last round finishes its own only when the others have turned away."""
    number = len(draft.rounds) - 1
    others = sorted(slot.tractor for slot in draft.rounds[number])
    for tractor in sorted(set(draft.last) - set(others)):
        draft.wait(tractor, draft.last_stretch(tractor), [draft.turned(number, other) for other in others])


def _one_by_one(draft: Draft, number: int, slot: Slot) -> list[Gate]:
    """On a longer way to a round the next tractor follows when the one before it is in place, the first row first."""
    order = sorted(draft.rounds[number], key=lambda other: (other.row, other.tractor))
    place = order.index(slot)
    return [draft.in_place(number, order[place - 1].tractor)] if place else []


def _lay_round(draft: Draft, number: int, slot: Slot, move_up: bool) -> None:
    """Append the legs of one tractor in one round: turn, drive in, take place, work in formation, queue; mark them."""
    job, legs = draft.job, draft.legs[slot.tractor]
    before = draft.last.get(slot.tractor)
    release = draft.last_stretch(slot.tractor) if before and before[1].row > 1 else len(legs)
    if before:
        legs += turn_legs(job, before[1].this, slot.this)
    turned = len(legs) - 1 if before else None
    entry, tool, work_task = job.entry(slot.this), job.manner.tool_m, task_on(TRACK, slot.this.track)
    legs.append(straight_leg(job, entry, 0.0, tool, task_on(DRIVE_IN, slot.this.track)))
    place_m = slot.place_m if slot.place_m > tool + SHORTEST_M else tool
    if place_m > tool:
        legs.append(straight_leg(job, entry, tool, place_m, work_task))
    placed = len(legs) - 1
    legs.append(straight_leg(job, entry, place_m, slot.hold_m, work_task))
    work, end = len(legs) - 1, slot.this.track.length + tool
    stops = [slot.hold_m, *(slot.up_m if move_up else ()), end]
    legs += [straight_leg(job, entry, a, b, work_task, may_wait=b == end) for a, b in pairwise(stops)]
    queue = tuple(range(work + 1, len(legs)))
    draft.marks[number, slot.tractor] = Marks(release, placed if turned is None else turned, placed, work, queue)
    draft.last[slot.tractor] = number, slot


def _move_up(draft: Draft) -> None:
    """In the queue, move up a place when the tractor in front has moved on."""
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            if slot.neighbour is None or slot.row == 2:
                continue
            front = draft.marks[number, slot.neighbour].queue
            for mine, other in zip(draft.marks[number, slot.tractor].queue, front, strict=False):
                draft.wait(slot.tractor, mine, [Gate(slot.neighbour, other, MOVED_ON * draft.job.manner.gap_m)])


def _hold(draft: Draft, queue: Queue, number: int, slot: Slot) -> None:
    """Add the gates of one slot: leave the queue, start together, keep the distance."""
    mine, own = draft.marks[number, slot.tractor], draft.legs[slot.tractor]
    if mine.release or not number:  # one that begins later than others is in its place before they come
        draft.wait(slot.tractor, mine.release, queue(draft, number, slot))
    others = [s.tractor for s in draft.rounds[number] if s.tractor != slot.tractor]
    draft.wait(slot.tractor, mine.work, [draft.in_place(number, other) for other in others])
    if slot.neighbour is not None:
        work = draft.marks[number, slot.neighbour].work
        own[mine.work] = replace(own[mine.work], follow=Follow(slot.neighbour, work, draft.job.manner.gap_m))
