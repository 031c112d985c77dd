"""Where a tractor in doubt may be, now and for the next seconds: a circle that grows with its last credible speed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class PossibleArea:
    """The ground that may be under a machine: within `radii_m` (steps,) of `centre` (2,), in metres of the observing
    fleet and at its time steps. Others keep `clearance_m` from it, and `release_m` if they stand and would resume."""

    key: int | tuple[str, int]
    centre: Array
    radii_m: Array
    clearance_m: float
    release_m: float

    def measure_distances_m(self, poses: Array, boxes: Array) -> Array:
        """Distances (..., steps), negative inside, from machines with `boxes` (n, 3) of tail, nose and half width.

        `poses` (..., steps, 3) are of their centre of mass, at the first of the time steps.
        """
        east_m, north_m = self.centre[0] - poses[..., 0], self.centre[1] - poses[..., 1]
        cos, sin = np.cos(poses[..., 2]), np.sin(poses[..., 2])
        ahead_m, aside_m = (cos * east_m + sin * north_m)[..., None], (cos * north_m - sin * east_m)[..., None]
        tail_m, nose_m, half_m = boxes.T
        beyond_m = np.maximum(np.maximum(tail_m - ahead_m, ahead_m - nose_m), 0.0)
        beside_m = np.maximum(np.abs(aside_m) - half_m, 0.0)
        distances_m: Array = np.hypot(beyond_m, beside_m).min(axis=-1) - self.radii_m[: poses.shape[-2]]
        return distances_m
