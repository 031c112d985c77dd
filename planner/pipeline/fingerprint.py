"""Hashes of everything that a result depends on: while the hash stays the same, a cached result is still valid."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import platform
from collections.abc import Collection, Iterable, Mapping, Sequence
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
FILE_SUFFIXES = (".py", ".toml", ".csv", ".geojson")


def hash_content(*parts: Any) -> str:
    """SHA-256 of plain values, dataclasses, models, arrays and geometries, and of the code that works on them."""
    text = json.dumps([_convert_to_plain(part) for part in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(f"{hash_code()}\n{text}".encode()).hexdigest()


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
def hash_code() -> str:
    """SHA-256 of Headland's source and tables, and of the versions of its libraries."""
    root, digest = Path(__file__).parents[2], hashlib.sha256()
    for package in PACKAGES:
        for path in sorted(path for path in (root / package).rglob("*") if path.suffix in FILE_SUFFIXES):
            digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    for library in LIBRARIES:
        try:
            digest.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            digest.update(library.encode())
    digest.update(f"{platform.machine()} {platform.python_version()}".encode())
    return digest.hexdigest()


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
