"""One candidate from strategy to figures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from planner.deconflict import without_conflicts
from planner.headland import headland_s, with_headland
from planner.measure import coverage, excursion, finite_or_none, outline_excursion_m, reversals
from planner.outlook import with_outlook
from planner.scenario import LEAST_CLEARANCE_M
from planner.site import Site
from planner.steady import ASIDE_M, slips, slowed, worst_aside
from planner.swept import swept_ground
from planner.trampled import trampled_m2
from reports.results import PlanResult
from strategies.errors import StrategyError
from strategies.formation import corners_by_promise
from strategies.job import Job
from strategies.record import MOST_REPAIRS, Refined, Simulate, Strategy
from strategies.registry import STRATEGIES
from vehicle.missions import Plan
from vehicle.rehearsal import Rehearsal
from vehicle.run import DONE, Run

ROOM_KEPT = 0.5  # of the room that neighbouring tracks leave between machines: the rest is for errors of guidance
FARTHEST_OUTSIDE_M = 0.5
FARTHEST_ASIDE = 1.0 / 3.0  # of the working width: more leaves a strip that nobody works
MOST_SLOWED = 2
SMALLEST_GAIN_M = 0.02


@dataclass(frozen=True)
class Candidate:
    """A combination to try; `jump` position_errors the pattern of tracks for a strategy that takes one."""

    strategy: str
    tractors: int
    jump: int | None = None


@dataclass(frozen=True, eq=False)
class Evaluation:
    """The figures of a candidate, and the run they were measured on; None where its strategy refused the field."""

    result: PlanResult
    run: Run | None


@dataclass(frozen=True, eq=False)
class CandidateRun:
    """The last run of a candidate, why it is not feasible (None when it is), the turns it uses, its remark."""

    run: Run
    reason: str | None
    turns: str
    remark: str | None


def evaluate(site: Site, candidate: Candidate) -> PlanResult:
    """The figures of `simulated` alone."""
    return simulated(site, candidate).result


def simulated(site: Site, candidate: Candidate) -> Evaluation:
    """Build, simulate, repair and measure one candidate; a refusal becomes a result with its reason."""
    try:
        tried = run_candidate(site, candidate)
    except StrategyError as refusal:
        turn = site.scenario.turn
        return Evaluation(PlanResult(candidate.strategy, candidate.tractors, turn, False, str(refusal)), None)
    result, area_ha = _measured(site, candidate, tried), site.layout.field.area_ha
    return Evaluation(
        with_outlook(result, tried.run, site.tractor, site.implement, area_ha, site.stakes), tried.run
    )


def run_candidate(site: Site, candidate: Candidate) -> CandidateRun:
    """Build, simulate and repair one candidate; raises StrategyError where its strategy cannot work the field."""
    strategy = STRATEGIES[candidate.strategy]
    if candidate.jump is not None and not strategy.takes_jump:
        raise StrategyError(f"Strategy {strategy.name!r} has its own order of tracks; leave out the jump.")
    job = replace(site.job(candidate.tractors), jump=candidate.jump)
    if job.corner is not None or not strategy.abreast:
        return _run_job(site, strategy, job)
    return _from_some_corner(site, strategy, job)


def _from_some_corner(site: Site, strategy: Strategy, job: Job) -> CandidateRun:
    """A formation on a field without an entrance: from the corner that promises most and can be driven."""
    first: CandidateRun | None = None
    refusal: StrategyError | None = None
    for corner in corners_by_promise(job):
        try:
            latest = _run_job(site, strategy, replace(job, corner=corner, used={}))
        except StrategyError as error:
            refusal = refusal or error
            continue
        if latest.reason is None:
            return latest
        first = first or latest
    if first is None:
        raise refusal or StrategyError("No corner to begin at; the field has no tracks.")
    return first


def _run_job(site: Site, strategy: Strategy, job: Job) -> CandidateRun:
    rehearsal = Rehearsal(
        site.tractor, site.implement, stop_clearance_m=site.scenario.clearance_m,
        beside_clearance_m=beside_clearance_m(site), position_errors=site.position_errors, seed=site.scenario.seed,
    )  # fmt: skip

    def simulate(plan: Plan) -> Run:
        return rehearsal.simulate(plan, _patience_s(plan))

    refine = strategy.refine
    refined = refine(job, simulate, site.tractor, site.implement) if refine else Refined(strategy.build(job))
    first: CandidateRun | None = None
    for choices in with_headland(site, job, refined):
        runs = [_run_plan(site, strategy, job, each, simulate) for each in choices]
        driven = [each for each in runs if each.reason is None]
        if driven:
            return min(driven, key=lambda each: round(each.run.duration_s, 3))
        first = first or next(iter(runs), None)
    assert first is not None  # a plan that cannot be written is refused
    return first


def _run_plan(site: Site, strategy: Strategy, job: Job, refined: Refined, simulate: Simulate) -> CandidateRun:
    repairs = strategy.most_repairs + (MOST_REPAIRS if job.rounds else 0)
    run, reason = _driven(refined, simulate, repairs)
    if reason is None:
        run, aside = _steadied(site, run, simulate, repairs)
        reason = _fault(site, run, aside)
    return CandidateRun(run, reason, _turns(job), refined.remark)


def beside_clearance_m(site: Site) -> float:
    """How near two may come beside each other on parallel lines: neighbouring tracks leave no more than they do."""
    machine_m = max(site.implement.contact_width_m, site.tractor.width_m)
    room = ROOM_KEPT * (site.implement.width_m - machine_m)
    return min(max(room, LEAST_CLEARANCE_M), site.scenario.clearance_m)


def _driven(refined: Refined, simulate: Simulate, most_repairs: int) -> tuple[Run, str | None]:
    """The run of a plan with tractors giving way, and why it is not feasible when it is not."""
    if refined.run is not None and refined.run.outcome == DONE:
        return refined.run, None
    return without_conflicts(refined.plan, simulate, most_repairs)


def _steadied(site: Site, run: Run, simulate: Simulate, most_repairs: int) -> tuple[Run, float]:
    """The run with turns that it followed badly driven more slowly where that helps, and what is left aside (m)."""
    turns = slips(run, site)
    for _ in range(MOST_SLOWED):
        bad = [slip for slip in turns if slip.metres > ASIDE_M]
        if not bad:
            break
        again, fault = without_conflicts(slowed(run.plan, bad), simulate, most_repairs)
        if fault:
            break
        left = slips(again, site)
        if worst_aside(left) > worst_aside(turns) - SMALLEST_GAIN_M:
            break
        run, turns = again, left
    return run, worst_aside(turns)


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
        return f"a track or round is begun {aside:.2f} m beside its line, more than a third of the working width"
    return None


def _patience_s(plan: Plan) -> float:
    """More than the plan takes with only one tractor moving at a time: whoever is not done by then never will be."""
    driven = sum(leg.length_m / leg.speed_mps for mission in plan.missions for leg in mission.legs)
    return 600.0 + 2.0 * driven


def _turns(job: Job) -> str:
    """The two kinds of turn driven most, the commonest first."""
    return "+".join(sorted(job.used, key=lambda kind: (-job.used[kind], kind))[:2]) or "none"


def _measured(site: Site, candidate: Candidate, tried: CandidateRun) -> PlanResult:
    run, reason, turn = tried.run, tried.reason, tried.turns
    outside = excursion(run, site)
    if run.outcome != DONE:
        return PlanResult(
            candidate.strategy, candidate.tractors, turn, False, reason, collisions=len(run.contacts)
        )
    scenario, shares, swept = site.scenario, run.time_shares(), swept_ground(run, site)
    worked = coverage(run, site, swept)
    tractor_time = float(np.sum(run.finish_s))
    hourly = run.duration_s * candidate.tractors / 3600.0 * scenario.price_per_hour
    hiring = candidate.tractors * scenario.price_per_tractor
    allowed = scenario.allowed_s
    return PlanResult(
        strategy=candidate.strategy,
        tractors=candidate.tractors,
        turn=turn,
        feasible=reason is None,
        reason=reason,
        time_s=run.duration_s,
        tractor_time_s=tractor_time,
        cost=hourly + hiring,
        meets_deadline=None if allowed is None else run.duration_s <= allowed,
        worked_pct=worked.worked_pct,
        overlap_pct=worked.overlap_pct,
        missed_m2=worked.missed_m2,
        largest_missed=worked.largest,
        finished_s=worked.finished(run.duration_s),
        finished_cost=worked.finished(hourly) + hiring,
        trampled_m2=trampled_m2(run, site, swept),
        outside_m=outside.length_m,
        excursion_m=outside.depth_m,
        outside_outline_m=outline_excursion_m(run, site),
        turning_s=float(shares["turning"].sum() + shares["reversing"].sum()),
        waiting_s=float(shares["waiting"].sum()),
        reversals=reversals(run),
        min_clearance_m=finite_or_none(run.min_clearance_m),
        collisions=len(run.contacts),
        order_gap_pct=run.plan.notes.get("order_gap_pct"),
        remark=tried.remark,
        rounds=site.layout.rounds,
        headland_s=headland_s(run),
    )
