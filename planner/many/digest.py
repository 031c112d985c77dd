"""What the answer to a question depends on, in a few letters."""

from __future__ import annotations

import os
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

from fields.source import source_of
from planner.content import digest

if TYPE_CHECKING:
    from planner.asked import Asked


def question_digest(asked: Asked, every: bool = False) -> str:
    """SHA-256 of all that the answer to a question depends on: its values, its files and the code."""
    scenario = asked.scenario
    names = (source_of(scenario.field).place, scenario.tractor, asked.tractor, scenario.rain, scenario.gnss_table)
    read = [Path(name).read_bytes() for name in names if isinstance(name, str) and os.path.isfile(name)]
    return digest(asked, every, [sha256(content).hexdigest() for content in read])
