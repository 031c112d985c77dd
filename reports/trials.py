"""Experiments for people and programs: a self-contained page, terminal tables, JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from reports.agreement import FAR_PCT, agreement, off_pct
from reports.figures import to_data
from reports.fitting import Column, FittedTable, sentence
from reports.plain import finite
from reports.template import rendered
from reports.trial_figures import panel_figure
from reports.wording import NOTHING
from vehicle.trials.sheets.sheet import Comparison, Driven, HeatMap, Panel, Proof, Proved, Sheet, TextTable


def trials_json(sheets: Sequence[Sheet]) -> str:
    """Every number of the thesis beside ours, as the contract of `headland validate --json` has it."""
    rows = [
        {
            "experiment": row.experiment,
            "quantity": row.quantity,
            "unit": row.unit,
            "thesis": row.thesis,
            "ours": row.ours,
            "difference_pct": row.difference_pct,
            "note": row.note,
        }
        for sheet in sheets
        for row in sheet.comparisons
    ]
    return json.dumps(finite(rows), indent=2, allow_nan=False) + "\n"


def drive_json(driven: Driven) -> str:
    """One drive, as the contract of `headland drive --json` has it; no circle is null."""
    content = {
        "radius_m": driven.radius_m,
        "stable": driven.stable,
        "slip_front_deg": driven.slip_front_deg,
        "slip_rear_deg": driven.slip_rear_deg,
        "track": [[round(float(value), 6) for value in row] for row in driven.track],
    }
    return json.dumps(finite(content), allow_nan=False) + "\n"


def sheet_json(sheet: Sheet) -> str:
    """A design study: its words, tables, and the numbers behind its pictures; null is oversteer."""
    content = {
        "study": sheet.name,
        "words": sheet.words,
        "tables": [{"title": t.title, "header": t.header, "rows": t.rows} for t in sheet.tables],
        "panels": [_panel_numbers(panel) for panel in sheet.panels],
    }
    return json.dumps(finite(content), indent=2, allow_nan=False) + "\n"


def _panel_numbers(panel: Panel | HeatMap) -> dict[str, Any]:
    names = {"title": panel.title, "x": panel.x_label, "y": panel.y_label}
    if isinstance(panel, HeatMap):
        axes = {"x_values": _numbers_of(panel.x), "y_values": _numbers_of(panel.y)}
        return {**names, **axes, "value": panel.value_label, "values": [_numbers_of(row) for row in panel.values]}
    lines = [{"label": line.label, "x": _numbers_of(line.x), "y": _numbers_of(line.y)} for line in panel.lines]
    return {**names, "lines": lines}


def _numbers_of(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 4) if math.isfinite(value) else None for value in values]


def proved_json(proved: Proved) -> str:
    """The verdict on a tractor file, as the contract of `headland tractor check --json` has it.

    A drive that did not come to its end has null for `driven`; `difference_pct` is null where 0 was asked for.
    """
    content = {
        "tractor": proved.tractor,
        "holds_together": proved.holds_together,
        "words": proved.words,
        "drives": [
            {
                "drive": proof.drive,
                "ground": proof.ground,
                "unit": proof.unit,
                "asked": proof.asked,
                "driven": proof.driven,
                "difference": proof.difference,
                "difference_pct": _pct(proof),
                "tolerance": proof.tolerance,
                "good": proof.good,
            }
            for proof in proved.proofs
        ],
    }
    return json.dumps(finite(content), indent=2, allow_nan=False) + "\n"


def _pct(proof: Proof) -> float | None:
    return None if proof.difference is None or not proof.asked else 100.0 * proof.difference / proof.asked


def trials_page(sheets: Sequence[Sheet]) -> str:
    """One page that asks for nothing outside itself: words, tables and pictures of every experiment given."""
    content = {
        "title": sheets[0].title if len(sheets) == 1 else "The virtual tractor beside the thesis",
        "sheets": [_content(sheet) for sheet in sheets],
        "agreement": agreement(sheets),
    }
    return rendered("trial.html.j2", content)


def _beside(sheet: Sheet) -> tuple[Comparison, ...]:
    """The numbers of an experiment; none when the thesis prints none of them, and tables of its own show ours."""
    return sheet.comparisons if any(row.thesis is not None for row in sheet.comparisons) else ()


def _content(sheet: Sheet) -> dict[str, Any]:
    pictures = [{"title": panel.title, "data": to_data(panel_figure(panel))} for panel in sheet.panels]
    return {
        "title": sheet.title,
        "words": sheet.words,
        "tables": sheet.tables,
        "pictures": pictures,
        "rows": [_cells(row) for row in _beside(sheet)],
    }


def _cells(row: Comparison) -> dict[str, Any]:
    apart = row.difference_pct
    return {
        "experiment": row.experiment,
        "quantity": row.quantity,
        "thesis": _value(row.thesis, row.unit),
        "ours": _value(row.ours, row.unit),
        "difference": NOTHING if apart is None else f"{round(apart, 1) + 0.0:+.1f} %",
        "off": (off_pct(row) or 0.0) > FAR_PCT,
        "note": row.note,
    }


def _value(value: float | None, unit: str) -> str:
    return NOTHING if value is None else f"{value:.3g} {unit}"


def trials_table(sheets: Sequence[Sheet]) -> RenderableType:
    """The verdict, words, small tables and the numbers that have one of ours; what cannot be computed is counted."""
    verdict = agreement(sheets)
    parts: list[RenderableType] = []
    if verdict:
        parts += [sentence(verdict.headline, style="bold"), *map(sentence, verdict.sentences)]
        if len(verdict.rows) > 1:
            parts.append(Padding(_text_table(verdict.header, verdict.rows), (1, 0, 0, 0)))
        parts.append(Text(""))
    for sheet in sheets:
        parts.append(sentence(sheet.title, style="bold"))
        parts += [sentence(text, indent=2) for text in sheet.words]
        parts += [_small_table(table) for table in sheet.tables]
        parts += _numbers(_beside(sheet))
        parts.append(Text(""))
    return Group(*parts)


def _text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> FittedTable:
    columns = tuple(Column(name, words=not number) for number, name in enumerate(header))
    return FittedTable(columns, tuple(tuple(row) for row in rows))


def _small_table(table: TextTable) -> RenderableType:
    return Padding(Group(sentence(table.title), _text_table(table.header, table.rows)), (1, 0, 0, 2))


def _numbers(rows: Sequence[Comparison]) -> list[RenderableType]:
    known = [row for row in rows if row.ours is not None]
    if not rows:
        return []
    figures = map(Column, ("Thesis", "Ours", "Difference"))
    columns = (Column("Experiment", words=True), Column("Quantity", words=True), *figures)
    names = ("experiment", "quantity", "thesis", "ours", "difference")
    cells = tuple(tuple(str(told[name]) for name in names) for told in map(_cells, known))
    parts: list[RenderableType] = [Padding(FittedTable(columns, cells), (1, 0, 0, 2))] if cells else []
    missing = len(rows) - len(known)
    if missing:
        note = f"{missing} further numbers cannot be computed here; --json gives each with its reason."
        parts.append(sentence(note, style="dim", indent=2))
    return parts
