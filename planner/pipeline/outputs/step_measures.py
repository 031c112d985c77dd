"""What each step of a run uses, and the slopes on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from fields.arrays import Floats
from planner.evaluation.candidates.slope_figures import compute_driven_slopes
from planner.evaluation.field_physics import FieldPhysics
from vehicle.energy.run_energy import RunEnergy, compute_run_energy
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Tractor
from vehicle.records import FINISHED, STANDING, WAITING


@dataclass(frozen=True, eq=False)
class StepMeasures:
    """By tractor and row of the record (t,): what is used until the next row, and slopes along and across (m/m).

    Each is empty where it is not known.
    """

    consumption: tuple[Floats, ...] = ()
    slopes: tuple[tuple[Floats, Floats], ...] = ()
    is_electric: bool = False

    def list_values(self, tractor: int, first_row: int, end_row: int) -> dict[str, Any]:
        """The values of a step of these rows, by their names in DriverLeg."""
        rows = slice(first_row, max(end_row, first_row + 1))
        values: dict[str, Any] = {}
        if self.consumption:
            name = "energy_kwh" if self.is_electric else "fuel_l"
            values[name] = float(self.consumption[tractor][rows].sum())
        for name, side in (("slope_along_pct", 0), ("slope_across_pct", 1)) if self.slopes else ():
            own = self.slopes[tractor][side][rows]
            values[name] = 100.0 * float(own[np.abs(own).argmax()])
        return values


NO_MEASURES = StepMeasures()


def measure_steps(run: SimulationRun, tractor: Tractor, physics: FieldPhysics) -> StepMeasures:
    """Consumption and slopes of a run."""
    numbers, terrain = range(run.plan.tractors), physics.terrain
    energy = None if physics.fuel_load is None else compute_run_energy(run, tractor, physics.fuel_load, terrain)
    return StepMeasures(
        () if energy is None else tuple(_spread_over_rows(run, energy, number) for number in numbers),
        () if terrain is None else tuple(compute_driven_slopes(run, number, terrain) for number in numbers),
        energy is not None and energy.fuel_l is None,
    )


def _spread_over_rows(run: SimulationRun, energy: RunEnergy, number: int) -> Floats:
    """Consumption of a tractor by row (t,): that of a leg evenly over its rows, apart for driving and for standing."""
    own, statuses = energy.tractors[number], run.get_statuses(number)
    legs = np.clip(run.get_leg_numbers(number), 0, len(own.consumption) - 1)
    is_idle = np.isin(statuses, (WAITING, STANDING))
    is_driving = ~is_idle & (statuses != FINISHED)
    rows = np.zeros(len(statuses))
    idle_counts = np.bincount(legs[is_idle], minlength=len(own.idle))
    idle = np.where(idle_counts > 0, own.idle, 0.0)
    for flags, amounts in ((is_idle, idle), (is_driving, own.consumption - idle)):
        counts = np.bincount(legs[flags], minlength=len(amounts))
        rows[flags] = (amounts / np.maximum(counts, 1))[legs[flags]]
    return rows
