"""The first screen of a day for a terminal: the answer, a row per field in the order of work, and what to type next."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count
from reports.common.text_tables import AnswerLines, FittedTable, TableColumn, format_sentence
from reports.common.wording import LEAST_COST, format_percent, format_price
from reports.day.answer import (
    describe_day_certainty,
    describe_day_end,
    describe_machine_orders,
    describe_unworked_fields,
    format_end_of_day,
    format_time_of_day,
    list_day_sentences,
    sort_by_machine,
)
from reports.day.schedule_results import DayJob, DayResult, get_stated_start_s

MOST_ROWS = 8


def build_day_screen(result: DayResult, *, with_next: bool = True) -> RenderableType:
    """What is done by when in a few lines, the work of every machine in a table, and what to type next."""
    if not result.jobs:
        return Group(*(format_sentence(text) for text in list_day_sentences(result)))
    lines = AnswerLines(
        (*result.shortfalls, describe_day_end(result), *result.questions, *describe_day_certainty(result)),
        (describe_machine_orders(result.jobs),),
        tuple(describe_unworked_fields(result)),
    )
    jobs = sort_by_machine(result)
    parts: list[RenderableType] = [lines, Text(""), _build_table(result, jobs[:MOST_ROWS])]
    parts.append(format_sentence(_write_legend(result), style="dim"))
    if len(jobs) > MOST_ROWS:
        hidden = len(jobs) - MOST_ROWS
        parts.append(
            format_sentence(
                translate_count("{count} more field: --explain.", "{count} more fields: --explain.", hidden),
                style="dim",
            )
        )
    if with_next:
        text = translate("Add --explain (roads, costs, how), --html day.html (chart and map).")
        parts.append(format_sentence(text, style="dim"))
    return Group(*parts)


def _write_legend(result: DayResult) -> str:
    roads = result.paid_cost - sum(job.cost for job in result.jobs)
    if roads < LEAST_COST:
        return translate("Times are medians of the samples, costs means.")
    money = f"{format_price(roads)} {result.currency}"
    return translate("Times are medians, costs means of the samples; roads add {money}.", money=money)


def _build_table(result: DayResult, jobs: Sequence[DayJob]) -> FittedTable:
    columns = (
        TableColumn(translate("Machine"), is_text=True, is_unbroken=True),
        TableColumn(translate("Field"), is_text=True, is_unbroken=True),
        TableColumn(translate("Begins")),
        TableColumn(translate("Done")),
        TableColumn(translate("95 % by"), drop_order=2),
        TableColumn(translate("In time %"), translate("In\ntime %"), drop_order=1),
        TableColumn(translate("Cost {currency}", currency=result.currency), drop_order=3),
    )
    return FittedTable(columns, tuple(_build_row(job) for job in jobs), more_hint=translate("--explain shows more"))


def _build_row(job: DayJob) -> tuple[str, ...]:
    return (
        job.machine,
        job.field,
        format_time_of_day(get_stated_start_s(job)),
        format_end_of_day(job.p50_end_s),
        format_end_of_day(job.p95_end_s),
        format_percent(job.finish_probability),
        format_price(job.cost),
    )
