"""The battery of an electric tractor as what it carries: used by driving and work, charged or changed at service stops.

Every need is that of vehicle.energy.run_energy with a share on top for what an estimate cannot know. A stop charges
what the work up to the next stop needs, so all stops of a tractor together charge what its work takes beyond the first
full battery; a battery that is changed is full again.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from strategies.rules.supply import Supply
from vehicle.energy.run_energy import LegMeter
from vehicle.missions.plan import Leg

CHARGE, CHANGE = "charge", "change"  # what a stop is for, besides refills
ESTIMATE_MARGIN = 0.05  # share that needs are taken to be greater than estimated: bends, waiting, corrections


@dataclass(frozen=True, kw_only=True)
class BatterySupply(Supply):
    """The energy of a battery in kWh: `capacity` is what lasts from stop to stop, `rate_per_m2` that of level swaths.

    Attributes:
        meter: estimates the energy of legs.
        turn_kwh: usual turn between two swaths.
        trip_kwh: the most that the way to the place takes, or the way back; 0 without a place. `capacity` is without
            both.
    """

    meter: LegMeter
    turn_kwh: float = 0.0
    trip_kwh: float = 0.0

    @property
    def usable_kwh(self) -> float:
        """What a full battery gives down to its reserve."""
        return self.meter.drive.usable_kwh

    @property
    def service(self) -> str:
        """What a stop is for: CHARGE or CHANGE."""
        return CHARGE if self.meter.drive.battery.change_s is None else CHANGE

    @property
    def load_text(self) -> str:
        """A load in words."""
        return f"a battery with {self.usable_kwh:.3g} kWh to use"

    def compute_need(self, length_m: float, width_m: float) -> float:
        """What a swath with the turn to it takes."""
        return self.turn_kwh + super().compute_need(length_m, width_m)

    def compute_legs_need(self, legs: Sequence[Leg], width_m: float) -> float:
        """What all legs take, those between work included."""
        return (1.0 + ESTIMATE_MARGIN) * math.fsum(self.meter.compute_leg_kwh(leg) for leg in legs)

    def estimate_stop_s(self, total: float) -> float:
        """The mean time of the fewest stops for a total of work."""
        stops = max(math.ceil(total / self.capacity) - 1, 1)
        return self.compute_stop_s(max(total - self.usable_kwh, 0.0) / stops + 2.0 * self.trip_kwh)

    def compute_stop_s(self, amount: float) -> float:
        """How long a stop with this amount takes."""
        return self.meter.drive.compute_charge_s(amount)

    def list_amounts(self, loads: Sequence[float]) -> list[float]:
        """What is charged at each stop between loads; the battery is full at first."""
        level, amounts = self.usable_kwh - loads[0] - self.trip_kwh, list[float]()
        for number, (_, load) in enumerate(pairwise(loads), start=1):
            needed = load + self.trip_kwh * (1 if number == len(loads) - 1 else 2)
            room = self.usable_kwh - level
            amount = room if self.meter.drive.battery.change_s is not None else min(max(needed - level, 0.0), room)
            amounts.append(amount)
            level += amount - needed
        return amounts

    def include_trips(self) -> BatterySupply:
        """The same for loads that count the ways to the place and back leg by leg, so that nothing is set apart."""
        return replace(self, capacity=self.usable_kwh, trip_kwh=0.0)

    def explain_small_load(self, need: float) -> str:
        """Why a piece of work cannot be done with one load, and what helps."""
        left_kwh = f"{max(self.capacity, 0.0):.3g}"
        if self.trip_kwh:
            return (
                f"Work between two stops takes at least {need:.3g} kWh, and of the battery {left_kwh} kWh can be used "
                "for it besides the way to the charger and back; use a nearer charger, a larger battery or a smaller "
                "reserve."
            )
        return (
            f"Work between two stops takes at least {need:.3g} kWh, and of the battery {left_kwh} kWh can be used for "
            "it; use a larger battery, a smaller reserve or a narrower implement."
        )
