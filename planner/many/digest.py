"""What the answer to a question depends on, in a few letters."""

from __future__ import annotations

import glob
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from fields.source import source_of
from planner.content import digest

if TYPE_CHECKING:
    from planner.asked import Asked


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
    names = (source_of(scenario.field).place, scenario.tractor, asked.tractor, scenario.rain, scenario.gnss_table)
    read = [path.read_bytes() for name in names if isinstance(name, str) for path in _files(name)]
    return digest(asked, every, [sha256(content).hexdigest() for content in read])
