"""Sections of a farm file (prices, times, yard, learned values): limits, defaults and their sources.

All prices are in one currency; defaults are euros of about 2025.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import resources
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from fields.units import DAY_S
from planner.request.option_texts import convert_time_to_text, parse_clock, parse_hours
from planner.request.plan_request import MAX_PRICE

SOURCE_KEY = "source"
NONE_GIVEN = "no default"
_EQUATIONS = "ASAE machinery cost equations (D497, EP496; standards of 2000)"
MAX_DURATION_S = 7.0 * DAY_S
MAX_BREAK_S = DAY_S // 2
FROM_TIMES = BeforeValidator(convert_time_to_text)
"""Times and dates without quotes, as TOML has them."""


class FileSection(BaseModel):
    """A frozen part of a farm file; unknown keys are refused."""

    model_config = ConfigDict(frozen=True, extra="forbid")


def read_example_text(kind: str) -> str:
    """The farm or day file that comes with Headland, as text; `kind` is "farm" or "day"."""
    return (resources.files(f"planner.{kind}") / "example.toml").read_text(encoding="utf-8")


def check_by(parse: Callable[[str], object]) -> AfterValidator:
    """A validator that leaves a text as it is, where `parse` raises no ValueError; None stays."""

    def check_text(text: str | None) -> str | None:
        if text is not None:
            parse(text)
        return text

    return AfterValidator(check_text)


def define_number(default: float | None, low: float, high: float, description: str, source: str = NONE_GIVEN) -> Any:
    """A number from `low` to `high` (no bool), with its description and unit, and the source of its default.

    The limits are wide: they catch wrong units and signs.
    """
    return Field(
        default=default,
        ge=low,
        le=high,
        strict=True,
        allow_inf_nan=False,
        description=description,
        json_schema_extra={SOURCE_KEY: source},
    )


def define_value(default: Any, description: str, source: str = NONE_GIVEN, **rules: Any) -> Any:
    """A value of another type, with rules of pydantic."""
    return Field(default=default, description=description, json_schema_extra={SOURCE_KEY: source}, **rules)


def define_price(default: float | None, description: str, source: str = NONE_GIVEN) -> Any:
    """An amount of money."""
    return define_number(default, 0.0, MAX_PRICE, description, source)


def define_share(default: float, description: str, source: str) -> Any:
    """A share of a whole, 0 to 1."""
    return define_number(default, 0.0, 1.0, description, source)


def define_duration(default: float, description: str, source: str) -> Any:
    """Seconds of handling or of a stop."""
    return define_number(default, 0.0, MAX_DURATION_S, description, source)


def get_default_source(section: type[FileSection], key: str) -> str:
    """The source of the default of a key."""
    extra = section.model_fields[key].json_schema_extra
    return str(extra[SOURCE_KEY]) if isinstance(extra, dict) and SOURCE_KEY in extra else NONE_GIVEN


class LearnedValue(FileSection):
    """One value that `headland learn` put into the farm file; it is cited as long as the file has this value.

    `key` is section and key, such as "uncertainty.turn_cv" or "implements.drill.speed_kmh".
    """

    key: str = Field(strict=True, min_length=1, description="in quotes")
    value: float | str = Field(description="as in the file")
    low: float | None = define_value(None, "lower end of the 95 % interval")
    high: float | None = define_value(None, "upper end of the 95 % interval")
    origin: str = define_value("", "in quotes")
    runs: tuple[str, ...] = define_value((), "names in quotes")

    def format_with_interval(self) -> str:
        """Value, interval and origin: "7.2 (95 %: 6.9 to 7.6), median of 17 runs"."""
        interval = "" if self.low is None or self.high is None else f" (95 %: {self.low:g} to {self.high:g})"
        value = self.value if isinstance(self.value, str) else f"{self.value:g}"
        return f"{value}{interval}, {self.origin}" if self.origin else f"{value}{interval}"


class FarmPrices(FileSection):
    """Costs of machines, fuel, people and late ground.

    Remaining value of a machine after n years: price x first_year_value x later_year_value^n. Repair up to h hours of
    use: price x repair_factor x (h / 1000)^repair_power. Fuel is `fuel_l_per_kwh` times the tractor's power, times the
    share of it used at work, in turns and on the road. `per_hour`, if given, is the total cost of one tractor with
    its implement per hour and replaces depreciation, interest, repair and fuel.
    """

    currency: str = define_value("EUR", "in quotes", "assumed", strict=True, min_length=1, max_length=12)
    per_hour: float | None = define_price(None, "per tractor and hour, all in", "from the values below")
    tractor_price: float = define_price(
        100_000.0, "list price of a tractor", "assumed: about 1,300 per kW for 77 kW, with the robot"
    )
    tractor_power_kw: float = define_number(77.0, 0.1, 2000.0, "kW at the shaft", "the tractor of the thesis (105 hp)")
    implement_price: float = define_price(15_000.0, "list price", "assumed: a cultivator of 3 m")
    hours_per_year: float = define_number(600.0, 1.0, 8784.0, "hours of use per year", "assumed: a tractor in full use")
    implement_hours_per_year: float = define_number(200.0, 1.0, 8784.0, "hours of use per year", "assumed")
    years: float = define_number(10.0, 0.1, 100.0, "years of use of a machine", "assumed")
    first_year_value: float = define_share(0.68, "share of the price", f"tractors, d1, {_EQUATIONS}")
    later_year_value: float = define_share(0.92, "share kept each year", f"tractors, d2, {_EQUATIONS}")
    implement_first_year_value: float = define_share(0.60, "share of the price", f"other machines, {_EQUATIONS}")
    implement_later_year_value: float = define_share(0.885, "share kept each year", f"other machines, {_EQUATIONS}")
    interest_pct: float = define_number(4.0, 0.0, 100.0, "percent per year of the mean value", "assumed")
    insurance_pct: float = define_number(
        1.5, 0.0, 100.0, "percent per year: taxes, housing, insurance", "assumed: usually 1 to 2"
    )
    repair_factor: float = define_number(0.007, 0.0, 10.0, "RF1 of a tractor", f"{_EQUATIONS}: two-wheel drive")
    repair_power: float = define_number(2.0, 0.1, 5.0, "RF2 of a tractor", f"{_EQUATIONS}: two-wheel drive")
    implement_repair_factor: float = define_number(0.27, 0.0, 10.0, "RF1", f"{_EQUATIONS}: field cultivator")
    implement_repair_power: float = define_number(1.4, 0.1, 5.0, "RF2", f"{_EQUATIONS}: field cultivator")
    fuel_per_l: float = define_number(1.2, 0.0, 1e6, "per litre", "assumed: farm diesel")
    fuel_l_per_kwh: float = define_number(
        0.3, 0.0, 10.0, "l per kWh of the power in use", "diesel engines: 250 g per kWh"
    )
    electricity_per_kwh: float = define_number(
        0.2, 0.0, 1e6, "per kWh at the charger", "assumed: a farm's contract in the EU"
    )
    grid_co2_kg_per_kwh: float = define_number(
        0.21,
        0.0,
        10.0,
        "kg of CO2 per kWh at the charger",
        "EU grid of 2023: 58 % below the 0.51 of 1990 (EEA, intensity of electricity generation)",
    )
    work_load: float = define_share(
        0.74, "share of the power at work", f"{_EQUATIONS}: 0.73 x 0.06 gallons per hour and horsepower"
    )
    turn_load: float = define_share(0.35, "share of the power in turns", "assumed: implement lifted")
    road_load: float = define_share(0.5, "share of the power on the road", "assumed")
    oil_share: float = define_number(0.15, 0.0, 10.0, "of the price of the fuel", f"lubricants, {_EQUATIONS}")
    supervision_per_hour: float = define_price(25.0, "of one person", "assumed: wage with all charges")
    supervision_share: float = define_number(0.25, 0.0, 10.0, "persons per robot", "assumed: one looks after four")
    transport_per_tractor: float = define_price(0.0, "bringing one robot to a field", "it drives itself")
    transport_per_km: float = define_price(0.0, "per robot and km on a lorry", "it drives itself")
    seed_per_ha: float = define_price(0.0, "seed or product lost on ground not done", "assumed: none")
    late_per_ha: float = define_price(
        80.0,
        "value lost per ha not done before the rain",
        "assumed: ten days late, half a percent per day, of a crop worth 1,600 per ha",
    )

    @property
    def late_ground_per_ha(self) -> float:
        """What a hectare costs that is not done in time, with its seed."""
        return self.late_per_ha + self.seed_per_ha

    @property
    def are_given(self) -> bool:
        """Whether any amount of money is given; the other values say how costs follow from these."""
        amounts = {
            "per_hour", "tractor_price", "implement_price", "fuel_per_l", "electricity_per_kwh", "supervision_per_hour",
            "transport_per_tractor", "transport_per_km", "seed_per_ha", "late_per_ha",
        }  # fmt: skip
        return not amounts.isdisjoint(self.model_fields_set)


def _parse_break(text: str) -> tuple[int, int]:
    """ "12:00-12:30" as seconds of the day (from, to); an end past midnight is above a day."""
    start, end = parse_hours(text)
    length_s = (end - start) % DAY_S or DAY_S
    if length_s > MAX_BREAK_S:
        raise ValueError(
            f"the break {text!r} lasts {length_s / 3600.0:.3g} h; use 12 h or less, with the earlier time first"
        )
    return start, start + length_s


Clock = Annotated[str | None, FROM_TIMES, check_by(lambda text: parse_clock(text, "the time"))]
Break = Annotated[str, FROM_TIMES, check_by(_parse_break)]


class FarmTimes(FileSection):
    """Handling times, shift and breaks. Durations are seconds, times of day "hh:mm" in quotes.

    A shift that ends before it starts ends on the next day.
    """

    unfold_s: float = define_duration(120.0, "s to unfold on the field", "assumed: a folding implement")
    fold_s: float = define_duration(120.0, "s to fold for the road", "assumed: a folding implement")
    refill_s: float = define_duration(
        300.0, "s to refill or unload at the service point", "assumed: one big bag or tank"
    )
    shift_start: Clock = define_value(None, "hh:mm in quotes", "none", strict=True)
    shift_end: Clock = define_value(None, "hh:mm in quotes", "none", strict=True)
    breaks: tuple[Break, ...] = define_value((), "such as '12:00-12:30', in quotes", "none: robots need none")
    road_speed_kmh: float = define_number(
        25.0, 0.5, 80.0, "km/h on the road", "assumed: with an implement, villages included"
    )
    road_factor: float = define_number(
        1.3, 1.0, 10.0, "length of road over straight line", "usual for rural roads: 1.2 to 1.4"
    )

    def drop_folding(self, folds: bool) -> FarmTimes:
        """The times of an implement that folds or not."""
        return self if folds else self.model_copy(update={"unfold_s": 0.0, "fold_s": 0.0})

    @property
    def break_spans_s(self) -> tuple[tuple[int, int], ...]:
        """Sorted breaks as seconds of the day (from, to); an end past midnight is above a day."""
        return tuple(sorted(_parse_break(text) for text in self.breaks))

    @property
    def shift_span_s(self) -> tuple[int | None, int | None]:
        """Start and end of the shift as seconds of the day; an end past midnight is above a day."""
        start, end = (None if at is None else parse_clock(at, "the shift") for at in (self.shift_start, self.shift_end))
        return start, end + DAY_S if start is not None and end is not None and end <= start else end


class Yard(FileSection):
    """Where the machines are kept, in degrees."""

    lon: float | None = define_number(None, -180.0, 180.0, "degrees of longitude")
    lat: float | None = define_number(None, -90.0, 90.0, "degrees of latitude")

    @model_validator(mode="after")
    def _check_position(self) -> Yard:
        if (self.lon is None) != (self.lat is None):
            missing_key, given_key = ("lon", "lat") if self.lon is None else ("lat", "lon")
            raise ValueError(f"{missing_key} is missing beside {given_key}; give both in degrees, or neither")
        return self
