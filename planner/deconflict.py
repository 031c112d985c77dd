"""Make tractors give way: simulate, and where two come too close let one wait before it enters the headland.

Every plan has, on every pass, a last stretch as a leg of its own; a tractor that gives way waits before it, inside
its own track. The tractor that came later gives way; if that has been tried, the other one does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from vehicle.missions import Gate, Plan
from vehicle.run import CONFLICT, DONE, Conflict, Run

CLEAR_M = 10.0  # the other must have driven this far past the place of the conflict
MOST_REPAIRS = 60

Simulate = Callable[[Plan], Run]


def without_conflicts(plan: Plan, simulate: Simulate) -> tuple[Run, str | None]:
    """Simulate and repair until the plan is done; the last run, and why it is not feasible when it is not."""
    tried: set[tuple[int, int, int]] = set()
    for _ in range(MOST_REPAIRS):
        run = simulate(plan)
        if run.outcome == DONE:
            return run, None
        if run.outcome != CONFLICT or run.conflict is None:
            return run, "tractors wait for each other and none moves any more"
        repaired = _repair(plan, run, run.conflict, tried)
        if repaired is None:
            break
        plan = repaired
    clash = run.conflict
    assert clash is not None
    return run, f"tractors {clash.first + 1} and {clash.second + 1} come into contact after {clash.time_s:.0f} s"


def _repair(plan: Plan, run: Run, clash: Conflict, tried: set[tuple[int, int, int]]) -> Plan | None:
    sides = [(clash.first, clash.first_leg, clash.first_m), (clash.second, clash.second_leg, clash.second_m)]
    entered = [_entered(plan, run, tractor, leg) for tractor, leg, _ in sides]
    order = [0, 1] if entered[0] > entered[1] else [1, 0]
    for index in order:
        (waiter, leg, _), (other, other_leg, metres) = sides[index], sides[1 - index]
        hold = hold_leg(plan, waiter, leg)
        if (waiter, hold, other) in tried or _finished(run, other):
            continue
        tried.add((waiter, hold, other))
        return plan.with_gate(waiter, hold, _past(plan, other, other_leg, metres + CLEAR_M))
    return None


def hold_leg(plan: Plan, tractor: int, leg: int) -> int:
    """The leg before which a tractor should have waited: the last stretch of its pass, or its very first leg."""
    legs = plan.missions[tractor].legs
    while leg > 0:
        last_stretch = legs[leg].kind == "work" and (leg + 1 == len(legs) or legs[leg + 1].kind != "work")
        if last_stretch and legs[leg - 1].kind == "work":
            return leg
        leg -= 1
    return 0


def _entered(plan: Plan, run: Run, tractor: int, leg: int) -> float:
    """When the tractor passed the place where it could have waited."""
    return float(np.argmax(run.record[:, tractor, 5] >= hold_leg(plan, tractor, leg)))


def _finished(run: Run, tractor: int) -> bool:
    return bool(np.isfinite(run.finish_s[tractor]))


def _past(plan: Plan, tractor: int, leg: int, metres: float) -> Gate:
    """Gate that opens when the tractor has driven so far from the start of a leg, on that or a later leg."""
    legs = plan.missions[tractor].legs
    while leg < len(legs) - 1 and metres > legs[leg].length_m:
        metres -= legs[leg].length_m
        leg += 1
    return Gate(tractor, leg, max(0.0, min(metres, legs[leg].length_m)))
