"""What a run uses: fuel or energy of the fleet and of each tractor, whether batteries last, and its service stops."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from fields.arrays import Floats, find_true_spans
from planner.evaluation.context import PlanningContext
from planner.risk.costs import DrivenTimes, estimate_flat_use, get_grid_factor
from strategies.rules.battery_supply import BatterySupply
from strategies.rules.supply import Supply
from vehicle.energy.fuel import CO2_KG_PER_L, ElectricDrive, build_power_source
from vehicle.energy.run_energy import compute_run_energy
from vehicle.missions.run import SimulationRun
from vehicle.records import STANDING

LEVEL_TOLERANCE_KWH = 1e-6
OVERLAP_TOLERANCE_S = 1.0


def measure_energy(context: PlanningContext, run: SimulationRun) -> tuple[float, ...] | None:
    """Litres or kilowatt-hours of every tractor of a run by its load; None where that is not known."""
    physics = context.physics
    if physics.fuel_load is None:
        return None
    energy = compute_run_energy(run, context.tractor, physics.fuel_load, physics.terrain)
    return tuple(energy.consumptions.tolist())


def list_energy_figures(
    context: PlanningContext, times: DrivenTimes, by_tractor: tuple[float, ...] | None
) -> dict[str, Any]:
    """The figures of a plan's energy by their names in PlanResult; without its load by the flat shares of a farm.

    `by_tractor` are litres or kilowatt-hours by the load; None where that is not known.
    """
    if by_tractor is not None:
        total = math.fsum(by_tractor)
    elif context.cost_terms is not None:
        total = estimate_flat_use(times, context.cost_terms)
    else:
        return {}
    per_ha = total / context.layout.field.area_ha
    if context.tractor.battery is None:
        return {
            "fuel_l": total,
            "fuel_l_per_ha": per_ha,
            "co2_kg": CO2_KG_PER_L * total,
            "fuel_l_by_tractor": by_tractor,
        }
    return {
        "energy_kwh": total,
        "energy_kwh_per_ha": per_ha,
        "co2_kg": get_grid_factor(context.cost_terms) * total,
        "energy_kwh_by_tractor": by_tractor,
    }


def find_flat_battery(context: PlanningContext, run: SimulationRun) -> str | None:
    """Why batteries do not last for a run: the first tractor that would go below its reserve; None where all last."""
    load = context.physics.fuel_load
    if context.tractor.battery is None or load is None:
        return None
    drive = build_power_source(context.tractor, load.engine_power_w)
    assert isinstance(drive, ElectricDrive)
    energy = compute_run_energy(run, context.tractor, load, context.physics.terrain, source=drive)
    is_charged = isinstance(context.supply, BatterySupply)
    stops = run.plan.notes.stops or () if is_charged else ()
    stands = context.going_on.stands if is_charged and context.going_on is not None else ()
    for number, (mission, own) in enumerate(zip(run.plan.missions, energy.tractors, strict=True)):
        is_stop = np.array([leg.stand_s > 0.0 for leg in mission.legs])
        amounts = np.zeros(len(mission.legs))
        if stops:
            amounts[is_stop] = [stop.amount for stop in stops if stop.tractor == number]
        before_kwh = stands[number].used if number < len(stands) else 0.0
        used_kwh = own.consumption - np.where(is_stop, own.idle, 0.0)
        lowest_kwh = compute_lowest_level_kwh(used_kwh, amounts, drive, before_kwh)
        if lowest_kwh < -LEVEL_TOLERANCE_KWH:
            return _describe_flat_battery(context, number, drive, lowest_kwh)
    return None


def compute_lowest_level_kwh(
    used_kwh: Floats, amounts_kwh: Floats, drive: ElectricDrive, before_kwh: float = 0.0
) -> float:
    """The least energy above the reserve at the end of any leg, of a battery of which `before_kwh` are used before.

    `used_kwh` (legs,) is what legs take, without standing at the charger, which gives that itself; `amounts_kwh`
    (legs,) are charged before legs.
    """
    level_kwh = lowest_kwh = drive.usable_kwh - before_kwh
    for used, amount in zip(used_kwh.tolist(), amounts_kwh.tolist(), strict=True):
        level_kwh = min(level_kwh + amount, drive.usable_kwh) - used
        lowest_kwh = min(lowest_kwh, level_kwh)
    return lowest_kwh


def _describe_flat_battery(context: PlanningContext, tractor: int, drive: ElectricDrive, lowest_kwh: float) -> str:
    start = (
        f"tractor {tractor + 1} would take {-lowest_kwh:.2g} kWh more than the {drive.usable_kwh:.3g} kWh that its "
        "battery has to use"
    )
    if context.supply is not None and not isinstance(context.supply, BatterySupply):
        return f"{start}, and charging is not planned beside refills; use a larger battery or more tractors"
    return f"{start}; use a larger battery, a smaller reserve or more tractors"


def list_service_figures(context: PlanningContext, run: SimulationRun) -> dict[str, Any]:
    """Stops to fill tanks and to charge or change batteries, and their time, by their names in PlanResult."""
    stops, seconds = len(run.plan.notes.stops or ()), float(run.standing_s.sum())
    if isinstance(context.supply, BatterySupply):
        return {"charges": stops, "charging_s": seconds}
    figures: dict[str, Any] = {} if context.supply is None else {"refills": stops, "refilling_s": seconds}
    if context.tractor.battery is not None and context.physics.fuel_load is not None:
        figures |= {"charges": 0, "charging_s": 0.0}
    return figures


@dataclass(frozen=True)
class CompletedServiceStop:
    """A service stop in a run: the tractor (from 0), and from when to when it stood (s)."""

    tractor: int
    from_s: float
    to_s: float


def find_service_stops(run: SimulationRun) -> list[CompletedServiceStop]:
    """All service stops of a run, in order of time."""
    stops = []
    for tractor in range(run.plan.tractors):
        is_served = (run.get_statuses(tractor) == STANDING) & ~run.find_folding_rows(tractor)
        spans = find_true_spans(is_served).tolist()
        stops += [CompletedServiceStop(tractor, first * run.step_s, last * run.step_s) for first, last in spans]
    return sorted(stops, key=lambda one: (one.from_s, one.tractor))


def find_service_conflict(run: SimulationRun, supply: Supply | None) -> str | None:
    """Why a run without contacts is not feasible: two tractors were served at once where only one can be; else None."""
    if supply is None or not supply.one_at_a_time:
        return None
    for before, after in pairwise(find_service_stops(run)):
        if after.from_s < before.to_s - OVERLAP_TOLERANCE_S:
            return (
                f"tractors {before.tractor + 1} and {after.tractor + 1} are served at the same time after "
                f"{after.from_s:.0f} s, but only one can be served at a time"
            )
    return None
