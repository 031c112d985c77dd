"""What machines, fuel, people and late ground cost. One currency; defaults are euros of about 2025."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

from planner.errors import ScenarioError, named
from planner.scenario import HIGHEST_PRICE

_EQUATIONS = "ASAE machinery cost equations (D497, EP496; standards of 2000)"
SOURCES = {
    "currency": "assumed",
    "tractor_price": "assumed: about 1,300 a kW for 77 kW, with the robot",
    "tractor_power_kw": "the tractor of the thesis (105 hp)",
    "implement_price": "assumed: a cultivator of 3 m",
    "hours_per_year": "assumed: a tractor in full use",
    "implement_hours_per_year": "assumed",
    "years": "assumed",
    "first_year_value": f"tractors, d1, {_EQUATIONS}",
    "later_year_value": f"tractors, d2, {_EQUATIONS}",
    "implement_first_year_value": f"other machines, {_EQUATIONS}",
    "implement_later_year_value": f"other machines, {_EQUATIONS}",
    "interest_pct": "assumed",
    "insurance_pct": "assumed: 1 to 2 usual",
    "repair_factor": f"two-wheel drive, {_EQUATIONS}",
    "repair_power": f"two-wheel drive, {_EQUATIONS}",
    "implement_repair_factor": f"field cultivator, {_EQUATIONS}",
    "implement_repair_power": f"field cultivator, {_EQUATIONS}",
    "fuel_per_l": "assumed: farm diesel",
    "fuel_l_per_kwh": "diesel engines: 250 g per kWh",
    "work_load": f"0.73 x 0.06 gallons per hour and horsepower, {_EQUATIONS}",
    "turn_load": "assumed: implement lifted",
    "road_load": "assumed",
    "oil_share": f"lubricants, {_EQUATIONS}",
    "supervision_per_hour": "assumed: wage with all charges",
    "supervision_share": "assumed: one looks after four",
    "transport_per_tractor": "it drives itself",
    "transport_per_km": "it drives itself",
    "seed_per_ha": "assumed: none",
    "late_per_ha": "assumed: ten days late at half a percent a day of a crop of 1,600 a ha",
}
"""Where the defaults of `Prices` come from, by parameter."""


@dataclass(frozen=True)
class Prices:
    """Prices in one currency, powers in kW, fuel in litres; shares of 1 unless they end in `_pct`.

    `per_hour`, where given, is all that one tractor with its implement costs in an hour on the field and takes the
    place of depreciation, interest, insurance, repair and fuel there. Raises ScenarioError for what cannot be.
    """

    currency: str = "EUR"
    per_hour: float | None = None
    tractor_price: float = 100_000.0
    tractor_power_kw: float = 77.0
    implement_price: float = 15_000.0
    hours_per_year: float = 600.0
    implement_hours_per_year: float = 200.0
    years: float = 10.0
    first_year_value: float = 0.68
    later_year_value: float = 0.92
    implement_first_year_value: float = 0.60
    implement_later_year_value: float = 0.885
    interest_pct: float = 4.0
    insurance_pct: float = 1.5
    repair_factor: float = 0.007
    repair_power: float = 2.0
    implement_repair_factor: float = 0.27
    implement_repair_power: float = 1.4
    fuel_per_l: float = 1.2
    fuel_l_per_kwh: float = 0.3
    work_load: float = 0.74
    turn_load: float = 0.35
    road_load: float = 0.5
    oil_share: float = 0.15
    supervision_per_hour: float = 25.0
    supervision_share: float = 0.25
    transport_per_tractor: float = 0.0
    transport_per_km: float = 0.0
    seed_per_ha: float = 0.0
    late_per_ha: float = 80.0

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name == "currency" or (each.name == "per_hour" and value is None):
                continue
            least = 0.1 if each.name in _ABOVE_0 else 0.0
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
                raise ScenarioError(f"{named(each.name)} is {value!r}; give a number.")
            if not least <= value <= HIGHEST_PRICE:
                raise ScenarioError(f"{named(each.name)} is {value:g}; use {least:g} to {HIGHEST_PRICE:g}.")


_ABOVE_0 = ("years", "hours_per_year", "implement_hours_per_year")


def flat(per_hour: float, per_tractor: float, currency: str = "", late_per_ha: float = 0.0) -> Prices:
    """Prices of somebody who hires: so much per tractor and hour, so much for bringing each."""
    return Prices(
        currency=currency, per_hour=per_hour, supervision_share=0.0, transport_per_tractor=per_tractor,
        late_per_ha=late_per_ha,
    )  # fmt: skip


def like(section: Any) -> Prices:
    """The prices of an object with values of the same names, as the section of a farm file; others by default."""
    names = (each.name for each in fields(Prices))
    return Prices(**{name: getattr(section, name) for name in names if hasattr(section, name)})
