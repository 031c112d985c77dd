"""A sweep for people and programs: all plans as JSON, CSV and Parquet, a table of the best ones, page and chart."""

from __future__ import annotations

import io
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType

from reports.common import palette
from reports.common.drawing_sizes import SWEEP_FRAME, TIME_STEPS_S
from reports.common.language import translate, translate_sentence
from reports.common.rendering import (
    EXPORT_DECIMALS,
    FIGURE_INCHES,
    NOT_DRAWN,
    ReportError,
    ResultView,
    build_view,
    create_figure,
    encode_picture,
    format_csv,
    format_json,
    pick_values,
    render_template,
)
from reports.common.text_tables import (
    FittedTable,
    TableColumn,
    build_table,
    format_sentence,
    format_title,
    render_fragment,
)
from reports.common.wording import capitalize_first, format_duration, format_number, format_tractor_count
from reports.plan.map_figure import escape_figure_formula, render_png
from reports.sweep.results import (
    ESTIMATED,
    SweepResult,
    SweptPlan,
    build_command,
    build_query,
    describe_best,
    describe_rows,
    describe_title,
    describe_value,
    format_value,
    list_option_words,
    list_remarks,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLAN_KEYS = (
    "finished_s", "finished_cost", "worked_pct", "fuel_l", "energy_kwh", "uncertainty_pct", "meets_deadline",
    "feasible", "reason", "lacks",
)  # fmt: skip


def list_rows(result: SweepResult) -> list[dict[str, Any]]:
    """All plans as plain values: options as written, figures, `on_front`, `is_best`; with several fields each alone."""
    on_front = {one.numbers for one in result.front}
    best = None if result.best is None else result.best.numbers

    def build_row(one: SweptPlan) -> dict[str, Any]:
        marks = {"on_front": one.numbers in on_front, "is_best": one.numbers == best}
        return {**list_values(result, one), **marks}

    if not result.by_field:
        return [build_row(one) for one in result.plans]
    return [{"field": name, **build_row(one)} for name, plans in result.by_field.items() for one in plans]


def list_values(result: SweepResult, one: SweptPlan) -> dict[str, Any]:
    """The options of a plan as written, and its figures, as plain values."""
    figures = pick_values(one.plan, PLAN_KEYS)
    if one.plan.feasible:
        figures |= {"finished_s": one.plan.ranked_s, "finished_cost": one.plan.ranked_cost}
    keys = [option.key for option in result.options]
    return {**dict(zip(keys, result.get_values(one), strict=True)), **figures}


def build_sweep_screen(result: SweepResult) -> RenderableType:
    """What to take, what matters, and the table of what nothing beats."""
    parts: list[RenderableType] = [
        format_title(describe_title(result)),
        format_sentence(describe_best(result), style="bold"),
        *map(format_sentence, list_remarks(result)),
    ]
    if result.rows:
        nearest = translate("> comes nearest to what was asked for.")
        mark = translate("> is the one to take.") if result.has_recommendation else nearest
        legend = f"{mark} {describe_rows(result)}".strip()
        parts += ["", replace(build_front_table(result), notes=(legend, ESTIMATED))]
    return Group(*parts)


def build_front_table(result: SweepResult) -> FittedTable:
    """The rows of `choose_rows` with their numbers, only varied options as columns."""
    varied = [place for place, option in enumerate(result.options) if len(option.values) > 1]
    titles = [(capitalize_first(translate_sentence(option.label)), option.unit) for option in result.options]
    rows, cost = result.rows, translate("Cost {currency}", currency=result.currency or "").strip()
    uses_energy = any(one.plan.energy_kwh is not None for one in rows)
    used, key = ("Energy kWh", "energy_kwh") if uses_energy else ("Fuel l", "fuel_l")

    def is_best(one: SweptPlan) -> bool:
        return result.best is not None and one.numbers == result.best.numbers

    figures: list[tuple[TableColumn, Callable[[SweptPlan], str]]] = [
        (TableColumn("Row"), lambda one: f"{'> ' if is_best(one) else ''}{rows.index(one) + 1}"),
        *(
            (TableColumn(", ".join(filter(None, titles[place]))),
             lambda one, place=place: format_value(result.get_values(one)[place]))
            for place in varied
        ),
        (TableColumn("Time"), lambda one: format_duration(one.plan.ranked_s)),
        (TableColumn(cost), lambda one: format_number(one.plan.ranked_cost, 2)),
        (TableColumn("± %"), lambda one: format_number(one.plan.uncertainty_pct, 0)),
        (TableColumn("Worked %", drop_order=1), lambda one: format_number(one.plan.worked_pct, 1)),
        (TableColumn(used, drop_order=2), lambda one: format_number(getattr(one.plan, key), 1)),
    ]  # fmt: skip
    return build_table(rows, figures, is_best)


def format_sweep_csv(result: SweepResult) -> str:
    """All plans as CSV, a row each."""
    rows = [{**row, "lacks": " ".join(row["lacks"])} for row in list_rows(result)]
    return format_csv(list(rows[0]) if rows else [], rows)


def format_sweep_json(result: SweepResult) -> str:
    """The sweep as JSON; the guide on sweeps lists the keys."""
    best = result.best

    def build_entry(one: SweptPlan) -> dict[str, Any]:
        return {**list_values(result, one), "command": build_command(result, one)}

    return format_json(
        {
            "field": result.field_name,
            "area_ha": result.area_ha,
            "combinations": result.total,
            "done": len(result.plans),
            "estimated": True,
            "currency": result.currency,
            "prices_assumed": not result.is_priced,
            "options": {option.key: option.values for option in result.options},
            "best": None if best is None else {"row": result.rows.index(best) + 1, **build_entry(best)},
            "front": [build_entry(one) for one in result.front],
            "influences": [
                {"option": option.key, "time_share": time_share, "cost_share": cost_share}
                for option, (time_share, cost_share) in result.influences
            ],
            "without_plan": {"count": sum(not one.plan.feasible for one in result.plans), "reason": result.refusal},
            "plans": list_rows(result),
        },
        EXPORT_DECIMALS,
        is_ascii=False,
    )


def render_sweep_parquet(result: SweepResult) -> bytes:
    """All plans as a Parquet file; raises ReportError without pyarrow."""
    import pandas as pd

    buffer = io.BytesIO()
    try:
        pd.DataFrame(list_rows(result)).to_parquet(buffer, engine="pyarrow", index=False)
    except ImportError:
        raise ReportError(
            "Parquet needs pyarrow, which is not installed; install headland[parquet], or write CSV."
        ) from None
    return buffer.getvalue()


def render_sweep_page(result: SweepResult) -> str:
    """The page as HTML text, in English: a point shows its options, its figures and the command that drives it."""
    table, rows = build_front_table(result), result.rows
    shaded = "is the one to take" if result.has_recommendation else "comes nearest to what was asked for"
    plans = [one for one in result.plans if one.plan.feasible]
    places = {one.numbers: place for place, one in enumerate(plans)}
    content: dict[str, Any] = {
        "title": describe_title(result),
        "best": describe_best(result),
        "currency": result.currency,
        "sentences": [*list_remarks(result), ESTIMATED],
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
        "title_of_rows": "Combinations that no other beats" if result.front else "What comes nearest",
        "legend": f"{describe_rows(result)} The shaded one {shaded}.".strip(),
    }
    return render_template("sweep.html.j2", content)


def _build_chart(result: SweepResult, plans: Sequence[SweptPlan], places: dict[tuple[int, ...], int]) -> dict[str, Any]:
    """All points, those of the front, ticks, and what the script of the page shows of a point."""
    x_axis, y_axis = SWEEP_FRAME.build_axes(
        _widen_range([one.plan.ranked_s for one in plans]), _widen_range([one.plan.ranked_cost for one in plans])
    )
    at = [(x_axis.place(one.plan.ranked_s), y_axis.place(one.plan.ranked_cost)) for one in plans]
    front = [places[one.numbers] for one in result.front]
    assert result.best is not None
    return {
        "frame": SWEEP_FRAME,
        "x_ticks": x_axis.list_ticks(
            TIME_STEPS_S[TIME_STEPS_S.index(60) :], lambda value: format_duration(value).removesuffix(":00")
        ),
        "y_ticks": y_axis.list_ticks(),
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
            "currency": result.currency or "",
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
    }


def _widen_range(values: Sequence[float]) -> tuple[float, float]:
    """The least and the largest of values, and some room beyond."""
    low, high = min(values), max(values)
    room = 0.04 * (high - low) or 0.1 * abs(high) or 1.0
    return low - room, high + room


def _list_numbers(one: SweptPlan, place: tuple[float, float]) -> list[Any]:
    """Place, seconds, cost, share worked, fuel and uncertainty of a point, then the numbers of its values."""
    plan = one.plan
    used = plan.fuel_l if plan.energy_kwh is None else plan.energy_kwh
    figures = round(plan.ranked_s), round(plan.ranked_cost, 2), round(plan.worked_pct or 0.0, 1)
    return [*place, *figures, None if used is None else round(used, 1), plan.uncertainty_pct, *one.numbers]


def _choose_colour(tractors: int) -> int:
    return (tractors - 1) % len(palette.TRACTOR_COLOURS)


def _list_shares(result: SweepResult) -> list[dict[str, Any]]:
    """What the options explain of time and cost in percent, with the rest that only combinations explain."""
    varied = [one for one in result.influences if len(one[0].values) > 1]
    labels = [capitalize_first(option.label) for option, _ in varied]
    found = []
    for place, colour, title in ((0, 0, "Of the difference in time"), (1, 2, "Of the difference in cost")):
        shares = [both[place] for _, both in varied]
        if sum(shares) > 0.0:
            named = sorted(zip(shares, labels, strict=True), reverse=True)
            named.append((max(0.0, 1.0 - sum(shares)), "Several only together"))
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
            hours = [plan.ranked_s / 3600.0 for plan in of_count]
            costs = [plan.ranked_cost for plan in of_count]
            label = format_tractor_count(count) if chosen is plans else None
            axes.plot(hours, costs, marker="o", markersize=size, alpha=alpha, label=label, **look)
    currency = f", {result.currency}" if result.currency else ""
    axes.set(xlabel="time, hours; estimated", ylabel=f"cost{currency}")
    axes.set_title(escape_figure_formula(describe_title(result)), loc="left", fontsize=10)
    axes.legend(frameon=False, fontsize=8)


def render_sweep_png(result: SweepResult) -> bytes:
    """The picture of `draw_sweep`; raises ReportError where no combination has a plan."""
    if result.best is None:
        raise ReportError("No combination has a plan, so there is nothing to draw; vary other options.")
    figure = create_figure(*FIGURE_INCHES, layout="constrained")
    draw_sweep(figure.add_subplot(), result)
    return render_png(figure)


@build_view.register
def build_sweep_view(result: SweepResult) -> ResultView:
    """A sweep: what to take, cost over time, and all plans as a table."""

    def render() -> str:
        sentences = [describe_best(result), *list_remarks(result), ESTIMATED]
        picture = None if result.best is None else encode_picture(lambda axes: draw_sweep(axes, result))
        notes = tuple(filter(None, [describe_rows(result)]))
        tables = [replace(build_front_table(result), notes=notes)] if result.rows else []
        words = "Cost over time of all combinations"
        return render_fragment(describe_title(result), sentences, tables, picture, words)

    return ResultView(
        summary=lambda: f"{describe_title(result)}. {describe_best(result)}",
        html=render,
        table=lambda: list_rows(result),
        draw=None if result.best is None else lambda axes: draw_sweep(axes, result),
        not_drawn=f"{NOT_DRAWN}, as no combination has a plan.",
        files={
            ".csv": lambda: format_sweep_csv(result),
            ".json": lambda: format_sweep_json(result),
            ".html": lambda: render_sweep_page(result),
            ".png": lambda: render_sweep_png(result),
            ".parquet": lambda: render_sweep_parquet(result),
        },
    )
