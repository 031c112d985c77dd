"""The discrepancy model: a few linear terms for what measured logs show and no effect of the catalogue explains.

It is fitted to data and names no cause, so it is trusted only inside the speeds and wheel angles of its logs and fades
to nothing within a tenth of their range beyond them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vehicle.errors import VehicleError

FADE_SHARE = 0.1
MAX_AMOUNT = 1e6  # in any unit: more is a typing error
ANGLE, GRIP, PUSH = "an extra wheel angle", "a change of grip", "a push over the ground"
DIRECTION, SIZE = "the direction of travel", "the size of the wheel angle"
DIRECTION_AND_TIME = "the direction of travel and the driving time"


@dataclass(frozen=True)
class DiscrepancyTerm:
    """One term: what it changes (`effect`), what it is proportional to, the unit of its amount and a typical amount.

    `scale` converts the amount of a file to that of MODEL. Terms `..._to_east` and `..._to_north` are the components
    of one direction.
    """

    id: str
    effect: str
    regressor: str
    unit: str
    typical: float
    scale: float = 1.0

    @property
    def model_field(self) -> str:
        """Field of MODEL."""
        return f"discrepancy_{self.id}"


DISCREPANCY_TERMS: tuple[DiscrepancyTerm, ...] = (
    DiscrepancyTerm("angle_by_speed", ANGLE, "speed", "deg per m/s", 0.5, math.radians(1.0)),
    DiscrepancyTerm("angle_by_square", ANGLE, "the square of speed", "deg per (m/s)2", 0.3, math.radians(1.0)),
    DiscrepancyTerm("angle_to_east", ANGLE, DIRECTION, "deg", 1.0, math.radians(1.0)),
    DiscrepancyTerm("angle_to_north", ANGLE, DIRECTION, "deg", 1.0, math.radians(1.0)),
    DiscrepancyTerm("grip_by_speed", GRIP, "speed", "per m/s", 0.1),
    DiscrepancyTerm("grip_by_angle", GRIP, SIZE, "per deg", 0.01, math.degrees(1.0)),
    DiscrepancyTerm("grip_by_implement", GRIP, "the implement", "", 0.1),
    DiscrepancyTerm("grip_to_east", GRIP, DIRECTION, "", 0.1),
    DiscrepancyTerm("grip_to_north", GRIP, DIRECTION, "", 0.1),
    DiscrepancyTerm("push_to_east", PUSH, DIRECTION_AND_TIME, "m/s", 0.05),
    DiscrepancyTerm("push_to_north", PUSH, DIRECTION_AND_TIME, "m/s", 0.05),
)
TERMS_BY_NAME = {term.id: term for term in DISCREPANCY_TERMS}
NEUTRAL_DISCREPANCY: dict[str, float] = {
    "discrepancy_model": 0.0,
    "discrepancy_slow": -math.inf,
    "discrepancy_fast": math.inf,
    "discrepancy_left": -math.inf,
    "discrepancy_right": math.inf,
    **{term.model_field: 0.0 for term in DISCREPANCY_TERMS},
}


def compute_discrepancy_fields(amounts: Mapping[str, float]) -> dict[str, float]:
    """Fields of MODEL for amounts per term. Raises VehicleError for an unknown term or an amount out of range."""
    fields = {"discrepancy_model": float(bool(amounts))}
    for name, amount in amounts.items():
        if name not in TERMS_BY_NAME:
            raise VehicleError(
                f"The discrepancy model has the unknown term {name!r}; use terms from: {', '.join(TERMS_BY_NAME)}."
            )
        if not abs(amount) <= MAX_AMOUNT:
            raise VehicleError(
                f"The discrepancy model has {name} = {amount:g}; give a finite number from {-MAX_AMOUNT:g} to "
                f"{MAX_AMOUNT:g}."
            )
        fields[TERMS_BY_NAME[name].model_field] = amount * TERMS_BY_NAME[name].scale
    return fields


def compute_range_fields(speed_mps: tuple[float, float], angle_deg: tuple[float, float]) -> dict[str, float]:
    """Fields of MODEL for the speeds and wheel angles of the logs a discrepancy model was fitted to."""
    return {
        "discrepancy_slow": speed_mps[0],
        "discrepancy_fast": speed_mps[1],
        "discrepancy_left": math.radians(angle_deg[0]),
        "discrepancy_right": math.radians(angle_deg[1]),
    }
