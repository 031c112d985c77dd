"""The plans beside the recommended one in sentences: what one more tractor saves, what else can be taken, who is in
time, and which is fastest and cheapest."""

from __future__ import annotations

from reports.common.language import mark_text, translate
from reports.common.plan_results import (
    PlanRanking,
    PlanResult,
    choose_plan,
    find_least_saving_s,
    is_dearer,
    is_share_different,
)
from reports.common.wording import (
    SURE_SHARE,
    format_deadline,
    format_duration,
    format_end_clock,
    format_percent,
    format_price_change,
    format_time_span,
    format_tractor_count,
    has_start_time,
    join_list,
)
from reports.plan.plan_wording import describe_share, name_fleet

LEAST_SPAN_S = 1.0  # less time is none
NEXT_TRACTORS = (
    mark_text("a second"), mark_text("a third"), mark_text("a fourth"), mark_text("a fifth"), mark_text("a sixth"),
    mark_text("a seventh"), mark_text("an eighth"), mark_text("a ninth"), mark_text("a tenth"),
)  # fmt: skip
"""What one more tractor is, from the second on."""


def format_stated_end(ranking: PlanRanking, seconds: float | None) -> str:
    """When field work ends: the clock time, up to the minute; without a start how long it takes."""
    if seconds is None or not has_start_time(ranking):
        return format_duration(seconds)
    return format_end_clock(ranking, seconds) or format_duration(seconds)


def name_plan(plan: PlanResult) -> str:
    """``2 tractors, split-field``; ``1 tractor``, as strategies say how several share a field."""
    if plan.tractors == 1:
        return name_fleet(plan)
    return translate("{tractors}, {strategy}", tractors=name_fleet(plan), strategy=plan.strategy)


def describe_rule(ranking: PlanRanking, best: PlanResult) -> str:
    """Why so many tractors where time and cost alone decide: ``3 tractors; a fourth saves 4 min for 9 EUR.``

    Where nobody gave a price, also how much it has to save, and how many tractors the assumed price would take.
    """
    if not ranking.has_knee:
        return ""
    larger = next((plan for plan in ranking.neighbours if plan.tractors > best.tractors), None)
    sentences = [] if larger is None else [_describe_next(ranking, larger, best)]
    if ranking.is_priced or not best.cost:
        return " ".join(sentences)
    count = choose_plan(ranking.eligible, ranking.allowed_s, is_priced=True).tractors
    least_s = 0.0 if larger is None else find_least_saving_s(best, larger)
    if larger is not None and _get_saved_s(best, larger) < least_s:
        sentences.append(
            translate("No price is given, so it would have to save {time}.", time=format_time_span(least_s))
        )
    elif count != best.tractors:
        sentences.append(translate("No price is given, so time decides."))
    if count != best.tractors:
        tractors = format_tractor_count(count)
        sentences.append(
            translate("At the assumed price it would be {tractors} (--price-per-hour).", tractors=tractors)
        )
    return " ".join(sentences)


def describe_alternatives(ranking: PlanRanking, best: PlanResult) -> str:
    """The plans to take with the next smaller and the next larger number of tractors, but for that of the rule."""
    others = _list_alternatives(ranking, best)
    listed = "; ".join(_compare_plan(ranking, plan, best, format_tractor_count(plan.tractors)) for plan in others)
    return translate("Or {alternatives}.", alternatives=listed) if others else ""


def _list_alternatives(ranking: PlanRanking, best: PlanResult) -> list[PlanResult]:
    return [plan for plan in ranking.neighbours if plan.tractors < best.tractors or not ranking.has_knee]


def _compare_plan(ranking: PlanRanking, plan: PlanResult, best: PlanResult, name: str) -> str:
    """A plan beside the best one: its end, how sure it is, what it costs more, and its share where that differs."""
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
        figures.append(describe_share(plan))
    return translate("{plan}: {figures}", plan=name, figures=", ".join(figures))


def _describe_next(ranking: PlanRanking, plan: PlanResult, best: PlanResult) -> str:
    """What more tractors than the recommended ones would save: ``3 tractors; a fourth saves 4 min for 9 EUR.``"""
    count = plan.tractors
    is_named = count == best.tractors + 1 and count < len(NEXT_TRACTORS) + 2
    more = translate(NEXT_TRACTORS[count - 2]) if is_named else translate("a fleet of {count}", count=count)
    saved_s, change = _get_saved_s(best, plan), _compute_cost_change(plan, best)
    values = {"tractors": format_tractor_count(best.tractors), "more": more, "worked": ""}
    if is_share_different(plan.worked_pct, best.worked_pct):
        values["worked"] = f", {describe_share(plan)}"
    if saved_s < LEAST_SPAN_S:
        return translate("{tractors}; {more} saves no time{worked}.", **values)
    values["time"] = format_time_span(saved_s)
    if change is None:
        return translate("{tractors}; {more} saves {time} at the same cost{worked}.", **values)
    values["money"] = _add_currency(ranking, change[1:])
    if change.startswith("-"):
        return translate("{tractors}; {more} saves {time} and {money}{worked}.", **values)
    return translate("{tractors}; {more} saves {time} for {money}{worked}.", **values)


def _get_saved_s(best: PlanResult, plan: PlanResult) -> float:
    """Seconds by which another plan is done with all of the field before the best one."""
    return best.stated_finished_end_s - plan.stated_finished_end_s


def _compute_cost_change(plan: PlanResult, best: PlanResult) -> str | None:
    """The difference as printed, with its sign; None where it is none or not known."""
    more_ground = plan.finishing_cost - best.finishing_cost
    return format_price_change(plan.stated_cost, best.stated_cost, more_ground)


def _add_currency(ranking: PlanRanking, money: str) -> str:
    return money if ranking.currency is None else f"{money} {ranking.currency}"


def describe_deadline(ranking: PlanRanking, best: PlanResult) -> list[str]:
    """Who meets the deadline, if anybody, and what the best plan is among those."""
    judged = [plan for plan in ranking.eligible if plan.meets_deadline is not None]
    in_time = [plan for plan in judged if plan.meets_deadline]
    if not in_time:
        return []
    meeting = sorted({plan.tractors for plan in in_time})
    late = sorted({plan.tractors for plan in judged} - set(meeting))
    counts = translate("{counts} tractors", counts=join_list(meeting, "or"))
    values = {
        "name": translate("The deadline ({clock})", clock=format_deadline(ranking)),
        "tractors": format_tractor_count(1) if meeting == [1] else counts,
        "missed": translate(", not with {counts}", counts=join_list(late, "or")) if late else "",
    }
    if len(judged) == 1:
        return [translate("{name} can be met with {tractors}{missed}.", **values)]
    if ranking.chosen is not None:
        return [translate("{name} can be met with {tractors}{missed}, in half of the samples or more.", **values)]
    if is_dearer(best, min(in_time, key=lambda plan: plan.ranked_cost)):
        text = translate(
            "{name} can be met with {tractors}{missed}; the best plan is the cheapest that could finish the field by "
            "then.",
            **values,
        )
        return [text]
    return [translate("{name} can be met with {tractors}{missed}; the best plan is the cheapest of them.", **values)]


def list_extremes(ranking: PlanRanking, best: PlanResult) -> list[str]:
    """The fastest and the cheapest plan, each where it is another than the best; alternatives without their figures."""
    plans = ranking.eligible
    priced = [plan for plan in plans if plan.cost is not None]
    fastest = min((plan for plan in plans if plan.time_s is not None), key=lambda plan: plan.ranked_s, default=best)
    cheapest = min(priced, key=lambda plan: plan.ranked_cost, default=best)
    is_faster, is_cheaper = fastest.ranked_s != best.ranked_s, cheapest.ranked_cost != best.ranked_cost
    if is_faster and is_cheaper and fastest is cheapest:
        others = {translate("Fastest and cheapest"): fastest}
    else:
        others = {translate("Fastest"): fastest} if is_faster else {}
        others |= {translate("Cheapest"): cheapest} if is_cheaper else {}
    sentences = []
    for label, plan in others.items():
        is_listed = any(plan is one for one in _list_alternatives(ranking, best))
        text = name_plan(plan) if is_listed else _compare_plan(ranking, plan, best, name_plan(plan))
        sentences.append(translate("{label}: {plan}.", label=label, plan=text))
    is_cheapest = len(priced) > 1 and not is_cheaper
    return [*sentences, translate("The best plan is also the cheapest.")] if is_cheapest else sentences
