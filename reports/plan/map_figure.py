"""The map of a drive with matplotlib: its layers from the ground up to the labels, title, legend and leg lists."""

from __future__ import annotations

import base64
import io
import math
import textwrap
import warnings
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from fields.arrays import Floats
from reports.common import palette
from reports.common.drawing_sizes import EDGE_SHARE, HATCH_SHARE, LINE_INCHES, NARROWEST_INCHES, PAGE_INCHES
from reports.common.plan_records import PlanDrive
from reports.common.rendering import create_figure
from reports.common.wording import format_area, format_duration, format_tractor_count
from reports.plan.drive_geometry import (
    FOLDING_STATUS,
    REVERSING,
    SERVICE_STATUS,
    STATUS_BY_STATE,
    WORKING,
    MapExtent,
    build_hatching,
    build_swath_outline,
    choose_round_length_m,
    compute_extent,
    find_stops,
    split_by_status,
)
from reports.plan.leg_list import format_leg_heading, format_leg_rows
from reports.plan.map_labels import (
    MapLabel,
    count_tracks,
    place_cell_labels,
    place_ground_labels,
    place_headland_pass_labels,
    place_leg_marks,
    place_swath_labels,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch


OTHER_FONTS = (
    "Noto Sans CJK JP", "Noto Sans JP", "IPAexGothic", "Hiragino Sans", "Yu Gothic", "MS Gothic", "Arial Unicode MS",
)  # fmt: skip
_BUFFER_STYLE = {"cap_style": "flat", "join_style": "mitre", "mitre_limit": 2.0}
_SAME_PLACE_M = 1.0  # tractors that begin nearer than this have their numbers beside each other
_POINTER = [(0.0, 0.0), (-0.6, 1.0), (0.6, 1.0), (0.0, 0.0)]  # a triangle that points at its place
_FAULT_LOOK: dict[str, Any] = {
    "marker": "o", "markersize": 16, "markerfacecolor": "none", "markeredgecolor": palette.UNWORKED_COLOUR,
    "markeredgewidth": 2.5, "linestyle": "none", "zorder": 9,
}  # fmt: skip
_LETTERS_PER_INCH = 11.0  # of a title of 11 points; height of its lines
_EDGE_INCHES = 0.2  # margin around everything
_TALLEST_INCHES = 9.0  # height of a map
_FOOT_SHARE = 0.1  # of the larger side of the field: margin below it with the scale
_MARK_INCHES = 1.6  # width of an entry of the legend
_LIST_INCHES, _LIST_POINTS, _LIST_SPACING = 3.1, 5.6, 1.2  # a column of the lists of legs
_ROW_INCHES, _LETTER_INCHES = _LIST_POINTS * _LIST_SPACING / 72.0, 0.602 * _LIST_POINTS / 72.0
_MOST_LIST_ROWS = 70  # below the map


def draw_field_ground(axes: Axes, drive: PlanDrive) -> None:
    """The field, the bands of its headland passes, its swaths, obstacles, outline and fences."""
    from matplotlib.collections import LineCollection, PolyCollection

    outline = [drive.boundary, *drive.holes]
    field_patch = build_patch(outline, facecolor=palette.FIELD_COLOUR, edgecolor="none", zorder=1)
    axes.add_patch(field_patch)
    if drive.relief is not None:  # shading and contours
        west, south, east, north = drive.relief.bounds_m
        picture = axes.imshow(
            drive.relief.shade, cmap="gray", vmin=0.0, vmax=1.0, alpha=palette.SHADE_OPACITY,
            extent=(west, east, south, north), origin="lower", interpolation="bilinear", zorder=1.2, aspect="equal",
        )  # fmt: skip
        contours = [points for _, points in drive.relief.contours]
        lines = LineCollection(contours, colors=palette.CONTOUR_COLOUR, linewidths=0.5, zorder=1.8)
        axes.add_collection(lines, autolim=False)
        for artist in (picture, lines):
            artist.set_clip_path(field_patch)
    for headland_pass in drive.headland_passes:
        band = shapely.LineString(headland_pass.points).buffer(0.5 * drive.width_m, **_BUFFER_STYLE)
        parts = shapely.get_parts(band)
        rings = [np.asarray(ring.coords) for part in parts for ring in (part.exterior, *part.interiors)]
        colour = palette.HEADLAND_PASS_COLOURS[headland_pass.number % 2]
        patch = axes.add_patch(build_patch(rings, facecolor=colour, edgecolor="none", zorder=1.1))
        patch.set_clip_path(field_patch)
    strips = [build_swath_outline(track, drive.width_m) for track in drive.swaths]
    look: dict[str, Any] = {"facecolors": "none", "edgecolors": palette.SWATH_COLOUR, "linewidths": 0.5, "zorder": 2}
    axes.add_collection(PolyCollection(strips, **look), autolim=False)
    if drive.done:
        axes.add_patch(build_patch(drive.done, facecolor=palette.DONE_COLOUR, alpha=0.75, edgecolor="none", zorder=2.1))
    for ring in drive.obstacles:
        axes.add_patch(build_patch([ring], facecolor=palette.OBSTACLE_COLOUR, edgecolor="none", zorder=2.2))
    axes.add_patch(build_patch(outline, facecolor="none", edgecolor=palette.EDGE_COLOUR, linewidth=1.2, zorder=3))
    for line in drive.fences:
        axes.plot(*line.T, color=palette.INK_COLOUR, linewidth=2.2, linestyle=(0, (2, 1)), zorder=3.1)


def build_patch(rings: Sequence[Floats], **look: object) -> PathPatch:
    """Closed rings as one shape, holes left out."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    outlines = (Outline(np.vstack([ring, ring[:1]]), closed=True) for ring in rings)
    return PathPatch(Outline.make_compound_path(*outlines), **look)


def _draw_path(axes: Axes, drive: PlanDrive, number: int) -> None:
    from matplotlib.collections import LineCollection

    xy, status = drive.xy[number], drive.status[number]
    colour = palette.get_tractor_colour(number)
    parts = split_by_status(xy, status)
    looks: tuple[tuple[str, float, tuple[int, ...]], ...] = (
        ("solid", 1.3, (WORKING,)),
        ("solid", 0.7, tuple({*range(FOLDING_STATUS + 1)} - {WORKING, REVERSING})),
        ("dotted", 1.5, (REVERSING,)),
    )
    for style, width, statuses in looks:
        lines = [points for part_status, points in parts if part_status in statuses]
        collection = LineCollection(lines, colors=colour, linewidths=width, linestyles=style, zorder=4)
        axes.add_collection(collection, autolim=False)
    stops = (("s", 4, STATUS_BY_STATE["waiting"]), ("D", 5, SERVICE_STATUS), ("H", 5, FOLDING_STATUS))
    for marker, size, stop_status in stops:
        look: dict[str, Any] = {"marker": marker, "markersize": size, "markerfacecolor": "white"}
        for x, y, _ in find_stops(xy, status, drive.step_s, stop_status):
            axes.plot(x, y, markeredgecolor=colour, zorder=5, **look)
    axes.plot(*xy[-1], marker="X", markersize=8, color=colour, markeredgecolor="white", linestyle="none", zorder=6.9)
    beside = sum(bool(np.hypot(*(other[0] - xy[0])) < _SAME_PLACE_M) for other in drive.xy[:number])
    look = {"color": "white", "fontsize": 7, "fontweight": "bold", "ha": "center", "va": "center", "zorder": 7}
    disc = {"boxstyle": "circle", "facecolor": colour, "edgecolor": "white"}
    axes.annotate(str(number + 1), xy[0], (12 * beside, 0), textcoords="offset points", bbox=disc, **look)


def _write_labels(
    axes: Axes, labels: Sequence[MapLabel], colour: str, size: float, zorder: float, *, bold: bool = False
) -> None:
    """Labels with a pale edge, so that they can be read over paths."""
    from matplotlib.patheffects import withStroke

    for label in labels:
        x, y = label.place
        text = axes.annotate(
            label.text, (x, y), color=colour, fontsize=size, fontweight="bold" if bold else "normal", ha="center",
            va="center", zorder=zorder,
        )  # fmt: skip
        text.set_path_effects([withStroke(linewidth=0.3 * size, foreground="white")])


def draw_scale_and_north(axes: Axes, box: MapExtent) -> None:
    """A scale bar below the field on the left, a north arrow on the right."""
    size = box.size or 1.0
    bar = choose_round_length_m(max(box.width, 0.5 * size) / 4)
    y = box.south - 0.06 * size
    look: dict[str, Any] = {"linewidth": 2.5, "solid_capstyle": "butt", "zorder": 6}
    axes.plot([box.west, box.west + bar], [y, y], color=palette.INK_COLOUR, **look)
    axes.annotate(f"{bar:g} m", (box.west + bar, y), xytext=(6, 0), textcoords="offset points", va="center", fontsize=9)
    arrow = {"arrowstyle": "-|>", "color": palette.INK_COLOUR, "linewidth": 1.2}
    top = (box.east, y + 0.05 * size)
    axes.annotate("N", top, (box.east, y), ha="center", va="center", fontsize=10, arrowprops=arrow)


def draw_plan_map(drive: PlanDrive, field_name: str = "") -> Figure:
    """The field and each tractor's path, to scale, north up, with start and end, entrance, scale bar and legend.

    Tracks and headland passes have their numbers, cells their outline, number and bearing, worked legs their direction
    and number, as many as have room. Leg lists are beside or below the map where they fit. Unworked ground is hatched,
    its largest piece has its area. A drive without tractors shows the field and its swaths. Places that cannot be
    driven are ringed.
    """
    across, up = measure_map(compute_extent(drive))
    lists = _format_leg_columns(drive, int(up / _ROW_INCHES) - 1)
    width = across + 3 * _EDGE_INCHES + _measure_list_inches(lists) * len(lists)
    has_lists_beside = bool(lists) and width <= PAGE_INCHES
    if not has_lists_beside:
        lists, width = _format_leg_columns(drive, _MOST_LIST_ROWS), max(across + 2 * _EDGE_INCHES, NARROWEST_INCHES)
        has_room = len(lists) * _measure_list_inches(lists) + _EDGE_INCHES <= width
        lists = lists if has_room else []
    rows = 0 if has_lists_beside else max((text.count("\n") + 1 for text in lists), default=0)
    lists_height = _ROW_INCHES * rows + _EDGE_INCHES if rows else 0.0
    title = _wrap_title(drive, field_name, width)
    title_height = _EDGE_INCHES + LINE_INCHES * len(title)
    entries, legend_columns = build_legend_entries(drive), max(2, int(width / _MARK_INCHES))
    legend_height = LINE_INCHES * math.ceil(len(entries) / legend_columns) + _EDGE_INCHES
    height = title_height + up + legend_height + lists_height
    figure = create_figure(width, height)
    left_edge, bottom = _EDGE_INCHES if has_lists_beside else 0.5 * (width - across), legend_height + lists_height
    draw_map_layers(figure.add_axes((left_edge / width, bottom / height, across / width, up / height)), drive)
    look: dict[str, Any] = {"ha": "left", "va": "top", "color": palette.INK_COLOUR}
    heading, heading_y = escape_figure_formula("\n".join(title)), 1.0 - 0.5 * _EDGE_INCHES / height
    figure.suptitle(heading, x=_EDGE_INCHES / width, y=heading_y, fontsize=11, linespacing=1.4, **look)
    figure.legend(
        handles=entries, loc="upper center", bbox_to_anchor=(0.5, bottom / height), ncols=legend_columns,
        frameon=False, fontsize=9, borderaxespad=0.0,
    )  # fmt: skip
    left_edge = across + 2 * _EDGE_INCHES if has_lists_beside else _EDGE_INCHES
    top = height - title_height if has_lists_beside else lists_height
    look |= {"fontsize": _LIST_POINTS, "family": "monospace", "linespacing": _LIST_SPACING}
    for column, text in enumerate(lists):
        left = (left_edge + column * _measure_list_inches(lists)) / width
        figure.text(left, top / height, escape_figure_formula(text), **look)
    return figure


def draw_map_layers(axes: Axes, drive: PlanDrive) -> None:
    """Everything on the ground, with scale and north arrow, but without title, legend and leg lists.

    Hatching lies over unworked ground, with the area of its largest piece; every tractor has its path with its start,
    end and stops, and its worked legs with direction and number.
    """
    from matplotlib.collections import LineCollection, PolyCollection

    box, ink = compute_extent(drive), palette.INK_COLOUR
    size = box.size
    frame_map(axes, box)
    draw_field_ground(axes, drive)
    if drive.unworked:
        lines = [*build_hatching(drive.unworked, HATCH_SHARE * (size or 1.0))]
        lines += [np.vstack([ring, ring[:1]]) for ring in drive.unworked]
        hatching = LineCollection(lines, colors=palette.UNWORKED_COLOUR, linewidths=0.5, zorder=2.4)
        axes.add_collection(hatching, autolim=False)
    _write_labels(axes, place_ground_labels(drive, box), palette.UNWORKED_COLOUR, 9, 9, bold=True)
    for number, marks in enumerate(place_leg_marks(drive, size)):
        _draw_path(axes, drive, number)
        heads, colour = [head for head, _ in marks], palette.get_tractor_colour(number)
        axes.add_collection(PolyCollection(heads, facecolors=colour, edgecolors="none", zorder=5), autolim=False)
        _write_labels(axes, [label for _, label in marks if label.text], colour, 5.5, 5.5, bold=True)
    if drive.entrance is not None:
        axes.plot(*drive.entrance, marker=_POINTER, color=ink, markersize=22, linestyle="none", zorder=6)
    for cell in drive.cells:
        look = {"edgecolor": ink, "linewidth": 1.0, "linestyle": (0, (6, 3)), "zorder": 5.8}
        axes.add_patch(build_patch(cell.rings, facecolor="none", **look))
    _write_labels(axes, place_swath_labels(drive, size), ink, 6.5, 6)
    _write_labels(axes, place_headland_pass_labels(drive, size), palette.EDGE_COLOUR, 6.5, 6.2, bold=True)
    _write_labels(axes, place_cell_labels(drive), ink, 9, 6.4, bold=True)
    for place in drive.fault_places:
        axes.plot(*place, **_FAULT_LOOK)
    draw_scale_and_north(axes, box)


def frame_map(axes: Axes, box: MapExtent) -> None:
    """Axes to scale around a box, with room below for the scale bar and without ticks."""
    size = box.size or 1.0
    axes.set_aspect("equal")
    axes.set_xlim(box.west - EDGE_SHARE * size, box.east + EDGE_SHARE * size)
    axes.set_ylim(box.south - _FOOT_SHARE * size, box.north + EDGE_SHARE * size)
    axes.set_axis_off()


def measure_map(box: MapExtent) -> tuple[float, float]:
    """Width and height in inches of a map framed around a box, as large as a page has room."""
    size = box.size or 1.0
    across_m, up_m = box.width + 2 * EDGE_SHARE * size, box.height + (EDGE_SHARE + _FOOT_SHARE) * size
    scale = min((PAGE_INCHES - 2 * _EDGE_INCHES) / across_m, _TALLEST_INCHES / up_m)
    return round(float(across_m * scale), 4), round(float(up_m * scale), 4)


def render_png(figure: Figure) -> bytes:
    """A figure as a PNG file of 150 dots an inch; what no font of the machine shows is a box."""
    from matplotlib.font_manager import fontManager
    from matplotlib.text import Text

    installed = {font.name for font in fontManager.ttflist}
    others = [name for name in OTHER_FONTS if name in installed]
    for text in figure.findobj(Text):  # for letters that matplotlib's own fonts lack
        text.set_fontfamily([*text.get_fontfamily(), *others])
    buffer = io.BytesIO()
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing from font", UserWarning)
        figure.savefig(buffer, dpi=150, format="png", facecolor="white", metadata={"Software": "Headland"})
    return buffer.getvalue()


def render_svg(figure: Figure) -> str:
    """A figure as SVG text; the same figure gives the same bytes."""
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "headland", "svg.fonttype": "none"}):
        figure.savefig(buffer, format="svg", metadata={"Date": None, "Creator": None})
    return buffer.getvalue()


def encode_svg_base64(figure: Figure) -> str:
    """A figure as SVG for a data URL, in base64: its styles then do not apply to the page."""
    return base64.b64encode(render_svg(figure).encode()).decode("ascii")


def _measure_list_inches(columns: list[str]) -> float:
    """Width of a column of the leg lists: at least that of usual ones, else of the longest row with a gap."""
    longest = max((len(row) for text in columns for row in text.split("\n")), default=0)
    return max(_LIST_INCHES, _LETTER_INCHES * (longest + 2))


def _wrap_title(drive: PlanDrive, field_name: str, width: float) -> list[str]:
    """Field and plan, then the figures of the drive, in lines for a figure of `width` inches."""
    count = len(drive.xy)
    first = f"{field_name}: {drive.title}" if field_name and field_name not in drive.title else drive.title
    track_count = count_tracks(drive)
    tracks = f"{track_count} track{'' if track_count == 1 else 's'}"
    second = [f"width {drive.width_m:g} m", *([] if tracks in first else [tracks])]
    if passes := max((headland_pass.number for headland_pass in drive.headland_passes), default=0):
        order = "" if drive.headland_order is None else f" {drive.headland_order}"
        second.append(f"{passes} headland pass{'es' if passes > 1 else ''}{order}")
    if count:
        second += [] if format_tractor_count(count) in first else [format_tractor_count(count)]
        drawn_s = max(drive.finish_s)
        stated_s = drawn_s if drive.stated_end_s is None else drive.stated_end_s
        drawn, stated = format_duration(drawn_s), format_duration(stated_s)
        without = ", without late starts, stops and breakdowns" if drive.has_delays else ""
        differs = "" if stated == drawn else f" (the drive as drawn{without}: {drawn})"
        second.append(f"done in {stated}{differs}")
    if drive.worked_pct is not None:
        second.append(f"{drive.worked_pct:.1f} % worked")
    if drive.cut_off:
        second.append(f"{format_area(math.fsum(one.m2 for one in drive.cut_off))} cut off by obstacles")
    room = int(width * _LETTERS_PER_INCH)
    return [line for text in (first, ", ".join(second)) for line in textwrap.wrap(text, room)]


def _format_leg_columns(drive: PlanDrive, most_rows: int) -> list[str]:
    """The leg lists as columns of text of at most `most_rows` rows; short lists share a column, long ones are split."""
    columns: list[list[str]] = []
    for number, steps in enumerate(drive.steps, start=1):
        rows = format_leg_rows(steps, drive.start)
        share = math.ceil(len(rows) / max(math.ceil(len(rows) / max(most_rows - 1, 1)), 1))
        for first in range(0, len(rows), max(share, 1)):
            title = format_leg_heading(number, steps) if not first else f"Tractor {number}, continued"
            block = [title, *rows[first : first + share]]
            if columns and len(columns[-1]) + 1 + len(block) <= most_rows:
                columns[-1] += ["", *block]
            else:
                columns.append(block)
    return ["\n".join(column) for column in columns]


def build_legend_entries(drive: PlanDrive) -> list[Artist]:
    """What the map of a drive explains: tractors, kinds of driving, and what is on the ground."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    count, ink = len(drive.xy), palette.INK_COLOUR
    driven = {int(value) for status in drive.status for value in np.unique(status)}
    line = partial(Line2D, [], [])
    mark = partial(line, linestyle="none", markeredgecolor=ink)
    number = partial(line, linestyle="none", markersize=6.5, markeredgewidth=0.4)
    relief = "" if drive.relief is None else drive.relief.label
    even_pass, odd_pass = palette.HEADLAND_PASS_COLOURS
    tractors = [line(color=palette.get_tractor_colour(n), linewidth=3, label=f"tractor {n + 1}") for n in range(count)]
    entries: list[tuple[object, Artist]] = [
        (count, line(color=ink, linewidth=1.8, label="working")),
        (count, line(color=ink, linewidth=0.7, label="turning")),
        (not count, line(color=palette.SWATH_COLOUR, linewidth=1.0, label=f"tracks of {drive.width_m:g} m")),
        (drive.steps, number(marker="$5$", color=palette.get_tractor_colour(0), label="number of a leg")),
        (count and len(drive.swaths), number(marker="$7$", color=ink, label="number of a track")),
        (
            drive.headland_sides,
            number(marker="$R1.2$", color=palette.EDGE_COLOUR, markersize=20, label="round 1, side 2"),
        ),
        (REVERSING in driven, line(color=ink, linewidth=1.5, linestyle="dotted", label="reversing")),
        (STATUS_BY_STATE["waiting"] in driven, mark(marker="s", markerfacecolor="white", label="waiting")),
        (SERVICE_STATUS in driven, mark(marker="D", markerfacecolor="white", label=drive.service)),
        (FOLDING_STATUS in driven, mark(marker="H", markerfacecolor="white", label="fold or unfold")),
        (count, mark(marker="o", markerfacecolor="grey", label="start")),
        (count, mark(marker="X", markerfacecolor="grey", label="end")),
        (drive.entrance, mark(marker="v", markerfacecolor=ink, label="entrance")),
        (drive.headland_passes, Patch(facecolor=odd_pass, edgecolor=even_pass, label="headland passes")),
        (drive.cells, line(color=ink, linewidth=1.0, linestyle="dashed", label="cells")),
        (relief, line(color=palette.CONTOUR_COLOUR, linewidth=0.8, label=relief)),
        (drive.obstacles, Patch(facecolor=palette.OBSTACLE_COLOUR, edgecolor="none", label="obstacles")),
        (drive.fences, line(color=ink, linewidth=2.2, linestyle=(0, (2, 1)), label="fences")),
        (drive.fault_places, line(label="cannot be driven", **{**_FAULT_LOOK, "markersize": 9})),
        (drive.done, Patch(facecolor=palette.DONE_COLOUR, edgecolor="none", label="done before")),
        (drive.unworked, Patch(facecolor="none", edgecolor=palette.UNWORKED_COLOUR, hatch="/////", label="not worked")),
    ]
    return [*tractors, *(handle for is_shown, handle in entries if is_shown)]


def escape_figure_formula(text: str) -> str:
    """Text that matplotlib does not read as a formula."""
    return text.replace("$", r"\$")
