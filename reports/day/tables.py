"""A day of several fields and fleets: result types, plain frozen data; what is said of it; tables, JSON and CSV.

Times are seconds of the day on which it begins: past midnight they are above 86,400. JSON and CSV have fixed keys in a
fixed order and six decimals; missing values are null or empty.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.plan_records import Points
from reports.common.rendering import EXPORT_DECIMALS, ShownResult, format_entries_csv, format_json
from reports.common.text_tables import (
    MOST_NAMED,
    AnswerLines,
    FittedTable,
    TableColumn,
    build_table,
    format_sentence,
    format_title,
)
from reports.common.wording import (
    LEAST_COST,
    NO_VALUE,
    SURE_SHARE,
    format_duration,
    format_number,
    format_percent,
    format_price,
    round_up_to_minute,
)


@dataclass(frozen=True)
class DayJob:
    """One field worked by one fleet (`machine`) with so many tractors, as planned from `start_s` to `end_s`.

    The fleet leaves the place before at `leaves_s`, for `km` of road. `finish_probability` is that of being done before
    the rain and the end of its window, with its 95 % interval; it is done by `p50_end_s` and `p95_end_s` in half and in
    95 % of the samples. `time_s` is the time of the simulated plan without variation, `cost` that of the work,
    `lost_cost` the mean loss on ground not done in time, `worked_pct` the share of the field that the plan works.
    `refills` counts stops to fill or empty a tank, None where nothing is carried. `p50_start_s` and `p50_leaves_s` are
    the medians of the samples, as reports state them.
    """

    field: str
    machine: str
    strategy: str
    tractors: int
    area_ha: float
    leaves_s: float
    km: float
    start_s: float
    end_s: float
    time_s: float
    finish_probability: float
    finish_probability_interval: tuple[float, float]
    p50_end_s: float
    p95_end_s: float
    cost: float
    lost_cost: float = 0.0
    worked_pct: float | None = None
    refills: int | None = None
    p50_start_s: float | None = None
    p50_leaves_s: float | None = None

    @property
    def stated_start_s(self) -> float:
        """The begin of the work that every report states: the median of the samples, seconds of the day."""
        return self.start_s if self.p50_start_s is None else self.p50_start_s

    @property
    def stated_leaves_s(self) -> float:
        """When the fleet leaves the place before, the median of the samples."""
        return self.leaves_s if self.p50_leaves_s is None else self.p50_leaves_s


@dataclass(frozen=True)
class UnworkedField:
    """A field that is not done, what that costs, and why in a sentence."""

    field: str
    area_ha: float
    cost: float
    reason: str


@dataclass(frozen=True)
class FleetDay:
    """The day of a fleet: what it is (`words`), when it leaves and is home (None if it stays), km and cost of roads.

    `p50_home_s` is the median of the samples.
    """

    name: str
    words: str
    leaves_s: float | None
    home_s: float | None
    km: float
    road_cost: float = 0.0
    p50_home_s: float | None = None

    @property
    def stated_home_s(self) -> float | None:
        """When the fleet is home as every report states it: the median of the samples."""
        return self.home_s if self.p50_home_s is None else self.p50_home_s


@dataclass(frozen=True, eq=False)
class MapPlace:
    """A place on the map, in metres: a field with its outline (n, 2), or the yard without one."""

    name: str
    x_m: float
    y_m: float
    outline: Points | None = None


@dataclass(frozen=True, eq=False, repr=False)
class DayResult(ShownResult):
    """The answer to a day file.

    `cost` is the expected cost of the whole day: `cost` and `lost_cost` of all jobs, `road_cost` of all fleets and
    `cost` of the fields not done. `gap_pct` is by how much less another order could cost at most, by the times it is
    planned with: means, or those that `certainty_pct` of the samples keep. `windows` are the hours in which each
    field may be worked, in the order of `fields`; `breaks` are those of the drivers. All jobs are done by `p50_done_s`
    and `p95_done_s` in half and in 95 % of the samples. `questions` are about tractors that seem too weak for their
    implement, and plans that were cut short for lack of computing time; `shortfalls` sentences on plans that are no
    recommendation.
    """

    start_s: float
    end_s: float
    jobs: tuple[DayJob, ...]
    unworked_fields: tuple[UnworkedField, ...]
    fleets: tuple[FleetDay, ...]
    gap_pct: float
    cost: float
    finish_probability: float | None
    currency: str
    samples: int
    seed: int
    advice: str
    remarks: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()
    windows: tuple[tuple[tuple[float, float], ...], ...] = ()
    breaks: tuple[tuple[float, float], ...] = ()
    rain: tuple[tuple[float, float], ...] = ()
    places: tuple[MapPlace, ...] = ()
    closest_field: str = ""
    certainty_pct: float | None = None
    p50_done_s: float | None = None
    p95_done_s: float | None = None
    questions: tuple[str, ...] = ()
    shortfalls: tuple[str, ...] = ()

    @property
    def paid_cost(self) -> float:
        """What is paid: work and roads."""
        return sum(job.cost for job in self.jobs) + sum(fleet.road_cost for fleet in self.fleets)

    @property
    def risked_cost(self) -> float:
        """The rest of the cost, which nobody pays: the loss on ground that is late or not worked."""
        return self.cost - self.paid_cost

    @property
    def stated_end_s(self) -> float:
        """When the day is done as every report states it: the median of the samples."""
        return max(job.p50_end_s for job in self.jobs) if self.p50_done_s is None else self.p50_done_s

    @property
    def stated_late_end_s(self) -> float:
        """When the day is done in 95 % of the samples."""
        return max(job.p95_end_s for job in self.jobs) if self.p95_done_s is None else self.p95_done_s


def list_day_sentences(result: DayResult) -> list[str]:
    """The answer, the most important first."""
    if not result.jobs:
        return [translate("No field can be done on this day."), *describe_unworked_fields(result)]
    return [
        *result.shortfalls,
        describe_day_end(result),
        *result.questions,
        *describe_day_certainty(result),
        describe_machine_orders(result.jobs),
        *describe_unworked_fields(result),
    ]


def describe_day_end(result: DayResult) -> str:
    """``All 3 fields are done by 15:22 (95 % by 15:50), 471 EUR.``: medians of the samples, means of the costs."""
    count, total = len(result.jobs), len(result.jobs) + len(result.unworked_fields)
    values = {
        "done": _format_end_in_words(result.stated_end_s),
        "late": _format_end_in_words(result.stated_late_end_s),
        "cost": _describe_cost(result),
        "total": total,
    }
    if count == total > 1:
        return translate("All {total} fields are done by {done} (95 % by {late}), {cost}.", **values)
    return translate_count(
        "{count} of {total} fields is done by {done} (95 % by {late}), {cost}.",
        "{count} of {total} fields are done by {done} (95 % by {late}), {cost}.",
        count,
        **values,
    )


def _describe_cost(result: DayResult) -> str:
    """``431 EUR paid and 40 EUR at risk``: what nobody pays is no part of a price."""
    paid = f"{format_price(result.paid_cost)} {result.currency}"
    if result.risked_cost < LEAST_COST:
        return paid
    risked = f"{format_price(result.risked_cost)} {result.currency}"
    return translate("{paid} paid and {risked} at risk", paid=paid, risked=risked)


def describe_day_certainty(result: DayResult) -> list[str]:
    """How sure it is that all is done in time, and what is least sure."""
    if result.finish_probability is None:
        return []
    share = format_percent(result.finish_probability)
    weakest = min(result.jobs, key=lambda job: (round(job.finish_probability, 6), job.p50_end_s))
    least = format_percent(weakest.finish_probability)
    if len(result.jobs) == 1 or weakest.finish_probability >= SURE_SHARE:
        return [translate("In time: {share} % sure.", share=share)]
    return [
        translate("In time: {share} % sure, least {field} ({least} %).", share=share, field=weakest.field, least=least)
    ]


def describe_machine_orders(jobs: Sequence[DayJob]) -> str:
    """Which machine works which fields in which order."""
    counts = {job.machine: job.tractors for job in jobs}
    orders = [
        translate(
            "{machine} ({count}): {fields}",
            machine=machine,
            count=count,
            fields=translate(", then ").join(job.field for job in jobs if job.machine == machine),
        )
        for machine, count in counts.items()
    ]
    return f"{'; '.join(orders)}."


def describe_unworked_fields(result: DayResult) -> list[str]:
    """The fields that are not done, with the reasons of the first."""
    left = result.unworked_fields
    sentences = [
        translate("{field} is not worked: {reason}.", field=one.field, reason=translate_sentence(one.reason))
        for one in left[:MOST_NAMED]
    ]
    more = len(left) - MOST_NAMED
    if more > 0:
        sentences.append(translate_count("{count} more is not worked.", "{count} more are not worked.", more))
    return sentences


def sort_by_machine(result: DayResult) -> list[DayJob]:
    """Jobs by machine, in the order in which each works them."""
    machines = [fleet.name for fleet in result.fleets]
    return sorted(result.jobs, key=lambda job: (machines.index(job.machine), job.p50_end_s))


def format_time_of_day(seconds: float | None) -> str:
    """Seconds of the day as hh:mm, past midnight with +1; a dash when there are none."""
    if seconds is None:
        return NO_VALUE
    minutes = round(seconds / 60.0)
    days, minute = divmod(minutes, 24 * 60)
    return f"{minute // 60:02d}:{minute % 60:02d}" + (f"+{days}" if days else "")


def format_end_of_day(seconds: float | None) -> str:
    """When something is done, seconds of the day as hh:mm, up to the minute."""
    return format_time_of_day(None if seconds is None else round_up_to_minute(seconds))


def _format_end_in_words(seconds: float) -> str:
    """When something is done, as a sentence says it: ``00:39 next day``."""
    clock, _, days = format_end_of_day(seconds).partition("+")
    if not days:
        return clock
    return translate_count("{clock} next day", "{clock}, {count} days later", int(days), clock=clock)


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


def format_day_json(result: DayResult) -> str:
    """The day as JSON text with a trailing newline.

    Keys: ``jobs`` (each as DayJob has it, fleet after fleet in the order they work), ``not_done`` (UnworkedField),
    ``gap_pct``, ``advice``, ``machines`` (FleetDay), ``cost`` (the sum of ``cost`` and ``lost_cost`` of the jobs,
    ``road_cost`` of the machines and ``cost`` of what is not done), ``paid_cost`` and ``risked_cost`` (what of it is
    paid, and what may be lost), ``finish_probability`` (of all jobs), ``currency``, ``samples``, ``seed``,
    ``start_s``, ``end_s``, ``remarks``, ``questions`` (to check), ``shortfalls`` (on plans that are no
    recommendation), ``certainty_pct`` (null: mean times), ``p50_done_s`` and ``p95_done_s`` (all jobs), ``summary``
    (the answer as it is printed).
    Times are seconds of the day on which work begins, above 86,400 past midnight.
    """
    made = {
        "not_done": result.unworked_fields,
        "machines": result.fleets,
        "p50_done_s": result.stated_end_s if result.jobs else None,
        "p95_done_s": result.stated_late_end_s if result.jobs else None,
        "summary": list_day_sentences(result),
    }
    content = {key: made[key] if key in made else getattr(result, key) for key in DAY_KEYS}
    return format_json(content, EXPORT_DECIMALS, is_ascii=False)


def format_day_csv(result: DayResult) -> str:
    """A row per field as CSV text: jobs fleet by fleet, then the fields not done with the reason."""
    return format_entries_csv(DAY_CSV_KEYS, [*result.jobs, *result.unworked_fields])


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
    parts: list[RenderableType] = [lines, Text(""), _build_screen_table(result, jobs[:MOST_ROWS])]
    roads, hidden = result.paid_cost - sum(job.cost for job in result.jobs), len(jobs) - MOST_ROWS
    notes = [translate("Times are medians of the samples, costs means.")]
    if roads >= LEAST_COST:
        money = f"{format_price(roads)} {result.currency}"
        notes = [translate("Times are medians, costs means of the samples; roads add {money}.", money=money)]
    if hidden > 0:
        notes.append(translate_count("{count} more field: --explain.", "{count} more fields: --explain.", hidden))
    if with_next:
        notes.append(translate("Add --explain (roads, costs, how), --html day.html (chart and map)."))
    return Group(*parts, *(format_sentence(text, style="dim") for text in notes))


def _build_screen_table(result: DayResult, jobs: Sequence[DayJob]) -> FittedTable:
    figures = [
        (replace(column, is_unbroken=column.is_text), write)
        for column, write in (_JOB_FIGURES[key] for key in _SCREEN_KEYS)
    ]
    cost = TableColumn(translate("Cost {currency}", currency=result.currency), drop_order=3)
    figures[-1] = cost, figures[-1][1]
    return build_table(jobs, figures, more_hint=translate("--explain shows more"))


def build_day_table(result: DayResult) -> RenderableType:
    """What a day says beyond its first screen: the jobs of every machine, every field, what is not done, the costs."""
    parts: list[RenderableType] = [format_sentence(describe_optimality_gap(result))]
    if result.jobs:
        parts += [Text(""), format_title("By machine"), build_machine_table(result)]
        parts += [Text(""), format_title("By field"), build_job_table(sort_by_field(result))]
        parts.append(format_sentence(describe_day_columns(result), style="dim"))
    if result.unworked_fields:
        columns = (
            TableColumn("Field", is_text=True), TableColumn("ha"), TableColumn("Costs"),
            TableColumn("Why", is_text=True),
        )  # fmt: skip
        rows = tuple(
            (one.field, format_number(one.area_ha, 2), format_price(one.cost), translate_sentence(one.reason))
            for one in result.unworked_fields
        )
        parts += [Text(""), format_title("Not done"), FittedTable(columns, rows)]
    money = (TableColumn("For", is_text=True), TableColumn(result.currency))
    parts += [Text(""), format_title("Costs"), FittedTable(money, tuple(list_money_rows(result)))]
    parts += [format_sentence(text, style="dim") for text in result.remarks]
    return Group(*parts)


def describe_day_columns(result: DayResult) -> str:
    """What the columns of the tables hold."""
    text = (
        "Times are hh:mm, +1 is the next day, and medians of the samples, late starts included. 95 % by: the end in "
        "95 % of the samples. Plan's time: without delays. In time %: done before the rain and within the hours of the "
        "field. Lost: mean loss on ground that is not done by then."
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
        jobs, name = [job for job in result.jobs if job.machine == fleet.name], f"{fleet.name} ({fleet.words})"
        if not jobs:
            rows.append((name, translate("stays"), NO_VALUE, NO_VALUE, NO_VALUE, NO_VALUE))
        for job in jobs:
            what = f"{job.field}: {job.strategy}"
            start, end = format_time_of_day(job.stated_start_s), format_end_of_day(job.p50_end_s)
            km, share = format_number(job.km, 1), format_percent(job.finish_probability)
            rows.append((name if job is jobs[0] else "", what, start, end, km, share))
        if jobs and fleet.home_s is not None:
            back_km = format_number(fleet.km - sum(job.km for job in jobs), 1)
            start, end = format_end_of_day(jobs[-1].p50_end_s), format_end_of_day(fleet.stated_home_s)
            rows.append(("", translate("back"), start, end, back_km, NO_VALUE))
    return rows


def build_machine_table(result: DayResult) -> FittedTable:
    """The rows of `list_machine_rows`."""
    columns = (
        TableColumn("Machine", is_text=True), TableColumn("Field", is_text=True),
        TableColumn("From"), TableColumn("To"),
        TableColumn("Road km", "Road\nkm", drop_order=2), TableColumn("In time %", "In\ntime %", drop_order=1),
    )  # fmt: skip
    return FittedTable(columns, tuple(list_machine_rows(result)))


_JOB_FIGURES: Mapping[str, tuple[TableColumn, Callable[[DayJob], str]]] = {
    "field": (TableColumn("Field", is_text=True), lambda job: job.field),
    "area": (TableColumn("ha", drop_order=4), lambda job: format_number(job.area_ha, 2)),
    "machine": (TableColumn("Machine", is_text=True), lambda job: job.machine),
    "tractors": (TableColumn("Tractors", "Trac-\ntors", drop_order=5), lambda job: str(job.tractors)),
    "begin": (TableColumn("Begins"), lambda job: format_time_of_day(job.stated_start_s)),
    "end": (TableColumn("Done"), lambda job: format_end_of_day(job.p50_end_s)),
    "late end": (TableColumn("95 % by", drop_order=2), lambda job: format_end_of_day(job.p95_end_s)),
    "time": (TableColumn("Plan's time", "Plan's\ntime", drop_order=6), lambda job: format_duration(job.time_s)),
    "share": (TableColumn("In time %", "In\ntime %", drop_order=1), lambda job: format_percent(job.finish_probability)),
    "cost": (TableColumn("Cost", drop_order=3), lambda job: format_price(job.cost)),
    "lost": (TableColumn("Lost", drop_order=4), lambda job: format_price(job.lost_cost)),
}
_SCREEN_KEYS = ("machine", "field", "begin", "end", "late end", "share", "cost")


def build_job_table(jobs: Sequence[DayJob]) -> FittedTable:
    """A row for every field that is done."""
    return build_table(jobs, list(_JOB_FIGURES.values()))


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
