"""Money of a farm. All prices are in one currency; defaults are euros of about 2025."""

from __future__ import annotations

from planner.farm.values import Section, number, other
from planner.scenario import HIGHEST_PRICE

_EQUATIONS = "ASAE machinery cost equations (D497, EP496; standards of 2000)"


class Prices(Section):
    """What machines, fuel, people and late ground cost.

    Value left of a machine after n years: price x first_year_value x later_year_value^n. Repair until h hours of use:
    price x repair_factor x (h / 1000)^repair_power. Fuel is `fuel_l_per_kwh` times the tractor's power, times the
    share of it that is used at work, in turns and on the road. `per_hour`, where given, is all that one tractor with
    its implement costs in an hour and takes the place of depreciation, interest, repair and fuel.
    """

    currency: str = other("EUR", "in quotes", "assumed", strict=True, min_length=1, max_length=12)
    per_hour: float | None = number(None, 0.0, HIGHEST_PRICE, "per tractor and hour, all in", "from the values below")
    tractor_price: float = number(
        100_000.0, 0.0, HIGHEST_PRICE, "list price of a tractor", "assumed: about 1,300 a kW for 77 kW, with the robot"
    )
    tractor_power_kw: float = number(77.0, 0.1, 2000.0, "kW at the shaft", "the tractor of the thesis (105 hp)")
    implement_price: float = number(15_000.0, 0.0, HIGHEST_PRICE, "list price", "assumed: a cultivator of 3 m")
    hours_per_year: float = number(600.0, 1.0, 8784.0, "hours of use a year", "assumed: a tractor in full use")
    implement_hours_per_year: float = number(200.0, 1.0, 8784.0, "hours of use a year", "assumed")
    years: float = number(10.0, 0.1, 100.0, "years a machine is kept", "assumed")
    first_year_value: float = number(0.68, 0.0, 1.0, "share of the price", f"tractors, d1, {_EQUATIONS}")
    later_year_value: float = number(0.92, 0.0, 1.0, "share kept each year", f"tractors, d2, {_EQUATIONS}")
    implement_first_year_value: float = number(0.60, 0.0, 1.0, "share of the price", f"other machines, {_EQUATIONS}")
    implement_later_year_value: float = number(0.885, 0.0, 1.0, "share kept each year", f"other machines, {_EQUATIONS}")
    interest_pct: float = number(4.0, 0.0, 100.0, "percent a year of the mean value", "assumed")
    insurance_pct: float = number(1.5, 0.0, 100.0, "percent a year: taxes, housing, insurance", "assumed: 1 to 2 usual")
    repair_factor: float = number(0.007, 0.0, 10.0, "RF1 of a tractor", f"{_EQUATIONS}: two-wheel drive")
    repair_power: float = number(2.0, 0.1, 5.0, "RF2 of a tractor", f"{_EQUATIONS}: two-wheel drive")
    implement_repair_factor: float = number(0.27, 0.0, 10.0, "RF1", f"{_EQUATIONS}: field cultivator")
    implement_repair_power: float = number(1.4, 0.1, 5.0, "RF2", f"{_EQUATIONS}: field cultivator")
    fuel_per_l: float = number(1.2, 0.0, 1e6, "per litre", "assumed: farm diesel")
    fuel_l_per_kwh: float = number(0.3, 0.0, 10.0, "l per kWh of the power in use", "diesel engines: 250 g per kWh")
    work_load: float = number(
        0.74, 0.0, 1.0, "share of the power at work", f"{_EQUATIONS}: 0.73 x 0.06 gallons per hour and horsepower"
    )
    turn_load: float = number(0.35, 0.0, 1.0, "share of the power in turns", "assumed: implement lifted")
    road_load: float = number(0.5, 0.0, 1.0, "share of the power on the road", "assumed")
    oil_share: float = number(0.15, 0.0, 10.0, "of the price of the fuel", f"lubricants, {_EQUATIONS}")
    supervision_per_hour: float = number(25.0, 0.0, HIGHEST_PRICE, "of one person", "assumed: wage with all charges")
    supervision_share: float = number(0.25, 0.0, 10.0, "persons per robot", "assumed: one looks after four")
    transport_per_tractor: float = number(0.0, 0.0, HIGHEST_PRICE, "bringing one robot to a field", "it drives itself")
    transport_per_km: float = number(0.0, 0.0, HIGHEST_PRICE, "per robot and km on a lorry", "it drives itself")
    seed_per_ha: float = number(0.0, 0.0, HIGHEST_PRICE, "seed or product lost on ground not done", "assumed: none")
    late_per_ha: float = number(
        80.0, 0.0, HIGHEST_PRICE, "value lost per ha not done by the rain",
        "assumed: ten days late at half a percent a day of a crop of 1,600 a ha",
    )  # fmt: skip
