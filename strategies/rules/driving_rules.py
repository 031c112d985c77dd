"""What all tractors of a fleet have in common when they drive: speeds, radius, distances between them, size, turns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fields.arrays import Floats
from vehicle.control.speed_profile import UNLIMITED, DrivingLimits

MAX_REVERSE_LENGTHS = 2.0  # lengths of tractor and implement that one manoeuvre may be driven in reverse
THESIS_MACHINE_M = 5.0  # length of tractor and implement that rows 10 m apart are for


def list_turn_costs(
    turn_mps: float,
    reverse_mps: float,
    cusp_s: float = 0.0,
    swing_sm: float = 0.0,
    limits: DrivingLimits = UNLIMITED,
) -> Floats:
    """What driving turns costs, as compiled functions take it (path_planning.primitives.compute_drive_time_s).

    The values are those of DrivingRules.
    """
    bends = limits.lateral_mps2, limits.steering_mps, limits.window_m, limits.length_m, limits.deceleration_mps2
    return np.array([turn_mps, reverse_mps, cusp_s, swing_sm, *bends])


@dataclass(frozen=True)
class DrivingRules:
    """How every tractor of the fleet drives.

    `tool_m` is how far the implement works behind the guided point. `turn_s[k]` are the simulated seconds of the best
    turn over k lines (index 0 unused); beyond its end the last entry grows by driving straight across. A tractor that
    must give way waits `hold_back_m` before the end of its swath, clear of the headland. Two that would turn side by
    side go `ahead_m` one after the other. `boxes` are the outline of tractor and implement: rear and front end ahead of
    the guided point, and half the width (m). `limits` hold in bends. A direction change costs `cusp_s` for the stop and
    the shift, and `swing_sm` seconds per 1/m of curvature by which the wheels must be turned over meanwhile.
    """

    work_speed_mps: float
    turn_speed_mps: float
    reverse_speed_mps: float
    radius_m: float
    tool_m: float
    gap_m: float = 10.0
    stagger_m: float = 12.0
    hold_back_m: float = 8.0
    ahead_m: float = 0.0
    turn_s: tuple[float, ...] = (0.0, 20.0)
    boxes: tuple[tuple[float, float, float], ...] = ((-1.8, 2.4, 1.0), (-2.7, -1.9, 1.4))
    limits: DrivingLimits = UNLIMITED
    cusp_s: float = 0.0
    swing_sm: float = 0.0

    @cached_property
    def turn_costs(self) -> Floats:
        """As list_turn_costs gives them."""
        return list_turn_costs(self.turn_speed_mps, self.reverse_speed_mps, self.cusp_s, self.swing_sm, self.limits)

    def get_path_speed_mps(self, gear: float) -> float:
        """Largest speed on a turn or route in a gear; bends are driven more slowly (vehicle.control.speed_profile)."""
        speed_mps: float = self.turn_speed_mps if gear > 0 else self.reverse_speed_mps
        return speed_mps

    @property
    def length_m(self) -> float:
        """Length of tractor and implement together (m)."""
        rears, fronts, _ = zip(*self.boxes, strict=True)
        return float(max(fronts) - min(rears))

    def scale_spacing(self) -> DrivingRules:
        """The same with the distances between tractors shortened for machines shorter than that of the thesis."""
        share = min(1.0, self.length_m / THESIS_MACHINE_M)
        spacing_m = {key: share * getattr(self, key) for key in ("gap_m", "stagger_m", "hold_back_m", "ahead_m")}
        return replace(self, **spacing_m)

    @property
    def body_width_m(self) -> float:
        """Width of the tractor (m)."""
        return 2.0 * self.boxes[0][2]

    @property
    def max_reverse_m(self) -> float:
        """The most that is driven in reverse in one manoeuvre, wherever another path leads on (m)."""
        return MAX_REVERSE_LENGTHS * self.length_m
