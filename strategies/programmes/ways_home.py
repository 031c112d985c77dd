"""Whether two tractors can both get from where they begin to where they end, if one waits while the other drives.

Each stands in the way of the other where it waits, before it begins and when it is done. Where no order of going on
lets both end, no way of waiting helps, and one of them is to begin or end elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from strategies.programmes.waiting_places import POSE_STEP_M, StandingCheck
from vehicle.arrays import measure_along
from vehicle.missions.plan import Leg, Mission
from vehicle.sim.path_conflicts import PosePath, build_poses

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Way:
    """What a tractor drives of a mission: `poses` (n, 3) of its centre of mass, `holds` those at which it may stand.

    The first and the last pose are holds; a segment lies between two of them.
    """

    poses: Floats
    holds: tuple[int, ...]


def build_way(mission: Mission, back_m: float) -> Way:
    """The way of a tractor on its mission, with its centre of mass `back_m` behind the guided point."""
    parts = [_sample_leg(leg, back_m) for leg in mission.legs]
    begins = np.cumsum([0, *(len(part) for part in parts)]).tolist()
    holds = [begins[number] for number, leg in enumerate(mission.legs) if not number or leg.may_wait]
    return Way(np.concatenate(parts), (*holds, begins[-1] - 1))


def _sample_leg(leg: Leg, back_m: float) -> Floats:
    along = measure_along(leg.points)
    count = max(2, int(np.ceil(along[-1] / POSE_STEP_M)))
    places = np.column_stack([np.interp(np.linspace(0.0, along[-1], count), along, axis) for axis in leg.points.T])
    steps = leg.gear * np.diff(places, axis=0)
    headings = np.arctan2(steps[:, 1], steps[:, 0])
    headings = np.append(headings, headings[-1])
    return np.column_stack([places - back_m * np.column_stack([np.cos(headings), np.sin(headings)]), headings])


def find_stuck_side(a: Way, b: Way, check: StandingCheck) -> int | None:
    """Where two never get on: 0 where they begin, 1 where they end; None if both get home."""
    passes = _find_passes(a, b, check), _find_passes(b, a, check).T
    reached = _spread(*passes)
    if reached[-1, -1]:
        return None
    led_home = _spread(*(flags[::-1, ::-1] for flags in passes))
    return int(reached.sum() > led_home.sum())


def _find_passes(driving: Way, standing: Way, check: StandingCheck) -> Flags:
    """Whether one can drive a segment while the other stands at a hold, (segments, holds)."""
    rows = check.find_blocked_parts(standing.poses[list(standing.holds)], PosePath(build_poses(driving.poses)))
    free = np.ones((len(driving.holds) - 1, len(standing.holds)), bool)
    for hold, first, last in rows.tolist():
        low = np.searchsorted(driving.holds[1:], first)
        high = np.searchsorted(driving.holds[1:], last)
        free[low : high + 1, hold] = False
    return free


def _spread(first_passes: Flags, second_passes: Flags) -> Flags:
    """Which pairs of holds two get to from their first, by passes (m, n + 1) of one and (m + 1, n) of the other."""
    reached = np.zeros((len(second_passes), first_passes.shape[1]), bool)
    reached[0, 0] = True
    for i, j in np.ndindex(reached.shape):
        came = i > 0 and reached[i - 1, j] and first_passes[i - 1, j]
        reached[i, j] |= came or (j > 0 and reached[i, j - 1] and second_passes[i, j - 1])
    return reached
