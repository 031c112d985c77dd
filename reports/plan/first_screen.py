"""The first screen of a ranking for a terminal: the answer, a short table, and what to type next.

At 80 columns it has at most 20 lines, of which at most five stand before the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rich.console import Group, RenderableType
from rich.text import Text

from fields.errors import shorten_middle
from reports.common.language import mark_text, translate, translate_count
from reports.common.plan_results import (
    PlanRanking,
    PlanResult,
    get_stated_cost,
    get_stated_end_s,
    get_stated_late_end_s,
)
from reports.common.text_tables import AnswerLines, FittedTable, TableColumn, format_sentence
from reports.common.units import format_hectares
from reports.common.wording import format_duration, format_number, format_price, format_yes_no, parse_start_time
from reports.plan.answer import format_stated_end, write_answer
from reports.plan.energy_wording import format_energy_cell, has_energy, name_energy_column
from reports.plan.plan_wording import describe_machines, format_in_time_probability, list_feasible, list_refused

MOST_ROWS, LEAST_ROWS = 6, 5
MOST_COLUMNS = 7
_MOST_NAME_LETTERS = 40
_MORE_HINT = mark_text("a wider window or --explain shows more")


@dataclass(frozen=True)
class _AnswerColumn:
    column: TableColumn
    text: Callable[[PlanResult], str]


def build_first_screen(ranking: PlanRanking, *, shows_all: bool = False, with_next: bool = True) -> RenderableType:
    """What to do in a few lines, the plans to choose from in a table, and what to type next.

    The table holds the best plan, then the Pareto front, then others as they are ranked: few, or all with `shows_all`.
    """
    plans = choose_first_plans(ranking, math.inf if shows_all else MOST_ROWS)
    parts: list[RenderableType] = [_build_answer_lines(ranking)]
    if plans:
        parts += [
            Text(""),
            build_answer_table(ranking, plans),
            format_sentence(write_legend(ranking, plans), style="dim"),
        ]
    parts += [format_sentence(text, style="dim") for text in count_other_plans(ranking, plans)]
    if with_next:
        parts += [] if plans else [Text("")]
        parts += [format_sentence(text, style="dim") for text in _suggest_commands(ranking)]
    return Group(*parts)


def _build_answer_lines(ranking: PlanRanking) -> AnswerLines:
    answer = write_answer(ranking)
    certainty = " ".join(filter(None, (answer.work, answer.certainty)))
    must = (answer.verdict, answer.decision) if answer.verdict else (answer.decision, certainty)
    others = (certainty, answer.alternatives) if answer.verdict else (answer.alternatives,)
    faults = (answer.question, *answer.faults) if answer.question else answer.faults
    title = "" if ranking.shortfalls else _format_heading(ranking)
    return AnswerLines(tuple(filter(None, must)), others, faults, title=title)


def choose_first_plans(ranking: PlanRanking, most: float = MOST_ROWS) -> list[PlanResult]:
    """The best plan, then the Pareto front from few tractors to many, then others until there are a few rows."""
    plans, best = list_feasible(ranking), ranking.best
    front = sorted(
        (plan for plan in plans if plan.on_pareto_front and plan is not best), key=lambda plan: plan.tractors
    )
    first = [*([best] if best else []), *front]
    others = [plan for plan in plans if all(plan is not each for each in first)]
    if math.isinf(most):
        return [*first, *others]
    return [*first[: int(most)], *others[: max(LEAST_ROWS - len(first), 0)]]


def _format_heading(ranking: PlanRanking) -> str:
    name = shorten_middle(ranking.field_name, _MOST_NAME_LETTERS)
    return ", ".join(filter(None, (name, format_hectares(ranking.area_ha), describe_machines(ranking))))


def build_answer_table(ranking: PlanRanking, plans: Sequence[PlanResult]) -> FittedTable:
    """The table of some plans, in at most seven columns."""
    columns = _list_columns(ranking, plans)
    rows = tuple(tuple(column.text(plan) for column in columns) for plan in plans)
    styles = tuple("bold" if plan is ranking.best else "" for plan in plans)
    return FittedTable(tuple(column.column for column in columns), rows, styles, more_hint=_MORE_HINT)


def _list_columns(ranking: PlanRanking, plans: Sequence[PlanResult]) -> list[_AnswerColumn]:
    """At most seven columns; those that hold the answer are dropped last."""
    has_start = parse_start_time(ranking.start) is not None
    has_samples = any(plan.p50_s is not None for plan in plans)
    columns = [
        _AnswerColumn(
            TableColumn(translate("Tractors"), translate("Trac-\ntors")),
            lambda plan: _mark_count(ranking, plan, shows_front=_is_front_part(plans)),
        ),
        _AnswerColumn(TableColumn(translate("Strategy"), is_text=True, is_unbroken=True), lambda plan: plan.strategy),
        _AnswerColumn(
            TableColumn(translate("Done") if has_start else translate("Time")),
            lambda plan: format_stated_end(ranking, get_stated_end_s(plan)),
        ),
    ]
    if has_samples:
        heading = translate("95 % by") if has_start else translate("95 % in")
        columns.append(
            _AnswerColumn(
                TableColumn(heading, drop_order=3),
                lambda plan: format_stated_end(ranking, get_stated_late_end_s(plan)),
            )
        )
    else:
        columns.append(
            _AnswerColumn(TableColumn(translate("Waiting"), drop_order=4), lambda plan: format_duration(plan.waiting_s))
        )
    columns += [
        _AnswerColumn(
            TableColumn(translate("Cost {currency}", currency=ranking.currency or "").strip(), drop_order=1),
            lambda plan: format_price(get_stated_cost(plan)),
        ),
        _AnswerColumn(
            TableColumn(translate("Worked %"), translate("Work\n%"), drop_order=2),
            lambda plan: format_number(plan.worked_pct, 1),
        ),
    ]
    in_time = TableColumn(translate("In time %"), translate("In\ntime %"), drop_order=1)
    if any(plan.finish_probability is not None for plan in plans):
        columns.append(_AnswerColumn(in_time, format_in_time_probability))
    elif any(plan.meets_deadline is not None for plan in plans):
        in_time = TableColumn(translate("In time"), translate("In\ntime"), drop_order=1)
        columns.append(_AnswerColumn(in_time, lambda plan: format_yes_no(plan.meets_deadline)))
    if len(columns) < MOST_COLUMNS and has_energy(plans):
        energy = TableColumn(name_energy_column(plans), name_energy_column(plans).replace(" ", "\n"), drop_order=3)
        columns.insert(len(columns) - 1, _AnswerColumn(energy, format_energy_cell))
    return columns


def _is_front_part(plans: Sequence[PlanResult]) -> bool:
    """Whether some of the plans are on the Pareto front and some are not; a mark on all would tell nothing."""
    return len({plan.on_pareto_front for plan in plans}) > 1


def _mark_count(ranking: PlanRanking, plan: PlanResult, *, shows_front: bool) -> str:
    """The number of tractors with the marks of the legend."""
    star = ("*" if plan.on_pareto_front else " ") if shows_front else ""
    return f"{'>' if plan is ranking.best else ''}{plan.tractors}{star}"


def write_legend(ranking: PlanRanking, plans: Sequence[PlanResult]) -> str:
    """What the marks in the table mean, and what its times and costs are."""
    mark = translate("> recommended") if ranking.is_recommended else translate("> the best, but no recommendation")
    has_samples = any(plan.p50_s is not None for plan in plans)
    figures = (
        translate("times are medians, costs are means")
        if has_samples
        else translate("times and costs are as simulated")
    )
    front = [translate("* none with as few is faster")] if _is_front_part(plans) else []
    return f"{'; '.join([mark, *front, figures])}."


def count_other_plans(ranking: PlanRanking, plans: Sequence[PlanResult]) -> list[str]:
    """How many plans the table leaves out, were refused, or were not simulated."""
    refused = list_refused(ranking)
    not_simulated = sum(plan.bound_s is not None for plan in refused)
    hidden = len(list_feasible(ranking)) - len(plans)
    counts = [
        translate_count("{count} more plan", "{count} more plans", hidden) if hidden else "",
        translate("{count} refused", count=len(refused) - not_simulated) if len(refused) > not_simulated else "",
        translate("{count} not simulated as others are faster", count=not_simulated) if not_simulated else "",
    ]
    listed = ", ".join(filter(None, counts))
    return [translate("Not shown: {counts}.", counts=listed)] if listed and ranking.best is not None else []


def _suggest_commands(ranking: PlanRanking) -> list[str]:
    if ranking.best is None:
        return [translate("Add --explain (all reasons), --html plan.html (map of the places that fail).")]
    first = translate("Add --explain (why and how), --html plan.html (map), --save plan.json (drive).")
    if ranking.samples or ranking.start:
        return [first]
    return [first, translate("Add --start 13:00 --deadline 17:00 to know how sure and how cheap it can be.")]
