"""The legs of one tractor as the centre needs them: how long, how long driven, where, and who is waited for."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.missions import Leg, Mission

Array = npt.NDArray[np.float64]
ONWARD_M, ONWARD_STEP_M = 5.0, 0.25  # how far a tractor may be from where it was last known to be

@dataclass(frozen=True, eq=False)
class Course:
    """A mission with the seconds that each of its legs takes (stands included, waiting for others not)."""

    mission: Mission
    seconds: tuple[float, ...]

    @property
    def legs(self) -> tuple[Leg, ...]:
        """The legs in order."""
        return self.mission.legs

    @cached_property
    def lengths_m(self) -> list[float]:
        """Length of each leg."""
        return [leg.length_m for leg in self.legs]

    @cached_property
    def before_m(self) -> list[float]:
        """Metres from the start of the mission to the start of each leg, and to its end."""
        return [0.0, *np.cumsum(self.lengths_m).tolist()]

    @cached_property
    def before_s(self) -> list[float]:
        """Seconds of driving up to the start of each leg, and to the end."""
        return [0.0, *np.cumsum(self.seconds).tolist()]

    @cached_property
    def worked_m(self) -> list[float]:
        """Metres driven with the implement at work up to the start of each leg, and to the end."""
        works = [leg.length_m if leg.implement else 0.0 for leg in self.legs]
        return [0.0, *np.cumsum(works).tolist()]

    def driven_s(self, leg: int, leg_m: float) -> float:
        """Seconds that the plan takes to a place, from the start."""
        if leg >= len(self.legs):
            return self.before_s[-1]
        share = min(max(leg_m / self.lengths_m[leg], 0.0), 1.0)
        return self.before_s[leg] + share * self.seconds[leg]

    def done_m(self, leg: int, leg_m: float) -> float:
        """Metres worked up to a place."""
        if leg >= len(self.legs):
            return self.worked_m[-1]
        part = min(max(leg_m, 0.0), self.lengths_m[leg]) if self.legs[leg].implement else 0.0
        return self.worked_m[leg] + part

    def along(self, leg: int, leg_m: float, ahead_m: Sequence[float], released: int) -> Array:
        """Poses (n, 3) of the guided point so far ahead of a place on the released legs: x, y (m), heading (rad).

        What lies beyond the end of the last released leg is that end.
        """
        start = self.before_m[leg] + min(max(leg_m, 0.0), self.lengths_m[leg])
        end = self.before_m[max(min(released, len(self.legs)), leg + 1)]
        return np.array([self._pose(min(start + ahead, end)) for ahead in ahead_m])

    def _pose(self, at_m: float) -> tuple[float, float, float]:
        leg = min(max(bisect.bisect_right(self.before_m, at_m) - 1, 0), len(self.legs) - 1)
        points, along = self.legs[leg].points, self._along[leg]
        part = at_m - self.before_m[leg]
        segment = min(max(int(np.searchsorted(along, part, side="right")) - 1, 0), len(points) - 2)
        (x, y), (x1, y1) = points[segment], points[segment + 1]
        length = math.hypot(x1 - x, y1 - y) or 1.0
        share = min(max((part - along[segment]) / length, 0.0), 1.0)
        gear = self.legs[leg].gear
        return (
            float(x + share * (x1 - x)), float(y + share * (y1 - y)), math.atan2(gear * (y1 - y), gear * (x1 - x)),
        )  # fmt: skip

    @cached_property
    def _along(self) -> list[Array]:
        return [
            np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(leg.points, axis=0).T)))) for leg in self.legs
        ]

    def onward(self, leg: int, leg_m: float, released: int, place: tuple[float, float]) -> tuple[int, float]:
        """The leg and the metres on it nearest to a place, from a known one on: up to ONWARD_M of the released legs."""
        steps = np.arange(0.0, ONWARD_M, ONWARD_STEP_M)
        poses = self.along(leg, leg_m, steps.tolist(), released)
        nearest = int(np.argmin(np.hypot(poses[:, 0] - place[0], poses[:, 1] - place[1])))
        end = self.before_m[max(min(released, len(self.legs)), leg + 1)]
        at_m = min(self.before_m[leg] + min(max(leg_m, 0.0), self.lengths_m[leg]) + float(steps[nearest]), end)
        there = min(max(bisect.bisect_right(self.before_m, at_m) - 1, leg), len(self.legs) - 1)
        return there, at_m - self.before_m[there]

    def off_m(self, leg: int, place: tuple[float, float]) -> float:
        """How far a place is from a leg."""
        return float(self._apart_m(leg, place).min())

    def nearest_m(self, leg: int, place: tuple[float, float], within_m: float) -> float:
        """Metres along a leg to where it is nearest to a place; 0 where it is farther away than `within_m`."""
        apart = self._apart_m(leg, place)
        points = self.legs[min(leg, len(self.legs) - 1)].points
        segment = int(apart.argmin())
        if apart[segment] > within_m:
            return 0.0
        steps = np.diff(points, axis=0)
        lengths = np.hypot(*steps.T)
        ahead = float(((place - points[segment]) * steps[segment]).sum() / max(lengths[segment], 1e-6))
        return float(lengths[:segment].sum()) + min(max(ahead, 0.0), float(lengths[segment]))

    def off_rad(self, leg: int, place: tuple[float, float], heading_rad: float) -> float:
        """Angle in [0, pi] between a heading and that of a tractor on a leg, where the leg is nearest to a place."""
        driven = self.legs[min(leg, len(self.legs) - 1)]
        segment = int(self._apart_m(leg, place).argmin())
        x, y = driven.gear * (driven.points[segment + 1] - driven.points[segment])
        return abs(math.remainder(heading_rad - math.atan2(y, x), 2.0 * math.pi))

    def _apart_m(self, leg: int, place: tuple[float, float]) -> Array:
        """How far a place is from each segment of a leg."""
        points = self.legs[min(leg, len(self.legs) - 1)].points
        a, along = points[:-1], np.diff(points, axis=0)
        square = np.maximum((along**2).sum(axis=1), 1e-12)
        share = np.clip(((place - a) * along).sum(axis=1) / square, 0.0, 1.0)
        apart: Array = np.hypot(*(a + share[:, None] * along - place).T)
        return apart


def leg_told(leg: Leg, origin_m: tuple[float, float]) -> dict[str, Any]:
    """A leg as pages and tractors are told of it, its points in metres of the coordinate system."""
    return {
        "kind": leg.task.kind, "number": leg.task.number, "piece": leg.task.piece, "gear": leg.gear,
        "implement": leg.implement, "points_m": np.round(leg.points + origin_m, 3).tolist(),
    }  # fmt: skip
