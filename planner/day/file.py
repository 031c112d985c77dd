"""The day file: fields with windows and values, fleets, roads, light and rain, in one TOML file."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from datetime import date
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, Field, StrictInt, ValidationError, field_validator, model_validator

from fields.reading import brief, parse_fault, read_text
from fields.samples_index import sample_names
from planner.errors import ScenarioError, nearest
from planner.farm.file import FarmFile, example_farm, load_farm
from planner.farm.machines import FarmImplement, FarmTractor
from planner.farm.times import Yard
from planner.farm.values import Section, number, other
from planner.scenario import DAY_S, HIGHEST_PRICE, MOST_TRACTORS, ORDERS_OF, parse_clock
from strategies.registry import STRATEGIES
from vehicle.faults import faults_of

YARD = "yard"
EXAMPLE = "example"
SUN = "sun"
MOST_TOLD = 30
MOST_KM = 1000.0
LONGEST_NIGHT_S = DAY_S // 2


def _is_window(text: str) -> str:
    hours(text)
    return text


def _is_clock(text: str | None) -> str | None:
    if text is not None:
        parse_clock(text, "the start")
    return text


def _is_light(text: str | None) -> str | None:
    if text is not None and text != SUN:
        hours(text)
    return text


def _is_date(text: str | None) -> str | None:
    if text is not None:
        try:
            date.fromisoformat(text)
        except ValueError:
            raise ValueError(f"{text!r} is no date; write for instance '2026-05-01'") from None
    return text


def hours(text: str) -> tuple[int, int]:
    """ "08:00-12:00" as seconds of the day; raises ScenarioError."""
    match = re.fullmatch(r"\s*(\S+)\s*-\s*(\S+)\s*", text)
    if not match:
        raise ScenarioError(f"{text!r} are no hours; write for instance '08:00-12:00'.")
    start, end = (parse_clock(part, "the time") for part in match.groups())
    return start, end


def placed(text: str, start_s: int) -> tuple[int, int]:
    """Hours as seconds of a day that begins at `start_s`: what is over by then is of the next day.

    Raises ScenarioError for a window that closes before it opens. One over midnight may last LONGEST_NIGHT_S; a
    longer one is taken for hours the wrong way round.
    """
    opens, closes = hours(text)
    if closes < opens and closes + DAY_S - opens > LONGEST_NIGHT_S:
        raise ScenarioError(
            f"The window {text!r} closes before it opens; write the earlier time first, and hours over midnight that "
            f"last longer than {LONGEST_NIGHT_S // 3600} as two windows, such as '18:00-00:00' and '00:00-09:00'."
        )
    closes += DAY_S if closes <= start_s else 0
    opens += DAY_S if opens + DAY_S < closes else 0
    if opens >= closes:
        raise ScenarioError(
            f"The window {text!r} closes before it opens; the day begins at {_clock(start_s)}, and what is over by "
            "then is of the next day."
        )
    return opens, closes


def _clock(seconds: int) -> str:
    return f"{seconds // 3600 % 24:02d}:{seconds % 3600 // 60:02d}"


def _are_two(names: tuple[str, ...]) -> tuple[str, ...]:
    if len(names) != 2:
        raise ValueError(f"{len(names)} names are no road; give two")
    return names


Window = Annotated[str, AfterValidator(_is_window)]


class DayField(Section):
    """A field: its file or sample, when it may be worked, what it is worth, who can work it, where it is.

    `value_per_ha` is what the work brings: left undone it is lost, and its cost is saved. `loss_per_ha` is what is lost
    when the work has to be done on another day, at the same cost. Without either the loss is that of late ground in
    the prices of the farm.
    """

    file: str = Field(strict=True, min_length=1, description="a field file or sample, in quotes")
    name: str | None = other(None, "in quotes", "the name in the file", strict=True, min_length=1)
    local: bool = other(False, "true: the file holds metres", "no", strict=True)
    crs: str | None = other(None, "such as 'EPSG:25832', in quotes", "that of the file", strict=True, min_length=1)
    swap: bool = other(False, "true: the file has latitude or northing first", "no", strict=True)
    windows: tuple[Window, ...] = other((), "such as '08:00-12:00', in quotes", "the whole day")
    value_per_ha: float | None = number(None, 0.0, HIGHEST_PRICE, "what the work of a hectare brings")
    loss_per_ha: float | None = number(None, 0.0, HIGHEST_PRICE, "lost per hectare that is put off")
    implement: str | None = other(None, "of the farm file, in quotes", "any that fits", strict=True)
    operation: str | None = other(None, "till, sow, spray, harvest or mow, in quotes", "any", strict=True)
    lon: float | None = number(None, -180.0, 180.0, "degrees of longitude", "the middle of the field")
    lat: float | None = number(None, -90.0, 90.0, "degrees of latitude", "the middle of the field")

    @model_validator(mode="after")
    def _consistent(self) -> DayField:
        if self.value_per_ha is not None and self.loss_per_ha is not None:
            raise ValueError("value_per_ha and loss_per_ha exclude each other; leave out one of them")
        if (self.lon is None) != (self.lat is None):
            raise ValueError("lon and lat go together; give both in degrees, or neither")
        if self.operation is not None and self.operation not in ORDERS_OF:
            close = nearest(self.operation, ORDERS_OF)
            raise ValueError(f"operation {self.operation!r} is unknown{close}; use {', '.join(ORDERS_OF)}")
        return self


class DayFleet(Section):
    """Tractors of one kind with an implement each, that work one field at a time together."""

    name: str = Field(strict=True, min_length=1, description="in quotes")
    tractor: str | None = other(None, "of the farm file, in quotes", "its first", strict=True)
    count: StrictInt = other(1, "how many", "one", ge=1, le=MOST_TRACTORS)
    implement: str | None = other(None, "of the farm file, in quotes", "the first that fits", strict=True)


class Road(Section):
    """The way between two fields, or a field and the yard, in kilometres of road; the same both ways."""

    between: Annotated[tuple[str, ...], AfterValidator(_are_two)] = Field(description="two names in brackets")
    km: float = Field(ge=0.0, le=MOST_KM, strict=True, allow_inf_nan=False, description="km of road")


class DayFile(Section):
    """A day: what there is to do, with whom, and when."""

    fields: tuple[DayField, ...] = Field(description="one [[fields]] each")
    fleets: tuple[DayFleet, ...] = Field(description="one [[fleets]] each")
    roads: tuple[Road, ...] = other((), "ways between places", "straight lines times road_factor")
    farm: str | None = other(None, "a farm file, or 'example'", "a farm of defaults", strict=True)
    start: Annotated[str | None, AfterValidator(_is_clock)] = other(None, "hh:mm", "shift_start of the farm")
    light: Annotated[str | None, AfterValidator(_is_light)] = other(
        None, "'sun', or hours such as '06:10-20:40'", "robots need none", strict=True
    )
    date: Annotated[str | None, AfterValidator(_is_date)] = other(None, "yyyy-mm-dd in quotes", strict=True)
    utc_offset_h: float | None = number(None, -12.0, 14.0, "hours that clocks are ahead of UTC")
    rain: str | None = other(None, "as --rain of headland plan", "none", strict=True)
    certainty_pct: float | None = number(
        None, 50.0, 99.0, "percent of the draws that keep the times the order is planned by", "planned by mean times"
    )
    strategies: tuple[str, ...] = other(tuple(STRATEGIES), "names in quotes", "all of them")
    yard: Yard | None = other(None, "lon and lat", "that of the farm")

    @field_validator("fields", "fleets", "roads", mode="before")
    @classmethod
    def _are_listed(cls, given: Any) -> Any:
        if isinstance(given, Mapping) or (isinstance(given, list) and not all(isinstance(x, Mapping) for x in given)):
            raise ValueError("write the heading of each with two brackets on either side, as [[fields]]")
        return given


def load_day(
    where: str | Path, *, farm: str | None = None, rain: str | None = None, certainty_pct: float | None = None
) -> tuple[DayFile, FarmFile]:
    """Read a day file and the farm it names; files it names are looked for beside it.

    `farm`, `rain` and `certainty_pct` take the place of what the file says. Raises ScenarioError with every fault of
    the file in one sentence.
    """
    text = read_text(where, "a day file (TOML)", ScenarioError)
    return day_from(text, str(where), Path(where).parent, farm=farm, rain=rain, certainty_pct=certainty_pct)


def day_from(
    text: str, called: str, folder: Path = Path(), *, farm: str | None = None, rain: str | None = None,
    certainty_pct: float | None = None,
) -> tuple[DayFile, FarmFile]:  # fmt: skip
    """The day of a text and its farm; `called` names it in refusals."""
    values: dict[str, Any] = {}
    try:
        values = tomllib.loads(text)
        day = DayFile.model_validate(values)
    except ValidationError as error:
        faults = _with_names(faults_of(error, DayFile, MOST_TOLD), values)
        raise ScenarioError(f"The day file {called} cannot be used: {faults}.") from None
    except (ValueError, RecursionError) as error:
        raise ScenarioError(f"The day file {called} is not TOML: {parse_fault(error)}.") from None
    asked = {"farm": farm, "rain": rain, "certainty_pct": certainty_pct}
    given = {key: value for key, value in asked.items() if value is not None}
    day = _beside(day, folder).model_copy(update=given)
    own = farm_of(day)
    faults = "; ".join(_faults(day, own))
    if faults:
        raise ScenarioError(f"The day file {called} cannot be used: {faults}.")
    return day, own


def farm_of(day: DayFile) -> FarmFile:
    """The farm of a day: its file, the one that comes with Headland, or one of defaults."""
    if day.farm is None:
        return FarmFile()
    return example_farm() if day.farm == EXAMPLE else load_farm(day.farm)


def start_of(day: DayFile, farm: FarmFile) -> int:
    """When the day begins, seconds of the day; raises ScenarioError where neither file says so."""
    if day.start is not None:
        return parse_clock(day.start, "start_s")
    begins = farm.times.shift_s[0]
    if begins is None:
        raise ScenarioError("The day has no start; give start = 'hh:mm' in the day file, or shift_start in the farm.")
    return begins


def machines_of(fleet: DayFleet, farm: FarmFile) -> tuple[FarmTractor, FarmImplement]:
    """Tractor and implement of a fleet by the farm file; raises ScenarioError."""
    tractor = farm.tractor(fleet.tractor)
    if fleet.implement is None:
        fitting = next((each for each in farm.implements if farm.fits(tractor, each)), None)
        return tractor, fitting or farm.implement()
    implement = farm.implement(fleet.implement)
    if not farm.fits(tractor, implement):
        raise ScenarioError(
            f"The implement {implement.name!r} of the fleet {fleet.name!r} does not fit its tractor {tractor.name!r} "
            "by the farm file; choose another of them."
        )
    return tractor, implement


def suits(field: DayField, implement: FarmImplement) -> bool:
    """Whether an implement does what a field asks for."""
    right = field.implement in (None, implement.name)
    return right and field.operation in (None, implement.operation or "till")


def example_text() -> str:
    """The day file that comes with Headland, as text."""
    return (resources.files("planner.day") / "example.toml").read_text(encoding="utf-8")


def _beside(day: DayFile, folder: Path) -> DayFile:
    """The day with files and its farm as seen from here."""

    def seen(file: str) -> str:
        sample = file in sample_names()
        return file if sample else str(folder / file)

    fields = tuple(each.model_copy(update={"file": seen(each.file)}) for each in day.fields)
    found: dict[str, Any] = {"fields": fields}
    if day.farm not in (None, EXAMPLE):
        found["farm"] = str(folder / str(day.farm))
    if day.rain is not None and day.rain.strip().lower().endswith(".csv"):
        found["rain"] = str(folder / day.rain.strip())
    return day.model_copy(update=found)


def _with_names(faults: str, values: Mapping[str, Any]) -> str:
    """Faults with fields and fleets called by their names, where they have any, instead of their numbers."""

    def called(match: re.Match[str]) -> str:
        kind, place = match[1], int(match[2])
        name = values[kind][place].get("name") if isinstance(values[kind][place], Mapping) else None
        return f"{kind}.{name}" if isinstance(name, str) and name else f"{kind} no. {place + 1}"

    return re.sub(r"\b(fields|fleets|roads)\.(\d+)(?=[.:])", called, faults)


def _faults(day: DayFile, farm: FarmFile) -> Iterator[str]:
    """What does not go together."""
    empty = [what for what in ("fields", "fleets") if not getattr(day, what)]
    yield from (f"{what} is empty; give one or more under [[{what}]]" for what in empty)
    if empty:
        return
    yield from _twice([fleet.name for fleet in day.fleets], "fleets have")
    yield from _twice([field.name for field in day.fields if field.name], "fields have")
    for field in day.fields:
        if field.name == YARD:
            yield f"a field is called {YARD!r}, which is where the fleets come from; give it another name"
    for name in day.strategies:
        if name not in STRATEGIES:
            yield f"the strategy {name!r} is unknown{nearest(name, STRATEGIES)}; use {', '.join(STRATEGIES)}"
    if not day.strategies:
        yield "strategies is empty; name one or more, or leave it out"
    yield from _too_many(day, farm)
    implements = [machines_of(fleet, farm)[1] for fleet in day.fleets]
    for field in day.fields:
        if field.implement is not None:
            farm.implement(field.implement)
        if not any(suits(field, implement) for implement in implements):
            asked = f"the implement {field.implement!r}" if field.implement else f"the operation {field.operation!r}"
            have = ", ".join(dict.fromkeys(f"{each.name} ({each.operation or 'till'})" for each in implements))
            yield f"no fleet fits {brief(field.name or field.file)}, which asks for {asked}; the fleets have {have}"
    if day.light == SUN and (day.date is None or day.utc_offset_h is None):
        yield f"light = {SUN!r} needs a date and utc_offset_h (2.0 for summer in central Europe); give both"
    begins, light = start_of(day, farm), [] if day.light in (None, SUN) else [str(day.light)]
    for text in (*(window for field in day.fields for window in field.windows), *light):
        placed(text, begins)


def _twice(names: Sequence[str], whose: str) -> Iterator[str]:
    for name in sorted({name for name in names if names.count(name) > 1}):
        yield f"two {whose} the name {brief(name)}; give each its own"


def _too_many(day: DayFile, farm: FarmFile) -> Iterator[str]:
    """Tractors that the farm does not have."""
    asked: dict[str, int] = {}
    for fleet in day.fleets:
        name = farm.tractor(fleet.tractor).name
        asked[name] = asked.get(name, 0) + fleet.count
    for name, count in asked.items():
        has = farm.tractor(name).count
        if count > has:
            yield f"the fleets have {count} x {name} together, and the farm {has}; change count here or there"
