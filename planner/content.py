"""What an answer depends on, in a few letters: the same letters mean that it need not be worked out again."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import platform
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import shapely
from pydantic import BaseModel

ROOMS = ("fields", "vehicle", "strategies", "planner", "reports")
LIBRARIES = ("numba", "numpy", "ortools", "pymunk", "pyogrio", "pyproj", "scipy", "shapely")
KINDS = (".py", ".toml", ".csv", ".geojson")


def digest(*parts: Any) -> str:
    """SHA-256 of content: of plain values, dataclasses, models and geometries, and of the code that works on them."""
    text = json.dumps([_plain(part) for part in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(f"{code_version()}\n{text}".encode()).hexdigest()


@cache
def code_version() -> str:
    """SHA-256 of Headland itself, its source and its tables, and the versions of what it stands on."""
    root, found = Path(__file__).parents[1], hashlib.sha256()
    for room in ROOMS:
        for path in sorted(path for path in (root / room).rglob("*") if path.suffix in KINDS):
            found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for library in LIBRARIES:
        try:
            found.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            found.update(library.encode())
    found.update(f"{platform.machine()} {platform.python_version()}".encode())
    return found.hexdigest()


def _plain(value: Any) -> Any:
    """A value as JSON has it, the same for the same content."""
    if isinstance(value, shapely.Geometry):
        return shapely.to_wkb(value, hex=True)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {each.name: _plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, str | int | float | bool) else repr(value)
