"""What keeps the best plan from being a recommendation: decided here once, for every report and exit status."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.unworked_area import KEPT_HEADLAND, find_unworked_areas
from reports.common.language import mark_text
from reports.common.plan_results import PlanRanking, PlanResult
from reports.common.shortfalls import LATE, PULL, WORKED, Shortfall

MIN_WORKED_PCT = 90.0  # of the ground asked for: nobody takes a plan that leaves more for finished work


def mark_worked_shares(results: Iterable[PlanResult], context: PlanningContext) -> list[PlanResult]:
    """The results, each with whether it works enough of the ground asked for."""
    listed = list(results)
    if all(_is_enough(result, 1.0) for result in listed):
        return listed
    requested_share = _measure_requested_share(context)
    return [replace(result, works_enough=_is_enough(result, requested_share)) for result in listed]


def find_shortfalls(ranking: PlanRanking, context: PlanningContext) -> tuple[Shortfall, ...]:
    """What the best plan of a ranking lacks, with what its samples said before; empty without a plan."""
    best = ranking.best
    if best is None:
        return ()
    found = [Shortfall(PULL)] if ranking.pull is not None and ranking.pull.is_infeasible else []
    found += [] if best.works_enough else [Shortfall(WORKED, _describe_worked_share(best, context))]
    return (*found, *ranking.shortfalls, *([] if ranking.missed_by_s is None else [Shortfall(LATE)]))


def _is_enough(result: PlanResult, requested_share: float) -> bool:
    return result.worked_pct is None or result.worked_pct >= MIN_WORKED_PCT * requested_share


def _measure_requested_share(context: PlanningContext) -> float:
    """The share of the field that is to be worked: all but a headland that is kept free on request."""
    kept_m2 = sum(one.area_m2 for one in find_unworked_areas(context) if one.reason == KEPT_HEADLAND)
    return 1.0 - kept_m2 / float(context.layout.field.region_without_obstacles.area)


def _describe_worked_share(best: PlanResult, context: PlanningContext) -> str:
    """The share that a plan works, and the reason why most of the rest is not worked."""
    requested_share = _measure_requested_share(context)
    requested_m2 = requested_share * context.layout.field.region_without_obstacles.area
    worked_pct = (best.worked_pct or 0.0) / requested_share
    areas = [(one.area_m2, one.reason) for one in find_unworked_areas(context) if one.reason != KEPT_HEADLAND]
    unexplained_m2 = 0.01 * (100.0 - worked_pct) * requested_m2 - sum(area_m2 for area_m2, _ in areas)
    most_m2, reason = max([*areas, (unexplained_m2, "reached by no pass of this plan as it is driven")])
    most_pct = 100.0 * most_m2 / requested_m2
    ground = mark_text("the field") if requested_share == 1.0 else mark_text("the ground inside the headland")
    return f"No recommendation: only {worked_pct:.1f} % of {ground} is worked; {most_pct:.0f} % is {reason}."
