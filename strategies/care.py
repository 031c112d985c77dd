"""A formation driven and mended: who lets whom go first, who waits farther off, which rounds are better taken apart.

Two of a row leave the queue together where that is clear. Where they meet on their way to a round, the one on the side
the formation moves away from waits: at first until the other has begun its turn, in the end until it is in its place.
A tractor that stands in the way waits farther back in its queue, or farther on in its place. Where nothing of that
helps, the round is divided anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from strategies.clear_rounds import AS_WRITTEN, Changes
from strategies.errors import StrategyError
from strategies.formation import Formation
from strategies.grouping import key_of
from strategies.job import Pass
from strategies.queueing import ARRIVED_M, past_release
from strategies.record import Refined, Simulate
from vehicle.missions import Gate, Plan
from vehicle.run import CONFLICT, DONE, Conflict

BEGUN_M = (10.0, 20.0)  # how far the other has driven since it left the queue, before its place is waited for
FARTHER_M = 5.0  # a tractor in the way waits so much farther off
MOST_FARTHER_M = 20.0
MOST_WRITTEN = 16  # times a formation is written anew
Write = Callable[[Changes], Formation]
Pair = tuple[Pass, Pass]
"""Passes of the tractor that waits, and of the one it waits for."""


def driven(write: Write, simulate: Simulate, changes: Changes = AS_WRITTEN) -> tuple[Formation, Refined]:
    """A formation with as little waiting as it is found to need, its plan and its run.

    `changes` are known to be needed from the start. Where nothing helps, the plan is handed back as it was first
    written, to be mended like any other.
    """
    first = formation = write(changes)
    care, written = dict[Pair, int](), 1
    while written <= MOST_WRITTEN:
        plan = _with_care(formation, care)
        run = simulate(plan)
        if run.outcome == DONE:
            return formation, Refined(plan, run, told(plan))
        if run.outcome != CONFLICT or run.conflict is None:
            break
        pair = _pair(formation, run.conflict)
        if pair is not None and care.get(pair, 0) <= len(BEGUN_M):
            care[pair] = care.get(pair, 0) + 1
            continue
        again = _changed(formation, run.conflict, changes)
        if again is None:
            break
        try:
            formation, changes, written = write(again), again, written + 1
        except StrategyError:
            break
    return first, Refined(first.plan, None, told(first.plan))


def told(plan: Plan) -> str | None:
    """What a reader of a formation plan would not expect: that not all of it is driven in formation."""
    share, apart = plan.notes.get("formation_pct"), plan.notes.get("apart")
    if share is None or not apart:
        return None
    names = [str(tractor) for tractor in apart]
    by = f"tractor {names[0]}" if len(names) == 1 else f"tractors {', '.join(names[:-1])} and {names[-1]}"
    return f"{min(round(share), 99)} % of the tracks driven in formation, the rest by {by}"


def met_on_way(formation: Formation, clash: Conflict) -> int | None:
    """The round into which both were on their way; None where they met elsewhere."""
    one, other = _coming(formation, clash.first, clash.first_leg), _coming(formation, clash.second, clash.second_leg)
    return one if one == other else None


def _pair(formation: Formation, clash: Conflict) -> Pair | None:
    """Who should wait for whom, where both were on their way into the same round."""
    number = met_on_way(formation, clash)
    if number is None:
        return None
    slots = {slot.tractor: slot for slot in formation.rounds[number]}
    ones = [slots[clash.first], slots[clash.second]]
    first, waits = sorted(ones, key=lambda slot: (slot.row, -slot.tractor))
    return waits.this, first.this


def _with_care(formation: Formation, care: dict[Pair, int]) -> Plan:
    """The plan of a formation with the gates of those that wait for others."""
    plan, at = formation.plan, {slot.this: (number, slot.tractor) for number, slot in formation.slots}
    for (waits, first), level in care.items():
        if waits not in at or first not in at or at[waits][0] != at[first][0]:
            continue
        (number, other), (_, tractor) = at[first], at[waits]
        marks, legs = formation.marks[number, other], formation.plan.missions[other].legs
        placed = Gate(other, marks.placed, max(0.0, legs[marks.placed].length_m - ARRIVED_M))
        gates = [past_release(legs, marks, other, metres) for metres in BEGUN_M] + [placed]
        plan = plan.with_gate(tractor, formation.marks[number, tractor].release, gates[level - 1])
    return plan


def _coming(formation: Formation, tractor: int, leg: int) -> int | None:
    """The round a tractor is on its way to, or at its place in, on a leg."""
    for number in range(len(formation.rounds)):
        marks = formation.marks.get((number, tractor))
        if marks and marks.release <= leg <= marks.placed:
            return number
    return None


def _changed(formation: Formation, clash: Conflict, changes: Changes) -> Changes | None:
    """What to write otherwise after two met; None where nothing is left to try."""
    sides = [(clash.first, clash.first_leg), (clash.second, clash.second_leg)]
    for tractor, leg in sides:
        for number, slot in formation.slots:
            marks = formation.marks[number, slot.tractor]
            if slot.tractor != tractor or not marks.placed <= leg <= marks.queue[-1]:
                continue
            back, ahead = changes.back_m.get(slot.this, 0.0), changes.ahead_m.get(slot.this, 0.0)
            if leg == marks.placed and ahead < MOST_FARTHER_M:
                return replace(changes, ahead_m={**changes.ahead_m, slot.this: ahead + FARTHER_M})
            if marks.work <= leg < marks.queue[-1] and back < MOST_FARTHER_M:
                return replace(changes, back_m={**changes.back_m, slot.this: back + FARTHER_M})
    coming = sorted({n for n in (_coming(formation, *side) for side in sides) if n is not None})
    for number in coming:
        if key_of(formation.rounds[number]) not in changes.barred:
            return replace(changes, barred=changes.barred | {key_of(formation.rounds[number])})
    return None
