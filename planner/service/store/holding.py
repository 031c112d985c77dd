"""One service at a time on a folder and on a database: two would each drive the same fleets and do the same jobs."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext
from pathlib import Path

import sqlalchemy as sa

from planner.service.errors import DatabaseError, TakenError
from planner.service.settings import Settings
from planner.service.store.database import Database

FILE = "headland.lock"
ENDING = ".lock"
TAKE = "SELECT pg_try_advisory_lock(hashtext('headland service'), hashtext(coalesce(current_schema(), '')))"
NOTICE = (
    "SELECT set_config('tcp_keepalives_idle', '10', false), set_config('tcp_keepalives_interval', '10', false), "
    "set_config('tcp_keepalives_count', '3', false)"
)
"""So that the server lets go within a minute of a machine that is gone without a word."""


@contextmanager
def held(settings: Settings) -> Iterator[None]:
    """Have the folder and the database for oneself as long as the body takes; the system lets go of both at a kill.

    Raises TakenError where another service has one of them, DatabaseError.
    """
    with ExitStack() as stack:
        stack.enter_context(_file(settings.data / FILE, f"the folder {settings.data}", "--data"))
        if settings.database:
            database = Database(settings.url)
            stack.callback(database.close)
            stack.enter_context(_held_database(database.engine))
        yield


def _held_database(engine: sa.Engine) -> AbstractContextManager[None]:
    if engine.dialect.name == "postgresql":
        return _advised(engine)
    file = engine.url.database
    if not file or file == ":memory:":
        return nullcontext()
    return _file(Path(file + ENDING), f"the file {file}", "--database")


def _taken(what: str, option: str) -> TakenError:
    return TakenError(
        f"Another headland serve has {what}; end it, or give another {option}.", parameter=option.removeprefix("--")
    )


@contextmanager
def _file(path: Path, what: str, option: str) -> Iterator[None]:
    """An open file that is locked; it stays, as another service may just be opening it."""
    try:
        number = os.open(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        raise DatabaseError(f"The file {path} cannot be made: {error.strerror}; give another {option}.") from None
    try:
        if not _locked(number):
            raise _taken(what, option)
        yield
    finally:
        os.close(number)


if sys.platform == "win32":
    import msvcrt

    def _locked(number: int) -> bool:
        """Lock an open file; whether that went."""
        try:
            msvcrt.locking(number, msvcrt.LK_NBLCK, 1)
        except OSError:
            return False
        return True

else:
    import fcntl

    def _locked(number: int) -> bool:
        """Lock an open file; whether that went."""
        try:
            fcntl.flock(number, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
        return True


@contextmanager
def _advised(engine: sa.Engine) -> Iterator[None]:
    """A connection whose advisory lock is that of the schema."""
    place = engine.url.render_as_string(hide_password=True)
    with ExitStack() as stack:
        try:
            connection = stack.enter_context(engine.connect().execution_options(isolation_level="AUTOCOMMIT"))
            connection.exec_driver_sql(NOTICE)
            taken = connection.scalar(sa.text(TAKE))
        except sa.exc.DBAPIError as error:
            why = " ".join(str(error.orig).split())[:200]
            raise DatabaseError(f"The database {place} cannot be used: {why}.") from None
        if not taken:
            raise _taken(f"the database {place}", "--database")
        yield
