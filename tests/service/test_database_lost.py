"""A database that hangs, is locked or is started anew: everything ends within seconds, and goes on afterwards."""

import socket
import sqlite3
import threading
import time
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import pytest
import sqlalchemy as sa
from starlette.testclient import TestClient

from planner.service.settings import DATABASE_FILE, ServiceSettings
from planner.service.store import database as databases
from planner.service.store import postgresql
from planner.service.store.service_store import Store
from tests.service.conftest import BOTH, HERE, bearer
from tests.service.databases import database
from tests.service.one_process import create_app

ANSWER_S, PING_S, CONNECT_S = 1.0, 0.5, 2  # nobody waits less for a connection
"""Waits of these tests; whatever they are, every wait ends with them."""
ENDS_S = PING_S + CONNECT_S + 2.0  # what a busy machine adds


class Way:
    """Passes on what both sides send while `open` is set; `broken` closes what there is."""

    def __init__(self, host: str, port: int) -> None:
        self.open = threading.Event()
        self.open.set()
        self._target, self._ends = (host, port), []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = int(self._listening.getsockname()[1])
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                far = socket.create_connection(self._target)
                self._ends += [near, far]
                for one, other in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=(one, other), daemon=True).start()

    def _pass_on(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while content := one.recv(65536):
                self.open.wait()
                other.sendall(content)
        with suppress(OSError):
            other.shutdown(socket.SHUT_WR)

    def cut(self) -> None:
        """End all connections, as a server that is started anew does."""
        ends, self._ends = self._ends, []
        for each in ends:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def close(self) -> None:
        """End all."""
        self._listening.close()
        self.open.set()
        self.cut()


def test_what_waits_for_a_database_waits_for_seconds() -> None:
    assert postgresql.BoundedConnection.answer_timeout_s == postgresql.ANSWER_TIMEOUT_S == 5.0
    assert f"'statement_timeout', '{postgresql.ANSWER_TIMEOUT_S:g}s'" in postgresql.SET_TIMEOUTS
    assert postgresql.PING_TIMEOUT_S + postgresql.NETWORK_OPTIONS["connect_timeout"] <= 5.0


@pytest.fixture
def impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorter waits than those of a service, of the client and of the server."""
    shorter = postgresql.SET_TIMEOUTS.replace(f"'{postgresql.ANSWER_TIMEOUT_S:g}s'", f"'{ANSWER_S:g}s'")
    assert shorter.count(f"'{ANSWER_S:g}s'") == 2
    monkeypatch.setattr(postgresql, "SET_TIMEOUTS", shorter)
    monkeypatch.setitem(postgresql.NETWORK_OPTIONS, "connect_timeout", CONNECT_S)
    monkeypatch.setattr(postgresql, "PING_TIMEOUT_S", PING_S)
    monkeypatch.setattr(postgresql, "ANSWER_TIMEOUT_S", ANSWER_S)
    monkeypatch.setattr(postgresql.BoundedConnection, "answer_timeout_s", ANSWER_S)


@pytest.fixture
def way(tmp_path: Path, impatient: None) -> Iterator[tuple[Way, ServiceSettings]]:
    """Settings of a service whose PostgreSQL is reached by a way that can be blocked."""
    with database("postgresql") as url:
        parsed = sa.make_url(url)
        with closing(Way(parsed.host or "127.0.0.1", parsed.port or 5432)) as way:
            through = parsed.set(host="127.0.0.1", port=way.port).render_as_string(hide_password=False)
            yield way, ServiceSettings(data=tmp_path, database=through, workers=0)


@pytest.mark.slow
def test_a_database_that_hangs_or_was_started_anew_is_found_again_and_no_question_waits_for_ever(
    way: tuple[Way, ServiceSettings],
) -> None:
    blocked, settings = way
    store = Store(settings)
    store.add_event(None, "office", "before")
    blocked.cut()
    assert len(store.list_events()) == 1, "a connection that is gone is replaced before it is used"
    blocked.open.clear()
    for ask in (store.list_events, lambda: store.add_event(None, "office", "meanwhile")):
        begin = time.monotonic()
        with pytest.raises(sa.exc.OperationalError):
            ask()
        assert time.monotonic() - begin < ENDS_S
    blocked.open.set()
    assert next(each.what for each in store.list_events()) == "before"
    begin = time.monotonic()
    with (
        pytest.raises(sa.exc.OperationalError, match="has not answered"),
        store.database.open_write_session() as session,
    ):
        session.execute(sa.text("DELETE FROM events"))
        blocked.open.clear()
        session.execute(sa.text("SELECT 1"))
    assert time.monotonic() - begin < ENDS_S
    blocked.open.set()
    assert store.list_events(), "nothing is kept of a transaction in the midst of which it hung"
    store.close()


@pytest.mark.slow
def test_statements_of_their_own_time_are_not_hurried(way: tuple[Way, ServiceSettings]) -> None:
    store, sleep = Store(way[1]), f"SELECT pg_sleep({ANSWER_S + 0.5})"
    with pytest.raises(sa.exc.OperationalError), store.database.open_read_session() as session:
        session.execute(sa.text(sleep))
    with store.database.engine.connect() as connection, databases.lift_timeouts(connection):
        connection.execute(sa.text(sleep))
    store.close()


@pytest.mark.slow
def test_a_request_to_a_database_that_hangs_is_answered_and_the_token_is_known(
    way: tuple[Way, ServiceSettings],
) -> None:
    blocked, settings = way
    app = create_app(settings, reads_inline=True)
    with TestClient(app, base_url=HERE, client=("192.0.2.7", 50000)) as client:
        token = bearer(app, BOTH)
        assert client.get("/api/v1/events", headers=token).status_code == 200
        blocked.open.clear()
        try:
            begin = time.monotonic()
            answer = client.post("/api/v1/fleets/none/stop", headers=token)
            assert answer.status_code == 404 and time.monotonic() - begin < 1.0, "known without the database"
            answer = client.get("/api/v1/events", headers=token)
            assert answer.status_code == 503 and time.monotonic() - begin < ENDS_S
        finally:
            blocked.open.set()


def test_a_file_that_somebody_else_writes_to_is_waited_for_so_long(
    plain: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(databases, "SQLITE_BUSY_TIMEOUT_MS", 500)
    plain.database.engine.dispose()  # connections of before wait longer
    other = sqlite3.connect(tmp_path / DATABASE_FILE, isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    begin = time.monotonic()
    with pytest.raises(sa.exc.OperationalError, match="locked"):
        plain.add_event(None, "office", "meanwhile")
    assert 0.4 < time.monotonic() - begin < ENDS_S
    assert plain.list_events() == [], "who only reads waits for nobody"
    monkeypatch.undo()
    plain.database.engine.dispose()  # the next connection waits as long as those of a service
    ended = threading.Timer(0.1, lambda: other.execute("COMMIT"))
    ended.start()
    assert plain.add_event(None, "office", "afterwards") == 1
    ended.join()
    other.close()
