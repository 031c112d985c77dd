"""What measured logs show and no effect of the catalogue explains: a few linear terms, kept where they were seen.

A tractor file may carry such a rest. It is told from data and names no cause, so it is trusted only inside the speeds
and wheel angles of the logs it came from and fades to nothing within a tenth of their range beyond them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from vehicle.errors import VehicleError

FADE = 0.1
MOST = 1e6  # of any unit: more is no amount but a slip


@dataclass(frozen=True)
class RestTerm:
    """One term: what it changes, what it is proportional to, the unit of its amount and an ordinary amount.

    `scale` turns the amount of a file into that of MODEL. Terms `..._to_east` and `..._to_north` are the components of
    one direction.
    """

    id: str
    changes: str
    on: str
    unit: str
    typical: float
    scale: float = 1.0

    @property
    def field(self) -> str:
        """Field of MODEL."""
        return f"rest_{self.id}"


ANGLE, GRIP, PUSH = "an extra wheel angle", "a change of grip", "a push over the ground"
DIRECTION, SIZE = "the direction of travel", "the size of the wheel angle"
WAY = "the direction of travel and the time on the way"
REST: tuple[RestTerm, ...] = (
    RestTerm("angle_by_speed", ANGLE, "speed", "deg per m/s", 0.5, math.radians(1.0)),
    RestTerm("angle_by_square", ANGLE, "the square of speed", "deg per (m/s)2", 0.3, math.radians(1.0)),
    RestTerm("angle_to_east", ANGLE, DIRECTION, "deg", 1.0, math.radians(1.0)),
    RestTerm("angle_to_north", ANGLE, DIRECTION, "deg", 1.0, math.radians(1.0)),
    RestTerm("grip_by_speed", GRIP, "speed", "per m/s", 0.1),
    RestTerm("grip_by_angle", GRIP, SIZE, "per deg", 0.01, math.degrees(1.0)),
    RestTerm("grip_by_implement", GRIP, "the implement", "", 0.1),
    RestTerm("grip_to_east", GRIP, DIRECTION, "", 0.1),
    RestTerm("grip_to_north", GRIP, DIRECTION, "", 0.1),
    RestTerm("push_to_east", PUSH, WAY, "m/s", 0.05),
    RestTerm("push_to_north", PUSH, WAY, "m/s", 0.05),
)
BY_NAME = {term.id: term for term in REST}
NEUTRAL_REST: dict[str, float] = {
    "rest": 0.0, "rest_slow": -math.inf, "rest_fast": math.inf, "rest_left": -math.inf, "rest_right": math.inf,
    **{term.field: 0.0 for term in REST},
}  # fmt: skip


def rest_fields(amounts: Mapping[str, float]) -> dict[str, float]:
    """Fields of MODEL for amounts per term. Raises VehicleError for an unknown term or an amount that is no number."""
    fields = {"rest": float(bool(amounts))}
    for name, amount in amounts.items():
        if name not in BY_NAME:
            raise VehicleError(f"The rest has a term {name!r}; use some of: {', '.join(BY_NAME)}.")
        if not abs(amount) <= MOST:
            raise VehicleError(f"The rest has {name} = {amount:g}; give a finite number from {-MOST:g} to {MOST:g}.")
        fields[BY_NAME[name].field] = amount * BY_NAME[name].scale
    return fields


def range_fields(speed_mps: tuple[float, float], angle_deg: tuple[float, float]) -> dict[str, float]:
    """Fields of MODEL for the speeds and wheel angles inside which a rest was seen."""
    return {
        "rest_slow": speed_mps[0], "rest_fast": speed_mps[1],
        "rest_left": math.radians(angle_deg[0]), "rest_right": math.radians(angle_deg[1]),
    }  # fmt: skip
