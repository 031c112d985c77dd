"""Tables of plans and of the study for a terminal; plain text survives a pipe and an ASCII console."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from reports.common.language import translate, translate_count
from reports.common.plan_results import FleetStudy, PlanRanking, PlanResult
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.wording import format_minutes, format_signed_number, join_list
from reports.plan.count_charts import choose_plan_per_count
from reports.plan.energy_wording import describe_physics
from reports.plan.figures import COUNT_DROPS, FIGURES, TABLE_DROPS, Figure, build_figure_table, choose_figures
from reports.plan.plan_wording import (
    BY_COUNT_HELP,
    UNWORKED_HELP,
    describe_order_optimality,
    describe_ranking,
    describe_simulated_effects,
    group_refusals,
    list_feasible,
    list_plan_remarks,
    list_refused,
    name_refused_plans,
)

_MORE_HINT = "a wider window or --json shows all"


def build_ranking_table(ranking: PlanRanking, most_plans: int | None = 20) -> RenderableType:
    """What a ranking says beyond its first screen: sentences, all plans, remarks, and what was refused and why.

    The table holds the `most_plans` fastest plans (all when None), the best plan and the Pareto front.
    """
    plans = list_feasible(ranking)
    shown = [
        plan
        for place, plan in enumerate(plans)
        if most_plans is None or place < most_plans or plan.on_pareto_front or plan is ranking.best
    ]

    def mark_rank(plan: PlanResult) -> str:
        return (
            f"{'>' if plan is ranking.best else ''}{FIGURES['rank'].format(plan)}{'*' if plan.on_pareto_front else ' '}"
        )

    parts: list[RenderableType] = [*map(format_sentence, (*describe_ranking(ranking), *describe_physics(ranking)))]
    if shown:
        figures = choose_figures(ranking, shown, TABLE_DROPS, names_currency=False)
        parts += [Text(""), build_figure_table(ranking, shown, figures, TABLE_DROPS, mark_rank, _MORE_HINT)]
        parts += [format_sentence(text, style="dim") for text in _list_table_notes(ranking, shown, figures)]
        parts += _build_count_table(ranking)
    effects = describe_simulated_effects(ranking)
    remarks = [*ranking.check_sentences, *([effects] if effects else [])]
    parts += [format_sentence(text, style="dim") for text in remarks]
    refused = list_refused(ranking)
    pruned = [plan for plan in refused if not plan.is_simulated]
    parts += _list_refusal_reasons("Refused", [plan for plan in refused if plan.is_simulated])
    parts += _list_refusal_reasons("Not simulated", pruned)
    parts += [format_sentence("--all simulates these too.", style="dim")] if pruned else []
    return Group(*parts)


def _list_table_notes(ranking: PlanRanking, shown: Sequence[PlanResult], figures: Sequence[Figure]) -> list[str]:
    """What the marks and columns of the table mean, what is not in it, and remarks on its plans."""
    legend = translate("Times are h:mm:ss. * no plan with as few tractors is faster (Pareto front).")
    legend += f" {translate('> best plan.')}" if ranking.best else ""
    legend += f" {translate(UNWORKED_HELP)}" if any(figure.key == "missed_m2" for figure in figures) else ""
    hidden = len(list_feasible(ranking)) - len(shown)
    if hidden:
        legend += " " + translate_count(
            "{count} slower plan is not shown; --all shows every plan.",
            "{count} slower plans are not shown; --all shows every plan.",
            hidden,
        )
    headings_by_note: dict[str, list[str]] = {}
    for figure in figures:
        if figure.note:
            heading = translate(figure.heading).removesuffix(" m")
            headings_by_note.setdefault(translate(figure.note), []).append(heading)
    explained = "; ".join(f"{join_list(headings)}: {note}" for note, headings in headings_by_note.items())
    has_risk = any(plan.expected_cost is not None for plan in shown)
    money = [] if has_risk else [f"{text[:-1]}, in {ranking.currency}." for text in ranking.money_sentences]
    proven = describe_order_optimality(shown)
    return [legend, f"{explained}.", *money, *([proven] if proven else []), *list_plan_remarks(shown)]


def _build_count_table(ranking: PlanRanking) -> list[RenderableType]:
    """Probability, time and cost of the best plan of every number of tractors; nothing without samples."""
    plans = choose_plan_per_count(ranking)
    if len(plans) < 2:
        return []
    figures = choose_figures(ranking, plans, COUNT_DROPS, names_currency=False)
    heading = format_title(f"By number of tractors, money in {ranking.currency}")
    table = build_figure_table(
        ranking, plans, figures, COUNT_DROPS, lambda plan: f"{'>' if plan is ranking.best else ''}{plan.tractors}",
        _MORE_HINT,
    )  # fmt: skip
    return [Text(""), heading, table, format_sentence(BY_COUNT_HELP, style="dim")]


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
        parts += [_build_bullet(text) for text in study.assumptions]
    return Group(*parts)


def _build_bullet(text: str) -> RenderableType:
    grid = Table.grid(padding=(0, 1, 0, 0))
    grid.add_column(width=1)
    grid.add_column(overflow="fold")
    grid.add_row(Text("-"), Padding(format_sentence(text), 0))
    return grid
