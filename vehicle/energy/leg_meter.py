"""What a leg takes from a battery, estimated before it is driven: at its own speed, with one start from standstill."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from vehicle.arrays import Floats, measure_along
from vehicle.energy.fuel import ElectricDrive, build_power_source
from vehicle.energy.run_energy import ACCELERATION, compute_consumption, compute_motion_work, list_rolling_shares
from vehicle.missions.plan import Leg
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad

STEP_M = 4.0  # between heights along a leg


@dataclass(frozen=True, eq=False)
class LegMeter:
    """Estimates the kilowatt-hours of legs; the simulated drive is measured by vehicle.energy.run_energy.

    Attributes:
        tractor: whose mass is moved.
        load: what it pulls.
        drive: battery and motor.
        terrain: heights; None for level ground.
    """

    tractor: Tractor
    load: WorkLoad
    drive: ElectricDrive
    terrain: Terrain | None = None

    def compute_leg_kwh(self, leg: Leg) -> float:
        """What driving a leg takes, without waiting and standing."""
        terrain, speed_mps = self.terrain, leg.speed_mps
        points = leg.points if terrain is None else _cut_into_steps(leg.points)
        metres = np.hypot(*np.diff(points, axis=0).T)
        count = len(metres)
        work = compute_motion_work(
            metres,
            np.zeros(count) if terrain is None else np.diff(terrain.compute_heights(points)),
            np.full(count + 1, speed_mps),
            self.tractor.mass_kg,
            self.load,
            np.repeat(list_rolling_shares((leg,), self.load), count),
            np.full(count, leg.implement),
        )
        work[0, ACCELERATION] += 0.5 * (self.tractor.mass_kg + self.load.implement_mass_kg) * speed_mps**2
        return float(compute_consumption(work, np.zeros(count), metres / speed_mps, self.load, self.drive).sum())

    def compute_straight_kwh(self, length_m: float, speed_mps: float, is_working: bool, ground: str) -> float:
        """What a straight line on level ground takes."""
        line = Leg(np.array([[0.0, 0.0], [0.0, length_m]]), speed_mps, implement=is_working, ground=ground)
        return replace(self, terrain=None).compute_leg_kwh(line)


def build_leg_meter(tractor: Tractor, load: WorkLoad, terrain: Terrain | None) -> LegMeter | None:
    """The meter of an electric tractor; None for diesel."""
    drive = build_power_source(tractor, load.engine_power_w)
    return LegMeter(tractor, load, drive, terrain) if isinstance(drive, ElectricDrive) else None


def _cut_into_steps(points: Floats) -> Floats:
    """The same polyline (n, 2) with points at most STEP_M apart."""
    places = measure_along(points)
    count = max(int(np.ceil(places[-1] / STEP_M)), 1)
    wanted = np.union1d(np.linspace(0.0, places[-1], count + 1), places)
    return np.column_stack([np.interp(wanted, places, points[:, axis]) for axis in (0, 1)])
