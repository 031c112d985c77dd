"""The page of many fields: totals, the best plan of each in a table and on a small map, and all plans by field."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from reports.common.rendering import render_template
from reports.common.wording import (
    format_area_or_dash,
    format_duration,
    format_number,
    format_price,
    insert_non_breaking_spaces,
)
from reports.plan.many_fields import (
    MAP_KEY,
    FieldRecord,
    RecordsTable,
    describe_records,
    get_best_plan,
    get_stated_plan_cost,
    get_stated_plan_s,
    list_records_without_plan,
    list_shortfalls,
    tabulate_records,
)
from reports.plan.many_fields_screen import list_many_sentences

PLAN_HEAD = ("Plan", "Time", "Cost", "Worked %", "Unworked", "Driven over m2", "Headland")
MAX_PLANS = 10  # of one field; the others are in CSV and JSON
PAGE_HEADINGS = ("Field", "Time", "Cost", "In time %", "Worked %", "Width", "Tractors", "Strategy", "ha")
"""Columns in the order of the page, on which those to the right may be hidden; the layout is in CSV and JSON."""


def render_many_fields_page(records: Sequence[FieldRecord]) -> str:
    """The page as HTML text; records with a plan may have a small map under `MAP_KEY`."""
    table = tabulate_records(records)
    sections = [
        _build_section(record, f"field-{number}", _has_widths(records))
        for number, record in enumerate(records)
        if get_best_plan(record)
    ]
    anchors = [f"field-{number}" if get_best_plan(record) else "" for number, record in enumerate(records)]
    places = _list_places(table)
    maps = [one["map"] for one in sections if one["map"]]
    return render_template(
        "many_fields.html.j2",
        {
            "title": f"{len({record['requested_field'] for record in records})} fields: plans",
            "machines": _describe_machines(records),
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


def _list_places(table: RecordsTable) -> list[int]:
    """The columns that the page shows, as places in the table."""
    headings = [column.heading for column in table.columns]
    return [headings.index(heading) for heading in PAGE_HEADINGS if heading in headings]


def _has_widths(records: Sequence[FieldRecord]) -> bool:
    return len({record["width_m"] for record in records}) > 1


def _describe_machines(records: Sequence[FieldRecord]) -> str | None:
    """Tractor and implement, where they are the same for all fields."""
    scenarios = [record["ranking"]["scenario"] for record in records if record["ranking"]]
    names = {f"{one['tractor']}, {one.get('implement') or 'implement'} {one['width_m']:g} m" for one in scenarios}
    return names.pop() if len(names) == 1 else None


def _build_section(record: FieldRecord, anchor: str, names_width: bool) -> dict[str, Any]:
    """One field at one width: map, what to do, and its feasible plans."""
    ranking = record["ranking"]
    best = get_best_plan(record)
    name = ranking["field"]["name"] + (f", {record['width_m']:g} m" if names_width else "")
    plans = [plan for plan in ranking["plans"] if plan["feasible"]]
    return {
        "name": name,
        "anchor": anchor,
        "map": record.get(MAP_KEY),
        "facts": insert_non_breaking_spaces(_list_facts(ranking, best or {})),
        "summary": ranking.get("summary", []),
        "rows": [{"best": _is_same(plan, best), "cells": _build_plan_cells(plan)} for plan in plans[:MAX_PLANS]],
    }


def _list_facts(ranking: Mapping[str, Any], best: Mapping[str, Any]) -> str:
    area = f"{ranking['field']['area_ha']:.2f} ha"
    cost = f"{format_price(get_stated_plan_cost(best))} {ranking.get('currency') or ''}".strip()
    return f"{area}, {format_duration(get_stated_plan_s(best))}, {cost}"


def _is_same(plan: Mapping[str, Any], best: Mapping[str, Any] | None) -> bool:
    return best is not None and (plan["strategy"], plan["tractors"]) == (best["strategy"], best["tractors"])


def _build_plan_cells(plan: Mapping[str, Any]) -> tuple[str, ...]:
    count = plan["tractors"]
    headland = f"{plan['headland_passes']} x {plan.get('headland_order') or ''}" if plan.get("headland_passes") else ""
    return (
        f"{count} {'tractor' if count == 1 else 'tractors'}, {plan['strategy']}",
        format_duration(get_stated_plan_s(plan)),
        format_price(get_stated_plan_cost(plan)),
        format_number(plan.get("worked_pct"), 1),
        format_area_or_dash(plan.get("missed_m2")),
        format_number(plan.get("over_finished_m2"), 0),
        headland.strip(" x"),
    )
