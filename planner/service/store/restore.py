"""A backup brought back, into SQLite or PostgreSQL, whatever it was made of."""

from __future__ import annotations

import re
import tempfile
import zipfile
import zlib
from pathlib import Path

import sqlalchemy as sa

from planner.service.errors import MissingError, ServiceError, TakenError
from planner.service.settings import FILE
from planner.service.store.base import FOLDER
from planner.service.store.database import Database, migrate
from planner.service.store.models import Base
from planner.service.store.whole import Store

AT_A_TIME = 500
BYTES = re.compile(rf"{FOLDER}/([0-9a-f]{{2}})/(\1[0-9a-f]{{62}})")
SEQUENCE = "SELECT setval(pg_get_serial_sequence('{table}', '{column}'), (SELECT max({column}) FROM {table}))"


def restore(store: Store, file: Path) -> int:
    """Put what a backup holds into a store that has nothing yet; how many files of bytes.

    The rows come all or not at all. Raises ServiceError for a file that is no whole backup, MissingError for none,
    TakenError for a store that has something, DatabaseError for a backup of a newer Headland.
    """
    _check_empty(store)
    try:
        with zipfile.ZipFile(file) as packed, tempfile.TemporaryDirectory() as folder:
            names = _names(packed, file)
            (Path(folder) / FILE).write_bytes(packed.read(FILE))
            for name, sha256 in names.items():
                if store.blobs.put(packed.read(name)) != sha256:
                    raise ServiceError(f"{file} is damaged: its part {name} has other bytes; use another backup.")
            _copy(store, Path(folder) / FILE, file)
    except FileNotFoundError:
        raise MissingError(f"There is no file {file}; give the name of a backup.", parameter="file") from None
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        raise ServiceError(f"{file} cannot be read as a backup: {error}.".replace("..", ".")) from None
    return len(names)


def _check_empty(store: Store) -> None:
    with store.database.reads() as session:
        for table in Base.metadata.sorted_tables:
            if session.execute(sa.select(sa.literal(1)).select_from(table).limit(1)).first() is not None:
                raise TakenError(
                    f"The database has {table.name} already, and nothing is written over; give another --data or "
                    "--database.",
                    parameter="data",
                )


def _names(packed: zipfile.ZipFile, file: Path) -> dict[str, str]:
    """The SHA-256 of every part but the database, by its name in the archive."""
    found = {name: BYTES.fullmatch(name) for name in packed.namelist() if name != FILE}
    strange = next((name for name, match in found.items() if match is None), None)
    if FILE not in packed.namelist() or strange is not None:
        why = f"it has {strange[:60]!r}" if strange is not None else f"it has no {FILE}"
        raise ServiceError(f"{file} is no backup of Headland: {why}; give one that headland backup made.")
    return {name: match[2] for name, match in found.items() if match is not None}


def _copy(store: Store, copy: Path, file: Path) -> None:
    """Copy all rows of a database of SQLite, which is brought up to date before."""
    if not copy.read_bytes()[:16].startswith(b"SQLite format 3"):
        raise ServiceError(f"{file} is damaged: its {FILE} is no database; use another backup.")
    source = Database(f"sqlite:///{copy}")
    try:
        migrate(source.engine)
        with source.engine.connect() as old, store.database.writes() as session:
            for table in Base.metadata.sorted_tables:
                rows = old.execution_options(yield_per=AT_A_TIME).execute(sa.select(table)).mappings()
                for part in rows.partitions(AT_A_TIME):
                    session.execute(sa.insert(table), [dict(row) for row in part])
                _count_on(session.connection(), table)
    finally:
        source.close()


def _count_on(connection: sa.Connection, table: sa.Table) -> None:
    """Let PostgreSQL number new rows after those that were put in with their numbers."""
    column = next(iter(table.primary_key.columns))
    if connection.dialect.name == "postgresql" and isinstance(column.type, sa.Integer):
        connection.execute(sa.text(SEQUENCE.format(table=table.name, column=column.name)))
