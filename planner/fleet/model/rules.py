"""The rules by which a fleet is watched and driven, and the refusals of its fleet manager."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from fields.errors import HeadlandError
from fields.units import MPS_PER_KMH

SHORTEST_HORIZON_S, LONGEST_HORIZON_S = 2.0, 600.0
STATE_PERIOD_S = 0.1  # between two states of a tractor
REFRESH_PERIOD_S = 1.0  # of what need not be quicker: forecasts, coverage, saved fleets, checks of twins and tokens
MAY_BE_ZERO = frozenset({"fence_margin_m", "clearance_m", "beside_m", "release_m", "release_s", "obstacle_margin_m"})


class FleetManagerError(HeadlandError):
    """An order or report that cannot be accepted now: one sentence with the value, the rule and the fix."""


class ControlLeaseError(FleetManagerError):
    """Another operator drives that tractor."""


@dataclass(frozen=True)
class FleetRules:
    """Distances in metres, times in seconds of real time.

    A link counts as broken after `silence_s` without a frame; after the same silence a tractor stops if it is driven by
    remote control or follows another one. The base reaches as far ahead as a tractor drives in `base_s`, at least
    `base_m`. A tractor that has heard nothing for `horizon_s` stops, also on base legs; that is real time, so at
    `times` 3 it drives three times as far without contact as at 1. Remote control must repeat its commands within
    `dead_man_s` and drives at most `remote_mps`. Tractors stay inside the fence, the outline of the driven ground
    widened by `fence_margin_m`. Paths are predicted `ahead_s`; two tractors that would come nearer than `clearance_m`
    (`beside_m` side by side) raise an alarm, and are stopped when only `reaction_s` and braking at `deceleration_mps2`
    remain. They resume once their path has been clear by `release_m` more for `release_s` of the fleet's clock, see
    planner.fleet.manager.danger_watch. `times` is how much faster than real time the fleet runs.
    """

    silence_s: float = 1.0
    heartbeat_s: float = 0.2
    base_s: float = 6.0
    base_m: float = 10.0
    horizon_s: float = 20.0
    dead_man_s: float = 0.5
    remote_mps: float = 5.0 * MPS_PER_KMH
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
            least = 0.0 if name in MAY_BE_ZERO else 1e-3
            if not (math.isfinite(value) and value >= least):
                raise FleetManagerError(
                    f"{name} is {value}; it must be a number of at least {least:g}.", parameter=name
                )
        if not SHORTEST_HORIZON_S <= self.horizon_s <= LONGEST_HORIZON_S:
            raise FleetManagerError(
                f"horizon_s is {self.horizon_s:g}; use {SHORTEST_HORIZON_S:g} to {LONGEST_HORIZON_S:g} seconds.",
                parameter="horizon_s",
            )
        if self.times > 100.0:
            raise FleetManagerError(
                f"times is {self.times:g}; a fleet runs at most 100 times as fast as real time.", parameter="times"
            )
