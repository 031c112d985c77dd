"""A replayed run: the picture, the numbers, the page."""

from __future__ import annotations

import io
import json
import math
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from reports import palette
from vehicle.measured.verdict import Replayed

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from rich.table import Table

_INK, _MEASURED, _SIMULATED = "#2B2B2B", palette.TRACTORS[0], palette.TRACTORS[1]


def replay_json(found: Replayed) -> str:
    """Errors by horizon as JSON."""
    errors = {
        f"{horizon:g}": {key: None if math.isnan(value) else value for key, value in error.__dict__.items()}
        for horizon, error in found.errors.items()
    }
    whole = {"run": found.name, "tractor": found.tractor, "effects": list(found.effects), "error": errors}
    return json.dumps(whole, indent=2) + "\n"


def replay_table(found: Replayed) -> Table:
    """Errors by horizon for the terminal."""
    from rich.table import Table

    effects = f", with {', '.join(found.effects)}" if found.effects else ""
    table = Table(title=f"{found.name} against {found.tractor}{effects}", title_justify="left")
    for name in ("Over", "Across cm", "Along cm", "Heading deg"):
        table.add_column(name, justify="right")
    for horizon, error in found.errors.items():
        table.add_row(f"{horizon:g} s", f"{error.cross_cm:.1f}", f"{error.along_cm:.1f}", f"{error.heading_deg:.2f}")
    return table


def replay_figure(found: Replayed) -> Figure:
    """Path, wheel angle, speed and the error across over 5 s, measured and simulated."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.0), layout="constrained")
    grid = figure.add_gridspec(3, 2, width_ratios=(1.1, 1.0))
    path = figure.add_subplot(grid[:, 0])
    rows = [figure.add_subplot(grid[row, 1]) for row in range(3)]
    for number, one in enumerate(found.stretches):
        label = _first if number == 0 else _none
        time = one.measured.start_s + one.measured.time
        path.plot(one.measured.east, one.measured.north, color=_MEASURED, linewidth=2.2, label=label("measured"))
        path.plot(*one.antenna.T, color=_SIMULATED, linewidth=1.1, label=label("simulated, laid on the first 5 s"))
        for values, line in ((one.measured.command, "dotted"), (one.measured.wheel, "solid")):
            if values is not None:
                name = "commanded" if line == "dotted" else "measured"
                rows[0].plot(
                    time, np.degrees(values), color=_MEASURED, linestyle=line, linewidth=1.2, label=label(name)
                )
        rows[0].plot(time, np.degrees(one.wheel), color=_SIMULATED, linewidth=0.9, label=label("simulated"))
        rows[1].plot(time, one.measured.speed, color=_MEASURED, linewidth=1.2)
        rows[1].plot(time, one.speed, color=_SIMULATED, linewidth=0.9)
        for piece, errors in one.pieces:
            rows[2].plot(time[piece], 100.0 * errors[:, 0], color=_INK, linewidth=0.8)
    path.set_aspect("equal", adjustable="datalim")
    path.set(xlabel="east, m", ylabel="north, m")
    for axes, label_y in zip(
        rows, ("wheel angle, deg", "speed, m/s", "error across, cm,\nanchored every 5 s"), strict=True
    ):
        axes.set_ylabel(label_y)
    rows[2].set_xlabel("time, s")
    for axes in (path, *rows):
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(color="#E4E4E4", linewidth=0.6)
    for axes in (path, rows[0]):
        axes.legend(frameon=False, fontsize=8)
    title = f"{found.name} against {found.tractor}".replace("$", r"\$")
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, color=_INK)
    return figure


def _first(text: str) -> str | None:
    return text


def _none(text: str) -> str | None:
    return None


def replay_page(found: Replayed) -> str:
    """The picture and the errors as one self-contained page."""
    picture = io.StringIO()
    replay_figure(found).savefig(picture, format="svg", metadata={"Date": None})
    drawing = picture.getvalue()
    drawing = drawing[drawing.index("<svg") :]
    rows = "".join(
        f"<tr><td>{horizon:g} s</td><td>{e.cross_cm:.1f}</td><td>{e.along_cm:.1f}</td><td>{e.heading_deg:.2f}</td></tr>"
        for horizon, e in found.errors.items()
    )
    effects = escape(", ".join(found.effects) or "none")
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        f"<title>{escape(found.name)}: replay</title><style>body{{font-family:system-ui,sans-serif;max-width:68rem;"
        "margin:2rem auto;padding:0 1rem}svg{width:100%;height:auto}td,th{padding:.2rem .9rem;text-align:right}</style>"
        f"</head><body><h1>{escape(found.name)} against {escape(found.tractor)}</h1><p>Effects in the tractor file: "
        f"{effects}. Every piece is laid on the measurement by the best turn and shift; what is left is the error.</p>"
        "<table><tr><th>Over</th><th>Across, cm</th><th>Along, cm</th><th>Heading, deg</th></tr>"
        f"{rows}</table>{drawing}</body></html>\n"
    )
