"""What a datasheet says of a tractor: values, what is usual, and what cannot be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from fields.errors import named
from vehicle.errors import VehicleError
from vehicle.faults import faults_of

SHARPEST_DEG = 50.0  # no front axle turns its wheels further in the mean of both
LONGEST_SHARE = 3.5
CENTRE, OUTER_WHEEL = "centre", "outer-wheel"


@dataclass(frozen=True)
class Quantity:
    """A value of a datasheet: what it is, its unit, what can be and what is usual."""

    words: str
    unit: str
    low: float
    high: float
    usual_low: float
    usual_high: float
    usual: float

    @property
    def told(self) -> str:
        """What it is and usually is, for a sentence."""
        return f"{self.words}, {self.unit}, usually {self.usual_low:g} to {self.usual_high:g}"


QUANTITIES: Mapping[str, Quantity] = {
    "wheelbase_m": Quantity("distance between the axles", "m", 0.5, 5.0, 1.0, 3.5, 2.4),
    "width_m": Quantity("width over all", "m", 0.3, 5.0, 0.8, 3.0, 2.0),
    "turning_radius_m": Quantity("radius at full lock, half the turning circle", "m", 0.8, 25.0, 2.0, 8.0, 5.0),
    "mass_kg": Quantity("mass ready to work", "kg", 20.0, 60_000.0, 500.0, 16_000.0, 5000.0),
    "power_kw": Quantity("power of the engine", "kW", 0.5, 1000.0, 10.0, 400.0, 80.0),
    "length_m": Quantity("length over all", "m", 0.3, 15.0, 2.0, 7.0, 4.3),
    "track_m": Quantity("distance between the wheels of an axle", "m", 0.2, 5.0, 0.8, 2.3, 1.6),
    "rear_overhang_m": Quantity("what reaches behind the rear axle", "m", 0.0, 6.0, 0.3, 1.2, 0.75),
    "max_steering_deg": Quantity("wheel angle at full lock", "degrees", 5.0, 59.0, 25.0, 55.0, 35.0),
    "steering_rate_deg_per_s": Quantity("how fast the wheels turn over", "degrees per s", 1.0, 500.0, 10.0, 60.0, 16.0),
    "front_share": Quantity("share of the weight on the front axle", "of 1", 0.2, 0.8, 0.35, 0.55, 0.4),
    "antenna_forward_m": Quantity("antenna ahead of the rear axle", "m", -3.0, 10.0, 0.0, 2.0, 1.1),
}
"""Every number of a datasheet, by the name it has there."""

NEEDED = ("wheelbase_m", "width_m", "turning_radius_m")
Number = Annotated[float, Field(strict=True)]


class Datasheet(BaseModel):
    """Numbers of a datasheet, of which the first three are needed; what is None follows from rules.

    `turning_radius_m` is that of the middle of the tractor ("centre") or, with `radius_of` "outer-wheel", of the
    outer front wheel, as ISO 789-3 has it. `power_kw` serves the mass alone.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    wheelbase_m: Annotated[Number, Field(description=QUANTITIES["wheelbase_m"].told)]
    width_m: Annotated[Number, Field(description=QUANTITIES["width_m"].told)]
    turning_radius_m: Annotated[Number, Field(description=QUANTITIES["turning_radius_m"].told)]
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
    def _possible(self) -> Datasheet:
        faults = _single(self) or _together(self)
        if faults:
            raise VehicleError(f"{'; '.join(faults)}.")
        return self


def lacking(values: Mapping[str, object]) -> list[str]:
    """The values that are needed and missing, each with what it is, its unit and what it usually is."""
    return [f"{named(name)} ({QUANTITIES[name].told})" for name in NEEDED if values.get(name) is None]


def sheet_from(values: Mapping[str, float | str | None]) -> Datasheet:
    """A datasheet of the values that are not None.

    Raises VehicleError, whose sentence names every value that is missing, or every one that cannot be.
    """
    missing = lacking(values)
    if missing:
        raise VehicleError(f"A tractor cannot be made without {' and '.join(missing)}; see its datasheet.")
    kind = values.get("radius_of")
    if kind is not None and kind not in (CENTRE, OUTER_WHEEL):
        raise VehicleError(f"{named('radius_of')} {kind!r} is unknown; use {CENTRE} or {OUTER_WHEEL}.")
    try:
        return Datasheet.model_validate({name: value for name, value in values.items() if value is not None})
    except ValidationError as error:
        for fault in error.errors():
            refusal = fault.get("ctx", {}).get("error")
            if isinstance(refusal, VehicleError):
                raise refusal from None
        raise VehicleError(f"The datasheet cannot be used: {faults_of(error, Datasheet)}.") from None


def _single(sheet: Datasheet) -> list[str]:
    """What is wrong with values on their own."""
    faults = []
    for name, quantity in QUANTITIES.items():
        value = getattr(sheet, name)
        if value is not None and not quantity.low <= value <= quantity.high:
            faults.append(
                f"{named(name)} is {value:g} ({quantity.told}); use {quantity.low:g} to {quantity.high:g}"
                f"{_slip(value, quantity)}"
            )
    return faults


def _slip(value: float, quantity: Quantity) -> str:
    """The value that may be meant, where a decimal point or a prefix of the unit is what is wrong."""
    for factor in (10.0, 100.0, 1000.0, 0.1, 0.01, 0.001):
        if quantity.usual_low <= value / factor <= quantity.usual_high:
            return f", perhaps {value / factor:g}"
    return ""


def _together(sheet: Datasheet) -> list[str]:
    """What is wrong between values that are possible each on its own."""
    faults = []
    base, width, radius = sheet.wheelbase_m, sheet.width_m, sheet.turning_radius_m
    if sheet.length_m is not None and not base <= sheet.length_m <= LONGEST_SHARE * base:
        faults.append(
            f"{named('length_m')} is {sheet.length_m:g} m beside a wheelbase of {base:g} m; a tractor without "
            f"implement is 1 to {LONGEST_SHARE:g} times as long as its wheelbase, usually 1.8 times"
        )
    elif sheet.rear_overhang_m is not None and sheet.length_m is not None and sheet.rear_overhang_m > (
        sheet.length_m - base
    ):
        faults.append(
            f"{named('rear_overhang_m')} is {sheet.rear_overhang_m:g} m, but a length of {sheet.length_m:g} m leaves "
            f"{sheet.length_m - base:g} m beside the wheelbase of {base:g} m; use that or less"
        )
    if sheet.track_m is not None and sheet.track_m > width:
        faults.append(
            f"{named('track_m')} is {sheet.track_m:g} m, wider than the tractor, {width:g} m; it is measured between "
            "the middles of the tyres"
        )
    if not base / 4.0 <= width <= 3.0 * base:
        faults.append(
            f"{named('width_m')} is {width:g} m beside a wheelbase of {base:g} m; a tractor is a quarter to three "
            "times as wide as its wheelbase is long, so check both"
        )
    smallest = smallest_radius_m(sheet)
    if radius < smallest:
        faults.append(
            f"{named('turning_radius_m')} is {radius:g} m, tighter than a wheelbase of {base:g} m turns with "
            f"its wheels at {SHARPEST_DEG:g} degrees; use {math.ceil(100.0 * smallest) / 100.0:.2f} m or more, or "
            f"check {named('wheelbase_m')}"
        )
    return faults


def smallest_radius_m(sheet: Datasheet) -> float:
    """The tightest turning radius, measured as the sheet measures it, that its wheelbase allows."""
    across = sheet.wheelbase_m / math.tan(math.radians(SHARPEST_DEG))
    if sheet.radius_of == OUTER_WHEEL:
        return math.hypot(sheet.wheelbase_m, across + 0.5 * track_m(sheet))
    return math.hypot(antenna_forward_m(sheet), across)


FRONT_SHARE, TRACK_SHARE = 0.4, 0.8


def track_m(sheet: Datasheet) -> float:
    """Distance between the wheels: given, or a share of the width."""
    return sheet.track_m if sheet.track_m is not None else round(TRACK_SHARE * sheet.width_m, 3)


def rear_axle_m(sheet: Datasheet) -> float:
    """The rear axle behind the centre of mass: the front's share of the weight times the wheelbase."""
    share = FRONT_SHARE if sheet.front_share is None else sheet.front_share
    return round(share * sheet.wheelbase_m, 3)


def antenna_forward_m(sheet: Datasheet) -> float:
    """The antenna ahead of the rear axle: given, or above the centre of mass."""
    return rear_axle_m(sheet) if sheet.antenna_forward_m is None else sheet.antenna_forward_m
