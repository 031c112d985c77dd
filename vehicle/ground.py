"""Grounds a tractor drives on: side friction of the tyres and rolling resistance."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from vehicle.errors import VehicleError


class Ground(BaseModel):
    """Side friction per degree of slip (Eq. 4.3, 4.4), where it stops growing, and rolling resistance."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: str
    front_slope_per_deg: float = Field(gt=0)
    front_limit_deg: float = Field(gt=0)
    rear_slope_per_deg: float = Field(gt=0)
    rear_limit_deg: float = Field(gt=0)
    rolling_resistance: float = Field(ge=0, lt=1)
    source: str


# The base model of both grounds carries the asphalt tyres of section 4.4: what soil does to the path is in the
# measured radii (Eq. 2.10), which the steering table reproduces on top of this base.
_BASE = {
    "front_slope_per_deg": 0.15,
    "front_limit_deg": 5.0,
    "rear_slope_per_deg": 0.2,
    "rear_limit_deg": 5.0,
}
GROUNDS = (
    Ground(name="asphalt", rolling_resistance=0.02, source="thesis, section 4.4; resistance assumed", **_BASE),
    Ground(name="soil", rolling_resistance=0.06, source="thesis, section 4.4; resistance assumed", **_BASE),
)


def ground_names() -> tuple[str, ...]:
    """Names of the grounds, in the order the compiled tables use."""
    return tuple(ground.name for ground in GROUNDS)


def ground_index(name: str) -> int:
    """Row of a ground in the tables; refuses an unknown one."""
    if name not in ground_names():
        raise VehicleError(f"The ground {name!r} is unknown; use one of: {', '.join(ground_names())}.")
    return ground_names().index(name)
