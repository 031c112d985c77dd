"""What a map of matplotlib is made of, one layer each, from the ground up to the names."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely

from reports import palette
from reports.landmarks import (
    Label,
    WorkMark,
    cell_labels,
    cut_off_labels,
    leg_numbers,
    missed_label,
    round_labels,
    track_labels,
    work_marks,
)
from reports.paths import REFILLING_STATUS, REVERSING, WORKING, Extent, hatching, pieces, round_length, swath, waits
from reports.results import Drive, Points

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import PathPatch

INK = "#2B2B2B"
_HATCH = 0.011  # of the larger side, between two lines over ground that is not worked
_JOIN = {"cap_style": "flat", "join_style": "mitre", "mitre_limit": 2.0}


def draw_ground(axes: Axes, drive: Drive) -> None:
    """The field, the bands of its rounds, the swaths of its tracks, what stands in it, and its outline."""
    from matplotlib.collections import PolyCollection

    whole = _patch([drive.boundary, *drive.holes], facecolor=palette.FIELD, edgecolor="none", zorder=1)
    axes.add_patch(whole)
    for one in drive.rounds:
        band = shapely.LineString(one.points).buffer(0.5 * drive.width_m, **_JOIN)
        parts = shapely.get_parts(band)
        rings = [np.asarray(ring.coords) for part in parts for ring in (part.exterior, *part.interiors)]
        look = _patch(rings, facecolor=palette.ROUNDS[one.number % 2], edgecolor="none", zorder=1.5)
        axes.add_patch(look)
        look.set_clip_path(whole)
    strips = PolyCollection(
        [swath(track, drive.width_m) for track in drive.tracks],
        facecolors="none",
        edgecolors=palette.SWATH,
        linewidths=0.5,
        zorder=2,
    )
    axes.add_collection(strips, autolim=False)
    for ring in drive.obstacles:
        axes.add_patch(_patch([ring], facecolor=palette.OBSTACLE, edgecolor="none", zorder=2.2))
    axes.add_patch(
        _patch([drive.boundary, *drive.holes], facecolor="none", edgecolor=palette.EDGE, linewidth=1.2, zorder=3)
    )
    for line in drive.fences:
        axes.plot(*line.T, color=INK, linewidth=2.2, linestyle=(0, (2, 1)), zorder=3.1)


def _patch(rings: Sequence[Points], **look: object) -> PathPatch:
    """Closed rings as one shape, holes left out."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    return PathPatch(
        Outline.make_compound_path(*(Outline(np.vstack([ring, ring[:1]]), closed=True) for ring in rings)), **look
    )


def draw_missed(axes: Axes, drive: Drive, box: Extent) -> None:
    """Lines over the ground that is not worked, and what the largest piece of it measures."""
    from matplotlib.collections import LineCollection

    if drive.missed:
        lines = [*hatching(drive.missed, _HATCH * (box.size or 1.0))]
        lines += [np.vstack([ring, ring[:1]]) for ring in drive.missed]
        axes.add_collection(LineCollection(lines, colors=palette.MISSED, linewidths=0.5, zorder=2.4), autolim=False)
    label = missed_label(drive, box)
    _write(axes, [*([label] if label else []), *cut_off_labels(drive)], palette.MISSED, 9, 9, bold=True)


def draw_tractors(axes: Axes, drive: Drive, size: float) -> None:
    """The path of every tractor, where it waits and begins, and its worked stretches with direction and number."""
    for number, marks in enumerate(work_marks(drive, size)):
        _draw_path(axes, drive, number)
        _draw_marks(axes, marks, palette.tractor_colour(number))


def _draw_path(axes: Axes, drive: Drive, number: int) -> None:
    from matplotlib.collections import LineCollection

    xy, status = drive.xy[number], drive.status[number]
    colour = palette.tractor_colour(number)
    parts = pieces(xy, status)
    looks: tuple[tuple[str, float, tuple[int, ...]], ...] = (
        ("solid", 1.3, (WORKING,)),
        ("solid", 0.7, tuple({*range(REFILLING_STATUS + 1)} - {WORKING, REVERSING})),
        ("dotted", 1.5, (REVERSING,)),
    )
    for style, width, wanted in looks:
        lines = [part.points for part in parts if part.status in wanted]
        axes.add_collection(
            LineCollection(lines, colors=colour, linewidths=width, linestyles=style, zorder=4), autolim=False
        )
    for x, y, _ in waits(xy, status, drive.step_s):
        axes.plot(x, y, marker="s", markersize=4, markerfacecolor="white", markeredgecolor=colour, zorder=5)
    for x, y, _ in waits(xy, status, drive.step_s, REFILLING_STATUS):
        axes.plot(x, y, marker="D", markersize=5, markerfacecolor="white", markeredgecolor=colour, zorder=5)
    axes.plot(*xy[0], marker="o", markersize=11, color=colour, markeredgecolor="white", linestyle="none", zorder=7)
    axes.annotate(
        str(number + 1), xy[0], color="white", fontsize=7, fontweight="bold", ha="center", va="center", zorder=8
    )


def _draw_marks(axes: Axes, marks: Sequence[WorkMark], colour: str) -> None:
    from matplotlib.collections import PolyCollection

    heads = [mark.head for mark in marks]
    axes.add_collection(PolyCollection(heads, facecolors=colour, edgecolors="none", zorder=5), autolim=False)
    _write(axes, leg_numbers(marks), colour, 5.5, 5.5, bold=True)


def draw_names(axes: Axes, drive: Drive, size: float) -> None:
    """Numbers of tracks and rounds, outlines of cells with their number and bearing."""
    for cell in drive.cells:
        look = {"facecolor": "none", "edgecolor": INK, "linewidth": 1.0, "linestyle": (0, (6, 3)), "zorder": 5.8}
        axes.add_patch(_patch(cell.rings, **look))
    _write(axes, track_labels(drive, size), INK, 6.5, 6)
    _write(axes, round_labels(drive, size), palette.EDGE, 6.5, 6.2, bold=True)
    _write(axes, cell_labels(drive), INK, 9, 6.4, bold=True)


def _write(
    axes: Axes, labels: Sequence[Label], colour: str, size: float, zorder: float, *, bold: bool = False
) -> None:
    """Texts with a pale edge where paths run under them."""
    from matplotlib.patheffects import withStroke

    for label in labels:
        x, y = label.place
        text = axes.annotate(
            label.text, (x, y), color=colour, fontsize=size, fontweight="bold" if bold else "normal", ha="center",
            va="center", zorder=zorder,
        )  # fmt: skip
        text.set_path_effects([withStroke(linewidth=0.3 * size, foreground="white")])


def draw_scale(axes: Axes, box: Extent) -> None:
    """A scale bar below the field on the left, a north arrow on the right."""
    size = box.size or 1.0
    bar = round_length(max(box.width, 0.5 * size) / 4)
    y = box.south - 0.06 * size
    axes.plot([box.west, box.west + bar], [y, y], color=INK, linewidth=2.5, solid_capstyle="butt", zorder=6)
    axes.annotate(f"{bar:g} m", (box.west + bar, y), xytext=(6, 0), textcoords="offset points", va="center", fontsize=9)
    axes.annotate(
        "N",
        xy=(box.east, y + 0.05 * size),
        xytext=(box.east, y),
        ha="center",
        va="center",
        fontsize=10,
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.2},
    )
