"""One candidate from its strategy to its figures: composed or built, driven and measured."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np

from fields.units import MINUTE_S
from planner.evaluation.candidates.best_drive import (
    describe_loss,
    describe_nearness,
    drive_best,
    estimate_loss_s,
    find_incumbent,
)
from planner.evaluation.candidates.energy_figures import find_flat_battery, find_service_conflict
from planner.evaluation.candidates.figures import CandidateRun, appraise_drive, measure_candidate
from planner.evaluation.candidates.fleet_drive import FleetDriver, compute_machine_gap_m, compute_nearness_m
from planner.evaluation.candidates.line_programme import ComposedPlan, SketchedPlan, drive_composed, sketch_plans
from planner.evaluation.candidates.slope_figures import (
    describe_stall,
    find_overturning,
    list_slope_remarks,
)
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import ContactPlace, describe_worst_place, find_contact_places
from planner.evaluation.ground.unworked_area import mark_worked_shares
from planner.risk.assessment import add_risk_estimate
from reports.common.language import mark_text
from reports.common.plan_records import STUCK, PlanDrive, PlanFault, Remark, Stake
from reports.common.plan_results import PlanResult
from strategies.path_planning.errors import StrategyError
from strategies.registry import get_strategy
from vehicle.missions.plan import ENTER, LEAVE, Plan
from vehicle.missions.run import SimulationRun, find_longest_reversing
from vehicle.sim.compile import build_model_record
from vehicle.sim.path_conflicts import compute_outline_distances

SPEED_TOLERANCE_MPS, MIN_SLOW_M = 0.1, 10.0  # of the least working speed, and of what is worked below it
REVERSE_TOLERANCE_M = 0.5  # legs are rounded


@dataclass(frozen=True)
class Candidate:
    """A combination to try."""

    strategy: str
    tractors: int


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of a candidate: its figures, the run that they are of and its picture.

    There is no plan if its strategy refused the field or it was pruned, and no picture unless it was asked for.
    `driven` are the figures without what prices, clock and samples make of them.
    """

    result: PlanResult
    driven: PlanResult
    plan: Plan | None = None
    run: SimulationRun | None = None
    picture: PlanDrive | None = None


def simulate_candidates(
    context: PlanningContext,
    candidates: Sequence[Candidate],
    prunes: bool,
    sketched: Mapping[Candidate, list[SketchedPlan]] | None = None,
    *,
    is_shown: bool = True,
) -> Iterator[tuple[int, Outcome]]:
    """Evaluate candidates of one number of tractors, those with the quickest sketch first; yields each with its number.

    Tractors that come nearer than the clearance on neighbouring tracks are the last. With `prunes` a candidate that
    cannot beat those before it is not driven. Those `sketched` before are not sketched again. Only with `is_shown` are
    figures measured by which nothing is chosen.
    """
    results, numbers, known = list[PlanResult](), range(len(candidates)), sketched or {}
    are_near = [_comes_near(context, one) for one in candidates]
    for near in (False, True):
        incumbent = find_incumbent(results) if prunes and near else None
        group = [number for number in numbers if are_near[number] == near]
        if incumbent is not None and incumbent.keeps_clearance:
            nearness_m = compute_nearness_m(context, beside=True)
            reason = describe_nearness(nearness_m, context.request.clearance_m, incumbent)
            marks = {"is_simulated": False, "keeps_clearance": False}
            yield from ((number, _build_refusal(context, candidates[number], reason, **marks)) for number in group)
            return
        sketches = {number: known.get(candidates[number]) or _sketch(context, candidates[number]) for number in group}
        sketched_s = {
            number: math.inf if isinstance(found, StrategyError) else max(found[0].tractor_s)
            for number, found in sketches.items()
        }
        for number in sorted(group, key=lambda number: (sketched_s[number], number)):
            incumbent = find_incumbent(results) if prunes else None
            outcome = _simulate_sketched(context, candidates[number], sketches[number], incumbent, is_shown=is_shown)
            results += mark_worked_shares([outcome.result], context)
            yield number, outcome


def _comes_near(context: PlanningContext, candidate: Candidate) -> bool:
    """Whether tractors work beside each other where neighbouring tracks leave less than the clearance."""
    beside = candidate.tractors > 1 and get_strategy(candidate.strategy).beside
    return compute_nearness_m(context, beside) < context.request.clearance_m


def _build_refusal(context: PlanningContext, candidate: Candidate, reason: str, **figures: Any) -> Outcome:
    """The outcome of a candidate that is not driven."""
    figures["in_formation"] = get_strategy(candidate.strategy).formation is not None
    refused = PlanResult(candidate.strategy, candidate.tractors, context.request.turn, False, reason, **figures)
    return Outcome(refused, refused)


def _sketch(context: PlanningContext, candidate: Candidate) -> list[SketchedPlan] | StrategyError:
    """The plans of a candidate as sketched, or why there are none."""
    try:
        return sketch_plans(context, get_strategy(candidate.strategy), candidate.tractors)
    except StrategyError as refusal:
        return refusal


def simulate_candidate(context: PlanningContext, candidate: Candidate, incumbent: PlanResult | None = None) -> Outcome:
    """Sketch, compose, drive and measure one candidate; a refusal becomes a result with its reason.

    A candidate whose plans cannot beat the incumbent is not driven.
    """
    return _simulate_sketched(context, candidate, _sketch(context, candidate), incumbent)


def _simulate_sketched(
    context: PlanningContext,
    candidate: Candidate,
    sketches: list[SketchedPlan] | StrategyError,
    incumbent: PlanResult | None,
    *,
    is_shown: bool = True,
) -> Outcome:
    try:
        driven = _run_unless_pruned(context, candidate, sketches, incumbent)
    except StrategyError as refusal:
        return _build_refusal(context, candidate, str(refusal))
    if isinstance(driven, CandidateRun):
        figures = measure_candidate(context, candidate.strategy, candidate.tractors, driven, is_shown=is_shown)
        return appraise(context, figures, driven.run)
    assert incumbent is not None
    reason = describe_loss(driven, incumbent)
    return _build_refusal(context, candidate, reason, bound_s=round(driven, 3), is_simulated=False)


def run_candidate(
    context: PlanningContext, candidate: Candidate, sketches: list[SketchedPlan] | None = None
) -> CandidateRun:
    """Compose and drive one candidate, as sketched before where `sketches` are given.

    Raises StrategyError if its strategy cannot work the field.
    """
    sketched = _sketch(context, candidate) if sketches is None else sketches
    outcome = _run_unless_pruned(context, candidate, sketched, None)
    assert isinstance(outcome, CandidateRun)  # nothing prunes without an incumbent
    return outcome


def drive_plan(context: PlanningContext, candidate: Candidate, plan: Plan) -> SimulationRun:
    """The run of a candidate's plan that was driven before."""
    return FleetDriver(context, get_strategy(candidate.strategy).beside).simulate(plan)


def _run_unless_pruned(
    context: PlanningContext,
    candidate: Candidate,
    sketches: list[SketchedPlan] | StrategyError,
    incumbent: PlanResult | None,
) -> CandidateRun | float:
    """The run of the best programme, or about the least seconds of its plans where these are likely to lose to the
    incumbent."""
    if isinstance(sketches, StrategyError):
        raise sketches
    driver = FleetDriver(context, get_strategy(candidate.strategy).beside)

    def drive(composed: ComposedPlan) -> tuple[CandidateRun, float]:
        driven = _check_run(context, drive_composed(context, driver, composed))
        dropped = driven.run.plan.notes.loosened  # gates that the operation asks for: each as dear as the plan
        return driven, math.inf if driven.reason else (1 + dropped) * driven.run.duration_s

    def measure_alone_s(composed: ComposedPlan) -> list[float]:
        return driver.measure_alone_s(composed.plan)

    def find_loss_s(tractor_s: Sequence[float]) -> float | None:
        return estimate_loss_s(context, tractor_s, incumbent)

    def compose_anew(composed: ComposedPlan, driven: CandidateRun) -> ComposedPlan | None:
        with suppress(StrategyError):
            return composed.compose_anew and composed.compose_anew(composed.plan, driven)
        return None

    return drive_best(sketches, measure_alone_s, drive, find_loss_s, compose_anew)


def _check_run(context: PlanningContext, driven: CandidateRun) -> CandidateRun:
    """A run with the reason why it is not feasible, and what else a reader would not expect of it."""
    run = driven.run
    if run.stall is not None:
        where = PlanFault(STUCK, None, run.stall.x_m, run.stall.y_m)
        return replace(driven, reason=describe_stall(run.stall, context.layout.field), faults=(where,))
    if driven.reason is not None:
        return driven
    places = find_contact_places(run, context)
    reason = _find_fault(context, run, places) or find_service_conflict(run, context.supply)
    reason = reason or find_flat_battery(context, run)
    remarks = driven.remarks if reason else (*driven.remarks, *_list_remarks(context, run))
    return replace(driven, reason=reason, remarks=remarks, faults=tuple(place.fault for place in places))


def appraise(context: PlanningContext, driven: PlanResult, run: SimulationRun) -> Outcome:
    """The outcome of a drive by its figures: with what prices, clock and samples make of them."""
    area_ha, physics = context.layout.field.area_ha, context.physics
    estimated = add_risk_estimate(
        appraise_drive(context, driven, run),
        run,
        context.tractor,
        context.implement,
        area_ha,
        context.criteria,
        terrain=physics.terrain,
        fuel_load=physics.fuel_load,
    )
    return Outcome(estimated, driven, run.plan, run)


def _measure_begin_gap_m(context: PlanningContext, run: SimulationRun) -> float:
    """How near two tractors stand to each other on the field where they begin (m)."""
    model = np.array([build_model_record(context.tractor, context.implement)])
    begins = [run.get_poses(n)[:1] for n, mission in enumerate(run.plan.missions) if not mission.enters]
    gaps_m = (float(compute_outline_distances(*pair, model)[0]) for pair in combinations(begins, 2))
    return min(gaps_m, default=math.inf)


def _list_remarks(context: PlanningContext, run: SimulationRun) -> list[Remark]:
    """Remarks on what a reader would not expect of the run of a feasible plan."""
    remarks = []
    if run.min_clearance_m < context.request.clearance_m:
        near = (
            f"tractors on neighbouring tracks come within {run.min_clearance_m:.2f} m of each other: some tracks leave "
            f"only {max(0.0, compute_machine_gap_m(context)):.2f} m between machines"
        )
        begin_m = math.inf if context.going_on is None else _measure_begin_gap_m(context, run)
        if begin_m < context.request.clearance_m:
            near = f"two tractors stand {begin_m:.2f} m from each other where they begin, and drive apart"
        remarks.append(Remark(Stake.MACHINES, near))
    reverse_m, number, is_in_corner = find_longest_reversing(run)
    if reverse_m > context.driving_rules.max_reverse_m + REVERSE_TOLERANCE_M:
        place = mark_text("in a headland corner") if is_in_corner else mark_text("in a turn")
        backing = f"tractor {number} reverses {reverse_m:.0f} m {place}: check that the implement can"
        remarks.append(Remark(Stake.TIME, backing))
    if stood := {1 + int(number): run.folding_s[number] / MINUTE_S for number in np.flatnonzero(run.folding_s)}:
        tractors, minutes = " and ".join(map(str, stood)), " and ".join(f"{each:.1f}" for each in stood.values())
        one = mark_text(f"tractor {tractors} stands {minutes} min in all")
        stands = one if len(stood) == 1 else mark_text(f"tractors {tractors} stand {minutes} min in all")
        legs = [leg for mission in run.plan.missions for leg in mission.legs if leg.folded]
        folding = (
            f"{stands} to fold and unfold for the entrance"
            if all(leg.task.kind in (ENTER, LEAVE) for leg in legs)
            else f"{stands} to fold and unfold: unfolded machines do not get through everywhere"
        )
        remarks.append(Remark(Stake.TIME, folding))
    slow_m = run.sum_slow_work_m((context.request.min_speed_mps or 0.0) - SPEED_TOLERANCE_MPS)
    if slow_m > MIN_SLOW_M:
        slow = f"bends and starts are worked more slowly than the implement asks for, {slow_m:.0f} m in all"
        remarks.append(Remark(Stake.WORK, slow))
    if loosened_count := run.plan.notes.loosened:
        places = "one place" if loosened_count == 1 else f"{loosened_count} places"
        changed = f"in {places} the order of tractors was changed to avoid a deadlock"
        remarks.append(Remark(Stake.NOTHING, changed))
    return remarks + list_slope_remarks(context, run)


def _find_fault(context: PlanningContext, run: SimulationRun, places: Sequence[ContactPlace]) -> str | None:
    """Why a plan that was driven to its end is still not feasible, or None.

    `places` are where it touches something or leaves the field.
    """
    if run.contacts:
        time, first, second = run.contacts[0]
        return f"tractors {first + 1} and {second + 1} touch after {time:.0f} s"
    overturning = find_overturning(context, run)
    if overturning is not None:
        return overturning
    return describe_worst_place(places, context) if places else None
