"""A service of each test's own: folder, database, tokens, and a client on this machine; a page that is watched."""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from playwright.sync_api import Browser
from starlette.testclient import TestClient

from planner.fleet.model.fleet_plan import FleetPlan
from planner.service.jobs.workers import run_and_store_job
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from planner.service.store.tables import JobRow, TokenRow
from planner.service.store.token_table import has_expired, hash_token
from tests.service.databases import KINDS, database
from tests.service.fake_service import CONTROL, Made, fake_app
from tests.service.one_process import create_app
from tests.service.watching import WatchedPage, serve_app

BOTH = "operator planner"
HERE = "http://127.0.0.1:8765"
SMALL = json.dumps(
    {"type": "Polygon", "coordinates": [[[0.0, 0.0], [45.0, 0.0], [45.0, 80.0], [0.0, 80.0], [0.0, 0.0]]]}
).encode()

Shared = tuple[TestClient, dict[str, str]]


@pytest.fixture(params=KINDS)
def both(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[ServiceSettings]:
    """Settings on each database in turn, without workers."""
    with database(request.param) as url:
        yield ServiceSettings(data=tmp_path / "data", database=url, workers=0, lease_s=1.0)


@pytest.fixture
def store(both: ServiceSettings) -> Iterator[Store]:
    """An empty store, on each database in turn."""
    store = Store(both)
    yield store
    store.close()


@pytest.fixture
def plain(tmp_path: Path) -> Iterator[Store]:
    """An empty store on SQLite in the folder of the test."""
    store = Store(ServiceSettings(data=tmp_path))
    yield store
    store.close()


@pytest.fixture
def settings(tmp_path: Path) -> ServiceSettings:
    """Settings of a small service on SQLite, without workers."""
    return ServiceSettings(data=tmp_path / "data", workers=0, upload_mb=1, jobs_waiting=3)


@pytest.fixture
def app(settings: ServiceSettings) -> FastAPI:
    """A service whose files are read in this process."""
    return create_app(settings, reads_inline=True)


@pytest.fixture
def client(app: FastAPI) -> Iterator[TestClient]:
    """A client that has logged in and so reads, without a token."""
    with client_of(app) as client:
        yield log_in(client)


@pytest.fixture
def token(app: FastAPI) -> dict[str, str]:
    """The header of a token that may plan and operate."""
    return bearer(app, BOTH)


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[int, str, str]]:
    """Exit status and what is printed of the command in this process."""

    def headland(*arguments: str | Path) -> tuple[int, str, str]:
        from planner.cli.main import main

        monkeypatch.setattr("sys.argv", ["headland", *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        return int(end.value.code or 0), out, err

    return headland


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shared]:
    """A client and the header of a token that may plan and operate, for tests that leave nothing behind."""
    settings = ServiceSettings(data=tmp_path_factory.mktemp("shared"), workers=0, upload_mb=1, jobs_waiting=1000)
    app = create_app(settings, reads_inline=True)
    with client_of(app) as client:
        yield log_in(client), bearer(app, BOTH)


@pytest.fixture(scope="session")
def plan(tmp_path_factory: pytest.TempPathFactory) -> FleetPlan:
    """A plan of three tractors that come in by a corner of a small field, which no test changes."""
    from tests.service.test_replanning import plan_three

    return plan_three(tmp_path_factory, (0.0, 0.0))


@pytest.fixture(scope="module")
def pages() -> Iterator[tuple[str, Made]]:
    """The address of the pages with a made-up service behind them, and what is asked of it."""
    app = fake_app()
    with serve_app(app) as base:
        yield base, app.state.made


@pytest.fixture(scope="module")
def window(pages: tuple[str, Made], browser: Browser) -> WatchedPage:
    """The page of `watched`."""
    return WatchedPage(browser, pages[0], CONTROL)


@pytest.fixture
def watched(window: WatchedPage) -> WatchedPage:
    """A page with an operator's token, of which nothing was said yet; tests open what they need in it."""
    window.said.clear()
    window.asked.clear()
    return window


def client_of(app: FastAPI) -> TestClient:
    """A client on the machine of a service."""
    return TestClient(app, base_url=HERE, client=("127.0.0.1", 50000))


def wait_until(is_true: Callable[[], bool], patience_s: float = 60.0) -> None:
    """Wait for something; no longer than `patience_s`."""
    end = time.monotonic() + patience_s
    while not is_true():
        assert time.monotonic() < end
        time.sleep(0.02)


def log_in(client: TestClient) -> TestClient:
    """The same client, which has opened the login address."""
    app: Any = client.app
    answer = client.get("/login", params={"code": app.state.logins.code}, follow_redirects=False)
    assert answer.status_code == 303
    return client


def bearer(app: FastAPI, scope: str, **more: Any) -> dict[str, str]:
    """The header of a new token of a scope, or of several with spaces between them."""
    return {"Authorization": f"Bearer {app.state.store.create_token_text(f'a {scope}', scope, **more)}"}


def run_next_job(store: Store, worker: str = "here") -> None:
    """Do the next job of a store in this process."""
    claimed = store.claim_job(worker)
    assert claimed is not None
    run_and_store_job(store, worker, claimed)


def store_done_job(
    store: Store,
    request: dict[str, Any] | None = None,
    inputs: dict[str, str] | None = None,
    results: Mapping[str, bytes] = {"result.json": b"made"},
) -> JobRow:
    """A plan in a store that is done, with its results."""
    job = store.add_job("plan", "first", request or {}, inputs)
    claimed = store.claim_job("w")
    assert claimed is not None and claimed.id == job.id
    store.keep_results(job.number, results)
    store.finish_job(job.number, "w", results)
    return store.get_job(job.id)


def find_token(store: Store, text: str) -> TokenRow | None:
    """The token of a text in a store; None for an unknown or expired one."""
    rows = [row for row in store.list_tokens() if row.sha256 == hash_token(text) and not has_expired(row)]
    return rows[0] if rows else None
