"""The gate of a real service: who is let in, how much is read, and stops that wait for nothing."""

import json
import math
import os
import re
import signal
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.benchmarks.squad import SEEN_S, run_squad
from tests.service.conftest import SMALL
from tests.service.running import Running, run_service

pytestmark = pytest.mark.slow

BOUNDARY = "x" * 20
PROC = pytest.mark.skipif(not Path("/proc/net/tcp").exists(), reason="looks at processes as Linux shows them")


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Running]:
    with run_service(tmp_path_factory.mktemp("gate") / "data") as made:
        yield made


@pytest.fixture(scope="module")
def reader(running: Running) -> dict[str, str]:
    path = running.login.split(str(running.port), 1)[1]
    status, headers, _ = running.ask("GET", path)
    assert status == 303
    return {"cookie": headers["set-cookie"].split(";")[0]}


@pytest.fixture(scope="module")
def planner(running: Running) -> dict[str, str]:
    return running.make_token("planner")


@pytest.fixture(scope="module")
def operator(running: Running) -> dict[str, str]:
    return running.make_token("operator")


def test_files_and_pages_are_answered_by_the_office_as_if_by_one(
    running: Running, reader: dict[str, str], planner: dict[str, str]
) -> None:
    assert running.ask("GET", "/")[2].startswith(b"<!doctype html>")
    assert json.loads(running.ask("GET", "/api/v1/openapi.json")[2])["paths"].keys() >= {
        "/api/v1/fleets/{id}/stop", "/api/v1/fields", "/api/v1/plans/{id}",
    }  # fmt: skip
    head = f'--{BOUNDARY}\r\nContent-Disposition: form-data; name="file"; filename="own.geojson"\r\n\r\n'
    body, form = (
        head.encode() + SMALL + f"\r\n--{BOUNDARY}--\r\n".encode(),
        {"content-type": f"multipart/form-data; boundary={BOUNDARY}"},
    )
    status, headers, made = running.ask("POST", "/api/v1/fields", body, form | planner)
    assert status == 201 and json.loads(made)["name"] == "own" and headers["content-security-policy"]
    status, headers, content = running.ask("GET", "/api/v1/fields/own", headers=reader)
    assert (status, content) == (200, SMALL) and "own.geojson" in headers["content-disposition"]
    odd = (("GET", "/fields/none"), ("PUT", "/fields"), ("PUT", "/fleets"), ("GET", "/none"), ("GET", "/fields?x=1"))
    assert [running.ask_json(*each, headers=reader)[0] for each in odd] == [404, 405, 405, 404, 422]
    assert running.ask_json("DELETE", "/fields/own", headers=planner)[0] == 204
    assert running.ask_json("GET", "/events", headers=reader)[1]["items"][0]["what"] == "field uploaded"


@pytest.mark.parametrize(
    ("target", "status"),
    [
        ("http://127.0.0.1:1/api/v1/health", 200), ("http://x", 200), ("http://x/api/v1/jobs", 401), ("*", 400),
        ("/api/v1/jobs#/x", 404), ("/api/v1/jobs/%2e%2e/tokens", 404), ("//api/v1/jobs", 404), ("x", 400),
        ("ftp://x/api/v1/health", 400), ("http:///api/v1/health", 400),
    ],
)  # fmt: skip
def test_odd_targets_are_answered_in_a_sentence(running: Running, target: str, status: int) -> None:
    with socket.create_connection(("127.0.0.1", running.port), timeout=20) as one:
        one.sendall(f"GET {target} HTTP/1.1\r\nhost: x\r\nconnection: close\r\n\r\n".encode())
        assert one.recv(100).split()[1] == str(status).encode(), target


def test_what_only_looks_like_this_machine_or_the_gate_is_refused_before_a_body_is_read(
    running: Running, reader: dict[str, str]
) -> None:
    who = json.dumps({"name": "x", "scopes": ["admin"], "token": "x", "fleet": None, "tractor": None})
    head = "POST /api/v1/plans HTTP/1.1\r\nhost: 127.0.0.1\r\ncontent-type: application/json\r\n"
    for cookie in ("", f"cookie: {reader['cookie']}\r\n"):
        with socket.create_connection(("127.0.0.1", running.port), timeout=20) as one:
            one.sendall(f"{head}{cookie}content-length: 60000000\r\n\r\n".encode())
            assert b"401" in one.recv(100), "answered with nothing of the body there"
    for headers in (
        {}, {"host": "127.0.0.1"}, {"host": "localhost"}, {"x-forwarded-for": "127.0.0.1"}, {"x-headland-who": who},
        {"x-headland-who": who, "x-headland-secret": ""}, {"cookie": "headland_login="},
        {"authorization": "Bearer hl_x"},
    ):  # fmt: skip
        assert running.ask_json("GET", "/fields", headers=headers)[0] == 401, headers
        assert running.ask("GET", "/metrics", headers=headers)[0] == 401, headers


@PROC
def test_the_office_answers_only_the_service(running: Running, reader: dict[str, str]) -> None:
    ports = {port for port in listening_ports(children_of(running.process.pid)) if port != running.port}
    assert len(ports) == 1
    found = Running(running.process, running.data, ports.pop(), "")
    for path in ("/api/v1/fields", "/", "/api/v1/health", "/api/v1/tokens"):
        status, _, body = found.ask("GET", path, headers={**reader, "x-headland-secret": "guess"})
        assert status == 403 and b"address" in body


@PROC
def test_the_office_is_begun_anew_and_stops_work_meanwhile(
    running: Running, reader: dict[str, str], operator: dict[str, str]
) -> None:
    office = next(pid for pid in children_of(running.process.pid) if listening_ports([pid]))
    os.kill(office, signal.SIGKILL)
    until = time.monotonic() + 90.0
    statuses = []
    while time.monotonic() < until:
        assert running.ask_json("POST", "/fleets/none/stop", headers=operator)[0] == 404
        statuses.append(running.ask_json("GET", "/fields", headers=reader)[0])
        if statuses[-1] == 200 and 503 in statuses:
            break
        time.sleep(0.2)
    assert set(statuses) == {503, 200} and statuses[-1] == 200
    assert running.ask_json("GET", "/ready")[1] == {"ready": True, "faults": []}


def test_everybody_stands_at_once_while_bodies_and_summaries_pour_in(
    running: Running, reader: dict[str, str], planner: dict[str, str], operator: dict[str, str]
) -> None:
    over = threading.Event()
    junk = b"[" + b"[]," * 300_000 + b"[]]"
    json_form = {"content-type": "application/json"}

    def pour(headers: dict[str, str], path: str, body: bytes | None) -> None:
        while not over.is_set():
            running.ask("POST" if body else "GET", path, body, headers)

    asked: list[tuple[dict[str, str], str, bytes | None]] = [({}, "/api/v1/plans", junk)]
    asked += [(planner | json_form, "/api/v1/plans", junk), (operator | json_form, "/api/v1/fleets", junk)]
    asked += [(reader, "/api/v1/fields/denmark/summary?swap=true", None)]
    threads = [threading.Thread(target=pour, args=each, daemon=True) for each in asked * 3]
    took_s, heard_s = [], []
    with run_squad(running, 10) as squad:
        for thread in threads:
            thread.start()
        for _ in range(10):
            begun_s = time.monotonic()
            assert running.ask_json("POST", "/fleets/none/stop", headers=operator)[0] == 404
            took_s.append(time.monotonic() - begun_s)
        for stop in (squad.stop_by_link, squad.stop_by_http) * 2:
            assert squad.go()
            heard_s.append(stop())
            time.sleep(SEEN_S)
        over.set()
    for thread in threads:
        thread.join(30)
    assert sorted(took_s)[-2] < 0.5, took_s
    assert sorted(heard_s)[-2] < 0.5 and math.isfinite(max(heard_s)), heard_s


def test_figures_and_request_ids(running: Running, reader: dict[str, str]) -> None:
    status, headers, text = running.ask("GET", "/metrics", headers=reader)
    assert status == 200 and headers["content-type"].startswith("text/plain; version=0.0.4")
    for name in ("headland_request_seconds_bucket", "headland_ready 1.0", "headland_connections ",
                 'headland_jobs{status="queued"} 0.0', "headland_stop_seconds_count"):  # fmt: skip
        assert name in text.decode(), name
    ids = {running.ask("GET", path)[1]["x-request-id"] for path in ("/", "/api/v1/health", "/api/v1/fields")}
    assert len(ids) == 3 and all(re.fullmatch("[0-9a-f]{12}", each) for each in ids)


def children_of(parent: int) -> list[int]:
    found = Path(f"/proc/{parent}/task").glob("*/children")
    return [int(pid) for path in found for pid in path.read_text().split()]


def listening_ports(pids: list[int]) -> set[int]:
    """Ports on which processes listen."""
    inodes = {line.split()[9]: int(line.split()[1].split(":")[1], 16)
              for line in Path("/proc/net/tcp").read_text().splitlines()[1:] if line.split()[3] == "0A"}  # fmt: skip
    held = {os.readlink(path)[8:-1] for pid in pids for path in Path(f"/proc/{pid}/fd").iterdir()
            if os.readlink(path).startswith("socket:")}  # fmt: skip
    return {port for inode, port in inodes.items() if inode in held}
