"""The answer of a ranking, worded once: what to do, how sure that is, why, what else there is, what is wrong with it.

Screens, explanations, pages and JSON lay its sentences out. Times and costs are the stated ones of
`reports.common.plan_results`.
"""

from __future__ import annotations

from dataclasses import dataclass

from reports.common.language import mark_text, translate, translate_count, translate_sentence
from reports.common.plan_results import MODEL_ERROR_SHARE, PlanRanking, PlanResult
from reports.common.wording import (
    HEADLAND_ORDERS,
    LEAST_COST,
    capitalize_first,
    format_area,
    format_assumed_money,
    format_deadline,
    format_duration,
    format_money,
    format_money_per_area,
    format_number,
    format_percent,
    format_time_span,
    has_start_time,
    join_list,
)
from reports.plan.other_plans import (
    describe_alternatives,
    describe_deadline,
    describe_rule,
    format_stated_end,
    list_extremes,
    name_plan,
)
from reports.plan.plan_wording import (
    count_service_stops,
    describe_finishing,
    describe_largest_piece,
    describe_left_out,
    describe_part,
    describe_physics,
    describe_share,
    format_energy,
    format_unworked,
    format_wide_interval,
    get_spoilt_m2,
)
from reports.plan.shortfall_wording import explain_no_plan, list_shortfall_sentences, question_pull

REQUIRED_ORDERS = {
    "sow": mark_text("headland last (as sowing asks)"),
    "mow": mark_text("headland first (as mowing asks)"),
    "harvest": mark_text("headland first (as harvesting asks)"),
}
"""The order of the headland by the operation that allows no other."""
UNCOUNTED_STOPS = {
    "sow": mark_text("filling not counted"),
    "spray": mark_text("filling not counted"),
    "harvest": mark_text("unloading not counted"),
}
"""What is left out of the time of operations with a load, where the implement tells none."""
DOSED_OPERATIONS = ("sow", "spray")  # what is worked twice gets twice as much


@dataclass(frozen=True)
class Answer:
    """What a ranking says in sentences: each attribute is one or a few of them, "" where there is nothing to say.

    Attributes:
        verdict: that no plan works and why, or what the best lacks of what was asked for.
        decision: the plan to take, when it is done and what it costs; "" where its tractor cannot pull the implement.
        question: what of the request should be checked: whether the tractor can pull the implement.
        day: times of day that a reader may take for others: those of the next day, and the hours of a farm.
        work: how much of the field is worked, when its headland, and the end that is nearly sure.
        ground: the largest piece left and why.
        certainty: how sure that is, and what late ground may cost.
        rule: why so many tractors, where nothing but time and cost decides: what one more saves.
        alternatives: the other plans to take, with fewer and with more tractors.
        faults: what is wrong with the plan to take.
        details: how all that is made up, for explanations.
    """

    verdict: str = ""
    decision: str = ""
    question: str = ""
    day: str = ""
    work: str = ""
    ground: str = ""
    certainty: str = ""
    rule: str = ""
    alternatives: str = ""
    faults: tuple[str, ...] = ()
    details: tuple[str, ...] = ()

    @property
    def conditions(self) -> str:
        """When, how much and how sure, in one paragraph."""
        return " ".join(filter(None, (self.day, self.work, self.ground, self.certainty)))

    def list_sentences(self) -> list[str]:
        """All sentences but the details, the most important first."""
        conditions = (self.day, self.work, self.ground, self.certainty)
        texts = (self.verdict, self.decision, self.question, *conditions, self.rule, self.alternatives, *self.faults)
        return [text for text in texts if text]


def write_answer(ranking: PlanRanking) -> Answer:
    """The answer of a ranking."""
    best, question = ranking.best, question_pull(ranking.pull)
    if best is None:
        return Answer(explain_no_plan(ranking), question=question)
    verdict = " ".join(list_shortfall_sentences(ranking))
    if not ranking.eligible:  # a plan that no tractor can drive has no time and no price
        return Answer(verdict, details=tuple(describe_physics(ranking)))
    # As ``2 tractors, split-field: done 14:36, 119 EUR, 33 l``, without a full stop: it fits in a line.
    done = format_stated_end(ranking, best.stated_end_s)
    figures = [
        translate("done {time}", time=done) if has_start_time(ranking) else translate("done in {time}", time=done)
    ]
    figures += [] if best.stated_cost is None else [format_stated_cost(ranking, best)]
    figures += filter(None, [format_energy(best)])
    return Answer(
        verdict,
        translate("{plan}: {figures}", plan=name_plan(best), figures=", ".join(figures)),
        question,
        " ".join(map(translate_sentence, ranking.day_sentences)),
        _describe_work(ranking, best),
        describe_largest_piece(best)[0],
        _describe_certainty(ranking, best),
        describe_rule(ranking, best),
        describe_alternatives(ranking, best),
        tuple(_list_faults(ranking, best)),
        tuple(_list_details(ranking, best)),
    )


def format_stated_cost(ranking: PlanRanking, plan: PlanResult) -> str:
    """The stated cost of a plan with the currency, and that its prices are assumed where nobody gave them."""
    return format_assumed_money(format_money(plan.stated_cost, ranking.currency), ranking.prices_assumed)


def _describe_work(ranking: PlanRanking, plan: PlanResult) -> str:
    """``98.4 % worked (0.08 ha left: 12 min and 9 EUR of work, without ways there), headland last.``

    The rest of the ground is left out where it takes no more than the error of the model.
    """
    parts = []
    if plan.worked_pct is not None:
        rest = ""
        is_left, spoilt_m2 = format_unworked(plan) is not None, get_spoilt_m2(plan)
        if (is_left or spoilt_m2) and plan.finishing_s >= MODEL_ERROR_SHARE * (plan.time_s or 0.0):
            grounds = [translate("{area} left", area=format_area(plan.due_missed_m2))] if is_left else []
            grounds += [translate("{area} spoilt by wheels", area=format_area(spoilt_m2))] if spoilt_m2 else []
            rest = translate(
                " ({ground}: {time} and {money} of work, without ways there)",
                ground=join_list(grounds),
                time=format_time_span(plan.finishing_s),
                money=format_money(plan.finishing_cost, ranking.currency),
            )
        parts.append(describe_share(plan) + rest)
    scenario, overlap_pct = ranking.scenario, plan.overlap_pct or 0.0
    operation = str(scenario.get("operation"))
    if overlap_pct >= 5.0 and operation in DOSED_OPERATIONS:  # where it costs seed or product
        share = format_number(overlap_pct, 0)
        has_sections = scenario.get("sections", 1) > 1
        twice = translate("{share} % twice (less with --sections)", share=share)
        parts.append(translate("{share} % twice", share=share) if has_sections else twice)
    if plan.left_out_m2 is not None:
        parts.append(describe_left_out(plan.left_out_m2))
    if plan.headland_order is not None:  # the operation asks for it where it allows no other and nobody asked
        by_operation = None if scenario.get("headland_order") is not None else REQUIRED_ORDERS.get(operation)
        parts.append(translate(by_operation or HEADLAND_ORDERS[plan.headland_order]))
    if (late_s := plan.stated_late_end_s) is not None:
        late = format_stated_end(ranking, late_s)
        has_start = has_start_time(ranking)
        parts.append(
            translate("95 % sure by {late}", late=late) if has_start else translate("95 % sure in {late}", late=late)
        )
    if plan.refills is not None:
        parts.append(count_service_stops(ranking, plan.refills))
    elif operation in UNCOUNTED_STOPS:
        parts.append(translate(UNCOUNTED_STOPS[operation]))
    if plan.charges:
        parts.append(translate_count("{count} stop to charge", "{count} stops to charge", plan.charges))
    return f"{', '.join(parts)}." if parts else ""


def describe_limit(ranking: PlanRanking) -> str:
    """By when work is to be done: ``before 17:00 and the rain``; "" without a limit."""
    has_rain = ranking.scenario.get("rain") is not None
    if ranking.allowed_s is None:
        return translate("before the rain") if has_rain else ""
    if has_rain:
        return translate("before {deadline} and the rain", deadline=format_deadline(ranking))
    return translate("before {deadline}", deadline=format_deadline(ranking))


def _describe_certainty(ranking: PlanRanking, plan: PlanResult) -> str:
    if plan.p50_s is None:
        return ""
    if plan.finish_probability is None:
        samples = f"{ranking.samples or 0:,}"
        return translate("Median and 95 % of {samples} samples with late starts, stops, breakdowns.", samples=samples)
    limit = describe_limit(ranking)
    probability, interval = format_percent(plan.finish_probability), format_wide_interval(plan)
    share = translate("{share} %", share=probability)
    if interval is not None:
        low, high = interval
        share = translate("{share} % ({low} to {high} %)", share=probability, low=low, high=high)
    loss = max((plan.expected_cost or 0.0) - (plan.paid_cost or plan.expected_cost or 0.0), 0.0)  # on late ground
    if loss < LEAST_COST:
        return translate("Done {limit}: {share} sure; no ground is late.", limit=limit, share=share)
    values = {"limit": limit, "share": share, "loss": format_money(loss, ranking.currency)}
    if ranking.allowed_s is None:
        return translate("Done {limit}: {share} sure; the rain costs {loss} on average, included.", **values)
    rate = format_money_per_area(ranking.late_ground_per_ha, ranking.currency)
    return translate(
        "Done {limit}: {share} sure; the cost includes {loss} for the risk of late ground ({rate}).",
        rate=rate,
        **values,
    )


def _list_faults(ranking: PlanRanking, best: PlanResult) -> list[str]:
    """What is wrong with the plan to take, the worst first."""
    cut_off_m2 = sum(part.ground.m2 for part in ranking.parts) or ranking.cut_off_m2
    faults, area = [], format_area(cut_off_m2)
    if ranking.parts:
        faults.append(translate("{area} of the field are cut off and planned on their own.", area=area))
    elif cut_off_m2:
        faults.append(translate("Obstacles cut off {area}, which no plan works.", area=area))
    is_late = ranking.allowed_s is not None and best.stated_finished_end_s > ranking.allowed_s
    if best.meets_deadline and is_late and best.finished_s is not None:
        area = format_area(best.due_missed_m2)
        faults.append(
            translate("Finishing the missed {area} as well takes longer than the deadline allows.", area=area)
        )
    return faults + [f"{capitalize_first(translate_sentence(remark)).rstrip('.')}." for remark in best.remarks]


def _list_details(ranking: PlanRanking, best: PlanResult) -> list[str]:
    """How the answer is made up: money, the drive, ground left, who is in time, other plans, physics."""
    sentences = [] if ranking.samples is None else list(ranking.money_sentences)
    if best.p50_s is not None:
        text = translate(
            "Times are medians of the samples; without late starts, stops and breakdowns the best plan takes "
            "{undelayed}.",
            undelayed=format_duration(best.time_s),
        )
        sentences.append(text)
    drive = format_duration(best.stated_s)
    sentences.append(translate("It turns {turn} and is driven in {time}.", turn=best.turn, time=drive))
    _, place = describe_largest_piece(best)
    return [
        *sentences,
        *([place] if place else []),
        *describe_finishing(ranking, best),
        *describe_deadline(ranking, best),
        *map(describe_part, ranking.parts),
        *list_extremes(ranking, best),
        *describe_physics(ranking),
    ]
