"""What an answer depends on, in a few letters: the same letters mean that it need not be worked out again."""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import json
import platform
from collections.abc import Iterator, Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import shapely
from pydantic import BaseModel

ROOMS = ("fields", "vehicle", "strategies", "planner", "reports")
LIBRARIES = ("numba", "numpy", "ortools", "pymunk", "pyogrio", "pyproj", "scipy", "shapely")
SOURCE = ".py"
KINDS = (SOURCE, ".toml", ".csv", ".geojson")
BY_NAME = "import_module"  # whoever calls it may load any module beside itself


def digest(*parts: Any, worker: str | None = None) -> str:
    """SHA-256 of content: of plain values, dataclasses, models and geometries, and of the code that works on them.

    That is what the module `worker` imports, and all that there is without one.
    """
    text = json.dumps([_plain(part) for part in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(f"{code_version(worker)}\n{text}".encode()).hexdigest()


@cache
def code_version(worker: str | None = None) -> str:
    """SHA-256 of Headland itself, its source and its tables, and the versions of what it stands on.

    With the name of a module only the source counts that it imports, wherever in it and through whatever modules;
    of packages on the way what is named is followed, and not all that they gather.
    """
    root, found = Path(__file__).parents[1], hashlib.sha256()
    used = None if worker is None else _imported(root, worker)
    for room in ROOMS:
        for path in sorted(path for path in (root / room).rglob("*") if path.suffix in KINDS):
            if used is None or path.suffix != SOURCE or path in used:
                found.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for library in LIBRARIES:
        try:
            found.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            found.update(library.encode())
    found.update(f"{platform.machine()} {platform.python_version()}".encode())
    return found.hexdigest()


def _imported(root: Path, worker: str) -> set[Path]:
    """The files of a module and of all modules of Headland that it imports, directly or not."""
    found: set[Path] = set()
    todo = [path for path in [_file(root, worker)] if path]
    while todo:
        path = todo.pop()
        if path not in found:
            found.add(path)
            todo += _named(root, path)
    folders = {folder for path in found for folder in path.parents if root in folder.parents}
    return found | {folder / f"__init__{SOURCE}" for folder in folders}


def _named(root: Path, path: Path) -> Iterator[Path]:
    """The modules of Headland that the source of a file names where it imports."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            inside = [f"{node.module}.{alias.name}" for alias in node.names]
            names = inside if all(_file(root, name) for name in inside) else [node.module, *inside]
        elif isinstance(node, ast.Name) and node.id == BY_NAME:
            yield from path.parent.glob(f"*{SOURCE}")
        yield from (file for name in names if (file := _file(root, name)))


def _file(root: Path, module: str) -> Path | None:
    """The source of a module of Headland, None for others."""
    place = root.joinpath(*module.split("."))
    files = (place.with_suffix(SOURCE), place / f"__init__{SOURCE}")
    return next((path for path in files if module.split(".")[0] in ROOMS and path.is_file()), None)


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
