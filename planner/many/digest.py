"""What the answer to a question depends on, in a few letters."""

from __future__ import annotations

import os
from hashlib import file_digest
from pathlib import Path
from typing import TYPE_CHECKING

from fields.source import field_files
from planner.content import digest

if TYPE_CHECKING:
    from planner.asked import Asked


def question_digest(asked: Asked, every: bool = False) -> str:
    """SHA-256 of all that the answer to a question depends on: its values, its files and the code."""
    scenario = asked.scenario
    names = (scenario.tractor, asked.tractor, scenario.rain, scenario.gnss_table)
    files = [Path(name) for name in names if isinstance(name, str) and os.path.isfile(name)]
    return digest(asked, every, [_content(path) for path in (*field_files(scenario.field), *files)])


def _content(path: Path) -> str | None:
    """SHA-256 of a file, None for one that is not there."""
    if not os.path.isfile(path):
        return None
    with path.open("rb") as stream:
        return file_digest(stream, "sha256").hexdigest()
