"""Parameters of a tractor and its implement, and the corrections from logs that a tractor file can carry.

Parameters are frozen and validated, and every value has a source. Steering tables, and replays that set their own
effects, use the tractor without corrections (remove_log_corrections).
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, StrictBool, ValidationError, model_validator

from fields.errors import suggest_name
from fields.text_files import quote_path, read_text
from vehicle.errors import VehicleError
from vehicle.model.discrepancy_model import compute_discrepancy_fields, compute_range_fields
from vehicle.model.effects import DISCREPANCY_KEY, check_effect, compute_effect_fields
from vehicle.model.validation_messages import describe_validation_errors, parse_settings

POWER_LAW_M = 118.4  # A in r_p = A / (c |delta|^p), from Table 4.1 and the exponent 1/1.04058 of Eq. 2.9

ROAD_WIDTH_M = 3.0  # of mounted and drawn implements on German roads, at most (StVZO 32)
RADIUS_FACTOR = 1.08  # plans turn this much wider than full lock, to leave guidance room for corrections
FOLD_S = 30.0  # assumed: hydraulic, from the seat and without the locks that a road asks for
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Seconds = Annotated[float, Field(ge=0, allow_inf_nan=False)]
StrictNumber = Annotated[float, Field(strict=True)]  # a limit may be infinite
Settings = Mapping[str, Mapping[str, float]]


def _make_number_type(low: float, high: float, description: str = "") -> Any:
    """A number of a parameter file (no boolean): its limits, and a description with its unit.

    The limits are wide, from a model car of 0.1 m to the largest tractor there is: they keep out wrong units and
    numbers that overflow.
    """
    return Field(ge=low, le=high, strict=True, allow_inf_nan=False, description=description or None)


Metres = Annotated[float, _make_number_type(0.01, 30.0, "m")]


class _FrozenModel(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class SteeringParameters(_FrozenModel):
    """Steering system simulator, Eq. 2.8."""

    dead_band_deg: Annotated[float, _make_number_type(0.0, 45.0, "degrees")] = 0.1
    switch_deg: Annotated[float, _make_number_type(0.001, 360.0, "degrees")] = 5.0
    rate_deg_per_s: Annotated[float, _make_number_type(0.1, 10_000.0, "degrees per s")] = 16.0
    lag_s: Annotated[float, _make_number_type(1e-9, 60.0, "s")] = 0.1
    gain: Annotated[float, _make_number_type(0.001, 100.0, "wheel angle per commanded angle, 1 for a true one")] = 1.0
    latch: StrictBool = True


class GuidanceParameters(_FrozenModel):
    """Steering controller, Eq. 2.5, and its lookahead on swaths and in turns."""

    lateral_gain_deg_per_m: Annotated[float, _make_number_type(0.0, 1e5, "degrees per m")] = 30.0
    heading_gain: Annotated[float, _make_number_type(0.0, 1000.0, "degrees per degree")] = 0.8
    lateral_limit_m: Annotated[float, _make_number_type(0.0001, 1000.0, "m")] = 0.7
    lookahead_m: Annotated[float, _make_number_type(0.001, 1000.0, "m")] = 5.0
    turn_lookahead_m: Annotated[float, _make_number_type(0.001, 1000.0, "m")] = 3.0
    rate_hz: Annotated[float, _make_number_type(0.1, 60.0, "Hz")] = 10.0

    def count_steps(self, dt: float) -> int:
        """Steps of `dt` (s) from one tick of the controller to the next."""
        return max(1, round(1.0 / (self.rate_hz * dt)))


class SpeedParameters(_FrozenModel):
    """Speed controller, Eq. 2.3 with gains in SI units, and the limits of the drive line."""

    proportional_n_s_per_m: Annotated[float, _make_number_type(0.0, 1e8, "N s/m")] = 8000.0
    integral_n_per_m: Annotated[float, _make_number_type(0.0, 1e8, "N/m")] = 3000.0
    derivative_n_s2_per_m: Annotated[float, _make_number_type(0.0, 1e8, "N s2/m")] = 400.0
    max_drive_n: Annotated[float, _make_number_type(0.001, 1e7, "N")] = 15000.0
    max_acceleration_mps2: Annotated[float, _make_number_type(0.001, 100.0, "m/s2")] = 0.7
    max_lateral_mps2: Annotated[float, _make_number_type(0.01, 100.0, "m/s2 in bends, usually 0.7 to 1.5")] = 1.0
    shift_time_s: Annotated[float, _make_number_type(0.0, 600.0, "s")] = 1.5


ShaftPower = Annotated[float, _make_number_type(0.0, 2000.0, "kW")]
FuelRate = Annotated[float, _make_number_type(0.0, 1000.0, "l/h")]


class EngineParameters(_FrozenModel):
    """What the engine gives and how much of it reaches the driven axles."""

    power_kw: Annotated[
        float, _make_number_type(0.01, 2000.0, "kW at the flywheel or of the electric motor, usually 10 to 400")
    ]
    driveline_efficiency: Annotated[float, _make_number_type(0.05, 1.0, "of the power, usually 0.8 to 0.9")] = 0.86
    fuel_points: tuple[tuple[ShaftPower, FuelRate], ...] = Field(
        default=(), description="kW at the shaft and l/h at full throttle, from a test; at least two, or none"
    )

    @model_validator(mode="after")
    def _check_fuel_points(self) -> EngineParameters:
        if len(self.fuel_points) == 1:
            raise ValueError("fuel_points has one pair; give two or more, or none")
        if any(not more[0] > less[0] or not more[1] > less[1] for less, more in pairwise(self.fuel_points)):
            raise ValueError("fuel_points must grow in power and in fuel; order them, and leave out the peak of torque")
        return self


class BatteryParameters(_FrozenModel):
    """The battery of an electric tractor, and how it is charged or changed.

    Only the capacity is a must. With `change_s` an empty battery is changed for a full one, else it is charged.
    """

    capacity_kwh: Annotated[
        float, _make_number_type(0.1, 10_000.0, "kWh that the full battery holds, usually 30 to 300")
    ]
    charger_kw: Annotated[float, _make_number_type(0.1, 10_000.0, "kW, usually 10 to 150")] = 50.0
    connect_s: Annotated[float, _make_number_type(0.0, 36_000.0, "s to connect and disconnect the charger")] = 120.0
    change_s: Annotated[float, _make_number_type(1.0, 36_000.0, "s to change it for a full one")] | None = None
    efficiency: Annotated[float, _make_number_type(0.05, 1.0, "from battery to motor shaft, usually 0.8 to 0.9")] = 0.85
    recovery: Annotated[float, _make_number_type(0.0, 1.0, "share of the energy of braking that returns")] = 0.0
    standby_w: Annotated[float, _make_number_type(0.0, 1e5, "W that controls and cooling always take")] = 500.0
    reserve: Annotated[float, _make_number_type(0.0, 0.9, "share that stays in it, usually 0.1 to 0.2")] = 0.15


class TyreParameters(_FrozenModel):
    """Sizes of the tyres, and which wheels are driven: by those follows the traction on a soil."""

    front_width_m: Annotated[float, _make_number_type(0.01, 3.0, "m, section width, usually 0.2 to 0.6")]
    front_diameter_m: Annotated[float, _make_number_type(0.05, 4.0, "m over all, usually 0.8 to 1.7")]
    rear_width_m: Annotated[float, _make_number_type(0.01, 3.0, "m, section width, usually 0.3 to 0.8")]
    rear_diameter_m: Annotated[float, _make_number_type(0.05, 4.0, "m over all, usually 1.2 to 2.1")]
    deflection_ratio: Annotated[float, _make_number_type(0.01, 0.6, "deflection over section height")] = 0.2
    driven_wheels: Literal["2wd", "mfwd", "4wd"] = "mfwd"


class StabilityParameters(_FrozenModel):
    """What decides whether a tractor rolls over, and below which margin that is warned of."""

    centre_height_m: Annotated[float, _make_number_type(0.01, 5.0, "m, the centre of mass, usually 0.6 to 1.2")]
    warn_deg: Annotated[float, _make_number_type(0.0, 60.0, "degrees of margin")] = 20.0


Factor = Annotated[float, _make_number_type(1e-4, 1e4, "factor c")]
Power = Annotated[float, _make_number_type(0.01, 10.0, "exponent p")]


class PowerLaw(_FrozenModel):
    """Measured turning radius r_p = 118.4 / (c |delta|^p) in metres, delta in degrees, for each side."""

    right: tuple[Factor, Power] = Field(description="factor and exponent to the right")
    left: tuple[Factor, Power] = Field(description="factor and exponent to the left")

    def compute_radius_m(self, steering_deg: float) -> float:
        """Radius of the antenna's circle at a physical steering angle (positive right); infinite at zero."""
        if steering_deg == 0:
            return math.inf
        factor, power = self.right if steering_deg > 0 else self.left
        return float(POWER_LAW_M / (factor * abs(steering_deg) ** power))


class EffectSetting(_FrozenModel):
    """An effect of vehicle.model.effects found in measured logs: its values, their intervals, and the logs used.

    `ground` is where the logs were recorded. Without `named` it is a calibration: it lowers the error, but the logs do
    not show that it is the cause. `equivalent_to` lists the causes that the logs cannot distinguish from it.
    """

    value: dict[str, StrictNumber] = Field(description="value per parameter of the effect")
    interval: dict[str, tuple[StrictNumber, StrictNumber]] = {}
    named: StrictBool = True
    equivalent_to: tuple[str, ...] = ()
    ground: str = ""
    logs: tuple[str, ...] = ()


SeenSpeed = Annotated[float, _make_number_type(0.0, 1000.0, "m/s")]
SeenAngle = Annotated[float, _make_number_type(-360.0, 360.0, "degrees")]


class DiscrepancyModel(_FrozenModel):
    """Amounts per term of vehicle.model.discrepancy_model, and the ranges of the logs they were fitted to.

    `on = false` switches it off. Outside the ranges of speed and wheel angle it is not trusted.
    """

    on: StrictBool = True
    amounts: dict[str, StrictNumber] = Field(description="amount per term")
    speed_mps: tuple[SeenSpeed, SeenSpeed] = Field(description="speeds of the logs, from and to, m/s")
    angle_deg: tuple[SeenAngle, SeenAngle] = Field(description="wheel angles of the logs, from and to, degrees")
    interval: dict[str, tuple[StrictNumber, StrictNumber]] = {}
    logs: tuple[str, ...] = ()

    @model_validator(mode="after")
    def _check_ranges(self) -> DiscrepancyModel:
        compute_discrepancy_fields(self.amounts)
        for name in ("speed_mps", "angle_deg"):
            low, high = getattr(self, name)
            if not low < high:
                raise ValueError(f"{name} = [{low:g}, {high:g}] must increase; give the smaller value first")
        return self


class Tractor(_FrozenModel, title="tractor file"):
    """A tractor as the simulator needs it. Distances from the centre of mass unless the name says otherwise.

    The antenna is measured from the rear-axle centre. Guidance steers the point of the centre line beside the antenna:
    it allows for `antenna_right_m`, which matters only where positions are measured.
    """

    name: str = Field(description="in quotes")
    mass_kg: Annotated[float, _make_number_type(0.01, 200_000.0, "kg, usually 500 to 16000")]
    front_axle_m: Annotated[Metres, Field(description="m ahead of the centre of mass, usually 0.6 of the wheelbase")]
    rear_axle_m: Annotated[Metres, Field(description="m behind it; the two add up to the wheelbase")]
    track_m: Annotated[Metres, Field(description="m between the wheels, usually 0.8 to 2.3")]
    length_m: Annotated[Metres, Field(description="m over all, usually 1.8 wheelbases")]
    width_m: Annotated[Metres, Field(description="m over all, usually 0.8 to 3")]
    rear_overhang_m: Annotated[float, _make_number_type(0.0, 30.0, "m behind the rear axle, usually 0.3 to 1.2")]
    max_steering_deg: Annotated[
        float, Field(gt=0.01, lt=60, strict=True, description="degrees at full lock, usually 25 to 55")
    ]
    antenna_forward_m: Annotated[float, _make_number_type(-30.0, 30.0, "m ahead of the rear axle")] = 1.1
    antenna_right_m: Annotated[float, _make_number_type(-30.0, 30.0, "m")] = 0.0
    drive: Literal["diesel", "electric"] = "diesel"
    steering: SteeringParameters = SteeringParameters()
    guidance: GuidanceParameters = GuidanceParameters()
    speed: SpeedParameters = SpeedParameters()
    engine: EngineParameters | None = None
    battery: BatteryParameters | None = None
    tyres: TyreParameters | None = None
    stability: StabilityParameters | None = None
    radius: dict[str, PowerLaw] = {}
    effects: dict[str, EffectSetting] = {}
    discrepancy_model: DiscrepancyModel | None = None
    source: dict[str, str] = {}

    @property
    def wheelbase_m(self) -> float:
        """Distance between the axles."""
        return self.front_axle_m + self.rear_axle_m

    @property
    def guide_m(self) -> float:
        """How far the point that guidance steers is ahead of the centre of mass."""
        return self.antenna_forward_m - self.rear_axle_m

    @property
    def inertia_kg_m2(self) -> float:
        """Yaw inertia of a uniform box of the tractor's length and width."""
        return self.mass_kg * (self.length_m**2 + self.width_m**2) / 12.0

    @property
    def rear_end_m(self) -> float:
        """How far the body reaches behind the centre of mass."""
        return self.rear_axle_m + self.rear_overhang_m

    @property
    def ackermann_radius_m(self) -> float:
        """Radius of the antenna's circle at full lock, from wheelbase and wheel angle alone."""
        return math.hypot(self.antenna_forward_m, self.wheelbase_m / math.tan(math.radians(self.max_steering_deg)))

    def compute_smallest_radius_m(self, ground: str) -> float:
        """Radius of the antenna's circle at full lock on its weaker side.

        Without measured radii on any ground, the circle of the wheels without slip (Ackermann), on every ground.
        """
        if not self.radius:
            return self.ackermann_radius_m
        law = self.get_power_law(ground)
        return max(law.compute_radius_m(self.max_steering_deg), law.compute_radius_m(-self.max_steering_deg))

    def get_power_law(self, ground: str) -> PowerLaw:
        """Measured radii on a ground. Raises VehicleError for a ground without measurements."""
        if not self.radius:
            raise VehicleError(
                f"The file of {self.name} has no measured turning radii; add them as radius.{ground}, or leave the "
                "wheels to turn without slip."
            )
        if ground not in self.radius:
            known = ", ".join(sorted(self.radius))
            raise VehicleError(f"No turning radii of {self.name} are known on {ground!r}; use one of: {known}.")
        return self.radius[ground]

    @model_validator(mode="after")
    def _check_drive(self) -> Tractor:
        if self.drive == "diesel":
            if self.battery is not None:
                raise ValueError(
                    '[battery] is that of an electric tractor; add drive = "electric", or remove [battery]'
                )
            return self
        if self.battery is None:
            raise ValueError('drive = "electric" needs a section [battery] with capacity_kwh; add it')
        if self.engine is None:
            raise ValueError('drive = "electric" needs the power of the motor; add power_kw under [engine]')
        if self.engine.fuel_points:
            raise ValueError('drive = "electric" burns no fuel; remove fuel_points under [engine]')
        return self

    @model_validator(mode="after")
    def _check_consistency(self) -> Tractor:
        for name, setting in self.effects.items():
            check_effect(name, setting.value, self.wheelbase_m)
            for key, (low, high) in setting.interval.items():
                if key not in setting.value or not low <= high:
                    raise VehicleError(
                        f"The effect {name} has the interval {key} = [{low:g}, {high:g}]; name one of its values and "
                        "give the lower bound first."
                    )
        if self.wheelbase_m > self.length_m:
            raise ValueError(f"wheelbase {self.wheelbase_m} m is longer than length_m {self.length_m}")
        if self.track_m > self.width_m + 0.5:
            raise ValueError(f"track_m {self.track_m} is wider than the tractor, width_m {self.width_m}")
        if self.rear_overhang_m > self.length_m:
            raise ValueError(f"rear_overhang_m {self.rear_overhang_m} is more than the whole length_m {self.length_m}")
        return self


class Implement(_FrozenModel):
    """A mounted implement: a bar of the working width, `hitch_m` behind the rear axle.

    One that is wider than a road allows folds to `transport_width_m`, and back, in `fold_s` seconds each; one with a
    transport width of its frame or more is rigid.
    """

    width_m: Positive = 3.0
    hitch_m: Positive = 1.2
    length_m: Positive = 0.7
    frame_width_m: Positive | None = None
    transport_width_m: Positive = ROAD_WIDTH_M
    fold_s: Seconds = FOLD_S

    @property
    def contact_width_m(self) -> float:
        """Width of the frame that could touch another tractor; by default a tenth less than the swath."""
        return self.frame_width_m if self.frame_width_m is not None else 0.9 * self.width_m

    @property
    def folds(self) -> bool:
        """Whether it is narrower when it is folded."""
        return self.transport_width_m < self.contact_width_m

    @property
    def folded(self) -> Implement:
        """The implement as it is folded; a rigid one as it is."""
        return self.model_copy(update={"frame_width_m": self.transport_width_m}) if self.folds else self


def list_tractor_names() -> tuple[str, ...]:
    """Names of the tractors that come with Headland."""
    folder = resources.files("vehicle") / "data"
    return tuple(sorted(f.name.removesuffix(".toml") for f in folder.iterdir() if f.name.endswith(".toml")))


def load_tractor(name_or_path: str | Path) -> Tractor:
    """Read a tractor by name ("eg105") or from a TOML file.

    Raises VehicleError naming every missing key, and every wrong one with its value and the rule.
    """
    names = list_tractor_names()
    if str(name_or_path) in names:
        text = (resources.files("vehicle") / "data" / f"{name_or_path}.toml").read_text(encoding="utf-8")
    elif str(name_or_path) and not os.path.lexists(name_or_path):
        close = suggest_name(str(name_or_path), names)
        raise VehicleError(
            f"The tractor {quote_path(name_or_path)} is neither a file nor one of: {', '.join(names)}{close}; headland "
            "tractor new writes a file of another."
        )
    else:
        text = read_text(name_or_path, "a tractor file (TOML)", VehicleError)
    return parse_tractor(text, str(name_or_path))


def parse_tractor(text: str, name: str) -> Tractor:
    """The tractor of a text (TOML), which messages call `name`; raises as `load_tractor`."""
    return parse_settings(text, Tractor, name, VehicleError)


def resolve_tractor(source: Tractor | str | Path) -> Tractor:
    """A tractor given as an object, or by its name or file.

    Objects are checked again, as `model_copy` checks nothing. Raises VehicleError.
    """
    if not isinstance(source, Tractor):
        return load_tractor(source)
    try:
        return Tractor.model_validate(source.model_dump())
    except ValidationError as error:
        raise VehicleError(
            f"The tractor {source.name!r} cannot be used: {describe_validation_errors(error, Tractor)}."
        ) from None


@dataclass(frozen=True)
class LogCorrections:
    """Corrections from logs. `settings` are values per effect, and the amounts of a discrepancy model under
    DISCREPANCY_KEY; `ranges` are fields of MODEL with the speeds and wheel angles where those amounts hold."""

    settings: Settings = field(default_factory=dict)
    ranges: Mapping[str, float] = field(default_factory=dict)

    @property
    def fields(self) -> dict[str, float]:
        """Fields of MODEL."""
        return compute_effect_fields(self.settings) | dict(self.ranges)


def get_log_corrections(tractor: Tractor) -> LogCorrections:
    """The effects of a tractor file, and its discrepancy model unless that is switched off."""
    settings: dict[str, Mapping[str, float]] = {name: setting.value for name, setting in tractor.effects.items()}
    discrepancy_model = tractor.discrepancy_model
    if discrepancy_model is None or not discrepancy_model.on:
        return LogCorrections(settings)
    return LogCorrections(
        settings | {DISCREPANCY_KEY: discrepancy_model.amounts},
        compute_range_fields(discrepancy_model.speed_mps, discrepancy_model.angle_deg),
    )


def remove_log_corrections(tractor: Tractor) -> Tractor:
    """The tractor without effects and discrepancy model."""
    return tractor.model_copy(update={"effects": {}, "discrepancy_model": None})
