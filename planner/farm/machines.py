"""Tractors and implements of a farm."""

from __future__ import annotations

from functools import partial
from typing import Literal

from pydantic import Field, StrictInt, model_validator

from planner.errors import HeadlandError
from planner.farm.settings import FileSection, define_duration, define_number, define_price, define_value
from planner.request.implement_choice import check_transport_width, choose_rule
from planner.request.option_texts import MAX_TRACTORS
from planner.request.plan_request import MAX_DEPTH_CM, MAX_LENGTH_M, MAX_SPEED_KMH, MIN_SPEED_KMH
from strategies.rules.supply import Supply
from vehicle.datasheet.build import build_tractor
from vehicle.datasheet.sheet import Datasheet
from vehicle.energy.draft import TILL
from vehicle.model.tractor import FOLD_S, ROAD_WIDTH_M, Implement, Tractor, load_tractor

DEFAULT_TRACTOR = "eg105"
_SPEED = partial(define_number, None, MIN_SPEED_KMH, MAX_SPEED_KMH)


class FarmTractor(FileSection):
    """One kind of tractor: name, file or datasheet (default: the tractor of the thesis), count and prices.

    Prices are in the currency of the farm; None stands for the default in the section of prices.
    """

    name: str = Field(strict=True, min_length=1, description="in quotes")
    file: str | None = define_value(
        None, "eg105, mr1000a or a TOML file, in quotes", "eg105 without a sheet", strict=True
    )
    sheet: Datasheet | None = None
    count: StrictInt = define_value(1, "how many", "one", ge=1, le=MAX_TRACTORS)
    price: float | None = define_price(None, "list price of one", "prices.tractor_price")
    power_kw: float | None = define_number(None, 0.1, 2000.0, "kW at the shaft", "prices.tractor_power_kw")
    hours_per_year: float | None = define_number(None, 1.0, 8784.0, "hours of use per year", "prices.hours_per_year")
    years: float | None = define_number(None, 0.1, 100.0, "years of use", "prices.years")

    @model_validator(mode="after")
    def _check_file_or_sheet(self) -> FarmTractor:
        if self.file is not None and self.sheet is not None:
            raise ValueError(f"the tractor {self.name!r} has both a file and a sheet; leave out one of them")
        return self

    @property
    def origin(self) -> Tractor | str:
        """The tractor for a plan: its name or file, or an object if it has a sheet; raises VehicleError."""
        return self.file or DEFAULT_TRACTOR if self.sheet is None else self.build_tractor()

    def build_tractor(self) -> Tractor:
        """The tractor for the simulator; raises VehicleError."""
        if self.sheet is not None:
            return build_tractor(self.name, self.sheet)
        return load_tractor(self.file or DEFAULT_TRACTOR)

    def find_motor_efficiency(self) -> float | None:
        """Share of the battery's energy that leaves the motor; None for a diesel tractor. Raises VehicleError."""
        battery = self.build_tractor().battery
        return None if battery is None else battery.efficiency


class FarmImplement(FileSection):
    """One implement: dimensions, load, speeds, prices and operation.

    `capacity` and `rate_per_m2` are in litres and litres per square metre, or both in kilograms. An implement that
    `collects` starts empty and is unloaded, any other starts full and is refilled. `tractors` are the names of the
    tractors it fits; without names it fits all. `draft` is its row in the table of drafts (vehicle.energy.draft).
    """

    name: str = Field(strict=True, min_length=1, description="in quotes")
    width_m: float = define_number(3.0, 0.1, MAX_LENGTH_M, "m working width", "thesis, section 6.3: cultivator of 3 m")
    hitch_m: float = define_number(
        1.2, 0.01, 30.0, "m behind the rear axle to the tools", "assumed: mounted at the rear"
    )
    length_m: float = define_number(
        0.7, 0.01, 30.0, "m from the first tool to the last", "assumed: a cultivator's frame"
    )
    frame_width_m: float | None = define_number(None, 0.1, MAX_LENGTH_M, "m overall", "0.9 of the working width")
    transport_width_m: float = define_number(
        ROAD_WIDTH_M, 0.1, MAX_LENGTH_M, "m when folded; its working width: it does not fold", "what most roads allow"
    )
    fold_s: float = define_duration(FOLD_S, "s to fold on the field, and to unfold", "assumed")
    speed_kmh: float | None = _SPEED("km/h at work", "the option --speed-kmh")
    min_speed_kmh: float | None = _SPEED("km/h, the least it works well at", "no limit")
    max_speed_kmh: float | None = _SPEED("km/h, the most it works well at", "no limit")
    turn_speed_kmh: float | None = _SPEED("km/h in turns", "the option")
    capacity: float | None = define_number(None, 0.001, 1e6, "l or kg when full", "it carries nothing")
    rate_per_m2: float | None = define_number(None, 1e-9, 1e3, "l or kg per m2 worked", "it carries nothing")
    collects: bool = define_value(False, "true: it fills up while working", "no", strict=True)
    price: float | None = define_price(None, "list price", "prices.implement_price")
    hours_per_year: float | None = define_number(
        None, 1.0, 8784.0, "hours of use per year", "prices.implement_hours_per_year"
    )
    years: float | None = define_number(None, 0.1, 100.0, "years of use", "prices.years")
    operation: Literal["till", "sow", "spray", "harvest", "mow"] | None = define_value(
        None, "till, sow, spray, harvest or mow, in quotes"
    )
    draft: str | None = define_value(
        None, "row of the table of drafts (headland guide implements), in quotes", "by the operation", strict=True
    )
    depth_cm: float | None = define_number(None, 0.1, MAX_DEPTH_CM, "cm working depth", "the usual one of the row")
    headland: Literal["first", "last"] | None = define_value(None, "first or last, in quotes", "by the operation")
    tractors: tuple[str, ...] = define_value((), "names in quotes", "all of them")

    @model_validator(mode="after")
    def _check_values(self) -> FarmImplement:
        try:
            if self.draft is not None or self.depth_cm is not None:
                choose_rule(self.operation or TILL, self.width_m, self.draft, self.depth_cm)
            if "transport_width_m" in self.model_fields_set:
                check_transport_width(self.transport_width_m, max(self.width_m, self.frame_width_m or 0.0))
        except HeadlandError as error:
            raise ValueError(str(error).rstrip(".")) from None
        return self

    @property
    def area_per_load_m2(self) -> float | None:
        """Area per load, square metres; None for an implement that carries nothing."""
        if self.capacity is None or self.rate_per_m2 is None:
            return None
        return self.capacity / self.rate_per_m2

    def build_supply(self, refill_s: float) -> Supply | None:
        """What it carries, with service stops of `refill_s` seconds; None if it carries nothing."""
        if self.capacity is None or self.rate_per_m2 is None:
            return None
        return Supply(self.capacity, self.rate_per_m2, refill_s, self.collects)

    @property
    def simulated_implement(self) -> Implement:
        """The implement for the simulator."""
        own = {"width_m", "hitch_m", "length_m", "frame_width_m", "transport_width_m", "fold_s"}
        return Implement(**self.model_dump(include=own))
