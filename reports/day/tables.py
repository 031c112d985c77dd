"""A day for a terminal (first screen, tables by machine and by field), as JSON and as CSV.

JSON and CSV have fixed keys in a fixed order and six decimals; missing values are null or empty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.rendering import EXPORT_DECIMALS, format_csv, format_json
from reports.common.text_tables import (
    FittedTable,
    TableColumn,
    build_plain_table,
    build_table,
    format_sentence,
    format_title,
)
from reports.common.wording import LEAST_COST, NO_VALUE, format_duration, format_number, format_percent, format_price
from reports.day.results import (
    DayJob,
    DayResult,
    build_day_answer,
    format_end_of_day,
    format_time_of_day,
    list_day_sentences,
)

DAY_KEYS = (
    "jobs", "not_done", "gap_pct", "advice", "machines", "cost", "paid_cost", "risked_cost", "finish_probability",
    "currency", "samples", "seed", "start_s", "end_s", "remarks", "questions", "shortfalls", "certainty_pct",
    "p50_done_s", "p95_done_s", "summary",
)  # fmt: skip
DAY_CSV_KEYS = (
    "field", "machine", "strategy", "tractors", "start_s", "end_s", "finish_probability", "p50_end_s", "p95_end_s",
    "leaves_s", "km", "time_s", "cost", "lost_cost", "area_ha", "reason",
)  # fmt: skip
MOST_ROWS = 8  # of the first screen
_JOB_FIGURES: Mapping[str, tuple[TableColumn, Callable[[DayJob], str]]] = {
    "field": (TableColumn("Field", is_text=True), lambda job: job.field),
    "area": (TableColumn("ha", drop_order=4), lambda job: format_number(job.area_ha, 2)),
    "machine": (TableColumn("Machine", is_text=True), lambda job: job.machine),
    "tractors": (TableColumn("Tractors", "Trac-\ntors", drop_order=5), lambda job: str(job.tractors)),
    "begin": (TableColumn("Begins"), lambda job: format_time_of_day(job.p50_start_s)),
    "end": (TableColumn("Done"), lambda job: format_end_of_day(job.p50_end_s)),
    "late end": (TableColumn("95 % by", drop_order=2), lambda job: format_end_of_day(job.p95_end_s)),
    "time": (TableColumn("Plan's time", "Plan's\ntime", drop_order=6), lambda job: format_duration(job.time_s)),
    "share": (TableColumn("In time %", "In\ntime %", drop_order=1), lambda job: format_percent(job.finish_probability)),
    "cost": (TableColumn("Cost", drop_order=3), lambda job: format_price(job.cost)),
    "lost": (TableColumn("Lost", drop_order=4), lambda job: format_price(job.lost_cost)),
}


def format_day_json(result: DayResult) -> str:
    """The day as JSON text with a trailing newline; the guide on days lists the keys."""
    made = {
        "not_done": result.unworked_fields,
        "machines": result.fleets,
        "summary": list_day_sentences(result),
    }
    content = {key: made[key] if key in made else getattr(result, key) for key in DAY_KEYS}
    return format_json(content, EXPORT_DECIMALS, is_ascii=False)


def format_day_csv(result: DayResult) -> str:
    """A row per field as CSV text: jobs fleet by fleet, then the fields not done with the reason."""
    return format_csv(DAY_CSV_KEYS, [*result.jobs, *result.unworked_fields])


def build_day_screen(result: DayResult, *, with_next: bool = True) -> RenderableType:
    """What is done by when in a few lines, the work of every machine in a table, and what to type next."""
    if not result.jobs:
        return Group(*(format_sentence(text) for text in list_day_sentences(result)))
    lines = replace(build_day_answer(result), is_whole=not with_next)
    machines = [fleet.name for fleet in result.fleets]
    jobs = sorted(result.jobs, key=lambda job: (machines.index(job.machine), job.p50_end_s))
    figures = [
        (replace(column, is_unbroken=column.is_text), write)
        for column, write in map(
            _JOB_FIGURES.__getitem__, ("machine", "field", "begin", "end", "late end", "share", "cost")
        )
    ]
    figures[-1] = TableColumn(translate("Cost {currency}", currency=result.currency), drop_order=3), figures[-1][1]
    roads, hidden = result.paid_cost - sum(job.cost for job in result.jobs), len(jobs) - MOST_ROWS
    notes = [translate("Times are medians of the samples, costs means.")]
    if roads >= LEAST_COST:
        money = f"{format_price(roads)} {result.currency}"
        notes = [translate("Times are medians, costs means of the samples; roads add {money}.", money=money)]
    if hidden > 0:
        notes.append(translate_count("{count} more field: --explain.", "{count} more fields: --explain.", hidden))
    if with_next:
        notes.append(translate("Add --explain (roads, costs, how), --html day.html (chart and map)."))
    more_hint = translate("--explain shows more")
    return Group(lines, "", build_table(jobs[:MOST_ROWS], figures, more_hint=more_hint, notes=tuple(notes)))


def build_day_table(result: DayResult) -> RenderableType:
    """What a day says beyond its first screen: the jobs of every machine, every field, what is not done, the costs."""
    parts: list[RenderableType] = [format_sentence(describe_optimality_gap(result))]
    if result.jobs:
        parts += [Text(""), format_title("By machine"), build_machine_table(result)]
        notes = (describe_day_columns(result),)
        parts += [Text(""), format_title("By field"), build_job_table(sort_by_field(result), notes=notes)]
    if result.unworked_fields:
        parts += [Text(""), format_title("Not done"), build_unworked_table(result)]
    money = build_plain_table(("For", result.currency), list_money_rows(result), notes=result.remarks)
    return Group(*parts, Text(""), format_title("Costs"), money)


def describe_day_columns(result: DayResult) -> str:
    """What the columns of the tables hold."""
    text = (
        "Times are hh:mm, +1 is the next day, and medians of the samples, late starts included. 95 % by: the end in "
        "95 % of the samples. Plan's time: without delays. In time %: done before the rain and within the hours of the "
        "field. Lost: mean loss on ground that is not done by then."
    )
    has_service_stops = any(job.refills is not None for job in result.jobs)
    return text + " Times include filling and emptying tanks, between fields and on them." * has_service_stops


def describe_optimality_gap(result: DayResult) -> str:
    """How far from the optimal order of the fields the day can be."""
    times = "mean times of work"
    if result.certainty_pct is not None:
        times = f"times of work that {result.certainty_pct:g} % of the samples keep"
    if result.gap_pct == 0.0:
        return f"Optimal order of the fields, by {times}."
    return f"Within {result.gap_pct:.1f} % of the optimal order of the fields, by {times}."


def build_machine_table(result: DayResult) -> FittedTable:
    """What every machine does, a row per field and one for the road back: machine, what, from, to, km, in time."""
    columns = (
        TableColumn("Machine", is_text=True), TableColumn("Field", is_text=True),
        TableColumn("From"), TableColumn("To"),
        TableColumn("Road km", "Road\nkm", drop_order=2), TableColumn("In time %", "In\ntime %", drop_order=1),
    )  # fmt: skip
    rows: list[tuple[str, ...]] = []
    for fleet in result.fleets:
        jobs, name = [job for job in result.jobs if job.machine == fleet.name], f"{fleet.name} ({fleet.words})"
        if not jobs:
            rows.append((name, translate("stays"), NO_VALUE, NO_VALUE, NO_VALUE, NO_VALUE))
        for job in jobs:
            what = f"{job.field}: {job.strategy}"
            start, end = format_time_of_day(job.p50_start_s), format_end_of_day(job.p50_end_s)
            km, share = format_number(job.km, 1), format_percent(job.finish_probability)
            rows.append((name if job is jobs[0] else "", what, start, end, km, share))
        if jobs and fleet.p50_home_s is not None:
            back_km = format_number(fleet.km - sum(job.km for job in jobs), 1)
            start, end = format_end_of_day(jobs[-1].p50_end_s), format_end_of_day(fleet.p50_home_s)
            rows.append(("", translate("back"), start, end, back_km, NO_VALUE))
    return FittedTable(columns, tuple(rows))


def build_job_table(jobs: Sequence[DayJob], notes: tuple[str, ...] = ()) -> FittedTable:
    """A row for every field that is done."""
    return build_table(jobs, list(_JOB_FIGURES.values()), notes=notes)


def build_unworked_table(result: DayResult) -> FittedTable:
    """A row for every field that is not done, with what that costs and why."""
    rows = (
        (one.field, format_number(one.area_ha, 2), format_price(one.cost), translate_sentence(one.reason))
        for one in result.unworked_fields
    )
    return build_plain_table(("Field", "ha", "Costs", "Why"), rows, (0, 3))


def sort_by_field(result: DayResult) -> Sequence[DayJob]:
    """Jobs in the order of the day file."""
    return sorted(result.jobs, key=lambda job: result.fields.index(job.field))


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
