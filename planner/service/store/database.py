"""The database: SQLite with a write-ahead log, or PostgreSQL; it is brought up to date or refused.

One service at a time on a folder and on a database: two would each drive the same fleets and do the same jobs.
"""

from __future__ import annotations

import os
import secrets
import sqlite3
import sys
import threading
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import sqlalchemy as sa
from sqlalchemy.orm import Session

from planner.service.errors import ConflictError, DatabaseError
from planner.service.settings import ServiceSettings, find_version
from planner.service.store.disk_storage import translate_disk_full
from planner.service.store.tables import TableBase

Row = TypeVar("Row")
GONE = "its file {path} is gone; bring it back"
LOG_LEFT = "its file is gone, but its log {log} is there; bring the file back, or delete the log to begin anew"
REPLACED = "its file {path} was replaced by another database; bring the first one back, or start the service again"
SELECT_MARK, MARK_PLACE, MARK_BYTES = "PRAGMA application_id", 68, 4
"""A number in the head of the file, drawn once, by which copies of one database know one another. It is read
from the file itself: SQLite would take the log beside it for that of a stranger, and write it there."""
SQLITE_BUSY_TIMEOUT_MS, POOL_TIMEOUT_S = 10_000, 5.0
"""How long SQLite waits for another writer, and a session for a connection; PostgreSQL's limits are in postgresql."""
WRITES_OPTION = "headland_writes"
VERSION_TABLE, SELECT_VERSION = "alembic_version", "SELECT version_num FROM alembic_version"
MIGRATIONS_FOLDER = Path(__file__).parent / "migrations"
LOCK_FILE = "headland.lock"
LOCK_SUFFIX = ".lock"
TAKE_ADVISORY_LOCK = (
    "SELECT pg_try_advisory_lock(hashtext('headland service'), hashtext(coalesce(current_schema(), '')))"
)
SET_KEEPALIVES = (
    "SELECT set_config('tcp_keepalives_idle', '10', false), set_config('tcp_keepalives_interval', '10', false), "
    "set_config('tcp_keepalives_count', '3', false)"
)
"""So that the server drops a machine that has vanished within a minute."""


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


class Database:
    """An engine whose sessions either read or write."""

    def __init__(self, url: str) -> None:
        self.engine = _create_engine(url)
        file = self.engine.url.database if self.engine.dialect.name == "sqlite" else None
        self._folder = Path(file).absolute().parent if file else None
        self._file = SqliteFile(self.engine, Path(file).absolute()) if file and file != ":memory:" else None

    @property
    def is_postgresql(self) -> bool:
        """Whether other machines can use the database too."""
        return self.engine.dialect.name == "postgresql"

    def keep_to_file(self) -> None:
        """Use from now on only the SQLite file that is there now: one that is gone is not made anew."""
        if self._file is not None:
            self._file.keep()

    @contextmanager
    def open_read_session(self) -> Iterator[Session]:
        """A session that reads. Raises StorageError where even this needs more room on the disk."""
        with translate_disk_full(self._folder), Session(self.engine, expire_on_commit=False) as session:
            yield session

    @contextmanager
    def open_write_session(self) -> Iterator[Session]:
        """A session whose changes are stored completely, or not at all where the body raises or the disk is full.

        Raises StorageError for the latter.
        """
        with (
            translate_disk_full(self._folder),
            self.engine.connect().execution_options(**{WRITES_OPTION: True}) as connection,
            Session(connection, expire_on_commit=False) as session,
        ):
            yield session
            session.commit()

    def list_rows(self, query: sa.Select[Row]) -> list[Row]:
        """What a query for one thing selects, read in a session of its own. Raises as `open_read_session` does."""
        with self.open_read_session() as session:
            return list(session.scalars(query))

    def find_row(self, query: sa.Select[Row]) -> Row | None:
        """The first that a query for one thing selects, None where it selects nothing. Raises as `list_rows` does."""
        with self.open_read_session() as session:
            return session.scalar(query)

    def change_rows(self, change: sa.Update | sa.Delete) -> int:
        """Make a change in a session of its own; returns the number of rows. Raises as `open_write_session` does."""
        with self.open_write_session() as session:
            return self.execute_change(session, change)

    def execute_change(self, session: Session, change: sa.Update | sa.Delete) -> int:
        """Make a change as a part of a session; returns the number of rows."""
        return int(session.execute(change).rowcount)  # type: ignore[attr-defined]

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()


@cache
def list_versions() -> tuple[str, ...]:
    """The versions of the tables that this Headland knows, the last of which it works with.

    They are what the names of the migrations begin with: what migrates takes memory, and is loaded to migrate only.
    """
    return tuple(sorted(path.name.partition("_")[0] for path in (MIGRATIONS_FOLDER / "versions").glob("[0-9]*.py")))


def get_current_version() -> str:
    """The version of the tables that this Headland works with."""
    return list_versions()[-1]


def read_version(connection: sa.Connection) -> str | None:
    """The version of the tables of a database, None where Headland has never used it."""
    is_known = sa.inspect(connection).has_table(VERSION_TABLE)
    return connection.scalar(sa.text(SELECT_VERSION)) if is_known else None


@cache
def describe_version() -> str:
    """The version of this Headland and of its tables: "0.2.0 with tables 0007"."""
    return f"{find_version()} with tables {get_current_version()}"


def migrate_database(engine: sa.Engine) -> None:
    """Make the tables, or bring those of an earlier version up to date.

    Raises DatabaseError for a database that is newer, or of another program.
    """
    with name_database_in_errors(engine), engine.connect() as connection:
        current = read_version(connection)
        tables = set(sa.inspect(connection).get_table_names())
    if current is not None and current not in list_versions():
        raise DatabaseError(
            f"The database is of a newer Headland (its version is {current}, this one knows "
            f"{get_current_version()}); update Headland, or give another --database or --data."
        )
    if current is None and tables & set(TableBase.metadata.tables):
        raise DatabaseError(
            "The database holds tables of other software by the names that Headland uses; give another --database."
        )
    if current == get_current_version():
        return
    with engine.connect().execution_options(**{WRITES_OPTION: True}) as connection, lift_timeouts(connection):
        if current is None:
            TableBase.metadata.create_all(connection)
            draw_sqlite_mark(connection)
            stamp_version(connection)
        else:
            upgrade_tables(connection)
        connection.commit()


def stamp_version(connection: sa.Connection, version: str = "head") -> None:
    """Note the version of the tables that are there, by default that of today."""
    from alembic.runtime.migration import MigrationContext
    from alembic.script import ScriptDirectory

    MigrationContext.configure(connection).stamp(ScriptDirectory(str(MIGRATIONS_FOLDER)), version)


def upgrade_tables(connection: sa.Connection, version: str = "head") -> None:
    """Bring tables of an earlier version up to a later one, by default to that of today."""
    from alembic import command
    from alembic.config import Config

    config = Config(attributes={"connection": connection})
    config.set_main_option("script_location", str(MIGRATIONS_FOLDER).replace("%", "%%"))
    command.upgrade(config, version)


def draw_sqlite_mark(connection: sa.Connection) -> None:
    """Give an SQLite database the number by which it is known again."""
    if connection.dialect.name == "sqlite":
        connection.exec_driver_sql(f"PRAGMA application_id={secrets.randbelow(2**31 - 1) + 1}")


def lift_timeouts(connection: sa.Connection) -> AbstractContextManager[None]:
    """Lift the time limits for one transaction, on any database."""
    if connection.dialect.name != "postgresql":
        return nullcontext()
    from planner.service.store import postgresql

    return postgresql.lift_timeouts(connection)


@contextmanager
def name_database_in_errors(engine: sa.Engine) -> Iterator[None]:
    """Turn errors of the driver into DatabaseError."""
    try:
        yield
    except sa.exc.DBAPIError as error:
        place = engine.url.render_as_string(hide_password=True)
        raise DatabaseError(f"The database {place} cannot be used: {shorten_error(error.orig)}.") from None


def shorten_error(error: object, most_chars: int = 200) -> str:
    """The text of an error in one short line."""
    return " ".join(str(error).split())[:most_chars]


def _create_engine(url: str) -> sa.Engine:
    try:
        parsed = sa.make_url(url)
        if parsed.get_backend_name() not in ("sqlite", "postgresql"):
            raise DatabaseError(f"A database of {parsed.get_backend_name()} is not known; use SQLite or PostgreSQL.")
        shared = parsed.database not in (None, "", ":memory:")
        engine = sa.create_engine(parsed, **({"pool_timeout": POOL_TIMEOUT_S} if shared else {}))
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
    elif engine.dialect.driver == "psycopg":  # other drivers have no time limits
        from planner.service.store.postgresql import limit_engine_waits

        limit_engine_waits(engine)
    return engine


def _prepare_sqlite(engine: sa.Engine) -> None:
    """Begin transactions explicitly; a writer locks at once, so that it never has to roll back."""

    def configure_connection(connection: sqlite3.Connection, _record: Any) -> None:
        connection.isolation_level = None
        connection.execute(f"PRAGMA busy_timeout={SQLITE_BUSY_TIMEOUT_MS}")
        for pragma in ("journal_mode=WAL", "foreign_keys=ON", "synchronous=NORMAL"):
            connection.execute(f"PRAGMA {pragma}")

    def begin_transaction(connection: sa.Connection) -> None:
        writes = connection.get_execution_options().get(WRITES_OPTION, False)
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    sa.event.listen(engine, "connect", configure_connection)
    sa.event.listen(engine, "begin", begin_transaction)


@contextmanager
def hold_service_lock(settings: ServiceSettings) -> Iterator[None]:
    """Lock the folder and the database while the body runs; the system releases both if the process is killed.

    Raises ConflictError where another service has one of them, DatabaseError.
    """
    with ExitStack() as stack:
        stack.enter_context(_lock_file(settings.data / LOCK_FILE, f"the folder {settings.data}", "--data"))
        if settings.database:
            database = Database(settings.url)
            stack.callback(database.close)
            url = database.engine.url
            if database.is_postgresql:
                stack.enter_context(_lock_schema(database.engine))
            elif url.database and url.database != ":memory:":
                path = Path(url.database + LOCK_SUFFIX)
                stack.enter_context(_lock_file(path, f"the file {url.database}", "--database"))
        yield


def _build_already_running_error(resource: str, option: str) -> ConflictError:
    return ConflictError(
        f"Another headland serve has {resource}; end it, or give another {option}.", parameter=option.removeprefix("--")
    )


@contextmanager
def _lock_file(path: Path, resource: str, option: str) -> Iterator[None]:
    """An open, locked file; it is not deleted, as another service may be opening it."""
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise DatabaseError(f"The file {path} cannot be made: {error.strerror}; give another {option}.") from None
    try:
        if not _try_lock(number):
            raise _build_already_running_error(resource, option)
        yield
    finally:
        os.close(number)


def _try_lock(number: int) -> bool:
    """Lock an open file; whether that succeeded."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


@contextmanager
def _lock_schema(engine: sa.Engine) -> Iterator[None]:
    """A connection that holds the advisory lock of the schema."""
    with ExitStack() as stack:
        with name_database_in_errors(engine):
            connection = stack.enter_context(engine.connect().execution_options(isolation_level="AUTOCOMMIT"))
            connection.exec_driver_sql(SET_KEEPALIVES)
            is_taken = connection.scalar(sa.text(TAKE_ADVISORY_LOCK))
        if not is_taken:
            resource = f"the database {engine.url.render_as_string(hide_password=True)}"
            raise _build_already_running_error(resource, "--database")
        yield
