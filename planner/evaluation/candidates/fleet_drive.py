"""How plans of a context are driven: simulated until two tractors come too close, and scheduled so that none do.

Every plan marks the legs before which a tractor may wait: the start, and some inside its own swaths and headland sides
(strategies.programmes.waiting_places). The schedule says who goes first everywhere (planner.traffic.precedence). It
needs to know a way home for all at any time; where none is found, the plan is not feasible.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from fields.layout.swaths import measure_min_spacing_m
from fields.units import KMH_PER_MPS
from planner.evaluation.context import CLEARANCE_SHARE, PlanningContext
from planner.request.plan_request import MIN_CLEARANCE_M
from planner.traffic.precedence import schedule_plan
from planner.traffic.trajectories import compute_mission_key
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.run import DONE, STALL, Conflict, SimulationRun
from vehicle.records import REC_PLACE, REC_SPEED, REC_STATUS, WAITING, WORKING
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.path_conflicts import ClearanceCheck

MAX_ROWS = 5_000_000  # of all cached records: about 300 MB
MAX_PLAN_ROWS = 2_500_000  # tractors of larger plans are simulated one after another, which needs less memory
ROWS_PER_S = 10.0
BATCH_SIZE = 8  # tractors simulated in one world, with little overhead
TIMEOUT_FACTOR = 4.0  # times the seconds at the speeds of the legs: bends are driven more slowly
SLOW_WORK_SHARE = 0.8  # of the planned speed: less is told
MIN_MOVING_MPS = 0.05  # less is said to be standing

Simulate = Callable[[Plan], SimulationRun]
"""Simulates a plan until it is done, two tractors come too close, or nothing moves any more."""
Scheduler = Callable[[Plan], Plan | None]
"""Adds gates so that no tractors meet; None if none are found."""


def build_clearance_check(context: PlanningContext, beside: bool) -> ClearanceCheck:
    """How near the tractors of a context may come to one another, as the scheduler sees it."""
    beside_m = compute_parallel_clearance_m(context, beside)
    return ClearanceCheck.for_machine(context.tractor, context.implement, context.request.clearance_m, beside_m)


def compute_parallel_clearance_m(context: PlanningContext, beside: bool) -> float:
    """How near two tractors may come on parallel lines (m): a formation as near as neighbouring swaths are."""
    beside_m = max(CLEARANCE_SHARE * compute_machine_gap_m(context), MIN_CLEARANCE_M)
    return min(beside_m, context.request.clearance_m) if beside else context.request.clearance_m


def compute_nearness_m(context: PlanningContext, beside: bool) -> float:
    """How near machines may come that work neighbouring swaths beside each other (m), to the centimetre as it is told.

    That is the part of their gap that errors of guidance leave; machines that overlap have none.
    """
    gap_m = max(0.0, compute_machine_gap_m(context)) if beside else math.inf
    return round(min(gap_m, compute_parallel_clearance_m(context, beside)), 2)


def compute_machine_gap_m(context: PlanningContext) -> float:
    """The gap between machines on neighbouring swaths (m); negative if they overlap."""
    return measure_min_spacing_m(context.layout) - max(context.implement.contact_width_m, context.tractor.width_m)


class SoloRuns:
    """Simulates tractors with nobody else on the field, each mission once and several in one world.

    Parts that a fleet has driven in the `rehearsal` are reused. On large fields runs of earlier plans are dropped for
    later ones.
    """

    def __init__(self, rehearsal: IncrementalSimulator) -> None:
        self.rehearsal = rehearsal
        self._runs: dict[bytes, SimulationRun] = {}

    def __call__(self, plan: Plan, numbers: Sequence[int]) -> Iterator[SimulationRun]:
        """The runs of these tractors of a plan in which they wait for nobody, one after another."""
        plan = remove_gates(plan)
        keys = [compute_mission_key(mission) for mission in plan.missions]
        for place, number in enumerate(numbers):
            if keys[number] not in self._runs:
                missing = {keys[n]: n for n in numbers[place:] if keys[n] not in self._runs}
                self._simulate(plan, missing)
            yield self._runs[keys[number]]

    def _simulate(self, plan: Plan, missing: Mapping[bytes, int]) -> None:
        """Simulate the first tractors that are missing of a plan without gates, by the keys of their missions."""
        is_large = _estimate_rows(plan.missions) > MAX_PLAN_ROWS
        batch = dict(list(missing.items())[: 1 if is_large else BATCH_SIZE])
        missions = [plan.missions[number] for number in batch.values()]
        needed_rows = _estimate_rows(missions)
        while self._runs and sum(len(run.time_s) for run in self._runs.values()) + needed_rows > MAX_ROWS:
            del self._runs[next(iter(self._runs))]  # the oldest
        limits_s = [compute_timeout_s(Plan((mission,))) for mission in missions]
        if is_large:
            runs = [self.rehearsal.simulate_mission(missions[0], limits_s[0])]
        else:
            runs = self.rehearsal.simulate_alone(plan, list(batch.values()), limits_s)
        self._runs.update(zip(batch, runs, strict=True))


class FleetDriver:
    """Drives plans of a context, beside each other or not; tractors give way to one another, but not those `at_once`
    where they begin (planner.traffic.precedence.schedule_plan)."""

    def __init__(self, context: PlanningContext, beside: bool, at_once: frozenset[int] = frozenset()) -> None:
        self._time_share = context.time_share
        self._rehearsal = IncrementalSimulator(
            context.tractor,
            context.implement,
            stop_clearance_m=context.request.clearance_m,
            beside_clearance_m=compute_parallel_clearance_m(context, beside),
            terrain=context.physics.terrain,
            load=context.physics.driven_load,
            position_errors=context.position_errors,
            seed=context.request.seed,
        )
        self._alone, self._at_once = SoloRuns(self._rehearsal), at_once
        self._check, self._cache = build_clearance_check(context, beside), context.trajectory_cache

    def measure_alone_s(self, plan: Plan) -> list[float]:
        """Seconds that every tractor drives with nobody else on the field; 0 for one that does not finish."""
        self._time_share.check()
        runs = self._alone(plan, range(plan.tractors))
        return [run.duration_s if run.outcome == DONE else 0.0 for run in runs]

    def drive(self, plan: Plan) -> tuple[SimulationRun, str | None]:
        """The last run of a plan, and why it is not feasible, or None."""
        return resolve_conflicts(plan, self.simulate, self._schedule)

    def simulate(self, plan: Plan) -> SimulationRun:
        """The run of a plan as it is; parts driven before are reused."""
        self._time_share.check()
        return self._rehearsal.simulate(plan, compute_timeout_s(plan))

    def _schedule(self, plan: Plan) -> Plan | None:
        """The plan with gates at which tractors wait for one another."""
        self._time_share.check()
        return schedule_plan(plan, self._check, self._alone, self._cache, self._at_once)


def remove_gates(plan: Plan) -> Plan:
    """The plan without gates and follow orders."""
    free_legs = (
        tuple(leg.copy_with(gates=(), follow=None) if leg.gates or leg.follow else leg for leg in mission.legs)
        for mission in plan.missions
    )
    return Plan(tuple(Mission(legs) for legs in free_legs), plan.notes)


def _estimate_rows(missions: Sequence[Mission]) -> float:
    """Approximate number of rows in the records of missions at planned speeds."""
    return ROWS_PER_S * math.fsum(leg.length_m / leg.speed_mps for mission in missions for leg in mission.legs)


def compute_timeout_s(plan: Plan) -> float:
    """More seconds than the plan takes with one tractor moving at a time: a tractor not done by then never will be."""
    driven_s = sum(leg.standing_s + leg.length_m / leg.speed_mps for mission in plan.missions for leg in mission.legs)
    return 600.0 + TIMEOUT_FACTOR * driven_s


def resolve_conflicts(plan: Plan, simulate: Simulate, schedule: Scheduler) -> tuple[SimulationRun, str | None]:
    """The last run of a plan, and why it is not feasible, or None; tractors give way where it must be."""
    run = first = simulate(plan)
    scheduled_plan = None if run.outcome == DONE else schedule(plan)
    if scheduled_plan is not None:
        run = simulate(scheduled_plan)
    return run, None if run.outcome == DONE else _explain_failure(run, first.conflict or run.conflict)


def _explain_failure(run: SimulationRun, conflict: Conflict | None) -> str:
    """What went wrong first, as a sentence without a full stop."""
    if conflict is not None and conflict.time_s == 0.0:
        return (
            f"tractors {conflict.first + 1} and {conflict.second + 1} touch where they begin, or nearly do: drive one "
            "of them away first"
        )
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
