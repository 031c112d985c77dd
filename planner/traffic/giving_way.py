"""Make tractors give way: simulate a plan, and where two come too close schedule the whole of it.

Every plan marks the legs before which a tractor may wait: the start, and some inside its own swaths and headland sides
(strategies.programmes.waiting_places). The schedule says who goes first everywhere (planner.traffic.precedence). It
needs to know a way home for all at any time; where none is found, the plan is not feasible.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from fields.units import KMH_PER_MPS
from vehicle.missions.plan import Plan
from vehicle.missions.run import DONE, STALL, Conflict, SimulationRun
from vehicle.records import REC_PLACE, REC_SPEED, REC_STATUS, WAITING, WORKING

SLOW_WORK_SHARE = 0.8  # of the planned speed: less is told
MIN_MOVING_MPS = 0.05  # less is said to be standing

Simulate = Callable[[Plan], SimulationRun]
"""Simulates a plan until it is done, two tractors come too close, or nothing moves any more."""
Scheduler = Callable[[Plan], Plan | None]
"""Adds gates so that no tractors meet; None if none are found."""


def resolve_conflicts(plan: Plan, simulate: Simulate, schedule: Scheduler) -> tuple[SimulationRun, str | None]:
    """The last run of a plan, and why it is not feasible, or None; tractors give way where it must be."""
    run = first = simulate(plan)
    scheduled_plan = None if run.outcome == DONE else schedule(plan)
    if scheduled_plan is not None:
        run = simulate(scheduled_plan)
    return run, None if run.outcome == DONE else _explain_failure(run, first.conflict or run.conflict)


def _explain_failure(run: SimulationRun, conflict: Conflict | None) -> str:
    """What went wrong first, as a sentence without a full stop."""
    if conflict is not None:
        return (
            f"tractors {conflict.first + 1} and {conflict.second + 1} meet after {conflict.time_s:.0f} s, "
            "and no way of waiting was found that avoids it"
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
