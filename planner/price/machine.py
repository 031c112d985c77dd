"""Hourly cost of a machine as farm accounting has it (ASAE machinery cost equations)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.prices import Prices

PCT = 0.01


@dataclass(frozen=True)
class Rates:
    """Money per hour of use: for having the machines, for keeping them whole, and for fuel with oil by what they do
    (`fuel_full`: at full power)."""

    depreciation: float
    interest: float
    insurance: float
    repair: float
    fuel_at_work: float
    fuel_in_turns: float
    fuel_on_road: float
    fuel_full: float

    @property
    def machine(self) -> float:
        """All but fuel."""
        return self.depreciation + self.interest + self.insurance + self.repair


def rates(prices: Prices, tractor: FarmTractor | None = None, implement: FarmImplement | None = None) -> Rates:
    """The hourly rates of one tractor with its implement; what these do not say of themselves the prices do."""
    own = _owned(
        prices, _said(tractor, "price", prices.tractor_price), _said(tractor, "years", prices.years),
        _said(tractor, "hours_per_year", prices.hours_per_year),
        (prices.first_year_value, prices.later_year_value, prices.repair_factor, prices.repair_power),
    )  # fmt: skip
    mounted = _owned(
        prices, _said(implement, "price", prices.implement_price), _said(implement, "years", prices.years),
        _said(implement, "hours_per_year", prices.implement_hours_per_year),
        (
            prices.implement_first_year_value, prices.implement_later_year_value,
            prices.implement_repair_factor, prices.implement_repair_power,
        ),
    )  # fmt: skip
    power = _said(tractor, "power_kw", prices.tractor_power_kw)
    full = prices.fuel_l_per_kwh * power * prices.fuel_per_l * (1.0 + prices.oil_share)
    having, interest, insurance, repair = (mine + its for mine, its in zip(own, mounted, strict=True))
    return Rates(
        having, interest, insurance, repair,
        full * prices.work_load, full * prices.turn_load, full * prices.road_load, full,
    )  # fmt: skip


def _said(machine: FarmTractor | FarmImplement | None, name: str, otherwise: float) -> float:
    value = getattr(machine, name, None)
    return otherwise if value is None else float(value)


def remaining_value(price: float, first: float, later: float, years: float) -> float:
    """What a machine of this list price is worth after so many years: price x d1 x d2^years."""
    return price * first * math.pow(later, years)


def repair_until(price: float, factor: float, power: float, hours: float) -> float:
    """Repair until so many hours of use: price x RF1 x (hours / 1000)^RF2."""
    return price * factor * math.pow(hours / 1000.0, power)


def _owned(
    prices: Prices, price: float, years: float, hours: float, law: tuple[float, float, float, float]
) -> tuple[float, float, float, float]:
    """Depreciation, interest, insurance and repair of one machine per hour of its use."""
    first, later, factor, power = law
    left = remaining_value(price, first, later, years)
    mean = 0.5 * (price + left)
    life = hours * years
    return (
        (price - left) / life,
        mean * prices.interest_pct * PCT / hours,
        mean * prices.insurance_pct * PCT / hours,
        repair_until(price, factor, power, life) / life,
    )
