"""The service behind real proxies with TLS, and in a real browser: nothing is readable, and the page links."""

import json
import os
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.browsers import BROWSER, open_browser
from tests.service.fleets import format_small_plan
from tests.service.running import Running, run_service
from tests.service.web_proxies import (
    ask_over_tls,
    connect_over_tls,
    has_caddy,
    has_nginx,
    run_bare_nginx,
    run_caddy,
    run_nginx,
)

PUBLIC = "https://farm.example"
MUST = bool(os.environ.get("HEADLAND_TEST_BROWSER"))
needs_nginx = pytest.mark.skipif(not (has_nginx() or MUST), reason="no nginx is installed")
needs_caddy = pytest.mark.skipif(not (has_caddy() or MUST), reason="no Caddy is installed")
TEXT = format_small_plan()


@dataclass
class Behind:
    """A service behind a proxy that takes TLS on a port."""

    service: Running
    port: int
    fleet: str = ""

    def ask(self, method: str, path: str, body: bytes | None, headers: dict[str, str]) -> int:
        """The status of a request through the proxy."""
        return ask_over_tls(connect_over_tls(self.port, "127.0.0.1"), method, path, body, headers)


@pytest.fixture(scope="module", params=["with --public-url", pytest.param("without", marks=pytest.mark.matrix)])
def service(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Running, str]]:
    """A service, and the id of a fleet that it has."""
    options = ("--public-url", PUBLIC) if request.param.startswith("with ") else ()
    with run_service(tmp_path_factory.mktemp("proxy") / "data", *options) as made:
        operator = made.make_token("operator")
        status, fleet = made.ask_json("POST", "/fleets", {"name": "north field", "plan": TEXT}, operator)
        assert status == 201, fleet
        yield made, fleet["id"]


@pytest.fixture(params=[pytest.param(run_nginx, marks=needs_nginx), pytest.param(run_caddy, marks=needs_caddy)])
def behind(request: pytest.FixtureRequest, service: tuple[Running, str], tmp_path: Path) -> Iterator[Behind]:
    """The service behind a proxy with the configuration of the guide."""
    with request.param(tmp_path, service[0].port, name="farm.example") as port:
        yield Behind(service[0], port, service[1])


@pytest.mark.slow
@needs_nginx
def test_behind_a_bare_proxy_pass_nothing_is_readable_without_a_token(
    service: tuple[Running, str], tmp_path: Path
) -> None:
    paths = json.loads(service[0].ask("GET", "/api/v1/openapi.json")[2])["paths"]
    closed = [path for path, methods in paths.items() if methods.get("get", {}).get("security")]
    assert len(closed) > 25
    with run_bare_nginx(tmp_path, service[0].port) as port:
        behind = Behind(service[0], port)
        for path in closed:
            assert behind.ask("GET", re.sub(r"\{[^}]*\}", "x", path), None, {"host": "127.0.0.1"}) == 401, path


@pytest.mark.slow
@pytest.mark.skipif(BROWSER is None and not MUST, reason="no browser is installed")
def test_the_page_links_behind_tls_on_the_usual_port(behind: Behind) -> None:
    frames: list[str] = []
    said: list[str] = []
    with open_browser(f"--host-resolver-rules=MAP farm.example:443 127.0.0.1:{behind.port}") as browser:
        page = browser.new_context(ignore_https_errors=True).new_page()
        page.on("websocket", lambda socket: socket.on("framereceived", lambda text: frames.append(str(text))))
        page.on("console", lambda message: said.append(message.text) if message.type == "error" else None)
        code = next(line for line in reversed(behind.service.lines) if "code=" in line).rsplit("code=", 1)[1]
        page.goto(f"{PUBLIC}/login?code={code}")
        page.goto(f"{PUBLIC}/#/fleet/{behind.fleet}")
        page.wait_for_selector("text=Ready", timeout=20_000)
        until = time.monotonic() + 20.0
        while not any('"tick"' in text for text in frames) and time.monotonic() < until:
            page.wait_for_timeout(100)
        cookie = page.context.cookies()[0]
    kinds = {json.loads(text)["kind"] for text in frames if text.startswith("{")}
    assert {"welcome", "scene", "tick"} <= kinds and "refused" not in kinds
    assert said == [], said
    assert cookie["name"] == "headland_login" and cookie["httpOnly"] and cookie["sameSite"] == "Strict"
    if behind.service.login.startswith(PUBLIC):
        assert cookie["secure"]
