"""By what rules a fleet is watched and driven."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from planner.service.centre.errors import CentreError

KMH = 1.0 / 3.6
MAY_BE_NONE = frozenset({"fence_margin_m", "clearance_m", "beside_m", "release_m", "release_s", "obstacle_margin_m"})


@dataclass(frozen=True)
class Rules:
    """Distances in metres, times in seconds of the clock on the wall.

    A tractor is believed lost after `silence_s` without a frame, and itself stops after as much silence of the centre.
    Legs are released so far ahead as is driven in `base_s`, `base_m` at the least. Whoever drives by remote control
    must say so again within `dead_man_s`, and goes no faster than `remote_mps`. Tractors keep inside the fence, the
    outline of what they drive widened by `fence_margin_m`. Paths are foreseen `ahead_s`; two that would come nearer to
    each other than `clearance_m` are told of, and stopped when `reaction_s` and the way to brake at
    `deceleration_mps2` are left. Who stands for that goes on once its way has been clear of `release_m` more for
    `release_s` of the fleet's clock, see planner.service.centre.nearness. `times` is how much faster than real time
    the fleet runs.
    """

    silence_s: float = 1.0
    beat_s: float = 0.2
    base_s: float = 6.0
    base_m: float = 10.0
    dead_man_s: float = 0.5
    remote_mps: float = 5.0 * KMH
    fence_margin_m: float = 2.0
    ahead_s: float = 5.0
    clearance_m: float = 0.5
    beside_m: float = 0.5
    release_m: float = 0.15
    release_s: float = 2.0
    reaction_s: float = 0.5
    deceleration_mps2: float = 0.7
    obstacle_margin_m: float = 0.5
    rejoin_m: float = 3.0
    times: float = 1.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            least = 0.0 if name in MAY_BE_NONE else 1e-3
            if not (math.isfinite(value) and value >= least):
                raise CentreError(f"{name} is {value}; it must be a number of at least {least:g}.", parameter=name)
        if self.times > 100.0:
            raise CentreError(f"times is {self.times:g}; a fleet runs at most 100 times as fast as real time.",
                              parameter="times")  # fmt: skip

    def told(self) -> dict[str, Any]:
        """All of them by name."""
        return asdict(self)
