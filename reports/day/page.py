"""A day as pictures (work over time, fields and roads), as one page that loads nothing, and in a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fields.units import HOUR_S
from reports.common import palette
from reports.common.drawing_sizes import COLUMN_INCHES, LINE_INCHES, PAGE_INCHES, TIME_STEPS_S, ChartAxis
from reports.common.rendering import (
    EXPORT_DECIMALS,
    ResultView,
    build_view,
    create_figure,
    encode_figure,
    make_json_safe,
    render_template,
)
from reports.common.text_tables import build_plain_table, render_fragment
from reports.common.wording import format_number, format_percent
from reports.day.results import DayResult, format_end_of_day, format_time_of_day, list_day_sentences
from reports.day.tables import (
    build_job_table,
    build_machine_table,
    build_unworked_table,
    describe_day_columns,
    describe_optimality_gap,
    format_day_csv,
    format_day_json,
    list_money_rows,
    sort_by_field,
)
from reports.plan.drive_geometry import bound_points, choose_round_length_m
from reports.plan.figures import flatten_entry
from reports.plan.map_figure import encode_svg_base64, escape_figure_formula, render_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

ROW_INCHES, HEAD_INCHES = 0.46, 0.95  # inches: of the picture, of a row, of titles and hours
LEAST_MAP_M = 100.0  # what the map shows at least
WINDOW_COLOUR, ROAD_COLOUR, BREAK_COLOUR, RAIN_COLOUR = "#E4E8DA", "#9A9A8E", "#F0EFEA", "#0072B2"
LONGEST_NAME_CHARS = 22  # letters of a name beside a row
GANTT_LEGEND = (
    "Grey: road, folding and unfolding. Thin line: end in 95 % of the samples. "
    "Pale: breaks (above), hours of the field (below)."
)
NARROWEST_LABELLED_BAR = 0.045  # of the width: what a bar must have for its name
MOST_JOBS = 30  # in a fragment; to_pandas has all
DAY_INCHES = (PAGE_INCHES, 4.0)


def draw_gantt(result: DayResult) -> Figure:
    """The work of every machine over the day, below it that of every field with the hours in which it may be worked.

    Roads are thin and grey, breaks pale bands, rain dashed lines with its probability. A bar ends at the median; the
    line behind a bar of a field reaches to its end in 95 % of the samples.
    """
    rows = len(result.fleets), len(result.fields)
    height = ROW_INCHES * sum(rows) + 2 * HEAD_INCHES + LINE_INCHES
    figure = create_figure(PAGE_INCHES, height)
    machines, fields = figure.subplots(2, 1, sharex=True, height_ratios=[max(count, 1) for count in rows])
    _draw_machines(machines, result)
    _draw_fields(fields, result)
    bottom = (0.5 + LINE_INCHES) / height
    figure.subplots_adjust(left=0.17, right=0.98, top=1.0 - 0.42 / height, bottom=bottom, hspace=1.1 / height * 2)
    figure.text(0.17, 0.16 / height, GANTT_LEGEND, fontsize=8, color=palette.INK_COLOUR, va="center")
    return figure


def draw_road_map(result: DayResult, *, has_title: bool = True) -> Figure | None:
    """Fields, yard and the roads driven, north up, in metres; None where fewer than two places are known.

    Roads are straight arrows in the colour of the machine, with their kilometres; `has_title` adds a title.
    """
    if len(result.places) < 2:
        return None
    figure = create_figure(COLUMN_INCHES, COLUMN_INCHES)
    axes = figure.add_axes((0.02, 0.02, 0.96, 0.92))
    axes.set_aspect("equal")
    axes.set_axis_off()
    outlines = [place.outline for place in result.places if place.outline is not None]
    box = bound_points([np.array([(place.x_m, place.y_m) for place in result.places]), *outlines])
    size = max(box.size, LEAST_MAP_M)
    axes.set_xlim(box.west - 0.12 * size, box.east + 0.12 * size)
    axes.set_ylim(box.south - 0.16 * size, box.north + 0.1 * size)
    machines = {job.field: job.machine for job in result.jobs}
    names = [fleet.name for fleet in result.fleets]
    ink = palette.INK_COLOUR
    for place in result.places:
        name, top = place.name, place.y_m
        if place.outline is None:  # the yard
            axes.plot(place.x_m, place.y_m, marker="s", markersize=8, color=ink, zorder=6)
        else:
            colour, top = palette.UNWORKED_COLOUR, float(place.outline[:, 1].max())
            if name in machines:
                colour = palette.get_tractor_colour(names.index(machines[name]))
            axes.fill(*place.outline.T, facecolor=palette.FIELD_COLOUR, edgecolor=colour, linewidth=1.6, zorder=3)
            axes.plot(place.x_m, place.y_m, marker="o", markersize=3, color=colour, zorder=6)
            name += "" if name in machines else " (not done)"
        axes.annotate(
            escape_figure_formula(name), (place.x_m, top), (0, 6), textcoords="offset points", ha="center",
            fontsize=9, color=ink, zorder=7,
        )  # fmt: skip
    _draw_roads(axes, result)
    x, y, bar_m = box.west, box.south - 0.12 * size, choose_round_length_m(size / 4)
    axes.plot([x, x + bar_m], [y, y], color=ink, linewidth=2)
    axes.annotate(
        f"{bar_m / 1000.0:g} km" if bar_m >= 1000.0 else f"{bar_m:g} m", (x + 0.5 * bar_m, y), (0, 4),
        textcoords="offset points", ha="center", fontsize=8, color=ink,
    )  # fmt: skip
    if has_title:
        figure.text(0.03, 0.96, "Fields and roads", fontsize=11, color=ink, va="center")
    return figure


def _draw_time_grid(axes: Axes, names: Sequence[str], title: str, result: DayResult) -> None:
    """Rows with their names, hours, breaks and rain."""
    ends = [job.p95_end_s for job in result.jobs]
    ends += [fleet.p50_home_s for fleet in result.fleets if fleet.p50_home_s]
    last = max(ends, default=result.start_s + 6 * HOUR_S)
    span = result.start_s, max(last + 0.03 * (last - result.start_s), result.start_s + HOUR_S)
    axes.set_xlim(*span)
    axes.set_ylim(len(names) - 0.4, -0.6)
    most = LONGEST_NAME_CHARS
    shown = [name if len(name) <= most else f"{name[: most - 1]}…" for name in names]
    labels = [escape_figure_formula(name) for name in shown]
    axes.set_yticks(range(len(names)), labels, fontsize=9, color=palette.INK_COLOUR)
    ticks = ChartAxis(*span, *span).list_ticks(TIME_STEPS_S[TIME_STEPS_S.index(900) :], format_time_of_day, most=12)
    axes.set_xticks(*zip(*ticks, strict=True), fontsize=8, color=palette.INK_COLOUR)
    axes.tick_params(length=0, labelbottom=True)
    axes.grid(axis="x", color="#DCDCCF", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.set_title(title, loc="left", fontsize=10, color=palette.INK_COLOUR)
    for start, end in result.breaks:
        axes.axvspan(max(start, span[0]), min(end, span[1]), color=BREAK_COLOUR, zorder=0)
    for onset, share in result.rain if len(result.rain) <= 12 else ():
        if span[0] <= onset <= span[1]:
            axes.axvline(onset, color=RAIN_COLOUR, linestyle="dashed", linewidth=0.9, zorder=2)
            axes.text(onset, -0.55, f" rain {format_percent(share)} %", fontsize=7, color=RAIN_COLOUR, va="top")


def _draw_machines(axes: Axes, result: DayResult) -> None:
    _draw_time_grid(axes, [fleet.name for fleet in result.fleets], "By machine", result)
    for row, fleet in enumerate(result.fleets):
        jobs = [job for job in result.jobs if job.machine == fleet.name]
        for job in jobs:
            colour, leaves_s = palette.get_tractor_colour(row), job.p50_leaves_s
            start_s, end_s = job.p50_start_s, job.p50_end_s
            axes.barh(row, start_s - leaves_s, left=leaves_s, height=0.14, color=ROAD_COLOUR, zorder=3)
            axes.barh(row, end_s - start_s, left=start_s, height=0.5, color=colour, zorder=4)
            _write_bar_name(axes, row, (start_s, end_s), job.field)
        if jobs and fleet.p50_home_s is not None:
            end_s = jobs[-1].p50_end_s
            axes.barh(row, fleet.p50_home_s - end_s, left=end_s, height=0.14, color=ROAD_COLOUR, zorder=3)


def _draw_fields(axes: Axes, result: DayResult) -> None:
    _draw_time_grid(axes, result.fields, "By field", result)
    names = [fleet.name for fleet in result.fleets]
    for row, windows in enumerate(result.windows):
        for opens, closes in windows:
            axes.barh(row, closes - opens, left=opens, height=0.72, color=WINDOW_COLOUR, zorder=1)
    for job in result.jobs:
        row, colour = result.fields.index(job.field), palette.get_tractor_colour(names.index(job.machine))
        start_s, end_s = job.p50_start_s, job.p50_end_s
        axes.plot([end_s, max(job.p95_end_s, end_s)], [row, row], color=colour, linewidth=1.2, zorder=2)
        axes.barh(row, end_s - start_s, left=start_s, height=0.5, color=colour, zorder=4)
        probability = f"{format_percent(job.finish_probability)} %"
        _write_bar_name(axes, row, (start_s, end_s), probability)
    for unworked in result.unworked_fields:
        row = result.fields.index(unworked.field)
        axes.text(result.start_s, row, " not done", fontsize=8, color=palette.UNWORKED_COLOUR, va="center")


def _write_bar_name(axes: Axes, row: int, times: tuple[float, float], text: str) -> None:
    """A name on its bar, shortened or left out where the bar is too narrow."""
    (start, end), (left, right) = times, axes.get_xlim()
    room = (end - start) / (right - left) / NARROWEST_LABELLED_BAR * 6
    if room >= 4:
        shown = text if len(text) <= room else text[: max(int(room) - 1, 1)] + "…"
        look: dict[str, Any] = {"ha": "center", "va": "center", "fontsize": 8, "color": "white", "zorder": 5}
        axes.annotate(escape_figure_formula(shown), (0.5 * (start + end), row), **look)


def _draw_roads(axes: Axes, result: DayResult) -> None:
    """The roads of every machine in order, where both ends are known."""
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
                    arrowprops={"arrowstyle": "-|>", "color": palette.get_tractor_colour(number), "linewidth": 1.4,
                                "connectionstyle": "arc3,rad=0.08", "shrinkA": 5, "shrinkB": 5}, zorder=4,
                )  # fmt: skip
                x, y = (0.5 * (first + second) for first, second in zip(spots[a], spots[b], strict=True))
                paper = {"facecolor": "white", "edgecolor": "none", "pad": 1.0}
                colour = palette.get_tractor_colour(number)
                axes.text(x, y, f"{km:.1f} km", fontsize=7.5, color=colour, ha="center", bbox=paper, zorder=5)


def render_day_page(result: DayResult) -> str:
    """The page as HTML text."""
    road_map = draw_road_map(result, has_title=False)
    facts = [
        ("Fields done", f"{len(result.jobs)} of {len(result.fields)}"),
        ("Hectares done", format_number(sum(job.area_ha for job in result.jobs), 1)),
    ]
    if result.jobs:
        facts.append(("All done", format_end_of_day(result.p50_done_s)))
        facts.append(("95 %", format_end_of_day(result.p95_done_s)))
    if result.finish_probability is not None:
        facts.append(("All in time", f"{format_percent(result.finish_probability)} %"))
    facts += [(f"{label}, {result.currency}", money) for label, money in list_money_rows(result)]
    content: dict[str, Any] = {
        "title": f"A day of {len(result.fields)} fields",
        "advice": " ".join(list_day_sentences(result)),
        "gap": describe_optimality_gap(result),
        "facts": facts,
        "gantt": encode_svg_base64(draw_gantt(result)),
        "map": None if road_map is None else encode_svg_base64(road_map),
        "machines": build_machine_table(result),
        "fields": build_job_table(sort_by_field(result)),
        "left": build_unworked_table(result),
        "legend": describe_day_columns(result),
        "remarks": [*result.remarks, f"{result.samples} samples, seed {result.seed}."],
    }
    return render_template("day.html.j2", content)


@build_view.register
def build_day_view(day: DayResult) -> ResultView:
    """A day: its answer, work over time, the jobs in the order of the fields, and what is not done."""

    def render() -> str:
        jobs = sort_by_field(day)
        notes = (f"{len(jobs) - MOST_JOBS} more fields; to_pandas() has all.",) if len(jobs) > MOST_JOBS else ()
        tables = [build_job_table(jobs[:MOST_JOBS], notes=notes)]
        if day.unworked_fields:
            rows = ((one.field, one.reason) for one in day.unworked_fields)
            tables.append(build_plain_table(("Not done", "Why"), rows, (0, 1)))
        first, *others = list_day_sentences(day)
        sentences = [*others, describe_optimality_gap(day), *day.remarks]
        return render_fragment(first, sentences, tables, encode_figure(draw_gantt(day)), "Work of the day over time")

    return ResultView(
        summary=lambda: " ".join(list_day_sentences(day)),
        html=render,
        table=lambda: [flatten_entry(make_json_safe(job, EXPORT_DECIMALS)) for job in day.jobs],
        draw=lambda axes: _draw_machines(axes, day),
        figure_inches=DAY_INCHES,
        files={
            ".json": lambda: format_day_json(day),
            ".csv": lambda: format_day_csv(day),
            ".html": lambda: render_day_page(day),
            ".png": lambda: render_png(draw_gantt(day)),
        },
    )
