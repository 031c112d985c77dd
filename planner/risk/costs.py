"""The cost of a plan in every sample: machines, fuel, people, transport, and late ground.

Hourly machine cost follows the ASAE machinery cost equations (ASAE EP496, D497). Fuel or electricity is that of the
load of the simulated drive (vehicle.energy) where that is known, else a flat share of the engine's power.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from fields.units import HOUR_S, PCT
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.settings import FarmPrices
from planner.request.plan_request import PlanRequest
from planner.risk.monte_carlo import SampledOutcomes
from reports.common.language import mark_text
from vehicle.missions.run import SimulationRun

PCT_TO_SHARE = 1.0 / PCT
ASSUMED_PRICE_PER_HOUR = 40.0  # of a tractor with implement, fuel and all, where nobody gave a price
IDLE_LOAD = 0.1  # share of full power of an idling engine: waiting and stopped tractors


@dataclass(frozen=True)
class HourlyRates:
    """Cost per hour of use: ownership, repair, and fuel with oil, or electricity, by activity (`fuel_full`: at full
    power)."""

    depreciation: float
    interest: float
    insurance: float
    repair: float
    fuel_at_work: float
    fuel_in_turns: float
    fuel_on_road: float
    fuel_full: float

    @property
    def rates_without_fuel(self) -> float:
        """All rates but fuel."""
        return self.depreciation + self.interest + self.insurance + self.repair


def compute_hourly_rates(
    prices: FarmPrices,
    tractor: FarmTractor | None = None,
    implement: FarmImplement | None = None,
    motor_efficiency: float | None = None,
) -> HourlyRates:
    """The hourly rates of one tractor with its implement; the prices fill in what these do not give.

    `motor_efficiency` is the share of the battery's energy that leaves the motor; None for a diesel engine.
    """
    tractor_rates = _compute_ownership_rates(prices, tractor, prices.tractor_price, "")
    implement_rates = _compute_ownership_rates(prices, implement, prices.implement_price, "implement_")
    power_kw = _get_value(tractor, "power_kw", prices.tractor_power_kw)
    full_power_fuel = (
        power_kw * compute_use_per_kwh(prices, motor_efficiency) * compute_energy_price(prices, motor_efficiency)
    )
    depreciation, interest, insurance, repair = (sum(pair) for pair in zip(tractor_rates, implement_rates, strict=True))
    return HourlyRates(
        depreciation,
        interest,
        insurance,
        repair,
        full_power_fuel * prices.work_load,
        full_power_fuel * prices.turn_load,
        full_power_fuel * prices.road_load,
        full_power_fuel,
    )


def compute_use_per_kwh(prices: FarmPrices, motor_efficiency: float | None) -> float:
    """Litres of diesel, or kWh of an electric tractor's battery, for a kWh of the power in use."""
    return prices.fuel_l_per_kwh if motor_efficiency is None else 1.0 / motor_efficiency


def compute_energy_price(prices: FarmPrices, motor_efficiency: float | None) -> float:
    """The price of a litre of diesel with oil, or of a kWh of electricity."""
    return prices.fuel_per_l * (1.0 + prices.oil_share) if motor_efficiency is None else prices.electricity_per_kwh


def get_grid_factor(terms: CostTerms | None) -> float:
    """Kilograms of carbon dioxide by kWh from the grid: of the farm, else the default of farm files."""
    return (FarmPrices() if terms is None else terms.prices).grid_co2_kg_per_kwh


def _get_value(machine: FarmTractor | FarmImplement | None, name: str, default: float) -> float:
    value = getattr(machine, name, None)
    return default if value is None else float(value)


def compute_remaining_value(price: float, first: float, later: float, years: float) -> float:
    """Remaining value of a machine after so many years: list price x d1 x d2^years."""
    return price * first * math.pow(later, years)


def compute_repair_cost(price: float, factor: float, power: float, hours: float) -> float:
    """Repair cost until so many hours of use: list price x RF1 x (hours / 1000)^RF2."""
    return price * factor * math.pow(hours / 1000.0, power)


def _compute_ownership_rates(
    prices: FarmPrices, machine: FarmTractor | FarmImplement | None, usual_price: float, kind: str
) -> tuple[float, float, float, float]:
    """Depreciation, interest, insurance and repair of one machine per hour of its use.

    `kind` is before the names of the prices of its kind.
    """
    price, years = _get_value(machine, "price", usual_price), _get_value(machine, "years", prices.years)
    hours = _get_value(machine, "hours_per_year", getattr(prices, f"{kind}hours_per_year"))
    names = ("first_year_value", "later_year_value", "repair_factor", "repair_power")
    first, later, factor, power = (getattr(prices, f"{kind}{name}") for name in names)
    final_value = compute_remaining_value(price, first, later, years)
    mean_value = 0.5 * (price + final_value)
    life_hours = hours * years
    return (
        (price - final_value) / life_hours,
        mean_value * prices.interest_pct * PCT_TO_SHARE / hours,
        mean_value * prices.insurance_pct * PCT_TO_SHARE / hours,
        compute_repair_cost(price, factor, power, life_hours) / life_hours,
    )


@dataclass(frozen=True)
class CostTerms:
    """The prices a fleet works at: those of the farm and of its machines.

    Each tractor travels `road_km` there and back in `road_s`, and is unfolded and folded in `handling_s`. It drives
    itself, unless the farm has a price for transport. `learned_notes` say which values come from the farm's own logs.
    `motor_efficiency` of electric tractors is the share of the battery's energy that leaves the motor; None for diesel.
    """

    prices: FarmPrices
    tractor: FarmTractor | None = None
    implement: FarmImplement | None = None
    road_km: float = 0.0
    road_s: float = 0.0
    handling_s: float = 0.0
    learned_notes: tuple[str, ...] = ()
    motor_efficiency: float | None = None

    @property
    def are_given(self) -> bool:
        """Whether anybody gave a price; else all are defaults of farm files."""
        machines = (self.tractor, self.implement)
        return self.prices.are_given or any(one is not None and one.price is not None for one in machines)


def are_prices_given(request: PlanRequest, terms: CostTerms | None) -> bool:
    """Whether anybody gave a price that decides between plans: with the request, or with the terms of a farm."""
    if terms is not None:
        return terms.are_given
    return request.price_per_hour is not None or request.price_per_tractor > 0.0


def get_price_per_hour(requested: float | None) -> float:
    """The price of a tractor and hour that was asked for, else the assumed one."""
    return ASSUMED_PRICE_PER_HOUR if requested is None else requested


def build_hire_terms(per_hour: float | None, per_tractor: float) -> CostTerms:
    """Terms of hired tractors: a price per tractor and hour, all included, and one for bringing each tractor."""
    price = get_price_per_hour(per_hour)
    return CostTerms(FarmPrices(per_hour=price, supervision_share=0.0, transport_per_tractor=per_tractor))


def choose_terms(request: PlanRequest, terms: CostTerms | None) -> CostTerms:
    """The terms of a farm, else those of tractors hired at the prices of a request."""
    return terms or build_hire_terms(request.price_per_hour, request.price_per_tractor)


def list_cost_figures(outcomes: SampledOutcomes, terms: CostTerms, area_ha: float) -> dict[str, float]:
    """The mean costs of a plan for `area_ha` of work by their names in PlanResult: paid, and with late ground added.

    Work continues to the end whatever the weather; the price of late ground is the loss by rain.
    """
    paid, prices = compute_paid_per_sample(outcomes, terms), terms.prices
    expected = paid + (1.0 - outcomes.worked_share) * area_ha * prices.late_ground_per_ha
    standard_error = float(expected.std(ddof=1)) / math.sqrt(len(expected)) if len(expected) > 1 else 0.0
    return {
        "paid_cost": float(paid.mean()),
        "expected_cost": float(expected.mean()),
        "expected_cost_error": standard_error,
    }


def compute_paid_per_sample(outcomes: SampledOutcomes, terms: CostTerms) -> Floats:
    """What is paid in each sample, (samples,).

    A fleet is paid from its actual start, and supervised until the last tractor is done.
    """
    tractors, prices = len(outcomes.tractor_finish_s), terms.prices
    present_h = tractors * (outcomes.finish_s - outcomes.start_delay_s) / HOUR_S
    people = present_h * prices.supervision_share * prices.supervision_per_hour
    travel = tractors * compute_travel_cost(terms)
    if prices.per_hour is not None:
        return np.asarray(present_h * prices.per_hour + people + travel)
    return np.asarray(_compute_machine_cost(outcomes, terms) + people + travel)


@dataclass(frozen=True, eq=False)
class DrivenTimes:
    """Seconds that a fleet drives: until each tractor is done (tractors,), and of all together at work and in turns.

    `resting` tractors more have nothing to do, and are not paid.
    """

    tractor_s: Floats
    work_s: float
    turn_s: float
    resting: int = 0


def measure_driven_times(run: SimulationRun) -> DrivenTimes:
    """The times of a run."""
    seconds = run.sum_seconds_by_status()
    turn_s = float(seconds["turning"].sum() + seconds["reversing"].sum())
    resting = run.plan.resting
    paid_s = np.delete(np.asarray(run.finish_s), [number - 1 for number in resting])
    return DrivenTimes(paid_s, float(seconds["working"].sum()), turn_s, len(resting))


def compute_driven_cost(times: DrivenTimes, terms: CostTerms, energy: float | None = None) -> float:
    """What is paid for a drive, without variation; `energy` are its litres or kWh where they are known."""
    work_s, turn_s, zero = (np.array([value]) for value in (times.work_s, times.turn_s, 0.0))
    finish_s, used = times.tractor_s[:, None], None if energy is None else np.array([energy])
    outcomes = SampledOutcomes(finish_s.max(axis=0), finish_s, work_s, turn_s, zero, zero, energy=used)
    return float(compute_paid_per_sample(outcomes, terms)[0])


def estimate_flat_use(times: DrivenTimes, terms: CostTerms) -> float:
    """Litres or kWh of all tractors in the field by flat shares of power; engines idle while waiting."""
    prices = terms.prices
    idle_s = max(float(times.tractor_s.sum()) - times.work_s - times.turn_s, 0.0)
    load_s = times.work_s * prices.work_load + times.turn_s * prices.turn_load + idle_s * IDLE_LOAD
    power_kw = _get_value(terms.tractor, "power_kw", prices.tractor_power_kw)
    return load_s / HOUR_S * power_kw * compute_use_per_kwh(prices, terms.motor_efficiency)


def describe_prices(terms: CostTerms) -> str:
    """What the prices cover, such as "machines, fuel and people"."""
    prices = terms.prices
    per_hour = prices.per_hour
    if per_hour is None:
        parts = [mark_text("machines")]
        parts.append(mark_text("fuel") if terms.motor_efficiency is None else mark_text("electricity"))
    else:
        parts = [f"{per_hour:.2f} for each tractor and hour from its actual start"]
    if prices.supervision_share * prices.supervision_per_hour > 0.0:
        parts.append(mark_text("people"))
    if prices.transport_per_tractor > 0.0 or prices.transport_per_km > 0.0:
        parts.append(mark_text("bringing the tractors"))
    elif per_hour is None:
        parts.append(mark_text("the road"))
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def compute_travel_cost(terms: CostTerms) -> float:
    """The cost of one tractor outside the field: transport or driving on the road, and handling."""
    prices = terms.prices
    transport = prices.transport_per_tractor + terms.road_km * prices.transport_per_km
    road_s = 0.0 if transport > 0.0 else terms.road_s
    if prices.per_hour is not None:
        hourly = (road_s + terms.handling_s) * prices.per_hour
    else:
        rate = compute_hourly_rates(prices, terms.tractor, terms.implement, terms.motor_efficiency)
        on_road = road_s * (rate.rates_without_fuel + rate.fuel_on_road)
        hourly = on_road + terms.handling_s * (rate.rates_without_fuel + IDLE_LOAD * rate.fuel_full)
    people = (terms.road_s + terms.handling_s) * prices.supervision_share * prices.supervision_per_hour
    return transport + (hourly + people) / HOUR_S


def _compute_machine_cost(outcomes: SampledOutcomes, terms: CostTerms) -> Floats:
    """Cost of machines and fuel, (samples,): each tractor until it is done; engines idle while waiting."""
    prices, efficiency = terms.prices, terms.motor_efficiency
    rates = compute_hourly_rates(prices, terms.tractor, terms.implement, efficiency)
    used_s = (outcomes.tractor_finish_s - outcomes.start_delay_s).sum(axis=0)
    if outcomes.energy is not None:
        energy_cost = outcomes.energy * compute_energy_price(prices, efficiency)
        return np.asarray(used_s * rates.rates_without_fuel / HOUR_S + energy_cost)
    idle_s = np.maximum(used_s - outcomes.work_s - outcomes.turn_s, 0.0)
    fuel = outcomes.work_s * rates.fuel_at_work + outcomes.turn_s * rates.fuel_in_turns
    fuel += idle_s * IDLE_LOAD * rates.fuel_full
    return np.asarray((used_s * rates.rates_without_fuel + fuel) / HOUR_S)
