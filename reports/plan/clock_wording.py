"""Clock times of a ranking in words: when work is done, and by when it must be."""

from __future__ import annotations

import math
from datetime import timedelta

from reports.common.language import translate_count
from reports.common.plan_results import PlanRanking
from reports.common.wording import format_duration, parse_start_time, round_seconds, round_up_to_minute


def format_clock_after_start(ranking: PlanRanking, seconds: float | None) -> str | None:
    """The clock time ``09:14``, ``01:14 next day`` or ``01:14, 2 days later`` after the start; None without a start."""
    start = parse_start_time(ranking.start)
    if start is None or seconds is None or not math.isfinite(seconds):
        return None
    later = start + timedelta(seconds=round_seconds(seconds))
    days = (later.date() - start.date()).days
    clock = later.strftime("%H:%M")
    return translate_count("{clock} next day", "{clock}, {count} days later", days, clock=clock) if days else clock


def format_end_clock(ranking: PlanRanking, seconds: float) -> str | None:
    """The clock time by which work is done, up to the minute; None without a start."""
    return format_clock_after_start(ranking, round_up_to_minute(seconds))


def format_deadline(ranking: PlanRanking) -> str:
    """When work must be done: the clock time, else the deadline as given or the time there is."""
    return (
        format_clock_after_start(ranking, ranking.allowed_s) or ranking.deadline or format_duration(ranking.allowed_s)
    )
