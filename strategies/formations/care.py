"""A formation driven and mended: who lets whom go first, who waits farther off, which rounds are better taken apart.

Two of a row leave the queue together where that is clear. Where they meet on their way to a round, the one on the side
the formation moves away from waits: at first until the other has begun its turn, in the end until it is in its place.
A tractor that stands in the way waits farther back in its queue, or farther on in its place. Where nothing of that
helps, the round is divided anew.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from strategies.errors import StrategyError
from strategies.formations.abreast import Slot
from strategies.formations.clear_rounds import AS_WRITTEN, Changes
from strategies.formations.formation import Formation
from strategies.formations.grouping import key_of
from strategies.formations.queueing import past_release
from strategies.job import Pass
from strategies.record import Refined, Simulate
from vehicle.missions import THROUGH_M, Gate, Plan
from vehicle.run import CONFLICT, DONE, Conflict

BEGUN_M = (10.0, 20.0)  # how far the other has driven since it left the queue, before its place is waited for
FARTHER_M = 5.0  # a tractor in the way waits so much farther off
MOST_FARTHER_M = 20.0
NOWHERE: tuple[int, Slot | None] = (-1, None)
SAME_S = 1.0
MOST_WRITTEN = 16  # times a formation is written anew
Write = Callable[[Changes], Formation]
Pair = tuple[Pass, Pass]
"""Passes of the tractor that waits, and of the one it waits for."""
Key = tuple[object, ...]
"""What was tried."""


@dataclass(frozen=True)
class Driven:
    """A formation as it was driven in the end: its plan with its run, and what it was found to need."""

    formation: Formation
    refined: Refined
    changes: Changes
    care: dict[Pair, int]


def driven(write: Write, simulate: Simulate, like: Driven | None = None) -> Driven:
    """A formation with as little waiting as it is found to need; at least that of another which is much `like` it.

    Where nothing helps, the plan is handed back as it was first written, to be mended like any other.
    """
    changes, care = (like.changes, dict(like.care)) if like else (AS_WRITTEN, {})
    first, known = write(changes), (changes, dict(care))
    formation, plan, vain, written = first, _with_care(first.plan, first, care), set[Key](), 1
    before: tuple[Key, Conflict] | None = None
    while written <= MOST_WRITTEN:
        run = simulate(plan)
        if run.outcome == DONE:
            return Driven(formation, Refined(plan, run, told(plan)), changes, care)
        clash = run.conflict if run.outcome == CONFLICT else None
        if clash is None:
            break
        if before is not None and _same(clash, before[1]):
            vain.add(before[0])
        pair = _pair(formation, clash)
        if pair is not None and care.get(pair, 0) < len(BEGUN_M) + 1:
            care[pair] = len(BEGUN_M) + 1 if ("care", *pair) in vain else care.get(pair, 0) + 1
            plan, before = _with_care(plan, formation, {pair: care[pair]}), (("care", *pair), clash)
            continue
        found = _changed(formation, clash, changes, vain)
        if found is None:
            break
        try:
            formation, changes, written = write(found[1]), found[1], written + 1
        except StrategyError:
            break
        plan, before = _with_care(formation.plan, formation, care), (found[0], clash)
    return Driven(first, Refined(first.plan, None, told(first.plan)), *known)


def _same(one: Conflict, other: Conflict) -> bool:
    """Whether two met as they did before."""
    alike = (one.first, one.second) == (other.first, other.second)
    return alike and abs(one.time_s - other.time_s) < SAME_S


def told(plan: Plan) -> str | None:
    """What a reader of a formation plan would not expect: that not all of it is driven in formation."""
    share, apart = plan.notes.get("formation_pct"), plan.notes.get("apart")
    if share is None or not apart:
        return None
    names = [str(tractor) for tractor in apart]
    by = f"tractor {names[0]}" if len(names) == 1 else f"tractors {', '.join(names[:-1])} and {names[-1]}"
    return f"{min(round(share), 99)} % of the tracks driven in formation, the rest by {by}"


def coming(formation: Formation, clash: Conflict) -> tuple[int | None, int | None]:
    """The rounds to which two that met were on their way or at their place; None for one that was in its queue."""
    return _coming(formation, clash.first, clash.first_leg), _coming(formation, clash.second, clash.second_leg)


def _pair(formation: Formation, clash: Conflict) -> Pair | None:
    """Who should wait for whom, where both were on their way into the same round."""
    number, other = coming(formation, clash)
    if number is None or number != other:
        return None
    slots = {slot.tractor: slot for slot in formation.rounds[number]}
    first, waits = sorted((slots[clash.first], slots[clash.second]), key=_turn)
    return waits.this, first.this


def _turn(slot: Slot) -> tuple[int, int]:
    """By what two are ordered that could leave together: the one on the side the formation moves to goes first."""
    return slot.row, -slot.tractor


def _with_care(plan: Plan, formation: Formation, care: dict[Pair, int]) -> Plan:
    """The plan of a formation with further gates, of those that wait for others."""
    at = {slot.this: (number, slot) for number, slot in formation.slots}
    for (waits, first), level in care.items():
        (number, one), (same, two) = at.get(first, NOWHERE), at.get(waits, NOWHERE)
        if one is None or two is None or number != same or _turn(two) < _turn(one):
            continue
        other, tractor = one.tractor, two.tractor
        marks, legs = formation.marks[number, other], formation.plan.missions[other].legs
        placed = Gate(other, marks.placed, max(0.0, legs[marks.placed].length_m - THROUGH_M))
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


def _changed(
    formation: Formation, clash: Conflict, changes: Changes, vain: set[Key]
) -> tuple[Key, Changes] | None:
    """What to write otherwise after two met; None where nothing is left to try but what was `vain`."""
    sides = [(clash.first, clash.first_leg), (clash.second, clash.second_leg)]
    for tractor, leg in sides:
        for number, slot in formation.slots:
            marks = formation.marks[number, slot.tractor]
            if slot.tractor != tractor or not marks.placed <= leg < marks.queue[-1]:
                continue
            ahead = leg == marks.placed
            key, known = ("ahead" if ahead else "back", slot.this), changes.ahead_m if ahead else changes.back_m
            farther = {**known, slot.this: known.get(slot.this, 0.0) + FARTHER_M}
            if key not in vain and farther[slot.this] <= MOST_FARTHER_M:
                return key, replace(changes, ahead_m=farther) if ahead else replace(changes, back_m=farther)
    for number in sorted({number for number in coming(formation, clash) if number is not None}):
        passes = key_of(formation.rounds[number])
        if passes not in changes.barred:
            return ("barred", *passes), replace(changes, barred=changes.barred | {passes})
    return None
