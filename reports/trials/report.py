"""Experiments of the thesis, design studies, tractor checks and the fleet study: figures, page, tables and JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.text import Text

from reports.common import palette
from reports.common.language import mark_text
from reports.common.rendering import (
    EXPORT_DECIMALS,
    ReportError,
    ResultView,
    ShownResult,
    build_view,
    create_figure,
    format_json,
    make_json_safe,
    pick_values,
    render_template,
)
from reports.common.text_tables import (
    FittedTable,
    build_plain_table,
    format_bullet,
    format_sentence,
    format_title,
    render_fragment,
)
from reports.common.wording import NO_VALUE, format_minutes, format_number, format_signed_number, join_list
from reports.plan.map_figure import encode_svg_base64
from vehicle.trials.sheets.sheet import (
    ExperimentSheet,
    HeatMap,
    PlotPanel,
    SteeredDrive,
    ThesisComparison,
    TractorVerdict,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STAGE_STYLES = {
    1: ("holds (stage 1)", "#8A8A8A"),
    2: ("follows (stage 2)", "#0072B2"),
    3: ("slews (stage 3)", "#D55E00"),
}
_FIGURE_COLUMNS = 2
NEAR_PCT, FAR_PCT = 5.0, 15.0


def draw_panel(panel: PlotPanel | HeatMap) -> Figure:
    """One panel on its own."""
    width, height = 7.0, 0.62 * 7.0
    if not isinstance(panel, HeatMap) and panel.equal_axes:  # to scale, as high as its lines need, within limits
        x, y = (np.ptp(np.concatenate([getattr(line, name) for line in panel.lines])) for name in ("x", "y"))
        height = float(np.clip(y / max(x, 1e-9) * width, 0.35 * width, 1.1 * width)) + 0.6
    figure = create_figure(width, height, layout="constrained")
    _draw_axes(figure.add_subplot(), panel)
    return figure


def draw_experiment_panels(sheet: ExperimentSheet) -> Figure:
    """All panels of an experiment, two in a row; raises ReportError where the experiment has no pictures."""
    if not sheet.panels:
        raise ReportError(f"The experiment {sheet.name!r} has no pictures; leave the picture out.")
    rows = -(-len(sheet.panels) // _FIGURE_COLUMNS)
    figure = create_figure(13.0, 4.6 * rows, layout="constrained")
    for number, panel in enumerate(sheet.panels):
        _draw_axes(figure.add_subplot(rows, _FIGURE_COLUMNS, number + 1), panel)
    figure.suptitle(sheet.title, x=0.01, ha="left", fontsize=14, color=palette.INK_COLOUR)
    return figure


def _draw_axes(axes: Axes, panel: PlotPanel | HeatMap) -> None:
    axes.set_title(panel.title, loc="left", fontsize=11, color=palette.INK_COLOUR)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.spines[["top", "right"]].set_visible(False)
    if isinstance(panel, HeatMap):
        from matplotlib.colors import LogNorm
        from matplotlib.patches import Patch

        values = np.ma.masked_invalid(panel.values)
        wide = values.count() and values.max() > 3.0 * values.min()
        norm = LogNorm(float(values.min()), float(values.max())) if wide else None
        mesh = axes.pcolormesh(panel.x, panel.y, values, cmap="viridis", norm=norm, shading="nearest")
        axes.set_facecolor("#D9D9D9")
        axes.set_xticks(panel.x)
        bar = axes.figure.colorbar(mesh, ax=axes)
        bar.set_label(panel.value_label)
        if wide:
            ticks = [tick for tick in (1, 2, 5, 10, 20, 50, 100, 200, 500) if values.min() <= tick <= values.max()]
            bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
            bar.minorticks_off()
        patch = Patch(facecolor="#D9D9D9", edgecolor="#8A8A8A", label=panel.missing)
        axes.legend(handles=[patch], fontsize=8, loc="upper right", framealpha=0.9, edgecolor="none")
        return
    axes.grid(color="#E4E4E4", linewidth=0.6)
    for line in panel.lines:
        step = max(1, len(line.x) // 1500)
        x, y = line.x[::step], line.y[::step]
        if line.stages is None:
            axes.plot(
                x, y, color=palette.get_tractor_colour(line.colour), linestyle=(0, (5, 3)) if line.dashed else "solid",
                linewidth=1.4, marker="o" if len(x) < 40 else None, markersize=4, label=line.label,
            )  # fmt: skip
            continue
        stages = line.stages[::step]
        for stage, (label, colour) in _STAGE_STYLES.items():
            inside = stages[1:] == stage
            if (stages == stage).any():
                shown = np.where(np.concatenate([inside, [False]]) | np.concatenate([[False], inside]), y, np.nan)
                axes.plot(x, shown, color=colour, linewidth=1.8, label=f"wheel angle {label}")
    if panel.missing:  # crosses at the lower edge, a row per line, where a line has no value
        low, high = axes.get_ylim()
        axes.set_ylim(low - 0.03 * len(panel.lines) * (high - low), high)
        style: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 5}
        for row, line in enumerate(panel.lines):
            x = line.x[np.isnan(line.y)]
            edge, colour = np.full(len(x), 0.02 + 0.03 * row), palette.get_tractor_colour(line.colour)
            axes.plot(x, edge, color=colour, transform=axes.get_xaxis_transform(), **style)
        axes.plot([], [], color=palette.INK_COLOUR, label=panel.missing, **style)
    if panel.equal_axes:
        axes.set_aspect("equal", adjustable="datalim")
    if len(panel.lines) > 1 or panel.lines[0].stages is not None:
        axes.legend(fontsize=8, frameon=True, framealpha=0.85, edgecolor="none")


@dataclass(frozen=True)
class ThesisAgreement:
    """The agreement: a headline, further sentences, and a table with a row per experiment."""

    headline: str
    sentences: tuple[str, ...]
    table: FittedTable


def measure_thesis_agreement(sheets: Sequence[ExperimentSheet]) -> ThesisAgreement | None:
    """The agreement over some experiments; None when the thesis prints no number for any of them."""
    counts = [(sheet.title, *_count_agreement(sheet.comparisons)) for sheet in sheets]
    total, near, fair, far, uncompared = _count_agreement(row for sheet in sheets for row in sheet.comparisons)
    if not total:
        return None
    headline = (
        f"{total - uncompared} of {total} numbers of the thesis are reproduced: {near} within {NEAR_PCT:g} %, "
        f"{fair} more within {FAR_PCT:g} %; {far} differ by more."
    )
    header = ("Experiment", "Numbers", f"Within {NEAR_PCT:g} %", f"Within {FAR_PCT:g} %", "Farther", "Not compared")
    shown = [one for one in counts if one[1]]
    shown += [("All", total, near, fair, far, uncompared)] if len(shown) > 1 else []
    table = build_plain_table(header, (tuple(map(str, one)) for one in shown))
    sentences = []
    if far and len(counts) > 1:
        named = join_list(f"{title} ({count})" for title, *_, count, _ in counts if count)
        sentences.append(f"Differ by more than {FAR_PCT:g} %: {named}.")
    if uncompared:
        sentences.append(f"{uncompared} cannot be compared; each is listed with the reason.")
    ours = sum(row.thesis is None and row.ours is not None for sheet in sheets for row in sheet.comparisons)
    if ours:
        sentences.append(f"{ours} further simulated numbers are not in the thesis.")
    return ThesisAgreement(headline, tuple(sentences), table)


def compute_deviation_pct(row: ThesisComparison) -> float | None:
    """Deviation from the printed number in percent, rounded to the decimal that tables show."""
    return None if row.difference_pct is None else round(abs(row.difference_pct), 1)


def _count_agreement(rows: Iterable[ThesisComparison]) -> tuple[int, int, int, int, int]:
    """How many numbers of the thesis there are, by their deviation here, and how many cannot be compared."""
    printed = [row for row in rows if row.thesis is not None]
    off = [value for row in printed if (value := compute_deviation_pct(row)) is not None]
    near, fair = sum(value <= NEAR_PCT for value in off), sum(NEAR_PCT < value <= FAR_PCT for value in off)
    return len(printed), near, fair, len(off) - near - fair, len(printed) - len(off)


def format_trials_json(sheets: Sequence[ExperimentSheet]) -> str:
    """Every number of the thesis beside the simulated one: the output of `headland validate --json`."""
    keys = ("experiment", "quantity", "unit", "thesis", "ours", "difference_pct", "note")
    return format_json([pick_values(row, keys) for sheet in sheets for row in sheet.comparisons])


def format_drive_json(driven: SteeredDrive) -> str:
    """One drive: the output of `headland drive --json`; `radius_m` is null without a circle."""
    content = pick_values(driven, ("radius_m", "stable", "slip_front_deg", "slip_rear_deg"))
    content["track"] = [[round(float(value), 6) for value in row] for row in driven.trace_rows]
    return json.dumps(make_json_safe(content), allow_nan=False) + "\n"


def format_experiment_json(sheet: ExperimentSheet) -> str:
    """A design study: sentences, tables and the numbers of its pictures; null is oversteer."""
    panels = []
    for panel in sheet.panels:
        entry: dict[str, Any] = {"title": panel.title, "x": panel.x_label, "y": panel.y_label}
        if isinstance(panel, HeatMap):
            entry |= {"x_values": _round_numbers(panel.x), "y_values": _round_numbers(panel.y)}
            entry |= {"value": panel.value_label, "values": [_round_numbers(row) for row in panel.values]}
        else:
            entry["lines"] = [
                {"label": line.label, "x": _round_numbers(line.x), "y": _round_numbers(line.y)} for line in panel.lines
            ]
        panels.append(entry)
    tables = [pick_values(table, ("title", "header", "rows")) for table in sheet.tables]
    return format_json({"study": sheet.name, "words": sheet.words, "tables": tables, "panels": panels})


def _round_numbers(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 4) if math.isfinite(value) else None for value in values]


def format_tractor_check_json(verdict: TractorVerdict) -> str:
    """The verdict on a tractor file: the output of `headland tractor check --json`.

    `achieved` is null for a drive that did not end, `difference_pct` where the target is 0.
    """
    content = {
        **pick_values(verdict, ("tractor", "holds_together", "words")),
        "drives": [
            {
                **pick_values(check, ("drive", "ground", "unit")),
                "target": check.expected,
                "achieved": check.driven,
                "difference": check.difference,
                "difference_pct": None
                if check.difference is None or not check.expected
                else 100.0 * check.difference / check.expected,
                "tolerance": check.tolerance,
                "good": check.is_good,
            }
            for check in verdict.checks
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
                "tables": [
                    {"title": table.title, "cells": build_plain_table(table.header, table.rows)}
                    for table in sheet.tables
                ],
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
        if len(verdict.table.rows) > 1:
            parts.append(Padding(verdict.table, (1, 0, 0, 0)))
        parts.append(Text(""))
    for sheet in sheets:
        parts.append(format_sentence(sheet.title, style="bold"))
        parts += [format_sentence(text, indent=2) for text in sheet.words]
        for table in sheet.tables:
            titled = Group(format_sentence(table.title), build_plain_table(table.header, table.rows))
            parts.append(Padding(titled, (1, 0, 0, 2)))
        numbers = _list_compared_numbers(sheet)
        compared = [_build_comparison_cells(row) for row in numbers if row.ours is not None]
        if compared:
            names = ("experiment", "quantity", "thesis", "ours", "difference")
            cells = (tuple(str(entry[name]) for name in names) for entry in compared)
            headings = (mark_text("Experiment"), mark_text("Quantity"), "Thesis", "Here", "Difference")
            parts.append(Padding(build_plain_table(headings, cells, (0, 1)), (1, 0, 0, 2)))
        if len(numbers) > len(compared):
            missing = len(numbers) - len(compared)
            note = f"{missing} further numbers cannot be simulated; --json gives the reasons."
            parts.append(format_sentence(note, style="dim", indent=2))
        parts.append(Text(""))
    return Group(*parts)


@dataclass(frozen=True)
class ThesisTableRow:
    """One row of a table of the thesis beside the simulated time."""

    label: str
    tractors: int
    thesis_s: float
    time_s: float | None
    difference_pct: float | None
    note: str = ""


@dataclass(frozen=True)
class ThesisClaim:
    """A claim of the thesis, and whether the simulation confirms it."""

    claim: str
    holds: bool
    why: str


@dataclass(frozen=True, repr=False)
class FleetStudy(ShownResult):
    """Tables 6.1 to 6.3 beside the thesis, its claims, and the one set of assumptions behind every row."""

    tables: dict[str, tuple[ThesisTableRow, ...]]
    claims: tuple[ThesisClaim, ...]
    assumptions: tuple[str, ...]


def build_study_tables(study: FleetStudy) -> RenderableType:
    """Tables of the thesis beside the simulation, then each claim with its verdict, then the assumptions."""
    parts: list[RenderableType] = []
    for name, rows in study.tables.items():
        has_notes = any(row.note for row in rows)
        headings = ("Plan", "Tractors", "Thesis", "Here", "Diff. %", *([mark_text("Note")] if has_notes else []))
        cells = (
            (row.label, str(row.tractors), format_minutes(row.thesis_s), format_minutes(row.time_s),
             format_signed_number(row.difference_pct, 1), *([row.note] if has_notes else []))
            for row in rows
        )  # fmt: skip
        parts += [format_title(f"Table {name}"), build_plain_table(headings, cells, (0, 5)), Text("")]
    if study.claims:
        verdicts = ((one.claim, "holds" if one.holds else "does not hold here", one.why) for one in study.claims)
        styles = tuple("" if one.holds else "yellow" for one in study.claims)
        headings = ("Claim", "Verdict", "Why")
        table = build_plain_table(headings, verdicts, (0, 1, 2), styles=styles)
        parts += [format_title("Claims of the thesis"), table, Text("")]
    if study.assumptions:
        parts.append(format_title("Assumptions behind every row"))
        parts += [format_bullet(text) for text in study.assumptions]
    return Group(*parts)


def format_study_json(study: FleetStudy) -> str:
    """The study as JSON text with a trailing newline: ``tables``, ``claims`` and ``assumptions``."""
    return format_json(study, EXPORT_DECIMALS, is_ascii=False)


@build_view.register
def build_study_view(study: FleetStudy) -> ResultView:
    """The fleet study: rows beside the thesis, and its claims."""
    held = sum(claim.holds for claim in study.claims)
    summary = f"{held} of {len(study.claims)} claims of the thesis hold in the simulation"
    named_rows = [(name, row) for name, table in study.tables.items() for row in table]

    def render() -> str:
        rows = (
            (name, row.label, str(row.tractors), format_minutes(row.thesis_s), format_minutes(row.time_s),
             format_number(row.difference_pct, 1), row.note)
            for name, row in named_rows
        )  # fmt: skip
        headings = ("Table", "Row", "Tractors", "Thesis, min:s", "Simulated, min:s", "Difference %", "Note")
        claims = ((claim.claim, "yes" if claim.holds else "no", claim.why) for claim in study.claims)
        claim_headings = ("Claim", "Holds", "Why")
        verdicts = build_plain_table(claim_headings, claims, (0, 1, 2))
        return render_fragment(f"{summary}.", [], [build_plain_table(headings, rows, (0, 1, 6)), verdicts])

    def draw(axes: Axes) -> None:
        """Minutes of the thesis and of the simulation, two bars per row."""
        for place, (_, row) in enumerate(named_rows):
            axes.barh(place - 0.2, row.thesis_s / 60.0, height=0.38, color=palette.TRACTOR_COLOURS[4])
            axes.barh(place + 0.2, (row.time_s or 0.0) / 60.0, height=0.38, color=palette.TRACTOR_COLOURS[0])
        axes.set_yticks(range(len(named_rows)), [f"{name} {row.label}" for name, row in named_rows], fontsize=8)
        axes.invert_yaxis()
        axes.set(xlabel="minutes; pale: thesis, dark: simulated")

    return ResultView(
        summary=lambda: summary,
        html=render,
        table=lambda: [{"table": name, **make_json_safe(row)} for name, row in named_rows],
        draw=draw,
        files={".json": lambda: format_study_json(study)},
    )
