"""The clock of a plan in sentences: road, breaks and shifts, and what day a time is taken to be of."""

from __future__ import annotations

import re

from planner.scenario import Scenario, clock
from planner.workday import BREAK, FOLD, NIGHT, ROAD, UNFOLD, Workday
from reports.results import PlanResult

MINUTE_S = 60.0


def day_words(day: Workday | None, scenario: Scenario, plan: PlanResult | None) -> tuple[str, ...]:
    """What is to be said of the clock of a plan, a sentence each; nothing without a farm and with all times today."""
    told = next_day_words(scenario)
    if day is None or plan is None or plan.home_s is None:
        return told
    if day.start_s is None:
        return (*told, f"{_duties(day)}: {_minutes(day.before_s + day.after_s)} in all beside the field work.")
    ready, done, home = (scenario.told(at) for at in (plan.ready_s, plan.done_s, plan.home_s))
    end = "home" if day.road_m else "folded"
    words = f"{_duties(day)}: out at {clock(day.start_s)}, field work from {ready} to {done}, {end} at {home}."
    return (*told, words, *_pause_words(day, scenario, plan.home_s))


def next_day_words(scenario: Scenario) -> tuple[str, ...]:
    """That a deadline or rain at a time of day before the start is one of the next day."""
    start = scenario.start_s
    if start is None:
        return ()
    told = []
    if scenario.before_s is not None and scenario.before_s < start:
        told.append(_taken("The deadline", clock(scenario.before_s), start))
    clocks = re.findall(r"\b(\d{1,2}):(\d{2})\b", scenario.rain or "")
    early = [one for one in (3600 * int(hours) + 60 * int(minutes) for hours, minutes in clocks) if one <= start]
    told += [_taken("Rain", clock(one), start) for one in early]
    return tuple(told)


def _taken(what: str, at: str, start_s: int) -> str:
    return f"{what} at {at} is taken for {at} next day, as the start is at {clock(start_s)}."


def _duties(day: Workday) -> str:
    road_s = 0.5 * day.of(ROAD)
    road = f"{day.road_m / 1000.0:.1f} km of road each way take {_minutes(road_s)}, " if day.road_m else ""
    words = f"{road}unfolding {_minutes(day.of(UNFOLD))} and folding {_minutes(day.of(FOLD))}"
    return words[0].upper() + words[1:]


def _pause_words(day: Workday, scenario: Scenario, home_s: float) -> tuple[str, ...]:
    """Breaks, waiting for the first shift, and the ends of shifts that the work goes on after."""
    pauses = day.pauses(home_s)
    told = []
    breaks = [pause for pause in pauses if pause.kind == BREAK]
    if breaks:
        total = _minutes(sum(pause.to_s - pause.from_s for pause in breaks))
        told.append(f"That is with {'a break' if len(breaks) == 1 else f'{len(breaks)} breaks'} of {total}.")
    for pause in (one for one in pauses if one.kind == NIGHT):
        begin, end = scenario.told(pause.from_s), scenario.told(pause.to_s)
        told.append(
            f"The shift begins at {end}." if pause.from_s <= 0.0
            else f"The shift ends at {begin} before all is done; it goes on at {end}."
        )
    return tuple(told)


def _minutes(seconds: float) -> str:
    minutes = round(seconds / MINUTE_S)
    if 0.0 < seconds < 0.5 * MINUTE_S:
        return f"{seconds:.0f} s"
    return f"{minutes // 60} h {minutes % 60} min" if minutes >= 60 else f"{minutes} min"
