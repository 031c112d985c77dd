"""What a plan costs in every draw: machines, fuel, people, transport, and ground that is late."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.chance.draws import Sample
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.prices import Prices
from planner.price.machine import Rates, rates
from vehicle.run import Run

HOUR_S = 3600.0
IDLE_LOAD = 0.1  # share of full power of an engine that idles: tractors that wait or stop
Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Cost:
    """Money for a plan in the mean of the draws: `paid`, and `expected` with ground that is late; standard errors.

    Work goes on to the end whatever the weather; the price of late ground is what the rain takes.
    """

    paid: float
    paid_error: float
    expected: float
    expected_error: float


@dataclass(frozen=True)
class Terms:
    """At what prices a fleet works: those of the farm and of its machines.

    Each tractor comes and goes `road_km` in all, in `road_s`, and is made ready for work and for the road in
    `handling_s`. It drives itself, unless the farm has a price for bringing it. `learned` is what the farm's own logs
    taught of what it plans with, in words.
    """

    prices: Prices
    tractor: FarmTractor | None = None
    implement: FarmImplement | None = None
    road_km: float = 0.0
    road_s: float = 0.0
    handling_s: float = 0.0
    learned: tuple[str, ...] = ()


def hired(per_hour: float, per_tractor: float) -> Terms:
    """So much per tractor and hour, all in, and so much for bringing each; late ground as on any farm."""
    return Terms(Prices(per_hour=per_hour, supervision_share=0.0, transport_per_tractor=per_tractor))


def cost(sample: Sample, terms: Terms, area_ha: float) -> Cost:
    """The cost of a plan for `area_ha` of work."""
    paid, prices = paid_per_draw(sample, terms), terms.prices
    late = (1.0 - sample.done) * area_ha * (prices.late_per_ha + prices.seed_per_ha)
    return Cost(float(paid.mean()), _error(paid), float((paid + late).mean()), _error(paid + late))


def paid_per_draw(sample: Sample, terms: Terms) -> Array:
    """What is paid in each draw, (draws,). A fleet is paid for from when it begins, late or not, and
    people look after it until the last tractor is done."""
    tractors, prices = len(sample.tractor_s), terms.prices
    present = tractors * (sample.finish_s - sample.late_s) / HOUR_S
    people = present * prices.supervision_share * prices.supervision_per_hour
    coming = tractors * coming_and_going(terms)
    if prices.per_hour is not None:
        return np.asarray(present * prices.per_hour + people + coming)
    return np.asarray(_machines(sample, rates(prices, terms.tractor, terms.implement)) + people + coming)


def as_simulated(run: Run, terms: Terms) -> float:
    """What is paid for a run as it was simulated, where nothing varies."""
    shares = run.time_shares()
    off = shares["turning"].sum() + shares["reversing"].sum()
    work, turns, none = (np.array([float(value)]) for value in (shares["working"].sum(), off, 0.0))
    ends = np.asarray(run.finish_s)[:, None]
    return float(paid_per_draw(Sample(ends.max(axis=0), ends, work, turns, none, none), terms)[0])


def account(prices: Prices) -> str:
    """What is paid for, in words."""
    per_hour = prices.per_hour
    parts = ["machines, fuel"] if per_hour is None else [f"{per_hour:.2f} for each tractor and hour"]
    parts += ["people"] if prices.supervision_share * prices.supervision_per_hour > 0.0 else []
    bringing = prices.transport_per_tractor > 0.0 or prices.transport_per_km > 0.0
    parts += ["bringing the tractors" if bringing else "the road"] if per_hour is None or bringing else []
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def coming_and_going(terms: Terms) -> float:
    """What one tractor costs before it comes in by the entrance and after it has left: brought, or driving itself."""
    prices = terms.prices
    brought = prices.transport_per_tractor + terms.road_km * prices.transport_per_km
    road_s = 0.0 if brought > 0.0 else terms.road_s
    if prices.per_hour is not None:
        hourly = (road_s + terms.handling_s) * prices.per_hour
    else:
        rate = rates(prices, terms.tractor, terms.implement)
        on_road = road_s * (rate.machine + rate.fuel_on_road)
        hourly = on_road + terms.handling_s * (rate.machine + IDLE_LOAD * rate.fuel_full)
    people = (terms.road_s + terms.handling_s) * prices.supervision_share * prices.supervision_per_hour
    return brought + (hourly + people) / HOUR_S


def _machines(sample: Sample, hourly: Rates) -> Array:
    """Machines and fuel, each tractor until it is done itself; waiting and stops idle."""
    used = (sample.tractor_s - sample.late_s).sum(axis=0)
    idle = np.maximum(used - sample.work_s - sample.turn_s, 0.0)
    fuel = sample.work_s * hourly.fuel_at_work + sample.turn_s * hourly.fuel_in_turns
    fuel += idle * IDLE_LOAD * hourly.fuel_full
    return np.asarray((used * hourly.machine + fuel) / HOUR_S)


def _error(values: Array) -> float:
    """Standard error of the mean."""
    return float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
