"""All values of a farm in use, each with its source."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from typing import Any

from planner.farm.inventory import FarmFile
from planner.farm.settings import FileSection, LearnedValue, get_default_source
from vehicle.model.tractor import Tractor
from vehicle.trials.sheets.sheet import ExperimentSheet, TextTable

GIVEN, OWN_LOGS = "given", "own logs: "
SECTIONS = ("prices", "times", "uncertainty", "yard")


@dataclass(frozen=True)
class FarmValue:
    """One value: section, key, value (possibly None), description with unit, and source."""

    section: str
    key: str
    value: Any
    description: str
    source: str

    @property
    def is_given(self) -> bool:
        """Whether the file has it, of its own or learned from logs."""
        return self.source == GIVEN or self.source.startswith(OWN_LOGS)


def list_values(farm: FarmFile) -> tuple[FarmValue, ...]:
    """All values except the datasheets of tractors, in the order of the file."""
    values: list[FarmValue] = []
    learned_by_key = {one.key: one for one in farm.learned}
    for kind, machines in (("tractors", farm.tractors), ("implements", farm.implements)):
        is_given = kind in farm.model_fields_set
        for machine in machines:
            values += _iterate_values(
                f"{kind} {machine.name}", machine, is_given, learned_by_key, skip=("name", "sheet")
            )
    for name in SECTIONS:
        values += _iterate_values(name, getattr(farm, name), True, learned_by_key)
    return tuple(values)


def find_unchanged_learned_values(farm: FarmFile) -> tuple[LearnedValue, ...]:
    """Learned values that the file still has."""
    values = {f"{value.section.replace(' ', '.', 1)}.{value.key}": value.value for value in list_values(farm)}
    return tuple(one for one in farm.learned if one.key in values and values[one.key] == one.value)


def _iterate_values(
    name: str,
    section: FileSection,
    is_given: bool,
    learned_by_key: Mapping[str, LearnedValue],
    skip: tuple[str, ...] = (),
) -> Iterator[FarmValue]:
    for key, info in type(section).model_fields.items():
        if key in skip:
            continue
        source = GIVEN if is_given and key in section.model_fields_set else get_default_source(type(section), key)
        learned_value = learned_by_key.get(f"{name.replace(' ', '.', 1)}.{key}")
        if source == GIVEN and learned_value is not None and learned_value.value == getattr(section, key):
            source = f"{OWN_LOGS}{learned_value.format_with_interval()}"
        yield FarmValue(name, key, getattr(section, key), info.description or "", source)


def format_farm_json(farm: FarmFile) -> str:
    """All values with their sources, and the machine of every kind of tractor, as JSON."""
    content: dict[str, Any] = {
        "tractors": [
            {"name": each.name, "count": each.count, **_describe_machine(each.build_tractor())}
            for each in farm.tractors
        ],
        "implements": [each.name for each in farm.implements],
        "values": [asdict(value) for value in list_values(farm)],
    }
    return json.dumps(content, indent=2, allow_nan=False) + "\n"


def _describe_machine(machine: Tractor) -> dict[str, float]:
    return {
        "mass_kg": machine.mass_kg,
        "wheelbase_m": round(machine.wheelbase_m, 6),
        "width_m": machine.width_m,
        "radius_soil_m": machine.compute_smallest_radius_m("soil"),
    }


def build_farm_sheet(farm: FarmFile, label: str, *, with_values: bool = True) -> ExperimentSheet:
    """The farm as a page: a description, and how many values each section gives, or all with their sources."""
    sentences, values = list[str](), list_values(farm)
    for tractor in farm.tractors:
        facts = _describe_machine(tractor.build_tractor())
        sentences.append(
            f"{tractor.count} x {tractor.name}: {facts['mass_kg']:g} kg, {facts['width_m']:g} m wide, turning radius "
            f"{facts['radius_soil_m']:.2f} m on soil."
        )
    for implement in farm.implements:
        load = implement.area_per_load_m2
        load_text = "" if load is None else f", {load / 10_000.0:.3g} ha per load"
        tractors_text = f", for {', '.join(implement.tractors)}" if implement.tractors else ""
        sentences.append(f"{implement.name}: {implement.width_m:g} m{load_text}{tractors_text}.")
    given_count = sum(value.is_given for value in values)
    sentences.append(f"{given_count} of {len(values)} values are given; the others are defaults.")
    by_section: dict[str, list[FarmValue]] = {}
    for value in values:
        by_section.setdefault(value.section, []).append(value)
    if with_values:
        tables = tuple(
            TextTable(
                f"[{section}]",
                ("Key", "Value", "Source"),
                tuple((f"{v.key}, {v.description}", format_value(v.value), v.source) for v in own),
            )
            for section, own in by_section.items()
        )
    else:
        defaults = {section: sum(not v.is_given for v in own) for section, own in by_section.items()}
        rows = tuple((f"[{name}]", str(len(by_section[name]) - count), str(count)) for name, count in defaults.items())
        tables = (TextTable("Values (--explain lists them)", ("Section", "Given", "Defaults"), rows),)
    return ExperimentSheet("farm", f"The farm of {label}", tuple(sentences), (), (), tables)


def format_value(value: Any) -> str:
    """A value as people read it."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, tuple):
        return ", ".join(map(str, value)) or "-"
    return f"{value:g}" if isinstance(value, float) else str(value)
