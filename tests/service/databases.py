"""The databases that tests of the service run on: SQLite, and PostgreSQL in a schema of each test's own.

HEADLAND_TEST_DATABASES=sqlite,postgresql says that both must be there; without it PostgreSQL is skipped where nothing
listens. HEADLAND_TEST_POSTGRESQL is the URL of another server than the usual one of this machine.
"""

import os
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import quote

import pytest
import sqlalchemy as sa

KINDS = ("sqlite", "postgresql")
MUST = os.environ.get("HEADLAND_TEST_DATABASES", "").split(",")
SERVER = os.environ.get("HEADLAND_TEST_POSTGRESQL", "postgresql+psycopg://root@127.0.0.1:5432/test")


def listens() -> bool:
    """Whether there is a PostgreSQL."""
    url = sa.make_url(SERVER)
    try:
        socket.create_connection((url.host or "127.0.0.1", url.port or 5432), timeout=2).close()
    except OSError:
        return False
    return True


@contextmanager
def database(kind: str) -> Iterator[str]:
    """The URL of an empty database ("" for a file in the folder of the service), gone afterwards."""
    if kind == "sqlite":
        yield ""
        return
    if not listens():
        assert kind not in MUST, f"nothing listens at {SERVER}, and HEADLAND_TEST_DATABASES asks for it"
        pytest.skip(f"nothing listens at {SERVER}")
    schema = f"headland_{os.getpid()}_{secrets.token_hex(4)}"
    engine = sa.create_engine(SERVER)
    with engine.begin() as connection:
        connection.execute(sa.text(f"CREATE SCHEMA {schema}"))
    try:
        yield f"{SERVER}?options={quote(f'-csearch_path={schema}')}"
    finally:
        with engine.begin() as connection:
            connection.execute(sa.text(f"DROP SCHEMA {schema} CASCADE"))
        engine.dispose()
