"""A copy of all that a service has, made while it runs; and bytes that nobody names any more, swept away."""

from __future__ import annotations

import secrets
import tempfile
import time
import zipfile
from contextlib import suppress
from pathlib import Path

import sqlalchemy as sa

from planner.service.settings import FILE
from planner.service.store.base import FOLDER
from planner.service.store.database import Database, migrate
from planner.service.store.models import Base, File, Fleet, Job, Result
from planner.service.store.whole import Store

AT_A_TIME = 500
KEPT_S = 3600.0
"""Bytes that are newer may be those of a row that is just being written."""


def back_up(store: Store, file: Path) -> int:
    """Write a zip file with the database and all bytes it names; how many files of bytes. It is whole, or not there.

    Unpacked into a folder it is one for `--data`: whatever the database is, in the copy it is SQLite.
    """
    draft = file.with_name(f".headland-{secrets.token_hex(4)}")
    try:
        with tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / FILE
            names = _copied(store, copy)
            with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as packed:
                packed.write(copy, FILE)
                for sha256 in names:
                    packed.write(store.blobs.path(sha256), f"{FOLDER}/{sha256[:2]}/{sha256}")
        draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    return len(names)


def sweep(store: Store) -> int:
    """Delete bytes that no file, result or job names; how many there were."""
    limit, swept = time.time() - KEPT_S, 0
    old = [path for path in store.blobs.all() if path.stat().st_mtime < limit]
    with store.database.reads() as session:
        wanted = set(_named(session.connection()))
    for path in old:
        if path.name not in wanted:
            with suppress(OSError):
                path.unlink()
                swept += 1
    return swept


def _copied(store: Store, copy: Path) -> list[str]:
    """Copy every row into a new database of SQLite, all as of one moment; the bytes they name, each once."""
    target = Database(f"sqlite:///{copy}")
    migrate(target.engine)
    with _one_moment(store) as source, target.writes() as session:
        for table in Base.metadata.sorted_tables:
            rows = source.execution_options(yield_per=AT_A_TIME).execute(sa.select(table)).mappings()
            for part in rows.partitions(AT_A_TIME):
                session.execute(sa.insert(table), [dict(row) for row in part])
        names = sorted(set(_named(source)))
    with target.engine.connect() as connection:
        connection.exec_driver_sql("COMMIT")
        connection.exec_driver_sql("PRAGMA journal_mode=DELETE")
        connection.exec_driver_sql("BEGIN")
    target.close()
    return names


def _one_moment(store: Store) -> sa.Connection:
    """A connection that sees the database as it is now until it is closed."""
    connection = store.database.engine.connect()
    if connection.dialect.name == "postgresql":
        connection = connection.execution_options(isolation_level="REPEATABLE READ")
    return connection


def _named(connection: sa.Connection) -> list[str]:
    """The SHA-256 of all bytes that rows name."""
    names = list(connection.scalars(sa.union_all(sa.select(File.sha256), sa.select(Result.sha256))))
    for inputs in connection.scalars(sa.select(Job.inputs)):
        names += inputs.values()
    for settings in connection.scalars(sa.select(Fleet.settings)):
        names += [sha256 for _, sha256 in settings.get("files", {}).values()]
    return names
