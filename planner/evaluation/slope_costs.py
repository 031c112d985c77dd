"""What slopes mean for a layout, estimated for its choice: seconds where the engine lacks power, or fuel.

Every swath is taken in both directions by halves, as tractors drive to and fro, at the steady speed that the power of
the engine allows; slip and starts are left to the simulation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fields.layout.swaths import Layout
from fields.terrain.slopes import cut_into_steps
from planner.evaluation.field_physics import FieldPhysics
from planner.request.plan_request import LEAST_FUEL, PlanRequest
from strategies.site.site import Site
from vehicle.energy.fuel import build_power_source
from vehicle.energy.run_energy import compute_consumption, compute_motion_work
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.terrain import Terrain
from vehicle.model.tractor import Tractor
from vehicle.model.work_load import WorkLoad
from vehicle.records import GRAVITY_MPS2

STEP_M = 4.0
LEAST_MPS, HALVINGS = 0.2, 30
ML_PER_L = 1000.0
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SlopeCosts:
    """Costs of layouts on terrain for one tractor with a load: seconds, or millilitres with `counts_fuel`."""

    terrain: Terrain
    load: WorkLoad
    tractor: Tractor
    rolling_share: float
    counts_fuel: bool

    def weigh(self, site: Site, level_s: float) -> float:
        """The cost of a site that takes `level_s` on level ground."""
        rules = site.rules
        metres, slopes = self._measure_swaths(site.layout)
        directions = [(slopes, self.limit_speeds(slopes, rules.work_speed_mps)) for slopes in (slopes, -slopes)]
        if not self.counts_fuel:
            slowed_s = [float((metres / speeds).sum()) for _, speeds in directions]
            return level_s + 0.5 * sum(slowed_s) - float(metres.sum()) / rules.work_speed_mps
        off_work_s = max(level_s - float(metres.sum()) / rules.work_speed_mps, 0.0)
        turn = self._compute_fuel_l(
            np.array([rules.turn_speed_mps]), np.zeros(1), np.array([rules.turn_speed_mps]), False
        )
        swath_l = [self._compute_fuel_l(metres, slopes, speeds, True) for slopes, speeds in directions]
        return ML_PER_L * (0.5 * sum(swath_l) + off_work_s * turn)

    def limit_speeds(self, slopes: Floats, speed_mps: float) -> Floats:
        """Speeds (n,) up to `speed_mps` at which the power of the engine suffices on slopes (n,), positive uphill."""
        low, high = np.full(len(slopes), LEAST_MPS), np.full(len(slopes), speed_mps)
        is_enough = self._compute_power_w(slopes, high) <= self.load.axle_power_w
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            fits = self._compute_power_w(slopes, middle) <= self.load.axle_power_w
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        return np.where(is_enough, speed_mps, low)

    def _compute_power_w(self, slopes: Floats, speeds: Floats) -> Floats:
        constant, linear, square = self.load.draft_n
        weight_n = (self.tractor.mass_kg + self.load.implement_mass_kg) * GRAVITY_MPS2
        draft_n = constant + (linear + square * speeds) * speeds
        return np.asarray((weight_n * (slopes + self.rolling_share) + draft_n) * speeds)

    def _compute_fuel_l(self, metres: Floats, slopes: Floats, speeds: Floats, is_working: bool) -> float:
        work = compute_motion_work(
            metres,
            slopes * metres,
            np.append(speeds, speeds[-1]),
            self.tractor.mass_kg,
            self.load,
            np.full(len(metres), self.rolling_share),
            np.full(len(metres), is_working),
        )
        source = build_power_source(self.tractor, self.load.engine_power_w)
        return float(compute_consumption(work, np.zeros(len(metres)), metres / speeds, self.load, source).sum())

    def _measure_swaths(self, layout: Layout) -> tuple[Floats, Floats]:
        """Lengths (n,) of steps along all swaths, and slopes (n,) along them."""
        steps = [cut_into_steps(swath.points_m, STEP_M) for swath in layout.swaths]
        vectors = np.concatenate([vector for _, vector in steps])
        gradients = self.terrain.compute_gradients(np.concatenate([middle for middle, _ in steps]))
        metres = np.hypot(*vectors.T)
        return metres, (gradients * vectors).sum(axis=1) / metres


def build_slope_weigher(
    request: PlanRequest, physics: FieldPhysics, tractor: Tractor, ground: str
) -> Callable[[Site, float], float] | None:
    """How layouts are weighed on terrain by the objective of a request; None where slopes change nothing."""
    load = physics.driven_load
    if physics.terrain is None or load is None:
        return None
    level_share = GROUNDS[find_ground_index(ground)].rolling_resistance
    rolling_share = level_share if load.rolling_share is None else load.rolling_share
    counts_fuel = request.objective == LEAST_FUEL and physics.fuel_load is not None
    return SlopeCosts(physics.terrain, load, tractor, rolling_share, counts_fuel).weigh
