"""Triangle formation (thesis, section 6.3): neighbouring tracks are worked abreast, rows 10 m apart.

At the headland the rows queue inside their tracks, a gap apart, and move up. When a tractor may leave the queue is what
the strategies differ in; they hand it over. When all are in place, all start together (Eq. 6.1 keeps the distance).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from fields.layout import Track
from strategies.errors import StrategyError
from strategies.job import Job, Pass
from strategies.legs import mission_from, straight_leg, task_on, turn_legs
from vehicle.missions import DRIVE_IN, TRACK, Follow, Gate, Leg, Plan

ARRIVED_M = 0.2  # a tractor counts as in place this far before the end of its leg
SHORTEST_M = 0.1
MOVED_ON = 0.8  # share of the gap after which the place in front counts as free
FORMATION_REPAIRS = 8  # a formation has its own queue: where that needs more mending, the field does not suit it
Corner = tuple[bool, int]
"""Begin at the last line? and the first direction."""
CORNERS: tuple[Corner, ...] = tuple((last, way) for last in (False, True) for way in (1, -1))


@dataclass(frozen=True)
class Slot:
    """One tractor in one round: its row (1 leads), the neighbour it follows, its pass.

    Along the track, from its beginning: `place_m` where it takes its place in formation, `hold_m` where it first
    waits in the queue, `queue_m` where the queue begins.
    """

    tractor: int
    row: int
    neighbour: int | None
    this: Pass
    place_m: float
    hold_m: float
    queue_m: float


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
class Formation:
    """A formation plan with what is needed to time its queues: per round, the slots and the marks per tractor."""

    plan: Plan
    rounds: tuple[tuple[Slot, ...], ...]
    marks: Mapping[tuple[int, int], Marks]


@dataclass(frozen=True)
class Draft:
    """A formation plan while it is written: per round the slots, the marks, and per tractor its legs so far."""

    job: Job
    rounds: list[list[Slot]]
    marks: dict[tuple[int, int], Marks]
    legs: list[list[Leg]]

    def in_place(self, number: int, tractor: int) -> Gate:
        """Gate that opens when a tractor is at its place in formation in a round."""
        return self._ended(tractor, self.marks[number, tractor].placed)

    def turned(self, number: int, tractor: int) -> Gate:
        """Gate that opens when a tractor has finished its turn into a round."""
        return self._ended(tractor, self.marks[number, tractor].turned)

    def past_release(self, number: int, tractor: int, metres: float) -> Gate:
        """Gate at a distance past the release of a tractor into a round, on whichever of its legs that is."""
        legs, leg = self.legs[tractor], self.marks[number, tractor].release
        while leg < len(legs) - 1 and metres > legs[leg].length_m:
            metres -= legs[leg].length_m
            leg += 1
        return Gate(tractor, leg, min(metres, legs[leg].length_m))

    def wait(self, tractor: int, leg: int, gates: list[Gate]) -> None:
        """Let a tractor wait for gates before one of its legs."""
        self.legs[tractor][leg] = self.legs[tractor][leg].with_gates(gates)

    def _ended(self, tractor: int, leg: int) -> Gate:
        return Gate(tractor, leg, max(0.0, self.legs[tractor][leg].length_m - ARRIVED_M))


Queue = Callable[[Draft, int, Slot], list[Gate]]
"""The gates a tractor waits for, in a round and as a slot of it, before it leaves the queue of the round before."""


def form(job: Job, name: str, queue: Queue, *, move_up: bool = True) -> Formation:
    """The plan of a formation whose tractors leave the queue as `queue` says; raises StrategyError.

    Without `move_up` each tractor stays at its first place in the queue until it is released.
    """
    draft = Draft(job, _rounds(job), {}, [[] for _ in range(job.tractors)])
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            _lay_round(draft, number, slot, move_up)
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            _hold(draft, queue, number, slot)
    if move_up:
        _move_up(draft)
    _stay_back(draft)
    plan = Plan(tuple(mission_from(own) for own in draft.legs), {"strategy": name, "tractors": job.tractors})
    return Formation(plan, tuple(tuple(slots) for slots in draft.rounds), draft.marks)


def corners_by_promise(job: Job) -> list[Corner]:
    """The four corners to begin at, the one first whose rounds and turns are estimated to take least.

    The estimate depends on the shape of the field only, not on its place or heading.
    """
    def seconds(corner: Corner) -> float:
        rounds = _passes(replace(job, corner=corner))
        work = sum(max(this.track.length for this in passes) for passes in rounds) / job.manner.work_speed_mps
        return work + sum(
            max(job.turn_time(a, b) for a, b in zip(before, after, strict=False)) for before, after in pairwise(rounds)
        )

    return sorted(CORNERS, key=lambda corner: round(seconds(corner), 3))


def _rounds(job: Job) -> list[list[Slot]]:
    """Who works which track in which round; raises StrategyError when a track is too short for it."""
    rounds = _laid(job)
    tightest = max(rounds, key=_missing)
    if _missing(tightest) > 0.0:
        raise StrategyError(f"{_too_short(job, tightest)}; {_advice(job)}.")
    return rounds


def _laid(job: Job) -> list[list[Slot]]:
    """Who works which track in which round, whether the tracks are long enough or not."""
    return [_slots(job, passes, (job.tractors - len(passes)) // 2) for passes in _passes(job)]


def _missing(slots: list[Slot]) -> float:
    """Metres a round lacks between the places in formation and those in the queue; 0 or less when it lacks none."""
    return max(slot.place_m + SHORTEST_M - slot.hold_m for slot in slots)


def _too_short(job: Job, slots: list[Slot]) -> str:
    """Which track leaves no room, and how much room there would have to be."""
    track = min((slot.this.track for slot in slots), key=lambda track: track.length)
    rows, gap = max(slot.row for slot in slots), job.manner.gap_m
    takes = max((rows - row) * gap + max((row - 1) * gap, job.manner.hold_back_m) for row in range(1, rows + 1))
    shape = f"a formation of {rows} rows {gap:g} m apart with its queue" if rows > 1 else "a queue at its end"
    return (
        f"Track {track.line} is {track.length:.1f} m long, too short for {shape}: that takes "
        f"{takes + SHORTEST_M:.1f} m where tracks end side by side, and lacks {_missing(slots):.1f} m here"
    )


def _advice(job: Job) -> str:
    """The largest smaller formation that has room on every track, if there is one, and other strategies."""
    corners = CORNERS if job.layout.field.entrance is None else (job.corner,)
    for tractors in range(job.tractors - 1, 1, -1):
        for corner in corners:
            rounds = _laid(replace(job, tractors=tractors, corner=corner))
            if all(_missing(slots) <= 0.0 for slots in rounds):
                return f"use {tractors} tractors, or split-field or interleaved"
    other = "use split-field or interleaved"
    return f"no smaller formation fits either, {other}" if job.tractors > 2 else other


def _passes(job: Job) -> list[list[Pass]]:
    """Tracks of each round, from one side of the field to the other, in alternating directions."""
    tracks = _whole_lines(job)
    from_last, direction = job.corner or (False, 1)
    if from_last:
        tracks = tracks[::-1]
    starts = range(0, len(tracks), job.tractors)
    return [
        [Pass(track, direction if number % 2 == 0 else -direction) for track in tracks[first : first + job.tractors]]
        for number, first in enumerate(starts)
    ]


def _whole_lines(job: Job) -> list[Track]:
    tracks = list(job.layout.tracks)
    if len({track.line for track in tracks}) < len(tracks):
        raise StrategyError(
            "A formation needs every track in one piece; a hole or a notch interrupts some here. "
            "Use split-field or interleaved."
        )
    if len(tracks) < job.tractors:
        raise StrategyError(
            f"{job.tractors} tractors are more than the {len(tracks)} tracks of the field; "
            f"use {len(tracks)} or fewer."
        )
    return tracks


def _slots(job: Job, passes: list[Pass], offset: int) -> list[Slot]:
    """Slots of one round; places are set from the last row forwards, each a gap ahead of the row behind it."""
    leader = (job.tractors - 1) // 2 - offset
    rows = [abs(index - leader) + 1 for index in range(len(passes))]
    along = [_along(job, this) for this in passes]
    own = [start + job.manner.tool_m for start in along]
    place = list(own)
    for row in range(max(rows) - 1, 0, -1):
        behind = [place[i] for i in range(len(passes)) if rows[i] == row + 1]
        for index in (i for i in range(len(passes)) if rows[i] == row):
            place[index] = max(own[index], max(behind) + job.manner.gap_m)
    ends = [start + this.track.length + job.manner.tool_m for start, this in zip(along, passes, strict=True)]
    slots = []
    for index, this in enumerate(passes):
        front = min(ends[i] for i in range(len(passes)) if i == index or rows[i] < rows[index])
        queue_m, place_m = front - along[index], place[index] - along[index]
        hold_m = queue_m - max((rows[index] - 1) * job.manner.gap_m, job.manner.hold_back_m)
        neighbour = None if rows[index] == 1 else offset + index + (1 if index < leader else -1)
        slots.append(Slot(offset + index, rows[index], neighbour, this, place_m, hold_m, queue_m))
    return slots


def _along(job: Job, this: Pass) -> float:
    """Where a pass begins, measured in its direction of travel."""
    x, y, heading = job.entry(this)
    return x * math.cos(heading) + y * math.sin(heading)


def _lay_round(draft: Draft, number: int, slot: Slot, move_up: bool) -> None:
    """Append the legs of one tractor in one round: turn, drive in, take place, work in formation, queue; mark them."""
    job, legs = draft.job, draft.legs[slot.tractor]
    last = draft.marks.get((number - 1, slot.tractor))
    before = next((s for s in draft.rounds[number - 1] if s.tractor == slot.tractor), None) if number else None
    release = last.queue[-1] if last and before and before.row > 1 else len(legs)
    if before:
        legs += turn_legs(job, before.this, slot.this)
    turned = len(legs) - 1 if before else None
    entry, tool, work_task = job.entry(slot.this), job.manner.tool_m, task_on(TRACK, slot.this.track)
    legs.append(straight_leg(job, entry, 0.0, tool, task_on(DRIVE_IN, slot.this.track)))
    if slot.place_m > tool + SHORTEST_M:
        legs.append(straight_leg(job, entry, tool, slot.place_m, work_task))
    placed = len(legs) - 1
    end, gap = slot.this.track.length + tool, job.manner.gap_m
    stops = [slot.hold_m]
    legs.append(straight_leg(job, entry, max(slot.place_m, tool), stops[0], work_task))
    work = len(legs) - 1
    stops += [slot.queue_m - row * gap for row in range(slot.row - 2, 0, -1)] if move_up else []
    stops.append(end)
    legs += [straight_leg(job, entry, a, b, work_task, may_wait=b == end) for a, b in pairwise(stops)]
    queue = tuple(range(work + 1, len(legs)))
    draft.marks[number, slot.tractor] = Marks(release, placed if turned is None else turned, placed, work, queue)


def _move_up(draft: Draft) -> None:
    """In the queue, move up a place when the tractor in front has moved on."""
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            if slot.neighbour is None or slot.row == 2:
                continue
            front = draft.marks[number, slot.neighbour].queue
            for mine, other in zip(draft.marks[number, slot.tractor].queue, front, strict=False):
                draft.wait(slot.tractor, mine, [Gate(slot.neighbour, other, MOVED_ON * draft.job.manner.gap_m)])


def _stay_back(draft: Draft) -> None:
    """A tractor without a track in the last round finishes its own only when the others have turned away."""
    if len(draft.rounds) < 2:
        return
    number = len(draft.rounds) - 1
    last = {slot.tractor for slot in draft.rounds[number]}
    for slot in draft.rounds[number - 1]:
        queue = draft.marks[number - 1, slot.tractor].queue
        if slot.tractor not in last and queue:
            draft.wait(slot.tractor, queue[-1], [draft.turned(number, other) for other in sorted(last)])


def _hold(draft: Draft, queue: Queue, number: int, slot: Slot) -> None:
    """Add the gates of one slot: leave the queue, start together, keep the distance."""
    mine, own = draft.marks[number, slot.tractor], draft.legs[slot.tractor]
    draft.wait(slot.tractor, mine.release, queue(draft, number, slot))
    others = [s.tractor for s in draft.rounds[number] if s.tractor != slot.tractor]
    draft.wait(slot.tractor, mine.work, [draft.in_place(number, other) for other in others])
    if slot.neighbour is not None:
        work = draft.marks[number, slot.neighbour].work
        own[mine.work] = replace(own[mine.work], follow=Follow(slot.neighbour, work, draft.job.manner.gap_m))
