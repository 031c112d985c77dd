"""Experiments of the thesis, how closely they agree with it, design studies and tractor checks: page, tables, JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from reports.common.rendering import format_json, make_json_safe, render_template
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.wording import NO_VALUE, join_list
from reports.plan.map_figure import encode_svg_base64
from reports.trials.figures import draw_panel
from vehicle.trials.sheets.sheet import (
    ExperimentSheet,
    HeatMap,
    PlotPanel,
    SteeredDrive,
    ThesisComparison,
    TractorVerdict,
)

NEAR_PCT, FAR_PCT = 5.0, 15.0


@dataclass(frozen=True)
class ThesisAgreement:
    """The agreement: a headline, further sentences, and a row per experiment under `header`."""

    headline: str
    sentences: tuple[str, ...]
    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class _AgreementCount:
    """Numbers of the thesis by their deviation here, and those that cannot be compared."""

    title: str
    near_count: int
    fair_count: int
    far_count: int
    uncompared_count: int

    @property
    def total(self) -> int:
        return self.near_count + self.fair_count + self.far_count + self.uncompared_count


def measure_thesis_agreement(sheets: Sequence[ExperimentSheet]) -> ThesisAgreement | None:
    """The agreement over some experiments; None when the thesis prints no number for any of them."""
    counts = [_count_agreement(sheet.title, sheet.comparisons) for sheet in sheets]
    total = _count_agreement("All", [row for sheet in sheets for row in sheet.comparisons])
    if not total.total:
        return None
    compared = total.total - total.uncompared_count
    headline = (
        f"{compared} of {total.total} numbers of the thesis are reproduced: {total.near_count} within {NEAR_PCT:g} %, "
        f"{total.fair_count} more within {FAR_PCT:g} %; {total.far_count} differ by more."
    )
    header = ("Experiment", "Numbers", f"Within {NEAR_PCT:g} %", f"Within {FAR_PCT:g} %", "Farther", "Not compared")
    counted = [one for one in counts if one.total]
    shown = [*counted, *([total] if len(counted) > 1 else [])]
    rows = tuple(
        (one.title, *map(str, (one.total, one.near_count, one.fair_count, one.far_count, one.uncompared_count)))
        for one in shown
    )
    sentences = []
    if total.far_count and len(counts) > 1:
        named = join_list(f"{one.title} ({one.far_count})" for one in counts if one.far_count)
        sentences.append(f"Differ by more than {FAR_PCT:g} %: {named}.")
    if total.uncompared_count:
        sentences.append(f"{total.uncompared_count} cannot be compared; each is listed with the reason.")
    ours = sum(row.thesis is None and row.ours is not None for sheet in sheets for row in sheet.comparisons)
    if ours:
        sentences.append(f"{ours} further simulated numbers are not in the thesis.")
    return ThesisAgreement(headline, tuple(sentences), header, rows)


def compute_deviation_pct(row: ThesisComparison) -> float | None:
    """Deviation from the printed number in percent, rounded to the decimal that tables show."""
    return None if row.difference_pct is None else round(abs(row.difference_pct), 1)


def _count_agreement(title: str, rows: Iterable[ThesisComparison]) -> _AgreementCount:
    printed = [row for row in rows if row.thesis is not None]
    off = [value for row in printed if (value := compute_deviation_pct(row)) is not None]
    near, fair = sum(value <= NEAR_PCT for value in off), sum(NEAR_PCT < value <= FAR_PCT for value in off)
    return _AgreementCount(title, near, fair, len(off) - near - fair, len(printed) - len(off))


def format_trials_json(sheets: Sequence[ExperimentSheet]) -> str:
    """Every number of the thesis beside the simulated one: the output of `headland validate --json`."""
    keys = ("experiment", "quantity", "unit", "thesis", "ours", "difference_pct", "note")
    rows = [{key: getattr(row, key) for key in keys} for sheet in sheets for row in sheet.comparisons]
    return format_json(rows)


def format_drive_json(driven: SteeredDrive) -> str:
    """One drive: the output of `headland drive --json`; `radius_m` is null without a circle."""
    content = {key: getattr(driven, key) for key in ("radius_m", "stable", "slip_front_deg", "slip_rear_deg")}
    content["track"] = [[round(float(value), 6) for value in row] for row in driven.trace_rows]
    return json.dumps(make_json_safe(content), allow_nan=False) + "\n"


def format_experiment_json(sheet: ExperimentSheet) -> str:
    """A design study: sentences, tables and the numbers of its pictures; null is oversteer."""
    content = {
        "study": sheet.name,
        "words": sheet.words,
        "tables": [{"title": t.title, "header": t.header, "rows": t.rows} for t in sheet.tables],
        "panels": [_build_panel_entry(panel) for panel in sheet.panels],
    }
    return format_json(content)


def _build_panel_entry(panel: PlotPanel | HeatMap) -> dict[str, Any]:
    names = {"title": panel.title, "x": panel.x_label, "y": panel.y_label}
    if isinstance(panel, HeatMap):
        axes = {"x_values": _round_numbers(panel.x), "y_values": _round_numbers(panel.y)}
        return {**names, **axes, "value": panel.value_label, "values": [_round_numbers(row) for row in panel.values]}
    lines = [{"label": line.label, "x": _round_numbers(line.x), "y": _round_numbers(line.y)} for line in panel.lines]
    return {**names, "lines": lines}


def _round_numbers(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 4) if math.isfinite(value) else None for value in values]


def format_tractor_check_json(proved: TractorVerdict) -> str:
    """The verdict on a tractor file: the output of `headland tractor check --json`.

    `achieved` is null for a drive that did not end, `difference_pct` where the target is 0.
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
                "target": proof.expected,
                "achieved": proof.driven,
                "difference": proof.difference,
                "difference_pct": None
                if proof.difference is None or not proof.expected
                else 100.0 * proof.difference / proof.expected,
                "tolerance": proof.tolerance,
                "good": proof.is_good,
            }
            for proof in proved.checks
        ],
    }
    return format_json(content)


def render_trials_page(sheets: Sequence[ExperimentSheet]) -> str:
    """One page that loads nothing from elsewhere: sentences, tables and pictures of every experiment."""
    content = {
        "title": sheets[0].title if len(sheets) == 1 else "The virtual tractor beside the thesis",
        "sheets": [
            {
                "title": sheet.title,
                "words": sheet.words,
                "tables": sheet.tables,
                "pictures": [
                    {"title": panel.title, "data": encode_svg_base64(draw_panel(panel))} for panel in sheet.panels
                ],
                "rows": [_build_comparison_cells(row) for row in _list_compared_numbers(sheet)],
            }
            for sheet in sheets
        ],
        "agreement": measure_thesis_agreement(sheets),
    }
    return render_template("trial.html.j2", content)


def _list_compared_numbers(sheet: ExperimentSheet) -> tuple[ThesisComparison, ...]:
    """The numbers of an experiment; none when the thesis prints none of them."""
    return sheet.comparisons if any(row.thesis is not None for row in sheet.comparisons) else ()


def _build_comparison_cells(row: ThesisComparison) -> dict[str, Any]:
    difference_pct = row.difference_pct
    return {
        "experiment": row.experiment,
        "quantity": row.quantity,
        "thesis": _format_with_unit(row.thesis, row.unit),
        "ours": _format_with_unit(row.ours, row.unit),
        "difference": NO_VALUE if difference_pct is None else f"{round(difference_pct, 1) + 0.0:+.1f} %",
        "off": (compute_deviation_pct(row) or 0.0) > FAR_PCT,
        "note": row.note,
    }


def _format_with_unit(value: float | None, unit: str) -> str:
    return NO_VALUE if value is None else f"{value:.3g} {unit}"


def build_trials_table(sheets: Sequence[ExperimentSheet]) -> RenderableType:
    """Agreement, sentences, tables and compared numbers of experiments; numbers without a simulated one are counted."""
    verdict = measure_thesis_agreement(sheets)
    parts: list[RenderableType] = []
    if verdict:
        parts += [format_sentence(verdict.headline, style="bold"), *map(format_sentence, verdict.sentences)]
        if len(verdict.rows) > 1:
            parts.append(Padding(_build_text_table(verdict.header, verdict.rows), (1, 0, 0, 0)))
        parts.append(Text(""))
    for sheet in sheets:
        parts.append(format_sentence(sheet.title, style="bold"))
        parts += [format_sentence(text, indent=2) for text in sheet.words]
        for table in sheet.tables:
            titled = Group(format_sentence(table.title), _build_text_table(table.header, table.rows))
            parts.append(Padding(titled, (1, 0, 0, 2)))
        parts += _build_number_comparison(_list_compared_numbers(sheet))
        parts.append(Text(""))
    return Group(*parts)


def _build_text_table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> FittedTable:
    columns = tuple(TableColumn(name, is_text=not number) for number, name in enumerate(header))
    return FittedTable(columns, tuple(tuple(row) for row in rows))


def _build_number_comparison(rows: Sequence[ThesisComparison]) -> list[RenderableType]:
    computed = [row for row in rows if row.ours is not None]
    if not rows:
        return []
    figures = map(TableColumn, ("Thesis", "Here", "Difference"))
    columns = (TableColumn("Experiment", is_text=True), TableColumn("Quantity", is_text=True), *figures)
    names = ("experiment", "quantity", "thesis", "ours", "difference")
    cells = tuple(tuple(str(entry[name]) for name in names) for entry in map(_build_comparison_cells, computed))
    parts: list[RenderableType] = [Padding(FittedTable(columns, cells), (1, 0, 0, 2))] if cells else []
    missing = len(rows) - len(computed)
    if missing:
        note = f"{missing} further numbers cannot be simulated; --json gives the reasons."
        parts.append(format_sentence(note, style="dim", indent=2))
    return parts
