"""Connections to PostgreSQL with a time limit on every wait for the server.

Time-outs of the server help as long as it runs, and those of the network as long as nobody acknowledges what was sent.
Where neither does (a server that hangs, a proxy whose other side is gone) only who waits can end the waiting.
"""

from __future__ import annotations

import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from typing import Any

import psycopg
import sqlalchemy as sa

from fields.units import HOUR_S

CONNECT_TIMEOUT_S, PING_TIMEOUT_S, ANSWER_TIMEOUT_S, IDLE_TIMEOUT_S = 3, 2.0, 5.0, 60.0
NETWORK_OPTIONS = {
    "connect_timeout": CONNECT_TIMEOUT_S,
    "tcp_user_timeout": int(ANSWER_TIMEOUT_S * 1000),
    "keepalives_idle": 5,
    "keepalives_interval": 2,
    "keepalives_count": 2,
}
"""Names of libpq; values in the URL of the database take precedence."""
SET_TIMEOUTS = (
    f"SELECT set_config('statement_timeout', '{ANSWER_TIMEOUT_S:g}s', false), "
    f"set_config('lock_timeout', '{ANSWER_TIMEOUT_S:g}s', false), "
    f"set_config('idle_in_transaction_session_timeout', '{IDLE_TIMEOUT_S:g}s', false)"
)
CLEAR_TIMEOUTS = "SELECT set_config('statement_timeout', '0', true), set_config('lock_timeout', '0', true)"


class BoundedConnection(psycopg.Connection[Any]):
    """A connection that breaks when the server has not answered for `patience_s`."""

    answer_timeout_s = ANSWER_TIMEOUT_S

    def wait(self, gen: Generator[Any, Any, Any], *interval: Any, **named: Any) -> Any:
        """As of psycopg, through which everything passes that waits for the server."""
        return super().wait(self._enforce_answer_timeout(gen), *interval, **named)

    def _enforce_answer_timeout(self, steps: Generator[Any, Any, Any]) -> Generator[Any, Any, Any]:
        """The same steps, until none of them was answered for too long."""
        answered_s = time.monotonic()
        try:
            state = next(steps)
            while True:
                ready = yield state
                if ready:
                    answered_s = time.monotonic()
                elif time.monotonic() - answered_s > self.answer_timeout_s:
                    self.close()
                    raise psycopg.OperationalError(f"the server has not answered for {self.answer_timeout_s:g} s")
                state = steps.send(ready)
        except StopIteration as end:
            return end.value
        finally:
            steps.close()


def limit_engine_waits(engine: sa.Engine) -> None:
    """Make all connections of an engine of this class."""

    def open_connection(_dialect: Any, _record: Any, arguments: list[Any], named: dict[str, Any]) -> BoundedConnection:
        connection = BoundedConnection.connect(*arguments, **(NETWORK_OPTIONS | named))
        _execute_directly(connection, SET_TIMEOUTS)
        return connection

    def check_out_connection(connection: BoundedConnection, _record: Any, _proxy: Any) -> None:
        """Replace a connection that a restarted server no longer knows before it is used."""
        connection.answer_timeout_s = PING_TIMEOUT_S
        try:
            _execute_directly(connection, "SELECT 1")
        except psycopg.Error as error:
            raise sa.exc.DisconnectionError("the connection is gone") from error
        connection.answer_timeout_s = ANSWER_TIMEOUT_S

    sa.event.listen(engine, "do_connect", open_connection)
    sa.event.listen(engine, "checkout", check_out_connection)


def _execute_directly(connection: BoundedConnection, statement: str) -> None:
    """Execute something outside any transaction."""
    connection.autocommit = True
    connection.execute(statement)
    connection.autocommit = False


@contextmanager
def lift_timeouts(connection: sa.Connection) -> Iterator[None]:
    """Lift the time limits for one transaction, as changes of large tables need."""
    bounded_connection = connection.connection.dbapi_connection
    if not isinstance(bounded_connection, BoundedConnection):
        yield
        return
    bounded_connection.answer_timeout_s = HOUR_S
    connection.exec_driver_sql(CLEAR_TIMEOUTS)
    try:
        yield
    finally:
        bounded_connection.answer_timeout_s = ANSWER_TIMEOUT_S
