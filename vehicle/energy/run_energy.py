"""Energy of a simulated run: work at the driven axles by cause, and the fuel or electricity for it, leg by leg.

What a leg takes from a battery is estimated before it is driven: at its own speed, with one start from standstill.

Between two rows of the 10 Hz record the wheels push with what the tractor's motion needs:

    push = change of kinetic energy + weight x rise + resistance to rolling + draft

all over the metres between the rows. Slip adds what the driven wheels lose (vehicle.energy.traction); where the sum is
negative the tractor is braked. So the work of the axle is that of the six causes together, braking counted as what it
takes away, and over a lap that ends as it began the rise adds nothing. What tyres lose sideways in bends is left out:
the record does not show it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats, locate_at, measure_along
from vehicle.control.speed import STANDSTILL_MPS
from vehicle.energy.fuel import CO2_KG_PER_L, LITRES, ElectricDrive, PowerSource, build_power_source
from vehicle.energy.traction import SLIP_RESISTANCE, solve_slips
from vehicle.missions.plan import Leg
from vehicle.missions.run import SimulationRun
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import FINISHED, GRAVITY_MPS2, REC_PLACE, REC_SPEED, STANDING, WAITING, WORKING

CAUSES = ("grade", "rolling", "draft", "acceleration", "slip", "braking")
GRADE, ROLLING, DRAFT, ACCELERATION, SLIP, BRAKING = range(len(CAUSES))
STEP_M = 4.0  # between heights along a leg


@dataclass(frozen=True, eq=False)
class TractorEnergy:
    """What one tractor took.

    Attributes:
        work_j: work at the axles by leg and cause (legs, 6), columns as CAUSES; braking is what brakes and engine took
            out, so that a row adds up to what the engine put in.
        consumption: by leg (legs,), in the unit of RunEnergy, with idling.
        idle: the part of it while the tractor waited or stood (legs,).
    """

    work_j: Floats
    consumption: Floats
    idle: Floats


@dataclass(frozen=True, eq=False)
class RunEnergy:
    """What a run took, by tractor; `unit` is "l" of diesel or "kWh" from the battery."""

    tractors: tuple[TractorEnergy, ...]
    unit: str

    @cached_property
    def consumptions(self) -> Floats:
        """Of each tractor (tractors,), in `unit`."""
        return np.array([tractor.consumption.sum() for tractor in self.tractors])

    @property
    def total(self) -> float:
        """Of all tractors, in `unit`."""
        return float(self.consumptions.sum())

    @property
    def fuel_l(self) -> float | None:
        """Litres of all tractors; None for electric ones."""
        return self.total if self.unit == LITRES else None

    @property
    def energy_kwh(self) -> float | None:
        """Kilowatt-hours of all tractors from their batteries; None for diesel."""
        return None if self.unit == LITRES else self.total

    @property
    def co2_kg(self) -> float | None:
        """Carbon dioxide of the diesel burnt; None for electric tractors, where it is that of the grid."""
        return self.total * CO2_KG_PER_L if self.unit == LITRES else None


def compute_run_energy(
    run: SimulationRun,
    tractor: Tractor,
    load: WorkLoad,
    terrain: Terrain | None = None,
    *,
    source: PowerSource | None = None,
) -> RunEnergy:
    """What the tractors of a run took, leg by leg.

    Args:
        run: a finished or broken run; after its end a tractor takes nothing.
        tractor: of every mission.
        load: as the run was driven with, or as it would have been pulled.
        terrain: heights; None for level ground.
        source: engine or battery; that of the tractor, a diesel engine with the power of the load, where None.

    Raises VehicleError where the power of the engine is not known.
    """
    source = source or build_power_source(tractor, load.engine_power_w)
    tractors = []
    for number, mission in enumerate(run.plan.missions):
        legs, statuses = mission.legs, run.get_statuses(number)[:-1]
        row_legs = np.clip(run.get_leg_numbers(number)[:-1], 0, len(legs) - 1)
        seconds, is_working = np.diff(run.time_s) * (statuses != FINISHED), statuses == WORKING
        places, speeds = np.ascontiguousarray(run.record[:, number, REC_PLACE]), run.record[:, number, REC_SPEED]
        metres = np.hypot(*np.diff(places, axis=0).T)
        rises_m = np.zeros(len(metres)) if terrain is None else np.diff(terrain.compute_heights(places))
        rolling_shares = np.array([choose_rolling_share(load, leg.ground) for leg in legs])[row_legs]
        work = compute_motion_work(metres, rises_m, speeds, tractor.mass_kg, load, rolling_shares, is_working)
        work *= (seconds > 0.0)[:, None]
        is_idle = np.isin(statuses, (WAITING, STANDING)) & (np.abs(speeds[:-1]) < STANDSTILL_MPS)
        taken = compute_consumption(work, seconds, load, source)
        taken = np.where(is_idle, source.idle_rate * seconds, taken)
        columns = (*work.T, taken, np.where(is_idle, taken, 0.0))
        *by_cause, consumption, idle = (
            np.bincount(row_legs, weights=column, minlength=len(legs)).astype(np.float64) for column in columns
        )
        tractors.append(TractorEnergy(np.column_stack(by_cause), consumption, idle))
    return RunEnergy(tuple(tractors), source.unit)


def compute_motion_work(
    metres: Floats,
    rises_m: Floats,
    speeds_mps: Floats,
    mass_kg: float,
    load: WorkLoad,
    rolling_shares: Floats,
    is_working: Flags,
) -> Floats:
    """Work (J) at the driven axles by cause (n, 6) over n pieces of a way.

    Args:
        metres: length of each piece (n,).
        rises_m: how much higher it ends (n,).
        speeds_mps: at the ends of the pieces (n + 1,), negative for backwards.
        mass_kg: of the tractor, without what the load adds.
        load: draft, grip and mass of the implement.
        rolling_shares: resistance to rolling over weight (n,), as on level ground: so the simulation takes it.
        is_working: whether the implement works (n,).
    """
    mean_speeds = 0.5 * np.abs(speeds_mps[1:] + speeds_mps[:-1])
    mass = mass_kg + load.implement_mass_kg
    weight = mass * GRAVITY_MPS2
    work = np.zeros((len(metres), len(CAUSES)))
    work[:, GRADE] = weight * rises_m
    work[:, ROLLING] = weight * rolling_shares * metres
    work[:, DRAFT] = np.where(is_working, load.compute_draft_n(mean_speeds) * metres, 0.0)
    work[:, ACCELERATION] = 0.5 * mass * np.diff(speeds_mps**2)
    push = work.sum(axis=1)
    work[:, SLIP] = _compute_slip_loss(push, metres, weight * load.driven_share, rolling_shares, load)
    work[:, BRAKING] = np.maximum(-push, 0.0)
    return work


def _compute_slip_loss(
    push_j: Floats, metres: Floats, driven_n: float, rolling_shares: Floats, load: WorkLoad
) -> Floats:
    """Work (J) that driven wheels lose by slip: they turn farther than the tractor goes, and dig.

    The push of the wheels pays for their own resistance without slip, which net traction leaves out.
    """
    losses = np.zeros(len(push_j))
    is_pushing = (push_j > 0.0) & (metres > 0.0)
    if load.mobility_number is None or not is_pushing.any():
        return losses
    shares = push_j[is_pushing] / metres[is_pushing] / driven_n
    slips = solve_slips(shares - rolling_shares[is_pushing], load.mobility_number, load.max_slip)
    slips = np.maximum(slips, 0.0)
    dig = SLIP_RESISTANCE * slips / math.sqrt(load.mobility_number) * driven_n
    gross_j = push_j[is_pushing] + dig * metres[is_pushing]
    losses[is_pushing] = gross_j / (1.0 - slips) - push_j[is_pushing]
    return losses


def compute_consumption(work: Floats, seconds: Floats, load: WorkLoad, source: PowerSource) -> Floats:
    """Litres or kilowatt-hours (n,) for work by cause (n, 6) in some seconds (n,).

    Wheels turn an engine or motor with what they brake.
    """
    axle = work.sum(axis=1)
    driven = np.where(axle > 0.0, axle / load.driveline_efficiency, 0.0)
    braked = work[:, BRAKING] * load.driveline_efficiency
    engine_j = driven - braked
    is_on = seconds > 0.0
    power_w = np.divide(engine_j, seconds, out=np.zeros_like(engine_j), where=is_on)
    return np.where(is_on, source.compute_rate(power_w) * seconds, 0.0)


def estimate_consumption(
    tractor: Tractor,
    load: WorkLoad,
    rolling_share: float,
    metres: Floats,
    rises_m: Floats,
    speeds_mps: Floats,
    is_working: bool,
    *,
    source: PowerSource | None = None,
    start_mps: float = 0.0,
) -> float:
    """Litres or kilowatt-hours for pieces of a way (n,) driven at steady speeds (n,), which change between them.

    `source` is engine or battery, that of the tractor where None; `start_mps` is the speed to which the tractor starts
    from standstill, 0 if it drives already.
    """
    count, speeds = len(metres), np.append(speeds_mps, speeds_mps[-1])
    rolling_shares, working = np.full(count, rolling_share), np.full(count, is_working)
    work = compute_motion_work(metres, rises_m, speeds, tractor.mass_kg, load, rolling_shares, working)
    work[0, ACCELERATION] += 0.5 * (tractor.mass_kg + load.implement_mass_kg) * start_mps**2
    source = source or build_power_source(tractor, load.engine_power_w)
    return float(compute_consumption(work, metres / speeds_mps, load, source).sum())


def choose_rolling_share(load: WorkLoad, ground: str) -> float:
    """Resistance to rolling over weight: the load's, or that of a ground."""
    level_share = GROUNDS[find_ground_index(ground)].rolling_resistance
    return level_share if load.rolling_share is None else load.rolling_share


@dataclass(frozen=True, eq=False)
class LegMeter:
    """Estimates the kilowatt-hours of legs; the simulated drive is measured above.

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
        terrain = self.terrain
        points = leg.points if terrain is None else _cut_into_steps(leg.points)
        metres = np.hypot(*np.diff(points, axis=0).T)
        rises_m = np.zeros(len(metres)) if terrain is None else np.diff(terrain.compute_heights(points))
        rolling_share, speeds = choose_rolling_share(self.load, leg.ground), np.full(len(metres), leg.speed_mps)
        return estimate_consumption(
            self.tractor, self.load, rolling_share, metres, rises_m, speeds, leg.implement,
            source=self.drive, start_mps=leg.speed_mps,
        )  # fmt: skip

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
    return locate_at(points, places, wanted)
