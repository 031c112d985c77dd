"""Tractors and implements of a farm."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, StrictInt, model_validator

from planner.farm.values import Section, number, other
from planner.scenario import FASTEST_KMH, HIGHEST_PRICE, KMH, LONGEST_M, MOST_TRACTORS, SLOWEST_KMH
from strategies.supply import Supply
from vehicle.datasheet import Datasheet, tractor_from
from vehicle.tractor import Implement, Tractor, load_tractor

USUAL_TRACTOR = "eg105"


class FarmTractor(Section):
    """One kind of tractor: a name, its file or datasheet (neither: the tractor of the thesis), how many, its money.

    Prices are in the currency of the farm; what is None is the default of the prices' section.
    """

    name: str = Field(strict=True, min_length=1, description="in quotes")
    file: str | None = other(None, "eg105, mr1000a or a TOML file, in quotes", "eg105 without a sheet", strict=True)
    sheet: Datasheet | None = None
    count: StrictInt = other(1, "how many", "one", ge=1, le=MOST_TRACTORS)
    price: float | None = number(None, 0.0, HIGHEST_PRICE, "list price of one", "prices.tractor_price")
    power_kw: float | None = number(None, 0.1, 2000.0, "kW at the shaft", "prices.tractor_power_kw")
    hours_per_year: float | None = number(None, 1.0, 8784.0, "hours of use a year", "prices.hours_per_year")
    years: float | None = number(None, 0.1, 100.0, "years it is kept", "prices.years")

    @model_validator(mode="after")
    def _one_origin(self) -> FarmTractor:
        if self.file is not None and self.sheet is not None:
            raise ValueError(f"the tractor {self.name!r} has a file and a sheet; leave out one of them")
        return self

    @property
    def origin(self) -> Tractor | str:
        """What a plan takes for its tractor: an object, or a name or file where there is one; raises VehicleError."""
        return self.file or USUAL_TRACTOR if self.sheet is None else self.machine()

    def machine(self) -> Tractor:
        """The tractor as the simulator has it; raises VehicleError."""
        if self.sheet is not None:
            return tractor_from(self.name, self.sheet)
        return load_tractor(self.file or USUAL_TRACTOR)


class FarmImplement(Section):
    """One implement: width, where it sits, what it carries, how fast it works.

    `capacity` and `rate_per_m2` are litres and litres per square metre, or kilograms for both. An implement that
    `collects` starts empty and is unloaded; one that does not starts full and is refilled. `tractors` are the names
    of those that it fits; none stands for all.
    """

    name: str = Field(strict=True, min_length=1, description="in quotes")
    width_m: float = number(3.0, 0.1, LONGEST_M, "m working width", "thesis, section 6.3: cultivator of 3 m")
    hitch_m: float = number(1.2, 0.01, 30.0, "m behind the rear axle to the tools", "assumed: mounted at the rear")
    length_m: float = number(0.7, 0.01, 30.0, "m from the first tool to the last", "assumed: a cultivator's frame")
    frame_width_m: float | None = number(None, 0.1, LONGEST_M, "m over all", "0.9 of the working width")
    speed_kmh: float | None = number(None, SLOWEST_KMH, FASTEST_KMH, "km/h at work", "the option --speed-kmh")
    turn_speed_kmh: float | None = number(None, SLOWEST_KMH, FASTEST_KMH, "km/h in turns", "the option")
    capacity: float | None = number(None, 0.001, 1e6, "l or kg when full", "it carries nothing")
    rate_per_m2: float | None = number(None, 1e-9, 1e3, "l or kg per m2 worked", "it carries nothing")
    collects: bool = other(False, "true: it fills at work", "no", strict=True)
    price: float | None = number(None, 0.0, HIGHEST_PRICE, "list price", "prices.implement_price")
    hours_per_year: float | None = number(None, 1.0, 8784.0, "hours of use a year", "prices.implement_hours_per_year")
    years: float | None = number(None, 0.1, 100.0, "years it is kept", "prices.years")
    operation: Literal["till", "sow", "spray", "harvest", "mow"] | None = other(
        None, "till, sow, spray, harvest or mow, in quotes"
    )
    headland: Literal["first", "last"] | None = other(None, "first or last, in quotes", "as the operation has it")
    tractors: tuple[str, ...] = other((), "names in quotes", "all of them")

    @property
    def speed_mps(self) -> float | None:
        """Working speed in m/s, None where it is left to the plan."""
        return None if self.speed_kmh is None else self.speed_kmh * KMH

    @property
    def turn_speed_mps(self) -> float | None:
        """Speed in turns in m/s, None where it is left to the plan."""
        return None if self.turn_speed_kmh is None else self.turn_speed_kmh * KMH

    @property
    def area_per_load_m2(self) -> float | None:
        """Ground that one load lasts for; None for an implement that carries nothing."""
        if self.capacity is None or self.rate_per_m2 is None:
            return None
        return self.capacity / self.rate_per_m2

    def supply(self, refill_s: float) -> Supply | None:
        """What it carries, with stops of so many seconds to make that good; None where it carries nothing."""
        if self.capacity is None or self.rate_per_m2 is None:
            return None
        return Supply(self.capacity, self.rate_per_m2, refill_s, self.collects)

    @property
    def mounted(self) -> Implement:
        """The implement as the simulator has it."""
        return Implement(
            width_m=self.width_m, hitch_m=self.hitch_m, length_m=self.length_m, frame_width_m=self.frame_width_m
        )
