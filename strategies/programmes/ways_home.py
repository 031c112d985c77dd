"""Whether two tractors can both get from where they begin to where they end, if one waits while the other drives.

Each stands in the way of the other where it waits, before it begins and when it is done. Where no order of going on
lets both end, no way of waiting helps, and one of them is to begin or end elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from fields.arrays import Flags, Floats
from strategies.programmes.waiting_places import sample_poses
from vehicle.jit import compile_function
from vehicle.missions.plan import Leg, Mission
from vehicle.sim.path_conflicts import ClearanceCheck, PosePath, build_poses


@dataclass(frozen=True, eq=False)
class Way:
    """What a tractor drives of a mission, by poses of its centre of mass.

    Attributes:
        path: all poses.
        stands: those at which it may stand, the first and the last among them; a segment lies between two.
        holds: the numbers of these in the path.
    """

    path: PosePath
    stands: PosePath
    holds: tuple[int, ...]


@dataclass(eq=False)
class WayBook:
    """The ways of missions, and which of them are stuck: a search changes few tours at a time, so most are known.

    Attributes:
        back_m: how far the centre of mass is behind the guided point.
    """

    back_m: float
    _leg_poses: dict[Leg, Floats] = field(default_factory=dict)
    _ways: dict[Mission, Way] = field(default_factory=dict)
    _stuck: dict[tuple[Way, Way, ClearanceCheck], int | None] = field(default_factory=dict)

    def build_way(self, mission: Mission) -> Way:
        """The way of a tractor on its mission."""
        if mission not in self._ways:
            parts = [self._sample_leg(leg) for leg in mission.legs]
            begins = np.cumsum([0, *(len(part) for part in parts)]).tolist()
            holds = [begins[number] for number, leg in enumerate(mission.legs) if not number or leg.may_wait]
            poses, holds = np.concatenate(parts), [*holds, begins[-1] - 1]
            stands = PosePath(build_poses(poses[holds]))
            self._ways[mission] = Way(PosePath(build_poses(poses)), stands, tuple(holds))
        return self._ways[mission]

    def _sample_leg(self, leg: Leg) -> Floats:
        if leg not in self._leg_poses:
            self._leg_poses[leg] = sample_poses(leg.points, self.back_m, leg.gear)
        return self._leg_poses[leg]

    def find_stuck_side(self, a: Way, b: Way, check: ClearanceCheck) -> int | None:
        """Where two never get on: 0 where they begin, 1 where they end; None if both get home."""
        key = a, b, check
        if key not in self._stuck:
            passes = _find_passes(a, b, check), _find_passes(b, a, check).T
            reached = _spread(*map(np.ascontiguousarray, passes))
            led_home = _spread(*(np.ascontiguousarray(flags[::-1, ::-1]) for flags in passes))
            self._stuck[key] = None if reached[-1, -1] else int(reached.sum() > led_home.sum())
        return self._stuck[key]


def _find_passes(driving: Way, standing: Way, check: ClearanceCheck) -> Flags:
    """Whether one can drive a segment while the other stands at a hold, (segments, holds)."""
    rows = check.find_blocked_parts(standing.stands, driving.path)
    free = np.ones((len(driving.holds) - 1, len(standing.holds)), bool)
    for hold, first, last in rows.tolist():
        low = np.searchsorted(driving.holds[1:], first)
        high = np.searchsorted(driving.holds[1:], last)
        free[low : high + 1, hold] = False
    return free


@compile_function
def _spread(first_passes, second_passes):  # type: ignore[no-untyped-def]
    """Which pairs of holds two get to from their first, by passes (m, n + 1) of one and (m + 1, n) of the other."""
    rows, columns = len(second_passes), first_passes.shape[1]
    reached = np.zeros((rows, columns), np.bool_)
    reached[0, 0] = True
    for i in range(rows):
        for j in range(columns):
            if i > 0 and reached[i - 1, j] and first_passes[i - 1, j]:
                reached[i, j] = True
            if j > 0 and reached[i, j - 1] and second_passes[i, j - 1]:
                reached[i, j] = True
    return reached
