"""Figures of the experiments: lines over two axes, wheel angles with their stages, maps of a sweep."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from reports.common import palette
from reports.common.notebook import create_figure
from reports.common.rendering import ReportError
from vehicle.trials.sheets.sheet import ExperimentSheet, HeatMap, PlotLine, PlotPanel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_STAGE_STYLES = {
    1: ("holds (stage 1)", "#8A8A8A"),
    2: ("follows (stage 2)", "#0072B2"),
    3: ("slews (stage 3)", "#D55E00"),
}
_MOST_LINE_POINTS = 1500
_FIGURE_COLUMNS = 2


def draw_panel(panel: PlotPanel | HeatMap) -> Figure:
    """One panel on its own."""
    figure = create_figure(7.0, _compute_panel_height(panel, 7.0), layout="constrained")
    _draw_axes(figure.add_subplot(), panel)
    return figure


def draw_experiment_panels(sheet: ExperimentSheet) -> Figure:
    """All panels of an experiment, two in a row.

    Raises:
        ReportError: the experiment has no pictures.
    """
    if not sheet.panels:
        raise ReportError(f"The experiment {sheet.name!r} has no pictures; leave the picture out.")
    rows = -(-len(sheet.panels) // _FIGURE_COLUMNS)
    figure = create_figure(13.0, 4.6 * rows, layout="constrained")
    for number, panel in enumerate(sheet.panels):
        _draw_axes(figure.add_subplot(rows, _FIGURE_COLUMNS, number + 1), panel)
    figure.suptitle(sheet.title, x=0.01, ha="left", fontsize=14, color=palette.INK_COLOUR)
    return figure


def _compute_panel_height(panel: PlotPanel | HeatMap, width: float) -> float:
    """Height of a panel; one drawn to scale is as high as its lines need, within limits."""
    if isinstance(panel, HeatMap) or not panel.equal_axes:
        return 0.62 * width
    x = np.concatenate([line.x for line in panel.lines])
    y = np.concatenate([line.y for line in panel.lines])
    shape = float(np.ptp(y)) / max(float(np.ptp(x)), 1e-9)
    return float(np.clip(shape * width, 0.35 * width, 1.1 * width)) + 0.6


def _draw_axes(axes: Axes, panel: PlotPanel | HeatMap) -> None:
    axes.set_title(panel.title, loc="left", fontsize=11, color=palette.INK_COLOUR)
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.spines[["top", "right"]].set_visible(False)
    if isinstance(panel, HeatMap):
        _draw_heat_map(axes, panel)
        return
    axes.grid(color="#E4E4E4", linewidth=0.6)
    for line in panel.lines:
        _draw_line(axes, line)
    if panel.missing:
        _draw_missing(axes, panel)
    if panel.equal_axes:
        axes.set_aspect("equal", adjustable="datalim")
    if len(panel.lines) > 1 or panel.lines[0].stages is not None:
        axes.legend(fontsize=8, frameon=True, framealpha=0.85, edgecolor="none")


def _draw_line(axes: Axes, line: PlotLine) -> None:
    step = max(1, len(line.x) // _MOST_LINE_POINTS)
    x, y = line.x[::step], line.y[::step]
    colour = palette.get_tractor_colour(line.colour)
    if line.stages is not None:
        _draw_line_by_stage(axes, x, y, line.stages[::step])
        return
    style = (0, (5, 3)) if line.dashed else "solid"
    marker = "o" if len(x) < 40 else None
    axes.plot(x, y, color=colour, linestyle=style, linewidth=1.4, marker=marker, markersize=4, label=line.label)


def _draw_missing(axes: Axes, panel: PlotPanel) -> None:
    """Crosses at the lower edge, a row per line, where a line has no value."""
    from matplotlib.lines import Line2D

    low, high = axes.get_ylim()
    axes.set_ylim(low - 0.03 * len(panel.lines) * (high - low), high)
    style: dict[str, Any] = {"linestyle": "none", "marker": "x", "markersize": 5}
    for row, line in enumerate(panel.lines):
        x = line.x[np.isnan(line.y)]
        edge = np.full(len(x), 0.02 + 0.03 * row)
        colour = palette.get_tractor_colour(line.colour)
        axes.plot(x, edge, color=colour, transform=axes.get_xaxis_transform(), **style)
    axes.add_line(Line2D([], [], color=palette.INK_COLOUR, label=panel.missing, **style))


def _draw_line_by_stage(axes: Axes, x: np.ndarray, y: np.ndarray, stages: np.ndarray) -> None:
    """The line in pieces, each in the colour of its stage."""
    for stage, (label, colour) in _STAGE_STYLES.items():
        if not (stages == stage).any():
            continue
        inside = stages[1:] == stage
        shown = np.where(np.concatenate([inside, [False]]) | np.concatenate([[False], inside]), y, np.nan)
        axes.plot(x, shown, color=colour, linewidth=1.8, label=f"wheel angle {label}")


def _draw_heat_map(axes: Axes, panel: HeatMap) -> None:
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
