"""The fleet study: tables of the thesis beside simulated times, and its claims, for terminal, JSON and notebook."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common import palette
from reports.common.notebook import ResultView, ShownResult, ShownTable, build_view, render_fragment
from reports.common.rendering import EXPORT_DECIMALS, format_json, make_json_safe
from reports.common.text_tables import FittedTable, TableColumn, format_bullet, format_title
from reports.common.wording import format_minutes, format_number, format_signed_number

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True)
class ThesisTableRow:
    """One row of a table of the thesis beside the simulated time."""

    label: str
    tractors: int
    thesis_s: float
    time_s: float | None
    difference_pct: float | None
    note: str = ""


@dataclass(frozen=True)
class ThesisClaim:
    """A claim of the thesis, and whether the simulation confirms it."""

    claim: str
    holds: bool
    why: str


@dataclass(frozen=True, repr=False)
class FleetStudy(ShownResult):
    """Tables 6.1 to 6.3 beside the thesis, its claims, and the one set of assumptions behind every row."""

    tables: dict[str, tuple[ThesisTableRow, ...]]
    claims: tuple[ThesisClaim, ...]
    assumptions: tuple[str, ...]


def build_study_tables(study: FleetStudy) -> RenderableType:
    """Tables of the thesis beside the simulation, then each claim with its verdict, then the assumptions."""
    parts: list[RenderableType] = []
    for name, rows in study.tables.items():
        columns = [TableColumn("Plan", is_text=True), *map(TableColumn, ("Tractors", "Thesis", "Here", "Diff. %"))]
        columns += [TableColumn("Note", is_text=True)] if any(row.note for row in rows) else []
        cells = (
            (row.label, str(row.tractors), format_minutes(row.thesis_s), format_minutes(row.time_s),
             format_signed_number(row.difference_pct, 1), row.note)
            for row in rows
        )  # fmt: skip
        table = FittedTable(tuple(columns), tuple(row[: len(columns)] for row in cells))
        parts += [format_title(f"Table {name}"), table, Text("")]
    if study.claims:
        heads = tuple(TableColumn(name, is_text=True) for name in ("Claim", "Verdict", "Why"))
        verdicts = tuple((one.claim, "holds" if one.holds else "does not hold here", one.why) for one in study.claims)
        styles = tuple("" if one.holds else "yellow" for one in study.claims)
        parts += [format_title("Claims of the thesis"), FittedTable(heads, verdicts, styles), Text("")]
    if study.assumptions:
        parts.append(format_title("Assumptions behind every row"))
        parts += [format_bullet(text) for text in study.assumptions]
    return Group(*parts)


def format_study_json(study: FleetStudy) -> str:
    """The study as JSON text with a trailing newline: ``tables``, ``claims`` and ``assumptions``."""
    return format_json(study, EXPORT_DECIMALS, is_ascii=False)


@build_view.register
def build_study_view(study: FleetStudy) -> ResultView:
    """The fleet study: rows beside the thesis, and its claims."""
    held = sum(claim.holds for claim in study.claims)
    summary = f"{held} of {len(study.claims)} claims of the thesis hold in the simulation"
    return ResultView(
        summary=lambda: summary,
        html=lambda: render_fragment(f"{summary}.", [], _list_study_tables(study)),
        table=lambda: [{"table": name, **make_json_safe(row)} for name, rows in study.tables.items() for row in rows],
        draw=lambda axes: _draw_study(axes, study),
        files={".json": lambda: format_study_json(study)},
    )


def _list_study_tables(study: FleetStudy) -> list[ShownTable]:
    """The rows of all tables, and the claims."""
    rows = [
        (
            name, row.label, str(row.tractors), format_minutes(row.thesis_s), format_minutes(row.time_s),
            format_number(row.difference_pct, 1), row.note,
        )
        for name, table in study.tables.items()
        for row in table
    ]  # fmt: skip
    headings = ("Table", "Row", "Tractors", "Thesis, min:s", "Simulated, min:s", "Difference %", "Note")
    claims = [(claim.claim, "yes" if claim.holds else "no", claim.why) for claim in study.claims]
    return [
        ShownTable(headings, rows, frozenset({0, 1, 6})),
        ShownTable(("Claim", "Holds", "Why"), claims, frozenset({0, 1, 2})),
    ]


def _draw_study(axes: Axes, study: FleetStudy) -> None:
    """Minutes of the thesis and of the simulation, two bars per row."""
    rows = [(f"{name} {row.label}", row) for name, table in study.tables.items() for row in table]
    for place, (_, row) in enumerate(rows):
        axes.barh(place - 0.2, row.thesis_s / 60.0, height=0.38, color=palette.TRACTOR_COLOURS[4])
        axes.barh(place + 0.2, (row.time_s or 0.0) / 60.0, height=0.38, color=palette.TRACTOR_COLOURS[0])
    axes.set_yticks(range(len(rows)), [label for label, _ in rows], fontsize=8)
    axes.invert_yaxis()
    axes.set(xlabel="minutes; pale: thesis, dark: simulated")
