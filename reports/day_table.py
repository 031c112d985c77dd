"""A day for a terminal: the advice, a table by machine and one by field."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Group, RenderableType
from rich.text import Text

from reports.day_results import DayJob, DayResult
from reports.fitting import Column, FittedTable, sentence
from reports.wording import NOTHING, duration, number, percent, price

DAY_S = 86_400


def day_table(result: DayResult) -> RenderableType:
    """The answer in words, what every machine does in order, every field, what is left and why, and what all costs."""
    parts: list[RenderableType] = [sentence(result.advice), sentence(gap_words(result))]
    if result.jobs:
        parts += [Text(""), _title("By machine"), _by_machine(result)]
        parts += [Text(""), _title("By field"), _by_field(result), sentence(legend(result), style="dim")]
    if result.not_done:
        parts += [Text(""), _title("Left"), _left(result)]
    parts += [Text(""), _title("Money"), FittedTable(_money_columns(result), tuple(money_rows(result)))]
    parts += [sentence(text, style="dim") for text in result.remarks]
    return Group(*parts)


def legend(result: DayResult) -> str:
    """What the columns hold."""
    words = (
        f"Times are hh:mm, +1 is the next day. Begins and Ends are planned with {_times(result)}; P95 is the end in 95 "
        "of 100 draws, late starts included. In time %: done before the rain and the end of the hours in which the "
        "field may be worked. Lost is what ground that is not done by then costs in the mean."
    )
    carried = any(job.refills is not None for job in result.jobs)
    tanks = " Tanks are made good between fields, and on a field as often as its plan says; both count in the times."
    return words + tanks * carried


def _times(result: DayResult) -> str:
    """The times that a day is planned with, in words."""
    if result.certainty_pct is None:
        return "mean times of work"
    return f"times of work that {result.certainty_pct:g} % of the draws keep"


def gap_words(result: DayResult) -> str:
    """How far from the best the day can be."""
    if result.gap_pct == 0.0:
        return f"Proven: no other order of the fields is expected to cost less, by {_times(result)}."
    return f"No other order of the fields can cost more than {result.gap_pct:.1f} % less, by {_times(result)}."


def at(seconds: float | None) -> str:
    """Seconds of the day as hh:mm, with the days that follow; a dash when there are none."""
    if seconds is None:
        return NOTHING
    minutes = round(seconds / 60.0)
    days, minute = divmod(minutes, 24 * 60)
    return f"{minute // 60:02d}:{minute % 60:02d}" + (f"+{days}" if days else "")


def machine_rows(result: DayResult) -> list[tuple[str, ...]]:
    """What every machine does, a row per way and field: machine, what, from, to, km, in time."""
    rows: list[tuple[str, ...]] = []
    for fleet in result.fleets:
        jobs = [job for job in result.jobs if job.machine == fleet.name]
        if not jobs:
            rows.append((fleet.name, "stays", NOTHING, NOTHING, NOTHING, NOTHING))
        for place, job in enumerate(jobs):
            name = fleet.name if not place else ""
            rows.append((name, f"{job.field}: {job.strategy}", at(job.start_s), at(job.end_s), number(job.km, 1),
                         percent(job.finish_probability)))  # fmt: skip
        if jobs and fleet.home_s is not None:
            back = fleet.km - sum(job.km for job in jobs)
            rows.append(("", "back", at(jobs[-1].end_s), at(fleet.home_s), number(back, 1), NOTHING))
    return rows


def _by_machine(result: DayResult) -> FittedTable:
    words = {fleet.name: fleet.words for fleet in result.fleets}
    rows = [
        (f"{name} ({words[name]})" if name else "", *others) for name, *others in machine_rows(result)
    ]  # fmt: skip
    columns = (
        Column("Machine", words=True), Column("Field", words=True), Column("From"), Column("To"),
        Column("Road km", "Road\nkm", drop=2), Column("In time %", "In\ntime %", drop=1),
    )  # fmt: skip
    return FittedTable(columns, tuple(rows))


def field_row(job: DayJob) -> tuple[str, ...]:
    """A field that is done: name, area, machine, tractors, start, end, P95, plan's time, in time, cost, lost."""
    return (
        job.field, number(job.area_ha, 2), job.machine, str(job.tractors), at(job.start_s), at(job.end_s),
        at(job.p95_end_s), duration(job.time_s), percent(job.finish_probability), price(job.cost),
        price(job.lost_cost),
    )  # fmt: skip


FIELD_COLUMNS = (
    Column("Field", words=True), Column("ha", drop=4), Column("Machine", words=True),
    Column("Tractors", "Trac-\ntors", drop=5), Column("Begins"), Column("Ends"), Column("P95", drop=2),
    Column("Plan's time", "Plan's\ntime", drop=6), Column("In time %", "In\ntime %", drop=1),
    Column("Cost", drop=3), Column("Lost", drop=4),
)  # fmt: skip


def by_field(result: DayResult) -> Sequence[DayJob]:
    """Jobs in the order of the day file."""
    return sorted(result.jobs, key=lambda job: result.fields.index(job.field))


def _by_field(result: DayResult) -> FittedTable:
    return FittedTable(FIELD_COLUMNS, tuple(field_row(job) for job in by_field(result)))


def money_rows(result: DayResult) -> list[tuple[str, str]]:
    """What the day is expected to cost and of what that is made, each with its money."""
    return [
        ("Work", price(sum(job.cost for job in result.jobs))),
        *((f"Ways of {fleet.name}", price(fleet.ways_cost)) for fleet in result.fleets if fleet.leaves_s is not None),
        ("Ground not done in time", price(sum(job.lost_cost for job in result.jobs))),
        ("Fields left", price(sum(one.cost for one in result.not_done))),
        ("Expected cost", price(result.cost)),
    ]


def _money_columns(result: DayResult) -> tuple[Column, ...]:
    return Column("For", words=True), Column(result.currency)


def _left(result: DayResult) -> FittedTable:
    columns = (Column("Field", words=True), Column("ha"), Column("Costs"), Column("Why", words=True))
    return FittedTable(
        columns, tuple((one.field, number(one.area_ha, 2), price(one.cost), one.reason) for one in result.not_done)
    )


def _title(text: str) -> Text:
    return Text(text, style="bold underline")
