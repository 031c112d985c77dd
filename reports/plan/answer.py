"""The answer of a ranking in five lines: what to do, how sure that is, what else there is, and what is wrong with it.

Times and costs are the stated ones of `reports.common.plan_results`, so that every report says the same.
"""

from __future__ import annotations

from dataclasses import dataclass

from reports.common.language import mark_text, translate, translate_count, translate_sentence
from reports.common.plan_results import MODEL_ERROR_SHARE, PlanRanking, PlanResult, is_share_different
from reports.common.wording import (
    HEADLAND_ORDERS,
    LEAST_COST,
    SURE_SHARE,
    capitalize_first,
    format_area,
    format_assumed_money,
    format_deadline,
    format_duration,
    format_end_clock,
    format_money,
    format_money_per_area,
    format_number,
    format_percent,
    format_price_change,
    format_time_span,
    format_tractor_count,
    has_start_time,
    join_list,
)
from reports.plan.plan_wording import (
    count_service_stops,
    describe_left_out,
    format_energy,
    format_unworked,
    format_wide_interval,
    get_spoilt_m2,
    name_fleet,
)
from reports.plan.shortfall_wording import explain_no_plan, list_shortfall_sentences, question_pull

LEAST_SPAN_S = 1.0  # less time is none
NEXT_TRACTORS = (
    mark_text("a second"), mark_text("a third"), mark_text("a fourth"), mark_text("a fifth"), mark_text("a sixth"),
    mark_text("a seventh"), mark_text("an eighth"), mark_text("a ninth"), mark_text("a tenth"),
)  # fmt: skip
"""What one more tractor is, from the second on."""
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
    """What a ranking says in sentences: each attribute is one of them, "" where there is nothing to say.

    Attributes:
        verdict: that no plan works and why, or what the best lacks of what was asked for.
        decision: the plan to take, when it is done and what it costs.
        work: how much of the field is worked, when its headland, and the end that is nearly sure.
        certainty: how sure that is, and what late ground may cost.
        alternatives: the plans with fewer and with more tractors, the latter as what one more tractor saves where that
            decides their number.
        counting: that time alone decides their number, where the assumed prices would take another.
        faults: what is wrong with the plan to take.
        question: what of the request should be checked: whether the tractor can pull the implement.
    """

    verdict: str
    decision: str
    work: str = ""
    certainty: str = ""
    alternatives: str = ""
    counting: str = ""
    faults: tuple[str, ...] = ()
    question: str = ""

    def list_sentences(self) -> list[str]:
        """All sentences, the most important first."""
        first = (self.verdict, self.decision, self.question, self.work, self.certainty)
        return [text for text in (*first, self.alternatives, self.counting, *self.faults) if text]


def write_answer(ranking: PlanRanking) -> Answer:
    """The answer of a ranking."""
    best, question = ranking.best, question_pull(ranking.pull)
    if best is None:
        return Answer(explain_no_plan(ranking), "", question=question)
    verdict = list_shortfall_sentences(ranking)
    # As ``2 tractors, split-field: done 14:36, 119 EUR, 33 l``, without a full stop: it fits in a line.
    done = format_stated_end(ranking, best.stated_end_s)
    has_start = has_start_time(ranking)
    figures = [translate("done {time}", time=done) if has_start else translate("done in {time}", time=done)]
    figures += [] if best.stated_cost is None else [format_stated_cost(ranking, best)]
    figures += filter(None, [format_energy(best)])
    counting = ""
    if ranking.priced_tractors is not None:
        count = format_tractor_count(ranking.priced_tractors)
        counting = translate(
            "By time alone; by the assumed price it would be {tractors} (--price-per-hour).", tractors=count
        )
    return Answer(
        " ".join(verdict),
        translate("{plan}: {figures}", plan=name_plan(best), figures=", ".join(figures)),
        _describe_work(ranking, best),
        _describe_certainty(ranking, best),
        _describe_alternatives(ranking, best),
        counting,
        tuple(_list_faults(ranking, best)),
        "" if question in verdict else question,
    )


def format_stated_end(ranking: PlanRanking, seconds: float | None) -> str:
    """When field work ends: the clock time, up to the minute; without a start how long it takes."""
    if seconds is None or not has_start_time(ranking):
        return format_duration(seconds)
    return format_end_clock(ranking, seconds) or format_duration(seconds)


def format_stated_cost(ranking: PlanRanking, plan: PlanResult) -> str:
    """The stated cost of a plan with the currency, and that its prices are assumed where nobody gave them."""
    return format_assumed_money(format_money(plan.stated_cost, ranking.currency), ranking.prices_assumed)


def name_plan(plan: PlanResult) -> str:
    """``2 tractors, split-field``; ``1 tractor``, as strategies say how several share a field."""
    if plan.tractors == 1:
        return name_fleet(plan)
    return translate("{tractors}, {strategy}", tractors=name_fleet(plan), strategy=plan.strategy)


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
        parts.append(_describe_share(plan) + rest)
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


def _describe_share(plan: PlanResult) -> str:
    return translate("{share} % worked", share=format_number(plan.worked_pct, 1))


def _describe_certainty(ranking: PlanRanking, plan: PlanResult) -> str:
    if plan.p50_s is None:
        return ""
    if plan.finish_probability is None:
        samples = f"{ranking.samples or 0:,}"
        return translate("Median and 95 % of {samples} samples with late starts, stops, breakdowns.", samples=samples)
    limit = translate("before the rain")
    if ranking.allowed_s is not None:
        limit = translate("before {deadline}", deadline=format_deadline(ranking))
        if ranking.scenario.get("rain") is not None:
            limit = translate("before {deadline} and the rain", deadline=format_deadline(ranking))
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


def _describe_alternatives(ranking: PlanRanking, best: PlanResult) -> str:
    """The plans to take with the next smaller and the next larger number of tractors."""
    others, sentences = ranking.neighbours, []
    if others and ranking.has_knee and others[-1].tractors > best.tractors:
        sentences.append(_describe_next(ranking, others.pop(), best))
    alternatives = []
    for plan in others:
        figures, sureness = [format_stated_end(ranking, plan.stated_end_s)], plan.finish_probability
        if sureness is not None and min(sureness, best.finish_probability or 0.0) < SURE_SHARE:
            figures.append(translate("{share} % sure", share=format_percent(sureness)))
        change = _compute_cost_change(plan, best)
        if change is None:
            figures.append(translate("same cost"))
        elif change.startswith("-"):  # a minus alone would be read as a dash
            figures.append(translate("{money} cheaper", money=_add_currency(ranking, change[1:])))
        else:
            figures.append(_add_currency(ranking, change))
        if is_share_different(plan.worked_pct, best.worked_pct):
            figures.append(_describe_share(plan))
        name = format_tractor_count(plan.tractors)
        alternatives.append(translate("{plan}: {figures}", plan=name, figures=", ".join(figures)))
    if alternatives:
        sentences.append(translate("Or {alternatives}.", alternatives="; ".join(alternatives)))
    return " ".join(sentences)


def _describe_next(ranking: PlanRanking, plan: PlanResult, best: PlanResult) -> str:
    """What more tractors than the recommended ones would save: ``3 tractors; a fourth saves 4 min for 9 EUR.``"""
    count = plan.tractors
    is_named = count == best.tractors + 1 and count < len(NEXT_TRACTORS) + 2
    more = translate(NEXT_TRACTORS[count - 2]) if is_named else translate("a fleet of {count}", count=count)
    saved_s = best.stated_finished_end_s - plan.stated_finished_end_s
    change = _compute_cost_change(plan, best)
    values = {"tractors": format_tractor_count(best.tractors), "more": more, "worked": ""}
    if is_share_different(plan.worked_pct, best.worked_pct):
        values["worked"] = f", {_describe_share(plan)}"
    if saved_s < LEAST_SPAN_S:
        return translate("{tractors}; {more} saves no time{worked}.", **values)
    values["time"] = format_time_span(saved_s)
    if change is None:
        return translate("{tractors}; {more} saves {time} at the same cost{worked}.", **values)
    values["money"] = _add_currency(ranking, change[1:])
    if change.startswith("-"):
        return translate("{tractors}; {more} saves {time} and {money}{worked}.", **values)
    return translate("{tractors}; {more} saves {time} for {money}{worked}.", **values)


def _compute_cost_change(plan: PlanResult, best: PlanResult) -> str | None:
    """The difference as printed, with its sign; None where it is none or not known."""
    more_ground = plan.finishing_cost - best.finishing_cost
    return format_price_change(plan.stated_cost, best.stated_cost, more_ground)


def _add_currency(ranking: PlanRanking, money: str) -> str:
    return money if ranking.currency is None else f"{money} {ranking.currency}"


def _list_faults(ranking: PlanRanking, best: PlanResult) -> list[str]:
    """What is wrong with the plan to take, the worst first."""
    cut_off_m2 = sum(part.ground.m2 for part in ranking.parts) or ranking.cut_off_m2
    faults, area = [], format_area(cut_off_m2)
    if ranking.parts:
        faults.append(translate("{area} of the field are cut off and planned on their own.", area=area))
    elif cut_off_m2:
        faults.append(translate("Obstacles cut off {area}, which no plan works.", area=area))
    is_late = ranking.allowed_s is not None and best.stated_finished_end_s > ranking.allowed_s
    if best.meets_deadline and is_late and best.finished_done_s is not None:
        area = format_area(best.due_missed_m2)
        faults.append(
            translate("Finishing the missed {area} as well takes longer than the deadline allows.", area=area)
        )
    return faults + [f"{capitalize_first(translate_sentence(remark)).rstrip('.')}." for remark in best.remarks]
