"""Imported runs, values learned from them, and a plan beside the logs of its work: tables, JSON, a map and a page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from rich.console import Group, RenderableType

from fields.arrays import Floats
from fields.units import KMH_PER_MPS
from reports.common import palette
from reports.common.drawing_sizes import COLUMN_INCHES, NARROWEST_INCHES
from reports.common.rendering import create_figure, draw_legend, format_json, pick_values, render_template
from reports.common.text_tables import FittedTable, TableColumn, build_plain_table, build_table, format_sentence
from reports.common.wording import (
    NO_VALUE,
    format_area,
    format_duration,
    format_number,
    format_percent,
    format_signed_number,
    group_alike,
)
from reports.plan.drive_geometry import bound_points
from reports.plan.map_figure import (
    build_patch,
    draw_scale_and_north,
    encode_svg_base64,
    escape_figure_formula,
    frame_map,
    measure_map,
)
from reports.task_logs.run_results import (
    ACTIVITY_KINDS,
    STANDING,
    UNLOGGED,
    ComparisonSide,
    ImportedRun,
    LearnedOutcome,
    PlanComparison,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PLANNED_COLOUR, DRIVEN_COLOUR = palette.TRACTOR_COLOURS[0], palette.TRACTOR_COLOURS[1]
OVERLAP_COLOUR = palette.TRACTOR_COLOURS[5]
_UNSHOWN_KEYS = ("area_counted", "width_m", "rows")  # of the figures of a side in JSON
ComparisonRow = tuple[str, str, str, str]

_FIGURE_LINES = (
    ("at work, km", "active_m", 1e-3, 2),
    ("off work, km", "inactive_m", 1e-3, 2),
    ("speed at work, km/h", "working_mps", KMH_PER_MPS, 1),
    ("turns", "turns", 1, 0),
    ("a turn back, s", "u_turn_s", 1, 0),
    ("lifts", "lifts", 1, 0),
    ("stops", "stops", 1, 0),
    ("fuel, l", "fuel_l", 1, 0),
)
"""Label of a row, its figure, how much of the unit shown one of its own is, and decimals."""


def build_runs_table(runs: Sequence[ImportedRun]) -> RenderableType:
    """One row per run, a row of totals where there are several (speeds have none), and remarks."""
    columns = (
        TableColumn("Run", is_text=True), TableColumn("Date", is_unbroken=True),
        TableColumn("Field", is_text=True, drop_order=1), TableColumn("Time", is_unbroken=True), TableColumn("ha"),
        TableColumn("km"), TableColumn("Working (%)", "Work%"), TableColumn("Turns", drop_order=2),
        TableColumn("Stops", drop_order=3), TableColumn("Lifts", drop_order=4),
        TableColumn("Speed (km/h)", "km/h", drop_order=5), TableColumn("Fuel (l)", "l", drop_order=6),
    )  # fmt: skip
    rows, figures = list[tuple[str, ...]](), [run.figures for run in runs]
    for run, one in zip(runs, figures, strict=True):
        speed = None if one.working_mps is None else one.working_mps * KMH_PER_MPS
        length = None if one.active_m is None or one.inactive_m is None else one.active_m + one.inactive_m
        rows.append(
            (run.name, run.start[:10] or NO_VALUE, run.field or NO_VALUE, format_duration(one.seconds),
             format_number(None if one.area_m2 is None else one.area_m2 / 1e4, 2),
             format_number((one.placed_m if length is None else length) / 1e3, 2), format_percent(one.share_working),
             *(format_number(count, 0) for count in (one.turns, one.stops, one.lifts)),
             format_number(speed, 1), format_number(one.fuel_l, 0))
        )  # fmt: skip
    if len(runs) > 1:
        with_share = [one for one in figures if one.share_working is not None]
        fuel = [one.fuel_l for one in figures if one.fuel_l is not None]
        share = sum(one.by_kind_s["working"] for one in with_share) / max(sum(one.seconds for one in with_share), 1e-9)
        length = sum(one.placed_m if one.counted_m is None else one.counted_m for one in figures)
        rows.append(
            (f"all {len(runs)}", "", "", format_duration(sum(one.seconds for one in figures)),
             format_number(sum(one.area_m2 or 0.0 for one in figures) / 1e4, 2), format_number(length / 1e3, 2),
             format_percent(share) if with_share else NO_VALUE, str(sum(one.turns or 0 for one in figures)),
             str(sum(one.stops for one in figures)), str(sum(one.lifts or 0 for one in figures)), "",
             format_number(sum(fuel), 0) if fuel else NO_VALUE)
        )  # fmt: skip
    return Group(FittedTable(columns, tuple(rows)), *map(format_sentence, group_run_notes(runs)))


def group_run_notes(runs: Sequence[ImportedRun]) -> Iterator[str]:
    """Remarks on the runs; a remark on several runs, figures apart, is one line with a count."""
    for members in group_alike((run, note) for run in runs for note in run.notes):
        run, note = members[0]
        if len(members) == 1:
            yield f"{run.name}: {note}."
        elif all(member_note == note for _, member_note in members):
            yield f"{len(members)} runs: {note}."
        else:
            yield f"{len(members)} runs, such as {run.name}: {note}."


def format_runs_json(runs: Sequence[ImportedRun], notes: Sequence[str]) -> str:
    """``runs`` with their figures in SI units, and ``notes`` on what could not be read, as JSON."""
    about = ("name", "form", "start", "field", "file")
    entries = [
        pick_values(run, about) | vars(run.figures) | {"share_working": run.figures.share_working, "notes": run.notes}
        for run in runs
    ]
    return format_json({"runs": entries, "notes": notes})


def build_learned_table(learned: Sequence[LearnedOutcome], notes: Sequence[str]) -> RenderableType:
    """One row per value, then the origin of each, then the remarks."""
    figures: tuple[tuple[TableColumn, Callable[[LearnedOutcome], str]], ...] = (
        (TableColumn("Value of the farm file", "Value", is_text=True), lambda one: one.key),
        (TableColumn("Learned", is_unbroken=True),
         lambda one: one.value if isinstance(one.value, str) else f"{one.value:g}"),
        (TableColumn("95 %", is_unbroken=True),
         lambda one: NO_VALUE if one.low is None or one.high is None else f"{one.low:g} to {one.high:g}"),
        (TableColumn("In the file", is_text=True, is_unbroken=True), lambda one: one.done),
    )  # fmt: skip
    origins = (f"{one.key.rpartition('.')[2]}: {one.measured}." for one in learned)
    return Group(build_table(learned, figures), *map(format_sentence, (*origins, *notes)))


def format_learned_json(learned: Sequence[LearnedOutcome], notes: Sequence[str]) -> str:
    """``learned``, values with interval, origin and what was done, and ``notes``, as JSON."""
    return format_json({"learned": learned, "notes": notes})


def build_comparison_table(comparison: PlanComparison) -> RenderableType:
    """Both sides and their difference, its causes, and remarks."""
    causes = [(_format_signed_duration(one.seconds), one.words) for one in comparison.differences]
    parts: list[RenderableType] = [format_sentence(describe_comparison(comparison)), tabulate_comparison(comparison)]
    if causes:
        parts += [
            format_sentence("Causes of the difference in machine time, largest first:"),
            build_plain_table(("Time", "What"), causes, texts=(1,)),
        ]
    return Group(*parts, *map(format_sentence, comparison.notes))


def describe_comparison(comparison: PlanComparison) -> str:
    """The comparison in a sentence."""
    a, b = comparison.planned.figures.seconds, comparison.as_driven.figures.seconds
    extra_pct = 100.0 * (b / a - 1.0) if a else 0.0
    text = (
        f"{comparison.name}: driven in {format_duration(b)} of machine time, planned {format_duration(a)} "
        f"({extra_pct:+.0f} %)."
    )
    if comparison.differences:
        first = comparison.differences[0]
        text += f" The largest difference is in {first.what}: {first.words} ({_format_signed_duration(first.seconds)})."
    return text


def tabulate_comparison(comparison: PlanComparison) -> FittedTable:
    """A row for every figure that one side has."""
    return build_plain_table(("", "Planned", "Driven", "Difference"), list_comparison_rows(comparison))


def list_comparison_rows(comparison: PlanComparison) -> Iterator[ComparisonRow]:
    """Rows of the table: figure, planned, driven, difference."""
    a, b = comparison.planned, comparison.as_driven
    yield "tractors, logs", str(a.machines), str(b.machines), ""
    yield _build_time_line("machine time", a.figures.seconds, b.figures.seconds)
    if a.figures.turns is None or b.figures.turns is None:
        yield _build_time_line("moving", a.figures.moving_s, b.figures.moving_s)
    for kind in ACTIVITY_KINDS if a.figures.turns is not None and b.figures.turns is not None else (STANDING, UNLOGGED):
        planned, driven = a.figures.by_kind_s[kind], b.figures.by_kind_s[kind]
        if planned or driven:
            yield _build_time_line(kind, planned, driven)
    for label, key, factor, decimals in _FIGURE_LINES:
        values = [getattr(side.figures, key) for side in (a, b)]
        if any(value is not None for value in values):
            planned_value, driven_value = (None if value is None else factor * value for value in values)
            yield _build_number_line(label, planned_value, driven_value, decimals)
    if a.ground is not None and b.ground is not None and comparison.field_m2:
        for label, planned, driven in (
            ("worked, ha", a.ground.worked_m2, b.ground.worked_m2),
            ("worked again, ha", a.ground.overlap_m2, b.ground.overlap_m2),
            ("missed, ha", a.ground.missed_m2, b.ground.missed_m2),
        ):
            yield _build_number_line(label, planned / 1e4, driven / 1e4, 3)


def _build_number_line(label: str, planned: float | None, driven: float | None, decimals: int) -> ComparisonRow:
    difference = None if planned is None or driven is None else driven - planned
    signed = format_signed_number(difference, decimals)
    return label, format_number(planned, decimals), format_number(driven, decimals), signed


def _build_time_line(label: str, planned_s: float, driven_s: float) -> ComparisonRow:
    return label, format_duration(planned_s), format_duration(driven_s), _format_signed_duration(driven_s - planned_s)


def _format_signed_duration(seconds: float) -> str:
    return ("+" if seconds >= 0.5 else "") + format_duration(seconds)


def format_comparison_json(comparison: PlanComparison) -> str:
    """Both sides in SI units, the differences and the remarks; areas without their shapes."""
    content = {
        "field": comparison.name,
        **pick_values(comparison, ("field_m2", "width_m")),
        "planned": _build_side_entry(comparison.planned),
        "driven": _build_side_entry(comparison.as_driven),
        **pick_values(comparison, ("differences", "notes")),
    }
    return format_json(content)


def _build_side_entry(side: ComparisonSide) -> dict[str, Any]:
    ground = side.ground and pick_values(side.ground, ("worked_m2", "overlap_m2", "missed_m2"))
    figures = {key: value for key, value in vars(side.figures).items() if key not in _UNSHOWN_KEYS}
    return {"machines": side.machines, **figures, "ground": ground}


def draw_comparison(comparison: PlanComparison) -> Figure:
    """Planned and driven lines on one map, with ground that was worked twice or missed when driven."""
    lines = (*comparison.planned.work_lines, *comparison.as_driven.work_lines, *comparison.as_driven.idle_lines)
    box = bound_points([*comparison.boundary[:1], *lines])
    across, up = measure_map(box)
    figure = create_figure(max(across, NARROWEST_INCHES), up + 1.2, layout="constrained")
    axes = figure.add_subplot()
    frame_map(axes, box)
    if comparison.boundary:
        look = {"facecolor": palette.FIELD_COLOUR, "edgecolor": palette.EDGE_COLOUR, "linewidth": 1.2, "zorder": 1}
        axes.add_patch(build_patch([ring[:-1] for ring in comparison.boundary], **look))
    ground = comparison.as_driven.ground
    if ground is not None:
        _draw_ground_pieces(axes, ground.overlaps, OVERLAP_COLOUR, "worked again when driven", None)
        _draw_ground_pieces(axes, ground.unworked, palette.UNWORKED_COLOUR, "missed when driven", "////")
        areas_m2 = [shapely.Polygon(ring).area for ring in ground.unworked]
        for place in np.argsort([-area_m2 for area_m2 in areas_m2], kind="stable")[:3]:  # the largest have their areas
            paper = {"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8}
            axes.annotate(
                format_area(areas_m2[place]), ground.unworked[place][:-1].mean(axis=0), xytext=(5, 5),
                textcoords="offset points", fontsize=8, color=palette.UNWORKED_COLOUR, zorder=6, bbox=paper,
            )  # fmt: skip
    _draw_lines(axes, comparison.planned, PLANNED_COLOUR, "planned", 2.2, 0.45)
    _draw_lines(axes, comparison.as_driven, DRIVEN_COLOUR, "driven", 0.9, 1.0)
    draw_scale_and_north(axes, box)
    columns = 3 if across > COLUMN_INCHES else 2
    draw_legend(figure, axes, loc="outside lower center", ncols=columns, fontsize=9)
    figure.suptitle(escape_figure_formula(f"{comparison.name}: planned and driven"), fontsize=11, x=0.02, ha="left")
    return figure


def _draw_lines(axes: Axes, side: ComparisonSide, colour: str, name: str, width: float, alpha: float) -> None:
    from matplotlib.collections import LineCollection

    for lines, look, activity, order in (
        (side.work_lines, "solid", "at work", 4),
        (side.idle_lines, (0, (2, 1.5)), "off work", 3),
    ):
        if lines:
            axes.add_collection(
                LineCollection(
                    [np.asarray(line) for line in lines], colors=colour, linewidths=width, linestyles=[look],
                    alpha=alpha, zorder=order, label=f"{name}, {activity}",
                ),
                autolim=False,
            )  # fmt: skip


def _draw_ground_pieces(axes: Axes, rings: Sequence[Floats], colour: str, name: str, hatch: str | None) -> None:
    if rings:
        look: dict[str, Any] = {"facecolor": "none" if hatch else colour, "edgecolor": colour, "hatch": hatch}
        look |= {"linewidth": 0.6, "alpha": 0.8 if hatch else 0.45, "zorder": 2.5, "label": name}
        axes.add_patch(build_patch([ring[:-1] for ring in rings], **look))


def render_comparison_page(comparison: PlanComparison) -> str:
    """The map, the table and the causes of the difference as one page that loads nothing from elsewhere."""
    causes = ((_format_signed_duration(one.seconds), one.what, one.words) for one in comparison.differences)
    content = {
        "name": comparison.name,
        "lead": describe_comparison(comparison),
        "picture": encode_svg_base64(draw_comparison(comparison)),
        "figures": tabulate_comparison(comparison),
        "causes": build_plain_table(("Time", "Kind", "What"), causes, (1, 2)),
        "notes": comparison.notes,
    }
    return render_template("work_compare.html.j2", content)
