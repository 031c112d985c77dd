"""Tables of plans and of the study for a terminal; plain text survives a pipe and an ASCII console."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

from rich.console import Console, ConsoleOptions, Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from reports.fitting import Column, FittedTable, sentence
from reports.odds import of_counts
from reports.results import Claim, PlanResult, Ranking, Study, StudyRow
from reports.wording import (
    BY_COUNT_WORDS,
    COLUMN_WORDS,
    LEFT_WORDS,
    NOTHING,
    area_or_dash,
    clearance,
    duration,
    effects_words,
    feasible,
    headline,
    in_time,
    late_counts,
    machines,
    members,
    minutes,
    number,
    price,
    proven_words,
    refusals,
    refused,
    remarks,
    yes_no,
)

_ELSEWHERE = "a wider window or --json shows all"
_NAMES = " +"  # names of strategies and turns stay whole: they are what --strategies and --turn take


@dataclass(frozen=True)
class _PlanColumn:
    """A column of the table of plans and the text of a plan in it."""

    column: Column
    text: Callable[[PlanResult], str]


@dataclass(frozen=True)
class _Told:
    """What there is anything to say of in columns: a deadline, ground left, how sure plans are, refills, the money of
    draws, and what is lost with late ground."""

    deadline: bool
    left: bool
    chances: bool
    refills: bool
    drawn: bool
    late: bool


def _told(ranking: Ranking, plans: list[PlanResult]) -> _Told:
    return _Told(
        any(plan.meets_deadline is not None for plan in plans),
        any(plan.missed_m2 is not None for plan in plans),
        any(plan.finish_probability is not None for plan in plans),
        any(plan.refills is not None for plan in plans),
        any(plan.expected_cost is not None for plan in plans),
        late_counts(ranking),
    )


@dataclass(frozen=True)
class _RankingTable:
    """Strategy and turn have a column each where all headings have room, else they share one."""

    plans: tuple[PlanResult, ...]
    best: PlanResult | None
    told: _Told

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterable[RenderableType]:
        wide = self._table(_columns(True, self.told))
        yield wide if wide.fits(options.max_width) else self._table(_columns(False, self.told))

    def _table(self, columns: list[_PlanColumn]) -> FittedTable:
        rows = tuple(self._row(plan, columns) for plan in self.plans)
        styles = tuple("bold" if plan is self.best else "" for plan in self.plans)
        return FittedTable(tuple(column.column for column in columns), rows, styles, elsewhere=_ELSEWHERE)

    def _row(self, plan: PlanResult, columns: list[_PlanColumn]) -> tuple[str, ...]:
        """The first cell marks the best plan where it is not the first one."""
        rank, *others = (column.text(plan) for column in columns)
        return (f">{rank}" if plan is self.best and plan.rank != 1 else rank), *others


def ranking_table(ranking: Ranking, most: int | None = 20) -> RenderableType:
    """The answer in plain words, a table of plans, and what was refused and why.

    The table holds the `most` fastest plans (all when None) and, however slow, the best plan and the Pareto front.
    """
    plans = feasible(ranking)
    shown = _shown(ranking, plans, most)
    title = ", ".join(filter(None, (ranking.field_name, f"{number(ranking.area_ha, 2)} ha", machines(ranking))))
    parts: list[RenderableType] = [_title(title)]
    parts += [sentence(text) for text in headline(ranking)]
    if shown:
        told = _told(ranking, shown)
        parts += [Text(""), _RankingTable(tuple(shown), ranking.best, told)]
        more = len(plans) - len(shown)
        hidden = f" {more} slower plan{' is' if more == 1 else 's are'} not shown; --all shows every plan."
        legend = "Times are h:mm:ss. * nobody is faster with as few tractors (Pareto front)."
        legend += " > the best plan." if ranking.best and ranking.best.rank != 1 else ""
        legend += f" {LEFT_WORDS}" if told.left else ""
        parts.append(sentence(legend + (hidden if more else ""), style="dim"))
        parts.append(sentence(_columns_words(told), style="dim"))
        if not told.drawn:
            parts += [sentence(f"{text[:-1]}, in {ranking.currency}.", style="dim") for text in ranking.money]
        proven = proven_words(shown)
        parts += [sentence(text, style="dim") for text in (*([proven] if proven else []), *remarks(shown))]
        parts += _by_count(ranking)
    parts += [sentence(text, style="dim") for text in ranking.checked]
    effects = effects_words(ranking)
    parts += [sentence(effects, style="dim")] if effects else []
    parts += _refused_part(refused(ranking))
    return Group(*parts)


def _shown(ranking: Ranking, plans: list[PlanResult], most: int | None) -> list[PlanResult]:
    if most is None:
        return plans
    return [p for index, p in enumerate(plans) if index < most or p.on_pareto_front or p is ranking.best]


def _columns(wide: bool, told: _Told) -> list[_PlanColumn]:
    """Rank, fleet, names, time, cost and deadline stay longest: they are the answer."""
    names = (
        [
            _PlanColumn(Column("Strategy", words=True, marks=_NAMES), lambda p: p.strategy),
            _PlanColumn(Column("Turn", words=True, marks=_NAMES), lambda p: p.turn),
        ]
        if wide
        else [_PlanColumn(Column("Strategy,\nturn", words=True, marks=_NAMES), lambda p: f"{p.strategy} {p.turn}")]
    )
    columns = [
        _PlanColumn(
            Column("Rank", "#"), lambda p: f"{NOTHING if p.rank is None else p.rank}{'*' if p.on_pareto_front else ' '}"
        ),
        _PlanColumn(Column("Tractors", "Trac-\ntors", drop=1), lambda p: str(p.tractors)),
        *names,
        _PlanColumn(Column("Time"), lambda p: duration(p.time_s)),
        *_money_columns(told),
        _PlanColumn(Column("Turning", "Turn-\ning", drop=5), lambda p: duration(p.turning_s)),
        _PlanColumn(Column("Waiting", "Wait-\ning", drop=6), lambda p: duration(p.waiting_s)),
        _PlanColumn(Column("Worked %", "Work\n%", drop=4), lambda p: number(p.worked_pct, 1)),
        _PlanColumn(Column("Overlap %", "Over-\nlap %", drop=8), lambda p: number(p.overlap_pct, 1)),
        _PlanColumn(Column("Clearance m", "Clear\nm", drop=7), lambda p: number(clearance(p), 2)),
    ]
    if told.refills:
        place = [column.column.heading for column in columns].index("Turning")
        columns.insert(place, _PlanColumn(Column("Refills", "Re-\nfills", drop=3), lambda p: number(p.refills, 0)))
    if told.left:
        place = [column.column.heading for column in columns].index("Overlap %")
        columns.insert(place, _PlanColumn(Column("Left", drop=4), lambda p: area_or_dash(p.missed_m2)))
    if told.chances:
        columns.append(_PlanColumn(Column("In time %", "In\ntime %", drop=3), in_time))
    elif told.deadline:
        columns.append(_PlanColumn(Column("In time", "In\ntime", drop=3), lambda p: yes_no(p.meets_deadline)))
    return columns


def _money_columns(told: _Told) -> list[_PlanColumn]:
    """The cost as simulated; with draws what is paid and, where ground may be late, what is expected, in their mean."""
    if not told.drawn:
        return [_PlanColumn(Column("Cost", drop=2), lambda p: price(p.cost))]
    paid = _PlanColumn(Column("Paid", drop=6 if told.late else 2), lambda p: price(p.paid_cost))
    late = _PlanColumn(Column("Expected", "Expec-\nted", drop=2), lambda p: price(p.expected_cost))
    return [paid, late] if told.late else [paid]


def _columns_words(told: _Told) -> str:
    """What is in the columns of plans, a sentence."""
    headings = [column.column.heading for column in _columns(True, told)]
    known = [heading for heading in headings if heading in COLUMN_WORDS]
    words = [f"{heading.removesuffix(' m')}: {COLUMN_WORDS[heading]}" for heading in known]
    return f"{'; '.join(words)}."


def _by_count(ranking: Ranking) -> list[RenderableType]:
    """Certainty, time and money of the plan to take with every number of tractors; nothing without draws."""
    plans = of_counts(ranking)
    if len(plans) < 2:
        return []
    columns = [
        _PlanColumn(Column("Tractors", "Trac-\ntors"), lambda p: f"{'>' if p is ranking.best else ''}{p.tractors}"),
        _PlanColumn(Column("Strategy", words=True, marks=_NAMES), lambda p: p.strategy),
        _PlanColumn(Column("In time %", "In\ntime %"), in_time),
        _PlanColumn(Column("Half the time", "Half\nthe time"), lambda p: duration(p.p50_s)),
        _PlanColumn(Column("At 95 %"), lambda p: duration(p.p95_s)),
        *_money_columns(_told(ranking, plans)),
    ]
    if all(plan.finish_probability is None for plan in plans):
        columns = [column for column in columns if column.column.heading != "In time %"]
    rows = tuple(tuple(column.text(plan) for column in columns) for plan in plans)
    styles = tuple("bold" if plan is ranking.best else "" for plan in plans)
    title = _title(f"By number of tractors, money in {ranking.currency}")
    table = FittedTable(tuple(column.column for column in columns), rows, styles)
    return [Text(""), title, table, sentence(BY_COUNT_WORDS, style="dim")]


def _refused_part(plans: list[PlanResult]) -> list[RenderableType]:
    beaten = [plan for plan in plans if plan.bound_s is not None]
    driven = [plan for plan in plans if plan.bound_s is None]
    return [*_reasons("Refused", driven), *_reasons("Not simulated", beaten), *_how(beaten)]


def _how(beaten: list[PlanResult]) -> list[RenderableType]:
    return [sentence("--all simulates these too.", style="dim")] if beaten else []


def _reasons(what: str, plans: list[PlanResult]) -> list[RenderableType]:
    if not plans:
        return []
    parts: list[RenderableType] = [Text(""), _title(f"{what}: {len(plans)} plan{'s' if len(plans) > 1 else ''}")]
    for refusal in refusals(plans):
        alike = " (first of several that differ in the figures)" if refusal.alike else ""
        parts.append(_bullet(f"{len(refusal.plans)} x  {refusal.reason}{alike}"))
        parts.append(sentence(members(refusal), style="dim", indent=4))
    return parts


def study_tables(study: Study) -> RenderableType:
    """Tables of the thesis beside the simulation, then each claim with its verdict, then the assumptions."""
    parts: list[RenderableType] = []
    for name, rows in study.tables.items():
        parts += [_title(f"Table {name}"), _study_table(rows), Text("")]
    if study.claims:
        parts += [_title("Claims of the thesis"), _claims_table(study.claims), Text("")]
    if study.assumptions:
        parts.append(_title("Assumptions behind every row"))
        parts += [_bullet(text) for text in study.assumptions]
    return Group(*parts)


def _study_table(rows: tuple[StudyRow, ...]) -> FittedTable:
    columns = [Column("Plan", words=True), *map(Column, ("Tractors", "Thesis", "Here", "Diff. %"))]
    if any(row.note for row in rows):
        columns.append(Column("Note", words=True))
    cells = (
        (row.label, str(row.tractors), minutes(row.thesis_s), minutes(row.time_s), _signed(row.difference_pct),
         row.note)[: len(columns)]
        for row in rows
    )  # fmt: skip
    return FittedTable(tuple(columns), tuple(cells))


def _claims_table(claims: tuple[Claim, ...]) -> FittedTable:
    columns = tuple(Column(name, words=True) for name in ("Claim", "Verdict", "Why"))
    rows = tuple((one.claim, "holds" if one.holds else "does not hold here", one.why) for one in claims)
    return FittedTable(columns, rows, tuple("" if one.holds else "yellow" for one in claims))


def _signed(value: float | None) -> str:
    text = number(value, 1)
    return text if text == NOTHING or text.startswith("-") or float(text) == 0 else f"+{text}"


def _title(text: str) -> Text:
    return Text(text, style="bold underline")


def _bullet(text: str) -> RenderableType:
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=1)
    grid.add_column(overflow="fold")
    grid.add_row(Text("-"), Padding(sentence(text), 0))
    return grid
