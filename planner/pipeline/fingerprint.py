"""Hashes of everything that a result depends on: while the hash stays the same, a cached result is still valid."""

from __future__ import annotations

import ast
import dataclasses
import hashlib
import json
import platform
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from pydantic import BaseModel

from fields.documents.sources import list_field_files, parse_field_reference
from fields.errors import FieldError
from fields.formats.archive import ArchiveMembers
from fields.formats.isoxml import TASKDATA_FILE
from fields.terrain.point_files import AGOPENGPS_FILE
from planner.evaluation.work_order import match_plan_time

PACKAGES = ("fields", "vehicle", "strategies", "planner", "reports")
LIBRARIES = ("numba", "numpy", "ortools", "pymunk", "pyogrio", "pyproj", "scipy", "shapely")
SOURCE_SUFFIX = ".py"
FILE_SUFFIXES = (SOURCE_SUFFIX, ".toml", ".csv", ".geojson")
DYNAMIC_IMPORT = "import_module"  # a module that calls it may load any module in its own folder


def hash_content(*parts: Any, worker: str | None = None) -> str:
    """SHA-256 of plain values, dataclasses, models, arrays and geometries, and of the code that works on them.

    The code is what the module `worker` imports, directly or not; without one, all of Headland.
    """
    text = json.dumps([_convert_to_plain(part) for part in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(f"{hash_code(worker)}\n{text}".encode()).hexdigest()


def hash_file(path: Path) -> str | None:
    """SHA-256 of a file; None if it does not exist or cannot be read."""
    if not path.is_file():  # a pipe would wait for ever
        return None
    try:
        with path.open("rb") as stream:
            return hashlib.file_digest(stream, "sha256").hexdigest()
    except OSError:
        return None


def hash_strategies(names: Collection[str]) -> list[str | None]:
    """SHA-256 of the source files of strategies that are of other packages, which `hash_code` leaves out."""
    from strategies.registry import list_source_files

    return [hash_file(path) for path in list_source_files(names)]


@cache
def hash_code(worker: str | None = None) -> str:
    """SHA-256 of Headland's source and tables, and of the versions of its libraries.

    With the name of a module only the source that it imports counts, directly or through other modules. Of a package
    only the modules that are named are followed, not all that it contains.
    """
    root, digest = Path(__file__).parents[2], hashlib.sha256()
    used_files = None if worker is None else _find_imported_files(root, worker)
    for package in PACKAGES:
        for path in sorted(path for path in (root / package).rglob("*") if path.suffix in FILE_SUFFIXES):
            if used_files is None or path.suffix != SOURCE_SUFFIX or path in used_files:
                digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for library in LIBRARIES:
        try:
            digest.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            digest.update(library.encode())
    digest.update(f"{platform.machine()} {platform.python_version()}".encode())
    return digest.hexdigest()


def _find_imported_files(root: Path, worker: str) -> set[Path]:
    """The files of a module and of all modules of Headland that it imports, directly or not."""
    files: set[Path] = set()
    pending = [path for path in [_find_source_file(root, worker)] if path]
    while pending:
        path = pending.pop()
        if path not in files:
            files.add(path)
            pending += _list_imported_modules(root, path)
    folders = {folder for path in files for folder in path.parents if root in folder.parents}
    return files | {folder / f"__init__{SOURCE_SUFFIX}" for folder in folders}


def _list_imported_modules(root: Path, path: Path) -> Iterator[Path]:
    """The files of the Headland modules that a file imports."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        names: list[str] = []
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            submodules = [f"{node.module}.{alias.name}" for alias in node.names]
            names = (
                submodules if all(_find_source_file(root, name) for name in submodules) else [node.module, *submodules]
            )
        elif isinstance(node, ast.Name) and node.id == DYNAMIC_IMPORT:
            yield from path.parent.glob(f"*{SOURCE_SUFFIX}")
        yield from (file for name in names if (file := _find_source_file(root, name)))


def _find_source_file(root: Path, module: str) -> Path | None:
    """The source file of a Headland module; None for other modules."""
    place = root.joinpath(*module.split("."))
    files = (place.with_suffix(SOURCE_SUFFIX), place / f"__init__{SOURCE_SUFFIX}")
    return next((path for path in files if module.split(".")[0] in PACKAGES and path.is_file()), None)


def _convert_to_plain(value: Any) -> Any:
    """A value in the types of JSON; equal content gives equal values."""
    if isinstance(value, shapely.Geometry):
        return shapely.to_wkb(value, hex=True)
    if isinstance(value, np.ndarray):
        return [str(value.dtype), value.shape, hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {each.name: _convert_to_plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _convert_to_plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_convert_to_plain(item) for item in value]
    return value if value is None or isinstance(value, str | int | float | bool) else repr(value)


def hash_height_files(name: str | None) -> list[tuple[str, str | None]] | None:
    """What heights of this name hold: hashes by the ends of the files' names; None without heights.

    The files are those of the same stem, as one beside the heights may say their coordinate system, or those that are
    read in a folder.
    """
    if name is None:
        return None
    place = Path(name)
    folder, stem = (place, "") if place.is_dir() else (place.parent, place.stem.lower())
    return [(str(path.relative_to(folder)).lower()[len(stem) :], hash_file(path)) for path in _list_height_files(place)]


def _list_height_files(place: Path) -> Iterable[Path]:
    """The files of heights; none where they cannot be listed, which is refused when they are read."""
    with suppress(OSError, ValueError, FieldError):
        if not place.is_dir():
            start = f"{place.stem}.".lower()
            return sorted(path for path in place.parent.iterdir() if f"{path.name}.".lower().startswith(start))
        own = sorted(path for path in place.iterdir() if path.name.lower() == AGOPENGPS_FILE)
        return own or [place / member for member in ArchiveMembers(place)]
    return []


def hash_sources(sources: Sequence[str]) -> list[tuple[str, str | None]]:
    """What sources of done work hold: for each file its hash, with its key or the time at which a plan is left."""
    found = list[tuple[str, str | None]]()
    for source in sources:
        match = match_plan_time(source)
        if match is None:
            named = parse_field_reference(source)
            found += [(named.key or "", hash_file(one)) for one in _list_source_files(Path(named.place))]
        else:
            found.append((match[0].rpartition("@")[2], hash_file(Path(match["file"]))))
    return found


def _list_source_files(path: Path) -> list[Path]:
    """What a folder, or a file of ground or logs, is read from: all parts of a Shapefile, and logs beside task data."""
    if path.is_dir():
        return sorted(one for one in path.rglob("*") if one.is_file())
    logs = path.parent.glob("*.[bB][iI][nN]") if path.name.lower() == TASKDATA_FILE else ()
    return [*list_field_files(str(path)), *sorted(logs)]
