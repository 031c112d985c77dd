"""The seconds that a turn takes: speeds forwards and in reverse, the loss at each change of direction, bends."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
from strategies.path_planning.paths import DrivePath, TurnError
from strategies.path_planning.primitives import compute_drive_time_s
from vehicle.control.speed_profile import UNLIMITED, DrivingLimits


@dataclass(frozen=True)
class TurnCosts:
    """What a turn costs in time: two speeds (m/s), the seconds lost per direction change, and the limits in bends.

    A direction change costs `cusp_s` for the stop and the shift, and `swing_sm` seconds per 1/m of curvature by which
    the wheels must be turned over meanwhile. Raises TurnError for speeds that are not positive or a negative loss.
    """

    speed_mps: float
    reverse_speed_mps: float
    cusp_s: float
    swing_sm: float = 0.0
    limits: DrivingLimits = UNLIMITED

    def __post_init__(self) -> None:
        for name in ("speed_mps", "reverse_speed_mps"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise TurnError(f"{name} {value} must be above zero and finite; give a driving speed in m/s.")
        for name in ("cusp_s", "swing_sm"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0):
                raise TurnError(f"{name} {value} must be zero or more and finite; give the loss per direction change.")

    def compute_time_s(self, path: DrivePath) -> float:
        """Seconds to drive the path between two swaths; direction changes at its ends count too."""
        return float(compute_drive_time_s(path.to_rows(), self.speeds))

    @property
    def speeds(self) -> Floats:
        """The costs as the compiled search takes them (primitives.compute_drive_time_s)."""
        own, limits = (self.speed_mps, self.reverse_speed_mps, self.cusp_s, self.swing_sm), self.limits
        bends = limits.lateral_mps2, limits.steering_mps, limits.window_m, limits.length_m, limits.deceleration_mps2
        return np.array([*own, *bends])
