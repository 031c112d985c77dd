"""A replayed run: the picture, the numbers, the page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from reports import palette
from reports.effect_words import both
from reports.figures import to_data
from reports.fitting import Column, FittedTable, sentence
from reports.plain import finite
from reports.template import rendered
from reports.wording import NOTHING, listed, number
from vehicle.measured.answer.verdict import Replayed, ReplayedStretch

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from rich.console import Group

SHOWN_S = 5.0
_INK, _MEASURED, _SIMULATED = "#2B2B2B", palette.TRACTORS[0], palette.TRACTORS[1]


def replay_json(found: Replayed, remarks: Sequence[str] = ()) -> str:
    """Errors by horizon and remarks on the log as JSON."""
    errors = {f"{horizon:g}": dict(error.__dict__) for horizon, error in found.errors.items()}
    whole = {
        "run": found.name, "tractor": found.tractor, "effects": list(found.effects), "error": errors,
        "rows_gated": found.rows_gated, "notes": [*remarks, *_stand_ins(found)],
    }  # fmt: skip
    return json.dumps(finite(whole), indent=2, allow_nan=False) + "\n"


def _stand_ins(found: Replayed) -> list[str]:
    """What the log lacks, so that the measured value was replayed instead of a simulated one."""
    measured = [one.measured for one in found.stretches]
    lacks = []
    if any(one.target is None for one in measured):
        lacks.append("No commanded speed was logged: the measured speed was replayed, none is simulated.")
    if any(one.command is None for one in measured):
        lacks.append("No steering command was logged: the measured wheel angle was replayed as the command.")
    return lacks


def replay_table(found: Replayed, remarks: Sequence[str] = ()) -> Group:
    """Errors by horizon and remarks on the log for the terminal."""
    from rich.console import Group

    columns = tuple(map(Column, ("Over", "Across cm", "Along cm", "Heading deg")))
    return Group(
        sentence(f"{found.name} against {found.tractor}; effects in the tractor file: {_effects(found)}."),
        FittedTable(columns, tuple(_rows(found))),
        *(sentence(line) for line in (*remarks, *_stand_ins(found))),
    )


def _effects(found: Replayed) -> str:
    return listed(map(both, found.effects))


def _rows(found: Replayed) -> list[tuple[str, str, str, str]]:
    return [
        (f"{horizon:g} s", number(error.cross_cm, 1), number(error.along_cm, 1), number(error.heading_deg, 2))
        for horizon, error in found.errors.items()
    ]


def replay_figure(found: Replayed) -> Figure:
    """Path, wheel angle, speed and the error across over 5 s, measured and simulated."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0))
    path = figure.add_subplot(grid[:, 0])
    wheel = figure.add_subplot(grid[0, 1])
    speed, error = (figure.add_subplot(grid[row, 1], sharex=wheel) for row in (1, 2))
    for one in found.stretches:
        _draw_path(path, one)
        _draw_wheel(wheel, one)
        _draw_speed(speed, one)
        time = one.measured.start_s + one.measured.time
        for piece, errors in one.pieces:
            error.plot(time[piece], 100.0 * errors[:, 0], color=_INK, linewidth=0.8)
    path.set_aspect("equal", adjustable="datalim")
    path.set(xlabel="east, m", ylabel="north, m")
    wheel.set_ylabel("wheel angle, deg")
    back = any(one.measured.gear < 0.0 for one in found.stretches)
    speed.set_ylabel("speed, m/s,\nbelow 0 in reverse" if back else "speed, m/s")
    error.set(ylabel="error across, cm,\nanchored every 5 s", xlabel="time, s")
    for axes in (path, wheel, speed, error):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#E4E4E4", linewidth=0.6)
    for axes in (path, wheel, speed):
        _legend_above(axes)
    figure.align_ylabels([wheel, speed, error])
    title = f"{found.name} against {found.tractor}".replace("$", r"\$")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, color=_INK)
    return figure


def _draw_path(axes: Axes, one: ReplayedStretch) -> None:
    axes.plot(one.measured.east, one.measured.north, color=_MEASURED, linewidth=2.2, label="measured")
    axes.plot(*one.antenna.T, color=_SIMULATED, linewidth=1.1, label="simulated, laid on the first 5 s")
    start = one.measured.east[0], one.measured.north[0]
    axes.plot(*start, color=_INK, marker="o", markersize=5, linestyle="none", label="start", zorder=4)


def _draw_wheel(axes: Axes, one: ReplayedStretch) -> None:
    time = one.measured.start_s + one.measured.time
    if one.measured.command is not None:
        command = np.degrees(one.measured.command)
        axes.plot(time, command, color=_MEASURED, linestyle="dotted", linewidth=1.4, label="commanded", zorder=3)
    if one.measured.wheel is not None:
        axes.plot(time, np.degrees(one.measured.wheel), color=_MEASURED, linewidth=1.2, label="measured")
    axes.plot(time, np.degrees(one.wheel), color=_SIMULATED, linewidth=0.9, label="simulated")


def _draw_speed(axes: Axes, one: ReplayedStretch) -> None:
    """Without a commanded speed the measured one is replayed, so there is no simulated one to show."""
    time = one.measured.start_s + one.measured.time
    replayed = "" if one.measured.target is not None else ", replayed: no command was logged"
    source = "measured" if one.measured.speed_seen else "from the positions"
    axes.plot(time, one.measured.speed, color=_MEASURED, linewidth=1.2, label=source + replayed)
    if one.measured.target is not None:
        axes.plot(time, one.measured.target, color=_MEASURED, linestyle="dotted", linewidth=1.2, label="commanded")
        axes.plot(time, one.speed, color=_SIMULATED, linewidth=0.9, label="simulated")


def _legend_above(axes: Axes) -> None:
    """One entry per label, above the axes, where no curve is."""
    handles, labels = axes.get_legend_handles_labels()
    entries = dict(zip(labels, handles, strict=True))
    axes.legend(
        entries.values(), entries.keys(), frameon=False, fontsize=8, ncols=3, loc="lower left",
        bbox_to_anchor=(0.0, 1.0), borderaxespad=0.0, handlelength=1.6, columnspacing=1.2,
    )  # fmt: skip


def replay_page(found: Replayed, remarks: Sequence[str] = ()) -> str:
    """The picture, the errors and the remarks on the log as one self-contained page."""
    rows = _rows(found)
    content = {
        "name": found.name,
        "tractor": found.tractor,
        "verdict": _verdict(found, rows),
        "effects": _effects(found),
        "notes": [*remarks, *_stand_ins(found)],
        "picture": to_data(replay_figure(found)),
        "rows": rows,
    }
    return rendered("replay.html.j2", content)


def _verdict(found: Replayed, rows: Sequence[tuple[str, str, str, str]]) -> str:
    """The errors over pieces of `SHOWN_S`, or of the greatest length there is."""
    if not rows:
        return "The run is too short for a piece of it to be compared."
    horizons = list(found.errors)
    piece, across, along, heading = rows[horizons.index(SHOWN_S) if SHOWN_S in horizons else -1]
    turned = "" if heading == NOTHING else f", and its heading by {heading} degrees"
    return f"Over pieces of {piece} the simulation is off by {across} cm across and {along} cm along the way{turned}."
