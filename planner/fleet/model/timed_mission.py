"""The legs of one tractor with their lengths and times, and places along them."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import shapely

from fields.arrays import Floats, measure_along
from fields.geometry.arithmetic import GRID_M
from vehicle.jit import compile_function
from vehicle.missions.plan import Leg, Mission

HERE_M = np.zeros(1)  # ahead of a place
ROUNDING_M = GRID_M  # of a place on a corner, which belongs to the segment before it
SEARCH_AHEAD_M, SEARCH_STEP_M = 5.0, 0.25  # how far a tractor may be from where it was last known to be


@compile_function
def sample_segments(starts_m, segments, at_m, ahead_m, end_m):  # type: ignore[no-untyped-def]
    """Poses (n, 3) `ahead_m` (n,) ahead of `at_m`, none beyond `end_m`, on straight parts: metres to the start of each
    (k,), and its start, length, direction and heading (k, 6)."""
    poses = np.empty((len(ahead_m), 3))
    for row, ahead in enumerate(ahead_m):
        place_m = min(at_m + ahead, end_m)
        number = max(np.searchsorted(starts_m, place_m, side="right") - 1, 0)
        x, y, length_m, east, north, heading_rad = segments[number]
        along_m = min(max(place_m - starts_m[number], 0.0), length_m)
        poses[row] = x + along_m * east, y + along_m * north, heading_rad
    return poses


@dataclass(frozen=True, eq=False)
class TimedMission:
    """A mission with the seconds of each leg (stops included, waiting for others not)."""

    mission: Mission
    leg_seconds: tuple[float, ...]

    @cached_property
    def legs(self) -> tuple[Leg, ...]:
        """The legs in order."""
        return self.mission.legs

    @cached_property
    def lines(self) -> npt.NDArray[np.object_]:
        """The line of each leg (shapely)."""
        return np.array([shapely.LineString(leg.points) for leg in self.legs])

    @cached_property
    def lengths_m(self) -> list[float]:
        """Length of each leg."""
        return [leg.length_m for leg in self.legs]

    @cached_property
    def leg_starts_m(self) -> list[float]:
        """Metres from the start of the mission to the start of each leg, and to its end."""
        return [0.0, *np.cumsum(self.lengths_m).tolist()]

    @cached_property
    def leg_starts_s(self) -> list[float]:
        """Seconds of driving up to the start of each leg, and to the end."""
        return [0.0, *np.cumsum(self.leg_seconds).tolist()]

    @cached_property
    def fastest_mps(self) -> float:
        """The highest speed of a leg."""
        return max(leg.speed_mps for leg in self.legs)

    @cached_property
    def worked_m(self) -> list[float]:
        """Metres driven with the implement at work up to the start of each leg, and to the end."""
        worked_lengths_m = [leg.length_m if leg.implement else 0.0 for leg in self.legs]
        return [0.0, *np.cumsum(worked_lengths_m).tolist()]

    def compute_driven_s(self, leg: int, leg_m: float) -> float:
        """Planned seconds of driving from the start to a place."""
        if leg >= len(self.lengths_m):
            return self.leg_starts_s[-1]
        share = min(max(leg_m / self.lengths_m[leg], 0.0), 1.0)
        return self.leg_starts_s[leg] + share * self.leg_seconds[leg]

    def compute_worked_m(self, leg: int, leg_m: float) -> float:
        """Metres worked up to a place."""
        if leg >= len(self.legs):
            return self.worked_m[-1]
        part_m = min(max(leg_m, 0.0), self.lengths_m[leg]) if self.legs[leg].implement else 0.0
        return self.worked_m[leg] + part_m

    def sample_poses(self, leg: int, leg_m: float, ahead_m: Floats, base_end: int) -> Floats:
        """Poses (n, 3) of the guided point `ahead_m` (n,) ahead of a place on base legs: x, y (m), heading (rad).

        Beyond the end of the base it is the end of the base.
        """
        start = self.leg_starts_m[leg] + min(max(leg_m, 0.0), self.lengths_m[leg])
        end = self.leg_starts_m[max(min(base_end, len(self.lengths_m)), leg + 1)]
        poses: Floats = sample_segments(*self._segments, start, ahead_m, end)
        return poses

    def find_pose(self, leg: int, leg_m: float, base_end: int) -> Floats:
        """The pose (3,) of the guided point at a place on base legs, as of `sample_poses`."""
        pose: Floats = self.sample_poses(leg, leg_m, HERE_M, base_end)[0]
        return pose

    @cached_property
    def _segments(self) -> tuple[Floats, Floats]:
        """Metres from the start to each straight part that has a length, and its start, length, direction and heading;
        as `sample_segments` takes them."""
        starts_m, segments = list[float](), list[tuple[float, float, float, float, float, float]]()
        for leg, leg_start_m, distances_m in zip(self.legs, self.leg_starts_m, self._point_distances_m, strict=False):
            lengths_m, steps = np.diff(distances_m).tolist(), np.diff(leg.points, axis=0).tolist()
            begins_m = (leg_start_m + distances_m[:-1]).tolist()
            for start_m, length_m, (x, y), (east_m, north_m) in zip(
                begins_m, lengths_m, leg.points[:-1].tolist(), steps, strict=True
            ):
                if length_m > 0.0:
                    heading_rad = math.atan2(leg.gear * north_m, leg.gear * east_m)
                    starts_m.append(start_m)
                    segments.append((x, y, length_m, east_m / length_m, north_m / length_m, heading_rad))
        return np.array(starts_m), np.array(segments)

    @cached_property
    def _point_distances_m(self) -> list[Floats]:
        return [measure_along(leg.points) for leg in self.legs]

    def locate_ahead(self, leg: int, leg_m: float, base_end: int, place: tuple[float, float]) -> tuple[int, float]:
        """Leg and metres on it nearest to a place, from a known place on, up to SEARCH_AHEAD_M of the base."""
        steps = np.arange(0.0, SEARCH_AHEAD_M, SEARCH_STEP_M)
        poses = self.sample_poses(leg, leg_m, steps, base_end)
        nearest = int(np.argmin(np.hypot(poses[:, 0] - place[0], poses[:, 1] - place[1])))
        end = self.leg_starts_m[max(min(base_end, len(self.legs)), leg + 1)]
        at_m = min(self.leg_starts_m[leg] + min(max(leg_m, 0.0), self.lengths_m[leg]) + float(steps[nearest]), end)
        end_leg = min(max(bisect.bisect_right(self.leg_starts_m, at_m) - 1, leg), len(self.legs) - 1)
        return end_leg, at_m - self.leg_starts_m[end_leg]

    def compute_distance_to_leg_m(self, leg: int, place: tuple[float, float]) -> float:
        """How far a place is from a leg."""
        return float(shapely.distance(self.lines[min(leg, len(self.legs) - 1)], shapely.Point(place)))

    def find_nearest_leg_position_m(self, leg: int, place: tuple[float, float], within_m: float) -> float:
        """Metres along a leg to where it is nearest to a place; 0 where it is farther away than `within_m`."""
        if self.compute_distance_to_leg_m(leg, place) > within_m:
            return 0.0
        return float(shapely.line_locate_point(self.lines[min(leg, len(self.legs) - 1)], shapely.Point(place)))

    def compute_heading_offset_rad(self, leg: int, place: tuple[float, float], heading_rad: float) -> float:
        """Angle in [0, pi] between a heading and the heading of a leg at its point nearest to a place."""
        number = min(leg, len(self.legs) - 1)
        nearest_leg, distances_m = self.legs[number], self._point_distances_m[number]
        at_m = float(shapely.line_locate_point(self.lines[number], shapely.Point(place)))
        segment = min(max(int(np.searchsorted(distances_m, at_m - ROUNDING_M)) - 1, 0), len(distances_m) - 2)
        x, y = nearest_leg.gear * (nearest_leg.points[segment + 1] - nearest_leg.points[segment])
        return abs(math.remainder(heading_rad - math.atan2(y, x), 2.0 * math.pi))


def encode_leg(leg: Leg, origin_m: tuple[float, float]) -> dict[str, Any]:
    """A leg as in frames, its points in metres of the coordinate system."""
    return {
        "kind": leg.task.kind,
        "number": leg.task.number,
        "piece": leg.task.piece,
        "gear": leg.gear,
        "implement": leg.implement,
        "points_m": np.round(leg.points + origin_m, 3).tolist(),
    }
