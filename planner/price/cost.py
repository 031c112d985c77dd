"""What a plan costs in every draw: machines, fuel, people, transport, and ground that is late."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from planner.chance.draws import Sample
from planner.price.machine import Rates, rates
from planner.price.prices import Prices

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


def cost(sample: Sample, prices: Prices, area_ha: float, *, road_km: float = 0.0) -> Cost:
    """The cost of a plan for `area_ha` of work; each tractor comes `road_km` on a lorry."""
    paid = paid_per_draw(sample, prices, road_km=road_km)
    late = (1.0 - sample.done) * area_ha * (prices.late_per_ha + prices.seed_per_ha)
    return Cost(float(paid.mean()), _error(paid), float((paid + late).mean()), _error(paid + late))


def paid_per_draw(sample: Sample, prices: Prices, *, road_km: float = 0.0) -> Array:
    """What is paid in each draw, (draws,). People look after the fleet until the last tractor is done."""
    tractors = len(sample.tractor_s)
    present = tractors * sample.finish_s / HOUR_S
    people = present * prices.supervision_share * prices.supervision_per_hour
    coming = tractors * (prices.transport_per_tractor + road_km * prices.transport_per_km)
    if prices.per_hour is not None:
        return np.asarray(present * prices.per_hour + people + coming)
    return np.asarray(_machines(sample, rates(prices)) + people + coming)


def _machines(sample: Sample, hourly: Rates) -> Array:
    """Machines and fuel, each tractor until it is done itself; waiting and stops idle."""
    used = sample.tractor_s.sum(axis=0)
    idle = np.maximum(used - sample.work_s - sample.turn_s, 0.0)
    fuel = sample.work_s * hourly.fuel_at_work + sample.turn_s * hourly.fuel_in_turns
    fuel += idle * IDLE_LOAD * hourly.fuel_full
    return np.asarray((used * hourly.machine + fuel) / HOUR_S)


def _error(values: Array) -> float:
    """Standard error of the mean."""
    return float(values.std(ddof=1)) / math.sqrt(len(values)) if len(values) > 1 else 0.0
