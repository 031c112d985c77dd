"""A day for a terminal (advice, tables by machine and by field), as JSON and as CSV.

JSON and CSV have fixed keys in a fixed order and six decimals; missing values are null or empty.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_sentence
from reports.common.rendering import make_json_safe
from reports.common.text_tables import FittedTable, TableColumn, format_sentence, format_title
from reports.common.wording import NO_VALUE, format_duration, format_number, format_percent, format_price
from reports.day.answer import format_end_of_day, format_time_of_day, list_day_sentences
from reports.day.schedule_results import DayJob, DayResult, get_stated_end_s, get_stated_start_s

JOB_KEYS = (
    "field", "machine", "strategy", "tractors", "start_s", "end_s", "finish_probability",
    "finish_probability_interval", "p50_end_s", "p95_end_s", "leaves_s", "km", "time_s", "cost", "lost_cost",
    "area_ha", "worked_pct", "refills", "p50_start_s",
)  # fmt: skip
NOT_DONE_KEYS = ("field", "area_ha", "cost", "reason")
FLEET_KEYS = ("name", "words", "leaves_s", "home_s", "km", "road_cost", "p50_home_s")
DAY_CSV_KEYS = (
    "field", "machine", "strategy", "tractors", "start_s", "end_s", "finish_probability", "p50_end_s", "p95_end_s",
    "leaves_s", "km", "time_s", "cost", "lost_cost", "area_ha", "reason",
)  # fmt: skip
DAY_DECIMALS = 6


def format_day_json(result: DayResult) -> str:
    """The day as JSON text with a trailing newline.

    Keys: ``jobs`` (each with `JOB_KEYS`, fleet after fleet in the order they work), ``not_done`` (`NOT_DONE_KEYS`),
    ``gap_pct``, ``advice``, ``machines`` (`FLEET_KEYS`), ``cost`` (the sum of ``cost`` and ``lost_cost`` of the jobs,
    ``road_cost`` of the machines and ``cost`` of what is not done), ``paid_cost`` and ``risked_cost`` (what of it is
    paid, and what may be lost), ``finish_probability`` (of all jobs), ``currency``, ``samples``, ``seed``,
    ``start_s``, ``end_s``, ``remarks``, ``questions`` (to check), ``shortfalls`` (on plans that are no
    recommendation), ``certainty_pct`` (null: mean times), ``p50_done_s`` and ``p95_done_s`` (all jobs), ``summary``
    (the answer as it is printed).
    Times are seconds of the day on which work begins, above 86,400 past midnight.
    """
    content = {
        "jobs": [build_job_entry(job) for job in result.jobs],
        "not_done": [{key: getattr(one, key) for key in NOT_DONE_KEYS} for one in result.unworked_fields],
        "gap_pct": result.gap_pct,
        "advice": result.advice,
        "machines": [{key: getattr(one, key) for key in FLEET_KEYS} for one in result.fleets],
        "cost": result.cost,
        "paid_cost": result.paid_cost,
        "risked_cost": result.risked_cost,
        "finish_probability": result.finish_probability,
        "currency": result.currency,
        "samples": result.samples,
        "seed": result.seed,
        "start_s": result.start_s,
        "end_s": result.end_s,
        "remarks": result.remarks,
        "questions": result.questions,
        "shortfalls": result.shortfalls,
        "certainty_pct": result.certainty_pct,
        "p50_done_s": result.stated_end_s if result.jobs else None,
        "p95_done_s": result.stated_late_end_s if result.jobs else None,
        "summary": list_day_sentences(result),
    }
    return json.dumps(make_json_safe(content, DAY_DECIMALS), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def format_day_csv(result: DayResult) -> str:
    """A row per field as CSV text: jobs fleet by fleet, then the fields not done with the reason."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(DAY_CSV_KEYS)
    unworked_fields = [{key: getattr(one, key) for key in NOT_DONE_KEYS} for one in result.unworked_fields]
    for row in (*(build_job_entry(job) for job in result.jobs), *unworked_fields):
        values = (make_json_safe(row.get(key), DAY_DECIMALS) for key in DAY_CSV_KEYS)
        writer.writerow(["" if value is None else value for value in values])
    return buffer.getvalue()


def build_job_entry(job: DayJob) -> dict[str, Any]:
    """One job with `JOB_KEYS`."""
    return {key: getattr(job, key) for key in JOB_KEYS}


DAY_S = 86_400


def build_day_table(result: DayResult) -> RenderableType:
    """What a day says beyond its first screen: the jobs of every machine, every field, what is not done, the costs."""
    parts: list[RenderableType] = [format_sentence(describe_optimality_gap(result))]
    if result.jobs:
        parts += [Text(""), format_title("By machine"), _build_machine_table(result)]
        parts += [
            Text(""),
            format_title("By field"),
            _build_field_table(result),
            format_sentence(describe_day_columns(result), style="dim"),
        ]
    if result.unworked_fields:
        parts += [Text(""), format_title("Not done"), _build_unworked_table(result)]
    parts += [
        Text(""),
        format_title("Costs"),
        FittedTable(_list_day_money_columns(result), tuple(list_money_rows(result))),
    ]
    parts += [format_sentence(text, style="dim") for text in result.remarks]
    return Group(*parts)


def describe_day_columns(result: DayResult) -> str:
    """What the columns of the tables hold."""
    text = (
        "Times are hh:mm, +1 is the next day, and medians of the samples, late starts included. P95: the end in 95 % "
        "of the samples. Plan's time: without delays. In time %: done before the rain and within the hours of the "
        "field. "
        "Lost: mean loss on ground that is not done by then."
    )
    has_service_stops = any(job.refills is not None for job in result.jobs)
    return text + " Times include filling and emptying tanks, between fields and on them." * has_service_stops


def _describe_planning_times(result: DayResult) -> str:
    """The times that a day is planned with: means, or a quantile."""
    if result.certainty_pct is None:
        return "mean times of work"
    return f"times of work that {result.certainty_pct:g} % of the samples keep"


def describe_optimality_gap(result: DayResult) -> str:
    """How far from the optimal order of the fields the day can be."""
    if result.gap_pct == 0.0:
        return f"Optimal order of the fields, by {_describe_planning_times(result)}."
    return f"Within {result.gap_pct:.1f} % of the optimal order of the fields, by {_describe_planning_times(result)}."


def list_machine_rows(result: DayResult) -> list[tuple[str, ...]]:
    """What every machine does, a row per field and one for the road back: machine, what, from, to, km, in time."""
    rows: list[tuple[str, ...]] = []
    for fleet in result.fleets:
        jobs = [job for job in result.jobs if job.machine == fleet.name]
        if not jobs:
            rows.append((fleet.name, translate("stays"), NO_VALUE, NO_VALUE, NO_VALUE, NO_VALUE))
        for place, job in enumerate(jobs):
            name = fleet.name if not place else ""
            rows.append(
                (
                    name,
                    f"{job.field}: {job.strategy}",
                    format_time_of_day(get_stated_start_s(job)),
                    format_end_of_day(get_stated_end_s(job)),
                    format_number(job.km, 1),
                    format_percent(job.finish_probability),
                )
            )
        if jobs and fleet.home_s is not None:
            back = fleet.km - sum(job.km for job in jobs)
            rows.append(
                (
                    "",
                    translate("back"),
                    format_end_of_day(get_stated_end_s(jobs[-1])),
                    format_end_of_day(fleet.stated_home_s),
                    format_number(back, 1),
                    NO_VALUE,
                )
            )
    return rows


def _build_machine_table(result: DayResult) -> FittedTable:
    descriptions = {fleet.name: fleet.words for fleet in result.fleets}
    rows = [
        (f"{name} ({descriptions[name]})" if name else "", *others) for name, *others in list_machine_rows(result)
    ]  # fmt: skip
    columns = (
        TableColumn("Machine", is_text=True), TableColumn("Field", is_text=True),
        TableColumn("From"), TableColumn("To"),
        TableColumn("Road km", "Road\nkm", drop_order=2), TableColumn("In time %", "In\ntime %", drop_order=1),
    )  # fmt: skip
    return FittedTable(columns, tuple(rows))


def build_field_row(job: DayJob) -> tuple[str, ...]:
    """A field that is done, in the order of `FIELD_COLUMNS`."""
    return (
        job.field,
        format_number(job.area_ha, 2),
        job.machine,
        str(job.tractors),
        format_time_of_day(get_stated_start_s(job)),
        format_end_of_day(get_stated_end_s(job)),
        format_end_of_day(job.p95_end_s),
        format_duration(job.time_s),
        format_percent(job.finish_probability),
        format_price(job.cost),
        format_price(job.lost_cost),
    )


FIELD_COLUMNS = (
    TableColumn("Field", is_text=True), TableColumn("ha", drop_order=4), TableColumn("Machine", is_text=True),
    TableColumn("Tractors", "Trac-\ntors", drop_order=5), TableColumn("Begins"), TableColumn("Done"),
    TableColumn("P95", drop_order=2),
    TableColumn("Plan's time", "Plan's\ntime", drop_order=6), TableColumn("In time %", "In\ntime %", drop_order=1),
    TableColumn("Cost", drop_order=3), TableColumn("Lost", drop_order=4),
)  # fmt: skip


def sort_by_field(result: DayResult) -> Sequence[DayJob]:
    """Jobs in the order of the day file."""
    return sorted(result.jobs, key=lambda job: result.fields.index(job.field))


def _build_field_table(result: DayResult) -> FittedTable:
    return FittedTable(FIELD_COLUMNS, tuple(build_field_row(job) for job in sort_by_field(result)))


def list_money_rows(result: DayResult) -> list[tuple[str, str]]:
    """The parts of the expected cost of the day, and their sum."""
    return [
        (translate("Work"), format_price(sum(job.cost for job in result.jobs))),
        *(
            (translate("Road of {machine}", machine=fleet.name), format_price(fleet.road_cost))
            for fleet in result.fleets
            if fleet.leaves_s is not None
        ),
        (translate("Ground not done in time"), format_price(sum(job.lost_cost for job in result.jobs))),
        (translate("Fields not done"), format_price(sum(one.cost for one in result.unworked_fields))),
        (translate("Paid"), format_price(result.paid_cost)),
        (translate("At risk"), format_price(result.risked_cost)),
        (translate("Expected cost"), format_price(result.cost)),
    ]


def _list_day_money_columns(result: DayResult) -> tuple[TableColumn, ...]:
    return TableColumn("For", is_text=True), TableColumn(result.currency)


def _build_unworked_table(result: DayResult) -> FittedTable:
    columns = (
        TableColumn("Field", is_text=True),
        TableColumn("ha"),
        TableColumn("Costs"),
        TableColumn("Why", is_text=True),
    )
    return FittedTable(
        columns,
        tuple(
            (one.field, format_number(one.area_ha, 2), format_price(one.cost), translate_sentence(one.reason))
            for one in result.unworked_fields
        ),
    )
