"""What a tractor has to pull and carry at work, and what its engine and tyres can give."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

from fields.arrays import Floats
from vehicle.errors import VehicleError, check_range

DRAFT_TERMS = 3
Speed = TypeVar("Speed", float, Floats)


@dataclass(frozen=True)
class WorkLoad:
    """Everything about forces that neither the tractor's steering nor the implement's size says; all neutral at first.

    Attributes:
        draft_n: d0, d1, d2 (N, N s/m, N s2/m2): the implement pulls back with d0 + d1 v + d2 v^2 while it works.
        implement_mass_kg: carried or drawn besides the tractor's own mass.
        rolling_share: resistance to rolling over weight without slip, of all wheels; None for that of each ground. With
            a mobility number it is at least 1 / Bn, which the soil takes before a wheel pulls anything.
        engine_power_w: at the flywheel.
        driveline_efficiency: share of the engine's power that reaches the driven axles.
        driven_share: share of the whole weight that stands on driven wheels.
        mobility_number: Bn of the driven wheels (vehicle.energy.traction); None for wheels that neither slip nor spin.
        max_slip: wheels are not driven with more slip.
        centre_height_m: height of the common centre of mass above the ground; None where it is not known.

    Raises VehicleError for a value that nothing can have.
    """

    draft_n: tuple[float, float, float] = (0.0, 0.0, 0.0)
    implement_mass_kg: float = 0.0
    rolling_share: float | None = None
    engine_power_w: float = math.inf
    driveline_efficiency: float = 1.0
    driven_share: float = 1.0
    mobility_number: float | None = None
    max_slip: float = 0.3
    centre_height_m: float | None = None

    def __post_init__(self) -> None:
        if len(self.draft_n) != DRAFT_TERMS or not all(math.isfinite(term) and term >= 0.0 for term in self.draft_n):
            raise VehicleError(f"The draft {self.draft_n} is none; give three forces of 0 or more (N, N s/m, N s2/m2).")
        check_range("The mass of the implement", self.implement_mass_kg, 0.0, 100_000.0, "kg")
        check_range("The power of the engine", self.engine_power_w, 1.0, math.inf, "W")
        check_range("The efficiency of the driveline", self.driveline_efficiency, 0.05, 1.0)
        check_range("The share of the weight on driven wheels", self.driven_share, 0.05, 1.0)
        check_range("The largest slip", self.max_slip, 0.01, 0.9)
        if self.rolling_share is not None:
            check_range("The resistance to rolling", self.rolling_share, 0.0, 1.0, "of the weight")
        if self.mobility_number is not None:
            check_range("The mobility number", self.mobility_number, 0.5, 1e6)
            _check_soil_resistance(self.rolling_share, self.mobility_number)
        if self.centre_height_m is not None:
            check_range("The height of the centre of mass", self.centre_height_m, 0.01, 10.0, "m")

    @property
    def axle_power_w(self) -> float:
        """Power that reaches the driven axles."""
        return self.engine_power_w * self.driveline_efficiency

    def compute_draft_n(self, speed_mps: Speed) -> Speed:
        """Pull of the working implement at a speed over ground, or at several."""
        constant, linear, square = self.draft_n
        return constant + (linear + square * speed_mps) * speed_mps


def _check_soil_resistance(rolling_share: float | None, mobility: float) -> None:
    """Refuse less resistance than the soil takes: wheels would have a thrust below 0 at rest, and roll backwards."""
    if rolling_share is not None and rolling_share >= 1.0 / mobility:
        return
    given = "that of each ground" if rolling_share is None else f"{rolling_share:g} of the weight"
    raise VehicleError(
        f"The resistance to rolling is {given}, and a soil with the mobility number {mobility:g} takes "
        f"{1.0 / mobility:.3g} alone; give that and what the tyres take, about 0.04."
    )
