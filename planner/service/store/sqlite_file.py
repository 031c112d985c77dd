"""The file of an SQLite database: its connections see when it was moved away, and no other file takes its place.

An open connection goes on in a file that was moved, and a new one would make an empty file at the old place, which
breaks the log of changes that lies beside it.
"""

from __future__ import annotations

import os
import sqlite3
import threading
from pathlib import Path
from typing import Any

import sqlalchemy as sa

GONE = "its file {path} is gone; bring it back"
LOG_LEFT = "its file is gone, but its log {log} is there; bring the file back, or delete the log to begin anew"
REPLACED = "its file {path} was replaced by another database; bring the first one back, or start the service again"
SELECT_MARK, MARK_PLACE, MARK_BYTES = "PRAGMA application_id", 68, 4
"""A number in the head of the file, drawn by a migration, by which copies of one database know one another. It is read
from the file itself: SQLite would take the log beside it for that of a stranger, and write it there."""


class SqliteFile:
    """Watches the connections of an engine; once its file is kept, none is made, and none of another mark is used."""

    def __init__(self, engine: sa.Engine, path: Path) -> None:
        self._engine, self._path = engine, path
        self._mark: int | None = None
        self._open_file: tuple[tuple[int, int], int] | None = None
        self._lock = threading.Lock()
        sa.event.listen(engine, "do_connect", self._check_there)
        sa.event.listen(engine, "connect", self._note_file)
        sa.event.listen(engine, "checkout", self._check_unmoved)
        sa.event.listen(engine, "engine_disposed", self._close)

    def keep(self) -> None:
        """Use only this database from now on."""
        with self._engine.connect() as connection:
            for statement in ("COMMIT", "PRAGMA wal_checkpoint(PASSIVE)", "BEGIN"):  # brings the mark into the file
                connection.exec_driver_sql(statement)
            mark = connection.exec_driver_sql(SELECT_MARK).scalar_one()
        self._mark = mark if mark == self._read_mark() else None

    def _check_there(self, _dialect: Any, _record: Any, _arguments: Any, _named: Any) -> None:
        log = self._path.with_name(f"{self._path.name}-wal")
        if not self._path.exists() and (self._mark is not None or log.exists()):
            sentence = GONE if self._mark is not None else LOG_LEFT
            raise sqlite3.OperationalError(sentence.format(path=self._path, log=log.name))
        if self._mark is not None and self._read_mark() != self._mark:
            raise sqlite3.OperationalError(REPLACED.format(path=self._path))

    def _read_mark(self) -> int | None:
        """The mark in the file, None where there is no file to read.

        The file stays open: a process that closes one of its descriptors gives up all its locks on the file, and the
        next to close the database would take the log of changes away.
        """
        with self._lock:
            found = self._find_file()
            if found is None:
                return None
            try:
                if self._open_file is None or self._open_file[0] != found:
                    self._open_file = found, os.open(self._path, os.O_RDONLY | getattr(os, "O_BINARY", 0))
                descriptor = self._open_file[1]
                os.lseek(descriptor, MARK_PLACE, os.SEEK_SET)
                return int.from_bytes(os.read(descriptor, MARK_BYTES), "big")
            except OSError:
                return None

    def _close(self, _engine: sa.Engine) -> None:
        """Close the file once its connections are closed."""
        with self._lock:
            if self._open_file is not None:
                os.close(self._open_file[1])
                self._open_file = None

    def _note_file(self, _connection: sqlite3.Connection, record: Any) -> None:
        record.info["file"] = self._find_file()

    def _check_unmoved(self, _connection: Any, record: Any, _proxy: Any) -> None:
        """Replace all connections of before where another file, or none, is there now."""
        if record.info.get("file") != self._find_file():
            raise sa.exc.InvalidatePoolError("the file was moved")

    def _find_file(self) -> tuple[int, int] | None:
        """What tells the file from others; None where there is none."""
        try:
            found = self._path.stat()
        except OSError:
            return None
        return found.st_dev, found.st_ino
