"""Every value of a farm in use, with its origin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from planner.farm.file import FarmFile
from planner.farm.values import Section, source_of

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
    for kind, machines in (("tractors", farm.tractors), ("implements", farm.implements)):
        given = kind in farm.model_fields_set
        for each in machines:
            found += _values(f"{kind} {each.name}", each, given, skip=("name", "sheet"))
    for name in SECTIONS:
        found += _values(name, getattr(farm, name), True)
    return tuple(found)


def _values(name: str, section: Section, given: bool, skip: tuple[str, ...] = ()) -> Iterator[Value]:
    for key, info in type(section).model_fields.items():
        if key in skip:
            continue
        source = GIVEN if given and key in section.model_fields_set else source_of(type(section), key)
        yield Value(name, key, getattr(section, key), info.description or "", source)
