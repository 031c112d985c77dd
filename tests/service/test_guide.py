"""The guide: what it names is there, and the files beside it do what it says."""

import re
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, ClassVar

import pytest

from tests.service.web_proxies import GUIDE, ask_over_tls, connect_over_tls, has_caddy, has_nginx, run_caddy, run_nginx

ROOT = GUIDE.parents[1]
PAGES = (*sorted(GUIDE.glob("*.md")), ROOT / "README.md", ROOT / "SECURITY.md")
UPLOAD = 3 * 2**20  # more than nginx and Caddy take without a word
PROXIES = [
    pytest.param(run_nginx, marks=pytest.mark.skipif(not has_nginx(), reason="nginx is not installed")),
    pytest.param(run_caddy, marks=pytest.mark.skipif(not has_caddy(), reason="Caddy is not installed")),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    links = re.findall(r"\]\((?!https?://)([^)#]+)", page.read_text(encoding="utf-8"))
    assert [link for link in links if not (page.parent / link).is_file()] == []


@pytest.mark.skipif(not (ROOT / "tests" / "benchmarks" / "attack").exists(), reason="a part of the tests is not here")
def test_code_and_tests_that_the_threat_model_names_are_there() -> None:
    text = (GUIDE / "threat-model.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:tests|service|fleet|fields)/[\w/.-]+|test_\w+\.py)`", text)
    places = [ROOT, ROOT / "planner", ROOT / "planner" / "service", ROOT / "tests" / "service"]
    assert len(named) > 20
    assert [name for name in named if not any((place / name).exists() for place in places)] == []


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd is not installed")
def test_the_unit_is_one(tmp_path: Path) -> None:
    unit = tmp_path / "headland.service"
    text = (GUIDE / "headland.service").read_text(encoding="utf-8")
    unit.write_text(text.replace("/opt/headland/bin/headland", sys.executable), encoding="utf-8")
    done = subprocess.run(["systemd-analyze", "verify", unit], capture_output=True, text=True, timeout=60, check=False)
    assert "headland.service" not in done.stderr, done.stderr


class Upstream(BaseHTTPRequestHandler):
    """Says what reached it."""

    seen: ClassVar[list[tuple[str, dict[str, str], int]]] = []

    def do_GET(self) -> None:
        length = int(self.headers.get("content-length", 0))
        got = len(self.rfile.read(length))
        self.seen.append((self.path, {name.lower(): value for name, value in self.headers.items()}, got))
        self.send_response(200)
        self.send_header("content-length", "0")
        self.end_headers()

    def do_POST(self) -> None:
        self.do_GET()

    def log_message(self, *_: Any) -> None:
        """Nothing."""


@pytest.fixture
def upstream() -> Iterator[int]:
    Upstream.seen.clear()
    with ThreadingHTTPServer(("127.0.0.1", 0), Upstream) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()


def ask(port: int, method: str, path: str, body: bytes | None = None, **headers: str) -> int:
    """The status of an answer over HTTPS, with a Host as a browser sends it."""
    return ask_over_tls(connect_over_tls(port), method, path, body, headers)


@pytest.mark.parametrize("run", PROXIES)
def test_a_proxy_of_the_guide_passes_on_what_the_service_needs(
    run: Callable[..., AbstractContextManager[int]], tmp_path: Path, upstream: int
) -> None:
    with run(tmp_path, upstream) as https:
        assert ask(https, "GET", "/api/v1/health") == 200
        assert ask(https, "POST", "/api/v1/fields", b"x" * UPLOAD) == 200
        assert ask(https, "GET", "/login?code=secret") == 200
        upgrade = {"upgrade": "websocket", "connection": "Upgrade"}
        assert ask(https, "GET", "/api/v1/fleets/one/link", **upgrade) == 200  # by an upstream that takes none
        if run is run_nginx:  # by the header alone; Caddy refuses once so much has come
            assert ask(https, "POST", "/api/v1/fields", b"", **{"content-length": str(100 * 2**20)}) == 413
    paths = [path for path, _, _ in Upstream.seen]
    assert paths == ["/api/v1/health", "/api/v1/fields", "/login?code=secret", "/api/v1/fleets/one/link"]
    assert {headers["host"] for _, headers, _ in Upstream.seen} == {f"localhost:{https}"}
    assert Upstream.seen[1][2] == UPLOAD
    assert Upstream.seen[3][1]["upgrade"] == "websocket" and Upstream.seen[3][1]["connection"].lower() == "upgrade"
    assert "secret" not in "".join(path.read_text() for path in tmp_path.glob("access.log"))


@pytest.mark.skipif(not has_nginx(), reason="nginx is not installed")
def test_one_client_is_held_back_but_for_stops(tmp_path: Path, upstream: int) -> None:
    with run_nginx(tmp_path, upstream) as https:
        connection, statuses = connect_over_tls(https), set[int]()
        for _ in range(400):
            connection.request("GET", "/")
            answer = connection.getresponse()
            answer.read()
            statuses.add(answer.status)
        connection.close()
        stops = {ask(https, "POST", "/api/v1/fleets/one/stop", b"{}") for _ in range(5)}
    assert statuses == {200, 429} and stops == {200}
