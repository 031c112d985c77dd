"""Make tractors give way: simulate a plan, and where two come too close schedule the whole of it.

Every plan marks the legs before which a tractor may wait: the last part of every pass, inside its own swath, and the
start. The schedule says who goes first everywhere (precedence), with more time between two if the usual is too little.
It needs to know a way home for all at any time. Where there is none, as tractors are already on their way, or where
two still meet, conflicts are repaired one by one: the tractor that came later waits, first until the other is clear of
the place, then until the other has finished its turn; if neither helps, the other one waits instead.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from fields.units import KMH_PER_MPS
from vehicle.missions.plan import Leg, LegGate, Plan
from vehicle.missions.run import CONFLICT, DONE, STALL, Conflict, SimulationRun
from vehicle.records import REC_PLACE, REC_SPEED, REC_STATUS, WAITING, WORKING

SCHEDULE_SLACKS = (1.0, 2.0)  # times the usual time between two tractors, tried in this order
MAX_REPAIRS, MAX_SCHEDULED_REPAIRS = 40, 6  # of a plan without a schedule, and of one with; more rarely help
CONFLICT_CLEAR_M = 10.0  # the other must have driven this far past the place of the conflict
SLOW_WORK_SHARE = 0.8  # of the planned speed: less is told
MIN_MOVING_MPS = 0.05  # less is said to be standing

Simulate = Callable[[Plan], SimulationRun]
"""Simulates a plan until it is done, two tractors come too close, or nothing moves any more."""
Scheduler = Callable[[Plan, float], Plan | None]
"""Adds gates so that no tractors meet, with a slack (times the usual time between two); None if it finds none."""
WaitKey = tuple[int, int, int]
"""(tractor that waits, leg it waits before, tractor it waits for)."""


@dataclass
class ConflictRepairs:
    """Who gives way to whom: the gates in use, which of them wait for a whole turn, and what has failed."""

    gates: dict[WaitKey, LegGate] = field(default_factory=dict)
    whole_turn: set[WaitKey] = field(default_factory=set)
    failed_keys: set[WaitKey] = field(default_factory=set)
    alternatives: dict[WaitKey, tuple[WaitKey, LegGate]] = field(default_factory=dict)

    def add_gates_to_plan(self, plan: Plan) -> Plan:
        """The plan with all gates in use."""
        for (waiter, hold, _), gate in self.gates.items():
            plan = plan.copy_with_gate(waiter, hold, gate)
        return plan

    def swap_last_wait(self) -> bool:
        """Let the other tractor wait instead of the last that was made to wait; False if that has failed too."""
        while self.gates:
            key, _ = self.gates.popitem()
            self.failed_keys.add(key)
            alternative = self.alternatives.get(key)
            if alternative and alternative[0] not in self.failed_keys:
                self.gates[alternative[0]] = alternative[1]
                return True
        return False


def resolve_conflicts(plan: Plan, simulate: Simulate, schedule: Scheduler) -> tuple[SimulationRun, str | None]:
    """The last run of a plan, and why it is not feasible, or None; tractors give way where it must be."""
    first = simulate(plan)
    last_plan, run, repairs = plan, first, MAX_REPAIRS
    for slack in SCHEDULE_SLACKS if first.outcome == CONFLICT else ():
        scheduled_plan = schedule(plan, slack)
        if scheduled_plan is None:
            break
        last_plan, run, repairs = scheduled_plan, simulate(scheduled_plan), MAX_SCHEDULED_REPAIRS
        if run.outcome == DONE:
            return run, None
    run, reason = _repair_plan(last_plan, run, simulate, repairs)
    return run, reason and _explain_failure(run, first.conflict)


def _repair_plan(
    plan: Plan, run: SimulationRun, simulate: Simulate, max_repairs: int
) -> tuple[SimulationRun, str | None]:
    """Repair a plan from its first run on, one wait at a time.

    A plan whose gates form a circle never finishes and is not simulated.
    """
    repairs = ConflictRepairs()
    first_conflict: Conflict | None = None
    for number in range(max_repairs):
        if number:
            tried_plan = repairs.add_gates_to_plan(plan)
            if not can_gates_open(tried_plan):
                if not repairs.swap_last_wait():
                    break
                continue
            run = simulate(tried_plan)
        if run.outcome == DONE:
            return run, None
        if run.outcome == CONFLICT and run.conflict is not None:
            first_conflict = first_conflict or run.conflict
            is_repaired = _repair_conflict(plan, run, run.conflict, repairs)
        else:
            is_repaired = run.outcome == STALL and repairs.swap_last_wait()
        if not is_repaired:
            break
    return run, _explain_failure(run, first_conflict)


def can_gates_open(plan: Plan) -> bool:
    """Whether all legs can be begun one after another; False if tractors wait for each other in a circle."""
    begun_legs = [0] * plan.tractors  # legs whose gates are open
    has_moved = True
    while has_moved:
        has_moved = False
        for tractor, mission in enumerate(plan.missions):
            begun_before = begun_legs[tractor]
            while begun_legs[tractor] < len(mission.legs) and all(
                gate.leg < begun_legs[gate.tractor] for gate in mission.legs[begun_legs[tractor]].gates
            ):
                begun_legs[tractor] += 1
            has_moved = has_moved or begun_legs[tractor] > begun_before
    return all(count == len(mission.legs) for count, mission in zip(begun_legs, plan.missions, strict=True))


def _explain_failure(run: SimulationRun, conflict: Conflict | None) -> str:
    """What went wrong first, as a sentence without a full stop."""
    if conflict is not None:
        return (
            f"tractors {conflict.first + 1} and {conflict.second + 1} meet after {conflict.time_s:.0f} s, "
            "and no way of waiting that was tried avoids it"
        )
    if run.outcome == STALL:
        # One tractor that cannot follow its path, and where, or all that are not done wait.
        unfinished = np.flatnonzero(~np.isfinite(run.finish_s)).tolist()
        lost = next((tractor for tractor in unfinished if run.get_statuses(tractor)[-1] != WAITING), None)
        if lost is None:
            return "tractors wait for each other and none moves any more"
        (x, y), speed_mps = run.record[-1, lost, REC_PLACE], abs(float(run.record[-1, lost, REC_SPEED]))
        if speed_mps > MIN_MOVING_MPS:
            return f"tractor {lost + 1} drives beside its path at ({x:.0f}, {y:.0f}) m: it cannot follow it there"
        return f"tractor {lost + 1} stands still at ({x:.0f}, {y:.0f}) m: it cannot follow its path there"
    return f"a tractor does not finish: still driving after {run.time_s[-1]:.0f} s{_describe_slow_work(run)}"


def _describe_slow_work(run: SimulationRun) -> str:
    """A clause on tractors that work more slowly than planned, for lack of power or grip; empty if none does."""
    planned_mps = max(leg.speed_mps for mission in run.plan.missions for leg in mission.legs)
    speeds = np.abs(run.record[:, :, REC_SPEED])[run.record[:, :, REC_STATUS] == WORKING]
    if not len(speeds) or float(np.median(speeds)) > SLOW_WORK_SHARE * planned_mps:
        return ""
    return (
        f"; it works at {KMH_PER_MPS * float(np.median(speeds)):.1f} km/h instead of {KMH_PER_MPS * planned_mps:.1f}, "
        "as power or grip are too little: use a narrower implement or another tractor"
    )


def _repair_conflict(plan: Plan, run: SimulationRun, conflict: Conflict, repairs: ConflictRepairs) -> bool:
    """Add, strengthen or swap one wait; False if nothing is left to try."""
    sides = [
        (conflict.first, conflict.first_leg, conflict.first_m),
        (conflict.second, conflict.second_leg, conflict.second_m),
    ]
    hold_legs = [find_waiting_leg(plan, tractor, leg) for tractor, leg, _ in sides]
    entered = [
        float(np.argmax(run.get_leg_numbers(side[0]) >= hold)) for side, hold in zip(sides, hold_legs, strict=True)
    ]
    later_side = 0 if entered[0] > entered[1] else 1
    order = [later_side, 1 - later_side]
    keys: list[WaitKey] = [(sides[i][0], hold_legs[i], sides[1 - i][0]) for i in (0, 1)]
    clear_gates = [_build_passage_gate(plan, *sides[1 - i], CONFLICT_CLEAR_M) for i in (0, 1)]
    for index in order:
        key = keys[index]
        if key in repairs.failed_keys or np.isfinite(run.finish_s[key[2]]):
            continue
        repairs.alternatives[key] = keys[1 - index], clear_gates[1 - index]
        if key not in repairs.gates:
            repairs.gates[key] = clear_gates[index]
            return True
        if key not in repairs.whole_turn:
            repairs.whole_turn.add(key)
            repairs.gates[key] = _build_turn_end_gate(plan, *sides[1 - index][:2])
            return True
        del repairs.gates[key]
        repairs.failed_keys.add(key)
    return False


def find_waiting_leg(plan: Plan, tractor: int, leg: int) -> int:
    """The leg before which a tractor should have waited: the last where it may, or its very first leg."""
    legs = plan.missions[tractor].legs
    return next((index for index in range(leg, 0, -1) if legs[index].may_wait), 0)


def _build_passage_gate(plan: Plan, tractor: int, leg: int, distance_m: float, extra_m: float) -> LegGate:
    """Gate that opens when the tractor has driven `distance_m` + `extra_m` from the start of a leg, or has driven in.

    It never lies on the swath after a turn: there the tractor may itself wait for others.
    """
    legs = plan.missions[tractor].legs
    distance_m += extra_m
    while distance_m > legs[leg].length_m and not _is_last_turn_leg(legs, leg):
        distance_m -= legs[leg].length_m
        leg += 1
    return LegGate.place(tractor, leg, legs[leg].length_m, distance_m)


def _build_turn_end_gate(plan: Plan, tractor: int, leg: int) -> LegGate:
    """Gate that opens when the tractor has driven in on its next swath, or has finished."""
    legs = plan.missions[tractor].legs
    while not _is_last_turn_leg(legs, leg):
        leg += 1
    return LegGate.place(tractor, leg, legs[leg].length_m)


def _is_last_turn_leg(legs: tuple[Leg, ...], leg: int) -> bool:
    """Whether a leg leads to the beginning of a swath or headland side, or is the last of all."""
    return leg == len(legs) - 1 or (not legs[leg].task.is_work and legs[leg + 1].task.is_work)
