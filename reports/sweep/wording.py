"""What a sweep says in sentences: what to take, what matters, what has no plan, and what an estimate leaves out."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from typing import Any
from urllib.parse import urlencode

from reports.common.language import mark_text, translate, translate_count, translate_sentence
from reports.common.plan_results import PlanResult
from reports.common.wording import (
    LEAST_SHARE,
    SPEED,
    capitalize_first,
    format_duration,
    format_money,
    format_number,
    format_time_span,
    format_tractor_count,
    format_width,
)
from reports.plan.answer import HEADLAND_ORDERS
from reports.sweep.results import SweepResult, SweptOption, SweptPlan

ESTIMATED = mark_text(
    "Estimated: for each layout and number of tractors a plan was driven at one speed. Times at others follow from it, "
    "and 9 of 10 plans driven in full lie within ± %. Time and cost include finishing the ground that is left. --save "
    "drives a combination in full."
)


def describe_value(option: SweptOption, value: Any) -> str:
    """A value of an option in words: ``6 m``, ``12 km/h``, ``1 tractor``, ``headland last``, ``price per hour 40``."""
    if option.key == "tractors":
        return format_tractor_count(value)
    if option.key == "width_m":
        return format_width(value)
    if option.key == "speed_kmh":
        return SPEED.format(value, 0 if float(value).is_integer() else 1)
    if option.key == "headland_order":
        return translate(HEADLAND_ORDERS[value])
    return f"{translate_sentence(option.label)} {format_value(value)}"


def format_value(value: Any) -> str:
    """A value as the option is written."""
    return f"{value:.10g}" if isinstance(value, int | float) else str(value)


def describe_options(result: SweepResult, one: SweptPlan) -> str:
    """The varied options of a plan: ``6 m, 12 km/h, 1 tractor``; those with one value are not varied."""
    varied = zip(result.options, result.get_values(one), strict=True)
    shown = [describe_value(option, value) for option, value in varied if len(option.values) > 1]
    return ", ".join(shown) or format_tractor_count(one.plan.tractors)


def describe_figures(result: SweepResult, one: SweptPlan) -> str:
    """``1 h 38 min, 65 EUR``; that prices are assumed is said where nobody gave them."""
    money = format_money(one.plan.ranked_cost, result.currency)
    money = money if result.is_priced else translate("{money} (assumed prices)", money=money)
    return f"{format_time_span(one.plan.ranked_s)}, {money}"


def describe_plan(result: SweepResult, one: SweptPlan) -> str:
    """``6 m, 12 km/h, 1 tractor: 1 h 38 min, 65 EUR``."""
    return translate("{plan}: {figures}", plan=describe_options(result, one), figures=describe_figures(result, one))


def describe_best(result: SweepResult) -> str:
    """What to take, or that there is nothing."""
    if result.best is None:
        return translate("No combination has a plan.")
    text = translate("{plan}; estimated.", plan=describe_plan(result, result.best))
    if result.best in result.usable:
        return text
    return translate("{plan} No combination does all that was asked for.", plan=text)


def describe_influences(result: SweepResult) -> str:
    """Of the differences in time and cost what options explain, "" where there are no differences."""
    sentences = []
    for text, shares in (
        (mark_text("Of the difference in time: {shares}."), {one.option: one.time_share for one in result.influences}),
        (mark_text("Of the difference in cost: {shares}."), {one.option: one.cost_share for one in result.influences}),
    ):
        named = [(translate_sentence(option.label), share) for option, share in shares.items()]
        named.sort(key=lambda one: -one[1])
        if named and named[0][1] >= LEAST_SHARE:
            named.append((translate("several options only together"), 1.0 - sum(shares.values())))
            words = [f"{name} {100.0 * share:.0f} %" for name, share in named if share >= LEAST_SHARE]
            sentences.append(translate(text, shares=", ".join(words)))
    return " ".join(sentences)


def describe_refused(result: SweepResult) -> str:
    """How many combinations have no plan, and why the first has none; "" where all have one."""
    count = sum(not one.plan.feasible for one in result.plans)
    if not count:
        return ""
    reason = translate_sentence(result.refusal or "")
    return translate_count(
        "{count} combination has no plan: {reason}", "{count} combinations have no plan, the first: {reason}",
        count, reason=reason,
    )  # fmt: skip


def describe_title(result: SweepResult) -> str:
    """Field, area and how many combinations there are."""
    area, done, total = format_number(result.area_ha, 2), f"{len(result.plans):,}", f"{result.total:,}"
    values = {"field": result.field_name, "area": area, "total": total}
    if len(result.plans) == result.total:
        return translate_count(
            "{field}, {area} ha: {total} combination", "{field}, {area} ha: {total} combinations",
            result.total, **values,
        )  # fmt: skip
    return translate_count(
        "{field}, {area} ha: {done} of {total} combination", "{field}, {area} ha: {done} of {total} combinations",
        result.total, done=done, **values,
    )  # fmt: skip


def describe_rows(result: SweepResult) -> str:
    """What the rows of the table are."""
    rows, front = len(result.rows), len(result.front)
    text = translate("No other combination beats these in time, cost, tractors, ground and fuel together.")
    if front <= rows:
        return text
    return translate("{text} Shown are {rows} of {front}; --csv has all.", text=text, rows=rows, front=front)


def describe_marked_rows(result: SweepResult) -> str:
    """The same, and which of them to take."""
    return translate("> is the one to take. {rows}", rows=describe_rows(result))


def compare_with_drive(result: SweepResult, one: SweptPlan, driven: PlanResult) -> str:
    """The plan as driven beside its estimate, with what they differ by."""

    def change(estimate: float, value: float) -> str:
        return format_change(100.0 * (estimate / value - 1.0)) if value else format_change(0.0)

    estimate_s, driven_s = one.plan.ranked_s, driven.ranked_s
    cost, driven_cost = one.plan.ranked_cost, driven.ranked_cost
    worked, driven_worked = one.plan.worked_pct or 0.0, driven.worked_pct or 0.0
    return translate(
        "{plan}: driven in full {time}, {cost}, {worked} % worked; estimated {estimated_time} ({time_change} %), "
        "{estimated_cost} ({cost_change} %), {estimated_worked} % ({worked_change}).",
        plan=describe_options(result, one),
        time=format_duration(driven_s),
        cost=format_money(driven_cost, result.currency),
        worked=format_number(driven_worked, 1),
        estimated_time=format_duration(estimate_s),
        time_change=change(estimate_s, driven_s),
        estimated_cost=format_money(cost, result.currency),
        cost_change=change(cost, driven_cost),
        estimated_worked=format_number(worked, 1),
        worked_change=format_change(worked - driven_worked),
    )


def format_change(value: float) -> str:
    """A difference with its sign and one decimal; one that is printed as none has a plus."""
    return f"{round(value, 1) + 0.0:+.1f}"


def build_command(result: SweepResult, one: SweptPlan) -> str:
    """The command that plans a combination in full."""
    words = list(result.command)
    for option, value in zip(result.options, result.get_values(one), strict=True):
        words += list_option_words(option.flag, value)
    return shlex.join(words)


def list_option_words(name: str, value: Any) -> list[str]:
    """An option of `headland plan` by its name with its value as words of a command; some are flags."""
    if name == "headland_order":
        return [f"--headland-{value}"]
    option = name if name.startswith("--") else f"--{name.replace('_', '-')}"
    return [option] if value is True else [option, format_value(value)]


def build_query(values: Iterable[tuple[str, Any]]) -> str:
    """Options of a plan by name, as the address of its form in a service has them (planaddress.js)."""
    texts = [
        (f"headland_{value}", "true")
        if name == "headland_order"
        else (name, "true" if value is True else format_value(value))
        for name, value in values
    ]
    return urlencode(texts)


def title_option(option: SweptOption) -> str:
    """The heading of a column: ``Working width, m``."""
    unit = f", {option.unit}" if option.unit else ""
    return f"{capitalize_first(translate_sentence(option.label))}{unit}"
