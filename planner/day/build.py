"""From file, places and field times to the day as numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import date
from statistics import NormalDist

import numpy as np
import numpy.typing as npt

from fields.field import Field
from planner.chance.draws import Sample, draw
from planner.chance.events import lognormal
from planner.chance.rain import Rain as Onset
from planner.chance.rain import parse_rain
from planner.chance.settings import Chances, like
from planner.chance.streams import stream
from planner.day.file import SUN, DayField, DayFile, machines_of, placed, start_of
from planner.day.light import sun_hours
from planner.day.problem import Problem, Rain
from planner.day.times import FieldTime, Table
from planner.errors import ScenarioError
from planner.farm.file import FarmFile
from planner.farm.machines import FarmImplement
from planner.price.cost import HOUR_S, Terms, coming_and_going, paid_per_draw
from planner.scenario import DAY_S
from planner.workday import Workday

FEW_DRAWS = 1000  # behind the mean time and price of a field, by which the day is planned
MOST_ONSETS = 24  # times of rain by which it is planned; draws use all
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Frame:
    """When a day begins and ends (seconds of the day), its clock, when it is light, and when it begins to rain.

    Working seconds are the start and the seconds of work that can be done since; they stand still in breaks.
    """

    start_s: int
    end_s: int
    clock: Workday
    light: tuple[int, int] | None
    onset: Onset | None

    def working(self, at_s: float) -> float:
        """Working seconds until a time of the day; the same for all of a break."""
        return self.start_s + float(self.clock.work_s(np.array(at_s - self.start_s)))

    def begin(self, working_s: float) -> float:
        """When on the day something begins: after a break rather than before it."""
        return self.start_s + self.clock.clock_s(working_s - self.start_s, begins=True)

    def end(self, working_s: float) -> float:
        """When on the day something ends: before a break rather than after it."""
        return self.start_s + self.clock.clock_s(working_s - self.start_s)

    def breaks(self) -> tuple[tuple[float, float], ...]:
        """Breaks until the end of the day, (from, to) in seconds of the day."""
        pauses = self.clock.pauses(self.end_s - self.start_s)
        return tuple((self.start_s + one.from_s, self.start_s + one.to_s) for one in pauses)

    def windows(self, texts: Sequence[str]) -> tuple[tuple[int, int], ...]:
        """Windows of a field within the day and its light, in working seconds, apart and in order."""
        asked = [placed(text, self.start_s) for text in texts] or [(self.start_s, self.end_s)]
        found: list[tuple[int, int]] = []
        for opens, closes in sorted(asked):
            lit = self.light or (opens, closes)
            begin, end = max(opens, lit[0], self.start_s), min(closes, lit[1], self.end_s)
            begin, end = math.ceil(self.working(begin)), math.floor(self.working(end))
            if found and begin <= found[-1][1]:
                found[-1] = found[-1][0], max(end, found[-1][1])
            elif begin < end:
                found.append((begin, end))
        return tuple(found)


def frame_of(day: DayFile, farm: FarmFile, at: tuple[float, float] | None = None) -> Frame:
    """The frame of a day; `at` (longitude, latitude) is where the sun is looked for. Raises ScenarioError."""
    start = start_of(day, farm)
    ends = farm.times.shift_s[1]
    end = start + DAY_S if ends is None else ends % DAY_S + (DAY_S if ends % DAY_S <= start else 0)
    light = _light(day, start, at)
    onset = None if day.rain is None else parse_rain(day.rain, start)
    return Frame(start, end, Workday(start, breaks_s=farm.times.breaks_s), light, onset)


def _light(day: DayFile, start_s: int, at: tuple[float, float] | None) -> tuple[int, int] | None:
    """When it is light, None for always."""
    if day.light is None:
        return None
    if day.light != SUN:
        return placed(day.light, start_s)
    if at is None:
        raise ScenarioError(
            f"light = {SUN!r} needs a place on the earth; give lon and lat of the yard or a field, or light in hours."
        )
    found = sun_hours(date.fromisoformat(day.date or ""), *at, day.utc_offset_h or 0.0)
    if found is None:
        return None
    rise, sets = found
    sets += DAY_S if sets < rise else 0
    return (rise + DAY_S, sets + DAY_S) if sets <= start_s else (rise, sets)


def chances_of(farm: FarmFile, *, late: bool = False) -> Chances:
    """What varies on a field; fleets are `late` once a day, not on every field."""
    chances = like(farm.chances)
    return chances if late else chances.without("late start")


def job_seed(seed: int, field: str, fleet: str) -> int:
    """The seed of one fleet on one field: what varies there is its own."""
    return int(stream(seed, "job of the day", field, fleet).integers(2**62))


def means(
    found: FieldTime, terms: Terms, chances: Chances, seed: int, certainty_pct: float | None = None
) -> tuple[int, float] | None:
    """Seconds and price of a field in the mean of draws; None where no plan can be driven.

    With `certainty_pct` the seconds are those that so many of the draws keep.
    """
    if found.graph is None:
        return None
    sample: Sample = draw(found.graph, chances, draws=FEW_DRAWS, seed=seed)
    seconds = float(_expected(sample.finish_s, certainty_pct))
    return math.ceil(seconds), float(paid_per_draw(sample, terms).mean())


def _expected(seconds: Array, certainty_pct: float | None) -> float:
    """The mean of draws, or what so many percent of them keep."""
    return float(seconds.mean() if certainty_pct is None else np.quantile(seconds, 0.01 * certainty_pct))


def _late_s(day: DayFile, farm: FarmFile) -> float:
    """By how much the day is planned to begin late: not at all, or so that the late starts of draws keep it."""
    if day.certainty_pct is None:
        return 0.0
    late = chances_of(farm, late=True)
    normal = NormalDist().inv_cdf(0.01 * day.certainty_pct)
    return float(lognormal(late.start_delay_s, late.start_delay_cv, np.array(normal)))


def terms_of(day: DayFile, farm: FarmFile, fleet: int) -> Terms:
    """At what prices a fleet works; its ways are counted for themselves, bringing it by lorry with them."""
    on_field = farm.prices.model_copy(update={"transport_per_tractor": 0.0})
    return Terms(on_field, *machines_of(day.fleets[fleet], farm))


def per_ha(field: DayField, farm: FarmFile) -> float:
    """What a hectare loses that is not done."""
    if field.value_per_ha is not None:
        return field.value_per_ha
    if field.loss_per_ha is not None:
        return field.loss_per_ha
    return farm.prices.late_per_ha + farm.prices.seed_per_ha


def problem_of(
    day: DayFile, farm: FarmFile, fields: Sequence[Field], km: Array, table: Table, frame: Frame, seed: int
) -> Problem:
    """The day as numbers. `km` (n + 1, n + 1) has the yard last; without one its ways are 0."""
    chances = chances_of(farm)
    mean = [
        [None if found is None else
         means(found, terms_of(day, farm, k), chances, job_seed(seed, field.name, day.fleets[k].name),
               day.certainty_pct)
         for field, found in zip(fields, row, strict=True)]
        for k, row in enumerate(table)
    ]  # fmt: skip
    stake = [per_ha(said, farm) * field.area_ha for said, field in zip(day.fields, fields, strict=True)]
    return Problem(
        work_s=tuple(tuple(None if one is None else one[0] for one in row) for row in mean),
        paid=tuple(tuple(0.0 if one is None else one[1] for one in row) for row in mean),
        put_off=tuple(
            stake[f] + _later(said, [row[f] for row in mean]) for f, said in enumerate(day.fields)
        ),
        stake=tuple(stake),
        windows=tuple(frame.windows(said.windows) for said in day.fields),
        move_s=tuple(_moves(day, farm, k, km) for k in range(len(day.fleets))),
        move_cost=tuple(_move_costs(day, farm, k, km) for k in range(len(day.fleets))),
        begin_s=frame.start_s + math.ceil(_late_s(day, farm)),
        home_by_s=math.floor(frame.working(frame.end_s)),
        rain=Rain(tuple(_onsets(frame))),
    )  # fmt: skip


def _later(said: DayField, mean: Iterable[tuple[int, float] | None]) -> float:
    """What the same work costs on another day; what only brings a value is not done then."""
    prices = [one[1] for one in mean if one is not None]
    return 0.0 if said.value_per_ha is not None or not prices else min(prices)


def _moves(day: DayFile, farm: FarmFile, fleet: int, km: Array) -> tuple[tuple[int, ...], ...]:
    """Seconds of a fleet from place to place; home ends with the road, and begins with it."""
    places, implement = range(len(km)), machines_of(day.fleets[fleet], farm)[1]
    return tuple(
        tuple(
            0 if a == b else math.ceil(_drive_s(km[a, b], farm) + _handling_s(a, b, len(km) - 1, farm, implement))
            for b in places
        )
        for a in places
    )


def _handling_s(a: int, b: int, yard: int, farm: FarmFile, implement: FarmImplement) -> float:
    """Folding and unfolding on a way, and between two fields tanks made good; nobody does any of it at the yard.

    Fleets leave the yard with tanks as a field asks for them, full or empty, and come back with what is left.
    """
    between = implement.capacity is not None and yard not in (a, b)
    times = farm.times
    return (0.0 if a == yard else times.fold_s) + (0.0 if b == yard else times.unfold_s) + between * times.refill_s


def _drive_s(km: float, farm: FarmFile) -> float:
    return km / farm.times.road_speed_kmh * HOUR_S


def _move_costs(day: DayFile, farm: FarmFile, fleet: int, km: Array) -> tuple[tuple[float, ...], ...]:
    """What the ways of a fleet cost, by the prices of a plan; bringing a tractor is paid on the way to a field."""
    count, home, places = day.fleets[fleet].count, len(km) - 1, range(len(km))
    machines, prices = machines_of(day.fleets[fleet], farm), farm.prices

    def way(a: int, b: int) -> float:
        drive_s, handling_s = _drive_s(km[a, b], farm), _handling_s(a, b, home, farm, machines[1])
        found = coming_and_going(Terms(prices, *machines, float(km[a, b]), drive_s, handling_s))
        return found - (prices.transport_per_tractor if b == home else 0.0)

    return tuple(tuple(0.0 if a == b else count * way(a, b) for b in places) for a in places)


def _onsets(frame: Frame) -> Iterable[tuple[int, float]]:
    """Times of rain in working seconds with their shares, at most `MOST_ONSETS`."""
    onset = frame.onset
    if onset is None:
        return
    if onset.per_s > 0.0:
        share = 1.0 / MOST_ONSETS
        times = [(-math.log1p(-(number + 0.5) * share) / onset.per_s, share) for number in range(MOST_ONSETS)]
    else:
        times = _thinned(sorted(zip(onset.onset_s, onset.shares, strict=True)))
    for seconds, share in times:
        yield math.floor(frame.working(frame.start_s + seconds)), share


def _thinned(times: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Times with shares, many of them by quantiles in the middle of equal shares of all."""
    if len(times) <= MOST_ONSETS:
        return times
    whole = sum(share for _, share in times)
    upto = np.cumsum([share for _, share in times])
    middles = (np.arange(MOST_ONSETS) + 0.5) * whole / MOST_ONSETS
    found = np.minimum(np.searchsorted(upto, middles), len(times) - 1).tolist()
    return [(times[place][0], whole / MOST_ONSETS) for place in found]



