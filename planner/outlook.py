"""How sure a simulated plan is and what it costs, in the figures of its result; and which plan is advised."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

from planner.chance.answer import DRAWS, Question, answer
from planner.chance.physics import Check, check
from planner.chance.planned_order import in_planned_order
from planner.chance.rain import parse_rain
from planner.chance.settings import Chances
from planner.price.advice import advice
from planner.price.choice import Figures, best
from planner.price.cost import Terms, cost, hired
from planner.scenario import CHEAPEST, Scenario
from planner.workday import Workday
from reports.results import PlanResult, Ranking
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor


@dataclass(frozen=True)
class Stakes:
    """What is asked of every plan beyond being driven: draws and their laws, money, and what is preferred.

    `limit` are the words for when work must be done, as "before 17:00", "" without a limit. Only where the plans are
    compared by a limit or a preference it `decides` which one is the best.
    """

    question: Question
    terms: Terms
    limit: str
    prefer: str
    decides: bool


def stakes_of(
    scenario: Scenario, chances: Chances | None = None, terms: Terms | None = None, day: Workday | None = None
) -> Stakes | None:
    """The stakes of a scenario; None where neither draws nor a limit nor a preference is asked for.

    Without `terms` tractors are hired at the prices of the scenario. Raises ScenarioError for rain that cannot be read.
    """
    draws = scenario.draws
    if draws is None:
        asked = scenario.before_s is not None or scenario.rain is not None or scenario.prefer is not None
        draws = DRAWS if asked else 0
    if draws == 0:
        return None
    rain = None if scenario.rain is None else parse_rain(scenario.rain, scenario.start_s)
    question = Question(chances or Chances(), rain, scenario.allowed_s, draws, scenario.seed, day)
    own = terms or hired(scenario.price_per_hour, scenario.price_per_tractor)
    limit = _limit(scenario, question)
    return Stakes(question, own, limit, scenario.prefer or CHEAPEST, bool(limit) or scenario.prefer is not None)


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
    """
    if stakes is None:
        return ranking
    plans = [plan for plan in ranking.plans if plan.expected_cost is not None]
    in_time = [plan for plan in plans if plan.meets_deadline is not False]
    chosen = None
    if in_time and stakes.decides:
        found = best(_figures(in_time, stakes), stakes.prefer)
        chosen = found.strategy, found.tractors
    told = replace(ranking, currency=stakes.terms.prices.currency, draws=stakes.question.draws, chosen=chosen)
    best_of_all = told.best
    taken = None if best_of_all is None else (best_of_all.strategy, best_of_all.tractors)
    return replace(told, advice=advice(_figures(plans, stakes), stakes.limit, stakes.prefer, taken) or None)


def _figures(plans: Iterable[PlanResult], stakes: Stakes) -> list[Figures]:
    return [
        Figures(
            plan.strategy, plan.tractors, plan.paid_cost or 0.0, plan.expected_cost or 0.0, plan.p50_s or 0.0,
            plan.p95_s or 0.0, plan.finish_probability, stakes.question.draws, plan.expected_cost_error or 0.0,
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
        told += f" end {100.0 * found.error:.1f} % from their drawn times in the mean"
    else:
        told += " could be compared"
    for number, words in ((found.meetings, "tractors meet"), (found.stalls, "somebody does not get on")):
        told += f"; in {number} {words}" if number else ""
    spread = [f"{name} {100.0 * share:.0f} %" for name, share in drivers.items() if share >= 0.01][:3]
    return (f"{told}.", *([f"What spreads the time: {', '.join(spread)} of its variance."] if spread else []))
