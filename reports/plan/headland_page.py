"""The page of a comparison of headlands: the answer, tables, and a small map of every plan; it loads nothing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from reports.common.rendering import render_template
from reports.common.wording import format_duration, format_number, insert_non_breaking_spaces
from reports.plan.headland_comparison import HeadlandComparison, HeadlandTotals, list_cut_off, list_missing, name_choice
from reports.plan.headland_report import (
    describe_comparison,
    describe_figures,
    format_cost_per_ha,
    tabulate_fields,
    tabulate_ways,
)
from reports.plan.plan_wording import describe_machines


def render_headland_page(comparison: HeadlandComparison) -> str:
    """The page as HTML text."""
    names = list(comparison.field_names.values())
    fields = tabulate_fields(comparison)
    head, rows = _tabulate(comparison, comparison.totals, comparison.best)
    rankings = [each.ranking for each in comparison.rows if each.ranking is not None]
    maps = [each.map for each in comparison.rows if each.map is not None]
    return render_template(
        "headland_comparison.html.j2",
        {
            "title": f"Headlands compared: {names[0] if len(names) == 1 else f'{len(names)} fields'}",
            "machines": "; ".join(dict.fromkeys(filter(None, map(describe_machines, rankings)))),
            "answer": [insert_non_breaking_spaces(text) for text in describe_comparison(comparison)],
            "head": head,
            "rows": rows,
            "help": f"{describe_figures(comparison)} Times are h:mm:ss.",
            "field_head": [column.heading for column in fields.columns],
            "field_rows": [{"best": False, "cells": cells} for cells in fields.rows],
            "cut_off": list_cut_off(comparison),
            "missing": list_missing(comparison),
            "fields": [_build_section(comparison, field) for field in comparison.fields],
            "has_missed": any(one["missed"] for one in maps),
            "has_driven_over": any(one["driven_over"] for one in maps),
            "remarks": list(dict.fromkeys(remark for one in rankings for remark in one.field_remarks)),
        },
    )


def _tabulate(
    comparison: HeadlandComparison, totals: Sequence[HeadlandTotals], best: HeadlandTotals | None
) -> tuple[list[str], list[dict[str, Any]]]:
    """Headings and rows of a table of ways."""
    table = tabulate_ways(comparison, totals, best)
    rows = [{"best": one is best, "cells": cells} for one, cells in zip(totals, table.rows, strict=True)]
    return [column.heading for column in table.columns], rows


def _build_section(comparison: HeadlandComparison, field: str) -> dict[str, Any]:
    """One field: its table and its maps, the best way first."""
    totals = comparison.totals_by_field[field]
    driven = [one for one in totals if one.driven]
    best = driven[0] if driven else None
    return {
        "name": comparison.field_names[field],
        "area": format_number(best.area_ha, 2) if best else "",
        "rows": _tabulate(comparison, totals, best)[1],
        "cards": [
            {
                "name": name_choice(one),
                "best": one is best,
                "map": one.plans[0].map,
                "text": insert_non_breaking_spaces(", ".join(_list_card_figures(one, comparison))),
            }
            for one in driven
            if one.plans[0].map is not None
        ],
    }


def _list_card_figures(totals: HeadlandTotals, comparison: HeadlandComparison) -> list[str]:
    """The figures below a map."""
    return [
        format_duration(totals.time_s),
        format_cost_per_ha(totals, comparison),
        *([] if totals.fuel_l is None else [f"{totals.fuel_l:.0f} l"]),
        *([] if totals.energy_kwh is None else [f"{totals.energy_kwh:.0f} kWh"]),
        f"missed {totals.missed_m2:.0f} m2",
        f"overlap {totals.overlap_m2:.0f} m2",
        f"driven over {totals.over_finished_m2:.0f} m2",
    ]
