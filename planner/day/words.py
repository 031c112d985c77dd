"""A day in words: the advice, and why a field is not done."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from planner.day.insertion import Routes, places
from planner.day.problem import Problem
from planner.price.advice import hours, percent
from planner.scenario import DAY_S, clock
from reports.day_results import DayJob, NotDone

MOST_TOLD = 3  # fields that are left and have their reason in the advice


@dataclass(frozen=True)
class Why:
    """Why a field is left: the sentence, and how far it is from being done (kind, then seconds or money)."""

    reason: str
    near: tuple[int, float]


def time_of_day(seconds: float) -> str:
    """hh:mm, with a word where that is on another day."""
    rounded = 60 * round(seconds / 60.0)
    days = rounded // DAY_S
    return clock(rounded) + ("" if days == 0 else " of the next day" if days == 1 else f" {days} days later")


def why_left(problem: Problem, routes: Routes, field: int, refusals: Sequence[str], names: Sequence[str]) -> Why:
    """Why a field is not done. `refusals` are those of the fleets that have no plan for it, `names` all fleets'."""
    able = [fleet for fleet in range(problem.fleets) if problem.work_s[fleet][field] is not None]
    if not able:
        return Why(f"no fleet has a plan that can be driven there: {_first(refusals)}", (3, 0.0))
    if not problem.windows[field]:
        return Why("none of the hours in which it may be worked lies within the day and its light", (2, 0.0))
    options = places(problem, routes, field)
    if options:
        return Why(f"doing it costs {options[0].added:.2f} more than leaving it", (0, options[0].added))
    late, fleet = min((_late_s(problem, fleet, field), fleet) for fleet in able)
    if late > 0:
        words = f"even {names[fleet]}, going there first, would be {hours(max(late, 60))} too late"
        return Why(words, (1, float(late)))
    return Why("no fleet has the time for it beside the others", (0, 0.0))


def _first(refusals: Sequence[str]) -> str:
    text = next((text for text in refusals if text), "every plan was refused")
    return text.rstrip(".")


def _late_s(problem: Problem, fleet: int, field: int) -> int:
    """By how much a fleet that works nothing else misses the best window and the end of the day; 0 for not at all."""
    work, depot = problem.work_s[fleet][field] or 0, problem.fields
    arrives = problem.begin_s + problem.move_s[fleet][depot][field]

    def late(window: tuple[int, int]) -> int:
        end = max(arrives, window[0]) + work
        return max(end - window[1], end + problem.move_s[fleet][field][depot] - problem.home_by_s, 0)

    return min(late(window) for window in problem.windows[field])


def advice_of(
    jobs: Sequence[DayJob], left: Sequence[NotDone], sure: float | None, cost: float, currency: str
) -> str:
    """The day in one or two sentences."""
    if not jobs:
        return "No field can be done on this day."
    whole = len(jobs) + len(left)
    count = f"All {whole} fields are" if not left and whole > 1 else f"{len(jobs)} of {whole} fields {_are(len(jobs))}"
    end = time_of_day(max(job.end_s for job in jobs))
    chance = "" if sure is None else f" ({percent(sure)} sure)"
    machines = dict.fromkeys(job.machine for job in jobs)
    shares = "; ".join(
        f"{machine}: {', then '.join(job.field for job in jobs if job.machine == machine)}" for machine in machines
    )
    sentences = [f"{count} done by {end}{chance}: {shares}.", f"Expected cost {cost:.2f} {currency}."]
    weakest = min(jobs, key=lambda job: (round(job.finish_probability, 6), job.end_s))
    if len(jobs) > 1 and sure is not None and weakest.finish_probability < 0.995:
        sentences.append(f"Least sure is {weakest.field}, {percent(weakest.finish_probability)}.")
    sentences += [f"{one.field} is left: {one.reason}." for one in left[:MOST_TOLD]]
    more = len(left) - MOST_TOLD
    sentences += [f"{more} more {_are(more)} left."] if more > 0 else []
    return " ".join(sentences)


def _are(count: int) -> str:
    return "is" if count == 1 else "are"
