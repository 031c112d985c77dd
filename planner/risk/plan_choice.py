"""The choice between plans by an objective.

Plans that differ by less than the errors of samples and model count as equal; then fewer tractors win. Plans are
compared with the ground that they leave finished as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from planner.request.plan_request import CHEAPEST, FASTEST, LEAST_FUEL
from reports.common.plan_results import MODEL_ERROR_SHARE, PlanResult, build_quality_key

STANDARD_ERROR_FACTOR = 2.0  # two plans must differ by this many standard errors


def choose_best(plans: Sequence[PlanResult], objective: str = CHEAPEST, samples: int = 1) -> PlanResult:
    """The plan to take: of the plans equal to the best one, the one with the fewest tractors.

    All are feasible, and their probabilities are from so many `samples`. Cheapest means the lowest expected cost; of
    plans equal in cost, those clearly less sure than another are excluded. Surest means the highest probability, or
    without a limit the earliest 95th percentile. The objective fuel means the least energy as simulated; plans whose
    energy is not known are left out if that of others is. Of equal plans with as many tractors that take as long the
    one of better quality is taken.
    """
    if objective == CHEAPEST:
        equal = select_surest(
            _select_equally_good_plans(
                plans, lambda plan: plan.ranked_cost, lambda plan: plan.expected_cost_error or 0.0
            ),
            samples,
        )
    elif objective == FASTEST:
        equal = _select_equally_good_plans(plans, lambda plan: plan.ranked_s)
    elif objective == LEAST_FUEL:
        metered = [plan for plan in plans if _compute_finished_energy(plan) is not None] or plans
        equal = _select_equally_good_plans(metered, lambda plan: _compute_finished_energy(plan) or 0.0)
    elif any(plan.finish_probability is None for plan in plans):
        equal = _select_equally_good_plans(plans, _compute_ranked_late_s)
    else:
        equal = select_surest(plans, samples)
    preferred = min(equal, key=_build_preference_key)
    as_long = [
        plan
        for plan in equal
        if plan.tractors == preferred.tractors and is_same_time(plan.ranked_s, preferred.ranked_s)
    ]
    return min(as_long, key=lambda plan: (build_quality_key(plan), _build_preference_key(plan)))


def _compute_finished_energy(plan: PlanResult) -> float | None:
    """Litres or kilowatt-hours with the unworked ground finished at the plan's own rate; None where not known."""
    energy = plan.fuel_l if plan.energy_kwh is None else plan.energy_kwh
    return energy if energy is None or not plan.time_s else energy * (1.0 + plan.finishing_s / plan.time_s)


def _compute_ranked_late_s(plan: PlanResult) -> float:
    """The 95th percentile of the time, with the unworked ground finished."""
    return (plan.p95_s or 0.0) + plan.finishing_s


def select_surest(plans: Sequence[PlanResult], samples: int) -> list[PlanResult]:
    """Plans less sure than the surest by no more than the errors of samples and model; all plans without a limit."""
    if any(plan.finish_probability is None for plan in plans):
        return list(plans)
    top = max(plans, key=lambda plan: (plan.finish_probability or 0.0, _compute_sampling_error(plan, samples)))
    top_error = _compute_sampling_error(top, samples)

    def is_clearly_less_sure(plan: PlanResult) -> bool:
        tolerance = STANDARD_ERROR_FACTOR * math.hypot(_compute_sampling_error(plan, samples), top_error)
        return (top.finish_probability or 0.0) - (plan.finish_probability or 0.0) > tolerance + MODEL_ERROR_SHARE

    return [plan for plan in plans if not is_clearly_less_sure(plan)]


def _compute_sampling_error(plan: PlanResult, samples: int) -> float:
    """The standard error of the probability of a plan."""
    share = plan.finish_probability or 0.0
    return math.sqrt(share * (1.0 - share) / samples)


def is_same_time(time_s: float, reference_s: float) -> bool:
    """Whether two times are equal within the error of the model."""
    return abs(time_s - reference_s) <= MODEL_ERROR_SHARE * abs(min(time_s, reference_s))


def _select_equally_good_plans(
    plans: Sequence[PlanResult],
    get_value: Callable[[PlanResult], float],
    get_error: Callable[[PlanResult], float] = lambda _: 0.0,
) -> list[PlanResult]:
    """Plans whose value exceeds the lowest by no more than the errors of samples and model."""
    best_plan = min(plans, key=lambda plan: (get_value(plan), -get_error(plan)))
    least, least_error = get_value(best_plan), get_error(best_plan)

    def compute_tolerance(plan: PlanResult) -> float:
        return STANDARD_ERROR_FACTOR * math.hypot(get_error(plan), least_error) + MODEL_ERROR_SHARE * abs(least)

    return [plan for plan in plans if get_value(plan) - least <= compute_tolerance(plan)]


def _build_preference_key(plan: PlanResult) -> tuple[int, float, float, float, float, float, str]:
    """Fewer tractors, then lower cost, earlier finish, higher probability; the rest breaks ties."""
    return (
        plan.tractors,
        round(plan.ranked_cost, 2),
        round(plan.ranked_s, 1),
        -round(plan.finish_probability or 0.0, 6),
        round(_compute_ranked_late_s(plan), 1),
        round(plan.paid_cost or 0.0, 2),
        plan.strategy,
    )
