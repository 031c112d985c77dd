"""Finds the formats of field and guidance files: the records of the modules beside this one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TypeVar

Record = TypeVar("Record")


def list_records(kind: type[Record], first: Sequence[str]) -> tuple[Record, ...]:
    """The records of a kind in all modules, each once; modules named `first` come first, then the others by name."""
    return tuple({id(record): record for record in _iter_records(kind, first)}.values())


def _iter_records(kind: type[Record], first: Sequence[str]) -> Iterator[Record]:
    names = dict.fromkeys([*first, *sorted(module.name for module in iter_modules([str(Path(__file__).parent)]))])
    for name in names:
        values = vars(import_module(f"fields.formats.{name}")).values()
        yield from (value for value in values if isinstance(value, kind))
