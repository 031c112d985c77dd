"""The answer of a day in a few sentences: what is done by when, how sure that is, by which machine, what is left."""

from __future__ import annotations

from collections.abc import Sequence

from reports.common.language import translate, translate_count, translate_sentence
from reports.common.text_tables import MOST_NAMED
from reports.common.wording import LEAST_COST, NO_VALUE, SURE_SHARE, format_percent, format_price, round_up_to_minute
from reports.day.schedule_results import DayJob, DayResult


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
