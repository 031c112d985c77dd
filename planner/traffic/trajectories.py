"""What each tractor of a plan does when nobody is in its way: where its outline is, when, and where it may stand."""

from __future__ import annotations

import hashlib
import struct
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from fields.arrays import Floats, Integers, measure_along
from strategies.programmes.waiting_places import POSE_STEP_M
from vehicle.missions.plan import LegGate, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.records import REC_ANGLE, REC_PLACE
from vehicle.sim.path_conflicts import PosePath, build_poses

MAX_CACHED_POSES = 1_000_000  # of all cached trajectories
TURN_WEIGHT_M = 3.0  # metres of driving that count as much as a radian of turning
SoloSimulation = Callable[[Plan, Sequence[int]], Iterable[SimulationRun]]
"""Simulates some tractors of a plan, by number, each with nobody else on the field."""


@dataclass(frozen=True, eq=False)
class SoloTrajectory:
    """One tractor driving alone without a stop: `poses` (k,) as in vehicle.sim.path_conflicts, and `time_s` (k,).

    `holds` are the indices of poses at which it may stand, the start first and the end of all last, each before leg
    `hold_legs[number]`; a segment lies between two of them. `leg` and `leg_distance_m` (k,) are how far each pose is
    along the mission. One that `enters` the field is not on it at its start, one that `leaves` it not at its end.
    """

    poses: npt.NDArray[np.void]
    time_s: Floats
    leg: Integers
    leg_distance_m: Floats
    holds: tuple[int, ...]
    hold_legs: tuple[int, ...]
    enters: bool = False
    leaves: bool = False

    def is_on_field_at(self, hold: int) -> bool:
        """Whether a tractor at a hold point, by number, is on the field."""
        return not ((hold == 0 and self.enters) or (hold == self.segment_count and self.leaves))

    @cached_property
    def trail(self) -> PosePath:
        """Its poses, ready to be compared with those of others."""
        return PosePath(self.poses)

    @property
    def segment_count(self) -> int:
        """Number of segments from one hold point to the next."""
        return len(self.holds) - 1

    def get_begin_s(self, segment: int) -> float:
        """When a segment begins; for `segment_count` when the last one ends (s)."""
        return float(self.time_s[self.holds[segment]])

    def get_duration_s(self, segment: int) -> float:
        """How long a segment takes (s)."""
        return self.get_begin_s(segment + 1) - self.get_begin_s(segment)

    def drop_holds(self, holds: set[int]) -> SoloTrajectory:
        """The same trajectory without these hold points, by number."""
        remaining = [number for number in range(len(self.holds)) if number not in holds]
        return replace(
            self, holds=tuple(self.holds[n] for n in remaining), hold_legs=tuple(self.hold_legs[n] for n in remaining)
        )

    def locate_passing(self, leg: int, distance_m: float) -> tuple[int, float]:
        """The segment in which a place on a leg is passed, and when, from the beginning of that segment (s)."""
        first = int(np.searchsorted(self.leg, leg))
        last = int(np.searchsorted(self.leg, leg, "right"))
        place = min(first + int(np.searchsorted(self.leg_distance_m[first:last], distance_m)), len(self.leg) - 1)
        segment = min(max(int(np.searchsorted(self.holds, place, "left")) - 1, 0), self.segment_count - 1)
        return segment, float(self.time_s[place]) - self.get_begin_s(segment)

    def build_segment_gate(self, tractor: int, segment: int, after_s: float, mission: Mission) -> LegGate:
        """Gate that opens when the tractor of this trajectory has been on a segment for `after_s`."""
        time_s = self.get_begin_s(segment) + min(max(after_s, 0.0), self.get_duration_s(segment))
        place = min(int(np.searchsorted(self.time_s, time_s)), self.holds[segment + 1])
        place = max(place, min(self.holds[segment] + 1, self.holds[segment + 1]))
        leg, distance_m = int(self.leg[place]), float(self.leg_distance_m[place])
        if (
            place == self.holds[segment + 1]
            and leg == self.hold_legs[segment + 1]
            and leg > 0
            and distance_m < POSE_STEP_M
        ):
            leg, distance_m = leg - 1, mission.legs[leg - 1].length_m
        length_m = mission.legs[leg].length_m
        if self.leaves and place == len(self.time_s) - 1:  # just before its end it is still in the lane
            return LegGate.end(tractor, leg, length_m)
        return LegGate.place(tractor, leg, length_m, distance_m)


@dataclass
class TrajectoryCache:
    """What plans of one field share: trajectories by mission, and where pairs meet (vehicle.sim.path_conflicts) with a
    clearance beside each other.

    It is emptied when it holds more than MAX_CACHED_POSES poses: large fields have few plans.
    """

    trajectories: dict[bytes, SoloTrajectory | None] = field(default_factory=dict)
    meetings: dict[tuple[SoloTrajectory, SoloTrajectory, float], Integers] = field(default_factory=dict)
    pose_count: int = 0

    def find_trajectories(self, plan: Plan, simulate_alone: SoloSimulation) -> list[SoloTrajectory | None]:
        """The trajectory of every tractor of a plan, those simulated that are not cached; None for one that does not
        finish."""
        keys = [compute_mission_key(mission) for mission in plan.missions]
        missing = {key: number for number, key in enumerate(keys) if key not in self.trajectories}
        for (key, number), run in zip(missing.items(), simulate_alone(plan, [*missing.values()]), strict=True):
            trajectory = _build_trajectory(plan.missions[number], run) if run.outcome == DONE else None
            self.pose_count += len(trajectory.poses) if trajectory else 0
            self.trajectories[key] = trajectory
        return [self.trajectories[key] for key in keys]

    def clear_if_too_large(self) -> None:
        """Empty the cache if it has become too large."""
        if self.pose_count > MAX_CACHED_POSES:
            self.trajectories.clear()
            self.meetings.clear()
            self.pose_count = 0


def get_trajectories(
    plan: Plan, simulate_alone: SoloSimulation, cache: TrajectoryCache | None = None
) -> list[SoloTrajectory] | None:
    """The trajectory of every tractor of a plan; None if one does not finish even alone."""
    cache = cache or TrajectoryCache()
    cache.clear_if_too_large()
    trajectories = cache.find_trajectories(plan, simulate_alone)
    complete = [trajectory for trajectory in trajectories if trajectory is not None]
    return complete if len(complete) == len(trajectories) else None


def compute_mission_key(mission: Mission) -> bytes:
    """A digest of all that a trajectory depends on."""
    digest = hashlib.sha256()
    for leg in mission.legs:
        leg_facts = leg.gear, leg.implement, leg.task.is_work, bool(leg.may_wait or leg.gates), len(leg.points)
        digest.update(struct.pack("<2d5i", leg.speed_mps, leg.standing_s, *leg_facts))
        digest.update(f"{leg.ground} {leg.task.kind}".encode())
        digest.update(np.ascontiguousarray(leg.points, dtype=np.float64).tobytes())
    return digest.digest()


def _build_trajectory(mission: Mission, run: SimulationRun) -> SoloTrajectory:
    legs = run.get_leg_numbers(0)
    holds = [n for n, leg in enumerate(mission.legs) if n == 0 or leg.may_wait or leg.gates]
    rows = np.searchsorted(legs, holds)
    rows[0] = 0
    poses = run.get_poses(0)
    driven_m = measure_along(poses[:, REC_PLACE])
    turned_rad = np.abs((np.diff(poses[:, REC_ANGLE]) + np.pi) % (2.0 * np.pi) - np.pi)
    travel_m = driven_m + TURN_WEIGHT_M * np.concatenate(([0.0], np.cumsum(turned_rad)))
    sample_rows = np.searchsorted(travel_m, np.arange(0.0, travel_m[-1], POSE_STEP_M))
    sample_rows = np.unique(np.concatenate([sample_rows, rows, [len(legs) - 1]]))
    leg_begins_m = driven_m[np.searchsorted(legs, legs[sample_rows])]
    return SoloTrajectory(
        build_poses(poses[sample_rows]),
        run.time_s[sample_rows],
        legs[sample_rows],
        driven_m[sample_rows] - leg_begins_m,
        (*np.searchsorted(sample_rows, rows).tolist(), len(sample_rows) - 1),
        (*holds, len(mission.legs)),
        mission.enters,
        mission.leaves,
    )
