"""One candidate from its strategy to its figures: built, simulated, repaired and measured."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from planner.evaluation.candidates.energy_figures import find_flat_battery
from planner.evaluation.candidates.figures import CandidateRun, join_remarks, measure_candidate, name_main_turns
from planner.evaluation.candidates.fleet_drive import (
    build_rehearsal,
    build_scheduler,
    build_simulate,
    compute_machine_gap_m,
)
from planner.evaluation.candidates.line_programme import ProgrammeDriver, compose_plans
from planner.evaluation.candidates.pruning import (
    Incumbent,
    PrunedCandidate,
    PruningLimits,
    build_pruned_result,
    choose_lower_bounded,
    drop_simulated,
    is_pruned_at_all_corners,
    prune_composed,
    relax_bound_for_corners,
    simulate_promising_first,
    split_contenders,
)
from planner.evaluation.candidates.service_conflicts import find_service_conflict
from planner.evaluation.candidates.slope_figures import (
    describe_stall,
    find_overturning,
    list_slope_remarks,
    locate_stall,
)
from planner.evaluation.candidates.solo_runs import SoloRuns
from planner.evaluation.candidates.time_bounds import build_speed_limits
from planner.evaluation.candidates.variants import (
    OTHER_ORDER_REMARK,
    build_for_headland_orders,
    build_for_reachable_job,
    check_formation_supply,
    iter_headland_variants,
    list_other_orders,
    list_service_variants,
)
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import ContactPlace, describe_worst_place, find_contact_places
from planner.evaluation.ground.coverage import measure_longest_reverse_m
from planner.evaluation.ground.wheel_traffic import compute_charged_s
from planner.evaluation.repair.path_deviation import (
    MAX_OFFSET_M,
    TurnDeviation,
    find_turn_deviations,
    get_worst_offset_m,
)
from planner.evaluation.repair.place_repair import describe_slowed_places, slow_at_places
from planner.evaluation.repair.turn_repair import (
    RepairedTurns,
    apply_repaired_turns,
    apply_repairs,
    collect_repaired_turns,
    find_repairs,
    sum_excess_offset_m,
)
from planner.request.plan_request import KEPT_GROUND_OPERATIONS
from planner.risk.assessment import add_risk_estimate
from planner.traffic.conflict_repair import Scheduler, resolve_conflicts
from reports.common.plan_results import NO_PATH, PlanFault, PlanResult
from strategies.formations.grouping import StartCorner
from strategies.formations.leftover import rank_start_corners
from strategies.path_planning.errors import NoPathError, NoPathFromError, StrategyError
from strategies.program.field_job import FieldJob
from strategies.program.strategy_record import RefinedPlan, Simulate, Strategy
from strategies.registry import get_strategy
from vehicle.missions.plan import HEADLAND_PASS, Plan
from vehicle.missions.run import DONE, SimulationRun

MAX_OFFSET_SHARE = 1.0 / 3.0  # of the working width: more leaves an unworked strip
LOST_WIDTHS, LOST_M = 1.0, 2.5  # working widths and metres: a tractor starting farther off than both has lost its line
MIN_GAIN_M = 0.02
SPEED_TOLERANCE_MPS, MIN_SLOW_M = 0.1, 10.0  # of the least working speed, and of what is worked below it
REVERSE_TOLERANCE_M = 0.5  # legs are rounded


@dataclass(frozen=True)
class Candidate:
    """A combination to try; `jump` fixes the pattern of swaths for a strategy that takes one."""

    strategy: str
    tractors: int
    jump: int | None = None


@dataclass(frozen=True, eq=False)
class CandidateEvaluation:
    """The figures of a candidate and their run; no run if its strategy refused the field."""

    result: PlanResult
    run: SimulationRun | None


def compute_candidate_figures(context: PlanningContext, candidate: Candidate) -> PlanResult:
    """Only the figures of `simulate_candidate`."""
    return simulate_candidate(context, candidate).result


def simulate_candidate(
    context: PlanningContext, candidate: Candidate, incumbent: Incumbent | None = None
) -> CandidateEvaluation:
    """Build, simulate and measure one candidate; a refusal becomes a result with its reason.

    A candidate whose plans cannot beat the incumbent is not simulated.
    """
    run = _run_programmes if is_by_lines(context, candidate) else _run_unless_pruned
    try:
        outcome = run(context, candidate, incumbent)
    except StrategyError as refusal:
        faults = (_locate_missing_path(refusal),) if isinstance(refusal, NoPathError | NoPathFromError) else ()
        return CandidateEvaluation(
            PlanResult(
                candidate.strategy, candidate.tractors, context.request.turn, False, str(refusal), faults=faults
            ),
            None,
        )
    if isinstance(outcome, PrunedCandidate):
        return CandidateEvaluation(build_pruned_result(outcome, context, candidate.strategy, candidate.tractors), None)
    return _measure_run(context, candidate, outcome)


def is_by_lines(context: PlanningContext, candidate: Candidate) -> bool:
    """Whether a candidate is a programme of work lines; not with a fixed pattern of swaths."""
    strategy = get_strategy(candidate.strategy)
    has_lines = strategy.deal is not None or strategy.compose is not None
    return candidate.jump is None and has_lines


def _run_programmes(
    context: PlanningContext, candidate: Candidate, incumbent: Incumbent | None
) -> CandidateRun | PrunedCandidate:
    """The programme that finishes the field first; of those that cannot be driven the first if none can.

    Another order of headland and swaths is driven only where it would be quicker than what was driven before.
    """
    composed = compose_plans(context, get_strategy(candidate.strategy), candidate.tractors)
    pruned = prune_composed(context, [one.tractor_s for one in composed], incumbent)
    if pruned is not None:
        return pruned
    driver = ProgrammeDriver(context)
    best: CandidateRun | None = None
    best_s = math.inf
    for one in composed:
        if one.cost_s >= best_s:
            break
        driven = driver.drive(one)
        driven = driven if driven.reason else _check_programme(context, driven)
        seconds = math.inf if driven.reason else driven.run.duration_s * one.left_factor
        if best is None or seconds < best_s:
            best, best_s = driven, seconds
    assert best is not None  # composed has at least one
    return best


def _check_programme(context: PlanningContext, driven: CandidateRun) -> CandidateRun:
    """The run of a programme with the reason why it is not feasible, and what else a reader would not expect of it."""
    places = find_contact_places(driven.run, context)
    reason = _find_fault(context, driven.run, places, None) or find_service_conflict(driven.run, context.supply)
    reason = reason or find_flat_battery(context, driven.run)
    remarks = [] if reason else _list_remarks(context, driven.run, None)
    remark, faults = join_remarks(driven.remark, *remarks), tuple(place.fault for place in places)
    return replace(driven, reason=reason, remark=remark, faults=faults)


def _measure_run(context: PlanningContext, candidate: Candidate, outcome: CandidateRun) -> CandidateEvaluation:
    """The figures of a run, with those of its samples."""
    result = measure_candidate(context, candidate.strategy, candidate.tractors, outcome)
    area_ha, physics = context.layout.field.area_ha, context.physics
    estimated = add_risk_estimate(
        result,
        outcome.run,
        context.tractor,
        context.implement,
        area_ha,
        context.criteria,
        terrain=physics.terrain,
        fuel_load=physics.fuel_load,
    )
    return CandidateEvaluation(estimated, outcome.run)


def _locate_missing_path(refusal: NoPathError | NoPathFromError) -> PlanFault:
    """Where no path leads on: at the place named, or at the end of the first of the swaths."""
    x_m, y_m = refusal.place if isinstance(refusal, NoPathFromError) else refusal.swaths[0].end_m
    return PlanFault(NO_PATH, None, x_m, y_m)


def run_candidate(context: PlanningContext, candidate: Candidate) -> CandidateRun:
    """Build, simulate and repair one candidate; raises StrategyError if its strategy cannot work the field."""
    outcome = _run_unless_pruned(context, candidate, None)
    assert isinstance(outcome, CandidateRun)
    return outcome


def _run_unless_pruned(
    context: PlanningContext, candidate: Candidate, incumbent: Incumbent | None
) -> CandidateRun | PrunedCandidate:
    """The run of a candidate, or its bound if the incumbent beats it."""
    strategy = get_strategy(candidate.strategy)
    if candidate.jump is not None and not strategy.takes_jump:
        raise StrategyError(f"Strategy {strategy.name!r} has its own order of tracks; leave out the jump.")
    job = replace(context.build_job(candidate.tractors), jump=candidate.jump)
    return (_run_first_drivable_corner if strategy.side_by_side else _run_first_drivable_order)(
        context, strategy, job, incumbent
    )


def _run_first_drivable_corner(
    context: PlanningContext, strategy: Strategy, job: FieldJob, incumbent: Incumbent | None
) -> CandidateRun | PrunedCandidate:
    """A formation from the first corner that can be driven: the one at the entrance, then the most promising."""
    first: CandidateRun | None = None
    refusal: StrategyError | None = None
    for corner in iter_corners(job):
        try:
            outcome = _run_job(context, strategy, replace(job, corner=corner, turn_counts={}), incumbent)
        except StrategyError as error:
            refusal = refusal or error
            continue
        if isinstance(outcome, PrunedCandidate) or outcome.reason is None:
            return outcome
        first = first or outcome
    if first is None:
        raise refusal or StrategyError("No corner to begin at; the field has no tracks.")
    return first


def _run_first_drivable_order(
    context: PlanningContext, strategy: Strategy, job: FieldJob, incumbent: Incumbent | None
) -> CandidateRun | PrunedCandidate:
    """Tractors with swaths of their own, in the first order that can be driven."""
    first: CandidateRun | None = None
    pruned: PrunedCandidate | None = None
    refusal: StrategyError | None = None
    for number, variant in enumerate((job, *list_other_orders(strategy, job))):
        try:
            outcome = _run_job(context, strategy, variant, incumbent)
        except StrategyError as error:
            refusal = refusal or error
            continue
        if isinstance(outcome, CandidateRun) and outcome.reason is None:
            return replace(outcome, remark=join_remarks(outcome.remark, OTHER_ORDER_REMARK)) if number else outcome
        if isinstance(outcome, CandidateRun):
            first = first or outcome
        elif not number and not outcome.was_simulated:
            return outcome
        elif not number or (pruned and outcome.bound_s < pruned.bound_s):
            pruned = outcome
    if pruned is not None:
        return pruned
    if first is None:
        assert refusal is not None  # every order is simulated, pruned or refused
        raise refusal
    return first


def iter_corners(job: FieldJob) -> Iterator[StartCorner]:
    """The corner at the entrance, then the others, the most promising first, ranked only when needed."""
    if job.corner is not None:
        yield job.corner
    yield from (corner for corner in rank_start_corners(job) if corner != job.corner)


def _run_job(
    context: PlanningContext, strategy: Strategy, job: FieldJob, incumbent: Incumbent | None
) -> CandidateRun | PrunedCandidate:
    rehearsal = build_rehearsal(context)
    simulate = build_simulate(context, rehearsal)

    def build(job: FieldJob) -> RefinedPlan:
        refine = strategy.refine
        if refine is None:
            return build_for_headland_orders(strategy, job, context.request.headland_orders)
        return refine(job, simulate, context.tractor, context.implement)

    check_formation_supply(job, strategy)
    solo_runs = SoloRuns(context, rehearsal)
    give_way = build_scheduler(context, solo_runs)
    limits = PruningLimits(
        build_speed_limits(context.tractor, context.implement, context.driving_rules.radius_m), solo_runs
    )
    refined, reachable = build_for_reachable_job(job, build, context.layout_repairs)
    job, refined = reachable.job, replace(refined, remark=join_remarks(refined.remark, reachable.remark))
    first: CandidateRun | None = None
    slower_pruned: PrunedCandidate | None = None
    simulated_plans: list[Plan] = []
    repaired_turns: RepairedTurns = {}

    def simulate_choice(choice: RefinedPlan) -> CandidateRun:
        plan = apply_repaired_turns(choice.plan, repaired_turns, context)
        if plan is not choice.plan:
            repaired_run = _run_plan(
                context, strategy, job, replace(choice, plan=plan, run=None), simulate, give_way, repaired_turns
            )
            if repaired_run.reason is None:
                return repaired_run
        return _run_plan(context, strategy, job, choice, simulate, give_way, repaired_turns)

    for variants in iter_headland_variants(context, job, refined):
        all_choices = list_service_variants(job, strategy, variants)
        choices = contenders = drop_simulated(all_choices, simulated_plans)
        solo_runs.expect_plans(choice.plan for choice in choices)
        if incumbent and not (first and strategy.side_by_side):  # another corner might work with the first transition
            contenders, pruned = split_contenders(context, choices, incumbent, solo_runs)
            is_lost = not contenders and len(choices) == len(all_choices)
            if strategy.side_by_side and pruned is not None and is_lost and is_pruned_at_all_corners(pruned):
                return relax_bound_for_corners(pruned)
            if strategy.side_by_side:
                contenders = choices
            else:
                slower_pruned = choose_lower_bounded(slower_pruned, pruned)
            if slower_pruned is not None and is_lost:
                return replace(slower_pruned, was_simulated=first is not None)
        runs = simulate_promising_first(contenders, choices, simulate_choice, limits)
        feasible = [each for each in runs if each.reason is None]
        if feasible:
            return _choose_quickest_run(context, feasible)
        first = first or next(iter(runs), None)
        simulated_plans += [each.plan for each in contenders]
    assert first is not None  # a plan that cannot be built is refused
    return first if slower_pruned is None else replace(slower_pruned, was_simulated=True)


def _choose_quickest_run(context: PlanningContext, candidate_runs: list[CandidateRun]) -> CandidateRun:
    """The run that ends first, where finished ground is kept with what is driven over charged."""
    if len(candidate_runs) == 1 or context.request.operation not in KEPT_GROUND_OPERATIONS:
        return min(candidate_runs, key=lambda each: round(each.run.duration_s, 3))
    return min(candidate_runs, key=lambda each: round(compute_charged_s(each.run, context), 3))


def _run_plan(
    context: PlanningContext,
    strategy: Strategy,
    job: FieldJob,
    refined: RefinedPlan,
    simulate: Simulate,
    schedule: Scheduler,
    repaired_turns: RepairedTurns | None = None,
) -> CandidateRun:
    repairs = strategy.max_repairs
    places: tuple[ContactPlace, ...] = ()
    run, reason = _simulate_without_conflicts(refined, simulate, repairs, schedule)
    faults: tuple[PlanFault, ...] = ()
    if run.stall is not None:
        reason, faults = describe_stall(run.stall, context.layout.field), (locate_stall(run.stall),)
    if reason is None:
        run, worst_deviation = _repair_turns(context, refined.plan, run, simulate, repairs, schedule, repaired_turns)
        run, places, slowed = slow_at_places(
            run, context, lambda plan: resolve_conflicts(plan, simulate, repairs, schedule)
        )
        reason = _find_fault(context, run, places, worst_deviation) or find_service_conflict(run, job.supply)
        reason = reason or find_flat_battery(context, run)
    remarks = [] if reason else [*_list_remarks(context, run, worst_deviation), describe_slowed_places(slowed)]
    return CandidateRun(
        run,
        reason,
        name_main_turns(job.turn_counts),
        join_remarks(refined.remark, *remarks),
        (*faults, *(place.fault for place in places)),
    )


def _list_remarks(context: PlanningContext, run: SimulationRun, worst_deviation: TurnDeviation | None) -> list[str]:
    """Remarks on what a reader would not expect of the run of a feasible plan."""
    remarks = context.layout_repairs.describe(context.layout.field)
    if run.min_clearance_m < context.request.clearance_m:
        remarks.append(
            f"tractors on neighbouring tracks come within {run.min_clearance_m:.2f} m of each other: some tracks leave "
            f"only {max(0.0, compute_machine_gap_m(context)):.2f} m between machines"
        )
    reverse_m = measure_longest_reverse_m(run)
    if reverse_m > context.driving_rules.max_reverse_m + REVERSE_TOLERANCE_M:
        remarks.append(f"reversing {reverse_m:.0f} m, as nothing else leads there; the list of legs says where")
    slow_m = run.sum_slow_work_m((context.request.min_speed_mps or 0.0) - SPEED_TOLERANCE_MPS)
    if slow_m > MIN_SLOW_M:
        remarks.append(f"bends and starts are worked more slowly than the implement asks for, {slow_m:.0f} m in all")
    if loosened_count := run.plan.notes.get("loosened"):
        places = "one place" if loosened_count == 1 else f"{loosened_count} places"
        remarks.append(f"in {places} the order of tractors was changed to avoid a deadlock")
    if worst_deviation is not None and worst_deviation.offset_m > MAX_OFFSET_SHARE * context.layout.width_m:
        remarks.append(f"{_describe_offset_start(run, worst_deviation)}; ground missed there is counted")
    return remarks + list_slope_remarks(context, run)


def _describe_offset_start(run: SimulationRun, deviation: TurnDeviation) -> str:
    kind = run.plan.missions[deviation.tractor].legs[deviation.leg].task.kind
    swath_name = "headland pass" if kind == HEADLAND_PASS else "track"
    return f"a {swath_name} starts {deviation.offset_m:.2f} m beside its line"


def _simulate_without_conflicts(
    refined: RefinedPlan, simulate: Simulate, most_repairs: int, schedule: Scheduler
) -> tuple[SimulationRun, str | None]:
    """The run of a plan with its conflicts resolved, and why it is not feasible (None if it is)."""
    if refined.run is not None and refined.run.outcome == DONE:
        return refined.run, None
    return resolve_conflicts(refined.plan, simulate, most_repairs, schedule)


def _repair_turns(
    context: PlanningContext,
    plan: Plan,
    run: SimulationRun,
    simulate: Simulate,
    most_repairs: int,
    schedule: Scheduler,
    repaired_turns: RepairedTurns | None = None,
) -> tuple[SimulationRun, TurnDeviation | None]:
    """The run with badly followed turns repaired where that helps, and the worst remaining deviation.

    Repairs that help are added to `repaired_turns`. If tractors then meet because of the gates of the run, and a turn
    leaves the field, the repairs are applied to `plan`, which has no gates yet. Where the headland is worked, swaths
    that start less than a third of the width off are left as they are: the missed ground costs less than slower turns.
    """
    deviations = find_turn_deviations(run, context)
    max_offset_m = (
        max(MAX_OFFSET_M, MAX_OFFSET_SHARE * context.layout.width_m) if context.headland_passes else MAX_OFFSET_M
    )
    repairs = find_repairs(
        run.plan,
        [deviation for deviation in deviations if deviation.offset_m > max_offset_m or deviation.is_outside],
        context,
    )
    if repairs and sum_excess_offset_m(deviations, repairs) <= sum_excess_offset_m(deviations) - MIN_GAIN_M:
        repaired_run, fault = resolve_conflicts(apply_repairs(run.plan, repairs), simulate, most_repairs, schedule)
        if fault and plan is not run.plan and any(repair.deviation.is_outside for repair in repairs):
            repaired_run, fault = resolve_conflicts(apply_repairs(plan, repairs), simulate, most_repairs, schedule)
        remaining = deviations if fault else find_turn_deviations(repaired_run, context)
        if sum_excess_offset_m(remaining) <= sum_excess_offset_m(deviations) - MIN_GAIN_M and get_worst_offset_m(
            remaining
        ) <= get_worst_offset_m(deviations):
            if repaired_turns is not None:
                repaired_turns |= collect_repaired_turns(run.plan, repairs, context)
            run, deviations = repaired_run, remaining
    return run, max(deviations, key=lambda deviation: deviation.offset_m, default=None)


def _find_fault(
    context: PlanningContext,
    run: SimulationRun,
    places: Sequence[ContactPlace],
    worst_deviation: TurnDeviation | None,
) -> str | None:
    """Why a plan that was driven to its end is still not feasible, or None.

    `places` are where it touches something or leaves the field, `worst_deviation` is that of the swath or headland side
    that started farthest beside its line. Where the headland is worked, the ground missed there is measured and
    charged, and only a tractor that has lost its line is refused.
    """
    if run.contacts:
        time, first, second = run.contacts[0]
        return f"tractors {first + 1} and {second + 1} touch after {time:.0f} s"
    overturning = find_overturning(context, run)
    if overturning is not None:
        return overturning
    if places:
        return describe_worst_place(places, context)
    width = context.layout.width_m
    if (
        worst_deviation is not None
        and not context.headland_passes
        and worst_deviation.offset_m > MAX_OFFSET_SHARE * width
    ):
        return f"{_describe_offset_start(run, worst_deviation)}, more than a third of the working width"
    if worst_deviation is not None and worst_deviation.offset_m > max(LOST_WIDTHS * width, LOST_M):
        start = _describe_offset_start(run, worst_deviation)
        return f"{start}, more than a working width: the tractor has lost its line"
    return None
