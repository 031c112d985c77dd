"""The day file: fields with windows and values, fleets, roads, light and rain, in one TOML file."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, StrictInt, model_validator

from fields.geometry.chosen_places import parse_obstacle_place
from fields.sample_fields import list_sample_names
from fields.text_files import read_text
from fields.units import DAY_S
from planner.errors import RequestError, mark_parameter, shorten_value, suggest_name
from planner.farm.inventory import FarmFile, load_example_farm, load_farm
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.settings import FROM_TIMES, FileSection, Yard, check_by, define_number, define_value
from planner.request.option_checks import MAX_CERTAINTY_PCT, MIN_CERTAINTY_PCT
from planner.request.option_texts import MAX_TRACTORS, format_clock, parse_clock, parse_hours, parse_number_pair
from planner.request.plan_request import HEADLAND_ORDERS_BY_OPERATION, MAX_PRICE
from planner.risk.rain import parse_rain
from strategies.names import STRATEGY_NAMES, list_strategy_names
from vehicle.model.validation_messages import parse_settings

EXAMPLE = "example"
SUN = "sun"
MAX_ROAD_KM = 1000.0
MAX_NIGHT_WINDOW_S = DAY_S // 2


def _check_daylight(text: str) -> None:
    if text != SUN:
        parse_hours(text)


def _check_date(text: str) -> None:
    try:
        date.fromisoformat(text)
    except ValueError:
        raise ValueError(f"{text!r} is not a date; write for instance '2026-05-01'") from None


def place_hours_in_day(text: str, start_s: int) -> tuple[int, int]:
    """Hours as seconds of a day that begins at `start_s`; hours over by then are on the next day.

    Raises RequestError for a window that closes before it opens. A window over midnight may last MAX_NIGHT_WINDOW_S; a
    longer one is refused as hours in the wrong order.
    """
    opens, closes = parse_hours(text)
    if closes < opens and closes + DAY_S - opens > MAX_NIGHT_WINDOW_S:
        raise RequestError(
            f"The window {text!r} closes before it opens; write the earlier time first, and a window over midnight of "
            f"more than {MAX_NIGHT_WINDOW_S // 3600} h as two, such as '18:00-00:00' and '00:00-09:00'."
        )
    closes += DAY_S if closes <= start_s else 0
    opens += DAY_S if opens + DAY_S < closes else 0
    if opens >= closes:
        raise RequestError(
            f"The window {text!r} closes before it opens: the day begins at {format_clock(start_s)}, and earlier "
            "times are on the next day; change the window or the start."
        )
    return opens, closes


def _validate_road_ends(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(names) != 2:
        raise ValueError(f"a road has two ends, not {len(names)}; give two names")
    return names


Window = Annotated[str, FROM_TIMES, check_by(parse_hours)]
ObstaclePlace = Annotated[str, check_by(parse_obstacle_place)]


class DayField(FileSection):
    """A field: file or sample, entrance, obstacles, heights, working hours, value, requirements and place.

    `value_per_ha` is the value of the work: if it is not done, the value is lost and the cost saved. `loss_per_ha` is
    the loss if the work is done on another day, at the same cost. Without either, the loss is `late_per_ha` and
    `seed_per_ha` of the farm's prices.
    """

    file: str = Field(strict=True, min_length=1, description="a field file or sample, in quotes")
    name: str | None = define_value(None, "in quotes", "the name in the file", strict=True, min_length=1)
    local: bool = define_value(False, "true: the file holds metres", "no", strict=True)
    crs: str | None = define_value(
        None, "such as 'EPSG:25832', in quotes", "that of the file", strict=True, min_length=1
    )
    swap_axes: bool = define_value(False, "true: the file has latitude or northing first", "no", strict=True)
    entrance: Annotated[str | None, check_by(lambda text: parse_number_pair(text, "entrance"))] = define_value(
        None, "'lon,lat' (x,y of a field in metres)", "that of the file", strict=True
    )
    obstacles: tuple[ObstaclePlace, ...] = define_value((), "such as '9.53,56.21,2': lon,lat,radius in m", "none more")
    ignored: tuple[str, ...] = define_value((), "names or numbers of obstacles of the file, in quotes", "none")
    elevation: str | None = define_value(
        None, "a file of heights, in quotes", "that which the field file names", strict=True, min_length=1
    )
    elevation_crs: str | None = define_value(
        None, "such as 'EPSG:25832', in quotes", "that of the heights", strict=True, min_length=1
    )
    done: tuple[Annotated[str, Field(min_length=1)], ...] = define_value(
        (), "files of worked ground, logs, or saved plans at a time ('plan.json@13:20')", "nothing"
    )
    windows: tuple[Window, ...] = define_value((), "such as '08:00-12:00', in quotes", "the whole day")
    value_per_ha: float | None = define_number(None, 0.0, MAX_PRICE, "value of the work per hectare")
    loss_per_ha: float | None = define_number(None, 0.0, MAX_PRICE, "loss per hectare done on another day")
    implement: str | None = define_value(None, "of the farm file, in quotes", "any that fits", strict=True)
    operation: str | None = define_value(None, "till, sow, spray, harvest or mow, in quotes", "any", strict=True)
    lon: float | None = define_number(None, -180.0, 180.0, "degrees of longitude", "the middle of the field")
    lat: float | None = define_number(None, -90.0, 90.0, "degrees of latitude", "the middle of the field")

    @model_validator(mode="after")
    def _check_consistency(self) -> DayField:
        if self.value_per_ha is not None and self.loss_per_ha is not None:
            raise ValueError("value_per_ha and loss_per_ha cannot be given together; leave out one of them")
        if (self.lon is None) != (self.lat is None):
            raise ValueError("lon and lat belong together; give both in degrees, or neither")
        if self.operation is not None and self.operation not in HEADLAND_ORDERS_BY_OPERATION:
            close = suggest_name(self.operation, HEADLAND_ORDERS_BY_OPERATION)
            raise ValueError(
                f"operation {self.operation!r} is unknown{close}; use {', '.join(HEADLAND_ORDERS_BY_OPERATION)}"
            )
        return self


class DayFleet(FileSection):
    """Tractors of one kind with an implement each, which work on one field at a time."""

    name: str = Field(strict=True, min_length=1, description="in quotes")
    tractor: str | None = define_value(None, "of the farm file, in quotes", "its first", strict=True)
    count: StrictInt = define_value(1, "how many", "one", ge=1, le=MAX_TRACTORS)
    implement: str | None = define_value(None, "of the farm file, in quotes", "the first that fits", strict=True)


class DayRoad(FileSection):
    """The road between two fields, or a field and the yard, in kilometres, the same both ways."""

    between: Annotated[tuple[str, ...], AfterValidator(_validate_road_ends)] = Field(
        description="two names in brackets"
    )
    km: float = Field(ge=0.0, le=MAX_ROAD_KM, strict=True, allow_inf_nan=False, description="km of road")


class DayFile(FileSection, title="day file"):
    """A day: fields, fleets, roads, hours and rain."""

    fields: tuple[DayField, ...] = Field(description="one [[fields]] each")
    fleets: tuple[DayFleet, ...] = Field(description="one [[fleets]] each")
    roads: tuple[DayRoad, ...] = define_value((), "roads between places", "straight lines times road_factor")
    farm: str | None = define_value(None, "a farm file, or 'example'", "a farm of defaults", strict=True)
    start: Annotated[str | None, FROM_TIMES, check_by(lambda text: parse_clock(text, "the start"))] = define_value(
        None, "hh:mm", "shift_start of the farm"
    )
    light: Annotated[str | None, FROM_TIMES, check_by(_check_daylight)] = define_value(
        None, "'sun', or hours such as '06:10-20:40'", "robots need none", strict=True
    )
    date: Annotated[str | None, FROM_TIMES, check_by(_check_date)] = define_value(
        None, "yyyy-mm-dd in quotes", strict=True
    )
    utc_offset_h: float | None = define_number(None, -12.0, 14.0, "hours that clocks are ahead of UTC")
    rain: Annotated[str | None, FROM_TIMES] = define_value(None, "as --rain of headland plan", "none", strict=True)
    certainty_pct: float | None = define_number(
        None,
        MIN_CERTAINTY_PCT,
        MAX_CERTAINTY_PCT,
        "percent of samples within the times used for planning",
        "mean times",
    )
    strategies: tuple[str, ...] = define_value(STRATEGY_NAMES, "names in quotes", "all of them")
    yard: Yard | None = define_value(None, "lon and lat", "that of the farm")


def name_day_key(parameter: str) -> str:
    """What a parameter of refusals is called in a day file; others stay as they are marked."""
    is_key = parameter in DayFile.model_fields or parameter in DayField.model_fields
    return f"{parameter} in the day file" if is_key else mark_parameter(parameter)


def load_day(
    path: str | Path, *, farm: str | None = None, rain: str | None = None, certainty_pct: float | None = None
) -> tuple[DayFile, FarmFile]:
    """Read a day file and the farm it names; files are relative to its folder.

    `farm`, `rain` and `certainty_pct` override the values of the file. Raises RequestError with all faults of the file
    in one sentence.
    """
    text = read_text(path, "a day file (TOML)", RequestError)
    return parse_day(text, str(path), Path(path).parent, farm=farm, rain=rain, certainty_pct=certainty_pct)


def parse_day(
    text: str,
    label: str,
    folder: Path = Path(),
    *,
    farm: str | None = None,
    rain: str | None = None,
    certainty_pct: float | None = None,
) -> tuple[DayFile, FarmFile]:
    """The day of a text and its farm; `label` is its name in messages."""
    day = parse_settings(text, DayFile, label, RequestError)
    overrides = {"farm": farm, "rain": rain, "certainty_pct": certainty_pct}
    given_overrides = {key: value for key, value in overrides.items() if value is not None}
    day = _resolve_paths(day, folder).model_copy(update=given_overrides)
    farm_file = load_farm_of_day(day)
    faults = "; ".join(_find_day_contradictions(day, farm_file))
    if faults:
        raise RequestError(f"The day file {label} cannot be used: {faults}.")
    if rain is not None:
        parse_rain(rain, get_start_s(day, farm_file))
    return day, farm_file


def load_farm_of_day(day: DayFile) -> FarmFile:
    """The farm of a day: its file, the example of Headland, or the defaults."""
    if day.farm is None:
        return FarmFile()
    return load_example_farm() if day.farm == EXAMPLE else load_farm(day.farm)


def get_start_s(day: DayFile, farm: FarmFile) -> int:
    """The start of the day in seconds; raises RequestError if neither file gives it."""
    if day.start is not None:
        return parse_clock(day.start, "start_s")
    shift_start_s = farm.times.shift_span_s[0]
    if shift_start_s is None:
        raise RequestError("The day has no start; give start = 'hh:mm' in the day file, or shift_start in the farm.")
    return shift_start_s


def get_fleet_machines(fleet: DayFleet, farm: FarmFile) -> tuple[FarmTractor, FarmImplement]:
    """Tractor and implement of a fleet by the farm file; raises RequestError."""
    tractor = farm.get_tractor(fleet.tractor)
    if fleet.implement is None:
        fitting = next((each for each in farm.implements if farm.is_compatible(tractor, each)), None)
        return tractor, fitting or farm.get_implement()
    implement = farm.get_implement(fleet.implement)
    if not farm.is_compatible(tractor, implement):
        raise RequestError(
            f"The implement {implement.name!r} of the fleet {fleet.name!r} is not for its tractor {tractor.name!r}: "
            "the farm file does not list that tractor under the implement; add it there, or choose another."
        )
    return tractor, implement


def is_suitable(field: DayField, implement: FarmImplement) -> bool:
    """Whether an implement meets the requirements of a field."""
    fits_name = field.implement in (None, implement.name)
    return fits_name and field.operation in (None, implement.operation or "till")


def _resolve_paths(day: DayFile, folder: Path) -> DayFile:
    """The day with the paths of its files relative to the folder."""

    def resolve_files(field: DayField) -> DayField:
        elevation = None if field.elevation is None else str(folder / field.elevation)
        file = field.file if field.file in list_sample_names() else str(folder / field.file)
        done = tuple(str(folder / source) for source in field.done)
        return field.model_copy(update={"file": file, "elevation": elevation, "done": done})

    fields = tuple(map(resolve_files, day.fields))
    updates: dict[str, Any] = {"fields": fields}
    if day.farm not in (None, EXAMPLE):
        updates["farm"] = str(folder / str(day.farm))
    if day.rain is not None and day.rain.strip().lower().endswith(".csv"):
        updates["rain"] = str(folder / day.rain.strip())
    return day.model_copy(update=updates)


def _find_day_contradictions(day: DayFile, farm: FarmFile) -> Iterator[str]:
    """Contradictions within the day and with the farm."""
    empty = [section for section in ("fields", "fleets") if not getattr(day, section)]
    yield from (f"{section} is empty; give one or more under [[{section}]]" for section in empty)
    if empty:
        return
    yield from _find_duplicates([fleet.name for fleet in day.fleets], "fleets have")
    yield from _find_duplicates([field.name for field in day.fields if field.name], "fields have")
    known = list_strategy_names()
    for name in day.strategies:
        if name not in known:
            yield f"the strategy {name!r} is unknown{suggest_name(name, known)}; use {', '.join(known)}"
    if not day.strategies:
        yield "strategies is empty; name one or more, or leave it out"
    yield from _find_shortages(day, farm)
    implements = [get_fleet_machines(fleet, farm)[1] for fleet in day.fleets]
    for field in day.fields:
        if field.implement is not None:
            farm.get_implement(field.implement)
        if not any(is_suitable(field, implement) for implement in implements):
            requirement = (
                f"the implement {field.implement!r}" if field.implement else f"the operation {field.operation!r}"
            )
            available = ", ".join(dict.fromkeys(f"{each.name} ({each.operation or 'till'})" for each in implements))
            yield (
                f"no fleet fits {shorten_value(field.name or field.file)}, which requires {requirement}; the fleets "
                f"have {available}"
            )
    if day.light == SUN and (day.date is None or day.utc_offset_h is None):
        yield f"light = {SUN!r} needs a date and utc_offset_h (2.0 for summer in central Europe); give both"
    start_s, light = get_start_s(day, farm), [] if day.light in (None, SUN) else [str(day.light)]
    for text in (*(window for field in day.fields for window in field.windows), *light):
        place_hours_in_day(text, start_s)


def _find_duplicates(names: Sequence[str], owners: str) -> Iterator[str]:
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"two {owners} the name {shorten_value(name)}; give each a unique name"


def _find_shortages(day: DayFile, farm: FarmFile) -> Iterator[str]:
    """Kinds of tractors of which the farm has too few."""
    requested_counts: dict[str, int] = {}
    for fleet in day.fleets:
        name = farm.get_tractor(fleet.tractor).name
        requested_counts[name] = requested_counts.get(name, 0) + fleet.count
    for name, count in requested_counts.items():
        owned_count = farm.get_tractor(name).count
        if count > owned_count:
            yield f"the fleets have {count} x {name} in total, but the farm only {owned_count}; change either count"
