"""Which candidates are simulated first, and the plans that others have to beat.

One strategy whose tractors have swaths of their own is simulated first, with every number of tractors. Another plan
with as many tractors is not driven if it takes longer even when nobody waits, as it would be ranked behind.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.candidates.pruning import Incumbent
from planner.evaluation.context import PlanningContext
from planner.request.plan_request import LEAST_FUEL, SUREST
from reports.common.plan_results import PlanResult, get_finished_field_s
from strategies.registry import STRATEGIES

MIN_SWATH_WORK_S = 900.0  # of work on swaths: on smaller fields every plan is simulated, as that is quick
MIN_TOTAL_WORK_S = 1800.0  # or of work on swaths and headland passes


def order_candidates(context: PlanningContext, todo: Sequence[Candidate]) -> list[list[int]]:
    """Numbers of the candidates in the order they are simulated: one strategy, and one tractor, before the others.

    It is the first requested strategy of the registry whose tractors have swaths of their own. There is only one wave
    on small fields, and if the surest plan or that of least fuel is requested: a slower plan may be that.
    """
    simulates_all = context.criteria is not None and context.criteria.objective in (SUREST, LEAST_FUEL)
    if simulates_all or not is_worth_pruning(context):
        return [list(range(len(todo)))]
    strategies = {one.strategy for one in todo}
    first = next((name for name in STRATEGIES if name in strategies and STRATEGIES[name].deal is not None), None)
    comes_first = [one.strategy == first or one.tractors == 1 for one in todo]
    parts = [[number for number, is_early in enumerate(comes_first) if is_early is early] for early in (True, False)]
    return [part for part in parts if part]


def group_candidates(candidates: Sequence[Candidate]) -> list[list[int]]:
    """Numbers of the candidates of each task: formations of as many tractors, which share most work, or one other."""
    groups: dict[tuple[str, int], list[int]] = {}
    for number, one in enumerate(candidates):
        strategy = STRATEGIES.get(one.strategy)
        forms = strategy is not None and strategy.formation is not None and one.tractors > 1
        groups.setdefault(("", one.tractors) if forms else (one.strategy, number), []).append(number)
    return list(groups.values())


def is_worth_pruning(context: PlanningContext) -> bool:
    """Whether the work is long enough that driving less saves much."""
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
