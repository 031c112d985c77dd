"""How plans of a context are driven: simulated until two tractors come too close, and scheduled so that none do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fields.layout.swaths import measure_min_spacing_m
from planner.evaluation.context import CLEARANCE_SHARE, PlanningContext
from planner.request.plan_request import MIN_CLEARANCE_M
from planner.traffic.conflict_zones import EXTRA_CLEARANCE_M
from planner.traffic.giving_way import resolve_conflicts
from planner.traffic.precedence import TrafficRules, schedule_plan
from planner.traffic.trajectories import compute_mission_key
from strategies.programmes.waiting_places import StandingCheck
from vehicle.missions.plan import Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.compile import build_model_record
from vehicle.sim.incremental import IncrementalSimulator
from vehicle.sim.world import World

MAX_ROWS = 5_000_000  # of all cached records: about 300 MB
MAX_PLAN_ROWS = 2_500_000  # larger plans are simulated one tractor after another, which needs less memory
ROWS_PER_S = 10.0
BATCH_SIZE = 8  # tractors simulated in one world, with little overhead; they finish at about the same time
TIMEOUT_FACTOR = 4.0  # times the seconds at the speeds of the legs: bends are driven more slowly


def build_standing_check(context: PlanningContext, beside: bool) -> StandingCheck:
    """Whether a tractor stands in the way of another, as the scheduler sees it."""
    models = np.array([build_model_record(context.tractor, context.implement)])
    clearance_m = context.request.clearance_m + EXTRA_CLEARANCE_M
    return StandingCheck(models, clearance_m, compute_parallel_clearance_m(context, beside))


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


@dataclass(eq=False)
class _ExpectedPlan:
    """A plan, and whether one of its tractors has been requested."""

    original: Plan
    is_requested: bool = False

    @cached_property
    def ungated_plan(self) -> Plan:
        """The plan with nobody waiting."""
        return remove_gates(self.original)

    @cached_property
    def mission_keys(self) -> list[bytes]:
        """The key of each tractor's mission."""
        return [compute_mission_key(mission) for mission in self.ungated_plan.missions]


class SoloRuns:
    """Simulates missions of a context with nobody else on the field.

    Of an expected plan the first requested tractor is simulated alone, as it may suffice; with the second one the
    others follow in one world. Parts that a fleet has driven in the `rehearsal` are reused. On large fields runs of
    earlier plans are dropped for later ones.
    """

    def __init__(self, context: PlanningContext, rehearsal: IncrementalSimulator | None = None) -> None:
        self.context, self.rehearsal = context, rehearsal
        self._runs: dict[bytes, SimulationRun] = {}
        self._expected_plans: list[_ExpectedPlan] = []

    def expect_plan(self, plan: Plan) -> None:
        """Announce one more plan."""
        if all(plan is not one.original for one in self._expected_plans):
            self._expected_plans.append(_ExpectedPlan(plan))

    def __call__(self, mission: Mission) -> SimulationRun:
        """The run of a mission in which its tractor waits for nobody."""
        key = compute_mission_key(mission)
        if key not in self._runs:
            self._simulate_expected(key)
        if key not in self._runs:
            self._drop_oldest_runs([mission])
            world = World(
                Plan((mission,)),
                self.context.tractor,
                self.context.implement,
                terrain=self.context.physics.terrain,
                load=self.context.physics.driven_load,
                seed=self.context.request.seed,
                position_errors=self.context.position_errors,
            )
            self._runs[key] = world.run(max_time_s=compute_timeout_s(Plan((mission,))))
        return self._runs[key]

    def _simulate_expected(self, key: bytes) -> None:
        """Simulate the tractor with this key of an expected plan, and others with it."""
        expected = (
            next((expected for expected in self._expected_plans if key in expected.mission_keys), None)
            if self.rehearsal
            else None
        )
        if expected is None or self.rehearsal is None or _estimate_rows(expected.ungated_plan.missions) > MAX_PLAN_ROWS:
            return
        number, missions = expected.mission_keys.index(key), expected.ungated_plan.missions
        numbers = [number]
        if expected.is_requested:
            missing = [
                n
                for n, other in enumerate(expected.mission_keys)
                if other not in self._runs and expected.mission_keys.index(other) == n
            ]
            order = sorted(missing, key=lambda n: (-compute_planned_s(missions[n]), n))
            batch_start = order.index(number) // BATCH_SIZE * BATCH_SIZE
            numbers = sorted(order[batch_start : batch_start + BATCH_SIZE])
        expected.is_requested = True
        self._drop_oldest_runs([missions[n] for n in numbers])
        runs = self.rehearsal.simulate_alone(
            expected.ungated_plan, numbers, [compute_timeout_s(Plan((missions[n],))) for n in numbers]
        )
        self._runs.update(
            {expected.mission_keys[n]: run for n, run in zip(numbers, runs, strict=True) if run is not None}
        )

    def _drop_oldest_runs(self, missions: Sequence[Mission]) -> None:
        """Drop the oldest runs until the next missions fit."""
        needed_rows = _estimate_rows(missions)
        while self._runs and sum(len(run.time_s) for run in self._runs.values()) + needed_rows > MAX_ROWS:
            del self._runs[next(iter(self._runs))]


class FleetDriver:
    """Drives plans of a context, beside each other or not; tractors give way to one another, but not those `at_once`
    where they begin (planner.traffic.precedence.TrafficRules)."""

    def __init__(self, context: PlanningContext, beside: bool, at_once: frozenset[int] = frozenset()) -> None:
        machine, clearance_m = (context.tractor, context.implement), context.request.clearance_m
        beside_m = compute_parallel_clearance_m(context, beside)
        self._time_share = context.time_share
        self._rehearsal = IncrementalSimulator(
            *machine,
            stop_clearance_m=clearance_m,
            beside_clearance_m=beside_m,
            terrain=context.physics.terrain,
            load=context.physics.driven_load,
            position_errors=context.position_errors,
            seed=context.request.seed,
        )
        self._alone = SoloRuns(context, self._rehearsal)
        self._rules = TrafficRules(
            *machine, clearance_m, beside_m, self._alone, context.trajectory_cache, at_once=at_once
        )

    def measure_alone_s(self, plan: Plan) -> list[float]:
        """Seconds that every tractor drives with nobody else on the field; 0 for one that does not finish."""
        self._time_share.check()
        self._alone.expect_plan(plan)
        runs = map(self._alone, remove_gates(plan).missions)
        return [run.duration_s if run.outcome == DONE else 0.0 for run in runs]

    def drive(self, plan: Plan) -> tuple[SimulationRun, str | None]:
        """The last run of a plan, and why it is not feasible, or None."""
        return resolve_conflicts(plan, self.simulate, self._schedule)

    def simulate(self, plan: Plan) -> SimulationRun:
        """The run of a plan as it is; parts driven before are reused."""
        self._time_share.check()
        return self._rehearsal.simulate(plan, compute_timeout_s(plan))

    def _schedule(self, plan: Plan, slack: float) -> Plan | None:
        """The plan with gates at which tractors wait for one another."""
        self._time_share.check()
        self._alone.expect_plan(plan)
        return schedule_plan(plan, self._rules, slack)


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
