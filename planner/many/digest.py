"""What an answer depends on, in a few letters: the same letters mean that it need not be worked out again."""

from __future__ import annotations

import glob
import hashlib
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from fields.source import source_of

if TYPE_CHECKING:
    from planner.asked import Asked

ROOMS = ("fields", "vehicle", "strategies", "planner", "reports")


@cache
def code_digest() -> str:
    """SHA-256 of Headland itself, its source and its tables: a changed planner has other answers."""
    home, digest = Path(__file__).parents[2], hashlib.sha256()
    kinds = (".py", ".toml", ".csv", ".geojson")
    for path in sorted(path for room in ROOMS for path in (home / room).rglob("*") if path.suffix in kinds):
        digest.update(str(path.relative_to(home)).encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _files(name: str) -> list[Path]:
    """The file of a name, or all in its folder: a field may be several files."""
    path = Path(name)
    if path.is_dir():
        return sorted(each for each in path.rglob("*") if each.is_file())
    beside = path.parent.glob(f"{glob.escape(path.stem)}.*") if path.suffix.lower() == ".shp" else [path]
    return sorted(each for each in beside if each.is_file())


def question_digest(asked: Asked, every: bool = False) -> str:
    """SHA-256 of all that the answer to a question depends on: its values, its files and the code."""
    scenario = asked.scenario
    parts = [
        code_digest(),
        repr(sorted(asdict(scenario).items())),
        *(repr(each) for each in (asked.tractor, asked.implement, asked.terms, asked.chances)),
        *(repr(each) for each in (asked.supply, asked.times, asked.yard, every)),
    ]
    digest = hashlib.sha256("\0".join(parts).encode())
    names = (source_of(scenario.field).place, scenario.tractor, asked.tractor, scenario.rain, scenario.gnss_table)
    for name in names:
        for path in _files(name) if isinstance(name, str) else ():
            digest.update(path.read_bytes() + b"\0")
    return digest.hexdigest()
