"""The measured radii, and places on a body: formulas that references share."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
RADIUS_LAW, LOCK_DEG, MAP_SPEED_MPS = 118.4, 35.0, 5.0 / 3.6


class Curve(NamedTuple):
    """Measured radius of the centre of mass: r = 118.4 / (c |angle|^p), angle in degrees, one (c, p) for each side."""

    right_c: float
    right_p: float
    left_c: float
    left_p: float


EG105 = Curve(0.4457377, 1.199, 0.3081049, 1.285)  # thesis, Eq. 2.10, on soil at 5 km/h


@numba.njit(cache=True)
def measured_curvature(angle_deg: float, curve: Any) -> float:
    """Curvature (1/m, positive right) of the path of the centre of mass at a wheel angle, by a Curve's fields."""
    size = min(abs(angle_deg), LOCK_DEG)
    if angle_deg > 0.0:
        return curve.right_c * size**curve.right_p / RADIUS_LAW
    return -curve.left_c * size**curve.left_p / RADIUS_LAW


@numba.njit(cache=True)
def look_up(value: float, places: Array, values: Array) -> float:
    """As `np.interp` of one value, with the outer slopes held on beyond the ends."""
    i = int(min(max(int(np.searchsorted(places, value)), 1), len(places) - 1))
    return values[i - 1] + (values[i] - values[i - 1]) * (value - places[i - 1]) / (places[i] - places[i - 1])


def find_point(
    east: Array, north: Array, heading: Array, forward_m: Array | float, right_m: Array | float
) -> tuple[Array, Array]:
    """East and north of a point ahead of another one and to its right, of a body of this heading (rad)."""
    sin, cos = np.sin(heading), np.cos(heading)
    return east + forward_m * sin + right_m * cos, north + forward_m * cos - right_m * sin


@dataclass(frozen=True, eq=False)
class Track:
    """A drive as it was, a row per step: states, the command in force (deg) and the speed over the ground (m/s).

    The first states are east, north (m) and heading (rad) of a point `ahead_m` of the rear axle; the drive begins at
    `day_s` of the day.
    """

    time_s: Array
    states: Array
    held_deg: Array
    speed_mps: Array
    ahead_m: float = 0.0
    day_s: float = 0.0

    def column(self, index: int) -> Array:
        """One state over time."""
        return self.states[:, index]

    def find_point(self, forward_m: Array | float, right_m: Array | float) -> tuple[Array, Array]:
        """East and north of a point ahead of the rear axle and to its right."""
        return find_point(*self.states[:, :3].T, forward_m - self.ahead_m, right_m)

    def find_start(self, place: Array, bearing: float, forward_m: float = 0.0) -> tuple[float, float, float]:
        """Where a drive like this one, which began at the origin, has to begin for its middle to be at a place (2,).

        The middle is that of a point ahead of the rear axle.
        """
        middle = [0.5 * float(np.min(axis) + np.max(axis)) for axis in self.find_point(forward_m, 0.0)]
        return float(place[0]) - middle[0], float(place[1]) - middle[1], bearing
