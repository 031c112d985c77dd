"""What is left to chance on a farm: the settings of `planner.chance`, with its defaults and their sources."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from planner.chance.settings import (
    HIGHEST_CV,
    HIGHEST_TAIL_CV,
    LONGEST_H,
    LONGEST_S,
    MOST_PER_HOUR,
    MOST_SLIP_PCT,
    SOURCES,
)
from planner.chance.settings import (
    Chances as Laws,
)
from planner.farm.values import Section, number, other

Seconds = Annotated[float, Field(ge=0.0, le=LONGEST_S, strict=True, allow_inf_nan=False)]


def _law(key: str, high: float, words: str) -> Any:
    """A setting of `planner.chance`, from 0 up; 0 switches it off."""
    return number(getattr(Laws, key), 0.0, high, words, SOURCES[key])


class Chances(Section):
    """What is left to chance, each a law of its own; 0 switches it off (`planner.chance.settings` says what each does).

    Coefficients of variation are of lognormal laws. Stops and breakdowns come at random at a mean rate.
    """

    speed_cv: float = _law("speed_cv", HIGHEST_CV, "of the speed of one pass")
    job_cv: float = _law("job_cv", HIGHEST_CV, "of one factor on all driving of a job")
    slip_pct: float = _law("slip_pct", MOST_SLIP_PCT, "percent of wheel slip, at which speeds hold")
    slip_cv: float = _law("slip_cv", HIGHEST_CV, "of the slip")
    turn_cv: float = _law("turn_cv", HIGHEST_CV, "of the time of a turn to the next track")
    turn_more_cv: float = _law("turn_more_cv", HIGHEST_CV, "of the time of a turn over more tracks")
    stops_per_hour: float = _law("stops_per_hour", MOST_PER_HOUR, "stops per tractor and hour")
    stop_s: float = _law("stop_s", LONGEST_S, "s of a stop in the mean")
    stop_cv: float = _law("stop_cv", HIGHEST_TAIL_CV, "of the length of a stop")
    stop_durations_s: tuple[Seconds, ...] = other((), "s of stops that were measured", "none: the law above")
    breakdown_hours: float = _law("breakdown_hours", LONGEST_H, "hours between breakdowns, 0 for none")
    repair_s: float = _law("repair_s", LONGEST_S, "s of a repair in the mean")
    repair_cv: float = _law("repair_cv", HIGHEST_TAIL_CV, "of the length of a repair")
    start_delay_s: float = _law("start_delay_s", LONGEST_S, "s late at the start in the mean")
    start_delay_cv: float = _law("start_delay_cv", HIGHEST_TAIL_CV, "of the delay")
