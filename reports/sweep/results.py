"""A sweep: plans of many combinations of options, which of them nothing beats, what matters, what is said of them."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from math import comb
from typing import Any
from urllib.parse import urlencode

import numpy as np

from fields.arrays import Floats, Integers
from reports.common.language import mark_text, translate, translate_count, translate_sentence
from reports.common.plan_results import PlanResult, choose_plan
from reports.common.rendering import ShownResult
from reports.common.wording import (
    HEADLAND_ORDERS,
    LEAST_SHARE,
    SPEED,
    format_assumed_money,
    format_duration,
    format_money,
    format_number,
    format_time_span,
    format_tractor_count,
    format_width,
)
from reports.plan.shortfall_wording import describe_lacks, question_pull

MOST_ROWS = 20  # of a table

ESTIMATED = mark_text(
    "Estimated: for each layout and number of tractors a plan was driven at one speed. Times at others follow from it, "
    "and 9 of 10 plans driven in full lie within ± %. Time and cost include finishing the ground that is left. --save "
    "drives a combination in full."
)


@dataclass(frozen=True)
class SweptOption:
    """An option that a sweep varies: its name in files (`width_m`, `speed_kmh`), as an option, and its values.

    `label` and `unit` are what people call it.
    """

    key: str
    flag: str
    values: tuple[Any, ...]
    label: str
    unit: str = ""


@dataclass(frozen=True, eq=False)
class SweptPlan:
    """One combination: the number of the value of every option, and the plan as estimated, or why there is none."""

    numbers: tuple[int, ...]
    plan: PlanResult


@dataclass(frozen=True, eq=False, repr=False)
class SweepResult(ShownResult):
    """The plans of a sweep in the order of their combinations, all estimated and none driven.

    Attributes:
        field_name, area_ha: of the field, or of all fields together.
        options: what is varied; every plan has a value of each.
        plans: of the combinations that there was time for, of `total` in all.
        by_field: with several fields, the plans of each, by its name; then `plans` are those of all together, one after
            another.
        command: the command that plans one combination in full, without the varied options.
        link: the address of a form that does so, without the varied options; "" without a service.
    """

    field_name: str
    area_ha: float
    options: tuple[SweptOption, ...]
    plans: tuple[SweptPlan, ...]
    total: int
    currency: str | None = None
    start: str | None = None
    allowed_s: float | None = None
    is_priced: bool = False
    by_field: dict[str, tuple[SweptPlan, ...]] = field(default_factory=dict)
    command: tuple[str, ...] = ()
    link: str = ""

    def get_values(self, plan: SweptPlan) -> tuple[Any, ...]:
        """The values of a plan's options, as options are written."""
        return tuple(option.values[number] for option, number in zip(self.options, plan.numbers, strict=True))

    @cached_property
    def usable(self) -> tuple[SweptPlan, ...]:
        """The plans that can be taken: they lack nothing of what was asked for."""
        return tuple(one for one in self.plans if one.plan.feasible and not one.plan.lacks)

    @cached_property
    def front(self) -> tuple[SweptPlan, ...]:
        """The usable plans that nothing beats in time, cost, tractors, ground worked and fuel together, quickest first.

        Of plans alike in all of these the first is taken. All are compared as they are printed.
        """
        aims = []
        for plan in (one.plan for one in self.usable):
            used = plan.fuel_l if plan.energy_kwh is None else plan.energy_kwh
            left = -round(plan.worked_pct or 0.0, 1)
            aims.append((round(plan.ranked_s), round(plan.ranked_cost, 2), plan.tractors, left, round(used or 0.0, 1)))
        return tuple(self.usable[number] for number in find_front(np.array(aims)))

    @cached_property
    def best(self) -> SweptPlan | None:
        """The plan to take, by the rule of `headland plan`, or what comes nearest where none is usable; None without a
        plan."""
        feasible = [one for one in self.plans if one.plan.feasible]
        if not feasible:
            return None
        chosen = choose_plan([one.plan for one in feasible], self.allowed_s, self.is_priced)
        return next(one for one in feasible if one.plan is chosen)

    @property
    def has_recommendation(self) -> bool:
        """Whether the best plan lacks nothing."""
        return self.best is not None and not self.best.plan.lacks

    @cached_property
    def rows(self) -> tuple[SweptPlan, ...]:
        """The rows of a table, quickest first: the front, spread evenly where it is too long, and the plan to take."""
        front, best = self.front, self.best
        if len(front) > MOST_ROWS:
            places = np.unique(np.linspace(0, len(front) - 1, MOST_ROWS - 1).round().astype(int))
            front = tuple(front[place] for place in places)
        if best is not None and all(one.numbers != best.numbers for one in front):
            front = tuple(sorted((*front, best), key=lambda one: one.plan.ranked_s))
        return front

    @cached_property
    def influences(self) -> tuple[tuple[SweptOption, tuple[float, float]], ...]:
        """Options, and the shares of the variance of time and of cost that each explains by itself, largest first."""
        feasible = [one for one in self.plans if one.plan.feasible]
        times_s = np.array([one.plan.ranked_s for one in feasible])
        costs = np.array([one.plan.ranked_cost for one in feasible])
        numbers = np.array([one.numbers for one in feasible], np.int64).reshape(len(feasible), len(self.options))
        shares = [measure_influences(values, numbers).tolist() for values in (times_s, costs)]
        found = [(option, (time, cost)) for option, time, cost in zip(self.options, *shares, strict=True)]
        return tuple(sorted(found, key=lambda one: -max(one[1])))

    @property
    def refusal(self) -> str | None:
        """Why the first combination without a plan has none; None where all have one."""
        return next((one.plan.reason for one in self.plans if not one.plan.feasible), None)


def find_front(aims: Floats) -> list[int]:
    """Numbers of the rows (n, k) that no other beats: none is as small in all and smaller in one; sorted by the row."""
    kept = list[int]()
    for number in np.lexsort(aims.T[::-1]).tolist() if len(aims) else []:
        front = aims[kept]
        if not (front <= aims[number]).all(axis=1).any():
            kept.append(number)
    return kept


def measure_influences(values: Floats, numbers: Integers) -> Floats:
    """Shares (k,) of the variance of values (n,) that options with these numbers of their values (n, k) explain.

    Sums of one effect for each value are fitted for any of the options together; an option has what it adds to those
    before it, on average over all orders (Lindeman, Merenda and Gold 1980). So shares add up to 1 at most also where
    combinations without a plan leave gaps; where all are there, it is the first-order index of Sobol. Zeros where
    values do not differ.
    """
    count, options = numbers.shape
    shares = np.zeros(options)
    total = float(np.square(values - values.mean()).sum()) if count else 0.0
    if total <= 1e-12 * float(np.square(values).sum()):
        return shares
    products, sums, levels = _multiply_effects(values, numbers)
    explained = {0: 0.0}
    for chosen in range(1, 2**options):
        rows = np.isin(levels, [option for option in range(options) if chosen >> option & 1])
        effects, *_ = np.linalg.lstsq(products[np.ix_(rows, rows)], sums[rows], rcond=1e-9)
        explained[chosen] = float(effects @ sums[rows]) / total
    for option, chosen in product(range(options), explained):
        if not chosen >> option & 1:
            others = chosen.bit_count()
            weight = 1.0 / (options * comb(options - 1, others))
            shares[option] += weight * (explained[chosen | 1 << option] - explained[chosen])
    return np.clip(shares, 0.0, 1.0)


def _multiply_effects(values: Floats, numbers: Integers) -> tuple[Floats, Floats, Integers]:
    """Normal equations of one effect for each value of options: products (m, m), sums (m,), whose effect it is (m,)."""
    count, options = numbers.shape
    sizes = numbers.max(axis=0) + 1
    begins = np.concatenate([[0], np.cumsum(sizes)])
    columns = numbers + begins[:-1]
    products = np.zeros((begins[-1], begins[-1]))
    for a, b in product(range(options), repeat=2):
        np.add.at(products, (columns[:, a], columns[:, b]), 1.0)
    counts = np.bincount(columns.ravel(), minlength=begins[-1])
    sums = np.zeros(begins[-1])
    for option in range(options):
        sums += np.bincount(columns[:, option], values - values.mean(), minlength=begins[-1])
    return products - np.outer(counts, counts) / count, sums, np.repeat(np.arange(options), sizes)


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


def describe_plan(result: SweepResult, one: SweptPlan) -> str:
    """``6 m, 12 km/h, 1 tractor: 1 h 38 min, 65 EUR``; that prices are assumed is said where nobody gave them."""
    money = format_assumed_money(format_money(one.plan.ranked_cost, result.currency), not result.is_priced)
    figures = f"{format_time_span(one.plan.ranked_s)}, {money}"
    return translate("{plan}: {figures}", plan=describe_options(result, one), figures=figures)


def describe_best(result: SweepResult) -> str:
    """What to take, what comes nearest where nothing does all that was asked for, or that there is nothing."""
    if result.best is None:
        return translate("No combination has a plan.")
    text = translate("{plan}; estimated.", plan=describe_plan(result, result.best))
    if result.has_recommendation:
        return text
    words = translate("No combination does all that was asked for; the nearest is {plan}", plan=text)
    return " ".join([words, *describe_lacks(result.best.plan).values()])


def describe_influences(result: SweepResult) -> str:
    """Of the differences in time and cost what options explain, "" where there are no differences."""
    sentences = []
    texts = mark_text("Of the difference in time: {shares}."), mark_text("Of the difference in cost: {shares}.")
    for place, text in enumerate(texts):
        named = [(translate_sentence(option.label), shares[place]) for option, shares in result.influences]
        named.sort(key=lambda one: -one[1])
        if named and named[0][1] >= LEAST_SHARE:
            rest = 1.0 - sum(shares[place] for _, shares in result.influences)
            named.append((translate("several options only together"), rest))
            words = [f"{name} {100.0 * share:.0f} %" for name, share in named if share >= LEAST_SHARE]
            sentences.append(translate(text, shares=", ".join(words)))
    return " ".join(sentences)


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
    if not front:
        return ""
    text = translate("No other combination beats these in time, cost, tractors, ground and fuel together.")
    if front <= rows:
        return text
    return translate("{text} Shown are {rows} of {front}; --csv has all.", text=text, rows=rows, front=front)


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


def list_remarks(result: SweepResult) -> list[str]:
    """What to check of the one to take, what matters, what cannot be pulled, and what has no plan."""
    best = result.best
    doubt = question_pull(best.plan.pull) if best is not None and result.has_recommendation else ""
    remarks = [doubt, describe_influences(result)]
    weak = [one.plan for one in result.plans if one.plan.feasible and "pull" in one.plan.lacks]
    if weak and result.has_recommendation:  # they need more power than their tractor has
        remarks.append(
            translate_count(
                "{count} combination cannot be taken: {reason}",
                "{count} combinations cannot be taken, the first: {reason}",
                len(weak),
                reason=question_pull(weak[0].pull),
            )
        )
    refused_count = sum(not one.plan.feasible for one in result.plans)
    if refused_count:
        remarks.append(
            translate_count(
                "{count} combination has no plan: {reason}",
                "{count} combinations have no plan, the first: {reason}",
                refused_count,
                reason=translate_sentence(result.refusal or ""),
            )
        )
    return [text for text in remarks if text]
