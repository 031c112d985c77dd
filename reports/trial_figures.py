"""Figures of the experiments: lines over two axes, wheel angles with their stages, maps of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from reports import palette
from reports.errors import ReportError
from vehicle.trials.sheets.sheet import HeatMap, Line, Panel, Sheet

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_INK = "#2B2B2B"
_STAGES = {1: ("holds (stage 1)", "#8A8A8A"), 2: ("follows (stage 2)", "#0072B2"), 3: ("slews (stage 3)", "#D55E00")}
_MOST_POINTS = 1500
_COLUMNS = 2


def panel_figure(panel: Panel | HeatMap) -> Figure:
    """One panel on its own."""
    figure = _figure(7.0, _height(panel, 7.0))
    _draw(figure.add_subplot(), panel)
    return figure


def sheet_figure(sheet: Sheet) -> Figure:
    """All panels of an experiment, two beside each other.

    Raises:
        ReportError: the experiment has no pictures.
    """
    if not sheet.panels:
        raise ReportError(f"The experiment {sheet.name!r} has no pictures; leave the picture out.")
    rows = -(-len(sheet.panels) // _COLUMNS)
    figure = _figure(13.0, 4.6 * rows)
    for number, panel in enumerate(sheet.panels):
        _draw(figure.add_subplot(rows, _COLUMNS, number + 1), panel)
    figure.suptitle(sheet.title, x=0.01, ha="left", fontsize=14, color=_INK)
    return figure


def _figure(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _height(panel: Panel | HeatMap, width: float) -> float:
    """Drawn to scale, a panel is as high as its lines ask for, within reason."""
    if isinstance(panel, HeatMap) or not panel.equal:
        return 0.62 * width
    x = np.concatenate([line.x for line in panel.lines])
    y = np.concatenate([line.y for line in panel.lines])
    shape = float(np.ptp(y)) / max(float(np.ptp(x)), 1e-9)
    return float(np.clip(shape * width, 0.35 * width, 1.1 * width)) + 0.6


def _draw(axes: Axes, panel: Panel | HeatMap) -> None:
    axes.set_title(panel.title, loc="left", fontsize=11, color=_INK)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.spines[["top", "right"]].set_visible(False)
    if isinstance(panel, HeatMap):
        _draw_map(axes, panel)
        return
    axes.grid(color="#E4E4E4", linewidth=0.6)
    for line in panel.lines:
        _draw_line(axes, line)
    if panel.missing:
        _draw_missing(axes, panel)
    if panel.equal:
        axes.set_aspect("equal", adjustable="datalim")
    if len(panel.lines) > 1 or panel.lines[0].stages is not None:
        axes.legend(fontsize=8, frameon=True, framealpha=0.85, edgecolor="none")


def _draw_line(axes: Axes, line: Line) -> None:
    step = max(1, len(line.x) // _MOST_POINTS)
    x, y = line.x[::step], line.y[::step]
    colour = palette.tractor_colour(line.colour)
    if line.stages is not None:
        _draw_stages(axes, x, y, line.stages[::step])
        return
    style = (0, (5, 3)) if line.dashed else "solid"
    few = "o" if len(x) < 40 else None
    axes.plot(x, y, color=colour, linestyle=style, linewidth=1.4, marker=few, markersize=4, label=line.label)


def _draw_missing(axes: Axes, panel: Panel) -> None:
    """Crosses at the lower edge, a row per line, where a line has no value: an axis ends with its last point."""
    from matplotlib.lines import Line2D

    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.03 * len(panel.lines) * (high - low), high)
    style: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 5}
    for row, line in enumerate(panel.lines):
        x = line.x[np.isnan(line.y)]
        edge = np.full(len(x), 0.02 + 0.03 * row)
        colour = palette.tractor_colour(line.colour)
        axes.plot(x, edge, color=colour, transform=axes.get_xaxis_transform(), **style)
    axes.add_line(Line2D([], [], color=_INK, label=panel.missing, **style))


def _draw_stages(axes: Axes, x: np.ndarray, y: np.ndarray, stages: np.ndarray) -> None:
    """The line in pieces, each in the colour of its stage."""
    for stage, (label, colour) in _STAGES.items():
        if not (stages == stage).any():
            continue
        inside = stages[1:] == stage
        shown = np.where(np.concatenate([inside, [False]]) | np.concatenate([[False], inside]), y, np.nan)
        axes.plot(x, shown, color=colour, linewidth=1.8, label=f"wheel angle {label}")


def _draw_map(axes: Axes, panel: HeatMap) -> None:
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
