"""A plan beside the logs of the work: a table for the terminal, JSON, a map and a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType

from reports.common import palette
from reports.common.rendering import format_json, render_template
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.wording import NO_VALUE, format_area, format_duration, format_number
from reports.plan.drive_geometry import MapExtent
from reports.plan.map_figure import draw_scale_and_north, encode_svg_base64
from reports.task_logs.run_results import (
    ACTIVITY_KINDS,
    STANDING,
    UNLOGGED,
    ComparisonSide,
    PlanComparison,
    Points,
    RunFigures,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch


KMH_PER_MPS = 3.6
PLANNED_COLOUR, DRIVEN_COLOUR = palette.TRACTOR_COLOURS[0], palette.TRACTOR_COLOURS[1]
OVERLAP_COLOUR = palette.TRACTOR_COLOURS[5]
# From _WIDE_INCHES on three columns of the legend fit.
_WIDEST_INCHES, _TALLEST_INCHES, _NARROWEST_INCHES, _WIDE_INCHES = 10.0, 8.0, 5.5, 7.5
_MARKED_PIECES = 3
ComparisonRow = tuple[str, str, str, str]


def build_comparison_table(comparison: PlanComparison) -> RenderableType:
    """Both sides and their difference, its causes, and remarks."""
    columns = (TableColumn("", is_text=True), TableColumn("Planned"), TableColumn("Driven"), TableColumn("Difference"))
    causes = tuple((_format_signed_duration(one.seconds), one.words) for one in comparison.differences)
    parts: list[RenderableType] = [
        format_sentence(describe_comparison(comparison)),
        FittedTable(columns, tuple(list_comparison_rows(comparison))),
    ]
    if causes:
        parts += [
            format_sentence("Causes of the difference in machine time, largest first:"),
            FittedTable((TableColumn("Time"), TableColumn("What", is_text=True)), causes),
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
    for label, get_value, decimals in _FIGURE_LINES:
        planned, driven = get_value(a.figures), get_value(b.figures)
        if planned is not None or driven is not None:
            yield _build_number_line(label, planned, driven, decimals)
    if a.ground is not None and b.ground is not None and comparison.field_m2:
        for label, planned, driven in (
            ("worked, ha", a.ground.worked_m2, b.ground.worked_m2),
            ("worked again, ha", a.ground.overlap_m2, b.ground.overlap_m2),
            ("missed, ha", a.ground.missed_m2, b.ground.missed_m2),
        ):
            yield _build_number_line(label, planned / 1e4, driven / 1e4, 3)


def _convert_to_km(metres: float | None) -> float | None:
    return None if metres is None else metres / 1e3


def _convert_to_kmh(mps: float | None) -> float | None:
    return None if mps is None else mps * KMH_PER_MPS


_FIGURE_LINES: tuple[tuple[str, Any, int], ...] = (
    ("at work, km", lambda one: _convert_to_km(one.active_m), 2),
    ("off work, km", lambda one: _convert_to_km(one.inactive_m), 2),
    ("speed at work, km/h", lambda one: _convert_to_kmh(one.working_mps), 1),
    ("turns", lambda one: one.turns, 0),
    ("a turn back, s", lambda one: one.u_turn_s, 0),
    ("lifts", lambda one: one.lifts, 0),
    ("stops", lambda one: one.stops, 0),
    ("fuel, l", lambda one: one.fuel_l, 0),
)


def _build_number_line(label: str, planned: float | None, driven: float | None, decimals: int) -> ComparisonRow:
    difference = None if planned is None or driven is None else driven - planned
    signed = (
        NO_VALUE
        if difference is None
        else f"{difference:+.{decimals}f}"
        if round(difference, decimals)
        else format_number(0.0, decimals)
    )
    return label, format_number(planned, decimals), format_number(driven, decimals), signed


def _build_time_line(label: str, planned_s: float, driven_s: float) -> ComparisonRow:
    return label, format_duration(planned_s), format_duration(driven_s), _format_signed_duration(driven_s - planned_s)


def _format_signed_duration(seconds: float) -> str:
    return ("+" if seconds >= 0.5 else "") + format_duration(seconds)


def format_comparison_json(comparison: PlanComparison) -> str:
    """Both sides in SI units, the differences and the remarks; areas without their shapes."""
    content = {
        "field": comparison.name,
        "field_m2": comparison.field_m2,
        "width_m": comparison.width_m,
        "planned": _build_side_entry(comparison.planned),
        "driven": _build_side_entry(comparison.as_driven),
        "differences": [asdict(one) for one in comparison.differences],
        "notes": list(comparison.notes),
    }
    return format_json(content)


def _build_side_entry(side: ComparisonSide) -> dict[str, Any]:
    names = ("worked_m2", "overlap_m2", "missed_m2")
    ground = None if side.ground is None else {name: getattr(side.ground, name) for name in names}
    return {"machines": side.machines, **_build_figures_entry(side.figures), "ground": ground}


def _build_figures_entry(figures: RunFigures) -> dict[str, Any]:
    return {key: value for key, value in asdict(figures).items() if key not in ("area_counted", "width_m", "rows")}


def draw_comparison(comparison: PlanComparison) -> Figure:
    """Planned and driven lines on one map, with ground that was worked twice or missed when driven."""
    from matplotlib.figure import Figure

    box = _compute_comparison_extent(comparison)
    size = box.size or 1.0
    scale = min(_WIDEST_INCHES / (1.06 * size), _TALLEST_INCHES / (1.2 * size)) if size else 1.0
    across, up = (box.width + 0.06 * size) * scale, (box.height + 0.16 * size) * scale
    figure = Figure(figsize=(max(across, _NARROWEST_INCHES), up + 1.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set_xlim(box.west - 0.03 * size, box.east + 0.03 * size)
    axes.set_ylim(box.south - 0.1 * size, box.north + 0.03 * size)
    axes.set_axis_off()
    if comparison.boundary:
        axes.add_patch(
            _build_ring_patch(
                comparison.boundary,
                facecolor=palette.FIELD_COLOUR,
                edgecolor=palette.EDGE_COLOUR,
                linewidth=1.2,
                zorder=1,
            )
        )
    ground = comparison.as_driven.ground
    if ground is not None:
        _draw_ground_pieces(axes, ground.overlaps, OVERLAP_COLOUR, "worked again when driven", None)
        _draw_ground_pieces(axes, ground.unworked, palette.UNWORKED_COLOUR, "missed when driven", "////")
        _label_largest(axes, ground.unworked)
    _draw_lines(axes, comparison.planned, PLANNED_COLOUR, "planned", 2.2, 0.45)
    _draw_lines(axes, comparison.as_driven, DRIVEN_COLOUR, "driven", 0.9, 1.0)
    draw_scale_and_north(axes, box)
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(
        once.values(),
        once.keys(),
        loc="outside lower center",
        ncols=3 if across > _WIDE_INCHES else 2,
        frameon=False,
        fontsize=9,
    )
    figure.suptitle(f"{comparison.name}: planned and driven".replace("$", r"\$"), fontsize=11, x=0.02, ha="left")
    return figure


def _compute_comparison_extent(comparison: PlanComparison) -> MapExtent:
    lines = [
        *comparison.boundary[:1],
        *comparison.planned.work_lines,
        *comparison.as_driven.work_lines,
        *comparison.as_driven.idle_lines,
    ]
    points = np.concatenate(lines) if lines else np.zeros((1, 2))
    (west, south), (east, north) = points.min(axis=0), points.max(axis=0)
    return MapExtent(float(west), float(south), float(east), float(north))


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


def _draw_ground_pieces(axes: Axes, rings: Sequence[Points], colour: str, name: str, hatch: str | None) -> None:
    if rings:
        look: dict[str, Any] = {"facecolor": "none" if hatch else colour, "edgecolor": colour, "hatch": hatch}
        axes.add_patch(
            _build_ring_patch(rings, linewidth=0.6, alpha=0.8 if hatch else 0.45, zorder=2.5, label=name, **look)
        )


def _label_largest(axes: Axes, rings: Sequence[Points]) -> None:
    """The areas of the largest missed pieces, beside them."""
    for ring in sorted(rings, key=_compute_area_m2, reverse=True)[:_MARKED_PIECES]:
        x, y = ring[:-1].mean(axis=0)
        axes.annotate(
            format_area(_compute_area_m2(ring)),
            (x, y),
            xytext=(5, 5),
            textcoords="offset points",
            fontsize=8,
            color=palette.UNWORKED_COLOUR,
            zorder=6,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8},
        )


def _compute_area_m2(ring: Points) -> float:
    """The area in a closed ring, m2 (shoelace formula)."""
    x, y = (ring - ring[0]).T
    return 0.5 * abs(float(x[:-1] @ y[1:] - x[1:] @ y[:-1]))


def _build_ring_patch(rings: Sequence[Points], **look: Any) -> PathPatch:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    return PathPatch(Path.make_compound_path(*(Path(ring, closed=True) for ring in rings)), **look)


def render_comparison_page(comparison: PlanComparison) -> str:
    """The map, the table and the causes of the difference as one page that loads nothing from elsewhere."""
    content = {
        "name": comparison.name,
        "lead": describe_comparison(comparison),
        "picture": encode_svg_base64(draw_comparison(comparison)),
        "rows": list(list_comparison_rows(comparison)),
        "causes": [(_format_signed_duration(one.seconds), one.what, one.words) for one in comparison.differences],
        "notes": comparison.notes,
    }
    return render_template("work_compare.html.j2", content)
