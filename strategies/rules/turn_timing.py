"""Turns timed by simulating one tractor that drives them."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fields.geometry.arithmetic import GRID_M
from strategies.path_planning.errors import StrategyError
from strategies.path_planning.paths import DrivePath, Pose
from strategies.path_planning.primitives import compute_drive_time_s
from strategies.path_planning.turns import list_turns, measure_turn_depth_m
from strategies.rules.driving_rules import DrivingRules
from strategies.rules.legs import PATH_STEP_M
from vehicle.missions.plan import SWATH, TURN, Leg, LegTask, Mission, Plan
from vehicle.missions.run import DONE
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.world import simulate

LEAD_M = 15.0  # straight before and after a turn, long enough to reach speed and settle
MAX_TURN_S = 600.0  # a tractor that has not finished by then never will


@dataclass(frozen=True)
class TurnTimer:
    """Times turns by simulating one tractor that drives them."""

    tractor: Tractor
    implement: Implement
    driving_rules: DrivingRules
    ground: str
    _best_times: dict[tuple[Any, ...], tuple[float | None, ...]] = field(
        default_factory=dict, compare=False, repr=False
    )

    def build_mission(self, path: DrivePath) -> Mission:
        """A straight swath, the turn, another straight swath."""
        turn = [
            Leg(points, self.driving_rules.get_path_speed_mps(gear), gear, ground=self.ground, task=LegTask(TURN))
            for gear, points in path.sample(PATH_STEP_M)
        ]
        return Mission(
            (self._build_straight(path.start, -LEAD_M, 0.0), *turn, self._build_straight(path.end, 0.0, LEAD_M))
        )

    def measure_seconds(self, path: DrivePath) -> float | None:
        """Simulated seconds from the end of one swath to the start of the next; None if the turn is never completed."""
        straight = Mission((self._build_straight(path.start, -LEAD_M, LEAD_M),))
        with_turn, without = (
            simulate(Plan((mission,)), self.tractor, self.implement, max_time_s=MAX_TURN_S)
            for mission in (self.build_mission(path), straight)
        )
        if with_turn.outcome != DONE or without.outcome != DONE:
            return None
        return with_turn.duration_s - without.duration_s

    def _build_straight(self, pose: Pose, start: float, end: float) -> Leg:
        ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
        points = np.array([pose[:2] + start * ahead, pose[:2] + end * ahead])
        return Leg(points, self.driving_rules.work_speed_mps, ground=self.ground, task=LegTask(SWATH), implement=True)

    def measure_best_times(self, width_m: float, depth_m: float, kinds: tuple[str, ...]) -> tuple[float | None, ...]:
        """Seconds of the quickest fitting turn over 0, 1, 2 ... lines, up to the first plain U-turn and one more.

        None where no turn of these kinds fits a headland that leaves `depth_m` for it.
        """
        key = width_m, depth_m, kinds
        if key not in self._best_times:
            self._best_times[key] = self._measure_best_times(*key)
        return self._best_times[key]

    def _measure_best_times(self, width_m: float, depth_m: float, kinds: tuple[str, ...]) -> tuple[float | None, ...]:
        """As `measure_best_times`, which keeps the times: layouts compared share them."""
        times: list[float | None] = [0.0]
        max_lines = math.ceil(2.0 * self.driving_rules.radius_m / width_m) + 1
        for lines in range(1, max_lines + 1):
            turns = list_turns(lines * width_m, self.driving_rules.radius_m)
            fitting = [turn for turn in turns if turn.kind in kinds and measure_turn_depth_m(turn) <= depth_m + GRID_M]
            turn_times_s = map(self.measure_seconds, fitting)
            times.append(min((time for time in turn_times_s if time is not None), default=None))
        return tuple(times)

    def estimate_detour_s(self) -> float:
        """Estimated seconds of a detour where no turn fits, for comparing orders: two full circles."""
        return 4.0 * math.pi * self.driving_rules.radius_m / self.driving_rules.turn_speed_mps

    def measure_reversal_costs(self) -> DrivingRules:
        """The rules with what a direction change costs, from two simulated turns: arc to arc, and arc to straight.

        Raises StrategyError if the tractor does not complete them.
        """
        radius, free_costs = self.driving_rules.radius_m, self.driving_rules.turn_costs
        _, three_arc_path, fishtail_path = list_turns(0.75 * radius, radius)
        lost_three_s, lost_tail_s = (
            (self._measure_required_seconds(path) - compute_drive_time_s(path.to_rows(), free_costs)) / 2.0
            for path in (three_arc_path, fishtail_path)
        )
        swing_sm = max(lost_three_s - lost_tail_s, 0.0) * radius
        cusp_s = max(lost_tail_s - swing_sm / radius, 0.0)
        return replace(self.driving_rules, cusp_s=cusp_s, swing_sm=swing_sm)

    def _measure_required_seconds(self, path: DrivePath) -> float:
        seconds = self.measure_seconds(path)
        if seconds is None:
            raise StrategyError(
                f"{self.tractor.name} does not complete a plain turn of {self.driving_rules.radius_m:.2f} m radius in "
                f"{MAX_TURN_S:g} s of simulation; check guidance, steering and speed in its tractor file."
            )
        return seconds
