"""How sure a simulated plan is and what it costs, in the figures of its result; and which plan is advised."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from planner.chance.answer import DRAWS, Question, answer
from planner.chance.physics import Check, check
from planner.chance.planned_order import in_planned_order
from planner.chance.rain import Rain, parse_rain
from planner.chance.settings import Chances
from planner.price.advice import advice, percent
from planner.price.choice import Figures, best
from planner.price.cost import Terms, account, cost, hired
from planner.scenario import CHEAPEST, FASTEST, Scenario
from planner.workday import Workday
from reports.results import PlanResult, Ranking, done_s
from reports.wording import duration, late_counts, price
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor

LEAST_CHANCE = 0.005  # less is no plan that meets what is asked


@dataclass(frozen=True)
class Stakes:
    """What is asked of every plan beyond being driven: draws and their laws, money, and what is preferred.

    `limit` are the words for when work must be done, as "before 17:00", "" without a limit. Only where the plans are
    compared by a limit or a preference it `decides` which one is the best. `budget` is the most that may be paid.
    """

    question: Question
    terms: Terms
    limit: str
    prefer: str
    decides: bool
    budget: float | None = None


def stakes_of(
    scenario: Scenario, chances: Chances | None = None, terms: Terms | None = None, day: Workday | None = None
) -> Stakes | None:
    """The stakes of a scenario; None where neither draws nor a limit nor a preference is asked for.

    Without `terms` tractors are hired at the prices of the scenario. Raises ScenarioError for rain that cannot be read.
    """
    draws = scenario.draws
    if draws is None:
        asked = (scenario.before_s, scenario.rain, scenario.prefer, scenario.budget)
        draws = 0 if all(each is None for each in asked) else DRAWS
    if draws == 0:
        return None
    rain = None if scenario.rain is None else parse_rain(scenario.rain, scenario.start_s)
    question = Question(chances or Chances(), rain, scenario.allowed_s, draws, scenario.seed, day)
    own = terms or hired(scenario.price_per_hour, scenario.price_per_tractor)
    limit = _limit(scenario, question)
    decides = bool(limit) or scenario.prefer is not None or scenario.budget is not None
    return Stakes(question, own, limit, scenario.prefer or CHEAPEST, decides, scenario.budget)


def _limit(scenario: Scenario, question: Question) -> str:
    """When work must be done, in words."""
    words = [] if scenario.before_s is None else [f"before {scenario.told(scenario.allowed_s)}"]
    rain = question.rain
    if rain is not None and scenario.start_s is not None and len(rain.onset_s) == 1 and sum(rain.shares) == 1.0:
        words.append(f"before {scenario.told(rain.onset_s[0])}")
    elif rain is not None:
        words.append("before the rain")
    return " and ".join(dict.fromkeys(words))


def with_outlook(
    result: PlanResult, run: Run, tractor: Tractor, implement: Implement, area_ha: float, stakes: Stakes | None
) -> PlanResult:
    """The result of a feasible plan with its probability, the quantiles of its time and its expected cost."""
    if stakes is None or not result.feasible:
        return result
    found = answer(in_planned_order(run, tractor, implement), stakes.question, drivers=False)
    money = cost(found.sample, stakes.terms, area_ha)
    return replace(
        result,
        finish_probability=found.finish_probability,
        finish_probability_interval=found.finish_probability_interval,
        p50_s=found.p50_s,
        p80_s=found.p80_s,
        p95_s=found.p95_s,
        expected_cost=money.expected,
        expected_cost_error=money.expected_error,
        paid_cost=money.paid,
    )


def advised(ranking: Ranking, stakes: Stakes | None) -> Ranking:
    """The ranking with the sentence of advice and the plan that it advises.

    Where a plan meets the deadline as simulated, those that do not are left out; where none does the closest remains.
    So with the rain, and with the budget: then the ranking says what no plan meets.
    """
    if stakes is None:
        return ranking
    plans = [plan for plan in ranking.plans if plan.expected_cost is not None]
    in_time = [plan for plan in plans if plan.meets_deadline is not False]
    chosen = unmet = None
    prefer = FASTEST  # where nothing decides, and where none is in time
    if in_time and stakes.decides:
        kept, unmet, prefer = _within(in_time, plans, stakes)
        found = best(_figures(kept, stakes), prefer)
        chosen = found.strategy, found.tractors
    currency, draws = stakes.terms.prices.currency, stakes.question.draws
    told = replace(ranking, currency=currency, draws=draws, chosen=chosen, unmet=unmet)
    best_of_all = told.best
    taken = None if best_of_all is None else (best_of_all.strategy, best_of_all.tractors)
    figures = _figures(plans, stakes)
    if unmet is not None and prefer == CHEAPEST:  # a budget is of what is paid
        figures = [replace(one, expected=one.paid) for one in figures]
    words = advice(figures, stakes.limit, prefer, taken, stakes.budget)
    return replace(told, advice=words or None, money=(_money_words(stakes, late_counts(told)),))


def _money_words(stakes: Stakes, late: bool) -> str:
    """What the money of the advice is, a sentence."""
    prices, draws = stakes.terms.prices, f"the mean of {stakes.question.draws:,} draws"
    paid = f"Money is in {prices.currency}, in {draws}: {'paid is ' if late else ''}{account(prices)}"
    per_ha = price(prices.late_per_ha + prices.seed_per_ha)
    return f"{paid}; expected adds {per_ha} for each hectare not done {stakes.limit}." if late else f"{paid}."


def _within(
    plans: list[PlanResult], every: list[PlanResult], stakes: Stakes
) -> tuple[list[PlanResult], str | None, str]:
    """The plans in time that may be taken, what none of them meets in a sentence, and what to choose them by."""
    dry, told = _before_rain(plans, stakes.question.rain)
    if told is not None:
        return plans, told, FASTEST
    budget = stakes.budget
    paid, all_paid = ([one for one in plans if _paid(one, budget)] for plans in (dry, every))
    if paid or budget is None:
        return paid, None, stakes.prefer
    least, unit = min(plan.paid_cost or 0.0 for plan in dry), stakes.terms.prices.currency
    cheapest = [plan for plan in dry if plan.paid_cost == least]
    which = "No plan that is done in time" if all_paid else "No plan"
    late = not all_paid and min(plan.paid_cost or 0.0 for plan in every) < least
    closest = "the closest that is done in time" if late else "the closest"
    told = f"{which} can be paid with {price(budget)} {unit}; {closest} comes to {price(least)} {unit}."
    return cheapest, told, CHEAPEST


def _paid(plan: PlanResult, budget: float | None) -> bool:
    return budget is None or (plan.paid_cost or 0.0) <= budget


def _before_rain(plans: list[PlanResult], rain: Rain | None) -> tuple[list[PlanResult], str | None]:
    """The plans that may be done before it rains; where none may, a sentence that says so."""
    if rain is None:
        return plans, None
    if len(rain.onset_s) == 1 and sum(rain.shares) == 1.0:
        dry = [plan for plan in plans if done_s(plan) <= rain.onset_s[0]]
        late_s = min(done_s(plan) for plan in plans) - rain.onset_s[0]
        return dry, None if dry else f"No plan is done before the rain; the closest misses it by {duration(late_s)}."
    surest = max(plan.finish_probability or 0.0 for plan in plans)
    if surest >= LEAST_CHANCE:
        return plans, None
    return [], f"No plan is done before the rain: the surest one is in {percent(surest)} of the draws."


def _figures(plans: Iterable[PlanResult], stakes: Stakes) -> list[Figures]:
    return [
        Figures(
            plan.strategy, plan.tractors, plan.paid_cost or 0.0, plan.expected_cost or 0.0, plan.p50_s or 0.0,
            plan.p95_s or 0.0, plan.finish_probability, stakes.question.draws, plan.expected_cost_error or 0.0,
            plan.finish_probability_interval,
        )
        for plan in plans
    ]  # fmt: skip


def bearing_out(run: Run, tractor: Tractor, implement: Implement, stakes: Stakes) -> tuple[Check, dict[str, float]]:
    """Some draws of a plan driven in full physics, and what drives the spread of its time."""
    kept = in_planned_order(run, tractor, implement)
    question = stakes.question
    drives = check(kept, question.chances, tractor, implement, seed=question.seed)
    return drives, answer(kept, replace(question, draws=min(question.draws, 2000))).drivers


def check_words(found: Check, drivers: dict[str, float]) -> tuple[str, ...]:
    """What the check and the drivers say, a sentence each."""
    count = len(found.driven_s)
    told = f"{count - found.meetings - found.stalls} of {count} draws driven in full physics"
    if found.error == found.error:
        told += f" end {100.0 * found.error:.1f} % from their drawn times on average"
    else:
        told += " could be compared"
    for number, words in ((found.meetings, "tractors meet"), (found.stalls, "somebody does not get on")):
        told += f"; in {number} {words}" if number else ""
    spread = [f"{name} ({100.0 * share:.0f} %)" for name, share in drivers.items() if share >= 0.01][:3]
    words = f"What makes the time uncertain, by its share of the variance: {', '.join(spread)}."
    return f"{told}.", *([words] if spread else [])
