"""Who may do what: tokens, this machine, other sites' pages, limits, headers."""

import asyncio
import json
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest
from fastapi import FastAPI, WebSocket
from starlette.testclient import TestClient

from planner.service.access import who_of_socket
from planner.service.access.limits import Buckets
from planner.service.access.views import Views
from planner.service.api import create_app
from planner.service.errors import MissingError, ServiceError
from planner.service.settings import Settings
from planner.service.store.models import Result
from tests.service.conftest import HERE, SMALL, Shared, bearer

READING = (
    "/fields", "/fields/iwamizawa", "/tractors", "/farms", "/logs", "/plans", "/days", "/diagnoses", "/jobs", "/events",
)  # fmt: skip
WRITING = (
    ("POST", "/fields"), ("DELETE", "/fields/x"), ("POST", "/plans"), ("POST", "/days"), ("POST", "/diagnoses"),
    ("POST", "/plans/x/cancel"), ("DELETE", "/plans/x"),
)  # fmt: skip


def elsewhere(app: FastAPI) -> TestClient:
    """A client on another machine."""
    return TestClient(app, base_url="http://farm.example:8765", client=("192.0.2.7", 50000))


def test_without_a_token_this_machine_reads_and_nobody_controls(client: TestClient) -> None:
    assert client.get("/api/v1/health").json()["status"] == "ok"
    for path in READING:
        assert client.get(f"/api/v1{path}").status_code == 200, path
    for method, path in WRITING:
        files = {"file": ("x.geojson", SMALL)} if path == "/fields" else None
        answer = client.request(method, f"/api/v1{path}", files=files, json=None if files else {"day": ""})
        assert answer.status_code == 401, path
        assert "control" in answer.json()["error"] and answer.headers["www-authenticate"] == "Bearer"


def test_other_machines_read_nothing_without_a_token(app: FastAPI) -> None:
    client = elsewhere(app)
    assert client.get("/api/v1/health").status_code == 200
    for path in READING:
        assert client.get(f"/api/v1{path}").status_code == 401, path
    assert client.get("/api/v1/fields", headers=bearer(app, "read")).status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "rebound.example:8765"},
        {"x-forwarded-for": "127.0.0.1"},
        {"forwarded": "for=127.0.0.1"},
        {"authorization": "Bearer hl_unknown"},
        {"authorization": "Basic aGw6"},
    ],
)
def test_what_only_looks_like_this_machine_is_refused(shared: Shared, headers: dict[str, str]) -> None:
    assert shared[0].get("/api/v1/fields", headers=headers).status_code == 401


def test_scopes_include_those_below(app: FastAPI, client: TestClient) -> None:
    read, control, admin = (bearer(app, scope) for scope in ("read", "control", "admin"))
    assert client.post("/api/v1/fields", files={"file": ("x.geojson", SMALL)}, headers=read).status_code == 403
    assert client.post("/api/v1/fields", files={"file": ("x.geojson", SMALL)}, headers=control).status_code == 201
    assert client.delete("/api/v1/fields/x", headers=admin).status_code == 204
    app.state.store.revoke_token("a control")
    assert client.get("/api/v1/fields", headers=control).status_code == 401


def test_who_administers_makes_tokens(app: FastAPI, client: TestClient) -> None:
    control, admin = bearer(app, "control"), bearer(app, "admin")
    body = {"name": "phone", "scope": "read"}
    assert client.get("/api/v1/tokens").status_code == 401
    assert client.post("/api/v1/tokens", json=body, headers=control).status_code == 403
    made = client.post("/api/v1/tokens", json=body, headers=admin)
    assert made.status_code == 201
    phone = {"Authorization": f"Bearer {made.json()['token']}"}
    assert client.post("/api/v1/tokens", json=body, headers=phone).status_code == 403
    assert client.post("/api/v1/tokens", json=body, headers=admin).status_code == 409
    listed = client.get("/api/v1/tokens", headers=admin)
    assert [each["name"] for each in listed.json()["items"]] == ["a control", "a admin", "phone"]
    assert made.json()["token"] not in listed.text + client.get("/api/v1/events").text
    assert client.delete("/api/v1/tokens/phone", headers=admin).status_code == 204
    assert client.get("/api/v1/fields", headers=phone).status_code == 401


def test_a_service_that_others_reach_wants_tokens_from_everybody(tmp_path: Path) -> None:
    app = create_app(Settings(data=tmp_path, host="0.0.0.0", workers=0), inline=True)
    with TestClient(app, base_url=HERE, client=("127.0.0.1", 50000)) as client:
        assert client.get("/api/v1/health").json()["tokens_needed"] is True
        assert client.get("/api/v1/fields").status_code == 401


def test_every_answer_tells_browsers_what_to_refuse(shared: Shared) -> None:
    for path in ("/api/v1/health", "/api/v1/nothing", "/nothing", "/api/v1/docs"):
        headers = shared[0].get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy and "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"


def test_the_documentation_asks_for_nothing_from_elsewhere(shared: Shared) -> None:
    client = shared[0]
    page = client.get("/api/v1/docs").text
    assert "//" not in page.replace("<!doctype html>", "") and "<script>" not in page
    for name in ("swagger-ui-bundle.js", "swagger-ui.css", "favicon-32x32.png", "start.js"):
        assert f"docs/{name}" in page and client.get(f"/api/v1/docs/{name}").status_code == 200


def test_bodies_that_are_too_large_are_refused(client: TestClient, token: dict[str, str]) -> None:
    large = b" " * (2**20 + 2**17)

    def parts() -> Iterator[bytes]:
        for _ in range(20):
            yield large[: 2**16]

    answer = client.post("/api/v1/fields", files={"file": ("x.geojson", large)}, headers=token)
    assert answer.status_code == 413 and "MB" in answer.json()["error"]
    assert client.post("/api/v1/plans", content=large, headers=token).status_code == 413
    assert client.post("/api/v1/plans", content=parts(), headers=token).status_code == 413  # no length is told
    assert client.get("/api/v1/health").status_code == 200


def test_the_rate_is_limited_for_each_address(tmp_path: Path) -> None:
    app = create_app(Settings(data=tmp_path, workers=0, rate_per_minute=5), inline=True)
    with TestClient(app, base_url=HERE, client=("127.0.0.1", 50000)) as client:
        statuses = [client.get("/api/v1/health").status_code for _ in range(7)]
        assert statuses == [200] * 5 + [429] * 2
        answer = client.get("/api/v1/health")
        assert int(answer.headers["retry-after"]) >= 1 and "5 requests" in answer.json()["error"]
        assert elsewhere(app).get("/api/v1/health").status_code == 200


def test_an_order_to_stop_is_never_too_often(tmp_path: Path) -> None:
    app = create_app(Settings(data=tmp_path, workers=0, rate_per_minute=2), inline=True)
    stop = "/api/v1/fleets/none/stop"
    with TestClient(app, base_url=HERE, client=("127.0.0.1", 50000)) as client:
        token = bearer(app, "control")
        assert [client.get("/api/v1/health").status_code for _ in range(3)] == [200, 200, 429]
        assert [client.post(stop, headers=token).status_code for _ in range(4)] == [404] * 4
        assert client.post(stop).status_code == 429, "without a token nobody may ask so often"
        assert client.post("/api/v1/fleets/none/resume", headers=token).status_code == 429
        assert client.get(stop, headers=token).status_code == 429


def test_a_bucket_fills_again() -> None:
    now = [0.0]
    buckets = Buckets(60, lambda: now[0])
    assert [buckets.wait_s("a") for _ in range(60)] == [0.0] * 60
    assert buckets.wait_s("a") == pytest.approx(1.0) and buckets.wait_s("b") == 0.0
    now[0] = 2.0
    assert [buckets.wait_s("a") > 0.0 for _ in range(3)] == [False, False, True]


def test_a_view_is_looked_at_once_within_a_minute() -> None:
    now = [0.0]
    views, result = Views(lambda: now[0]), Result(name="page.html")
    first, second = views.add(result), views.add(result)
    assert first != second and views.take(first) is result
    for name in (first, "other"):
        with pytest.raises(MissingError):
            views.take(name)
    now[0] = 61.0
    with pytest.raises(MissingError):
        views.take(second)


ORIGINS: list[tuple[dict[str, str], bool]] = [
    ({}, False),
    ({"origin": "http://127.0.0.1:8765"}, False),
    ({"origin": "http://127.0.0.1:9999"}, True),
    ({"origin": "http://evil.example"}, True),
    ({"origin": "null"}, True),
    ({"origin": "http://[odd"}, True),
]


def test_sockets_of_other_sites_pages_are_refused(app: FastAPI, token: dict[str, str]) -> None:
    @app.websocket("/try")
    async def link(websocket: WebSocket) -> None:
        await websocket.accept()
        hello = await websocket.receive_json()
        try:
            who = await asyncio.to_thread(who_of_socket, websocket, hello["token"])
            await websocket.send_text(json.dumps([who.name, who.may("read"), who.may("control")]))
        except ServiceError as refusal:
            await websocket.send_text(json.dumps(refusal.http))

    client = TestClient(app, base_url=HERE, client=("127.0.0.1", 50000))
    text = token["Authorization"].removeprefix("Bearer ")
    hellos = ((None, ["this machine", True, False]), (text, ["a control", True, True]), ("hl_no", 401))
    for (headers, refused), (given, expected) in product(ORIGINS, hellos):
        with client.websocket_connect("ws://127.0.0.1:8765/try", headers=headers) as socket:
            socket.send_json({"token": given})
            assert socket.receive_json() == (403 if refused else expected), headers
