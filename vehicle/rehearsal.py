"""Simulate plans of one fleet one after another, each from where it first differs from the one before.

Plans are mended by gates and slower legs, and driven again to see whether that helps. Up to the first leg that was
changed nothing can differ, so the run goes on from a snapshot of the last one, with the same result bit for bit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.control import ARRIVED_M
from vehicle.missions import Mission, Plan
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor
from vehicle.world import Snapshot, World

SNAPSHOT_S = 60.0  # of simulated time
FASTER = 1.5  # than any leg asks for nobody drives


class Rehearsal:
    """Drives the plans of a fleet; arguments as of World and its run. `began_s` is where the last run went on from."""

    def __init__(
        self, tractor: Tractor, implement: Implement, *, stop_clearance_m: float,
        beside_clearance_m: float | None = None, position_errors: Any = None, seed: int = 1,
    ) -> None:  # fmt: skip
        self.tractor, self.implement = tractor, implement
        self.stop_clearance_m, self.beside_clearance_m = stop_clearance_m, beside_clearance_m
        self.position_errors, self.seed = position_errors, seed
        self.began_s = 0.0
        self._plan: Plan | None = None
        self._kept: list[Snapshot] = []

    def simulate(self, plan: Plan, max_time_s: float) -> Run:
        """The run of a plan, as a world of its own would drive it."""
        world = World(plan, self.tractor, self.implement, position_errors=self.position_errors, seed=self.seed)
        limits = self._limits(world)
        self._kept = [
            one for one in self._kept if one.time_s < max_time_s and (one.states["progress"] < limits).all()
        ]
        self._plan = plan
        self.began_s = 0.0
        if self._kept:
            world.restore(self._kept[-1])
            self.began_s = self._kept[-1].time_s

        def keep(_: float) -> None:
            snapshot = world.snapshot()
            if snapshot is not None:
                self._kept.append(snapshot)

        return world.run(
            stop_clearance_m=self.stop_clearance_m, beside_clearance_m=self.beside_clearance_m,
            max_time_s=max_time_s, progress=keep, chunk_s=SNAPSHOT_S,
        )  # fmt: skip

    def _limits(self, world: World) -> npt.NDArray[np.float64]:
        """How far each tractor may have driven (m) without heeding what this plan has other than the last one."""
        plan, program = world.plan, world.program
        if self._plan is None or self._plan.tractors != plan.tractors:
            return np.zeros(plan.tractors)
        limits = np.full(plan.tractors, np.inf)
        for number, (before, after) in enumerate(zip(self._plan.missions, plan.missions, strict=True)):
            same = _same_legs(before, after)
            if same < len(after.legs):
                end = program.legs["end"][program.states["first_leg"][number] + same - 1] if same else 0.0
                limits[number] = end - self._sight_m(after)
        return limits

    def _sight_m(self, mission: Mission) -> float:
        """More than how far ahead a tractor heeds its legs: the way to stop in (vehicle.control.allowed_speed)."""
        fastest = FASTER * max(leg.speed_mps for leg in mission.legs)
        return fastest * fastest / (2.0 * self.tractor.speed.max_acceleration_mps2) + 1.0 + 2.0 * ARRIVED_M


def _same_legs(before: Mission, after: Mission) -> int:
    """How many legs at the start of two missions are the very same; 0 where their paths are not."""
    if len(before.legs) != len(after.legs):
        return 0
    pairs = list(zip(before.legs, after.legs, strict=True))
    if any(a.points is not b.points or a.gear != b.gear for a, b in pairs):
        return 0
    return next((index for index, (a, b) in enumerate(pairs) if a is not b), len(pairs))
