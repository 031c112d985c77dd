"""Bodies of requests: one budget for all, files for large ones, and clients that go away."""

import asyncio
import json
import logging
from collections.abc import AsyncIterator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from hypothesis import given
from hypothesis import strategies as st
from starlette.testclient import TestClient

from planner.service.errors import BusyError, ServiceError
from planner.service.fleets.fleet_routes import build_requested_fleet, spool_body
from planner.service.gateway.request_gate import BODIES_FOLDER, UNCOUNTED_BYTES, BodyBudget
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings
from planner.service.store.service_store import Store
from tests.service.conftest import bearer
from tests.service.test_fleets import TEXT

SETTINGS = ServiceSettings(data=Path("unused"), upload_mb=1)


def test_a_client_has_two_uploads_and_all_have_four() -> None:
    budget = BodyBudget(SETTINGS)
    with budget.open_share("a") as one, budget.open_share("a") as two, budget.open_share("a") as three:
        assert one(MEGABYTE_BYTES) and two(MEGABYTE_BYTES) and not three(MEGABYTE_BYTES)
        assert three(UNCOUNTED_BYTES), "orders are never held up"
        with budget.open_share("b") as four, budget.open_share("c") as five, budget.open_share("d") as six:
            assert four(2 * MEGABYTE_BYTES) and not five(MEGABYTE_BYTES)
            assert six(UNCOUNTED_BYTES)
        with budget.open_share("c") as five:
            assert five(MEGABYTE_BYTES), "the room was given back"
    assert budget.held_bytes == 0
    assert BodyBudget(replace(SETTINGS, upload_mb=64)).most_bytes == 256 * MEGABYTE_BYTES


@given(st.lists(st.tuples(st.sampled_from("abc"), st.lists(st.integers(0, 3 * MEGABYTE_BYTES), max_size=4))))
def test_a_budget_is_never_exceeded_and_all_of_it_comes_back(bodies: list[tuple[str, list[int]]]) -> None:
    budget, shares, held = BodyBudget(SETTINGS), ExitStack(), dict[str, int]()
    for client, sizes in bodies:
        grow, taken = shares.enter_context(budget.open_share(client)), 0
        for size in sizes:
            taken = max(taken, size - UNCOUNTED_BYTES) if grow(size) else taken
            assert budget.held_bytes == sum(held.values()) + taken
        held[client] = held.get(client, 0) + taken
        assert held[client] <= budget.most_bytes / 2 and budget.held_bytes <= budget.most_bytes
    shares.close()
    assert budget.held_bytes == 0


def test_a_body_in_a_file_is_whole_and_gone_afterwards(tmp_path: Path) -> None:
    parts = [bytes([number % 256]) * 1000 for number in range(1000)]

    async def stream() -> AsyncIterator[bytes]:
        for part in parts:
            yield part

    async def write() -> None:
        async with spool_body(stream(), tmp_path / "bodies") as path:
            assert path.read_bytes() == b"".join(parts)
        assert not path.exists()

    asyncio.run(write())
    assert list((tmp_path / "bodies").iterdir()) == []


def make_request(settings: ServiceSettings, **more: Any) -> Path:
    """A file with the request of a fleet."""
    settings.data.mkdir(parents=True, exist_ok=True)
    file = settings.data / "request"
    file.write_text(json.dumps({"name": "north", "plan": TEXT} | more))
    return file


def test_a_fleet_is_made_from_a_file_and_stored_under_its_id(both: ServiceSettings) -> None:
    label, _, given = build_requested_fleet("0" * 16, len(TEXT.encode()), both, make_request(both, times=2.0))
    store = Store(both)
    row = store.get_fleet("0" * 16)
    assert (row.name, row.plan, row.settings, row.created) == ("north", TEXT, given, label.created)
    assert given["times"] == 2.0 and label.plan_bytes == len(TEXT.encode())
    with pytest.raises(BusyError, match="delete a fleet first"):
        build_requested_fleet("1" * 16, label.plan_bytes - 1, both, make_request(both))
    with pytest.raises(ServiceError):
        build_requested_fleet("1" * 16, label.plan_bytes, both, make_request(both, name=""))
    assert [each.id for each in store.list_fleets()] == ["0" * 16]
    store.close()


@pytest.mark.slow
def test_a_body_without_room_is_refused_and_an_order_is_not(app: FastAPI, client: TestClient) -> None:
    operator = bearer(app, "operator")
    with app.state.bodies.open_share("x") as one, app.state.bodies.open_share("y") as two:
        assert one(2 * MEGABYTE_BYTES) and two(2 * MEGABYTE_BYTES)
        refused = client.post("/api/v1/fleets", content=b" " * 500_000, headers=operator)
        assert refused.status_code == 429 and "large bodies" in refused.json()["error"]
        assert int(refused.headers["retry-after"]) > 0
        refused = client.post("/api/v1/fleets", content=iter([b" " * 70_000] * 4), headers=operator)
        assert refused.status_code == 429, "in chunks, too"
        assert client.post("/api/v1/fleets/none/stop", headers=operator).status_code == 404
        assert client.post("/api/v1/fleets/none/accept", json={"proposal": 1}, headers=operator).status_code == 404
    answer = client.post("/api/v1/fleets", content=b" " * 500_000, headers=operator)
    assert answer.status_code == 422 and "not JSON" in answer.json()["error"]
    answer = client.post("/api/v1/fleets", json={"name": "x", "plan": "p", "odd": 1}, headers=operator)
    assert answer.status_code == 422 and answer.json()["parameter"] == "odd"
    answer = client.post("/api/v1/fleets/none/accept", content=b" " * 70_000, headers=operator)
    assert answer.status_code == 413 and "64 KB" in answer.json()["error"], "bodies of orders are short"
    assert list((app.state.settings.data / BODIES_FOLDER).iterdir()) == []


@pytest.mark.parametrize("path", ["fleets", "fleets/none/accept", "plans", "fields"])
def test_a_client_that_goes_away_is_no_fault(
    app: FastAPI, client: TestClient, caplog: pytest.LogCaptureFixture, path: str
) -> None:
    token = bearer(app, "operator planner")["Authorization"].encode()
    begin = b"--x\r\n" if path == "fields" else b"{"
    messages: Iterator[dict[str, Any]] = iter(
        [{"type": "http.request", "body": begin, "more_body": True}, {"type": "http.disconnect"}]
    )
    headers = [(b"host", b"x"), (b"authorization", token), (b"content-type", b"application/json")]
    if path == "fields":
        headers[-1] = b"content-type", b"multipart/form-data; boundary=x"
    scope = {
        "type": "http", "method": "POST", "path": f"/api/v1/{path}", "raw_path": f"/api/v1/{path}".encode(),
        "query_string": b"", "headers": headers, "client": ("192.0.2.9", 1), "server": ("x", 80), "scheme": "http",
        "http_version": "1.1", "asgi": {"version": "3.0", "spec_version": "2.3"}, "root_path": "",
    }  # fmt: skip

    async def receive() -> dict[str, Any]:
        return next(messages, {"type": "http.disconnect"})

    async def send(_message: Any) -> None:
        pass

    with caplog.at_level(logging.WARNING):
        asyncio.run(app(scope, receive, send))
    assert not caplog.records and app.state.bodies.held_bytes == 0
