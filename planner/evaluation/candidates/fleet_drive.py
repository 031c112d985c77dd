"""How plans of a context are driven: simulated until two tractors come too close, and scheduled so that none do."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

from fields.layout.swaths import measure_min_spacing_m
from planner.evaluation.context import CLEARANCE_SHARE, PlanningContext
from planner.request.plan_request import MIN_CLEARANCE_M
from planner.traffic.giving_way import resolve_conflicts
from planner.traffic.precedence import schedule_plan
from planner.traffic.trajectories import compute_mission_key
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.path_conflicts import ClearanceCheck

MAX_ROWS = 5_000_000  # of all cached records: about 300 MB
MAX_PLAN_ROWS = 2_500_000  # tractors of larger plans are simulated one after another, which needs less memory
ROWS_PER_S = 10.0
BATCH_SIZE = 8  # tractors simulated in one world, with little overhead
TIMEOUT_FACTOR = 4.0  # times the seconds at the speeds of the legs: bends are driven more slowly


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
        self._drop_oldest_runs(missions)
        limits_s = [compute_timeout_s(Plan((mission,))) for mission in missions]
        if is_large:
            runs = [self.rehearsal.simulate_mission(missions[0], limits_s[0])]
        else:
            runs = self.rehearsal.simulate_alone(plan, list(batch.values()), limits_s)
        self._runs.update(zip(batch, runs, strict=True))

    def _drop_oldest_runs(self, missions: Sequence[Mission]) -> None:
        """Drop the oldest runs until the next missions fit."""
        needed_rows = _estimate_rows(missions)
        while self._runs and sum(len(run.time_s) for run in self._runs.values()) + needed_rows > MAX_ROWS:
            del self._runs[next(iter(self._runs))]


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


def compute_planned_s(mission: Mission) -> float:
    """Seconds at planned speeds."""
    return round(math.fsum(leg.length_m / leg.speed_mps for leg in mission.legs), 3)


def remove_gates(plan: Plan) -> Plan:
    """The plan without gates and follow orders."""
    free_legs = (
        tuple(leg.copy_with(gates=(), follow=None) if leg.gates or leg.follow else leg for leg in mission.legs)
        for mission in plan.missions
    )
    return Plan(tuple(Mission(legs) for legs in free_legs), plan.notes)


def _estimate_rows(missions: Sequence[Mission]) -> float:
    """Approximate number of rows in the records of missions."""
    return ROWS_PER_S * math.fsum(compute_planned_s(mission) for mission in missions)


def compute_timeout_s(plan: Plan) -> float:
    """More seconds than the plan takes with one tractor moving at a time: a tractor not done by then never will be."""
    driven_s = sum(leg.standing_s + leg.length_m / leg.speed_mps for mission in plan.missions for leg in mission.legs)
    return 600.0 + TIMEOUT_FACTOR * driven_s
