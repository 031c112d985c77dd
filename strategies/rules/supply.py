"""What a tractor carries and uses at work, or collects, and where it is refilled or emptied."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from vehicle.missions.plan import REFILL, Leg

PLACE, HEADLAND, SERVICE_VEHICLE = "place", "headland", "tender"
Point = tuple[float, float]
LEAST_LOAD_M = 50.0  # of work that a load lasts for at least: with less a tractor does little but stop


@dataclass(frozen=True)
class Supply:
    """A tank, the same on every tractor: capacity in litres or kilograms, use per square metre worked.

    It starts full and empties at work; a tank that `collects` starts empty and fills. A stop of `stop_s` seconds
    refills (or empties) it: at a `place` (x, y in m) with room for one tractor at a time, at the end of a swath on the
    headland, or there by a service vehicle that serves one tractor at a time.
    """

    capacity: float
    rate_per_m2: float
    stop_s: float
    collects: bool = False
    served_at: str = HEADLAND
    place: Point | None = None

    @property
    def one_at_a_time(self) -> bool:
        """Whether tractors are served one at a time."""
        return self.served_at != HEADLAND

    def compute_need(self, length_m: float, width_m: float) -> float:
        """What this work takes of a load (l or kg)."""
        return self.rate_per_m2 * length_m * width_m

    @property
    def service(self) -> str:
        """What a stop is for: REFILL, also where a tank is emptied."""
        return REFILL

    @property
    def load_text(self) -> str:
        """A load in words."""
        return f"a load of {self.capacity:g}"

    def compute_legs_need(self, legs: Sequence[Leg], width_m: float) -> float:
        """What legs take of a load (l or kg), those on which the implement works."""
        return self.compute_need(math.fsum(leg.length_m for leg in legs if leg.implement), width_m)

    def estimate_stop_s(self, total: float) -> float:
        """How long a stop takes in the mean, where the work takes this total."""
        return self.stop_s

    def compute_stop_s(self, amount: float) -> float:
        """How long a stop with this amount takes."""
        return self.stop_s

    def list_amounts(self, loads: Sequence[float]) -> list[float]:
        """What is filled in, or taken out, at each stop between loads: what was used before."""
        return list(loads[:-1])

    def include_trips(self) -> Supply:
        """The same for loads that count the ways to the place and back leg by leg."""
        return self

    def explain_least_load(self, width_m: float) -> str | None:
        """Why a load does not even last for LEAST_LOAD_M of work of this width; None where it does."""
        need = self.compute_need(LEAST_LOAD_M, width_m)
        return self.explain_small_load(need) if need > self.capacity else None

    def explain_small_load(self, need: float) -> str:
        """Why a piece of work cannot be done with one load, and what helps."""
        return (
            f"Work between two stops takes at least {need:.3g} l or kg, and a load is {self.capacity:g}; use a larger "
            "tank or a lower rate."
        )
