"""Answers in a file, one line of JSON each, written when they are known; a table that was interrupted goes on."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from fields.reading import reason
from planner.errors import ScenarioError, named

KEY = "key"
Record = dict[str, Any]


class KeptError(ScenarioError):
    """A file of answers that is none."""


def read_kept(path: Path) -> dict[str, Record]:
    """Records of a file of answers by their key; none where there is no file yet.

    A last line that was cut off in the middle is left out. Raises KeptError for a file of something else.
    """
    if not path.exists():
        return {}
    try:
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    except (OSError, UnicodeDecodeError) as error:
        why = reason(error) if isinstance(error, OSError) else "it is not text"
        raise KeptError(f"The file of answers ({named('keep')}) {path} cannot be read: {why}.") from None
    records = [_record(path, number, line) for number, line in enumerate(lines, start=1) if line.endswith("\n")]
    return {record[KEY]: record for record in records}


def _record(path: Path, number: int, line: str) -> Record:
    try:
        record = json.loads(line)
        if isinstance(record, dict) and isinstance(record[KEY], str):
            return record
    except (ValueError, KeyError):
        pass
    raise KeptError(f"Line {number} of {path} ({named('keep')}) is no answer of Headland; name another file.")


class Keeper:
    """Appends records to a file, each on the disk before the next is begun; without a path it keeps nothing."""

    def __init__(self, path: Path | None) -> None:
        self._path = path

    def begin(self, records: Iterable[Record]) -> None:
        """Write what is kept already, whole lines only."""
        if self._path is not None:
            _replace(self._path, records)

    def keep(self, record: Mapping[str, Any]) -> None:
        """Add one."""
        if self._path is None:
            return
        with self._path.open("a", encoding="utf-8", newline="\n") as file:
            file.write(_line(record))
            file.flush()
            os.fsync(file.fileno())

    def end(self, records: Iterable[Record]) -> None:
        """All of them in the order they were asked for, whatever order they were done in."""
        self.begin(records)


def _replace(path: Path, records: Iterable[Record]) -> None:
    draft = path.with_name(path.name + ".part")
    draft.write_text("".join(_line(record) for record in records), encoding="utf-8", newline="\n")
    draft.replace(path)


def _line(record: Mapping[str, Any]) -> str:
    return json.dumps(record, ensure_ascii=False) + "\n"
