"""Experiments for people and programs: a self-contained page, terminal tables, JSON."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from reports.figures import to_svg
from reports.trial_figures import panel_figure
from vehicle.trials.sheets.sheet import Comparison, Driven, HeatMap, Panel, Sheet, TextTable

NOTHING = "-"
FAR_PCT = 15.0


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
    return json.dumps(rows, indent=2, allow_nan=False) + "\n"


def drive_json(driven: Driven) -> str:
    """One drive, as the contract of `headland drive --json` has it; no circle is null."""
    content = {
        "radius_m": driven.radius_m,
        "stable": driven.stable,
        "slip_front_deg": driven.slip_front_deg,
        "slip_rear_deg": driven.slip_rear_deg,
        "track": [[round(float(value), 6) for value in row] for row in driven.track],
    }
    return json.dumps(content, allow_nan=False) + "\n"


def sheet_json(sheet: Sheet) -> str:
    """A design study: its words, tables, and the numbers behind its pictures; null is oversteer."""
    content = {
        "study": sheet.name,
        "words": sheet.words,
        "tables": [{"title": t.title, "header": t.header, "rows": t.rows} for t in sheet.tables],
        "panels": [_panel_numbers(panel) for panel in sheet.panels],
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _panel_numbers(panel: Panel | HeatMap) -> dict[str, Any]:
    names = {"title": panel.title, "x": panel.x_label, "y": panel.y_label}
    if isinstance(panel, HeatMap):
        axes = {"x_values": _numbers_of(panel.x), "y_values": _numbers_of(panel.y)}
        return {**names, **axes, "value": panel.value_label, "values": [_numbers_of(row) for row in panel.values]}
    lines = [{"label": line.label, "x": _numbers_of(line.x), "y": _numbers_of(line.y)} for line in panel.lines]
    return {**names, "lines": lines}


def _numbers_of(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 4) if math.isfinite(value) else None for value in values]


def trials_page(sheets: Sequence[Sheet]) -> str:
    """One page that asks for nothing outside itself: words, tables and pictures of every experiment given."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    source = files("reports").joinpath("trial.html.j2").read_text(encoding="utf-8")
    comparisons = [row for sheet in sheets for row in _beside(sheet)]
    content = {
        "title": sheets[0].title if len(sheets) == 1 else "The virtual tractor beside the thesis",
        "sheets": [_content(sheet) for sheet in sheets],
        "count": len(comparisons),
        "known": sum(row.ours is not None for row in comparisons),
    }
    return environment.from_string(source).render(content).rstrip() + "\n"


def _beside(sheet: Sheet) -> tuple[Comparison, ...]:
    """The numbers of an experiment; none when the thesis prints none of them, and tables of its own show ours."""
    return sheet.comparisons if any(row.thesis is not None for row in sheet.comparisons) else ()


def _content(sheet: Sheet) -> dict[str, Any]:
    pictures = [{"title": panel.title, "data": _encoded(to_svg(panel_figure(panel)))} for panel in sheet.panels]
    return {
        "title": sheet.title,
        "words": sheet.words,
        "tables": sheet.tables,
        "pictures": pictures,
        "rows": [_cells(row) for row in _beside(sheet)],
    }


def _encoded(svg: str) -> str:
    return base64.b64encode(svg.encode()).decode("ascii")


def _cells(row: Comparison) -> dict[str, Any]:
    apart = row.difference_pct
    return {
        "experiment": row.experiment,
        "quantity": row.quantity,
        "thesis": _value(row.thesis, row.unit),
        "ours": _value(row.ours, row.unit),
        "difference": NOTHING if apart is None else f"{round(apart, 1) + 0.0:+.1f} %",
        "off": apart is not None and abs(apart) > FAR_PCT,
        "note": row.note,
    }


def _value(value: float | None, unit: str) -> str:
    return NOTHING if value is None else f"{value:.3g} {unit}"


def trials_table(sheets: Sequence[Sheet]) -> RenderableType:
    """Words, small tables and the numbers that have one of ours; what cannot be computed is counted."""
    parts: list[RenderableType] = []
    for sheet in sheets:
        parts.append(Text(sheet.title, style="bold"))
        parts += [Padding(Text(text), (0, 0, 0, 2)) for text in sheet.words]
        parts += [_small_table(table) for table in sheet.tables]
        parts += _numbers(_beside(sheet))
        parts.append(Text(""))
    return Group(*parts)


def _small_table(table: TextTable) -> RenderableType:
    shown = Table(title=table.title, title_justify="left", box=None, pad_edge=False, title_style="")
    for number, header in enumerate(table.header):
        shown.add_column(Text(header), justify="right" if number else "left", overflow="fold")
    for row in table.rows:
        shown.add_row(*(Text(cell) for cell in row))
    return Padding(shown, (1, 0, 0, 2))


def _numbers(rows: Sequence[Comparison]) -> list[RenderableType]:
    known = [row for row in rows if row.ours is not None]
    if not rows:
        return []
    table = Table(box=None, pad_edge=False)
    for header, side in (("Experiment", "left"), ("Quantity", "left"), ("Thesis", "right"), ("Ours", "right"),
                         ("Difference", "right")):  # fmt: skip
        table.add_column(header, justify=side, overflow="fold")  # type: ignore[arg-type]
    for row in known:
        cells = _cells(row)
        names = ("experiment", "quantity", "thesis", "ours", "difference")
        table.add_row(*(Text(str(cells[name])) for name in names))
    parts: list[RenderableType] = [Padding(table, (1, 0, 0, 2))]
    missing = len(rows) - len(known)
    if missing:
        note = f"{missing} further numbers cannot be computed here; --json gives each with its reason."
        parts.append(Padding(Text(note, style="dim"), (0, 0, 0, 2)))
    return parts
