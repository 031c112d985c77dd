"""Tables for a terminal of 80 columns or more; plain text survives a pipe, a log file and an ASCII console."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.measure import Measurement
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from reports.results import Claim, PlanResult, Ranking, Study, StudyRow
from reports.wording import (
    NOTHING,
    clearance,
    duration,
    effects_words,
    feasible,
    headline,
    members,
    minutes,
    number,
    price,
    refusals,
    refused,
    remarks,
    yes_no,
)

_WIDE = 112
_UNITS = {"m": "m", "m2": "m2", "ha": "ha", "s": "s", "deg": "degrees", "pct": "%", "kmh": "km/h", "mps": "m/s"}


@dataclass(frozen=True)
class _Column:
    """A column: header in a wide and in a narrow table, and the text of a plan."""

    wide: str
    narrow: str
    text: Callable[[PlanResult], str]
    words: bool = False


@dataclass(frozen=True)
class _RankingTable:
    """Chooses the columns when the width of the console is known."""

    plans: tuple[PlanResult, ...]
    best: PlanResult | None
    deadline: bool

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        wide = options.max_width >= _WIDE
        columns = _columns(wide, self.deadline)
        table = _frame()
        for column in columns:
            header = Text(column.wide if wide else column.narrow)
            table.add_column(
                header,
                justify="left" if column.words else "right",
                no_wrap=not column.words,
                overflow="fold",
                min_width=8 if column.words else None,
            )
        for plan in self.plans:
            style = "bold" if plan is self.best else ""
            table.add_row(*(_cell(column, plan) for column in columns), style=style)
        yield table


@dataclass(frozen=True)
class _Words:
    """Names in a cell, broken where a reader would: at a space, else after a plus sign, else after a hyphen."""

    text: str

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        yield Text("\n".join(_broken(self.text, options.max_width)), overflow="fold")

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        pieces = re.findall(r"[^ +-]+[+-]?", self.text)
        least = max((len(piece) for piece in pieces), default=0)
        return Measurement(least, len(self.text)).with_maximum(options.max_width)


def _cell(column: _Column, plan: PlanResult) -> RenderableType:
    text = column.text(plan)
    return _Words(text) if column.words else Text(text)


def _broken(text: str, width: int, marks: str = " +-") -> list[str]:
    """Lines of at most `width` columns, broken after the first of `marks` that helps; longer if none does."""
    if len(text) <= width or not marks:
        return [text]
    lines = [""]
    for piece in re.findall(f"[^{re.escape(marks[0])}]*{re.escape(marks[0])}|.+$", text):
        if len((lines[-1] + piece).rstrip()) <= width:
            lines[-1] += piece
        else:
            lines += _broken(piece.rstrip(), width, marks[1:])
    return [line.rstrip() for line in lines if line]


def ranking_table(ranking: Ranking, most: int | None = 20) -> RenderableType:
    """The answer in plain words, a table of plans, and what was refused and why.

    The table holds the `most` fastest plans (all when None) and, however slow, the best plan and the Pareto front.
    """
    plans = feasible(ranking)
    shown = _shown(ranking, plans, most)
    parts: list[RenderableType] = [_title(f"{ranking.field_name}, {number(ranking.area_ha, 2)} ha")]
    parts += [Text(sentence) for sentence in headline(ranking)]
    if shown:
        deadline = any(plan.meets_deadline is not None for plan in shown)
        parts += [Text(""), _RankingTable(tuple(shown), ranking.best, deadline)]
        more = len(plans) - len(shown)
        starred = "* nobody is faster with as few tractors (Pareto front)."
        hidden = f" {more} slower plan{' is' if more == 1 else 's are'} not shown." if more else ""
        parts.append(Text(starred + hidden, style="dim"))
        parts += [Text(sentence, style="dim") for sentence in remarks(shown)]
    effects = effects_words(ranking)
    parts += [Text(effects, style="dim")] if effects else []
    parts += _refused_part(refused(ranking))
    return Group(*parts)


def _shown(ranking: Ranking, plans: list[PlanResult], most: int | None) -> list[PlanResult]:
    if most is None:
        return plans
    return [p for index, p in enumerate(plans) if index < most or p.on_pareto_front or p is ranking.best]


def study_tables(study: Study) -> RenderableType:
    """Tables of the thesis beside the simulation, then each claim with its verdict, then the assumptions."""
    parts: list[RenderableType] = []
    for name, rows in study.tables.items():
        parts += [_title(f"Table {name}"), _study_table(rows), Text("")]
    if study.claims:
        parts += [_title("Claims of the thesis"), _claims_table(study.claims), Text("")]
    if study.assumptions:
        parts.append(_title("Assumptions behind every row"))
        parts += [_bullet(Text(text)) for text in study.assumptions]
    return Group(*parts)


def field_table(info: Mapping[str, Any]) -> RenderableType:
    """Label and value pairs, one per line: ``area_ha`` reads ``Area (ha)``; a mapping has a line per entry."""
    table = _frame(header=False)
    table.add_column(style="bold", no_wrap=False, overflow="fold")
    table.add_column(overflow="fold")
    for label, value in info.items():
        table.add_row(Text(_label(label)), Text(_plain(value)))
    return table


def _columns(wide: bool, deadline: bool) -> list[_Column]:
    plan_columns = (
        [_Column("Strategy", "", lambda p: p.strategy, True), _Column("Turn", "", lambda p: p.turn, True)]
        if wide
        else [_Column("", "Strategy,\nturn", lambda p: f"{p.strategy} {p.turn}", True)]
    )
    columns = [
        _Column("Rank", "#", lambda p: f"{NOTHING if p.rank is None else p.rank}{'*' if p.on_pareto_front else ' '}"),
        _Column("Tractors", "Trac-\ntors", lambda p: str(p.tractors)),
        *plan_columns,
        _Column("Time", "Time", lambda p: duration(p.time_s)),
        _Column("Cost", "Cost", lambda p: price(p.cost)),
        _Column("Turning", "Turn-\ning", lambda p: duration(p.turning_s)),
        _Column("Waiting", "Wait-\ning", lambda p: duration(p.waiting_s)),
        _Column("Worked %", "Work\n%", lambda p: number(p.worked_pct, 1)),
        _Column("Overlap %", "Over-\nlap %", lambda p: number(p.overlap_pct, 1)),
        _Column("Clearance m", "Clear\nm", lambda p: number(clearance(p), 2)),
    ]
    if deadline:
        columns.append(_Column("Deadline", "In\ntime", lambda p: yes_no(p.meets_deadline)))
    return columns


def _refused_part(plans: list[PlanResult]) -> list[RenderableType]:
    if not plans:
        return []
    parts: list[RenderableType] = [Text(""), _title(f"Refused: {len(plans)} plan{'s' if len(plans) > 1 else ''}")]
    for refusal in refusals(plans):
        alike = " (first of several that differ in the figures)" if refusal.alike else ""
        parts.append(_bullet(Text(f"{len(refusal.plans)} x  {refusal.reason}{alike}")))
        parts.append(Padding(Text(members(refusal), style="dim"), (0, 0, 0, 4)))
    return parts


def _study_table(rows: tuple[StudyRow, ...]) -> Table:
    table = _frame()
    table.add_column("Plan", overflow="fold", min_width=12)
    for name in ("Tractors", "Thesis", "Here", "Diff. %"):
        table.add_column(name, justify="right", no_wrap=True)
    noted = any(row.note for row in rows)
    if noted:
        table.add_column("Note", overflow="fold", min_width=12)
    for row in rows:
        cells = [row.label, str(row.tractors), minutes(row.thesis_s), minutes(row.time_s), _signed(row.difference_pct)]
        table.add_row(*(Text(cell) for cell in (*cells, row.note)[: 6 if noted else 5]))
    return table


def _claims_table(claims: tuple[Claim, ...]) -> Table:
    table = _frame()
    table.add_column("Claim", overflow="fold", ratio=3)
    table.add_column("Verdict", min_width=7, max_width=13)
    table.add_column("Why", overflow="fold", ratio=4)
    for claim in claims:
        verdict = Text("holds", style="green") if claim.holds else Text("does not hold here", style="yellow")
        table.add_row(Text(claim.claim), verdict, Text(claim.why))
    return table


def _signed(value: float | None) -> str:
    text = number(value, 1)
    return text if text == NOTHING or text.startswith("-") or float(text) == 0 else f"+{text}"


def _frame(header: bool = True) -> Table:
    return Table(box=None, show_header=header, header_style="bold", padding=(0, 1, 0, 0), pad_edge=False)


def _title(text: str) -> Text:
    return Text(text, style="bold underline")


def _bullet(text: Text) -> RenderableType:
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=1)
    grid.add_column(overflow="fold")
    grid.add_row(Text("-"), text)
    return grid


def _label(key: object) -> str:
    """A key in words, its unit in brackets."""
    words = str(key).split("_")
    unit = f" ({_UNITS[words.pop()]})" if len(words) > 1 and words[-1] in _UNITS else ""
    text = " ".join(words)
    return text[:1].upper() + text[1:] + unit


def _plain(value: Any, inner: str = "\n") -> str:
    """A value in words: six significant digits, lists with commas, a mapping's pairs parted by `inner`."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if value is None or isinstance(value, bool):
        return yes_no(value)
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, Mapping):
        return inner.join(f"{_label(label)}: {_plain(item, ', ')}" for label, item in value.items()) or NOTHING
    if isinstance(value, list | tuple):
        return ", ".join(_plain(item) for item in value) or NOTHING
    return str(value)
