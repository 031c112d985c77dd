"""Pictures of a day with matplotlib: the work of every machine and field over time, and the roads between them."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from reports import palette
from reports.day_results import DayResult, MapPlace
from reports.day_table import at
from reports.layers import INK
from reports.paths import round_length
from reports.wording import percent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, ROW, HEAD = 10.0, 0.46, 0.95  # inches: of the picture, of a row, of titles and hours
MAP_INCHES, LEAST_M = 8.0, 100.0  # of the map; what it shows at least
HOUR_S = 3600.0
STEPS_H = (0.25, 0.5, 1, 2, 3, 6, 12, 24)
PALE, ROAD, PAUSE, RAIN = "#E4E8DA", "#9A9A8E", "#F0EFEA", "#0072B2"
LONGEST = 22  # letters of a name beside a row
FOOT = 0.24  # inches below for the legend
LEGEND = (
    "Grey: ways, folding and unfolding. Line behind a bar: end in 95 of 100 draws. "
    "Pale: above breaks, below the hours of the field."
)
NARROW = 0.045  # of the width: what a bar must have for its name


def gantt_figure(result: DayResult) -> Figure:
    """What every machine does over the day, and below when every field may be worked and is.

    Ways are thin and grey, breaks pale bands, the rain dashed lines with its percentages. A bar is the mean time; below
    a line behind it reaches to the end in 95 of 100 draws.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = len(result.fleets), len(result.fields)
    height = ROW * sum(rows) + 2 * HEAD + FOOT
    figure = Figure(figsize=(WIDTH, height))
    FigureCanvasAgg(figure)
    machines, fields = figure.subplots(2, 1, sharex=True, height_ratios=[max(count, 1) for count in rows])
    left, right = _span(result)
    for axes, names, title in (
        (machines, [fleet.name for fleet in result.fleets], "By machine"), (fields, list(result.fields), "By field"),
    ):  # fmt: skip
        _frame(axes, names, title, result, (left, right))
    _machines(machines, result, right - left)
    _fields(fields, result, right - left)
    bottom = (0.5 + FOOT) / height
    figure.subplots_adjust(left=0.17, right=0.98, top=1.0 - 0.42 / height, bottom=bottom, hspace=1.1 / height * 2)
    figure.text(0.17, 0.16 / height, LEGEND, fontsize=8, color=INK, va="center")
    return figure


def map_figure(result: DayResult, *, titled: bool = True) -> Figure | None:
    """Fields, yard and the roads that are driven, north up, in metres; None where fewer than two places are known.

    `titled` writes above what it shows. Roads are straight lines with their kilometres; every machine has its colour,
    an arrow its direction.
    """
    if len(result.places) < 2:
        return None
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(MAP_INCHES, MAP_INCHES))
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.92))
    axes.set_aspect("equal")
    axes.set_axis_off()
    west, east, south, north = _extent(result.places)
    size = max(east - west, north - south, LEAST_M)
    axes.set_xlim(west - 0.12 * size, east + 0.12 * size)
    axes.set_ylim(south - 0.16 * size, north + 0.1 * size)
    for place in result.places:
        _place(axes, place, result)
    _roads(axes, result)
    _scale(axes, west, south - 0.12 * size, round_length(size / 4))
    if titled:
        figure.text(0.03, 0.96, "Fields and roads", fontsize=11, color=INK, va="center")
    return figure


def _span(result: DayResult) -> tuple[float, float]:
    """From when to when the picture goes."""
    ends = [job.p95_end_s for job in result.jobs] + [fleet.home_s for fleet in result.fleets if fleet.home_s]
    last = max(ends, default=result.start_s + 6 * HOUR_S)
    return result.start_s, max(last + 0.03 * (last - result.start_s), result.start_s + HOUR_S)


def _frame(axes: Axes, names: list[str], title: str, result: DayResult, span: tuple[float, float]) -> None:
    """Rows with their names, hours, breaks and rain."""
    axes.set_xlim(*span)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_yticks(range(len(names)), [_literal(_short(name)) for name in names], fontsize=9, color=INK)
    step = next((step for step in STEPS_H if (span[1] - span[0]) / HOUR_S / step <= 12), 24)
    first = math.ceil(span[0] / HOUR_S / step)
    ticks = [number * step * HOUR_S for number in range(first, math.floor(span[1] / HOUR_S / step) + 1)]
    axes.set_xticks(ticks, [at(tick) for tick in ticks], fontsize=8, color=INK)
    axes.tick_params(length=0, labelbottom=True)
    axes.grid(axis="x", color="#DCDCCF", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(title, loc="left", fontsize=10, color=INK)
    for start, end in result.breaks:
        axes.axvspan(max(start, span[0]), min(end, span[1]), color=PAUSE, zorder=0)
    for onset, share in result.rain if len(result.rain) <= 12 else ():
        if span[0] <= onset <= span[1]:
            axes.axvline(onset, color=RAIN, linestyle="dashed", linewidth=0.9, zorder=2)
            axes.text(onset, -0.55, f" rain {percent(share)} %", fontsize=7, color=RAIN, va="top")


def _machines(axes: Axes, result: DayResult, span: float) -> None:
    for row, fleet in enumerate(result.fleets):
        jobs = [job for job in result.jobs if job.machine == fleet.name]
        for job in jobs:
            colour = palette.tractor_colour(row)
            axes.barh(row, job.start_s - job.leaves_s, left=job.leaves_s, height=0.14, color=ROAD, zorder=3)
            axes.barh(row, job.end_s - job.start_s, left=job.start_s, height=0.5, color=colour, zorder=4)
            _name(axes, row, (job.start_s, job.end_s), job.field, span)
        if jobs and fleet.home_s is not None:
            axes.barh(row, fleet.home_s - jobs[-1].end_s, left=jobs[-1].end_s, height=0.14, color=ROAD, zorder=3)


def _fields(axes: Axes, result: DayResult, span: float) -> None:
    names = [fleet.name for fleet in result.fleets]
    for row, windows in enumerate(result.windows):
        for opens, closes in windows:
            axes.barh(row, closes - opens, left=opens, height=0.72, color=PALE, zorder=1)
    for job in result.jobs:
        row, colour = result.fields.index(job.field), palette.tractor_colour(names.index(job.machine))
        _bar(axes, row, (job.start_s, job.end_s, job.p95_end_s), colour)
        chance = f"{percent(job.finish_probability)} %"
        _name(axes, row, (job.start_s, job.end_s), chance, span)
    for one in result.not_done:
        row = result.fields.index(one.field)
        axes.text(result.start_s, row, " left", fontsize=8, color=palette.MISSED, va="center")


def _bar(axes: Axes, row: int, times: tuple[float, float, float], colour: str) -> None:
    start, end, late = times
    axes.plot([end, max(late, end)], [row, row], color=colour, linewidth=1.2, zorder=2)
    axes.barh(row, end - start, left=start, height=0.5, color=colour, zorder=4)


def _name(axes: Axes, row: int, times: tuple[float, float], text: str, span: float) -> None:
    """A name on its bar where that has room."""
    start, end = times
    room = (end - start) / span / NARROW * 6
    if room >= 4:
        shown = text if len(text) <= room else text[: max(int(room) - 1, 1)] + "…"
        axes.annotate(
            _literal(shown), (0.5 * (start + end), row), ha="center", va="center", fontsize=8, color="white", zorder=5
        )


def _extent(places: tuple[MapPlace, ...]) -> tuple[float, float, float, float]:
    """West, east, south and north of all that is drawn."""
    east = [place.x_m for place in places]
    north = [place.y_m for place in places]
    for place in places:
        if place.outline is not None:
            east += [float(place.outline[:, 0].min()), float(place.outline[:, 0].max())]
            north += [float(place.outline[:, 1].min()), float(place.outline[:, 1].max())]
    return min(east), max(east), min(north), max(north)


def _place(axes: Axes, place: MapPlace, result: DayResult) -> None:
    """A field with its outline and name, or the yard."""
    done = {job.field: job.machine for job in result.jobs}
    names = [fleet.name for fleet in result.fleets]
    if place.outline is None:
        axes.plot(place.x_m, place.y_m, marker="s", markersize=8, color=INK, zorder=6)
    else:
        colour = palette.tractor_colour(names.index(done[place.name])) if place.name in done else palette.MISSED
        axes.fill(*place.outline.T, facecolor=palette.FIELD, edgecolor=colour, linewidth=1.6, zorder=3)
        axes.plot(place.x_m, place.y_m, marker="o", markersize=3, color=colour, zorder=6)
    left = "" if place.name in done or place.outline is None else " (left)"
    top = place.y_m if place.outline is None else float(place.outline[:, 1].max())
    axes.annotate(
        _literal(place.name + left), (place.x_m, top), (0, 6), textcoords="offset points", ha="center",
        fontsize=9, color=INK, zorder=7,
    )  # fmt: skip


def _roads(axes: Axes, result: DayResult) -> None:
    """The ways of every machine in order, as far as both ends are known."""
    spots = {place.name: (place.x_m, place.y_m) for place in result.places}
    yard = next((place.name for place in result.places if place.outline is None), None)
    for number, fleet in enumerate(result.fleets):
        jobs = [job for job in result.jobs if job.machine == fleet.name]
        stops = [yard, *(job.field for job in jobs), yard] if jobs else []
        lengths = [*(job.km for job in jobs), fleet.km - sum(job.km for job in jobs)]
        for a, b, km in zip(stops[:-1], stops[1:], lengths, strict=False):
            if a in spots and b in spots:
                axes.annotate(
                    "", spots[b], spots[a],
                    arrowprops={"arrowstyle": "-|>", "color": palette.tractor_colour(number), "linewidth": 1.4,
                                "connectionstyle": "arc3,rad=0.08", "shrinkA": 5, "shrinkB": 5}, zorder=4,
                )  # fmt: skip
                x, y = (0.5 * (one + other) for one, other in zip(spots[a], spots[b], strict=True))
                paper = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
                colour = palette.tractor_colour(number)
                axes.text(x, y, f"{km:.1f} km", fontsize=7.5, color=colour, ha="center", bbox=paper, zorder=5)


def _scale(axes: Axes, x: float, y: float, length: float) -> None:
    axes.plot([x, x + length], [y, y], color=INK, linewidth=2)
    shown = f"{length / 1000.0:g} km" if length >= 1000.0 else f"{length:g} m"
    axes.annotate(shown, (x + 0.5 * length, y), (0, 4), textcoords="offset points", ha="center", fontsize=8, color=INK)


def _short(name: str) -> str:
    return name if len(name) <= LONGEST else name[: LONGEST - 1] + "…"


def _literal(text: str) -> str:
    """Text in which matplotlib reads no formula."""
    return text.replace("$", r"\$")
