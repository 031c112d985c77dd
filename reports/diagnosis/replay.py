"""A replayed run as JSON, a table, a picture, a page and in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from reports.common import palette
from reports.common.rendering import (
    ResultView,
    create_figure,
    draw_legend,
    encode_figure,
    format_json,
    make_json_safe,
    render_template,
)
from reports.common.text_tables import FittedTable, build_plain_table, format_sentence, render_fragment
from reports.common.wording import NO_VALUE, format_effect_with_id, join_list
from reports.diagnosis.sentences import SHOWN_HORIZON_S, format_errors, list_error_rows
from reports.plan.map_figure import encode_svg_base64, escape_figure_formula, render_png
from vehicle.identification.diagnosis.results import ReplayResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from pandas import DataFrame
    from rich.console import Group


_HEADINGS = ("Over", "Across cm", "Along cm", "Heading deg")
_MEASURED_COLOUR, _SIMULATED_COLOUR = palette.TRACTOR_COLOURS[0], palette.TRACTOR_COLOURS[1]


def format_replay_json(replayed: ReplayResult, remarks: Sequence[str] = ()) -> str:
    """Errors by horizon and remarks on the log as JSON."""
    content = {
        "run": replayed.name,
        "tractor": replayed.tractor,
        "effects": list(replayed.effects),
        "error": replayed.errors,
        "rows_gated": replayed.rows_gated,
        "notes": [*remarks, *_list_replayed_measurements(replayed)],
    }
    return format_json(content)


def _list_replayed_measurements(replayed: ReplayResult) -> list[str]:
    """List columns that the log lacks, for which the measured value was replayed instead of a simulated one."""
    measured = [one.measured for one in replayed.segments]
    lacks = []
    if any(one.target is None for one in measured):
        lacks.append("No commanded speed was logged, so the measured speed was replayed and none is simulated.")
    if any(one.command is None for one in measured):
        lacks.append(
            "No steering command was logged, so the measured wheel angle was replayed; no steering is simulated."
        )
    return lacks


def build_replay_table(replayed: ReplayResult, remarks: Sequence[str] = ()) -> Group:
    """Errors by horizon and remarks on the log for the terminal."""
    from rich.console import Group

    effects = join_list(map(format_effect_with_id, replayed.effects))
    return Group(
        format_sentence(f"{replayed.name} against {replayed.tractor}; effects in the tractor file: {effects}."),
        build_plain_table(_HEADINGS, list_error_rows(replayed.errors), texts=()),
        *(format_sentence(line) for line in (*remarks, *_list_replayed_measurements(replayed))),
    )


def draw_replay(replayed: ReplayResult) -> Figure:
    """Path, wheel angle, speed and the error across over 5 s, measured and simulated."""
    figure = create_figure(11.0, 7.0, layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0))
    path = figure.add_subplot(grid[:, 0])
    wheel = figure.add_subplot(grid[0, 1])
    speed, error = (figure.add_subplot(grid[row, 1], sharex=wheel) for row in (1, 2))
    commanded: dict[str, Any] = {"color": _MEASURED_COLOUR, "linestyle": "dotted", "label": "commanded"}
    measured_look: dict[str, Any] = {"color": _MEASURED_COLOUR, "linewidth": 1.2}
    simulated: dict[str, Any] = {"color": _SIMULATED_COLOUR, "linewidth": 0.9, "label": "simulated"}
    _draw_paths(path, replayed)
    for segment in replayed.segments:
        measured = segment.measured
        time = measured.start_s + measured.time
        if measured.command is not None:
            wheel.plot(time, np.degrees(measured.command), linewidth=1.4, zorder=3, **commanded)
        if measured.wheel is not None:
            wheel.plot(time, np.degrees(measured.wheel), label="measured", **measured_look)
        wheel.plot(time, np.degrees(segment.wheel), **simulated)
        source = "measured" if measured.speed_measured else "from the positions"
        if measured.target is None:  # the measured speed is replayed, so there is no simulated one to show
            speed.plot(time, measured.speed, label=f"{source}, replayed: no command was logged", **measured_look)
        else:
            speed.plot(time, measured.speed, label=source, **measured_look)
            speed.plot(time, measured.target, linewidth=1.2, **commanded)
            speed.plot(time, segment.speed, **simulated)
        for piece, errors in segment.pieces:
            error.plot(time[piece], 100.0 * errors[:, 0], color=palette.INK_COLOUR, linewidth=0.8)
    wheel.set_ylabel("wheel angle, deg")
    back = any(segment.measured.gear < 0.0 for segment in replayed.segments)
    speed.set_ylabel("speed, m/s,\nbelow 0 in reverse" if back else "speed, m/s")
    error.set(ylabel="error across, cm,\nanchored every 5 s", xlabel="time, s")
    for axes in (path, wheel, speed, error):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#E4E4E4", linewidth=0.6)
    for axes in (path, wheel, speed):
        draw_legend(
            axes, axes, fontsize=8, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0,
            handlelength=1.6, columnspacing=1.2,
        )  # fmt: skip
    figure.align_ylabels([wheel, speed, error])
    title = escape_figure_formula(f"{replayed.name} against {replayed.tractor}")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, color=palette.INK_COLOUR)
    return figure


def describe_replay(replayed: ReplayResult) -> str:
    """How far off the simulation is over pieces of 5 s, or of the longest length there is, in a sentence."""
    if not replayed.errors:
        return "The run is too short to compare measured and simulated pieces."
    horizon_s = SHOWN_HORIZON_S if SHOWN_HORIZON_S in replayed.errors else list(replayed.errors)[-1]
    across, along, heading = format_errors(replayed.errors, horizon_s)
    turned = "" if heading == NO_VALUE else f", and its heading by {heading} degrees"
    return (
        f"Over pieces of {horizon_s:g} s the simulation is off by {across} cm across and {along} cm along the "
        f"way{turned}."
    )


def _draw_paths(axes: Axes, replayed: ReplayResult) -> None:
    """Measured and simulated paths, to scale."""
    for one in replayed.segments:
        axes.plot(one.measured.east, one.measured.north, color=_MEASURED_COLOUR, linewidth=2.2, label="measured")
        axes.plot(*one.antenna.T, color=_SIMULATED_COLOUR, linewidth=1.1, label="simulated, aligned with the first 5 s")
        start = one.measured.east[0], one.measured.north[0]
        axes.plot(*start, color=palette.INK_COLOUR, marker="o", markersize=5, linestyle="none", label="start", zorder=4)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="east, m", ylabel="north, m")


def render_replay_page(replayed: ReplayResult, remarks: Sequence[str] = ()) -> str:
    """The picture, the errors and the remarks on the log as one self-contained page."""
    content = {
        "name": replayed.name,
        "tractor": replayed.tractor,
        "verdict": describe_replay(replayed),
        "effects": join_list(map(format_effect_with_id, replayed.effects)),
        "notes": [*remarks, *_list_replayed_measurements(replayed)],
        "picture": encode_svg_base64(draw_replay(replayed)),
        "errors": _tabulate_errors(replayed, (0,)),
    }
    return render_template("replay.html.j2", content)


def _tabulate_errors(replayed: ReplayResult, texts: Sequence[int] = ()) -> FittedTable:
    """The errors by length of the pieces, with units in words as pages have them."""
    headings = "Over", "Across, cm", "Along, cm", "Heading, deg"
    return build_plain_table(headings, list_error_rows(replayed.errors), texts)


def build_replay_view(replayed: ReplayResult, remarks: Sequence[str]) -> ResultView:
    """A replayed run with the remarks on its log: errors by length of the pieces, and the two paths."""
    title = f"{replayed.name} against {replayed.tractor}"

    def render() -> str:
        sentences, words = [describe_replay(replayed), *remarks], "Measured and simulated path, angle and speed"
        return render_fragment(
            title, sentences, [_tabulate_errors(replayed)], encode_figure(draw_replay(replayed)), words
        )

    def draw(axes: Axes) -> None:
        _draw_paths(axes, replayed)
        draw_legend(axes, axes, fontsize=8)

    def tabulate() -> DataFrame:
        import pandas as pd

        rows = [{"horizon_s": horizon, **make_json_safe(vars(error))} for horizon, error in replayed.errors.items()]
        return pd.DataFrame(rows, columns=["horizon_s", "cross_cm", "along_cm", "heading_deg"], dtype="float64")

    return ResultView(
        summary=lambda: f"{title}. {describe_replay(replayed)}",
        html=render,
        table=tabulate,
        draw=draw,
        files={
            ".json": lambda: format_replay_json(replayed, remarks),
            ".html": lambda: render_replay_page(replayed, remarks),
            ".png": lambda: render_png(draw_replay(replayed)),
        },
    )
