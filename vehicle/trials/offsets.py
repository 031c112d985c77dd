"""The step response of section 3.2: from one straight path to another beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vehicle.gnss import NO_ERROR, Table
from vehicle.steering import SLEW
from vehicle.tractor import Tractor
from vehicle.trials.deviation import distances
from vehicle.trials.drive import Trace, follow
from vehicle.trials.paths import RUN_OUT_M, straight
from vehicle.trials.setting import UNLIMITED_M, as_tested

OFFSETS_CM = (-200, -150, -100, -50, 50, 100, 150, 200)
SPEEDS_KMH = (3.0, 5.0)
FIRST_M, SECOND_M, LAST_M = 20.0, 28.0, 15.0  # the length of path 2 is not printed: 28 m is assumed


@dataclass(frozen=True, eq=False)
class Step:
    """One step response: its setting and its track; positive offsets lie to the right."""

    offset_cm: int
    speed_kmh: float
    ground: str
    steering: str
    track: Trace
    second_m: float = SECOND_M

    @property
    def lateral_cm(self) -> float:
        """Mean size of the lateral error over the last 15 m of path 2, in centimetres."""
        place = self.track.place()
        end = FIRST_M + self.second_m
        last = (place[:, 1] > end - LAST_M) & (place[:, 1] < end)
        return float(100.0 * np.abs(place[last, 0] - 0.01 * self.offset_cm).mean())

    @property
    def slews(self) -> bool:
        """Whether the steering simulator enters its third stage."""
        return bool((self.track.column("stage")[self._measured()] == SLEW).any())

    @property
    def sharpest_cm(self) -> float:
        """How far the controlled point gets beyond path 2, in centimetres."""
        sign = 1.0 if self.offset_cm > 0 else -1.0
        return float(max(0.0, (100.0 * sign * self.track.place()[:, 0]).max() - abs(self.offset_cm)))

    def _measured(self) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
        return np.asarray(self.track.place()[:, 1] < FIRST_M + self.second_m)

    def difference_cm(self, other: Step) -> tuple[float, float]:
        """Largest and mean distance of this track from another, from the first turn to the last 15 m."""
        place = self.track.place()
        turning = (place[:, 1] > FIRST_M - 6.0) & (place[:, 1] < FIRST_M + self.second_m - LAST_M)
        gap = 100.0 * distances(place[turning], other.track.place())
        return float(gap.max()), float(gap.mean())


def step_response(
    tractor: Tractor, offset_cm: int, speed_kmh: float, ground: str, steering: str = "proposed", *,
    position_errors: Table = NO_ERROR, seed: int = 1, limit_m: float = UNLIMITED_M, second_m: float = SECOND_M,
) -> Step:  # fmt: skip
    """Drive one step response with the corrected base model of a ground."""
    path = straight(FIRST_M + second_m + RUN_OUT_M, speed_kmh / 3.6, ground)
    tested = as_tested(tractor, steering, limit_m=limit_m)
    track = follow(tested, path, position_errors=position_errors, seed=seed, jump=(FIRST_M, 0.01 * offset_cm))
    return Step(offset_cm, speed_kmh, ground, steering, track, second_m)


def weaving_m(tractor: Tractor, offset_cm: int, *, limit_m: float, speed_kmh: float = 5.0) -> float:
    """Largest lateral error (m) in the third minute after a start `offset_cm` beside a straight path on soil.

    Unlike in the step response the lookahead point does not move first: the whole offset is there at once.
    """
    path = straight(1000.0, speed_kmh / 3.6, "soil")
    tested = as_tested(tractor, limit_m=limit_m)
    track = follow(tested, path, seconds=180.0, jump=(0.1, 0.01 * offset_cm))
    late = track.time_s > 120.0
    return float(np.abs(track.place()[late, 0] - 0.01 * offset_cm).max())
