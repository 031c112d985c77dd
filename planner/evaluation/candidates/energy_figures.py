"""What a run uses: litres of fuel or kilowatt-hours, of the fleet and of each tractor."""

from __future__ import annotations

from typing import Any

from planner.evaluation.context import PlanningContext
from planner.risk.costs import estimate_fuel_l
from vehicle.energy.fuel import CO2_KG_PER_L
from vehicle.energy.run_energy import RunEnergy, compute_run_energy
from vehicle.missions.run import SimulationRun


def measure_energy(context: PlanningContext, run: SimulationRun) -> RunEnergy | None:
    """What the tractors of a run use by their load; None where that is not known."""
    physics = context.physics
    if physics.fuel_load is None:
        return None
    return compute_run_energy(run, context.tractor, physics.fuel_load, physics.terrain)


def list_energy_figures(context: PlanningContext, run: SimulationRun, energy: RunEnergy | None) -> dict[str, Any]:
    """The figures of a plan's energy by their names in PlanResult; without its load by the flat shares of a farm."""
    if energy is None:
        if context.cost_terms is None:
            return {}
        flat_l = estimate_fuel_l(run, context.cost_terms)
        return {
            "fuel_l": flat_l,
            "fuel_l_per_ha": flat_l / context.layout.field.area_ha,
            "co2_kg": CO2_KG_PER_L * flat_l,
        }
    by_tractor = tuple(energy.consumptions.tolist())
    fuel_l = energy.fuel_l
    return {
        "fuel_l": fuel_l,
        "fuel_l_per_ha": None if fuel_l is None else fuel_l / context.layout.field.area_ha,
        "energy_kwh": energy.energy_kwh,
        "co2_kg": energy.co2_kg,
        "fuel_l_by_tractor": None if fuel_l is None else by_tractor,
        "energy_kwh_by_tractor": by_tractor if fuel_l is None else None,
    }
