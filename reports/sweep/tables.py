"""A sweep as a table: for programs all plans, for people those that nothing beats."""

from __future__ import annotations

import io
from typing import Any

from rich.console import Group, RenderableType

from reports.common.language import translate
from reports.common.plan_results import PlanResult
from reports.common.rendering import EXPORT_DECIMALS, ReportError, format_entries_csv, format_json, pick_values
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.wording import format_duration, format_number
from reports.sweep.results import SweepResult, SweptPlan
from reports.sweep.wording import (
    ESTIMATED,
    build_command,
    describe_best,
    describe_influences,
    describe_marked_rows,
    describe_refused,
    describe_title,
    format_value,
    title_option,
)

PLAN_KEYS = (
    "finished_s", "finished_cost", "worked_pct", "fuel_l", "energy_kwh", "uncertainty_pct", "meets_deadline",
    "feasible", "reason",
)  # fmt: skip


def list_rows(result: SweepResult) -> list[dict[str, Any]]:
    """All plans as plain values: options as written, figures, `on_front`, `is_best`; with several fields each alone."""
    keys = [option.key for option in result.options]
    on_front = {one.numbers for one in result.front}
    best = None if result.best is None else result.best.numbers

    def build_row(one: SweptPlan) -> dict[str, Any]:
        options = dict(zip(keys, result.get_values(one), strict=True))
        marks = {"on_front": one.numbers in on_front, "is_best": one.numbers == best}
        return {**options, **_list_figures(one.plan), **marks}

    if not result.by_field:
        return [build_row(one) for one in result.plans]
    return [{"field": name, **build_row(one)} for name, plans in result.by_field.items() for one in plans]


def _list_figures(plan: PlanResult) -> dict[str, Any]:
    figures = pick_values(plan, PLAN_KEYS)
    if plan.feasible:
        figures |= {"finished_s": plan.ranked_s, "finished_cost": plan.ranked_cost}
    return figures


def build_sweep_screen(result: SweepResult) -> RenderableType:
    """What to take, what matters, and the table of what nothing beats."""
    rows = result.rows
    sentences = [describe_best(result), describe_influences(result), describe_refused(result)]
    parts: list[RenderableType] = [format_title(describe_title(result))]
    parts += [format_sentence(text, style="" if place else "bold") for place, text in enumerate(sentences) if text]
    if rows:
        parts += ["", build_front_table(result), format_sentence(describe_marked_rows(result), style="dim")]
        parts.append(format_sentence(ESTIMATED, style="dim"))
    return Group(*parts)


def build_front_table(result: SweepResult) -> FittedTable:
    """The rows of `choose_rows` with their numbers, only varied options as columns."""
    varied = [place for place, option in enumerate(result.options) if len(option.values) > 1]
    rows = result.rows
    uses_energy = any(one.plan.energy_kwh is not None for one in rows)
    columns = [
        TableColumn("Row"),
        *(TableColumn(title_option(result.options[place]), drop_order=0) for place in varied),
        TableColumn("Time"),
        TableColumn(translate("Cost {currency}", currency=result.currency or "").strip()),
        TableColumn("± %"),
        TableColumn("Worked %", drop_order=1),
        TableColumn("Energy kWh" if uses_energy else "Fuel l", drop_order=2),
    ]
    best = None if result.best is None else result.best.numbers
    cells = [
        (
            f"> {number}" if one.numbers == best else str(number),
            *(format_value(result.get_values(one)[place]) for place in varied),
            format_duration(one.plan.ranked_s),
            format_number(one.plan.ranked_cost, 2),
            format_number(one.plan.uncertainty_pct, 0),
            format_number(one.plan.worked_pct, 1),
            format_number(one.plan.energy_kwh if uses_energy else one.plan.fuel_l, 1),
        )
        for number, one in enumerate(rows, start=1)
    ]
    styles = tuple("bold" if one.numbers == best else "" for one in rows)
    return FittedTable(tuple(columns), tuple(cells), styles)


def format_sweep_csv(result: SweepResult) -> str:
    """All plans as CSV, a row each."""
    rows = list_rows(result)
    return format_entries_csv(list(rows[0]) if rows else [], rows)


def format_sweep_json(result: SweepResult) -> str:
    """The sweep as JSON; the guide on sweeps lists the keys."""
    best = result.best
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
            "best": None if best is None else {"row": result.rows.index(best) + 1, **list_values(result, best)},
            "front": [list_values(result, one) for one in result.front],
            "influences": [
                {"option": one.option.key, "time_share": one.time_share, "cost_share": one.cost_share}
                for one in result.influences
            ],
            "without_plan": {"count": sum(not one.plan.feasible for one in result.plans), "reason": result.refusal},
            "plans": list_rows(result),
        },
        EXPORT_DECIMALS,
        is_ascii=False,
    )


def list_values(result: SweepResult, one: SweptPlan) -> dict[str, Any]:
    """A plan as plain values with its command."""
    keys = [option.key for option in result.options]
    options = dict(zip(keys, result.get_values(one), strict=True))
    return {**options, **_list_figures(one.plan), "command": build_command(result, one)}


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
