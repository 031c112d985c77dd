"""Who has much read, or something slow, waits himself; everybody else hardly does."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from pathlib import Path

import pytest
from fastapi import FastAPI
from starlette.testclient import TestClient

from planner.farm.settings import read_example_text
from planner.service.errors import BusyError
from planner.service.jobs import file_reading
from planner.service.jobs.file_reading import (
    FairQueue,
    compute_read_timeout_s,
    compute_reading_memory_limit_bytes,
)
from planner.service.sandbox.reader_processes import ReadOrder, ReadOutcome
from planner.service.settings import ServiceSettings
from tests.fields.strangers import SECRET, vrt
from tests.service.conftest import BOTH, SMALL, bearer, client_of, wait_until
from tests.service.one_process import create_app

LOG = "time_s,easting_m,northing_m,steering_deg,speed_mps\n" + "".join(
    f"{row / 10:.1f},{row / 7:.3f},0.0,0.0,1.4\n" for row in range(400)
)
RING = [[10.0, 50.0], [10.004, 50.0], [10.004, 50.002], [10.0, 50.0]]


class Held:
    """Work that goes on until it is let go, and what was begun in which order."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.go = threading.Event()

    def work(self, name: str) -> Callable[[], str]:
        def held() -> str:
            self.begun.append(name)
            assert self.go.wait(60)
            return name

        return held

    def await_begun(self, count: int) -> None:
        wait_until(lambda: len(self.begun) >= count)


def hold_queue(**limits: int) -> tuple[FairQueue, Held]:
    """A queue of one place, which work of the client "a" has taken."""
    queue, held = FairQueue(slots=1, **limits), Held()
    queue.submit_work("a", held.work("a"))
    held.await_begun(1)
    return queue, held


def test_a_client_has_one_thing_read_at_a_time_and_others_go_on() -> None:
    queue, held = FairQueue(slots=3), Held()
    slow = [queue.submit_work("a", held.work(f"a{number}")) for number in range(3)]
    held.await_begun(1)
    assert queue.submit_work("b", lambda: "b").result(60) == "b"
    assert queue.submit_work("c", lambda: "c").result(60) == "c"
    assert held.begun == ["a0"] and not any(each.done() for each in slow)
    held.go.set()
    assert [each.result(60) for each in slow] == ["a0", "a1", "a2"]
    with pytest.raises(ZeroDivisionError):
        queue.submit_work("a", lambda: 1 // 0).result(60)
    assert queue.submit_work("a", lambda: 1).result(60) == 1, "a fault of one is its own"
    queue.close()


def test_clients_take_turns() -> None:
    queue, held = FairQueue(slots=1), Held()
    order: list[str] = []
    first = queue.submit_work("z", held.work("z"))
    held.await_begun(1)
    waiting = [
        queue.submit_work(who, lambda who=who: order.append(who)) for who in ("a", "a", "a", "b", "b", "c")
    ]  # fmt: skip
    held.go.set()
    for each in (first, *waiting):
        each.result(60)
    assert order == ["a", "b", "c", "a", "b", "a"]
    queue.close()


def test_only_so_much_waits() -> None:
    queue, held = hold_queue(most_per_client=2, most_waiting=3)
    for _ in range(2):
        queue.submit_work("a", held.work("a"))
    with pytest.raises(BusyError, match=r"^2 files of yours are waiting already; ask again when some are done\.$"):
        queue.submit_work("a", held.work("a"))
    queue.submit_work("b", held.work("b"))
    with pytest.raises(BusyError, match=r"^3 files are waiting already; ask again in a minute\.$"):
        queue.submit_work("c", held.work("c"))
    held.go.set()
    queue.close()


def test_what_nobody_waits_for_does_not_count() -> None:
    queue, held = hold_queue(most_per_client=2, most_waiting=2)
    for _ in range(2):
        queue.submit_work("a", held.work("left")).cancel()
    last = queue.submit_work("a", held.work("last"))
    held.go.set()
    assert last.result(60) == "last" and held.begun == ["a", "last"]
    queue.close()


def test_what_has_waited_too_long_is_told_so(monkeypatch: pytest.MonkeyPatch) -> None:
    queue, held = hold_queue()
    monkeypatch.setattr(file_reading, "LONGEST_WAIT_S", 0.01)
    late = queue.submit_work("b", held.work("b"))
    time.sleep(0.05)
    held.go.set()
    with pytest.raises(BusyError, match=r"^This has waited 0 s for its turn among files; try again"):
        late.result(60)
    queue.close()


def test_what_waits_is_dropped_at_the_end_and_what_nobody_wants_is_left_out() -> None:
    queue, held = hold_queue()
    unwanted, dropped = queue.submit_work("b", held.work("b")), queue.submit_work("c", held.work("c"))
    assert unwanted.cancel()
    queue.close()
    held.go.set()
    with pytest.raises(CancelledError):
        dropped.result(60)
    assert held.begun == ["a"]


class SlowProcesses:
    """Readings that take until they are let go, but those of a file called quick."""

    def __init__(self) -> None:
        self.go, self.orders = threading.Event(), 0
        self.seconds: list[float] = []

    def read_order(self, order: ReadOrder) -> ReadOutcome:
        self.orders += 1
        self.seconds.append(order.seconds)
        if "quick" not in str(order.arguments):
            assert self.go.wait(60)
        return ReadOutcome(json.dumps({"value": {"fields": [], "field": None, "error": None}}).encode(), 0)

    def start_process(self) -> None: ...
    def close(self) -> None: ...


@pytest.fixture
def slow(settings: ServiceSettings) -> Iterator[tuple[FastAPI, SlowProcesses]]:
    """A service whose files are read as slowly as can be."""
    app, processes = create_app(settings), SlowProcesses()
    app.state.reader._processes = processes
    yield app, processes
    processes.go.set()
    app.state.reader.close()


def stored(app: FastAPI, *names: str) -> None:
    for name in names:
        app.state.store.add_file("field", name, SMALL.replace(b"80.0", f"8{len(name)}.0".encode()) + name.encode())


@pytest.mark.slow
def test_many_slow_summaries_leave_other_routes_and_clients_quick(slow: tuple[FastAPI, SlowProcesses]) -> None:
    app, processes = slow
    stored(app, "quick", *(f"slow{number}" for number in range(120)))
    one, other = bearer(app, "read"), bearer(app, "read planner")
    with client_of(app) as client, ThreadPoolExecutor(120) as threads:
        paths = (f"/api/v1/fields/slow{number}/summary" for number in range(120))
        asked = [threads.submit(client.get, path, headers=one) for path in paths]
        most = file_reading.MOST_WAITING_PER_CLIENT
        wait_until(lambda: sum(each.done() for each in asked) >= 120 - 1 - most)
        assert client.get("/api/v1/fields", headers=other).status_code == 200
        assert client.get("/api/v1/fields/quick/summary", headers=other).status_code == 200
        assert processes.orders == 2 and not processes.go.is_set(), "answered while the slow ones wait"
        refused = [each.result() for each in asked if each.done()]
        assert [each.status_code for each in refused] == [429] * (120 - 1 - most)
        assert refused[0].json()["error"].startswith(f"{most} files of yours are waiting already; ")
        processes.go.set()
        assert [each.result().status_code for each in asked].count(200) == 1 + most


def test_who_asks_for_the_same_waits_for_the_same_reading(slow: tuple[FastAPI, SlowProcesses]) -> None:
    app, processes = slow
    stored(app, "slow")
    token = bearer(app, "read")
    with client_of(app) as client, ThreadPoolExecutor(30) as threads:
        asked = [threads.submit(client.get, "/api/v1/fields/slow/summary", headers=token) for _ in range(30)]
        wait_until(lambda: processes.orders >= 1)
        time.sleep(0.2)
        processes.go.set()
        assert [each.result().status_code for each in asked] == [200] * 30
    assert processes.orders == 1


@pytest.fixture(scope="module")
def real(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[TestClient, dict[str, str], FastAPI]]:
    """A service that reads in processes of their own."""
    app = create_app(ServiceSettings(data=tmp_path_factory.mktemp("real"), workers=0, upload_mb=4))
    with client_of(app) as client:
        yield client, bearer(app, BOTH), app


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "name", "content"),
    [
        ("fields", "a.geojson", json.dumps({"type": "Polygon", "coordinates": [RING]}).encode()),
        ("logs", "a.csv", LOG.encode()),
        ("tables", "a.csv", b"time,east_mm,north_mm\n"),
        ("farms", "example.toml", read_example_text("farm").encode()),
    ],
)  # fmt: skip
def test_every_kind_is_read_in_a_process_of_its_own(
    real: tuple[TestClient, dict[str, str], FastAPI], path: str, name: str, content: bytes
) -> None:
    client, token, _ = real
    answer = client.post(f"/api/v1/{path}", files={"file": (name, content)}, headers=token)
    if path == "tables":
        assert answer.status_code == 422 and answer.json()["parameter"] == "file"
        return
    assert answer.status_code == 201, answer.text
    assert client.get(f"/api/v1/{path}/{Path(name).stem}/summary", headers=token).status_code == 200


@pytest.mark.slow
def test_requests_are_checked_in_a_process_of_its_own(real: tuple[TestClient, dict[str, str], FastAPI]) -> None:
    client, token, _ = real
    assert client.post("/api/v1/plans", json={"field": "netherlands", "width": 3}, headers=token).status_code == 202
    refused = client.post("/api/v1/plans", json={"field": "netherlands", "width": 9000}, headers=token)
    assert refused.status_code == 422 and "width" in refused.json()["error"]
    asked = client.post("/api/v1/diagnoses", json={"tractor": "eg105", "hide": "steering_offset"}, headers=token)
    assert asked.status_code in (202, 422) and "Reading this" not in asked.text


@pytest.mark.parametrize("name", ["x.gpkg", "x.kml", "x.gpx", "x.fgb", "x.zip", "x.json", "x.xml"])
def test_an_upload_that_names_the_database_of_the_service(
    real: tuple[TestClient, dict[str, str], FastAPI], name: str, tmp_path: Path
) -> None:
    client, token, app = real
    (tmp_path / "secret.csv").write_text(f"name,WKT\n{SECRET},POINT(1 2)\n")
    for source in (f"CSV:{tmp_path / 'secret.csv'}", str(app.state.settings.data / "headland.db")):
        answer = client.post("/api/v1/fields", files={"file": (name, vrt(source))}, headers=token)
        assert answer.status_code == 422 and SECRET not in answer.text and answer.json()["error"].endswith(".")


def test_a_reading_gets_the_time_of_its_files_and_memory_that_fits_the_machine(
    slow: tuple[FastAPI, SlowProcesses],
) -> None:
    megabytes = (0.0, 0.1, 1.0, 2.0, 5.0, 11.0, 200.0)
    assert [compute_read_timeout_s(int(each * 2**20)) for each in megabytes] == [10, 10, 10, 15, 30, 60, 60]
    assert 512 * 2**20 <= compute_reading_memory_limit_bytes() <= 2 * 2**30
    app, processes = slow
    stored(app, "slow")
    processes.go.set()
    with client_of(app) as client:
        client.get("/api/v1/fields/slow/summary", headers=bearer(app, "read"))
    assert processes.seconds == [10.0]


@pytest.mark.parametrize("kind", ["tractors", "farms"])
def test_a_key_of_many_parts_is_refused_at_once(real: tuple[TestClient, dict[str, str], FastAPI], kind: str) -> None:
    client, token, _ = real
    text, begin = ".".join(["a"] * 50_000) + "=1", time.monotonic()
    answer = client.post(f"/api/v1/{kind}", files={"file": ("deep.toml", text)}, headers=token)
    assert answer.status_code == 422 and "50000 parts" in answer.json()["error"]
    assert time.monotonic() - begin < 8.0
