"""The values of a maker's datasheet, with the usual and the possible range of each."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from fields.errors import mark_parameter
from vehicle.errors import VehicleError
from vehicle.model.validation_messages import describe_validation_errors

MAX_WHEEL_ANGLE_DEG = 50.0  # mean of both wheels: no front axle turns further
MAX_LENGTH_RATIO = 3.5
CENTRE, OUTER_WHEEL = "centre", "outer-wheel"
REQUIRED_KEYS = ("wheelbase_m", "width_m", "turning_radius_m")
Number = Annotated[float, Field(strict=True)]

FRONT_SHARE, TRACK_SHARE = 0.4, 0.8


@dataclass(frozen=True)
class DatasheetQuantity:
    """A value of a datasheet: label, unit, possible range, usual range and a usual value."""

    label: str
    unit: str
    low: float
    high: float
    usual_low: float
    usual_high: float
    usual: float

    @property
    def description(self) -> str:
        """Label, unit and usual range, for a sentence."""
        return f"{self.label}, {self.unit}, usually {self.usual_low:g} to {self.usual_high:g}"


QUANTITIES: Mapping[str, DatasheetQuantity] = {
    "wheelbase_m": DatasheetQuantity("distance between the axles", "m", 0.5, 5.0, 1.0, 3.5, 2.4),
    "width_m": DatasheetQuantity("width over all", "m", 0.3, 5.0, 0.8, 3.0, 2.0),
    "turning_radius_m": DatasheetQuantity(
        "radius at full lock, half the turning circle", "m", 0.8, 25.0, 2.0, 8.0, 5.0
    ),
    "mass_kg": DatasheetQuantity("mass ready to work", "kg", 20.0, 60_000.0, 500.0, 16_000.0, 5000.0),
    "power_kw": DatasheetQuantity("power of the engine", "kW", 0.5, 1000.0, 10.0, 400.0, 80.0),
    "length_m": DatasheetQuantity("length over all", "m", 0.3, 15.0, 2.0, 7.0, 4.3),
    "track_m": DatasheetQuantity("distance between the wheels of an axle", "m", 0.2, 5.0, 0.8, 2.3, 1.6),
    "rear_overhang_m": DatasheetQuantity("overhang behind the rear axle", "m", 0.0, 6.0, 0.3, 1.2, 0.75),
    "max_steering_deg": DatasheetQuantity("wheel angle at full lock", "degrees", 5.0, 59.0, 25.0, 55.0, 35.0),
    "steering_rate_deg_per_s": DatasheetQuantity(
        "steering rate of the wheels", "degrees per s", 1.0, 500.0, 10.0, 60.0, 16.0
    ),
    "front_share": DatasheetQuantity("share of the weight on the front axle", "of 1", 0.2, 0.8, 0.35, 0.55, 0.4),
    "antenna_forward_m": DatasheetQuantity("antenna ahead of the rear axle", "m", -3.0, 10.0, 0.0, 2.0, 1.1),
}
"""Every number of a datasheet, by its key."""


class Datasheet(BaseModel):
    """Numbers of a datasheet. The first three are required; those that are None follow from rules.

    `turning_radius_m` is the radius of the middle of the tractor ("centre") or, with `radius_of` "outer-wheel", of the
    outer front wheel (ISO 789-3). `power_kw` says what it can pull, and estimates an unknown mass.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    wheelbase_m: Annotated[Number, Field(description=QUANTITIES["wheelbase_m"].description)]
    width_m: Annotated[Number, Field(description=QUANTITIES["width_m"].description)]
    turning_radius_m: Annotated[Number, Field(description=QUANTITIES["turning_radius_m"].description)]
    mass_kg: Number | None = None
    power_kw: Number | None = None
    length_m: Number | None = None
    track_m: Number | None = None
    rear_overhang_m: Number | None = None
    max_steering_deg: Number | None = None
    steering_rate_deg_per_s: Number | None = None
    front_share: Number | None = None
    antenna_forward_m: Number | None = None
    radius_of: Literal["centre", "outer-wheel"] = "centre"

    @model_validator(mode="after")
    def _check_values_and_consistency(self) -> Datasheet:
        faults = _find_value_faults(self) or _find_contradictions(self)
        if faults:
            raise VehicleError(f"{'; '.join(faults)}.")
        return self


def list_missing(values: Mapping[str, object]) -> list[str]:
    """The required values that are missing, each with its label, unit and usual range."""
    return [
        f"{mark_parameter(name)} ({QUANTITIES[name].description})" for name in REQUIRED_KEYS if values.get(name) is None
    ]


def build_datasheet(values: Mapping[str, float | str | None]) -> Datasheet:
    """A datasheet of the values that are not None.

    Raises VehicleError naming every missing value, or every impossible one.
    """
    missing = list_missing(values)
    if missing:
        raise VehicleError(f"A tractor file needs {' and '.join(missing)}; see the datasheet.")
    kind = values.get("radius_of")
    if kind is not None and kind not in (CENTRE, OUTER_WHEEL):
        raise VehicleError(f"{mark_parameter('radius_of')} {kind!r} is unknown; use {CENTRE} or {OUTER_WHEEL}.")
    try:
        return Datasheet.model_validate({name: value for name, value in values.items() if value is not None})
    except ValidationError as error:
        for fault in error.errors():
            refusal = fault.get("ctx", {}).get("error")
            if isinstance(refusal, VehicleError):
                raise refusal from None
        raise VehicleError(f"The datasheet cannot be used: {describe_validation_errors(error, Datasheet)}.") from None


def _find_value_faults(sheet: Datasheet) -> list[str]:
    """Faults of single values."""
    faults = []
    for name, quantity in QUANTITIES.items():
        value = getattr(sheet, name)
        if value is not None and not quantity.low <= value <= quantity.high:
            faults.append(
                f"{mark_parameter(name)} is {value:g} ({quantity.description}); use {quantity.low:g} to "
                f"{quantity.high:g}{_suggest_value(value, quantity)}"
            )
    return faults


def _suggest_value(value: float, quantity: DatasheetQuantity) -> str:
    """The value that may be meant if a decimal point or a unit prefix is wrong; "" if none."""
    for factor in (10.0, 100.0, 1000.0, 0.1, 0.01, 0.001):
        if quantity.usual_low <= value / factor <= quantity.usual_high:
            return f", perhaps {value / factor:g}"
    return ""


def _find_contradictions(sheet: Datasheet) -> list[str]:
    """Contradictions between values that are possible each on its own."""
    faults = []
    base, width, radius = sheet.wheelbase_m, sheet.width_m, sheet.turning_radius_m
    if sheet.length_m is not None and not base <= sheet.length_m <= MAX_LENGTH_RATIO * base:
        faults.append(
            f"{mark_parameter('length_m')} is {sheet.length_m:g} m with a wheelbase of {base:g} m; a tractor without "
            f"implement is 1 to {MAX_LENGTH_RATIO:g} times as long as its wheelbase, usually 1.8 times, so check both"
        )
    elif (
        sheet.rear_overhang_m is not None
        and sheet.length_m is not None
        and sheet.rear_overhang_m > (sheet.length_m - base)
    ):
        faults.append(
            f"{mark_parameter('rear_overhang_m')} is {sheet.rear_overhang_m:g} m, but a length of {sheet.length_m:g} m "
            f"and a wheelbase of {base:g} m leave {sheet.length_m - base:g} m; use that or less"
        )
    if sheet.track_m is not None and sheet.track_m > width:
        faults.append(
            f"{mark_parameter('track_m')} is {sheet.track_m:g} m, wider than the tractor ({width:g} m); measure it "
            "between the middles of the tyres"
        )
    if not base / 4.0 <= width <= 3.0 * base:
        faults.append(
            f"{mark_parameter('width_m')} is {width:g} m with a wheelbase of {base:g} m; a tractor is a quarter to "
            "three times as wide as its wheelbase is long, so check both"
        )
    smallest = compute_smallest_radius_m(sheet)
    if radius < smallest:
        faults.append(
            f"{mark_parameter('turning_radius_m')} is {radius:g} m, tighter than a wheelbase of {base:g} m can turn "
            f"with its wheels at {MAX_WHEEL_ANGLE_DEG:g} degrees; use {math.ceil(100.0 * smallest) / 100.0:.2f} m or "
            f"more, or check {mark_parameter('wheelbase_m')}"
        )
    return faults


def compute_smallest_radius_m(sheet: Datasheet) -> float:
    """The tightest turning radius that the wheelbase allows, measured as the datasheet measures it."""
    across = sheet.wheelbase_m / math.tan(math.radians(MAX_WHEEL_ANGLE_DEG))
    if sheet.radius_of == OUTER_WHEEL:
        return math.hypot(sheet.wheelbase_m, across + 0.5 * compute_wheel_spacing_m(sheet))
    return math.hypot(compute_antenna_forward_m(sheet), across)


def compute_wheel_spacing_m(sheet: Datasheet) -> float:
    """Distance between the wheels: given, or a share of the width."""
    return sheet.track_m if sheet.track_m is not None else round(TRACK_SHARE * sheet.width_m, 3)


def compute_rear_axle_m(sheet: Datasheet) -> float:
    """Distance of the rear axle from the centre of mass: the front axle's share of the weight times the wheelbase."""
    share = FRONT_SHARE if sheet.front_share is None else sheet.front_share
    return round(share * sheet.wheelbase_m, 3)


def compute_antenna_forward_m(sheet: Datasheet) -> float:
    """The antenna ahead of the rear axle: given, or above the centre of mass."""
    return compute_rear_axle_m(sheet) if sheet.antenna_forward_m is None else sheet.antenna_forward_m
