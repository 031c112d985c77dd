"""Tables of plans and of the study for a terminal; plain text survives a pipe and an ASCII console."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from reports.common.language import translate, translate_count
from reports.common.plan_results import PlanRanking, PlanResult, get_stated_cost, get_stated_s
from reports.common.study_results import FleetStudy, ThesisClaim, ThesisTableRow
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.wording import (
    NO_VALUE,
    format_area_or_dash,
    format_duration,
    format_minutes,
    format_number,
    format_price,
    format_yes_no,
    join_list,
)
from reports.plan.count_charts import choose_plan_per_count
from reports.plan.energy_wording import describe_physics, format_energy_cell, has_energy, name_energy_column
from reports.plan.plan_wording import (
    BY_COUNT_HELP,
    COLUMN_HELP,
    UNWORKED_HELP,
    describe_ranking,
    describe_simulated_effects,
    format_in_time_probability,
    get_charged_traffic_m2,
    get_clearance_m,
    group_refusals,
    has_late_ground_loss,
    list_feasible,
    list_plan_remarks,
    list_refused,
    name_refused_plans,
)

_MORE_HINT = "a wider window or --json shows all"
LEAST_GAP_PCT = 0.05  # less reads as nothing


@dataclass(frozen=True)
class _PlanColumn:
    """A column of the table of plans and the text of a plan in it."""

    column: TableColumn
    text: Callable[[PlanResult], str]


@dataclass(frozen=True)
class _ColumnFlags:
    """Which optional columns have something to show."""

    has_deadline: bool
    has_unworked: bool
    has_charged_traffic: bool
    has_probability: bool
    has_service_stops: bool
    has_charges: bool
    has_risk: bool
    has_late_costs: bool
    energy: str


def _find_column_flags(ranking: PlanRanking, plans: list[PlanResult]) -> _ColumnFlags:
    return _ColumnFlags(
        any(plan.meets_deadline is not None for plan in plans),
        any(plan.missed_m2 is not None for plan in plans),
        any(get_charged_traffic_m2(plan) is not None for plan in plans),
        any(plan.finish_probability is not None for plan in plans),
        any(plan.refills is not None for plan in plans),
        any(plan.charges is not None for plan in plans),
        any(plan.expected_cost is not None for plan in plans),
        has_late_ground_loss(ranking),
        name_energy_column(plans) if has_energy(plans) else "",
    )


def _build_plan_table(ranking: PlanRanking, plans: list[PlanResult], flags: _ColumnFlags) -> FittedTable:
    """A line per plan; the first cell marks the best plan."""
    columns = _list_plan_columns(flags)
    rows = tuple((_mark_rank(plan, ranking.best), *(column.text(plan) for column in columns[1:])) for plan in plans)
    styles = tuple("bold" if plan is ranking.best else "" for plan in plans)
    return FittedTable(tuple(column.column for column in columns), rows, styles, more_hint=_MORE_HINT)


def _mark_rank(plan: PlanResult, best: PlanResult | None) -> str:
    rank = NO_VALUE if plan.rank is None else str(plan.rank)
    return f"{'>' if plan is best else ''}{rank}{'*' if plan.on_pareto_front else ' '}"


def build_ranking_table(ranking: PlanRanking, most_plans: int | None = 20) -> RenderableType:
    """What a ranking says beyond its first screen: sentences, all plans, remarks, and what was refused and why.

    The table holds the `most_plans` fastest plans (all when None), the best plan and the Pareto front.
    """
    plans = list_feasible(ranking)
    shown = _choose_shown_plans(ranking, plans, most_plans)
    parts: list[RenderableType] = [
        format_sentence(text) for text in (*describe_ranking(ranking), *describe_physics(ranking))
    ]
    if shown:
        flags = _find_column_flags(ranking, shown)
        parts += [Text(""), _build_plan_table(ranking, shown, flags)]
        hidden_count = len(plans) - len(shown)
        hidden = " " + translate_count(
            "{count} slower plan is not shown; --all shows every plan.",
            "{count} slower plans are not shown; --all shows every plan.",
            hidden_count,
        )
        legend = translate("Times are h:mm:ss. * no plan with as few tractors is faster (Pareto front).")
        legend += f" {translate('> best plan.')}" if ranking.best else ""
        legend += f" {translate(UNWORKED_HELP)}" if flags.has_unworked else ""
        parts.append(format_sentence(legend + (hidden if hidden_count else ""), style="dim"))
        parts.append(format_sentence(_describe_plan_columns(flags), style="dim"))
        if not flags.has_risk:
            parts += [
                format_sentence(f"{text[:-1]}, in {ranking.currency}.", style="dim") for text in ranking.money_sentences
            ]
        proven = describe_order_optimality(shown)
        parts += [
            format_sentence(text, style="dim") for text in (*([proven] if proven else []), *list_plan_remarks(shown))
        ]
        parts += _build_count_table(ranking)
    parts += [format_sentence(text, style="dim") for text in ranking.check_sentences]
    effects = describe_simulated_effects(ranking)
    parts += [format_sentence(effects, style="dim")] if effects else []
    parts += _build_refusal_lists(list_refused(ranking))
    return Group(*parts)


def _choose_shown_plans(ranking: PlanRanking, plans: list[PlanResult], most_plans: int | None) -> list[PlanResult]:
    if most_plans is None:
        return plans
    return [p for index, p in enumerate(plans) if index < most_plans or p.on_pareto_front or p is ranking.best]


def _list_plan_columns(flags: _ColumnFlags) -> list[_PlanColumn]:
    """The columns; those that hold the answer are dropped last."""
    columns = [
        _PlanColumn(TableColumn("Rank", "#"), lambda p: NO_VALUE if p.rank is None else str(p.rank)),
        _PlanColumn(TableColumn("Tractors", "Trac-\ntors", drop_order=1), lambda p: str(p.tractors)),
        _PlanColumn(TableColumn("Strategy", is_text=True, is_unbroken=True), lambda p: p.strategy),
        _PlanColumn(TableColumn("Turn", is_text=True, is_unbroken=True, drop_order=9), lambda p: p.turn),
        _PlanColumn(TableColumn("Time"), lambda p: format_duration(get_stated_s(p))),
        *_list_money_columns(flags),
        _PlanColumn(TableColumn("Turning", "Turn-\ning", drop_order=5), lambda p: format_duration(p.turning_s)),
        _PlanColumn(TableColumn("Waiting", "Wait-\ning", drop_order=6), lambda p: format_duration(p.waiting_s)),
        _PlanColumn(TableColumn("Worked %", "Work\n%", drop_order=4), lambda p: format_number(p.worked_pct, 1)),
        _PlanColumn(TableColumn("Overlap %", "Over-\nlap %", drop_order=8), lambda p: format_number(p.overlap_pct, 1)),
        _PlanColumn(
            TableColumn("Clearance m", "Clear\nm", drop_order=7), lambda p: format_number(get_clearance_m(p), 2)
        ),
    ]
    if flags.energy:
        place = [column.column.heading for column in columns].index("Turning")
        column = TableColumn(flags.energy, flags.energy.replace(" ", "\n"), drop_order=6)
        columns.insert(place, _PlanColumn(column, format_energy_cell))
    if flags.has_service_stops:
        place = [column.column.heading for column in columns].index("Turning")
        columns.insert(
            place,
            _PlanColumn(TableColumn("Refills", "Re-\nfills", drop_order=3), lambda p: format_number(p.refills, 0)),
        )
    if flags.has_charges:
        place = [column.column.heading for column in columns].index("Turning")
        columns.insert(place, _PlanColumn(TableColumn("Charges", drop_order=3), lambda p: format_number(p.charges, 0)))
    if flags.has_unworked:
        place = [column.column.heading for column in columns].index("Overlap %")
        columns.insert(
            place,
            _PlanColumn(
                TableColumn("Unworked", "Un-\nworked", drop_order=4), lambda p: format_area_or_dash(p.missed_m2)
            ),
        )
    if flags.has_charged_traffic:
        place = [column.column.heading for column in columns].index("Overlap %")
        columns.insert(
            place,
            _PlanColumn(
                TableColumn("Driven over", "Driven\nover", drop_order=5),
                lambda p: format_area_or_dash(get_charged_traffic_m2(p)),
            ),
        )
    if flags.has_probability:
        columns.append(_PlanColumn(TableColumn("In time %", "In\ntime %", drop_order=3), format_in_time_probability))
    elif flags.has_deadline:
        columns.append(
            _PlanColumn(TableColumn("In time", "In\ntime", drop_order=3), lambda p: format_yes_no(p.meets_deadline))
        )
    return columns


def _list_money_columns(flags: _ColumnFlags) -> list[_PlanColumn]:
    """The stated cost and, where ground may be late, what is paid of it."""
    cost = _PlanColumn(TableColumn("Cost", drop_order=2), lambda p: format_price(get_stated_cost(p)))
    paid = _PlanColumn(TableColumn("Paid", drop_order=6), lambda p: format_price(p.paid_cost))
    return [cost, paid] if flags.has_late_costs else [cost]


def _describe_plan_columns(flags: _ColumnFlags) -> str:
    """What the columns of plans hold, a sentence; columns that hold the same are named together."""
    headings_by_help: dict[str, list[str]] = {}
    for column in _list_plan_columns(flags):
        heading = column.column.heading
        if heading in COLUMN_HELP:
            headings_by_help.setdefault(translate(COLUMN_HELP[heading]), []).append(
                translate(heading).removesuffix(" m")
            )
    return f"{'; '.join(f'{join_list(headings)}: {text}' for text, headings in headings_by_help.items())}."


def _build_count_table(ranking: PlanRanking) -> list[RenderableType]:
    """Probability, time and cost of the best plan of every number of tractors; nothing without samples."""
    plans = choose_plan_per_count(ranking)
    if len(plans) < 2:
        return []
    columns = [
        _PlanColumn(
            TableColumn("Tractors", "Trac-\ntors"), lambda p: f"{'>' if p is ranking.best else ''}{p.tractors}"
        ),
        _PlanColumn(TableColumn("Strategy", is_text=True, is_unbroken=True), lambda p: p.strategy),
        _PlanColumn(TableColumn("In time %", "In\ntime %"), format_in_time_probability),
        _PlanColumn(TableColumn("Median time", "Median\ntime"), lambda p: format_duration(p.p50_s)),
        _PlanColumn(TableColumn("95 %"), lambda p: format_duration(p.p95_s)),
        *_list_money_columns(_find_column_flags(ranking, plans)),
    ]
    if all(plan.finish_probability is None for plan in plans):
        columns = [column for column in columns if column.column.heading != "In time %"]
    rows = tuple(tuple(column.text(plan) for column in columns) for plan in plans)
    styles = tuple("bold" if plan is ranking.best else "" for plan in plans)
    heading = format_title(f"By number of tractors, money in {ranking.currency}")
    table = FittedTable(tuple(column.column for column in columns), rows, styles)
    return [Text(""), heading, table, format_sentence(BY_COUNT_HELP, style="dim")]


def _build_refusal_lists(plans: list[PlanResult]) -> list[RenderableType]:
    pruned = [plan for plan in plans if plan.bound_s is not None]
    simulated = [plan for plan in plans if plan.bound_s is None]
    return [
        *_list_refusal_reasons("Refused", simulated),
        *_list_refusal_reasons("Not simulated", pruned),
        *_build_all_option_hint(pruned),
    ]


def _build_all_option_hint(pruned: list[PlanResult]) -> list[RenderableType]:
    return [format_sentence("--all simulates these too.", style="dim")] if pruned else []


def _list_refusal_reasons(heading: str, plans: list[PlanResult]) -> list[RenderableType]:
    if not plans:
        return []
    parts: list[RenderableType] = [
        Text(""),
        format_title(f"{heading}: {len(plans)} plan{'s' if len(plans) > 1 else ''}"),
    ]
    for refusal in group_refusals(plans):
        similar_note = " (figures of the first)" if refusal.has_similar_reasons else ""
        parts.append(_build_bullet(f"{len(refusal.plans)} x  {refusal.reason}{similar_note}"))
        parts.append(format_sentence(name_refused_plans(refusal), style="dim", indent=4))
    return parts


def build_study_tables(study: FleetStudy) -> RenderableType:
    """Tables of the thesis beside the simulation, then each claim with its verdict, then the assumptions."""
    parts: list[RenderableType] = []
    for name, rows in study.tables.items():
        parts += [format_title(f"Table {name}"), _build_study_table(rows), Text("")]
    if study.claims:
        parts += [format_title("Claims of the thesis"), _build_claims_table(study.claims), Text("")]
    if study.assumptions:
        parts.append(format_title("Assumptions behind every row"))
        parts += [_build_bullet(text) for text in study.assumptions]
    return Group(*parts)


def _build_study_table(rows: tuple[ThesisTableRow, ...]) -> FittedTable:
    columns = [TableColumn("Plan", is_text=True), *map(TableColumn, ("Tractors", "Thesis", "Here", "Diff. %"))]
    if any(row.note for row in rows):
        columns.append(TableColumn("Note", is_text=True))
    cells = (
        (
            row.label,
            str(row.tractors),
            format_minutes(row.thesis_s),
            format_minutes(row.time_s),
            _format_signed(row.difference_pct),
            row.note,
        )[: len(columns)]
        for row in rows
    )
    return FittedTable(tuple(columns), tuple(cells))


def _build_claims_table(claims: tuple[ThesisClaim, ...]) -> FittedTable:
    columns = tuple(TableColumn(name, is_text=True) for name in ("Claim", "Verdict", "Why"))
    rows = tuple((one.claim, "holds" if one.holds else "does not hold here", one.why) for one in claims)
    return FittedTable(columns, rows, tuple("" if one.holds else "yellow" for one in claims))


def _format_signed(value: float | None) -> str:
    text = format_number(value, 1)
    return text if text == NO_VALUE or text.startswith("-") or float(text) == 0 else f"+{text}"


def _build_bullet(text: str) -> RenderableType:
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=1)
    grid.add_column(overflow="fold")
    grid.add_row(Text("-"), Padding(format_sentence(text), 0))
    return grid


def describe_order_optimality(plans: Sequence[PlanResult]) -> str | None:
    """How near the orders of tracks are to the optimum, a sentence; None where none is proven."""
    groups: dict[str, dict[str, list[int]]] = {}
    for plan in sorted(plans, key=lambda plan: (plan.order_gap_pct or 0.0, plan.tractors)):
        if plan.order_gap_pct is not None:
            gaps = groups.setdefault(plan.strategy, {})
            gaps.setdefault(format_order_optimality(plan.order_gap_pct), []).append(plan.tractors)
    parts = [
        translate("{strategy} {gap} with {counts}", strategy=name, gap=gap, counts=join_list(sorted(set(counts))))
        for name, gaps in groups.items()
        for gap, counts in gaps.items()
    ]
    if not parts:
        return None
    return translate("Order of tracks, by the driving between them: {orders}.", orders="; ".join(parts))


def format_order_optimality(pct: float) -> str:
    """``optimal`` or ``within 1.2 % of optimal``."""
    if pct < LEAST_GAP_PCT:
        return translate("optimal")
    return translate("within {share} % of optimal", share=format_number(pct, 1))
