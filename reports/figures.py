"""The map of a drive with matplotlib, and figures as PNG files and SVG text."""

from __future__ import annotations

import base64
import io
import math
import textwrap
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from reports import palette
from reports.layers import INK, draw_ground, draw_missed, draw_names, draw_scale, draw_tractors
from reports.leg_list import heading, text_rows
from reports.paths import REFILLING_STATUS, REVERSING, STATES, Extent, check_drive, extent
from reports.results import Drive
from reports.wording import area, duration, tractors

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

_HASH_SALT = "headland"
_LETTERS_PER_INCH, _TITLE_INCHES, _EDGE_INCHES = 11.0, 0.24, 0.2  # of a title of 11 points; around everything
_WIDEST, _TALLEST, _NARROWEST = 10.0, 9.0, 4.5  # of a map, inches
_ROOM, _FOOT = 0.03, 0.1  # of the larger side of the field: beside it, and below it with the scale
_MARK_INCHES, _MARKS_INCHES = 1.6, 0.23  # width of an entry of the legend, height of a row of them
_LIST_INCHES, _LIST_POINTS, _LIST_SPACING = 3.1, 5.6, 1.2  # a column of the lists of legs
_ROW_INCHES = _LIST_POINTS * _LIST_SPACING / 72.0
_MOST_ROWS, _WIDEST_WITH_LISTS = 70, 11.0  # of lists below the map; of a map with lists beside it


def map_figure(drive: Drive, field_name: str = "") -> Figure:
    """The field and each tractor's path, to scale, north up, with start, entrance, scale bar and legend.

    Tracks and rounds have their numbers, cells their outline, number and bearing, worked stretches the direction they
    were driven in and their number in the list of legs, as many as have room. Those lists stand below the map where
    they fit. Ground that is not worked is hatched, the largest piece marked with its area. Above stand the name of the
    field, what was driven, and width, tracks, rounds and time. A drive without tractors shows the field and its swaths.

    Raises:
        ReportError: the drive cannot be drawn.
    """
    check_drive(drive, least=0)
    box = extent(drive)
    sheet = _sheet(drive, field_name, _map_inches(box))
    figure, axes = _canvas(sheet)
    size = box.size or 1.0
    axes.set_aspect("equal")
    axes.set_xlim(box.west - _ROOM * size, box.east + _ROOM * size)
    axes.set_ylim(box.south - _FOOT * size, box.north + _ROOM * size)
    axes.set_axis_off()
    draw_ground(axes, drive)
    draw_missed(axes, drive, box)
    draw_tractors(axes, drive, box.size)
    if drive.entrance is not None:
        axes.plot(*drive.entrance, marker="v", color=INK, markersize=8, linestyle="none", zorder=6)
    draw_names(axes, drive, box.size)
    draw_scale(axes, box)
    _write_round(figure, drive, sheet)
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


def _map_inches(box: Extent) -> tuple[float, float]:
    """Width and height of the map: as large as has room, all of it map."""
    size = box.size or 1.0
    across, up = box.width + 2 * _ROOM * size, box.height + (_ROOM + _FOOT) * size
    scale = min((_WIDEST - 2 * _EDGE_INCHES) / across, _TALLEST / up)
    return round(float(across * scale), 4), round(float(up * scale), 4)


@dataclass(frozen=True)
class _Sheet:
    """What goes where, in inches: the map `across` by `up`, above it `title`, below it `legend` and lists or beside."""

    across: float
    up: float
    width: float
    title: list[str]
    legend: float
    columns: int
    lists: list[str]
    beside: bool

    @property
    def above(self) -> float:
        """Height of the title."""
        return _EDGE_INCHES + _TITLE_INCHES * len(self.title)

    @property
    def listed(self) -> float:
        """Height of the lists below the legend."""
        rows = max((text.count("\n") + 1 for text in self.lists), default=0)
        return 0.0 if self.beside or not rows else _ROW_INCHES * rows + _EDGE_INCHES

    @property
    def height(self) -> float:
        """Of everything."""
        return self.above + self.up + self.legend + self.listed


def _sheet(drive: Drive, field_name: str, inches: tuple[float, float]) -> _Sheet:
    """The map with lists of legs beside it, or below it, or without where they have no room."""
    across, up = inches
    alone = max(across + 2 * _EDGE_INCHES, _NARROWEST)
    beside = _lists(drive, int(up / _ROW_INCHES) - 1)
    wide = across + 3 * _EDGE_INCHES + _LIST_INCHES * len(beside)
    below = _lists(drive, _MOST_ROWS)
    is_beside = bool(beside) and wide <= _WIDEST_WITH_LISTS
    width = wide if is_beside else alone
    lists = beside if is_beside else below if len(below) * _LIST_INCHES + _EDGE_INCHES <= width else []
    columns = max(2, int(width / _MARK_INCHES))
    legend = _MARKS_INCHES * math.ceil(len(_marks(drive)) / columns) + _EDGE_INCHES
    return _Sheet(across, up, width, _title_lines(drive, field_name, width), legend, columns, lists, is_beside)


def _canvas(sheet: _Sheet) -> tuple[Figure, Axes]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(sheet.width, sheet.height))
    FigureCanvasAgg(figure)
    left = _EDGE_INCHES if sheet.beside else 0.5 * (sheet.width - sheet.across)
    bottom, across = (sheet.legend + sheet.listed) / sheet.height, sheet.across / sheet.width
    return figure, figure.add_axes((left / sheet.width, bottom, across, sheet.up / sheet.height))


def _write_round(figure: Figure, drive: Drive, sheet: _Sheet) -> None:
    """Title, legend and lists of legs."""
    edge = _EDGE_INCHES / sheet.width
    figure.suptitle(
        _literal("\n".join(sheet.title)), x=edge, y=1.0 - 0.5 * _EDGE_INCHES / sheet.height, ha="left", va="top",
        fontsize=11, color=INK, linespacing=1.4,
    )  # fmt: skip
    figure.legend(
        handles=_marks(drive), loc="upper center", bbox_to_anchor=(0.5, (sheet.legend + sheet.listed) / sheet.height),
        ncols=sheet.columns, frameon=False, fontsize=9, borderaxespad=0.0,
    )  # fmt: skip
    left = sheet.across + 2 * _EDGE_INCHES if sheet.beside else _EDGE_INCHES
    top = sheet.height - sheet.above if sheet.beside else sheet.listed
    for column, text in enumerate(sheet.lists):
        figure.text(
            (left + column * _LIST_INCHES) / sheet.width, top / sheet.height, _literal(text), ha="left", va="top",
            fontsize=_LIST_POINTS, family="monospace", color=INK, linespacing=_LIST_SPACING,
        )  # fmt: skip


def _title_lines(drive: Drive, field_name: str, width: float) -> list[str]:
    """Field and plan, and below them the figures of the drive, in lines for a picture of `width` inches."""
    count = len(drive.xy)
    first = f"{field_name}: {drive.title}" if field_name and field_name not in drive.title else drive.title
    tracks = f"{len(drive.tracks)} tracks"
    second = [f"width {drive.width_m:g} m", *([] if tracks in first else [tracks])]
    if drive.rounds:
        rounds = max(one.number for one in drive.rounds)
        second.append(f"{rounds} round{'s' if rounds > 1 else ''} of the headland")
    if count:
        second += [*([] if tractors(count) in first else [tractors(count)]), f"done in {duration(max(drive.finish_s))}"]
    if drive.worked_pct is not None:
        second.append(f"{drive.worked_pct:.1f} % worked")
    if drive.cut_off:
        second.append(f"{area(math.fsum(one.m2 for one in drive.cut_off))} cut off by obstacles")
    room = int(width * _LETTERS_PER_INCH)
    return [line for text in (first, ", ".join(second)) for line in textwrap.wrap(text, room)]


def _lists(drive: Drive, most: int) -> list[str]:
    """The lists of legs as columns of text of at most so many rows; short ones stand below each other.

    A longer one is parted evenly.
    """
    columns: list[list[str]] = []
    for number, steps in enumerate(drive.steps, start=1):
        rows = text_rows(steps)
        share = math.ceil(len(rows) / max(math.ceil(len(rows) / max(most - 1, 1)), 1))
        for first in range(0, len(rows), max(share, 1)):
            title = heading(number, steps) if not first else f"Tractor {number}, on"
            block = [title, *rows[first : first + share]]
            if columns and len(columns[-1]) + 1 + len(block) <= most:
                columns[-1] += ["", *block]
            else:
                columns.append(block)
    return ["\n".join(column) for column in columns]


def _marks(drive: Drive) -> list[Artist]:
    """The entries of the legend."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    count = len(drive.xy)
    handles: list[Artist] = [
        Line2D([], [], color=palette.tractor_colour(number), linewidth=3, label=f"tractor {number + 1}")
        for number in range(count)
    ]
    if count:
        handles.append(Line2D([], [], color=INK, linewidth=1.8, label="working"))
        handles.append(Line2D([], [], color=INK, linewidth=0.7, label="turning"))
    else:
        handles.append(Line2D([], [], color=palette.SWATH, linewidth=1.0, label=f"swaths of {drive.width_m:g} m"))
    driven = {int(value) for status in drive.status for value in np.unique(status)}
    if REVERSING in driven:
        handles.append(Line2D([], [], color=INK, linewidth=1.5, linestyle="dotted", label="reversing"))
    if STATES["waiting"] in driven:
        handles.append(_mark("s", "waiting", "white"))
    if REFILLING_STATUS in driven:
        handles.append(_mark("D", "refill", "white"))
    if count:
        handles.append(_mark("o", "start", "grey"))
    if drive.entrance is not None:
        handles.append(_mark("v", "entrance", INK))
    if drive.rounds:
        handles.append(Patch(facecolor=palette.ROUNDS[1], edgecolor=palette.ROUNDS[0], label="rounds"))
    if drive.cells:
        handles.append(Line2D([], [], color=INK, linewidth=1.0, linestyle="dashed", label="cells"))
    if drive.obstacles:
        handles.append(Patch(facecolor=palette.OBSTACLE, edgecolor="none", label="obstacles"))
    if drive.fences:
        handles.append(Line2D([], [], color=INK, linewidth=2.2, linestyle=(0, (2, 1)), label="fences"))
    if drive.missed:
        handles.append(Patch(facecolor="none", edgecolor=palette.MISSED, hatch="/////", label="not worked"))
    return handles


def _mark(marker: str, label: str, face: str) -> Line2D:
    from matplotlib.lines import Line2D

    return Line2D([], [], marker=marker, linestyle="none", markerfacecolor=face, markeredgecolor=INK, label=label)


def _literal(text: str) -> str:
    """Text in which matplotlib reads no formula."""
    return text.replace("$", r"\$")
