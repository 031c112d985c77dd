"""One candidate from strategy to figures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.deconflict import MOST_REPAIRS, Simulate, without_conflicts
from planner.measure import coverage, excursion, finite_or_none, reversals
from planner.site import Site
from planner.steady import ASIDE_M, slips, slowed, worst_aside
from planner.waiting import optimised
from reports.results import PlanResult
from strategies.errors import StrategyError
from strategies.formation import corners_by_promise
from strategies.job import Job
from strategies.registry import FORMATIONS, ROW_BY_ROW_OPTIMISED, build
from vehicle.missions import Plan
from vehicle.run import DONE, Run
from vehicle.world import World

SAFE_M = 0.05
FARTHEST_OUTSIDE_M = 0.5
FORMATION_REPAIRS = 8  # a formation has its own queue: where that needs more mending, the field does not suit it
FARTHEST_ASIDE = 1.0 / 3.0  # of the working width: more leaves a strip that nobody works
MOST_SLOWED = 2
SMALLEST_GAIN_M = 0.02
ALONE = "one tractor waits for nobody, so it is driven as row-by-row"
NOT_QUICKER = "no optimised queue proved quicker, so it is driven as row-by-row"
Driven = tuple[Run, str | None, str]


@dataclass(frozen=True)
class Candidate:
    """A combination to try; `jump` fixes the pattern of tracks of a split field."""

    strategy: str
    tractors: int
    jump: int | None = None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The figures of a candidate, and the run they were measured on; None where its strategy refused the field."""

    result: PlanResult
    run: Run | None


def evaluate(site: Site, candidate: Candidate) -> PlanResult:
    """Build, simulate, repair and measure one candidate; a refusal becomes a result with its reason."""
    return simulated(site, candidate).result


def simulated(site: Site, candidate: Candidate) -> Evaluation:
    """As `evaluate`, with the run that was measured."""
    try:
        run, reason, turn = drive(site, candidate)
    except StrategyError as refusal:
        turn = site.scenario.turn
        return Evaluation(PlanResult(candidate.strategy, candidate.tractors, turn, False, str(refusal)), None)
    return Evaluation(_measured(site, candidate, run, reason, turn), run)


def drive(site: Site, candidate: Candidate) -> Driven:
    """The run of a candidate, why it is not feasible (None when it is), and the turns it uses."""
    job = site.job(candidate.tractors)
    if job.corner is not None or candidate.strategy not in FORMATIONS:
        return _drive(site, candidate, job)
    return _from_some_corner(site, candidate, job)


def _from_some_corner(site: Site, candidate: Candidate, job: Job) -> Driven:
    """A formation on a field without an entrance: from the corner that promises most and can be driven."""
    driven: Driven | None = None
    refusal: StrategyError | None = None
    for corner in corners_by_promise(job):
        try:
            latest = _drive(site, candidate, replace(job, corner=corner, used={}))
        except StrategyError as error:
            refusal = refusal or error
            continue
        if latest[1] is None:
            return latest
        driven = driven or latest
    if driven is None:
        raise refusal or StrategyError("No corner to begin at; the field has no tracks.")
    return driven


def _drive(site: Site, candidate: Candidate, job: Job) -> Driven:
    def simulate(plan: Plan) -> Run:
        world = World(plan, site.tractor, site.implement, fixes=site.fixes, seed=site.scenario.seed)
        return world.run(stop_clearance_m=SAFE_M, max_time_s=_patience_s(plan))

    most = FORMATION_REPAIRS if candidate.strategy in FORMATIONS else MOST_REPAIRS
    run, reason = _first_run(site, candidate, job, simulate, most)
    if reason:
        return run, reason, _turns(job)
    found = slips(run, site)
    for _ in range(MOST_SLOWED):
        bad = [slip for slip in found if slip.metres > ASIDE_M]
        if not bad:
            break
        again, fault = without_conflicts(slowed(run.plan, bad), simulate, most)
        if fault:
            break
        left = slips(again, site)
        if worst_aside(left) > worst_aside(found) - SMALLEST_GAIN_M:
            break
        run, found = again, left
    return run, _fault(site, run, worst_aside(found)), _turns(job)


def _first_run(
    site: Site, candidate: Candidate, job: Job, simulate: Simulate, most: int
) -> tuple[Run, str | None]:
    """The candidate as its strategy writes it, with tractors giving way."""
    if candidate.strategy == ROW_BY_ROW_OPTIMISED and candidate.tractors > 1:
        plan, run = optimised(job, simulate, site.tractor, site.implement)
        if run.outcome == DONE:
            return run, None
    elif candidate.strategy == ROW_BY_ROW_OPTIMISED:
        plan = build("row-by-row", job)
    else:
        plan = build(candidate.strategy, job, candidate.jump)
    return without_conflicts(plan, simulate, most)


def _fault(site: Site, run: Run, aside: float) -> str | None:
    """Why a plan that was driven to the end is not feasible all the same, or None.

    `aside` is by how many metres the worst of its tracks was begun beside its line.
    """
    if run.contacts:
        time, first, second = run.contacts[0]
        return f"tractors {first + 1} and {second + 1} touch after {time:.0f} s"
    outside = excursion(run, site).depth_m
    if outside >= FARTHEST_OUTSIDE_M:
        return f"a path leaves the field by {outside:.2f} m, {FARTHEST_OUTSIDE_M} m or more"
    if aside > FARTHEST_ASIDE * site.layout.width_m:
        return f"a track is begun {aside:.2f} m beside its line, more than a third of the working width"
    return None


def _patience_s(plan: Plan) -> float:
    """More than the plan takes with only one tractor moving at a time: whoever is not done by then never will be."""
    driven = sum(leg.length_m / leg.speed_mps for mission in plan.missions for leg in mission.legs)
    return 600.0 + 2.0 * driven


def _turns(job: Job) -> str:
    """The two kinds of turn driven most, the commonest first."""
    return "+".join(sorted(job.used, key=lambda kind: (-job.used[kind], kind))[:2]) or "none"


def _measured(site: Site, candidate: Candidate, run: Run, reason: str | None, turn: str) -> PlanResult:
    outside = excursion(run, site)
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
        remark=_remark(candidate, run),
    )


def _remark(candidate: Candidate, run: Run) -> str | None:
    """What a reader would not expect of a plan by this name, or None."""
    if candidate.strategy != ROW_BY_ROW_OPTIMISED or run.plan.notes.get("strategy") == ROW_BY_ROW_OPTIMISED:
        return None
    return ALONE if candidate.tractors == 1 else NOT_QUICKER
