"""Which candidates are simulated first, and which are pruned because even their best case loses to the incumbent.

One strategy whose tractors have swaths of their own is simulated first, with every number of tractors. Another plan
with as many tractors is skipped if its lower bound is longer, as it would be ranked behind.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from planner.evaluation.candidates.evaluate import Candidate, is_by_lines, iter_corners
from planner.evaluation.candidates.pruning import (
    Incumbent,
    PrunedCandidate,
    build_pruned_result,
    is_pruned_at_all_corners,
    prune_plans,
    relax_bound_for_corners,
)
from planner.evaluation.candidates.time_bounds import build_speed_limits, compute_earliest_finish_s, remove_gates
from planner.evaluation.candidates.variants import (
    build_for_headland_orders,
    build_for_reachable_job,
    iter_headland_variants,
)
from planner.evaluation.context import PlanningContext
from planner.request.plan_request import LEAST_FUEL, SUREST
from reports.common.plan_results import PlanResult, get_finished_field_s
from strategies.path_planning.errors import StrategyError
from strategies.program.field_job import FieldJob
from strategies.program.strategy_record import RefinedPlan, Strategy
from strategies.registry import STRATEGIES, get_strategy
from vehicle.missions.plan import Plan

MIN_SWATH_WORK_S = 900.0  # of work on swaths: on smaller fields every plan is simulated, as that is quick
MIN_TOTAL_WORK_S = 1800.0  # or of work on swaths and headland passes


def order_candidates(context: PlanningContext, todo: Sequence[Candidate]) -> list[list[int]]:
    """Numbers of the candidates in the order they are simulated: one strategy before the others.

    It is the first requested strategy of the registry whose tractors have swaths of their own. There is only one wave
    on small fields, and if the surest plan or that of least fuel is requested: a slower plan may be that.
    """
    simulates_all = context.criteria is not None and context.criteria.objective in (SUREST, LEAST_FUEL)
    if simulates_all or not is_worth_bounding(context):
        return [list(range(len(todo)))]
    strategies = {one.strategy for one in todo}
    first = next((name for name in STRATEGIES if name in strategies and not STRATEGIES[name].side_by_side), None)
    parts = [[n for n, one in enumerate(todo) if (one.strategy == first) is early] for early in (True, False)]
    return [part for part in parts if part]


def is_worth_bounding(context: PlanningContext) -> bool:
    """Whether the work is long enough that bounds save more time than they take."""
    speed = context.driving_rules.work_speed_mps
    swaths_s = context.layout.total_length_m / speed
    headland_s = math.fsum(headland_pass.length_m for headland_pass in context.headland_passes) / speed
    return swaths_s >= MIN_SWATH_WORK_S or swaths_s + headland_s >= MIN_TOTAL_WORK_S


def find_incumbents(results: Mapping[int, PlanResult]) -> dict[int, Incumbent]:
    """The quickest feasible plan so far for every number of tractors."""
    worst_first = sorted((one for one in results.values() if one.feasible), key=_build_plan_sort_key, reverse=True)
    return {
        one.tractors: Incumbent(one.strategy, round(get_finished_field_s(one), 3), _compute_tractor_s(one))
        for one in worst_first
    }


def _build_plan_sort_key(plan: PlanResult) -> tuple[float, str, int]:
    return round(get_finished_field_s(plan), 3), plan.strategy, plan.tractors


def _compute_tractor_s(plan: PlanResult) -> float:
    """Seconds of all tractors together, including the time that the missed ground would take."""
    return round((plan.tractor_time_s or 0.0) * (get_finished_field_s(plan) / plan.time_s if plan.time_s else 1.0), 3)


def prune_candidate(context: PlanningContext, candidate: Candidate, incumbent: Incumbent | None) -> PlanResult | None:
    """The result of a candidate that cannot win; None if it might, or if only composing or simulating it can tell."""
    if incumbent is None or is_by_lines(context, candidate):
        return None
    starts = _iter_starts(context, candidate)
    first = next(starts, None)
    try:
        pruned = prune_plans(context, first.ordered_plans, incumbent) if first else None
    except StrategyError:
        return None
    if first is None or pruned is None:
        return None
    if get_strategy(candidate.strategy).side_by_side:
        pruned = (
            relax_bound_for_corners(pruned)
            if is_pruned_at_all_corners(pruned)
            else _bound_all_corners(pruned, first, starts)
        )
    return None if pruned is None else build_pruned_result(pruned, context, candidate.strategy, candidate.tractors)


def _bound_all_corners(
    pruned: PrunedCandidate, first: _CandidateStart, other_starts: Iterator[_CandidateStart]
) -> PrunedCandidate | None:
    """A formation pruned at its first corner, with the lowest bound of all corners; None if another might win."""
    after_swaths_s = pruned.bound_s - first.min_swaths_s
    seconds = [pruned.bound_s, *(after_swaths_s + other.min_swaths_s for other in other_starts)]
    return replace(pruned, bound_s=min(seconds)) if min(seconds) > pruned.incumbent.finish_s else None


@dataclass(frozen=True)
class _CandidateStart:
    """A candidate from one corner: the plan of its swaths, with no more waiting than it will have."""

    context: PlanningContext
    job: FieldJob
    refined: RefinedPlan

    @property
    def min_swaths_s(self) -> float:
        """Seconds that the swaths take at least."""
        return compute_earliest_finish_s(
            self.refined.plan,
            build_speed_limits(self.context.tractor, self.context.implement, self.context.driving_rules.radius_m),
        )

    @property
    def ordered_plans(self) -> list[Plan]:
        """The whole plan for every order of headland and swaths."""
        return [choice.plan for choice in next(iter_headland_variants(self.context, self.job, self.refined))]


def _iter_starts(context: PlanningContext, candidate: Candidate) -> Iterator[_CandidateStart]:
    """A candidate from where it is driven first; a formation then from its other corners.

    The real plan may take longer if the headland passes need transitions that keep tractors farther apart.
    """
    strategy = get_strategy(candidate.strategy)
    job = replace(context.build_job(candidate.tractors), jump=candidate.jump)
    for corner in iter_corners(job) if strategy.side_by_side else (job.corner,):
        try:
            refined, reachable = build_for_reachable_job(
                replace(job, corner=corner, turn_counts={}),
                lambda job: _build_least_waiting_plan(context, strategy, job),
                context.layout_repairs,
            )
            yield _CandidateStart(context, reachable.job, refined)
        except StrategyError:
            continue


def _build_least_waiting_plan(context: PlanningContext, strategy: Strategy, job: FieldJob) -> RefinedPlan:
    """The plan of a strategy; for one refined by simulation, the plan that waits least."""
    if strategy.refine is None:
        return build_for_headland_orders(strategy, job, context.request.headland_orders)
    return RefinedPlan(strategy.build_bound(job) if strategy.build_bound else remove_gates(strategy.build(job)))
