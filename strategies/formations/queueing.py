"""A formation plan while it is written: legs of every round, the queue at its end, and who waits for whom.

At the headland the rows queue inside their swaths, a gap apart, and move up. When all are in place in the next round,
all start together (Eq. 6.1 keeps the distance).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from strategies.formations.slots import SHORTEST_M, FormationSlot
from strategies.program.field_job import FieldJob
from strategies.program.legs import build_turn_legs, get_straight_leg, make_swath_task
from vehicle.missions.plan import DRIVE_IN, GATE_MARGIN_M, SWATH, FollowOrder, Leg, LegGate

MOVED_ON_GAP_SHARE = 0.8  # share of the gap the tractor in front must have driven


@dataclass(frozen=True)
class RoundMarks:
    """Leg numbers of one tractor in one round.

    `release_leg` is the first leg after the queue of the round before, `turn_leg` the last leg of the turn, `place_leg`
    the leg that ends at the place in formation, `work_leg` the leg worked in formation, `queue_legs` the legs after it
    up to the end of the swath: moving up, then the last part.
    """

    release_leg: int
    turn_leg: int
    place_leg: int
    work_leg: int
    queue_legs: tuple[int, ...]


@dataclass(frozen=True)
class FormationDraft:
    """A formation plan while it is written.

    Per round the slots, and whether the tractors come to it `from_afar`; the marks by (round, tractor); per tractor its
    legs so far, and in `last_slots` its last round with its slot there.
    """

    job: FieldJob
    rounds: list[list[FormationSlot]]
    from_afar: list[bool]
    marks: dict[tuple[int, int], RoundMarks]
    legs: list[list[Leg]]
    last_slots: dict[int, tuple[int, FormationSlot]] = field(default_factory=dict)

    def build_place_gate(self, number: int, tractor: int) -> LegGate:
        """Gate that opens when a tractor is at its place in formation in a round."""
        return self.build_end_gate(tractor, self.marks[number, tractor].place_leg)

    def build_turn_gate(self, number: int, tractor: int) -> LegGate:
        """Gate that opens when a tractor has finished its turn into a round."""
        return self.build_end_gate(tractor, self.marks[number, tractor].turn_leg)

    def add_wait(self, tractor: int, leg: int, gates: list[LegGate]) -> None:
        """Let a tractor wait for gates before one of its legs."""
        self.legs[tractor][leg] = self.legs[tractor][leg].copy_with_gates(gates)

    def build_end_gate(self, tractor: int, leg: int) -> LegGate:
        """Gate that opens when a tractor is almost at the end of a leg."""
        return LegGate(tractor, leg, max(0.0, self.legs[tractor][leg].length_m - GATE_MARGIN_M))

    def find_last_leg(self, tractor: int) -> int:
        """The leg with which a tractor ends its last round."""
        return self.marks[self.last_slots[tractor][0], tractor].queue_legs[-1]


def build_release_gate(legs: Sequence[Leg], marks: RoundMarks, tractor: int, distance_m: float) -> LegGate:
    """Gate at a distance past the release of a tractor into a round, on the leg that this distance reaches."""
    leg = marks.release_leg
    while leg < len(legs) - 1 and distance_m > legs[leg].length_m:
        distance_m -= legs[leg].length_m
        leg += 1
    return LegGate(tractor, leg, min(distance_m, legs[leg].length_m))


QueueRule = Callable[[FormationDraft, int, FormationSlot], list[LegGate]]
"""Gives the gates that a tractor (round, slot) waits for before it leaves the queue of the round before."""


def write_formation_legs(draft: FormationDraft, queue_rule: QueueRule, *, move_up: bool) -> None:
    """Write the legs of all rounds with the gates of their queues.

    Without `move_up` each tractor stays at its first place in the queue until it is released.
    """
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            _write_slot_legs(draft, number, slot, move_up)
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            _add_slot_gates(draft, _build_single_file_gates if draft.from_afar[number] else queue_rule, number, slot)
    if move_up:
        _add_move_up_legs(draft)


def hold_back_idle(draft: FormationDraft) -> None:
    """A tractor without a swath in the last round finishes its own only when the others have turned away."""
    number = len(draft.rounds) - 1
    last_tractors = sorted(slot.tractor for slot in draft.rounds[number])
    for tractor in sorted(set(draft.last_slots) - set(last_tractors)):
        draft.add_wait(
            tractor,
            draft.find_last_leg(tractor),
            [draft.build_turn_gate(number, other_tractor) for other_tractor in last_tractors],
        )


def _build_single_file_gates(draft: FormationDraft, number: int, slot: FormationSlot) -> list[LegGate]:
    """On a longer path to a round the next tractor follows when the one before it is in place, the first row first."""
    order = sorted(draft.rounds[number], key=lambda other: (other.row, other.tractor))
    position = order.index(slot)
    return [draft.build_place_gate(number, order[position - 1].tractor)] if position else []


def _write_slot_legs(draft: FormationDraft, number: int, slot: FormationSlot, move_up: bool) -> None:
    """Append the legs of one tractor in one round (turn, drive in, take place, work, queue) and mark them."""
    job, legs = draft.job, draft.legs[slot.tractor]
    last_round = draft.last_slots.get(slot.tractor)
    release_leg = draft.find_last_leg(slot.tractor) if last_round and last_round[1].row > 1 else len(legs)
    if last_round:
        legs += build_turn_legs(job, last_round[1].swath_pass, slot.swath_pass)
    turn_leg = len(legs) - 1 if last_round else None
    entry, tool_m = job.get_entry_pose(slot.swath_pass), job.driving_rules.tool_m
    work_task = make_swath_task(SWATH, slot.swath_pass.swath)
    legs.append(get_straight_leg(job, entry, 0.0, tool_m, make_swath_task(DRIVE_IN, slot.swath_pass.swath)))
    place_m = slot.place_m if slot.place_m > tool_m + SHORTEST_M else tool_m
    if place_m > tool_m:
        legs.append(get_straight_leg(job, entry, tool_m, place_m, work_task))
    place_leg = len(legs) - 1
    legs.append(get_straight_leg(job, entry, place_m, slot.hold_m, work_task))
    work_leg, end_m = len(legs) - 1, slot.swath_pass.swath.length_m + tool_m
    stops_m = [slot.hold_m, *(slot.up_m if move_up else ()), end_m]
    legs += [get_straight_leg(job, entry, a, b, work_task, may_wait=b == end_m) for a, b in pairwise(stops_m)]
    queue_legs = tuple(range(work_leg + 1, len(legs)))
    draft.marks[number, slot.tractor] = RoundMarks(
        release_leg, place_leg if turn_leg is None else turn_leg, place_leg, work_leg, queue_legs
    )
    draft.last_slots[slot.tractor] = number, slot


def _add_move_up_legs(draft: FormationDraft) -> None:
    """In the queue, move up a place when the tractor in front has moved on."""
    for number, slots in enumerate(draft.rounds):
        for slot in slots:
            if slot.neighbour is None or slot.row == 2:
                continue
            front_legs = draft.marks[number, slot.neighbour].queue_legs
            for own_leg, front_leg in zip(draft.marks[number, slot.tractor].queue_legs, front_legs, strict=False):
                draft.add_wait(
                    slot.tractor,
                    own_leg,
                    [LegGate(slot.neighbour, front_leg, MOVED_ON_GAP_SHARE * draft.job.driving_rules.gap_m)],
                )


def _add_slot_gates(draft: FormationDraft, queue_rule: QueueRule, number: int, slot: FormationSlot) -> None:
    """Add the gates of one slot: leave the queue, start together, keep the distance."""
    own_marks, own_legs = draft.marks[number, slot.tractor], draft.legs[slot.tractor]
    if own_marks.release_leg or not number:  # whoever begins in a later round is in its place before the others come
        draft.add_wait(slot.tractor, own_marks.release_leg, queue_rule(draft, number, slot))
    other_tractors = [s.tractor for s in draft.rounds[number] if s.tractor != slot.tractor]
    draft.add_wait(
        slot.tractor,
        own_marks.work_leg,
        [draft.build_place_gate(number, other_tractor) for other_tractor in other_tractors],
    )
    if slot.neighbour is not None:
        neighbour_leg = draft.marks[number, slot.neighbour].work_leg
        own_legs[own_marks.work_leg] = replace(
            own_legs[own_marks.work_leg],
            follow=FollowOrder(slot.neighbour, neighbour_leg, draft.job.driving_rules.gap_m),
        )
