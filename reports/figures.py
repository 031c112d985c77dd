"""The map of a drive with matplotlib, and figures as PNG files and SVG text."""

from __future__ import annotations

import base64
import io
import textwrap
from typing import TYPE_CHECKING

import numpy as np

from reports import palette
from reports.paths import (
    REVERSING,
    STATES,
    WORKING,
    Extent,
    Piece,
    arrow,
    check_drive,
    extent,
    hatching,
    numbered,
    pieces,
    round_length,
    spread,
    swath,
    waits,
)
from reports.results import Drive
from reports.wording import area, duration, tractors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_INK = "#2B2B2B"
_HASH_SALT = "headland"
_LETTERS_PER_INCH, _LINE_INCHES = 11.0, 0.24  # of a title of 11 points
# Of the larger side of the map: how far beyond a track its number stands, least distances, length of an arrow's head.
_BESIDE, _LABELS, _ARROWS, _HEAD = 0.012, 0.022, 0.04, 0.012
_HATCH = 0.011  # of the larger side, between two lines over ground that is not worked


def map_figure(drive: Drive, field_name: str = "") -> Figure:
    """The field and each tractor's path, to scale, north up, with start, entrance, scale bar and legend.

    Tracks have their numbers and worked stretches the direction they were driven in, as many as have room. Ground that
    is not worked is hatched, the largest piece marked with its area. Above stand
    the name of the field, what was driven, and width, tracks, tractors and time. A drive without tractors shows the
    field and its swaths.

    Raises:
        ReportError: the drive cannot be drawn.
    """
    check_drive(drive, least=0)
    box = extent(drive)
    figure, axes = _map_canvas(box)
    title = _title_lines(drive, field_name, figure.get_figwidth())
    figure.set_figheight(figure.get_figheight() + _LINE_INCHES * len(title))
    figure.suptitle(_literal("\n".join(title)), x=0.02, ha="left", fontsize=11, color=_INK, linespacing=1.4)
    _draw_field(axes, drive)
    _draw_missed(axes, drive, box.size)
    for number in range(len(drive.xy)):
        _draw_tractor(axes, drive, number, box.size)
    if drive.entrance is not None:
        axes.plot(*drive.entrance, marker="v", color=_INK, markersize=8, linestyle="none", zorder=6)
    _draw_numbers(axes, drive, box)
    _draw_scale(axes, box)
    _map_legend(figure, drive)
    return figure


def png_bytes(figure: Figure, dpi: int = 150) -> bytes:
    """A figure as a PNG file."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=dpi, format="png", facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def to_svg(figure: Figure) -> str:
    """A figure as SVG text; the same figure gives the same text, letter by letter."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": _HASH_SALT, "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def to_data(figure: Figure) -> str:
    """A figure as SVG for a data address: base64, so that its styles stay its own."""
    return base64.b64encode(to_svg(figure).encode()).decode("ascii")


def _canvas(width: float, height: float) -> tuple[Figure, Axes]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.add_subplot()


def _map_canvas(box: Extent) -> tuple[Figure, Axes]:
    size = box.size or 1.0
    room = 0.04 * size
    foot = 0.08 * size
    drawn = (box.width + 2 * room) / (box.height + 2 * room + foot)
    width, height = (10.0, 10.0 / drawn) if drawn > 1 else (max(9.0 * drawn, 4.5), 9.0)
    figure, axes = _canvas(width, height + 0.9)
    axes.set_aspect("equal")
    axes.set_xlim(box.west - room, box.east + room)
    axes.set_ylim(box.south - room - foot, box.north + room)
    axes.set_axis_off()
    return figure, axes


def _draw_field(axes: Axes, drive: Drive) -> None:
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    rings = [Outline(np.vstack([ring, ring[:1]]), closed=True) for ring in (drive.boundary, *drive.holes)]
    whole = Outline.make_compound_path(*rings)
    axes.add_patch(PathPatch(whole, facecolor=palette.FIELD, edgecolor="none", zorder=1))
    strips = PolyCollection(
        [swath(track, drive.width_m) for track in drive.tracks],
        facecolors="none",
        edgecolors=palette.SWATH,
        linewidths=0.5,
        zorder=2,
    )
    axes.add_collection(strips, autolim=False)
    axes.add_patch(PathPatch(whole, facecolor="none", edgecolor=palette.EDGE, linewidth=1.2, zorder=3))


def _draw_missed(axes: Axes, drive: Drive, size: float) -> None:
    """Lines over the ground that is not worked, and what the largest piece of it measures."""
    from matplotlib.collections import LineCollection
    from matplotlib.patheffects import withStroke

    if drive.missed:
        lines = [*hatching(drive.missed, _HATCH * (size or 1.0))]
        lines += [np.vstack([ring, ring[:1]]) for ring in drive.missed]
        axes.add_collection(LineCollection(lines, colors=palette.MISSED, linewidths=0.5, zorder=2.4), autolim=False)
    if (piece := drive.largest_missed) is not None:
        text = axes.annotate(f"{area(piece.m2)} left", (piece.x_m, piece.y_m), color=palette.MISSED, fontsize=9,
                             fontweight="bold", ha="center", va="center", zorder=9)  # fmt: skip
        text.set_path_effects([withStroke(linewidth=3.0, foreground="white")])


def _draw_tractor(axes: Axes, drive: Drive, number: int, size: float) -> None:
    from matplotlib.collections import LineCollection

    xy, status = drive.xy[number], drive.status[number]
    colour = palette.tractor_colour(number)
    parts = pieces(xy, status)
    looks: tuple[tuple[str, float, tuple[int, ...]], ...] = (
        ("solid", 1.3, (WORKING,)),
        ("solid", 0.7, tuple({*range(5)} - {WORKING, REVERSING})),
        ("dotted", 1.5, (REVERSING,)),
    )
    for style, width, wanted in looks:
        lines = [part.points for part in parts if part.status in wanted]
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=width, linestyles=style, zorder=4), autolim=False
        )
    _draw_arrows(axes, parts, colour, size)
    for x, y, _ in waits(xy, status, drive.step_s):
        axes.plot(x, y, marker="s", markersize=4, markerfacecolor="white", markeredgecolor=colour, zorder=5)
    axes.plot(*xy[0], marker="o", markersize=11, color=colour, markeredgecolor="white", linestyle="none", zorder=7)
    axes.annotate(
        str(number + 1), xy[0], color="white", fontsize=7, fontweight="bold", ha="center", va="center", zorder=8
    )


def _draw_numbers(axes: Axes, drive: Drive, box: Extent) -> None:
    """Numbers of tracks from 1 at both ends, with a pale edge where paths run under them."""
    from matplotlib.patheffects import withStroke

    for index, place in numbered(drive.tracks, _BESIDE * box.size, _LABELS * box.size):
        x, y = place
        text = axes.annotate(str(index + 1), (x, y), fontsize=6.5, color=_INK, ha="center", va="center", zorder=6)
        text.set_path_effects([withStroke(linewidth=2.0, foreground="white")])


def _draw_arrows(axes: Axes, parts: list[Piece], colour: str, size: float) -> None:
    """The direction of worked stretches, half way along."""
    from matplotlib.collections import PolyCollection

    worked = [arrow(part.points, _HEAD * size) for part in parts if part.status == WORKING]
    heads = [head for head in worked if head is not None]
    places = np.array([head[0] for head in heads]).reshape(-1, 2)
    chosen = [heads[index] for index in spread(places, _ARROWS * size)]
    axes.add_collection(PolyCollection(chosen, facecolors=colour, edgecolors="none", zorder=5), autolim=False)


def _title_lines(drive: Drive, field_name: str, width: float) -> list[str]:
    """Field and plan, and below them the figures of the drive, in lines for a picture of `width` inches."""
    count = len(drive.xy)
    first = f"{field_name}: {drive.title}" if field_name and field_name not in drive.title else drive.title
    second = [f"width {drive.width_m:g} m", f"{len(drive.tracks)} tracks"]
    second += [tractors(count), f"done in {duration(max(drive.finish_s))}"] if count else []
    room = int(width * _LETTERS_PER_INCH)
    return [line for text in (first, ", ".join(second)) for line in textwrap.wrap(text, room)]


def _draw_scale(axes: Axes, box: Extent) -> None:
    """A scale bar below the field on the left, a north arrow on the right."""
    size = box.size or 1.0
    bar = round_length(max(box.width, 0.5 * size) / 4)
    y = box.south - 0.06 * size
    axes.plot([box.west, box.west + bar], [y, y], color=_INK, linewidth=2.5, solid_capstyle="butt", zorder=6)
    axes.annotate(f"{bar:g} m", (box.west + bar, y), xytext=(6, 0), textcoords="offset points", va="center", fontsize=9)
    axes.annotate(
        "N",
        xy=(box.east, y + 0.05 * size),
        xytext=(box.east, y),
        ha="center",
        va="center",
        fontsize=10,
        arrowprops={"arrowstyle": "-|>", "color": _INK, "linewidth": 1.2},
    )


def _map_legend(figure: Figure, drive: Drive) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    count = len(drive.xy)
    handles: list[Artist] = [
        Line2D([], [], color=palette.tractor_colour(number), linewidth=3, label=f"tractor {number + 1}")
        for number in range(count)
    ]
    if count:
        handles.append(Line2D([], [], color=_INK, linewidth=1.8, label="working"))
        handles.append(Line2D([], [], color=_INK, linewidth=0.7, label="turning"))
    else:
        handles.append(Line2D([], [], color=palette.SWATH, linewidth=1.0, label=f"swaths of {drive.width_m:g} m"))
    driven = {int(value) for status in drive.status for value in np.unique(status)}
    if REVERSING in driven:
        handles.append(Line2D([], [], color=_INK, linewidth=1.5, linestyle="dotted", label="reversing"))
    if STATES["waiting"] in driven:
        handles.append(_mark("s", "waiting", "white"))
    if count:
        handles.append(_mark("o", "start", "grey"))
    if drive.entrance is not None:
        handles.append(_mark("v", "entrance", _INK))
    if drive.missed:
        handles.append(Patch(facecolor="none", edgecolor=palette.MISSED, hatch="/////", label="not worked"))
    columns = max(2, int(figure.get_figwidth() / 1.6))
    figure.legend(handles=handles, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)


def _mark(marker: str, label: str, face: str) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], marker=marker, linestyle="none", markerfacecolor=face, markeredgecolor=_INK, label=label)


def _literal(text: str) -> str:
    """Text in which matplotlib reads no formula."""
    return text.replace("$", r"\$")
