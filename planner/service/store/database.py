"""One database for all: SQLite with a write-ahead log, or PostgreSQL; brought up to date or refused."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy.orm import Session

from planner.service.errors import DatabaseError
from planner.service.store.models import Base

WAIT_MS = 20_000
WRITES = "headland_writes"
MIGRATIONS = Path(__file__).parent / "migrations"


class Database:
    """An engine whose sessions either read or write."""

    def __init__(self, url: str) -> None:
        self.engine = _engine(url)

    @contextmanager
    def reads(self) -> Iterator[Session]:
        """A session that reads."""
        with Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def writes(self) -> Iterator[Session]:
        """A session whose changes are kept whole, or not at all where the body raises."""
        with (
            self.engine.connect().execution_options(**{WRITES: True}) as connection,
            Session(connection, expire_on_commit=False) as session,
        ):
            yield session
            session.commit()

    def close(self) -> None:
        """Let go of all connections."""
        self.engine.dispose()


def migrate(engine: sa.Engine, to: str = "head") -> None:
    """Bring the tables up to date, or to a version.

    Raises DatabaseError for a database that is newer, or somebody else's.
    """
    scripts = ScriptDirectory(str(MIGRATIONS))
    with _connected(engine) as connection:
        now = MigrationContext.configure(connection).get_current_revision()
        tables = set(sa.inspect(connection).get_table_names())
    if now is not None and now not in {each.revision for each in scripts.walk_revisions()}:
        raise DatabaseError(
            f"The database is of a newer Headland (its version is {now}, this one knows {scripts.get_current_head()}); "
            "update Headland, or give another --database or --data."
        )
    if now is None and tables & set(Base.metadata.tables):
        raise DatabaseError(
            "The database holds tables of other software by the names that Headland uses; give another --database."
        )
    if now == scripts.get_current_head():
        return
    config = Config()
    config.set_main_option("script_location", str(MIGRATIONS).replace("%", "%%"))
    with engine.connect().execution_options(**{WRITES: True}) as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, to)
        connection.commit()


@contextmanager
def _connected(engine: sa.Engine) -> Iterator[sa.Connection]:
    try:
        with engine.connect() as connection:
            yield connection
    except sa.exc.DBAPIError as error:
        why = " ".join(str(error.orig).split())[:200]
        place = engine.url.render_as_string(hide_password=True)
        raise DatabaseError(f"The database {place} cannot be used: {why}.") from None


def _engine(url: str) -> sa.Engine:
    try:
        parsed = sa.make_url(url)
        if parsed.get_backend_name() not in ("sqlite", "postgresql"):
            raise DatabaseError(f"A database of {parsed.get_backend_name()} is not known; use SQLite or PostgreSQL.")
        engine = sa.create_engine(parsed, pool_pre_ping=parsed.get_backend_name() != "sqlite")
    except sa.exc.ArgumentError:
        raise DatabaseError(
            "The database is not a URL; write one such as postgresql://user@host/name or sqlite:///file.db."
        ) from None
    except ImportError as error:
        raise DatabaseError(
            f"The driver of the database is missing ({error.name}); install 'headland[postgres]' or leave the "
            "database to SQLite."
        ) from None
    if parsed.get_backend_name() == "sqlite":
        _prepare_sqlite(engine)
    return engine


def _prepare_sqlite(engine: sa.Engine) -> None:
    """Transactions begin where they are told to; a writer takes its turn at once, so that it never has to be undone."""

    def connected(connection: sqlite3.Connection, _record: Any) -> None:
        connection.isolation_level = None
        for pragma in (f"busy_timeout={WAIT_MS}", "journal_mode=WAL", "foreign_keys=ON", "synchronous=NORMAL"):
            connection.execute(f"PRAGMA {pragma}")

    def begun(connection: sa.Connection) -> None:
        writes = connection.get_execution_options().get(WRITES, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    sa.event.listen(engine, "connect", connected)
    sa.event.listen(engine, "begin", begun)
