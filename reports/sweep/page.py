"""A sweep as a page and as a picture: cost over time of all combinations, what matters, and what no other beats."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.common import palette
from reports.common.notebook import FIGURE_INCHES, create_figure
from reports.common.plan_results import get_ranked_cost, get_ranked_s
from reports.common.rendering import ReportError, render_template
from reports.common.wording import capitalize_first, format_tractor_count
from reports.plan.map_figure import render_png
from reports.sweep.results import SweepResult, SweptPlan
from reports.sweep.tables import build_front_table
from reports.sweep.wording import (
    ESTIMATED,
    build_query,
    describe_best,
    describe_influences,
    describe_refused,
    describe_rows,
    describe_title,
    describe_value,
    list_option_words,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEIGHT = 560, 400
LEFT, RIGHT, TOP, BOTTOM = 64, 544, 28, 352
MOST_TICKS = 6
STEPS_S = (1, 5, 10, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 21600, 43200, 86400)
ROOM = 0.04  # of the range of values, beside the first and the last


@dataclass(frozen=True)
class ChartAxis:
    """A direction of the picture: values from `low` to `high` lie from `first` to `last`."""

    low: float
    high: float
    first: float
    last: float

    def place(self, value: float) -> float:
        """Where a value lies."""
        return round(self.first + (self.last - self.first) * (value - self.low) / (self.high - self.low), 1)

    def list_ticks(self, steps: Sequence[float]) -> list[float]:
        """Values at the first step that makes few enough."""
        span = self.high - self.low
        step = next((one for one in steps if span / one <= MOST_TICKS), span / MOST_TICKS)
        first = int(np.ceil(self.low / step - 1e-9))
        return [number * step for number in range(first, int(np.floor(self.high / step + 1e-9)) + 1)]


def render_sweep_page(result: SweepResult) -> str:
    """The page as HTML text, in English: a point shows its options, its figures and the command that drives it."""
    table, rows = build_front_table(result), result.rows
    plans = [one for one in result.plans if one.plan.feasible]
    places = {one.numbers: place for place, one in enumerate(plans)}
    sentences = (describe_influences(result), describe_refused(result), ESTIMATED)
    content: dict[str, Any] = {
        "title": describe_title(result),
        "best": describe_best(result),
        "currency": result.currency,
        "sentences": [text for text in sentences if text],
        "chart": _build_chart(result, plans, places) if plans and result.front else None,
        "shares": _list_shares(result),
        "headings": [column.full_title for column in table.columns],
        "rows": [
            {
                "cells": [cells[0].removeprefix("> "), *cells[1:]],
                "is_best": one is result.best,
                "point": places[one.numbers],
            }
            for one, cells in zip(rows, table.rows, strict=True)
        ],
        "legend": describe_rows(result),
    }
    return render_template("sweep.html.j2", content)


def _build_chart(result: SweepResult, plans: Sequence[SweptPlan], places: dict[tuple[int, ...], int]) -> dict[str, Any]:
    """All points, those of the front, ticks, and what the script of the page shows of a point."""
    x_axis = _build_axis([get_ranked_s(one.plan) for one in plans], LEFT, RIGHT)
    y_axis = _build_axis([get_ranked_cost(one.plan) for one in plans], BOTTOM, TOP)
    at = [(x_axis.place(get_ranked_s(one.plan)), y_axis.place(get_ranked_cost(one.plan))) for one in plans]
    steps = [number * 10.0**power for power in range(-2, 9) for number in (1, 2, 5)]
    front = [places[one.numbers] for one in result.front]
    assert result.best is not None
    return {
        "width": WIDTH, "height": HEIGHT, "left": LEFT, "right": RIGHT, "top": TOP, "bottom": BOTTOM,
        "x_ticks": [
            {"at": x_axis.place(value), "text": f"{int(value) // 3600}:{int(value) % 3600 // 60:02d}"}
            for value in x_axis.list_ticks(STEPS_S[4:])
        ],
        "y_ticks": [{"at": y_axis.place(value), "text": f"{value:g}"} for value in y_axis.list_ticks(steps)],
        "groups": [
            {
                "colour": _choose_colour(count),
                "text": format_tractor_count(count),
                "path": "".join(
                    f"M{x - 2:.1f} {y - 2:.1f}h4v4h-4z"
                    for x, y in dict.fromkeys(
                        place for one, place in zip(plans, at, strict=True) if one.plan.tractors == count
                    )
                ),
            }
            for count in sorted({one.plan.tractors for one in plans})
        ],
        "front": [
            {"x": at[place][0], "y": at[place][1], "colour": _choose_colour(plans[place].plan.tractors)}
            for place in front
        ],
        "data": {
            "points": [_list_numbers(one, place) for one, place in zip(plans, at, strict=True)],
            "front": front,
            "best": places[result.best.numbers],
            "unit": "l" if plans[0].plan.energy_kwh is None else "kWh",
            "command": shlex.join(result.command),
            "link": result.link,
            "parameters": [
                [build_query([(option.flag, value)]) for value in option.values] if result.link else []
                for option in result.options
            ],
            "words": [
                [describe_value(option, value) if len(option.values) > 1 else "" for value in option.values]
                for option in result.options
            ],
            "options": [
                [shlex.join(list_option_words(option.flag, value)) for value in option.values]
                for option in result.options
            ],
        },
    }  # fmt: skip


def _build_axis(values: Sequence[float], first: float, last: float) -> ChartAxis:
    low, high = min(values), max(values)
    room = ROOM * (high - low) or 0.1 * abs(high) or 1.0
    return ChartAxis(low - room, high + room, first, last)


def _list_numbers(one: SweptPlan, place: tuple[float, float]) -> list[Any]:
    """Place, seconds, cost, share worked and fuel of a point, then the numbers of its values."""
    plan = one.plan
    used = plan.fuel_l if plan.energy_kwh is None else plan.energy_kwh
    figures = round(get_ranked_s(plan)), round(get_ranked_cost(plan), 2), round(plan.worked_pct or 0.0, 1)
    return [*place, *figures, None if used is None else round(used, 1), *one.numbers]


def _choose_colour(tractors: int) -> int:
    return (tractors - 1) % len(palette.TRACTOR_COLOURS)


def _list_shares(result: SweepResult) -> list[dict[str, Any]]:
    """What the options explain of time and cost in percent, with the rest that only combinations explain."""
    varied = [one for one in result.influences if len(one.option.values) > 1]
    labels = [capitalize_first(one.option.label) for one in varied]
    found = []
    for colour, title, shares in (
        (0, "Of the difference in time", [one.time_share for one in varied]),
        (2, "Of the difference in cost", [one.cost_share for one in varied]),
    ):
        if sum(shares) > 0.0:
            named = sorted(zip(shares, labels, strict=True), reverse=True)
            named.append((max(0.0, 1.0 - sum(shares)), "Only combinations"))
            rows = [{"text": label, "percent": round(100.0 * share)} for share, label in named]
            found.append({"title": title, "colour": colour, "rows": rows})
    return found


def draw_sweep(axes: Axes, result: SweepResult) -> None:
    """Cost over hours of all combinations, a colour by number of tractors, those that no other beats strongly."""
    plans = [one for one in result.plans if one.plan.feasible]
    for count in sorted({one.plan.tractors for one in plans}):
        look: dict[str, Any] = {"linestyle": "none", "color": palette.get_tractor_colour(count - 1)}
        for chosen, size, alpha in ((plans, 2.5, 0.3), (result.front, 6.0, 1.0)):
            of_count = [one.plan for one in chosen if one.plan.tractors == count]
            hours = [get_ranked_s(plan) / 3600.0 for plan in of_count]
            costs = [get_ranked_cost(plan) for plan in of_count]
            label = format_tractor_count(count) if chosen is plans else None
            axes.plot(hours, costs, marker="o", markersize=size, alpha=alpha, label=label, **look)
    currency = f", {result.currency}" if result.currency else ""
    axes.set(xlabel="time, hours; estimated", ylabel=f"cost{currency}")
    axes.set_title(describe_title(result).replace("$", r"\$"), loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)


def render_sweep_png(result: SweepResult) -> bytes:
    """The picture of `draw_sweep`; raises ReportError where no combination has a plan."""
    if result.best is None:
        raise ReportError("No combination has a plan, so there is nothing to draw; vary other options.")
    figure = create_figure(*FIGURE_INCHES, layout="constrained")
    draw_sweep(figure.add_subplot(), result)
    return render_png(figure)
