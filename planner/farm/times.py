"""Times of a farm: handling, shifts and breaks; and where the yard is."""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import AfterValidator, model_validator

from planner.farm.values import Section, number, other
from planner.scenario import DAY_S, parse_clock

LONGEST_S = 7.0 * DAY_S
LONGEST_BREAK_S = DAY_S // 2


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
    lasts = (end - start) % DAY_S or DAY_S
    if lasts > LONGEST_BREAK_S:
        raise ValueError(f"the break {text!r} lasts {lasts / 3600.0:.3g} h; use 12 h or less, the earlier time first")
    return start, start + lasts


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

    @model_validator(mode="after")
    def _leaves_work(self) -> Times:
        start, end = self.shift_s
        begin = start or 0
        until = begin + DAY_S if end is None else end + DAY_S * (end <= begin)
        again = sorted((a + day, b + day) for a, b in self.breaks_s for day in (-DAY_S, 0, DAY_S))
        free_from = begin
        for first, last in again:
            if first > free_from:
                break
            free_from = max(free_from, last)
        if free_from >= until:
            raise ValueError("the breaks leave nothing of the shift; shorten them")
        return self

    @property
    def breaks_s(self) -> tuple[tuple[int, int], ...]:
        """Breaks as seconds of the day, from and to, in order; an end past midnight is above a day."""
        return tuple(sorted(_break(text) for text in self.breaks))

    @property
    def shift_s(self) -> tuple[int | None, int | None]:
        """Start and end of the shift as seconds of the day; an end past midnight is above a day."""
        start, end = (None if at is None else parse_clock(at, "the shift") for at in (self.shift_start, self.shift_end))
        return start, end + DAY_S if start is not None and end is not None and end <= start else end


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
