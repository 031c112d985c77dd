"""The choice between plans by an objective.

Plans that differ by less than the errors of samples and model count as equal; then fewer tractors win. Plans are
compared with the ground that they leave finished as well.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from planner.request.plan_request import CHEAPEST, FASTEST, LEAST_FUEL
from reports.common.plan_results import MODEL_ERROR_SHARE

STANDARD_ERROR_FACTOR = 2.0  # two plans must differ by this many standard errors


@dataclass(frozen=True)
class PlanFigures:
    """The figures of a feasible plan: cost, times (s), and the probability of being in time (None: no limit).

    `paid` is the mean cost, `expected` adds late ground and has the standard error `expected_error`. The probability is
    from `samples` samples. `finishing_s` and `finishing_cost` are what the unworked ground takes besides; `energy`,
    with that ground, is in litres or kilowatt-hours, None where not known. `quality` is the key of `build_quality_key`
    for plans that take as long.
    """

    strategy: str
    tractors: int
    paid: float
    expected: float
    p50_s: float
    p95_s: float
    probability: float | None = None
    samples: int = 1
    expected_error: float = 0.0
    energy: float | None = None
    finishing_s: float = 0.0
    finishing_cost: float = 0.0
    quality: tuple[float, ...] = ()

    @property
    def ranked_s(self) -> float:
        """The median time with the unworked ground finished."""
        return self.p50_s + self.finishing_s

    @property
    def ranked_late_s(self) -> float:
        """The 95th percentile of the time, with the unworked ground finished."""
        return self.p95_s + self.finishing_s

    @property
    def ranked_cost(self) -> float:
        """The expected cost with the unworked ground finished."""
        return self.expected + self.finishing_cost

    @property
    def _probability_error(self) -> float:
        share = self.probability or 0.0
        return math.sqrt(share * (1.0 - share) / self.samples)


def choose_best(plans: Sequence[PlanFigures], objective: str = CHEAPEST) -> PlanFigures:
    """The plan to take: of the plans equal to the best one, the one with the fewest tractors.

    Cheapest means the lowest expected cost; of plans equal in cost, those clearly less sure than another are excluded.
    Surest means the highest probability, or without a limit the earliest 95th percentile. The objective fuel means the
    least energy as simulated; plans whose energy is not known are left out if that of others is. Of equal plans with
    as many tractors that take as long the one of better `quality` is taken.
    """
    if objective == CHEAPEST:
        equal = select_surest(
            _select_equally_good_plans(plans, lambda plan: plan.ranked_cost, lambda plan: plan.expected_error)
        )
    elif objective == FASTEST:
        equal = _select_equally_good_plans(plans, lambda plan: plan.ranked_s, lambda plan: 0.0)
    elif objective == LEAST_FUEL:
        metered = [plan for plan in plans if plan.energy is not None] or plans
        equal = _select_equally_good_plans(metered, lambda plan: plan.energy or 0.0, lambda plan: 0.0)
    elif any(plan.probability is None for plan in plans):
        equal = _select_equally_good_plans(plans, lambda plan: plan.ranked_late_s, lambda plan: 0.0)
    else:
        equal = select_surest(plans)
    preferred = min(equal, key=_build_preference_key)
    as_long = [
        plan
        for plan in equal
        if plan.tractors == preferred.tractors and is_same_time(plan.ranked_s, preferred.ranked_s)
    ]
    return min(as_long, key=lambda plan: (plan.quality, _build_preference_key(plan)))


def select_surest(plans: Sequence[PlanFigures]) -> list[PlanFigures]:
    """Plans not clearly less sure than the surest; all plans without a limit."""
    if any(plan.probability is None for plan in plans):
        return list(plans)
    top = max(plans, key=lambda plan: (plan.probability or 0.0, plan._probability_error))
    return [plan for plan in plans if not is_clearly_less_sure(plan, top)]


def is_clearly_less_sure(plan: PlanFigures, reference: PlanFigures) -> bool:
    """Whether a plan is less sure than another by more than the errors of samples and model."""
    return (reference.probability or 0.0) - (plan.probability or 0.0) > _compute_sampling_tolerance(
        plan, reference
    ) + MODEL_ERROR_SHARE


def is_same_time(time_s: float, reference_s: float) -> bool:
    """Whether two times are equal within the error of the model."""
    return _is_too_near(time_s, reference_s, 0.0)


def _compute_sampling_tolerance(plan: PlanFigures, reference: PlanFigures) -> float:
    """How far two probabilities may differ by chance."""
    return STANDARD_ERROR_FACTOR * math.hypot(plan._probability_error, reference._probability_error)


def _is_too_near(value: float, reference: float, error: float) -> bool:
    return abs(value - reference) <= STANDARD_ERROR_FACTOR * error + MODEL_ERROR_SHARE * abs(min(value, reference))


def _select_equally_good_plans(
    plans: Sequence[PlanFigures], get_value: Callable[[PlanFigures], float], get_error: Callable[[PlanFigures], float]
) -> list[PlanFigures]:
    """Plans whose value exceeds the lowest by no more than the errors of samples and model."""
    best_plan = min(plans, key=lambda plan: (get_value(plan), -get_error(plan)))

    def compute_tolerance(plan: PlanFigures) -> float:
        return STANDARD_ERROR_FACTOR * math.hypot(get_error(plan), get_error(best_plan)) + MODEL_ERROR_SHARE * abs(
            get_value(best_plan)
        )

    return [plan for plan in plans if get_value(plan) - get_value(best_plan) <= compute_tolerance(plan)]


def _build_preference_key(plan: PlanFigures) -> tuple[int, float, float, float, float, float, str, str]:
    """Fewer tractors, then lower cost, earlier finish, higher probability; the rest breaks ties.

    The last item holds every figure in full, so that plans that only rounding makes equal keep an order of their own.
    """
    return (
        plan.tractors,
        round(plan.ranked_cost, 2),
        round(plan.ranked_s, 1),
        -round(plan.probability or 0.0, 6),
        round(plan.ranked_late_s, 1),
        round(plan.paid, 2),
        plan.strategy,
        repr(plan),
    )
