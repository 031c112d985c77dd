"""A plan and what was driven of it: a table for the terminal, JSON, the map, the page."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Group, RenderableType

from reports import palette
from reports.figures import to_data
from reports.fitting import Column, FittedTable, sentence
from reports.layers import draw_scale
from reports.paths import Extent
from reports.plain import finite
from reports.template import rendered
from reports.wording import NOTHING, area, duration, number
from reports.work_results import KINDS, STANDING, UNLOGGED, Comparison, Figures, Points, Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.patches import PathPatch

KMH = 3.6
PLANNED, DRIVEN = palette.TRACTORS[0], palette.TRACTORS[1]
AGAIN = palette.TRACTORS[5]
_WIDEST, _TALLEST, _NARROWEST, _WIDE = 10.0, 8.0, 5.5, 7.5  # inches; three columns of the legend fit from the last on
_MARKED = 3
Row = tuple[str, str, str, str]


def comparison_table(found: Comparison) -> RenderableType:
    """Both sides and their difference, what it comes from, and the remarks."""
    columns = (Column("", words=True), Column("Planned"), Column("Driven"), Column("Difference"))
    causes = tuple((_signed(one.seconds), one.words) for one in found.differences)
    parts: list[RenderableType] = [sentence(headline(found)), FittedTable(columns, tuple(rows(found)))]
    if causes:
        parts += [
            sentence("Where the difference in machine time comes from, the largest first:"),
            FittedTable((Column("Time"), Column("What", words=True)), causes),
        ]
    return Group(*parts, *map(sentence, found.notes))


def headline(found: Comparison) -> str:
    """The comparison in a sentence."""
    a, b = found.planned.figures.seconds, found.driven.figures.seconds
    more = 100.0 * (b / a - 1.0) if a else 0.0
    told = f"{found.name}: driven in {duration(b)} of machine time, planned {duration(a)} ({more:+.0f} %)."
    if found.differences:
        first = found.differences[0]
        told += f" What differs most is {first.what}: {first.words} ({_signed(first.seconds)})."
    return told


def rows(found: Comparison) -> Iterator[Row]:
    """Lines of the table: what, planned, driven, difference."""
    a, b = found.planned, found.driven
    yield "tractors, logs", str(a.machines), str(b.machines), ""
    yield _time("machine time", a.figures.seconds, b.figures.seconds)
    if a.figures.turns is None or b.figures.turns is None:
        yield _time("moving", a.figures.moving_s, b.figures.moving_s)
    for kind in KINDS if a.figures.turns is not None and b.figures.turns is not None else (STANDING, UNLOGGED):
        one, other = a.figures.by_kind_s[kind], b.figures.by_kind_s[kind]
        if one or other:
            yield _time(kind, one, other)
    for words, of, decimals in _FIGURES:
        one, other = of(a.figures), of(b.figures)
        if one is not None or other is not None:
            yield _line(words, one, other, decimals)
    if a.ground is not None and b.ground is not None and found.field_m2:
        for words, one, other in (
            ("worked, ha", a.ground.worked_m2, b.ground.worked_m2),
            ("worked again, ha", a.ground.overlap_m2, b.ground.overlap_m2),
            ("missed, ha", a.ground.missed_m2, b.ground.missed_m2),
        ):
            yield _line(words, one / 1e4, other / 1e4, 3)


def _km(metres: float | None) -> float | None:
    return None if metres is None else metres / 1e3


def _kmh(mps: float | None) -> float | None:
    return None if mps is None else mps * KMH


_FIGURES: tuple[tuple[str, Any, int], ...] = (
    ("at work, km", lambda one: _km(one.active_m), 2),
    ("off work, km", lambda one: _km(one.inactive_m), 2),
    ("speed at work, km/h", lambda one: _kmh(one.working_mps), 1),
    ("turns", lambda one: one.turns, 0),
    ("a turn back, s", lambda one: one.u_turn_s, 0),
    ("lifts", lambda one: one.lifts, 0),
    ("stops", lambda one: one.stops, 0),
    ("fuel, l", lambda one: one.fuel_l, 0),
)


def _line(words: str, one: float | None, other: float | None, decimals: int) -> Row:
    gone = None if one is None or other is None else other - one
    signed = NOTHING if gone is None else f"{gone:+.{decimals}f}" if round(gone, decimals) else number(0.0, decimals)
    return words, number(one, decimals), number(other, decimals), signed


def _time(words: str, one: float, other: float) -> Row:
    return words, duration(one), duration(other), _signed(other - one)


def _signed(seconds: float) -> str:
    return ("+" if seconds >= 0.5 else "") + duration(seconds)


def comparison_json(found: Comparison) -> str:
    """Both sides in SI units, the differences, the remarks; areas without their shapes."""
    told = {
        "field": found.name, "field_m2": found.field_m2, "width_m": found.width_m, "planned": _side(found.planned),
        "driven": _side(found.driven), "differences": [asdict(one) for one in found.differences],
        "notes": list(found.notes),
    }  # fmt: skip
    return json.dumps(finite(told), indent=2, allow_nan=False) + "\n"


def _side(side: Side) -> dict[str, Any]:
    names = ("worked_m2", "overlap_m2", "missed_m2")
    ground = None if side.ground is None else {name: getattr(side.ground, name) for name in names}
    return {"machines": side.machines, **_figures(side.figures), "ground": ground}


def _figures(figures: Figures) -> dict[str, Any]:
    return {key: value for key, value in asdict(figures).items() if key not in ("area_counted", "width_m", "rows")}


def comparison_figure(found: Comparison) -> Figure:
    """Planned and driven lines on one map, with ground that was worked again and missed when it was driven."""
    from matplotlib.figure import Figure

    box = _extent(found)
    size = box.size or 1.0
    scale = min(_WIDEST / (1.06 * size), _TALLEST / (1.2 * size)) if size else 1.0
    across, up = (box.width + 0.06 * size) * scale, (box.height + 0.16 * size) * scale
    figure = Figure(figsize=(max(across, _NARROWEST), up + 1.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set_aspect("equal")
    axes.set_xlim(box.west - 0.03 * size, box.east + 0.03 * size)
    axes.set_ylim(box.south - 0.1 * size, box.north + 0.03 * size)
    axes.set_axis_off()
    if found.boundary:
        axes.add_patch(_patch(found.boundary, facecolor=palette.FIELD, edgecolor=palette.EDGE, linewidth=1.2, zorder=1))
    ground = found.driven.ground
    if ground is not None:
        _draw_pieces(axes, ground.again, AGAIN, "worked again when driven", None)
        _draw_pieces(axes, ground.missed, palette.MISSED, "missed when driven", "////")
        _mark_largest(axes, ground.missed)
    _draw_lines(axes, found.planned, PLANNED, "planned", 2.2, 0.45)
    _draw_lines(axes, found.driven, DRIVEN, "driven", 0.9, 1.0)
    draw_scale(axes, box)
    handles, labels = axes.get_legend_handles_labels()
    once = dict(zip(labels, handles, strict=True))
    figure.legend(
        once.values(),
        once.keys(),
        loc="outside lower center",
        ncols=3 if across > _WIDE else 2,
        frameon=False,
        fontsize=9,
    )
    figure.suptitle(f"{found.name}: planned and driven".replace("$", r"\$"), fontsize=11, x=0.02, ha="left")
    return figure


def _extent(found: Comparison) -> Extent:
    lines = [*found.boundary[:1], *found.planned.work, *found.driven.work, *found.driven.idle]
    points = np.concatenate(lines) if lines else np.zeros((1, 2))
    (west, south), (east, north) = points.min(axis=0), points.max(axis=0)
    return Extent(float(west), float(south), float(east), float(north))


def _draw_lines(axes: Axes, side: Side, colour: str, name: str, width: float, alpha: float) -> None:
    from matplotlib.collections import LineCollection

    for lines, look, words, order in ((side.work, "solid", "at work", 4), (side.idle, (0, (2, 1.5)), "off work", 3)):
        if lines:
            axes.add_collection(
                LineCollection(
                    [np.asarray(line) for line in lines], colors=colour, linewidths=width, linestyles=[look],
                    alpha=alpha, zorder=order, label=f"{name}, {words}",
                ),
                autolim=False,
            )  # fmt: skip


def _draw_pieces(axes: Axes, rings: Sequence[Points], colour: str, name: str, hatch: str | None) -> None:
    if rings:
        look: dict[str, Any] = {"facecolor": "none" if hatch else colour, "edgecolor": colour, "hatch": hatch}
        axes.add_patch(_patch(rings, linewidth=0.6, alpha=0.8 if hatch else 0.45, zorder=2.5, label=name, **look))


def _mark_largest(axes: Axes, rings: Sequence[Points]) -> None:
    """The areas of the largest missed pieces, beside them."""
    for ring in sorted(rings, key=_area, reverse=True)[:_MARKED]:
        x, y = ring[:-1].mean(axis=0)
        axes.annotate(
            area(_area(ring)), (x, y), xytext=(5, 5), textcoords="offset points", fontsize=8, color=palette.MISSED,
            zorder=6, bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.7, "pad": 0.8},
        )  # fmt: skip


def _area(ring: Points) -> float:
    """The area in a closed ring, m2 (shoelace formula)."""
    x, y = (ring - ring[0]).T
    return 0.5 * abs(float(x[:-1] @ y[1:] - x[1:] @ y[:-1]))


def _patch(rings: Sequence[Points], **look: Any) -> PathPatch:
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path

    return PathPatch(Path.make_compound_path(*(Path(ring, closed=True) for ring in rings)), **look)


def comparison_page(found: Comparison) -> str:
    """The map, the table and what the difference comes from, as one self-contained page."""
    content = {
        "name": found.name,
        "lead": headline(found),
        "picture": to_data(comparison_figure(found)),
        "rows": list(rows(found)),
        "causes": [(_signed(one.seconds), one.what, one.words) for one in found.differences],
        "notes": found.notes,
    }
    return rendered("work_compare.html.j2", content)
