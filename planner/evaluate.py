"""One candidate from strategy to figures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.deconflict import without_conflicts
from planner.measure import coverage, excursion, finite_or_none, reversals
from planner.results import PlanResult
from planner.site import Site
from planner.waiting import optimised
from strategies.errors import StrategyError
from strategies.job import Job
from strategies.registry import ROW_BY_ROW_OPTIMISED, build
from vehicle.missions import Plan
from vehicle.run import DONE, Run
from vehicle.world import World

SAFE_M = 0.05
FARTHEST_OUTSIDE_M = 0.5


@dataclass(frozen=True)
class Candidate:
    """A combination to try; `jump` fixes the pattern of tracks of a split field."""

    strategy: str
    tractors: int
    jump: int | None = None


def evaluate(site: Site, candidate: Candidate) -> PlanResult:
    """Build, simulate, repair and measure one candidate; a refusal becomes a result with its reason."""
    try:
        run, reason, turn = drive(site, candidate)
    except StrategyError as refusal:
        return PlanResult(candidate.strategy, candidate.tractors, site.scenario.turn, False, str(refusal))
    return _measured(site, candidate, run, reason, turn)


def drive(site: Site, candidate: Candidate) -> tuple[Run, str | None, str]:
    """The run of a candidate, why it is not feasible (None when it is), and the turns it uses."""
    job = site.job(candidate.tractors)

    def simulate(plan: Plan) -> Run:
        return World(plan, site.tractor, site.implement).run(stop_clearance_m=SAFE_M, max_time_s=_patience_s(plan))

    if candidate.strategy == ROW_BY_ROW_OPTIMISED and candidate.tractors > 1:
        plan, run = optimised(job, simulate, site.tractor, site.implement)
        if run.outcome == DONE:
            return run, None, _turns(job)
    elif candidate.strategy == ROW_BY_ROW_OPTIMISED:
        plan = build("row-by-row", job)
    else:
        plan = build(candidate.strategy, job, candidate.jump)
    run, reason = without_conflicts(plan, simulate)
    return run, reason, _turns(job)


def _patience_s(plan: Plan) -> float:
    """More than the plan takes with only one tractor moving at a time: whoever is not done by then never will be."""
    driven = sum(leg.length_m / leg.speed_mps for mission in plan.missions for leg in mission.legs)
    return 600.0 + 2.0 * driven


def _turns(job: Job) -> str:
    """The two kinds of turn driven most, the commonest first."""
    return "+".join(sorted(job.used, key=lambda kind: (-job.used[kind], kind))[:2]) or "none"


def _measured(site: Site, candidate: Candidate, run: Run, reason: str | None, turn: str) -> PlanResult:
    outside = excursion(run, site)
    if reason is None and run.contacts:
        time, first, second = run.contacts[0]
        reason = f"tractors {first + 1} and {second + 1} touch after {time:.0f} s"
    if reason is None and outside.depth_m >= FARTHEST_OUTSIDE_M:
        reason = f"a path leaves the field by {outside.depth_m:.2f} m, {FARTHEST_OUTSIDE_M} m or more"
    if run.outcome != DONE:
        return PlanResult(
            candidate.strategy, candidate.tractors, turn, False, reason, collisions=len(run.contacts)
        )
    scenario, shares, worked = site.scenario, run.time_shares(), coverage(run, site)
    tractor_time = float(np.sum(run.finish_s))
    hired = run.duration_s * candidate.tractors
    allowed = scenario.allowed_s
    return PlanResult(
        strategy=candidate.strategy,
        tractors=candidate.tractors,
        turn=turn,
        feasible=reason is None,
        reason=reason,
        time_s=run.duration_s,
        tractor_time_s=tractor_time,
        cost=hired / 3600.0 * scenario.price_per_hour + candidate.tractors * scenario.price_per_tractor,
        meets_deadline=None if allowed is None else run.duration_s <= allowed,
        worked_pct=worked.worked_pct,
        overlap_pct=worked.overlap_pct,
        outside_m=outside.length_m,
        excursion_m=outside.depth_m,
        turning_s=float(shares["turning"].sum() + shares["reversing"].sum()),
        waiting_s=float(shares["waiting"].sum()),
        reversals=reversals(run),
        min_clearance_m=finite_or_none(run.min_clearance_m),
        collisions=len(run.contacts),
    )
