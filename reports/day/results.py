"""A day of several fields and fleets: result types, plain frozen data, and its answer in a few sentences.

Times are seconds of the day on which it begins: past midnight they are above 86,400. The answer says what is done by
when, how sure that is, by which machine, and what is left.
"""

from __future__ import annotations

from dataclasses import dataclass

from fields.arrays import Floats
from reports.common.language import translate, translate_count, translate_sentence
from reports.common.rendering import ShownResult
from reports.common.text_tables import MOST_NAMED, AnswerLines
from reports.common.wording import (
    NO_VALUE,
    SURE_SHARE,
    format_percent,
    format_price,
    format_risked_money,
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
    the medians of the samples, which reports state.
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
    lost_cost: float
    worked_pct: float | None
    refills: int | None
    p50_start_s: float
    p50_leaves_s: float


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

    `p50_home_s` is the median of the samples, which reports state.
    """

    name: str
    words: str
    leaves_s: float | None
    home_s: float | None
    km: float
    road_cost: float = 0.0
    p50_home_s: float | None = None


@dataclass(frozen=True, eq=False)
class MapPlace:
    """A place on the map, in metres: a field with its outline (n, 2), or the yard without one."""

    name: str
    x_m: float
    y_m: float
    outline: Floats | None = None


@dataclass(frozen=True, eq=False, repr=False)
class DayResult(ShownResult):
    """The answer to a day file.

    `cost` is the expected cost of the whole day: `cost` and `lost_cost` of all jobs, `road_cost` of all fleets and
    `cost` of the fields not done. `gap_pct` is by how much less another order could cost at most, by the times it is
    planned with: means, or those that `certainty_pct` of the samples keep. `windows` are the hours in which each field
    may be worked, in the order of `fields`; `breaks` are those of the drivers. All jobs are done by `p50_done_s` and
    `p95_done_s` in half and in 95 % of the samples, None without jobs. `questions` are about tractors that seem too
    weak for their implement, and plans that were cut short for lack of computing time; `shortfalls` sentences on plans
    that are no recommendation.
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


def list_day_sentences(result: DayResult) -> list[str]:
    """The answer, the most important first."""
    answer = build_day_answer(result)
    return [*answer.sentences, *answer.alternatives, *answer.faults]


def build_day_answer(result: DayResult) -> AnswerLines:
    """The answer, then which machine works which fields in which order, then what is not worked."""
    unworked = tuple(_describe_unworked_fields(result))
    if not result.jobs:
        return AnswerLines((translate("No field can be done on this day."),), faults=unworked)
    orders = [
        translate(
            "{machine} ({count}): {fields}",
            machine=machine,
            count=count,
            fields=translate(", then ").join(job.field for job in result.jobs if job.machine == machine),
        )
        for machine, count in {job.machine: job.tractors for job in result.jobs}.items()
    ]
    first = (*result.shortfalls, _describe_day_end(result), *result.questions, *_describe_day_certainty(result))
    return AnswerLines(first, (f"{'; '.join(orders)}.",), unworked)


def _describe_day_end(result: DayResult) -> str:
    """``All 3 fields are done by 15:22 (95 % by 15:50), 471 EUR.``: medians of the samples, means of the costs."""
    count, total = len(result.jobs), len(result.jobs) + len(result.unworked_fields)
    paid, risked = (f"{format_price(each)} {result.currency}" for each in (result.paid_cost, result.risked_cost))
    values = {
        "done": _format_end_in_words(result.p50_done_s),
        "late": _format_end_in_words(result.p95_done_s),
        "cost": format_risked_money(paid, risked, result.risked_cost),
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


def _describe_day_certainty(result: DayResult) -> list[str]:
    """How sure it is that all is done in time, and what is least sure."""
    if result.finish_probability is None:
        return []
    share = format_percent(result.finish_probability)
    weakest = min(result.jobs, key=lambda job: (round(job.finish_probability, 6), job.p50_end_s))
    least = format_percent(weakest.finish_probability)
    limit = translate("within the hours of each field")
    if result.rain:
        limit = translate("before the rain and within the hours of each field")
    if len(result.jobs) == 1 or weakest.finish_probability >= SURE_SHARE:
        return [translate("Done {limit}: {share} % sure.", limit=limit, share=share)]
    values = {"limit": limit, "share": share, "field": weakest.field, "least": least}
    return [translate("Done {limit}: {share} % sure, least {field} ({least} %).", **values)]


def _describe_unworked_fields(result: DayResult) -> list[str]:
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


def _format_end_in_words(seconds: float | None) -> str:
    """When something is done, as a sentence says it: ``00:39 next day``."""
    clock, _, days = format_end_of_day(seconds).partition("+")
    if not days:
        return clock
    return translate_count("{clock} next day", "{clock}, {count} days later", int(days), clock=clock)
