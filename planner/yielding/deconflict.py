"""Make tractors give way: simulate, and where two come too close let some wait where they may stand.

Every plan marks the legs before which a tractor may wait: the last stretch of every pass, inside its own track, and
the start. At the first conflict all of the plan is scheduled (giving_way). What still conflicts then is mended one by
one: the tractor that came later gives way, at first until the other is clear of the place, then until the other has
finished its turn; if neither helps, the other one gives way instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from planner.yielding.giving_way import Scheduled
from strategies.record import MOST_REPAIRS, Simulate
from vehicle.missions import DRIVE_IN, ROUND, THROUGH_M, Gate, Leg, Plan
from vehicle.run import CONFLICT, DONE, STALL, Conflict, Run

CLEAR_M = 10.0  # the other must have driven this far past the place of the conflict
SLACKS = (1.0, 2.0)  # times the usual time between two tractors, one after the other
FEW = 6  # more rarely mend what was scheduled
WAITED = 1.01  # where a schedule takes so much longer than all would alone, mending may be quicker
TRIED = 10  # times that it is mended then

GiveWay = Callable[[Plan, float], Scheduled | None]
"""The plan with gates so that nobody meets another, keeping so many times the usual time; None where none is found."""
Key = tuple[int, int, int]
"""(tractor that waits, leg it waits before, tractor it waits for)."""


@dataclass
class Repairs:
    """Who gives way to whom: the gates in force, which of them wait for a whole turn, and what has failed."""

    gates: dict[Key, Gate] = field(default_factory=dict)
    whole_turn: set[Key] = field(default_factory=set)
    failed: set[Key] = field(default_factory=set)
    rival: dict[Key, tuple[Key, Gate]] = field(default_factory=dict)

    def applied(self, plan: Plan) -> Plan:
        """The plan with all gates in force."""
        for (waiter, hold, _), gate in self.gates.items():
            plan = plan.with_gate(waiter, hold, gate)
        return plan

    def swap_last(self) -> bool:
        """Let the other one wait instead of the last that was told to; False when that has failed too."""
        while self.gates:
            key, _ = self.gates.popitem()
            self.failed.add(key)
            other = self.rival.get(key)
            if other and other[0] not in self.failed:
                self.gates[other[0]] = other[1]
                return True
        return False


def without_conflicts(
    plan: Plan, simulate: Simulate, most: int = MOST_REPAIRS, give_way: GiveWay | None = None
) -> tuple[Run, str | None]:
    """Simulate, let tractors give way and repair, at most so often, until the plan is done.

    Returns the last run, and why the plan is not feasible when it is not.
    """
    run = simulate(plan)
    if run.outcome == DONE or give_way is None:
        return (run, None) if run.outcome == DONE else _repaired(plan, run, simulate, most)
    first, last = run, (plan, run)
    for slack in SLACKS if run.outcome == CONFLICT else ():
        scheduled = give_way(plan, slack)
        if scheduled is None:
            break
        latest = simulate(scheduled.plan)
        if latest.outcome == DONE and scheduled.predicted_s > WAITED * scheduled.alone_s:
            return _quicker(latest, *_repaired(plan, first, simulate, min(most, TRIED))), None
        if latest.outcome == DONE:
            return latest, None
        last = scheduled.plan, latest
    run, why = _repaired(*last, simulate, min(most, FEW))
    return run, why and _why(run, first.conflict)


def _quicker(run: Run, other: Run, fault: str | None) -> Run:
    """The run that is done sooner."""
    return other if fault is None and other.duration_s < run.duration_s else run


def _repaired(plan: Plan, run: Run, simulate: Simulate, most: int) -> tuple[Run, str | None]:
    """Mend a plan from its first run on, one order to give way at a time.

    Where these hold tractors up in a circle the plan is never done, and is not driven to see that.
    """
    repairs = Repairs()
    first: Conflict | None = None
    for number in range(most):
        if number:
            tried = repairs.applied(plan)
            if not gates_can_open(tried):
                if not repairs.swap_last():
                    break
                continue
            run = simulate(tried)
        if run.outcome == DONE:
            return run, None
        if run.outcome == CONFLICT and run.conflict is not None:
            first = first or run.conflict
            mended = _mend(plan, run, run.conflict, repairs)
        else:
            mended = run.outcome == STALL and repairs.swap_last()
        if not mended:
            break
    return run, _why(run, first)


def gates_can_open(plan: Plan) -> bool:
    """Whether all legs can be begun one after another; False where tractors wait for each other in a circle."""
    begun = [0] * plan.tractors  # legs whose gates are open
    moved = True
    while moved:
        moved = False
        for tractor, mission in enumerate(plan.missions):
            before = begun[tractor]
            while begun[tractor] < len(mission.legs) and all(
                gate.leg < begun[gate.tractor] for gate in mission.legs[begun[tractor]].gates
            ):
                begun[tractor] += 1
            moved = moved or begun[tractor] > before
    return all(count == len(mission.legs) for count, mission in zip(begun, plan.missions, strict=True))


def _why(run: Run, clash: Conflict | None) -> str:
    """What first went wrong, in words."""
    if clash is not None:
        return (
            f"tractors {clash.first + 1} and {clash.second + 1} meet after {clash.time_s:.0f} s, "
            "and no way of giving way that was tried avoids it; fewer tractors, or another headland, may"
        )
    if run.outcome == STALL:
        return "tractors wait for each other and none moves any more"
    return f"a tractor loses its way: not done after {run.time_s[-1]:.0f} s"


def _mend(plan: Plan, run: Run, clash: Conflict, repairs: Repairs) -> bool:
    """Add, strengthen or swap one order to give way; False when nothing is left to try."""
    sides = [(clash.first, clash.first_leg, clash.first_m), (clash.second, clash.second_leg, clash.second_m)]
    holds = [hold_leg(plan, tractor, leg) for tractor, leg, _ in sides]
    entered = [float(np.argmax(run.leg(side[0]) >= hold)) for side, hold in zip(sides, holds, strict=True)]
    later = 0 if entered[0] > entered[1] else 1
    order = [later, 1 - later]
    keys: list[Key] = [(sides[i][0], holds[i], sides[1 - i][0]) for i in (0, 1)]
    clear = [_past(plan, *sides[1 - i], CLEAR_M) for i in (0, 1)]
    for index in order:
        key = keys[index]
        if key in repairs.failed or np.isfinite(run.finish_s[key[2]]):
            continue
        repairs.rival[key] = keys[1 - index], clear[1 - index]
        if key not in repairs.gates:
            repairs.gates[key] = clear[index]
            return True
        if key not in repairs.whole_turn:
            repairs.whole_turn.add(key)
            repairs.gates[key] = _turned(plan, *sides[1 - index][:2])
            return True
        del repairs.gates[key]
        repairs.failed.add(key)
    return False


def hold_leg(plan: Plan, tractor: int, leg: int) -> int:
    """The leg before which a tractor should have waited: the last where it may, or its very first leg."""
    legs = plan.missions[tractor].legs
    return next((index for index in range(leg, 0, -1) if legs[index].may_wait), 0)


def _past(plan: Plan, tractor: int, leg: int, metres: float, more: float) -> Gate:
    """Gate that opens when the tractor has driven `metres` + `more` from the start of a leg, or has driven in.

    It never lies on the track after a turn: there the tractor may itself wait for others.
    """
    legs = plan.missions[tractor].legs
    metres += more
    while metres > legs[leg].length_m and not _ends_turn(legs, leg):
        metres -= legs[leg].length_m
        leg += 1
    return Gate(tractor, leg, max(0.0, min(metres, legs[leg].length_m - THROUGH_M)))


def _turned(plan: Plan, tractor: int, leg: int) -> Gate:
    """Gate that opens when the tractor has driven in on its next track, or has finished."""
    legs = plan.missions[tractor].legs
    while not _ends_turn(legs, leg):
        leg += 1
    return Gate(tractor, leg, max(0.0, legs[leg].length_m - THROUGH_M))


def _ends_turn(legs: tuple[Leg, ...], leg: int) -> bool:
    """Whether a leg drives in on a track, leads to where a side of a round begins, or is the last of all."""
    if leg == len(legs) - 1 or legs[leg].task.kind == DRIVE_IN:
        return True
    return legs[leg].task.kind != ROUND and legs[leg + 1].task.kind == ROUND
