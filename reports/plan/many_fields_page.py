"""The page of many fields: totals, the best plan of each in a table and on a small map, and all plans by field."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from reports.common.plan_results import PlanRanking, PlanResult, get_stated_cost
from reports.common.rendering import render_template
from reports.common.wording import format_money, format_tractor_count, insert_non_breaking_spaces
from reports.plan.answer import write_answer
from reports.plan.figures import FIGURES
from reports.plan.many_fields import (
    FieldRow,
    describe_records,
    list_many_sentences,
    list_records_without_plan,
    list_shortfalls,
    tabulate_records,
)
from reports.plan.plan_wording import list_feasible

PLAN_HEAD = ("Plan", "Time", "Cost", "Worked %", "Unworked", "Driven over m2", "Headland")
PLAN_CELLS = ("stated_end_s", "stated_cost", "worked_pct", "missed_m2", "over_finished_m2")
MAX_PLANS = 10  # of one field; the others are in CSV and JSON
PAGE_HEADINGS = ("Field", "Time", "Cost", "In time %", "Worked %", "Width", "Tractors", "Strategy", "ha")
"""Columns in the order of the page, on which those to the right may be hidden; the layout is in CSV and JSON."""


def render_many_fields_page(records: Sequence[FieldRow]) -> str:
    """The page as HTML text; records with a plan may have a small map."""
    table = tabulate_records(records)
    has_widths = len({record.label for record in records}) > 1
    anchors = [f"field-{number}" if record.best else "" for number, record in enumerate(records)]
    sections = [
        _build_section(record, record.ranking, record.best, anchor, has_widths)
        for record, anchor in zip(records, anchors, strict=True)
        if record.ranking is not None and record.best is not None
    ]
    headings = [column.heading for column in table.columns]
    places = [headings.index(heading) for heading in PAGE_HEADINGS if heading in headings]
    maps = [one["map"] for one in sections if one["map"]]
    scenarios = [record.ranking.scenario for record in records if record.ranking is not None]
    machines = {f"{one['tractor']}, {one.get('implement') or 'implement'} {one['width_m']:g} m" for one in scenarios}
    return render_template(
        "many_fields.html.j2",
        {
            "title": f"{len({record.requested_field for record in records})} fields: plans",
            "machines": machines.pop() if len(machines) == 1 else None,
            "lead": insert_non_breaking_spaces(" ".join([*list_shortfalls(records), *list_many_sentences(records)])),
            "columns": [table.columns[place] for place in places],
            "rows": [
                {"cells": [row[place] for place in places], "is_total": row in table.total_rows, "anchor": anchor}
                for row, anchor in zip(table.rows, anchors + [""] * len(table.total_rows), strict=True)
            ],
            "legend": ["The best plan of each field. Times are h:mm:ss.", *describe_records(records)[1:]],
            "without": list_records_without_plan(records),
            "sections": sections,
            "plan_head": PLAN_HEAD,
            "has_missed": any(one["missed"] for one in maps),
            "has_driven_over": any(one["driven_over"] for one in maps),
        },
    )


def _build_section(
    record: FieldRow, ranking: PlanRanking, best: PlanResult, anchor: str, names_width: bool
) -> dict[str, Any]:
    """One field at one width: map, what to do, and its feasible plans."""
    cost = format_money(get_stated_cost(best), ranking.currency)
    rows = []
    for plan in list_feasible(ranking)[:MAX_PLANS]:
        headland = f"{plan.headland_passes} x {plan.headland_order or ''}" if plan.headland_passes else ""
        figures = (FIGURES[key].format(plan) for key in PLAN_CELLS)
        name = f"{format_tractor_count(plan.tractors)}, {plan.strategy}"
        rows.append({"best": plan is best, "cells": (name, *figures, headland.strip(" x"))})
    facts = f"{ranking.area_ha:.2f} ha, {FIGURES['stated_end_s'].format(best)}, {cost}"
    return {
        "name": ranking.field_name + (f", {record.label:g} m" if names_width else ""),
        "anchor": anchor,
        "map": record.map,
        "facts": insert_non_breaking_spaces(facts),
        "summary": write_answer(ranking).list_sentences(),
        "rows": rows,
    }
