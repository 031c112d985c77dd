"""Turns timed by simulating one tractor that drives them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from strategies.errors import StrategyError
from strategies.job import Manner
from strategies.legs import STEP_M
from strategies.ways.connect import TurnCosts
from strategies.ways.paths import Path, Pose
from strategies.ways.turns import fishtail, omega_turn, switch_back, turn_depth, u_turn
from vehicle.missions import TRACK, TURN, Leg, Mission, Plan, Task
from vehicle.run import DONE
from vehicle.tractor import Implement, Tractor
from vehicle.world import simulate

LEAD_M = 15.0  # straight before and after a turn, long enough to come to speed and to settle
LONGEST_S = 600.0  # a tractor that is not through by then never will be
TURNS = {"u": (u_turn,), "omega": (omega_turn,), "switch-back": (switch_back, fishtail)}


@dataclass(frozen=True)
class TurnClock:
    """Times turns by simulating one tractor that drives them."""

    tractor: Tractor
    implement: Implement
    manner: Manner
    ground: str

    def mission(self, path: Path) -> Mission:
        """Some way of straight track, the turn, some way of straight track."""
        speed = self.manner.reverse_speed_mps if path.reverse_m else self.manner.turn_speed_mps
        turn = [Leg(points, speed, gear, ground=self.ground, task=Task(TURN)) for gear, points in path.sample(STEP_M)]
        return Mission((self._straight(path.start, -LEAD_M, 0.0), *turn, self._straight(path.end, 0.0, LEAD_M)))

    def seconds(self, path: Path) -> float | None:
        """Simulated seconds from the end of one track to the start of the next; None where it never comes through."""
        straight = Mission((self._straight(path.start, -LEAD_M, LEAD_M),))
        with_turn, without = (
            simulate(Plan((mission,)), self.tractor, self.implement, max_time_s=LONGEST_S)
            for mission in (self.mission(path), straight)
        )
        if with_turn.outcome != DONE or without.outcome != DONE:
            return None
        return with_turn.duration_s - without.duration_s

    def _straight(self, pose: Pose, start: float, end: float) -> Leg:
        ahead = np.array([math.cos(pose[2]), math.sin(pose[2])])
        points = np.array([pose[:2] + start * ahead, pose[:2] + end * ahead])
        return Leg(points, self.manner.work_speed_mps, ground=self.ground, task=Task(TRACK), implement=True)

    def best_times(self, width_m: float, depth_m: float, kinds: tuple[str, ...]) -> tuple[float | None, ...]:
        """Seconds of the quickest fitting turn over 0, 1, 2 ... lines, up to the first plain U-turn and one more.

        None where no turn of these kinds fits a headland that leaves `depth_m` for it.
        """
        times: list[float | None] = [0.0]
        most = math.ceil(2.0 * self.manner.radius_m / width_m) + 1
        for lines in range(1, most + 1):
            timed = [self.seconds(path) for path in self._options(lines * width_m, depth_m, kinds)]
            times.append(min((time for time in timed if time is not None), default=None))
        return tuple(times)

    def _options(self, spacing: float, depth_m: float, kinds: tuple[str, ...]) -> list[Path]:
        a, b = (0.0, 0.0, 0.5 * math.pi), (spacing, 0.0, -0.5 * math.pi)
        radius = self.manner.radius_m
        found = []
        for kind in kinds:
            if (kind == "u" and spacing < 2.0 * radius) or turn_depth(kind, spacing, radius) > depth_m + 1e-6:
                continue
            found += [path for make in TURNS[kind] if (path := make(a, b, radius))]
        return found

    def long_way_s(self) -> float:
        """What a way round is taken to cost where no turn fits, for comparing orders: two full circles."""
        return 4.0 * math.pi * self.manner.radius_m / self.manner.turn_speed_mps

    def costs(self) -> TurnCosts:
        """What a direction change costs, from two simulated turns: arc to arc, and arc to straight.

        Raises StrategyError for a tractor that does not come through them.
        """
        radius, manner = self.manner.radius_m, self.manner
        a, b = (0.0, 0.0, 0.5 * math.pi), (0.75 * radius, 0.0, -0.5 * math.pi)
        free = TurnCosts(manner.turn_speed_mps, manner.reverse_speed_mps, 0.0)
        three, tail = switch_back(a, b, radius), fishtail(a, b, radius)
        assert three is not None and tail is not None
        lost_three, lost_tail = ((self._driven(path) - free.time_s(path)) / 2.0 for path in (three, tail))
        swing = max(lost_three - lost_tail, 0.0) * radius
        cusp = max(lost_tail - swing / radius, 0.0)
        return TurnCosts(manner.turn_speed_mps, manner.reverse_speed_mps, cusp, swing)

    def _driven(self, path: Path) -> float:
        seconds = self.seconds(path)
        if seconds is None:
            raise StrategyError(
                f"{self.tractor.name} does not come through a plain turn of {self.manner.radius_m:.2f} m radius in "
                f"{LONGEST_S:g} s of simulation; check guidance, steering and speed in its file."
            )
        return seconds
