"""Item 7: the database goes away or falls silent while tractors drive."""

from __future__ import annotations

import os
import re
import secrets
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any
from urllib.parse import quote, urlsplit

from tests.benchmarks.attack.relay import Relay, run_relay
from tests.benchmarks.attack.robots import greet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import HOST, Service, run_service
from tests.benchmarks.attack.squad import describe_stops, run_squad, wait_for
from tests.benchmarks.attack.web import API, ask

SERVER = os.environ.get("HEADLAND_TEST_POSTGRESQL", "postgresql+psycopg://root@127.0.0.1:5432/test")
LIMIT = "stop 0.5 s, new link 1 s, health and ready say it"
NEW_LINK_S, BACK_S, HONEST_S = 1.0, 60.0, 8.0


def attack_database(command: Sequence[str], short: bool) -> list[Row]:
    """Item 7, with PostgreSQL behind a relay that is stopped and, in the long form, frozen."""
    attacked = "PostgreSQL behind a relay"
    try:
        with _own_schema() as schema:
            return _attack(command, schema, short)
    except ConnectionError as error:
        return [Row("7", attacked, f"no PostgreSQL: {error}"[:80], LIMIT, None)]


def _attack(command: Sequence[str], schema: str, short: bool) -> list[Row]:
    parts, rows = urlsplit(SERVER), []
    with run_relay((parts.hostname or HOST, parts.port or 5432)) as relay:
        url = f"postgresql://{parts.username or 'root'}@{HOST}:{relay.port}{parts.path}"
        with run_service(command, database=f"{url}?options={quote(f'-csearch_path={schema}')}") as service:
            rows.append(_cut_off(service, relay, "7a", "PostgreSQL stopped", short))
            rows.append(_cut_off(service, relay, "7b", "PostgreSQL frozen", short))
    return rows


def _cut_off(service: Service, relay: Relay, item: str, how: str, short: bool) -> Row:
    before = _ask_health(service)
    with run_squad(service, 5 if short else 20) as squad:
        squad.go()
        relay.close() if item == "7a" else relay.frozen.set()
        try:
            time.sleep(0.5)
            stops = squad.measure_stops(("HTTP", "link"), timeout_s=20.0)
            kind, sentence, seconds = greet(service.port, squad.fleet, "control", service.token("operator", "planner"))
            wait_for(lambda: _ask_health(service)["ready"][0] == 503, HONEST_S)
            meanwhile = _ask_health(service)
        finally:
            relay.open() if item == "7a" else relay.frozen.clear()
    back = wait_for(lambda: _ask_health(service)["ready"][0] in (200, 404), BACK_S)
    return _judge(item, how, stops, (kind, sentence, seconds), before, meanwhile, back)


def _ask_health(service: Service) -> dict[str, tuple[int, str]]:
    """Status and body of health and readiness; figures in the body do not count."""
    found = {}
    for name in ("health", "ready"):
        answer = ask(service.port, "GET", f"{API}/{name}", token=service.token("operator", "planner"), timeout_s=10.0)
        found[name] = answer.status, re.sub(r"[0-9.]+", "#", answer.body.decode(errors="replace"))[:300]
    return found


def _judge(item: str, how: str, stops: Any, link: tuple[str, str, float], before: dict[str, tuple[int, str]],
           meanwhile: dict[str, tuple[int, str]], back: bool) -> Row:  # fmt: skip
    words, held, values = describe_stops(stops)
    honest = meanwhile["health"] != before["health"] and meanwhile["health"][0] != 0
    ready = meanwhile["ready"][0]
    linked = link[0] == "welcome"
    words += (f"; new link {f'{link[2]:.2f} s' if linked else link[0]}; health {meanwhile['health'][0]} "
              f"{'says it' if honest else 'says nothing of it'}, ready {ready}")  # fmt: skip
    values |= {"link": link, "health": meanwhile["health"], "ready": ready, "back": back}
    held = held and linked and link[2] <= NEW_LINK_S and honest and ready == 503 and back
    return Row(item, how, words, LIMIT, held, values)


@contextmanager
def _own_schema() -> Iterator[str]:
    """An empty schema of the server, gone afterwards; raises ConnectionError where there is no server."""
    try:
        import psycopg

        link = psycopg.connect(SERVER.replace("+psycopg", ""), autocommit=True, connect_timeout=3)
    except Exception as error:  # whatever keeps it from being used here
        raise ConnectionError(str(error).splitlines()[0] if str(error) else type(error).__name__) from None
    schema = f"headland_attack_{os.getpid()}_{secrets.token_hex(4)}"
    with link:
        link.execute(f"CREATE SCHEMA {schema}")
        try:
            yield schema
        finally:
            link.execute(f"DROP SCHEMA {schema} CASCADE")
