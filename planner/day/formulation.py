"""From day file, places and field times to the problem in numbers, and Monte Carlo samples of every fleet's day.

A field that takes longer delays everything that the fleet does afterwards. In a sample the rain is the same for all
fields; other random inputs are independent between fields. Every fleet starts with a random delay.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from datetime import date
from statistics import NormalDist

import numpy as np

from fields.arrays import Flags, Floats
from fields.geometry.field import Field
from fields.units import DAY_S, HOUR_S
from planner.day.field_times import FieldTime, FieldTimeTable, find_left_ha
from planner.day.input_file import SUN, DayField, DayFile, get_fleet_machines, get_start_s, place_hours_in_day
from planner.day.optimization.problem import DayProblem, RainOnsets
from planner.day.places import compute_sun_hours
from planner.errors import RequestError
from planner.farm.inventory import FarmFile
from planner.farm.machines import FarmImplement
from planner.farm.random_inputs import UncertaintySettings
from planner.farm.workday import Workday
from planner.risk.costs import CostTerms, compute_paid_per_sample, compute_travel_cost
from planner.risk.leg_graph import LegGraph
from planner.risk.monte_carlo import SampledOutcomes, compute_wilson_interval, sample_outcomes
from planner.risk.rain import RainForecast, parse_rain
from planner.risk.random_events import create_generator, draw_lognormal

PLANNING_SAMPLES = 1000  # for the mean time and cost of a field in planning
MAX_ONSETS = 24  # rain onsets used in planning; samples use all


@dataclass(frozen=True)
class DayHours:
    """Start and end of a day (seconds of the day), its clock, daylight, and onset of rain.

    Working seconds are the start plus the seconds of possible work since then; they do not advance in breaks.
    """

    start_s: int
    end_s: int
    clock: Workday
    daylight_s: tuple[int, int] | None
    onset: RainForecast | None

    def convert_to_working_s(self, time_of_day_s: float) -> float:
        """Working seconds at a time of the day; constant during a break."""
        return self.start_s + float(self.clock.compute_work_s(np.array(time_of_day_s - self.start_s)))

    def get_begin_clock_s(self, working_s: float) -> float:
        """Time of the day of a beginning: after a break rather than before it."""
        return self.start_s + self.clock.compute_clock_s(working_s - self.start_s, begins=True)

    def get_end_clock_s(self, working_s: float) -> float:
        """Time of the day of an end: before a break rather than after it."""
        return self.start_s + self.clock.compute_clock_s(working_s - self.start_s)

    def list_breaks(self) -> tuple[tuple[float, float], ...]:
        """Breaks until the end of the day as (from, to) in seconds of the day."""
        pauses = self.clock.list_pauses(self.end_s - self.start_s)
        return tuple((self.start_s + pause.from_s, self.start_s + pause.to_s) for pause in pauses)

    def find_work_windows(self, texts: Sequence[str]) -> tuple[tuple[int, int], ...]:
        """Windows of a field within the day and its daylight, in working seconds, sorted and disjoint."""
        requested = [place_hours_in_day(text, self.start_s) for text in texts] or [(self.start_s, self.end_s)]
        merged: list[tuple[int, int]] = []
        for opens, closes in sorted(requested):
            daylight_s = self.daylight_s or (opens, closes)
            begin, end = max(opens, daylight_s[0], self.start_s), min(closes, daylight_s[1], self.end_s)
            begin, end = math.ceil(self.convert_to_working_s(begin)), math.floor(self.convert_to_working_s(end))
            if merged and begin <= merged[-1][1]:
                merged[-1] = merged[-1][0], max(end, merged[-1][1])
            elif begin < end:
                merged.append((begin, end))
        return tuple(merged)


def build_day_hours(day: DayFile, farm: FarmFile, lon_lat: tuple[float, float] | None = None) -> DayHours:
    """The frame of a day; `lon_lat` is the place for sunrise and sunset. Raises RequestError."""
    start_s = get_start_s(day, farm)
    shift_end_s, end_s = farm.times.shift_span_s[1], start_s + DAY_S
    if shift_end_s is not None:
        end_s = shift_end_s % DAY_S + (DAY_S if shift_end_s % DAY_S <= start_s else 0)
    daylight_s = _find_daylight(day, start_s, lon_lat)
    onset = None if day.rain is None else parse_rain(day.rain, start_s)
    return DayHours(start_s, end_s, Workday(start_s, breaks_s=farm.times.break_spans_s), daylight_s, onset)


def _find_daylight(day: DayFile, start_s: int, lon_lat: tuple[float, float] | None) -> tuple[int, int] | None:
    """Daylight as (from, to), None for always."""
    if day.light is None:
        return None
    if day.light != SUN:
        return place_hours_in_day(day.light, start_s)
    if lon_lat is None:
        raise RequestError(
            f"light = {SUN!r} needs a place on the earth; give lon and lat of the yard or a field, or hours of light."
        )
    sun_times = compute_sun_hours(date.fromisoformat(day.date or ""), *lon_lat, day.utc_offset_h or 0.0)
    if sun_times is None:
        return None
    rise_s, set_s = sun_times
    set_s += DAY_S if set_s < rise_s else 0
    return (rise_s + DAY_S, set_s + DAY_S) if set_s <= start_s else (rise_s, set_s)


def get_field_uncertainty(farm: FarmFile, *, with_late_start: bool = False) -> UncertaintySettings:
    """The random inputs of a field; fleets start late once a day, not on every field."""
    settings = farm.uncertainty
    return settings if with_late_start else settings.disable_input("late start")


def derive_job_seed(seed: int, field: str, fleet: str) -> int:
    """The seed of one fleet on one field, for independent samples."""
    return int(create_generator(seed, "job of the day", field, fleet).integers(2**62))


def estimate_mean_time_and_cost(
    field_time: FieldTime,
    terms: CostTerms,
    uncertainty: UncertaintySettings,
    seed: int,
    certainty_pct: float | None = None,
) -> tuple[int, float] | None:
    """Mean seconds and cost of a field over samples; None without a plan.

    With `certainty_pct`, the seconds are this percentile of the samples.
    """
    if field_time.graph is None:
        return None
    sample: SampledOutcomes = sample_outcomes(field_time.graph, uncertainty, samples=PLANNING_SAMPLES, seed=seed)
    finish_s = sample.finish_s
    seconds = finish_s.mean() if certainty_pct is None else np.quantile(finish_s, 0.01 * certainty_pct)
    return math.ceil(seconds), float(compute_paid_per_sample(sample, terms).mean())


def build_fleet_prices(day: DayFile, farm: FarmFile, fleet: int) -> CostTerms:
    """Prices of a fleet's field work; roads and transport by lorry are counted separately."""
    on_field = farm.prices.model_copy(update={"transport_per_tractor": 0.0})
    tractor, implement = get_fleet_machines(day.fleets[fleet], farm)
    return CostTerms(on_field, tractor, implement, motor_efficiency=tractor.find_motor_efficiency())


def get_loss_per_ha(field: DayField, farm: FarmFile) -> float:
    """The loss per hectare that is not done."""
    if field.value_per_ha is not None:
        return field.value_per_ha
    if field.loss_per_ha is not None:
        return field.loss_per_ha
    return farm.prices.late_ground_per_ha


def build_problem(
    day: DayFile,
    farm: FarmFile,
    fields: Sequence[Field],
    road_km: Floats,
    table: FieldTimeTable,
    frame: DayHours,
    seed: int,
) -> DayProblem:
    """The optimisation problem of a day. `road_km` (n + 1, n + 1) has the yard last, zeros without a yard."""
    uncertainty = get_field_uncertainty(farm)

    def estimate_job(fleet: int, field: Field, field_time: FieldTime | None) -> tuple[int, float] | None:
        if field_time is None:
            return None
        job_seed = derive_job_seed(seed, field.name, day.fleets[fleet].name)
        return estimate_mean_time_and_cost(
            field_time, build_fleet_prices(day, farm, fleet), uncertainty, job_seed, day.certainty_pct
        )

    estimates = [
        [estimate_job(fleet, field, field_time) for field, field_time in zip(fields, row, strict=True)]
        for fleet, row in enumerate(table)
    ]
    values_at_risk = [
        get_loss_per_ha(day_field, farm) * find_left_ha(field, (row[number] for row in table))
        for number, (day_field, field) in enumerate(zip(day.fields, fields, strict=True))
    ]
    start_delay_s = 0.0
    if day.certainty_pct is not None:
        settings = get_field_uncertainty(farm, with_late_start=True)
        normal = np.array(NormalDist().inv_cdf(0.01 * day.certainty_pct))
        start_delay_s = float(draw_lognormal(settings.start_delay_s, settings.start_delay_cv, normal))
    # Work with a value of this day only costs nothing if it is skipped; other work is done on another day.
    skip_cost = []
    for number, (day_field, value) in enumerate(zip(day.fields, values_at_risk, strict=True)):
        costs = [row_estimate[1] for row in estimates if (row_estimate := row[number]) is not None]
        skip_cost.append(value + (0.0 if day_field.value_per_ha is not None else min(costs, default=0.0)))
    travel = [_compute_travel(day, farm, fleet, road_km) for fleet in range(len(day.fleets))]
    return DayProblem(
        work_s=tuple(tuple(None if estimate is None else estimate[0] for estimate in row) for row in estimates),
        work_cost=tuple(tuple(0.0 if estimate is None else estimate[1] for estimate in row) for row in estimates),
        skip_cost=tuple(skip_cost),
        value_at_risk=tuple(values_at_risk),
        windows=tuple(frame.find_work_windows(day_field.windows) for day_field in day.fields),
        travel_s=tuple(seconds for seconds, _ in travel),
        travel_cost=tuple(costs for _, costs in travel),
        begin_s=frame.start_s + math.ceil(start_delay_s),
        home_by_s=math.floor(frame.convert_to_working_s(frame.end_s)),
        rain=RainOnsets(tuple(_iterate_onsets(frame))),
    )


def _compute_travel(
    day: DayFile, farm: FarmFile, fleet: int, road_km: Floats
) -> tuple[tuple[tuple[int, ...], ...], tuple[tuple[float, ...], ...]]:
    """Seconds and costs of a fleet from place to place with handling; transport is paid on the way to a field."""
    count, yard = day.fleets[fleet].count, len(road_km) - 1
    machines, prices = get_fleet_machines(day.fleets[fleet], farm), farm.prices
    terms = CostTerms(prices, *machines, motor_efficiency=machines[0].find_motor_efficiency())

    def estimate_trip(start: int, end: int) -> tuple[int, float]:
        if start == end:
            return 0, 0.0
        drive_s = road_km[start, end] / farm.times.road_speed_kmh * HOUR_S
        handling_s = _estimate_handling_s(start, end, yard, farm, machines[1])
        trip = replace(terms, road_km=float(road_km[start, end]), road_s=drive_s, handling_s=handling_s)
        transport = prices.transport_per_tractor if end == yard else 0.0
        return math.ceil(drive_s + handling_s), count * (compute_travel_cost(trip) - transport)

    trips = [[estimate_trip(start, end) for end in range(len(road_km))] for start in range(len(road_km))]
    seconds = tuple(tuple(trip_s for trip_s, _ in row) for row in trips)
    return seconds, tuple(tuple(cost for _, cost in row) for row in trips)


def _estimate_handling_s(start: int, end: int, yard: int, farm: FarmFile, implement: FarmImplement) -> float:
    """Folding, unfolding and, between two fields, refilling or unloading.

    At the yard there is no handling: fleets leave it with tanks full, or empty to collect.
    """
    times = farm.times.drop_folding(implement.simulated_implement.folds)
    fold_s = 0.0 if start == yard else times.fold_s
    unfold_s = 0.0 if end == yard else times.unfold_s
    has_load = implement.capacity is not None and yard not in (start, end)
    return fold_s + unfold_s + (farm.times.refill_s if has_load else 0.0)


def _iterate_onsets(frame: DayHours) -> Iterable[tuple[int, float]]:
    """Rain onsets in working seconds with their probabilities, at most MAX_ONSETS."""
    onset = frame.onset
    if onset is None:
        return
    if onset.rate_per_s > 0.0:
        share = 1.0 / MAX_ONSETS
        times = [(-math.log1p(-(number + 0.5) * share) / onset.rate_per_s, share) for number in range(MAX_ONSETS)]
    else:
        times = _limit_rain_onsets(sorted(zip(onset.onsets_s, onset.probabilities, strict=True)))
    for seconds, share in times:
        yield math.floor(frame.convert_to_working_s(frame.start_s + seconds)), share


def _limit_rain_onsets(times: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Onsets with probabilities, reduced to MAX_ONSETS quantiles of equal probability."""
    if len(times) <= MAX_ONSETS:
        return times
    total_share = sum(share for _, share in times)
    cumulative_shares = np.cumsum([share for _, share in times])
    middles = (np.arange(MAX_ONSETS) + 0.5) * total_share / MAX_ONSETS
    positions = np.minimum(np.searchsorted(cumulative_shares, middles), len(times) - 1).tolist()
    return [(times[position][0], total_share / MAX_ONSETS) for position in positions]


@dataclass(frozen=True, eq=False)
class PlannedRouteField:
    """A field on a fleet's route: `move_s` from the place before, worked between `opens_s` and `closes_s`.

    Times are working seconds; `value_at_risk` is lost if nothing is done in time, `seed` is for its samples.
    """

    graph: LegGraph
    move_s: float
    opens_s: float
    closes_s: float
    terms: CostTerms
    value_at_risk: float
    seed: int


@dataclass(frozen=True, eq=False)
class FleetDaySamples:
    """Samples for the fields of one fleet: begin, end of field work (`done_s`) and end with the way out in working
    seconds, and whether done in time, all (fields, samples); mean cost of the work and mean loss on ground not done in
    time, both (fields,).
    """

    start_s: Floats
    done_s: Floats
    end_s: Floats
    in_time: Flags
    work_cost: Floats
    lost_cost: Floats

    def estimate_in_time_probability(self, position: int) -> tuple[float, tuple[float, float]]:
        """Probability that a field is done in time, with its interval."""
        hits, samples = int(self.in_time[position].sum()), self.in_time.shape[1]
        return hits / samples, compute_wilson_interval(hits, samples)


def sample_fleet_day(
    stops: Sequence[PlannedRouteField],
    uncertainty: UncertaintySettings,
    begin_s: float,
    rain_s: Floats,
    *,
    seed: int,
    fleet: str,
) -> FleetDaySamples:
    """The day of one fleet in all samples. `rain_s` (samples,) is the onset of rain in working seconds."""
    samples = len(rain_s)
    normal = create_generator(seed, "late fleet", fleet).standard_normal(samples)
    now_s = begin_s + draw_lognormal(uncertainty.start_delay_s, uncertainty.start_delay_cv, normal)
    on_field = uncertainty.disable_input("late start")
    start_of_work_s, done_s, end_s, in_time, work_cost, lost_cost = [], [], [], [], [], []
    for stop in stops:
        start_s = np.maximum(now_s + stop.move_s, stop.opens_s)
        limit_s = np.minimum(rain_s, stop.closes_s)
        sample = sample_outcomes(stop.graph, on_field, samples=samples, seed=stop.seed, limit_s=limit_s - start_s)
        now_s = start_s + sample.finish_s
        start_of_work_s.append(start_s)
        done_s.append(start_s + sample.work_finish_s)
        end_s.append(now_s)
        in_time.append(done_s[-1] <= limit_s)
        work_cost.append(float(compute_paid_per_sample(sample, stop.terms).mean()))
        lost_cost.append(float((1.0 - sample.worked_share).mean()) * stop.value_at_risk)
    shape = (len(stops), samples)
    return FleetDaySamples(
        np.reshape(start_of_work_s, shape),
        np.reshape(done_s, shape),
        np.reshape(end_s, shape),
        np.reshape(in_time, shape).astype(np.bool_),
        np.asarray(work_cost),
        np.asarray(lost_cost),
    )


def convert_rain_onsets(onset_s: Floats, start_s: float, clock: Workday) -> Floats:
    """Rain onsets (seconds after the start) as working seconds of the day."""
    return start_s + clock.compute_work_s(onset_s)
