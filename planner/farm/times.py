"""Times of a farm: handling, shifts, what chance does to them, and where the yard is."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import AfterValidator, model_validator

from planner.farm.values import Section, number, other
from planner.scenario import DAY_S, parse_clock

LONGEST_S = 7.0 * DAY_S
_LOGS = "17 logs of one attended forage harvester"


def _is_clock(text: str | None) -> str | None:
    if text is not None:
        parse_clock(text, "the time")
    return text


def _is_break(text: str) -> str:
    _break(text)
    return text


def _break(text: str) -> tuple[int, int]:
    """ "12:00-12:30" as seconds of the day, from and to; past midnight the end is above a day."""
    match = re.fullmatch(r"\s*(\S+)\s*-\s*(\S+)\s*", text)
    if not match:
        raise ValueError(f"{text!r} is no break; write for instance '12:00-12:30'")
    start, end = (parse_clock(part, "the break") for part in match.groups())
    return start, end if end > start else end + DAY_S


Clock = Annotated[str | None, AfterValidator(_is_clock)]
Break = Annotated[str, AfterValidator(_is_break)]


def _clock(words: str) -> Any:
    return other(None, words, "none", strict=True)


class Times(Section):
    """How long handling takes, and when people are there. Seconds; clocks are "hh:mm" in quotes.

    A shift that ends before it starts ends on the next day.
    """

    unfold_s: float = number(120.0, 0.0, LONGEST_S, "s to make ready on the field", "assumed: a folding implement")
    fold_s: float = number(120.0, 0.0, LONGEST_S, "s to make ready for the road", "assumed: a folding implement")
    refill_s: float = number(300.0, 0.0, LONGEST_S, "s to refill or unload once there", "assumed: one big bag or tank")
    shift_start: Clock = _clock("hh:mm in quotes")
    shift_end: Clock = _clock("hh:mm in quotes")
    breaks: tuple[Break, ...] = other((), "such as '12:00-12:30', in quotes", "none: robots need none")
    road_speed_kmh: float = number(25.0, 0.5, 80.0, "km/h on the road", "assumed: with an implement, villages included")
    road_factor: float = number(1.3, 1.0, 10.0, "road over straight line", "usual detour of rural roads, 1.2 to 1.4")

    @property
    def breaks_s(self) -> tuple[tuple[int, int], ...]:
        """Breaks as seconds of the day, from and to, in order; an end past midnight is above a day."""
        return tuple(sorted(_break(text) for text in self.breaks))

    @property
    def shift_s(self) -> tuple[int | None, int | None]:
        """Start and end of the shift as seconds of the day; an end past midnight is above a day."""
        start, end = (None if at is None else parse_clock(at, "the shift") for at in (self.shift_start, self.shift_end))
        return start, end + DAY_S if start is not None and end is not None and end <= start else end


class Chances(Section):
    """What is left to chance, each a law of its own; 0 switches it off.

    Coefficients of variation are of lognormal factors. Stops and breakdowns come by chance at a mean rate, each as
    long as a draw with the given mean and coefficient of variation.
    """

    speed_cv: float = number(0.15, 0.0, 2.0, "of the speed of one pass", f"0.15 to 0.18 within a job, {_LOGS}")
    job_cv: float = number(
        0.06, 0.0, 2.0, "of one factor on all driving of a job", f"{_LOGS}: off by 4.8 % in the mean, left out singly"
    )
    slip_pct: float = number(7.6, 0.0, 90.0, "percent of wheel slip, at which speeds hold", "log of a New Holland")
    slip_cv: float = number(0.28, 0.0, 2.0, "of the slip", "the same log: half of it between 6.2 and 9.0 %")
    turn_cv: float = number(0.21, 0.0, 2.0, "of the time of a turn to the next track", f"163 turns, {_LOGS}")
    turn_more_cv: float = number(0.13, 0.0, 2.0, "of that of a turn over more tracks", f"16 turns, {_LOGS}")
    stops_per_hour: float = number(
        1.0, 0.0, 1000.0, "stops per tractor and hour", f"assumed for a robot: a tenth of {_LOGS}"
    )
    stop_s: float = number(48.0, 0.0, LONGEST_S, "s of a stop in the mean", f"stops of 5 s and more, {_LOGS}")
    stop_cv: float = number(3.9, 0.0, 20.0, "of the length of a stop", f"median 12 s beside that mean, {_LOGS}")
    breakdown_hours: float = number(
        290.0, 0.0, 1e6, "hours between breakdowns, 0 for none",
        "Zetor tractors (Agronomy 12(6):1364): half of the worst model fail within 200 h",
    )  # fmt: skip
    repair_s: float = number(7200.0, 0.0, LONGEST_S, "s of a repair in the mean", "assumed: someone has to come")
    repair_cv: float = number(1.0, 0.0, 20.0, "of the length of a repair", "assumed: as an exponential law")
    start_delay_s: float = number(
        600.0, 0.0, LONGEST_S, "s late at the start in the mean", "assumed: a change of field in two campaigns"
    )
    start_delay_cv: float = number(1.0, 0.0, 20.0, "of the delay", "assumed: as an exponential law")


class Yard(Section):
    """Where the machines come from, in degrees."""

    lon: float | None = number(None, -180.0, 180.0, "degrees of longitude")
    lat: float | None = number(None, -90.0, 90.0, "degrees of latitude")

    @model_validator(mode="after")
    def _both(self) -> Yard:
        if (self.lon is None) != (self.lat is None):
            lacks, has = ("lon", "lat") if self.lon is None else ("lat", "lon")
            raise ValueError(f"{lacks} is missing beside {has}; give both in degrees, or neither")
        return self
