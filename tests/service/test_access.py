"""Who may do what: tokens, logins, other sites' pages, limits, headers."""

import json
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import pytest
import sqlalchemy as sa
from fastapi import FastAPI, WebSocket
from starlette.requests import HTTPConnection
from starlette.testclient import TestClient

from planner.service.access.browsers import BrowserLogins, OneTimeViews
from planner.service.access.permissions import RIGHTS_BY_SCOPE, RequiredRight, identify_socket
from planner.service.api.apps import API_PREFIX, list_back_office_routers, list_control_routers
from planner.service.errors import NotFoundError, ServiceError
from planner.service.fleets.fleet_sessions import FleetLabel
from planner.service.gateway.connection_limits import RateLimiter
from planner.service.gateway.request_gate import find_route_rule, list_route_rules
from planner.service.settings import ServiceSettings
from planner.service.store.tables import ResultRow, TokenRow
from tests.service.conftest import BOTH, HERE, SMALL, Shared, bearer, client_of
from tests.service.one_process import create_app

READING = (
    "/fields", "/fields/iwamizawa", "/tractors", "/farms", "/logs", "/plans", "/days", "/diagnoses", "/jobs", "/events",
)  # fmt: skip
WRITING = (
    ("POST", "/fields"), ("DELETE", "/fields/x"), ("POST", "/plans"), ("POST", "/days"), ("POST", "/diagnoses"),
    ("POST", "/plans/x/cancel"), ("DELETE", "/plans/x"),
)  # fmt: skip
MAY = {
    "read": {"read"}, "planner": {"read", "plan"}, "operator": {"read", "operate"},
    "operator planner": {"read", "plan", "operate"}, "admin": {"read", "plan", "operate", "administer"},
}  # fmt: skip
ASKS = {
    "read": ("GET", "/fields"), "plan": ("DELETE", "/fields/none"), "operate": ("POST", "/fleets/none/stop"),
    "administer": ("DELETE", "/tokens/none"),
}  # fmt: skip
OPEN_TO_ROBOTS = {("get", f"/api/v1/{name}") for name in ("health", "ready", "me", "fleets", "fleets/{id}")}
ORIGINS: list[tuple[dict[str, str], bool]] = [
    ({}, False),
    ({"origin": "http://127.0.0.1:8765"}, False),
    ({"origin": "http://127.0.0.1:9999"}, True),
    ({"origin": "http://evil.example"}, True),
    ({"origin": "null"}, True),
    ({"origin": "http://[odd"}, True),
    ({"origin": "https://farm.example", "host": "farm.example"}, False),
    ({"origin": "https://farm.example:443", "host": "farm.example"}, False),
    ({"origin": "http://farm.example", "host": "farm.example:80"}, False),
    ({"origin": "https://farm.example:8443", "host": "farm.example:8443"}, False),
    ({"origin": "https://farm.example:8443", "host": "farm.example"}, True),
    ({"origin": "https://evil.example", "host": "farm.example"}, True),
    ({"origin": "https://farm.example", "host": "farm.example", "sec-fetch-site": "same-origin"}, False),
    ({"origin": "http://farm.example", "host": "farm.example", "sec-fetch-site": "same-site"}, True),
    ({"origin": "file://", "host": ""}, True),
]


def elsewhere(app: FastAPI) -> TestClient:
    """A client on another machine."""
    return TestClient(app, base_url="http://farm.example:8765", client=("192.0.2.7", 50000))


@pytest.mark.slow
def test_nobody_reads_without_a_token_or_a_login_which_does_nothing_else(app: FastAPI, client: TestClient) -> None:
    reader = bearer(app, "read")
    for stranger in (client_of(app), elsewhere(app)):
        assert stranger.get("/api/v1/health").json()["status"] == "ok"
        assert {stranger.get(f"/api/v1{path}").status_code for path in READING} == {401}
        assert stranger.get("/api/v1/fields", headers=reader).status_code == 200
    for path in READING:
        assert client.get(f"/api/v1{path}").status_code == 200, path
    for method, path in WRITING:
        files = {"file": ("x.geojson", SMALL)} if path == "/fields" else None
        answer = client.request(method, f"/api/v1{path}", files=files, json=None if files else {"day": ""})
        assert answer.status_code == 401, path
        assert "--scope planner" in answer.json()["error"] and answer.headers["www-authenticate"] == "Bearer"


def test_a_scope_gives_its_own_rights_and_no_others(app: FastAPI, client: TestClient) -> None:
    headers = {scope: bearer(app, scope) for scope in MAY}
    for scope, (right, (method, path)) in product(MAY, ASKS.items()):
        expected = 403 if right not in MAY[scope] else 200 if method == "GET" else 404
        assert client.request(method, f"/api/v1{path}", headers=headers[scope]).status_code == expected, (scope, path)


@pytest.mark.slow
def test_a_robot_reads_its_own_fleet_and_nothing_else(app: FastAPI, client: TestClient) -> None:
    for fleet in ("f1", "f2"):
        app.state.hub.labels[fleet] = FleetLabel(fleet, fleet, app.state.store.save_fleet(fleet, fleet, "{}", {}))
    robot = bearer(app, "robot", fleet="f1", tractor=2)
    assert [each["id"] for each in client.get("/api/v1/fleets", headers=robot).json()["items"]] == ["f1"]
    assert client.get("/api/v1/fleets/f1", headers=robot).status_code == 200
    answer = client.get("/api/v1/fleets/f2", headers=robot)
    assert answer.status_code == 403 and "tractor 2 of the fleet f1 alone" in answer.json()["error"]
    described = app.openapi()["paths"]
    for path, methods in described.items():
        for method in methods:
            asked = path.replace("{id}", "f1").replace("{fleet}", "f1").replace("{tractor}", "2").replace("{name}", "x")
            if (method, path) in OPEN_TO_ROBOTS or "{view}" in path:
                continue
            assert client.request(method, asked, headers=robot).status_code == 403, (method, path)
    app.state.store.delete_fleet("f1")
    assert app.state.book.refresh() and client.get("/api/v1/fleets", headers=robot).status_code == 401


def test_a_token_is_worth_nothing_once_it_has_expired(app: FastAPI, client: TestClient) -> None:
    reader = bearer(app, "read", expires="1d")
    assert client.get("/api/v1/fields", headers=reader).status_code == 200
    with app.state.store.database.open_write_session() as session:
        session.execute(sa.update(TokenRow).values(expires="2026-01-01T00:00:00.000Z"))
    assert app.state.book.refresh()
    answer = client.get("/api/v1/fields", headers=reader)
    assert answer.status_code == 401 and "expired at 2026-01-01T00:00:00.000Z" in answer.json()["error"]
    assert answer.headers["www-authenticate"] == "Bearer"


def test_every_route_needs_a_right_that_a_scope_has(app: FastAPI) -> None:
    doors = list_route_rules([*list_control_routers(), *list_back_office_routers()], API_PREFIX, app.state.settings)
    free = {door.path.pattern for door in doors if door.required_right is None and "/docs" not in door.path.pattern}
    assert free == {rf"^/api/v1/{name}$" for name in ("health", "ready", "views/(?P<view>[^/]+)")}
    assert {door.required_right.right for door in doors if door.required_right is not None} <= RIGHTS_BY_SCOPE["admin"]
    described = app.openapi()
    assert described["components"]["securitySchemes"]["HTTPBearer"]["scheme"] == "bearer"
    for path, methods in described["paths"].items():
        for method, route in methods.items():
            found = find_route_rule(doors, method.upper(), path)
            assert found is not None and (found[0].required_right is None) == (not route.get("security")), path
            assert {"413", "429", "503"} <= set(route["responses"]) and route["operationId"]
    of_fleet = {"GET": ("", RequiredRight("read", fleet_parameter="id")), "POST": ("/stop", RequiredRight("operate"))}
    for method, (end, right) in of_fleet.items():
        found = find_route_rule(doors, method, f"/api/v1/fleets/f1{end}")
        assert found is not None and (found[0].required_right, found[1]) == (right, {"id": "f1"})
    for method, path in (("GET", "/api/v1/fleets/f1/stop"), ("GET", "/api/v1/fleet"), ("GET", "/")):
        assert find_route_rule(doors, method, path) is None


def test_who_administers_makes_tokens(app: FastAPI, client: TestClient) -> None:
    control, admin = bearer(app, BOTH), bearer(app, "admin")
    body = {"name": "phone", "scopes": ["read"], "expires": "30d"}
    assert client.get("/api/v1/tokens").status_code == 401
    assert client.post("/api/v1/tokens", json=body, headers=control).status_code == 403
    made = client.post("/api/v1/tokens", json=body, headers=admin)
    assert made.status_code == 201
    phone = {"Authorization": f"Bearer {made.json()['token']}"}
    assert client.post("/api/v1/tokens", json=body, headers=phone).status_code == 403
    assert client.post("/api/v1/tokens", json=body, headers=admin).status_code == 409
    listed = client.get("/api/v1/tokens", headers=admin)
    assert [each["name"] for each in listed.json()["items"]] == ["a operator planner", "a admin", "phone"]
    phone_row = listed.json()["items"][2]
    assert phone_row["scopes"] == ["read"] and phone_row["expires"] == made.json()["expires"] > phone_row["created"]
    assert made.json()["token"] not in listed.text + client.get("/api/v1/events").text
    assert client.delete("/api/v1/tokens/phone", headers=admin).status_code == 204
    assert client.get("/api/v1/fields", headers=phone).status_code == 401


def test_a_login_address_works_once_and_its_cookie_lasts(app: FastAPI) -> None:
    logins: BrowserLogins = app.state.logins
    shown: list[str] = []
    logins.on_used = shown.append
    code = logins.code
    first = client_of(app)
    answer = first.get(f"/login?code={code}", follow_redirects=False)
    assert answer.status_code == 303 and answer.headers["location"] == "/"
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=strict" in cookie and "Secure" not in cookie and code not in cookie
    assert first.get("/api/v1/fields").status_code == 200 and shown == [logins.code] != [code]
    assert first.get(f"/login?code={code}", follow_redirects=False).headers["location"] == "/"
    assert first.head(f"/login?code={logins.code}").status_code == 405 and len(shown) == 1
    second = elsewhere(app)
    for wrong in (code, "", "x" * 5000, "\u00e9"):
        refused = second.get("/login", params={"code": wrong}, follow_redirects=False)
        assert refused.status_code == 401 and "headland serve" in refused.json()["error"]
        assert "set-cookie" not in refused.headers
    assert second.get("/api/v1/fields").status_code == 401
    assert second.get("/api/v1/fields", headers={"cookie": "headland_login=guessed"}).status_code == 401


def test_logins_end_after_a_month_and_the_oldest_of_very_many_give_way(app: FastAPI) -> None:
    now = [0.0]
    logins = BrowserLogins(secure=True, clock=lambda: now[0])
    cookies = []
    for _ in range(101):
        cookies.append(logins.redeem_code(logins.code))
        now[0] += 1.0

    def reads(value: str) -> bool:
        headers = [(b"cookie", f"headland_login={value}".encode())]
        return logins.is_logged_in(HTTPConnection({"type": "http", "headers": headers}))

    assert [reads(cookies[0]), reads(cookies[1]), reads(cookies[-1])] == [False, True, True]
    assert "Secure" in logins.log_in_browser(logins.code).headers["set-cookie"]
    now[0] += 30 * 24 * 3600.0
    assert not reads(cookies[-1])


def test_every_answer_tells_browsers_what_to_refuse_and_the_documentation_asks_for_nothing_from_elsewhere(
    shared: Shared,
) -> None:
    client = shared[0]
    for path in ("/api/v1/health", "/api/v1/nothing", "/nothing", "/api/v1/docs"):
        headers = client.get(path).headers
        policy = headers["content-security-policy"]
        assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy and "unsafe" not in policy
        assert headers["x-content-type-options"] == "nosniff" and headers["referrer-policy"] == "no-referrer"
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


def test_the_rate_is_limited_for_each_address_but_for_orders_to_stop(tmp_path: Path) -> None:
    app = create_app(ServiceSettings(data=tmp_path, workers=0, rate_per_minute=5), reads_inline=True)
    stop = "/api/v1/fleets/none/stop"
    with client_of(app) as client:
        token = bearer(app, "operator")
        assert [client.get("/api/v1/health").status_code for _ in range(7)] == [200] * 5 + [429] * 2
        answer = client.get("/api/v1/health")
        assert int(answer.headers["retry-after"]) >= 1 and "5 requests" in answer.json()["error"]
        assert elsewhere(app).get("/api/v1/health").status_code == 200
        assert [client.post(stop, headers=token).status_code for _ in range(4)] == [404] * 4
        assert client.post(stop).status_code == 429, "without a token nobody may ask so often"
        assert client.post("/api/v1/fleets/none/resume", headers=token).status_code == 429
        assert client.get(stop, headers=token).status_code == 429


def test_a_bucket_fills_again() -> None:
    now = [0.0]
    buckets = RateLimiter(1.0, 60, lambda: now[0])
    assert [buckets.take_token("a") for _ in range(60)] == [0.0] * 60
    assert buckets.take_token("a") == pytest.approx(1.0) and buckets.take_token("b") == 0.0
    now[0] = 2.0
    assert [buckets.take_token("a") > 0.0 for _ in range(3)] == [False, False, True]


def test_a_view_is_looked_at_once_within_a_minute() -> None:
    now = [0.0]
    views, result = OneTimeViews(lambda: now[0]), ResultRow(name="page.html")
    first, second = views.add_view(result), views.add_view(result)
    assert first != second and views.take_view(first) is result
    for name in (first, "other"):
        with pytest.raises(NotFoundError):
            views.take_view(name)
    now[0] = 61.0
    with pytest.raises(NotFoundError):
        views.take_view(second)


def test_sockets_of_other_sites_pages_are_refused(app: FastAPI, token: dict[str, str]) -> None:
    @app.websocket("/try")
    async def link(websocket: WebSocket) -> None:
        await websocket.accept()
        hello = await websocket.receive_json()
        try:
            who = await identify_socket(websocket, hello["token"])
            await websocket.send_text(json.dumps([who.name, who.has_right("read"), who.has_right("operate")]))
        except ServiceError as refusal:
            await websocket.send_text(json.dumps(refusal.http_status))

    client = client_of(app)
    text = token["Authorization"].removeprefix("Bearer ")
    hellos = ((None, ["nobody", False, False]), (text, ["a operator planner", True, True]), ("hl_no", 401))
    for (headers, refused), (given, expected) in product(ORIGINS, hellos):
        with client.websocket_connect("ws://127.0.0.1:8765/try", headers=headers) as socket:
            socket.send_json({"token": given})
            assert socket.receive_json() == (403 if refused else expected), headers


def test_the_login_of_the_own_machine_brings_a_token_until_somebody_makes_one(app: FastAPI) -> None:
    store, logins = app.state.store, app.state.logins
    logins.make_token = store.create_browser_token
    with client_of(app) as client:
        used = logins.code
        answer = client.get("/login", params={"code": used}, follow_redirects=False)
        assert answer.status_code == 303 and answer.headers["cache-control"] == "no-store"
        path, _, token = answer.headers["location"].partition("#token=")
        assert path == "/" and [row.name for row in store.list_tokens()] == ["browser 1"]
        about = client.get("/api/v1/me", headers={"Authorization": f"Bearer {token}"}).json()
        assert (
            about["rights"] == ["operate", "plan", "read"] and f"--data {store.settings.data}" in about["token_command"]
        )
        again = client.get("/login", params={"code": used}, follow_redirects=False)
        assert again.headers["location"] == "/", "an address is worth a token once"
        another = client.get("/login", params={"code": logins.code}, follow_redirects=False)
        assert "#token=hl_" in another.headers["location"], "its user opened the next address, as the tab was closed"
        made = client.post("/api/v1/fields/denmark/copy", json={}, headers={"Authorization": f"Bearer {token}"}).json()
        assert made["owner"] is None, "a browser gets another token with each login"
        with pytest.raises(ServiceError, match="'browser 7' is one for browsers"):
            store.create_token_text("browser 7", "planner")
        store.create_token_text("office", "planner")
        last = client.get("/login", params={"code": logins.code}, follow_redirects=False)
        assert last.headers["location"] == "/" and len(store.list_tokens()) == 3
        assert client.post("/api/v1/fields/denmark/copy", json={}).status_code == 401, "the cookie alone only reads"


def test_refusals_name_the_folder_to_those_who_may_know_it(app: FastAPI, client: TestClient) -> None:
    folder = app.state.settings.data
    refused = client.delete("/api/v1/fields/x").json()["error"]
    assert f"headland token new --data {folder} --scope planner makes one" in refused
    stranger = TestClient(app, base_url=HERE, client=("127.0.0.1", 50001)).delete("/api/v1/fields/x").json()["error"]
    assert str(folder) not in stranger and "headland token new --scope planner makes one" in stranger
    proxied = create_app(ServiceSettings(data=folder.parent / "far", workers=0, public_url="https://farm.example"))
    assert proxied.state.settings.is_own_machine is False
    proxied.state.store.close()


def test_services_of_one_process_share_nothing_but_their_routes(tmp_path: Path) -> None:
    one, other = (
        create_app(ServiceSettings(data=tmp_path / name, workers=0), reads_inline=True) for name in ("one", "other")
    )
    header = bearer(one, BOTH)
    for app, status in ((other, 401), (one, 200)):
        with client_of(app) as client:
            assert client.get("/api/v1/fleets", headers=header).status_code == status
