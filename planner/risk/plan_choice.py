"""The choice between plans by an objective, and the advice: what fewer or more tractors would change.

Plans that differ by less than the errors of samples and model count as equal; then fewer tractors win. Plans are
compared with the ground that they leave finished as well, and described as they are driven.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fields.units import MINUTE_S
from planner.request.plan_request import CHEAPEST, FASTEST, LEAST_FUEL, SUREST
from reports.common.plan_results import MODEL_ERROR_SHARE, is_share_different
from reports.common.wording import LEAST_COST, format_price, format_price_change
from reports.plan.plan_wording import is_interval_wide

STANDARD_ERROR_FACTOR = 2.0  # two plans must differ by this many standard errors
ABOUT_EQUAL = " (about equal)"


@dataclass(frozen=True)
class PlanFigures:
    """The figures of a feasible plan: cost, times (s), and the probability of being in time (None: no limit).

    `paid` is the mean cost, `expected` adds late ground and has the standard error `expected_error`. The probability is
    from `samples` samples and has the 95 % `interval`. `finishing_s` and `finishing_cost` are what the unworked ground
    takes besides; `energy`, with that ground, is in litres, or with `is_electric` in kilowatt-hours, None where not
    known. `quality` is the key of `build_quality_key` for plans that take as long.
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
    interval: tuple[float, float] | None = None
    energy: float | None = None
    is_electric: bool = False
    finishing_s: float = 0.0
    finishing_cost: float = 0.0
    worked_pct: float | None = None
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


def choose_best_by_count(plans: Sequence[PlanFigures], objective: str = CHEAPEST) -> dict[int, PlanFigures]:
    """The best plan of every number of tractors, fewest first."""
    counts = sorted({plan.tractors for plan in plans})
    return {count: choose_best([plan for plan in plans if plan.tractors == count], objective) for count in counts}


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


def has_same_cost(plan: PlanFigures, reference: PlanFigures) -> bool:
    """Whether the expected costs of two plans are equal within their errors."""
    return _is_too_near(
        plan.ranked_cost, reference.ranked_cost, math.hypot(plan.expected_error, reference.expected_error)
    )


def has_indistinct_probability(plan: PlanFigures, reference: PlanFigures) -> bool:
    """Whether the samples are too few to tell the probabilities of two plans apart."""
    return abs((reference.probability or 0.0) - (plan.probability or 0.0)) <= _compute_sampling_tolerance(
        plan, reference
    )


def has_same_probability(plan: PlanFigures, reference: PlanFigures) -> bool:
    """Whether two plans are equally sure within the errors of samples and model."""
    return not is_clearly_less_sure(plan, reference) and not is_clearly_less_sure(reference, plan)


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


def write_advice(
    plans: Sequence[PlanFigures],
    limit_text: str = "",
    objective: str = CHEAPEST,
    chosen_key: tuple[str, int] | None = None,
    budget: float | None = None,
    currency: str = "",
) -> str:
    """The advice for feasible plans, "" without any: the chosen plan, then the best ones with fewer and more tractors.

    `limit_text` says when work must be done, such as "before 17:00"; `chosen_key` is the chosen plan (strategy,
    tractors) if known. The alternatives are given by their probability, or by their time with the objective fastest or
    without a limit, and by the difference of expected cost as printed; what is equal to the chosen plan in the
    objective says so. Example: "2 tractors: 97 % before 17:00, 128.90 EUR expected (120.10 EUR paid). 1 tractor: 61 %
    in time, -1.50 EUR (about equal). 3 tractors: 99 % in time, +9.40 EUR."
    """
    if not plans:
        return ""
    given_plan = next((plan for plan in plans if (plan.strategy, plan.tractors) == chosen_key), None)
    chosen, by_count = given_plan or choose_best(plans, objective), choose_best_by_count(plans, objective)
    previous_count = max((count for count in by_count if count < chosen.tractors), default=None)
    next_count = min((count for count in by_count if count > chosen.tractors), default=None)
    unit = f" {currency}" if currency else ""
    certainty, cost = _describe_certainty(chosen, limit_text, objective), _describe_cost(chosen, unit)
    sentences = [f"{_format_tractors(chosen.tractors)}: {certainty}, {cost}."]
    for alternative in (by_count[count] for count in (previous_count, next_count) if count is not None):
        changes = [_describe_alternative_plan(alternative, chosen, objective)]
        changes.append(_describe_cost_change(alternative, chosen, unit, mention_equal=objective == CHEAPEST))
        if budget is not None and alternative.paid > budget:
            changes.append("over the budget")
        if is_share_different(alternative.worked_pct, chosen.worked_pct):
            changes.append(f"{alternative.worked_pct:.1f} % worked")
        sentences.append(f"{_format_tractors(alternative.tractors)}: {', '.join(changes)}.")
    return " ".join(sentences)


def format_percent(share: float) -> str:
    """A probability in whole percent; only certain and impossible are rounded to 100 and 0 %."""
    if 0.995 <= share < 1.0:
        return "over 99 %"
    if 0.0 < share < 0.005:
        return "under 1 %"
    return f"{100.0 * share:.0f} %"


def format_hours(seconds: float) -> str:
    """A time to the minute."""
    minutes = round(seconds / MINUTE_S)
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"


def format_probability(plan: PlanFigures) -> str:
    """The probability of a plan: ``97 %``, or ``77 % (68 to 84 %)`` with its 95 % interval if samples are few."""
    share = format_percent(plan.probability or 0.0)
    if not is_interval_wide(plan.interval) or plan.interval is None:
        return share
    low, high = (f"{100.0 * end:.0f}" for end in plan.interval)
    return f"{share} ({low} to {high} %)"


def _format_tractors(count: int) -> str:
    return f"{count} tractor{'s' if count > 1 else ''}"


def _describe_certainty(plan: PlanFigures, limit_text: str, objective: str) -> str:
    median_text = f"median {format_hours(plan.p50_s)}"
    if plan.probability is None:
        return f"{median_text}, 95 % within {format_hours(plan.p95_s)}"
    probability_text = f"{format_probability(plan)} {limit_text or 'in time'}"
    return f"{median_text}, {probability_text}" if objective == FASTEST else probability_text


def _describe_cost(plan: PlanFigures, unit: str) -> str:
    """The expected cost, and what is paid of it if ground may be late."""
    if abs(plan.expected - plan.paid) < LEAST_COST:
        return f"{format_price(plan.expected)}{unit}"
    return f"{format_price(plan.expected)}{unit} expected ({format_price(plan.paid)}{unit} paid)"


def _describe_alternative_plan(plan: PlanFigures, chosen: PlanFigures, objective: str) -> str:
    """How an alternative does: its probability, its fuel, or its time with the objective fastest or without a limit."""
    if objective == LEAST_FUEL and plan.energy is not None and chosen.energy:
        name = "electricity" if plan.is_electric else "fuel"
        change_pct = round(100.0 * (plan.energy / chosen.energy - 1.0))
        if not change_pct:
            return f"as much {name}"
        equal_remark = ABOUT_EQUAL if _is_too_near(plan.energy, chosen.energy, 0.0) else ""
        return f"{abs(change_pct)} % {'more' if change_pct > 0 else 'less'} {name}{equal_remark}"
    if objective == FASTEST or plan.probability is None or chosen.probability is None:
        return _describe_time_change(plan, chosen, objective)
    if plan.probability == 0.0:
        return "too late"
    probability_text = f"{format_probability(plan)} in time"
    if is_interval_wide(plan.interval) and has_indistinct_probability(plan, chosen):
        return f"{probability_text} (no clear difference with {chosen.samples} samples)"
    return probability_text + (ABOUT_EQUAL if objective == SUREST and has_same_probability(plan, chosen) else "")


def _describe_time_change(plan: PlanFigures, chosen: PlanFigures, objective: str) -> str:
    """The change of the median time, or of the 95th percentile with the objective surest."""
    time_s, reference_s = (
        (plan.ranked_late_s, chosen.ranked_late_s) if objective == SUREST else (plan.ranked_s, chosen.ranked_s)
    )
    difference_s = time_s - reference_s
    if abs(difference_s) < 0.5 * MINUTE_S:
        return "equally fast"
    equal_remark = ABOUT_EQUAL if objective != CHEAPEST and is_same_time(time_s, reference_s) else ""
    return f"{format_hours(abs(difference_s))} {'slower' if difference_s > 0.0 else 'faster'}{equal_remark}"


def _describe_cost_change(plan: PlanFigures, chosen: PlanFigures, unit: str, *, mention_equal: bool) -> str:
    """The change of the expected cost, such as "+9.40 EUR"."""
    change = format_price_change(plan.expected, chosen.expected, plan.finishing_cost - chosen.finishing_cost)
    if change is None:
        return "same cost"
    equal_remark = ABOUT_EQUAL if mention_equal and has_same_cost(plan, chosen) else ""
    return f"{change}{unit}{equal_remark}"
