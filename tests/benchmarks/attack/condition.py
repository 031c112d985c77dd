"""Items 14 and 16: what a service says of itself without its database, and what names and addresses reach."""

from __future__ import annotations

import contextlib
import json
import socket
import sqlite3
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tests.benchmarks.attack.plans import lay_lines, make_fleet
from tests.benchmarks.attack.robots import greet
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import HOST, Service, run_service
from tests.benchmarks.attack.squad import wait_for
from tests.benchmarks.attack.web import API, ask, square_field, upload

DATABASE = "headland.db"
HONEST_S, REFUSED_S, BACK_S = 8.0, 1.5, 30.0
LIMIT = "not ready within 8 s, revoked within 1.5 s and after a restart"


def attack_sqlite(command: Sequence[str], short: bool) -> list[Row]:
    """Item 14: SQLite locked by another program, and its file moved away; a token is revoked meanwhile."""
    rows = []
    for item, how, take in (("14a", "SQLite locked", _lock), ("14b", "its file moved away", _move)):
        with run_service(command) as service:
            rows.append(_take_database(service, item, how, take, 12.0 if short else 25.0))
    return rows


def _take_database(service: Service, item: str, how: str, take: Any, seconds: float) -> Row:
    name, token = "leaver", service.token("operator", "planner")
    made = ask(service.port, "POST", f"{API}/tokens", token=service.admin, json_body={"name": name, "scopes": ["read"]})
    leaver, begin = str(made.json["token"]), time.monotonic()
    with take(service.data / DATABASE):
        revoked = ask(service.port, "DELETE", f"{API}/tokens/{name}", token=service.admin)
        refused_s = _time_until(lambda: _status(service, "fleets", leaver) == 401, REFUSED_S)
        honest_s = _time_until(lambda: _status(service, "ready") == 503, max(0.0, begin + seconds - time.monotonic()))
        honest_s += time.monotonic() - begin - honest_s if honest_s >= 0.0 else 0.0
        gauge = "headland_ready 0.0" in ask(service.port, "GET", "/metrics", token=token).body.decode()
        time.sleep(max(0.0, begin + seconds - time.monotonic()))
    back = wait_for(lambda: _status(service, "ready") == 200, BACK_S)
    service.end()
    service.start()
    forgotten = _status(service, "fleets", leaver) != 401
    words = (f"not ready {_say(honest_s)}, gauge {'says it' if gauge else 'does not'}; revoked ({revoked.status} in "
             f"{revoked.seconds:.1f} s), refused {_say(refused_s)}, {'FORGOTTEN' if forgotten else 'kept'}"
             f" at a restart; {'ready again' if back else 'not ready again'}")  # fmt: skip
    held = 0.0 <= honest_s <= HONEST_S + revoked.seconds and gauge and refused_s >= 0.0 and not forgotten and back
    values = {"honest_s": honest_s, "refused_s": refused_s, "revoke": revoked.status, "forgotten": forgotten}
    return Row(item, f"{how} for {seconds:.0f} s", words, LIMIT, held, values)


@contextlib.contextmanager
def _lock(file: Path) -> Iterator[None]:
    other = sqlite3.connect(file, isolation_level=None, timeout=10.0)
    other.execute("BEGIN IMMEDIATE")
    yield
    other.execute("COMMIT")
    other.close()


@contextlib.contextmanager
def _move(file: Path) -> Iterator[None]:
    away = file.with_name("away.db")
    file.rename(away)
    yield
    away.rename(file)


def _status(service: Service, path: str, token: str | None = None) -> int:
    return ask(service.port, "GET", f"{API}/{path}", token=token, timeout_s=10.0).status


def _time_until(is_true: Any, timeout_s: float) -> float:
    """Seconds until something is true, -1 where it does not become so in time."""
    begin = time.monotonic()
    return time.monotonic() - begin if wait_for(is_true, timeout_s) else -1.0


def _say(seconds: float) -> str:
    return "never" if seconds < 0.0 else f"after {seconds:.1f} s"


def attack_identity(service: Service, short: bool) -> list[Row]:
    """Item 16: a token with the name of a revoked one, clients that go away, video of other machines."""
    return [_reuse_name(service), _go_away(service, 4 if short else 40), _set_video(service)]


def _reuse_name(service: Service) -> Row:
    """Delete the file and cancel nothing: the file of a token that was revoked, with a new one of the same name."""
    body = {"name": "own1", "scopes": ["planner"]}
    first = str(ask(service.port, "POST", f"{API}/tokens", token=service.admin, json_body=body).json["token"])
    added = upload(service.port, "fields", "legacy.geojson", square_field(), first, local="true")
    ask(service.port, "DELETE", f"{API}/tokens/own1", token=service.admin)
    second = str(ask(service.port, "POST", f"{API}/tokens", token=service.admin, json_body=body).json["token"])
    status = ask(service.port, "DELETE", f"{API}/fields/legacy", token=second).status
    held = added.status == 201 and status == 403
    attacked, words = "a new own1 deletes a file of the revoked own1", f"{added.status}, then {status}"
    return Row("16a", attacked, words, "201, then 403", held, {"status": status})


def _go_away(service: Service, times: int) -> Row:
    """Clients that send half a body, of a fleet, an upload and a job, and are gone."""
    seen, heads = service.log_bytes(), (
        ("fleets", "application/json", "operator"), ("fields", "multipart/form-data; boundary=x", "planner"),
        ("plans", "application/json", "planner"), ("fleets/none/accept", "application/json", "operator"),
    )  # fmt: skip
    for path, media, role in heads * times:
        head = (f"POST {API}/{path} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {service.token(role)}\r\n"
                f"Content-Type: {media}\r\nContent-Length: 60000\r\n\r\n")  # fmt: skip
        with socket.create_connection((HOST, service.port), 5.0) as link:
            link.sendall(head.encode() + b'--x\r\nContent-Disposition: form-data; name="file"; filename="a"\r\n\r\n')
            time.sleep(0.2)
    time.sleep(2.0)
    log = service.log.read_bytes()[seen:].decode(errors="replace")
    count = log.count("Traceback")
    return Row("16b", f"{4 * times} clients go away in the middle of a body", f"{count} tracebacks", "none", count == 0,
               {"log": log[:2000]})  # fmt: skip


def _set_video(service: Service) -> Row:
    fleet, address = make_fleet(service, "filmed", lay_lines(1, 50.0)), "http://192.168.1.1/reboot"
    path = f"{API}/fleets/{fleet}/tractors/1/video"
    answer = ask(service.port, "PUT", path, token=service.token("operator", "planner"), json_body={"address": address})
    shown = "192.168.1.1" in json.dumps(ask(service.port, "GET", f"{API}/fleets", token=service.admin).json)
    kind, _, _ = greet(service.port, fleet, "viewer", service.admin)
    words = f"{answer.status}, {'shown' if shown else 'not shown'} to who looks"
    return Row("16c", f"an operator sets the video {address}", words, "422, not shown",
               answer.status == 422 and not shown, {"status": answer.status, "link": kind})  # fmt: skip
