"""Every value of a farm in use, with its origin."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from planner.farm.file import FarmFile
from planner.farm.learned import LearnedValue
from planner.farm.values import Section, source_of
from vehicle.tractor import Tractor
from vehicle.trials.sheets.sheet import Sheet, TextTable

GIVEN = "given"
SECTIONS = ("prices", "times", "chances", "yard")


@dataclass(frozen=True)
class Value:
    """One value: its section, key, value (None: none), what it is with its unit, and where it is from."""

    section: str
    key: str
    value: Any
    words: str
    source: str


def values_of(farm: FarmFile) -> tuple[Value, ...]:
    """Every value but for the datasheets of tractors, in the order of the file."""
    found: list[Value] = []
    taught = {one.key: one for one in farm.learned}
    for kind, machines in (("tractors", farm.tractors), ("implements", farm.implements)):
        given = kind in farm.model_fields_set
        for each in machines:
            found += _values(f"{kind} {each.name}", each, given, taught, skip=("name", "sheet"))
    for name in SECTIONS:
        found += _values(name, getattr(farm, name), True, taught)
    return tuple(found)


def learned_in_use(farm: FarmFile) -> tuple[LearnedValue, ...]:
    """What logs taught, as far as the file still has the values."""
    values = {f"{value.section.replace(' ', '.', 1)}.{value.key}": value.value for value in values_of(farm)}
    return tuple(one for one in farm.learned if one.key in values and values[one.key] == one.value)


def _values(
    name: str, section: Section, given: bool, taught: Mapping[str, LearnedValue], skip: tuple[str, ...] = ()
) -> Iterator[Value]:
    for key, info in type(section).model_fields.items():
        if key in skip:
            continue
        source = GIVEN if given and key in section.model_fields_set else source_of(type(section), key)
        own = taught.get(f"{name.replace(' ', '.', 1)}.{key}")
        if source == GIVEN and own is not None and own.value == getattr(section, key):
            source = f"own logs: {own.words()}"
        yield Value(name, key, getattr(section, key), info.description or "", source)


def farm_json(farm: FarmFile) -> str:
    """Every value with its origin, and per kind of tractor the machine it stands for, as JSON."""
    content: dict[str, Any] = {
        "tractors": [
            {"name": each.name, "count": each.count, **_facts(each.machine())} for each in farm.tractors
        ],
        "implements": [each.name for each in farm.implements],
        "values": [asdict(value) for value in values_of(farm)],
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _facts(machine: Tractor) -> dict[str, float]:
    return {
        "mass_kg": machine.mass_kg,
        "wheelbase_m": round(machine.wheelbase_m, 6),
        "width_m": machine.width_m,
        "radius_soil_m": machine.smallest_radius_m("soil"),
    }


def farm_sheet(farm: FarmFile, called: str) -> Sheet:
    """The farm in words, and every value with its origin."""
    return Sheet("farm", f"The farm of {called}", tuple(_words(farm)), (), (), tuple(_tables(farm)))


def _words(farm: FarmFile) -> Iterator[str]:
    for tractor in farm.tractors:
        facts = _facts(tractor.machine())
        yield (
            f"{tractor.count} x {tractor.name}: {facts['mass_kg']:g} kg, {facts['width_m']:g} m wide, turns on "
            f"{facts['radius_soil_m']:.2f} m on soil."
        )
    for implement in farm.implements:
        load = implement.area_per_load_m2
        lasts = "" if load is None else f", a load lasts for {load / 10_000.0:.3g} ha"
        fits = f", for {', '.join(implement.tractors)}" if implement.tractors else ""
        yield f"{implement.name}: {implement.width_m:g} m{lasts}{fits}."
    values = values_of(farm)
    given = sum(value.source == GIVEN for value in values)
    yield f"{given} of {len(values)} values are given; the others are defaults."


def _tables(farm: FarmFile) -> Iterator[TextTable]:
    values = values_of(farm)
    for section in dict.fromkeys(value.section for value in values):
        rows = tuple((f"{v.key}, {v.words}", _shown(v.value), v.source) for v in values if v.section == section)
        yield TextTable(f"[{section}]", ("Key", "Value", "Source"), rows)


def _shown(value: Any) -> str:
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "-"
    return f"{value:g}" if isinstance(value, float) else str(value)
