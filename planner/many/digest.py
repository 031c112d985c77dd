"""What an answer depends on, in a few letters: the same letters mean that it need not be worked out again."""

from __future__ import annotations

import hashlib
import os
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
        if isinstance(name, str) and os.path.isfile(name):
            digest.update(Path(name).read_bytes() + b"\0")
    return digest.hexdigest()
