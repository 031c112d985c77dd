"""Finds the formats of field and guidance files: the records of the modules beside this one."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import TypeVar

Record = TypeVar("Record")


def list_records(kind: type[Record], first: Sequence[str]) -> tuple[Record, ...]:
    """The records of a kind in all modules, each once; modules named `first` come first, then the others by name."""
    names = dict.fromkeys([*first, *sorted(module.name for module in iter_modules([str(Path(__file__).parent)]))])
    modules = [import_module(f"fields.formats.{name}") for name in names]
    records = [value for module in modules for value in vars(module).values() if isinstance(value, kind)]
    return tuple({id(record): record for record in records}.values())
