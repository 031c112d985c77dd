"""How plans of a context are driven: simulated until two tractors come too close, and scheduled so that none do."""

from __future__ import annotations

import numpy as np

from fields.layout.swaths import measure_min_spacing_m
from planner.evaluation.candidates.solo_runs import SoloRuns, compute_timeout_s
from planner.evaluation.context import CLEARANCE_SHARE, PlanningContext
from planner.request.plan_request import MIN_CLEARANCE_M
from planner.traffic.conflict_zones import EXTRA_CLEARANCE_M
from planner.traffic.giving_way import Scheduler, Simulate
from planner.traffic.precedence import TrafficRules, schedule_plan
from strategies.programmes.waiting_places import StandingCheck
from vehicle.missions.plan import Plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.compile import build_model_record
from vehicle.sim.incremental import IncrementalSimulator


def build_rehearsal(context: PlanningContext) -> IncrementalSimulator:
    """Simulates the plans of a candidate one after another."""
    return IncrementalSimulator(
        context.tractor,
        context.implement,
        stop_clearance_m=context.request.clearance_m,
        beside_clearance_m=compute_parallel_clearance_m(context),
        terrain=context.physics.terrain,
        load=context.physics.driven_load,
        position_errors=context.position_errors,
        seed=context.request.seed,
    )


def build_simulate(context: PlanningContext, rehearsal: IncrementalSimulator) -> Simulate:
    """Drives a plan while there is time left for it."""

    def simulate(plan: Plan) -> SimulationRun:
        context.time_share.check()
        return rehearsal.simulate(plan, compute_timeout_s(plan))

    return simulate


def build_scheduler(context: PlanningContext, solo_runs: SoloRuns) -> Scheduler:
    """A scheduler for plans of a context."""
    rules = TrafficRules(
        context.tractor,
        context.implement,
        context.request.clearance_m,
        compute_parallel_clearance_m(context),
        solo_runs,
        context.trajectory_cache,
    )

    def schedule(plan: Plan, slack: float) -> Plan | None:
        context.time_share.check()
        solo_runs.expect_plan(plan)
        return schedule_plan(plan, rules, slack)

    return schedule


def build_standing_check(context: PlanningContext) -> StandingCheck:
    """Whether a tractor stands in the way of another, as the scheduler sees it."""
    models = np.array([build_model_record(context.tractor, context.implement)])
    clearance_m = context.request.clearance_m + EXTRA_CLEARANCE_M
    return StandingCheck(models, clearance_m, compute_parallel_clearance_m(context))


def compute_parallel_clearance_m(context: PlanningContext) -> float:
    """How near two tractors may come on parallel lines (m): no more than neighbouring swaths allow."""
    return min(max(CLEARANCE_SHARE * compute_machine_gap_m(context), MIN_CLEARANCE_M), context.request.clearance_m)


def compute_machine_gap_m(context: PlanningContext) -> float:
    """The gap between machines on neighbouring swaths (m); negative if they overlap."""
    return measure_min_spacing_m(context.layout) - max(context.implement.contact_width_m, context.tractor.width_m)
