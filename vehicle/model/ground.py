"""Grounds and tyres: side friction and rolling resistance, for plans and for the experiments of the thesis."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from vehicle.errors import VehicleError

TYRE_MODELS = ("kinematic", "linear", "nonlinear")
NO_LIMIT_DEG = 90.0
STIFF_PER_DEG = 50.0  # "a very large constant value" (section 4.3): 0.01 degrees of slip carry half the load
# Slope per degree and limit, front and rear, of the non-linear model, and slopes of the linear one; rolling resistance
# and grip are assumed. The thesis gives no tyres for soil: those of section 4.3, which names no ground and which
# chapter 6 uses, are taken for it.
_TYRE_VALUES = {
    "asphalt": ((0.15, 0.2), (5.0, 5.0), (0.15, 0.2), 0.02, 0.8),
    "soil": ((0.005, 0.01), (5.0, 5.0), (0.005, 0.01), 0.06, 0.2),
    "mud": ((0.03, 0.04), (2.0, 2.0), (0.0225, 0.03), 0.10, 0.4),
}
TYRE_GROUNDS = tuple(_TYRE_VALUES)


class FrictionCurve(BaseModel):
    """Friction curve of a game engine's wheel: linear to the peak, linear to the slide, constant beyond.

    It is read at the slip atan(sideways / (forward + ease)); some engines use an ease of 1 m/s.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    peak_slip_rad: float = Field(default=0.2, gt=0)
    peak: float = Field(default=1.0, gt=0)
    slide_slip_rad: float = Field(default=0.5, gt=0)
    slide: float = Field(default=0.75, ge=0)
    ease_mps: float = Field(default=0.0, ge=0)


ENGINE_CURVE = FrictionCurve()


class Tyres(BaseModel):
    """Side friction of front and rear tyres per degree of slip (Eq. 4.3, 4.4), where it stops growing, and rolling.

    `curve`, if any, multiplies the side friction; `grip`, if any, is the largest drive force of the rear wheels over
    their load, and drive force reduces their side force (friction circle).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    front_slope_per_deg: float = Field(gt=0)
    front_limit_deg: float = Field(gt=0, le=NO_LIMIT_DEG)
    rear_slope_per_deg: float = Field(gt=0)
    rear_limit_deg: float = Field(gt=0, le=NO_LIMIT_DEG)
    rolling_resistance: float = Field(default=0.0, ge=0, lt=1)
    grip: float | None = Field(default=None, gt=0)
    curve: FrictionCurve | None = None


class GroundType(Tyres):
    """A ground that plans are driven on, with plain tyres."""

    name: str
    source: str


# The base model uses the asphalt tyres of section 4.4 on both grounds: the influence of soil on the path is in the
# measured radii (Eq. 2.10), which the steering table reproduces on top of this base.
GROUNDS = tuple(
    GroundType(
        name=name,
        front_slope_per_deg=0.15,
        front_limit_deg=5.0,
        rear_slope_per_deg=0.2,
        rear_limit_deg=5.0,
        rolling_resistance=rolling,
        source="thesis, section 4.4; resistance assumed",
    )
    for name, rolling in (("asphalt", 0.02), ("soil", 0.06))
)


def list_ground_names() -> tuple[str, ...]:
    """Names of the grounds, in the order the compiled tables use."""
    return tuple(ground.name for ground in GROUNDS)


def find_ground_index(name: str) -> int:
    """Row of a ground in the tables. Raises VehicleError for an unknown ground."""
    names = list_ground_names()
    if name not in names:
        raise VehicleError(f"The ground {name!r} is unknown; use one of: {', '.join(names)}.", parameter="ground")
    return names.index(name)


def get_tyres(ground: str, model: str, *, curve: FrictionCurve | None = ENGINE_CURVE) -> Tyres:
    """Tyres of the thesis on a ground (section 4.3 and 4.4); the kinematic model has no curve and no friction circle.

    Raises VehicleError for an unknown ground or model.
    """
    if ground not in _TYRE_VALUES:
        raise VehicleError(f"The ground {ground!r} is unknown; use one of: {', '.join(TYRE_GROUNDS)}.")
    if model not in TYRE_MODELS:
        raise VehicleError(f"The tyre model {model!r} is unknown; use one of: {', '.join(TYRE_MODELS)}.")
    slopes, limits, linear_slopes, rolling, grip = _TYRE_VALUES[ground]
    if model != "nonlinear":
        slopes = linear_slopes if model == "linear" else (STIFF_PER_DEG, STIFF_PER_DEG)
        limits = NO_LIMIT_DEG, NO_LIMIT_DEG
    return Tyres(
        front_slope_per_deg=slopes[0],
        front_limit_deg=limits[0],
        rear_slope_per_deg=slopes[1],
        rear_limit_deg=limits[1],
        rolling_resistance=rolling,
        grip=None if model == "kinematic" else grip,
        curve=None if model == "kinematic" else curve,
    )
