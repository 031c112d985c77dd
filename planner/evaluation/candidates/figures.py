"""The figures of a candidate: time, cost, coverage and traffic of its last run, with the times of day."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fields.units import HOUR_S
from planner.evaluation.candidates.energy_figures import list_energy_figures, list_service_figures, measure_energy
from planner.evaluation.candidates.slope_figures import list_slope_figures
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import Overhang, measure_overhang
from planner.evaluation.ground.coverage import Coverage, count_reversals, measure_coverage
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.ground.unworked_area import explain_largest_piece
from planner.evaluation.ground.wheel_traffic import (
    FinishedGroundTraffic,
    measure_crop_traffic_m2,
    measure_finished_ground_traffic,
)
from planner.request.implement_choice import keeps_ground
from planner.request.plan_request import STANDING_CROP_OPERATIONS
from planner.risk.costs import (
    DrivenTimes,
    compute_driven_cost,
    compute_travel_cost,
    get_price_per_hour,
    measure_driven_times,
)
from reports.common.plan_records import PlanFault, Remark, Stake
from reports.common.plan_results import PlanResult
from reports.plan.figures import MEASURES
from vehicle.missions.plan import HEADLAND_PASS
from vehicle.missions.run import DONE, SimulationRun
from vehicle.records import FINISHED

MIN_BEYOND_M = 5.0  # less driving beyond the allowed overhang is in the results, but no remark


@dataclass(frozen=True, eq=False)
class CandidateRun:
    """The last run of a candidate, why it is not feasible (None if it is), its kinds of turns and its remarks.

    `faults` are the places where it touches something or leaves the field.
    """

    run: SimulationRun
    reason: str | None
    turns: str
    remarks: tuple[Remark, ...] = ()
    faults: tuple[PlanFault, ...] = ()


def measure_candidate(
    context: PlanningContext, strategy: str, tractors: int, candidate_run: CandidateRun, *, is_shown: bool = True
) -> PlanResult:
    """The figures of a candidate's last run without what prices and clock make of them (`appraise_drive`); where it is
    not shown without those by which nothing is chosen, too."""
    run, reason, turn_names = candidate_run.run, candidate_run.reason, candidate_run.turns
    if run.outcome != DONE:
        return PlanResult(
            strategy,
            tractors,
            turn_names,
            False,
            reason,
            collisions=len(run.contacts),
            faults=candidate_run.faults,
        )
    seconds, swept = run.sum_seconds_by_status(), compute_swept_area(run, context)
    operation, spoilt_m2 = context.request.operation, None
    is_kept = keeps_ground(operation, context.request.find_draft_rule())
    traffic = measure_finished_ground_traffic(run, context, swept) if is_shown or is_kept else None
    if operation in STANDING_CROP_OPERATIONS:
        spoilt_m2 = measure_crop_traffic_m2(run, context, swept)
    elif traffic is not None and is_kept:
        spoilt_m2 = traffic.area_m2
    coverage = replace(measure_coverage(run, context, swept), spoilt_m2=spoilt_m2 or 0.0)
    overhang = measure_overhang(run, context) if is_shown else None
    coverage = replace(coverage, largest_piece=explain_largest_piece(context, coverage))
    overhangs = [] if overhang is None else _list_overhang_remarks(overhang, context)
    remarks = [*candidate_run.remarks, *overhangs]
    return PlanResult(
        strategy=strategy,
        tractors=tractors,
        turn=turn_names,
        feasible=reason is None,
        reason=reason,
        time_s=run.duration_s,
        tractor_time_s=float(np.sum(run.finish_s)),
        finished_s=coverage.extrapolate_to_field(run.duration_s),
        spoilt_m2=spoilt_m2,
        outside_m=None if overhang is None else overhang.farthest_m,
        outside_along_m=None if overhang is None else overhang.beyond_m,
        turning_s=float(seconds["turning"].sum() + seconds["reversing"].sum()),
        waiting_s=float(seconds["waiting"].sum()),
        reversals=count_reversals(run),
        min_clearance_m=run.min_clearance_m if math.isfinite(run.min_clearance_m) else None,
        keeps_clearance=run.min_clearance_m >= context.request.clearance_m,
        collisions=len(run.contacts),
        measured={key: measure(run, context.layout.field.area_ha) for key, measure in MEASURES.items()},
        remarks=tuple(remark.text for remark in sorted(remarks, key=lambda remark: remark.stake)),
        headland_passes=context.layout.headland_passes,
        headland_s=measure_headland_phase_s(run),
        headland_order=name_headland_order(context, run.plan.notes.headland or None),
        **_list_ground_figures(coverage, traffic),
        **list_slope_figures(context, run),
        **list_service_figures(context, run),
        resting=(*run.plan.resting, *range(run.plan.tractors + 1, tractors + 1)),
        faults=candidate_run.faults,
    )


def appraise_drive(context: PlanningContext, figures: PlanResult, run: SimulationRun) -> PlanResult:
    """The figures of a drive with its cost, energy and clock times; those of one that did not end as they are."""
    if figures.time_s is None:
        return figures
    return appraise_times(context, figures, measure_driven_times(run), measure_energy(context, run), run.work_finish_s)


def appraise_times(
    context: PlanningContext,
    figures: PlanResult,
    times: DrivenTimes,
    energy: tuple[float, ...] | None,
    work_finish_s: float,
) -> PlanResult:
    """The figures of a plan with its cost, energy and clock times.

    `energy` are the litres or kilowatt-hours of every tractor, None where they are not known; field work takes
    `work_finish_s`.
    """
    hourly, hiring = _compute_cost(context, times, energy)
    figures = replace(
        figures,
        cost=hourly + hiring,
        finished_cost=hourly * figures.left_factor + hiring,
        **list_energy_figures(context, times, energy),
    )
    return _add_clock_times(figures, context, work_finish_s)


def _list_ground_figures(coverage: Coverage, traffic: FinishedGroundTraffic | None) -> dict[str, Any]:
    """What was worked and driven over, by the names of a result."""
    figures = {
        "worked_pct": coverage.worked_pct,
        "overlap_pct": coverage.overlap_pct,
        "missed_m2": coverage.missed_m2,
        "spared_m2": coverage.spared_m2,
        "left_out_m2": coverage.left_out_m2 or None,
        "largest_missed": coverage.largest_piece,
    }
    if traffic is not None:
        figures["wheel_traffic_m2"] = traffic.off_headland_m2
        figures["over_finished_m"], figures["over_finished_m2"] = traffic.length_m, traffic.area_m2
    return figures


def name_headland_order(context: PlanningContext, order: str | None) -> str | None:
    """Whether the headland is worked first or last; None where nothing else is."""
    return order or None if context.layout.swaths else None


def measure_headland_phase_s(run: SimulationRun) -> float | None:
    """Seconds from the first tractor's start on the headland passes to the last one's end; None without passes."""
    times = []
    for tractor in range(run.plan.tractors):
        is_on_headland = run.find_task_rows(tractor, (HEADLAND_PASS,))
        headland_rows = np.flatnonzero(is_on_headland & (run.get_statuses(tractor) != FINISHED))
        times += (
            [float(run.time_s[headland_rows[0]]), float(run.time_s[headland_rows[-1]])] if len(headland_rows) else []
        )
    return max(times) - min(times) if times else None


def _list_overhang_remarks(overhang: Overhang, context: PlanningContext) -> list[Remark]:
    """A remark on machines that reach farther beyond the outline than allowed for a while."""
    if overhang.beyond_m < MIN_BEYOND_M:
        return []
    text = (
        f"tractor or implement reach up to {overhang.farthest_m:.1f} m beyond the outline, and farther than allowed "
        f"along {overhang.beyond_m:.0f} m of driving (the overhang asked for is {context.request.overhang_m:g} m)"
    )
    return [Remark(Stake.GROUND_OF_OTHERS, text)]


def name_main_turns(counts: Mapping[str, int]) -> str:
    """The two most frequent kinds of turns, the most frequent first."""
    return "+".join(sorted(counts, key=lambda kind: (-counts[kind], kind))[:2]) or "none"


def _compute_cost(
    context: PlanningContext, times: DrivenTimes, energy: tuple[float, ...] | None
) -> tuple[float, float]:
    """Cost of the work and of bringing the tractors: by the prices of a farm, or by the hourly price."""
    working, request = len(times.tractor_s), context.request
    if context.cost_terms is not None:
        travel_cost = working * compute_travel_cost(context.cost_terms)
        used = None if energy is None else math.fsum(energy)
        return compute_driven_cost(times, context.cost_terms, used) - travel_cost, travel_cost
    price_per_hour = get_price_per_hour(request.price_per_hour)
    brought = working + times.resting - (0 if context.going_on is None else len(context.going_on.stands))
    hours = float(times.tractor_s.max()) / HOUR_S
    return hours * working * price_per_hour, brought * request.price_per_tractor


def _add_clock_times(figures: PlanResult, context: PlanningContext, work_finish_s: float) -> PlanResult:
    """The figures with the times when field work begins, ends, would end for the whole field, and all are home.

    Field work takes `work_finish_s` as driven.
    """
    workday, time_limit_s = context.workday, context.request.time_limit_s
    field_finish_s = work_finish_s * figures.left_factor
    if workday is None:
        timed_figures = replace(figures, done_s=work_finish_s, finished_done_s=field_finish_s)
    else:
        before_field_s = workday.before_field_s
        timed_figures = replace(
            figures,
            transport_s=figures.tractors * (before_field_s + workday.after_field_s),
            ready_s=workday.compute_clock_s(before_field_s, begins=True),
            done_s=workday.compute_clock_s(before_field_s + work_finish_s),
            finished_done_s=workday.compute_clock_s(before_field_s + field_finish_s),
            home_s=workday.compute_clock_s(before_field_s + (figures.time_s or 0.0) + workday.after_field_s),
        )
    return replace(
        timed_figures,
        meets_deadline=None if time_limit_s is None else timed_figures.field_work_end_s <= time_limit_s,
    )
