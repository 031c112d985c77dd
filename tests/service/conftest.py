"""A service of each test's own: folder, database, tokens, and a client on this machine; a browser for the pages."""

import json
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi import FastAPI
from playwright.sync_api import Browser, sync_playwright
from starlette.testclient import TestClient

from planner.service.api import create_app
from planner.service.settings import Settings
from planner.service.store import Store
from tests.service.databases import KINDS, database
from tests.service.fake_service import CONTROL, Made, fake_app
from tests.service.watching import BROWSER, Watched, served

HERE = "http://127.0.0.1:8765"
SMALL = json.dumps(
    {"type": "Polygon", "coordinates": [[[0.0, 0.0], [45.0, 0.0], [45.0, 80.0], [0.0, 80.0], [0.0, 0.0]]]}
).encode()


@pytest.fixture(params=KINDS)
def both(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Settings]:
    """Settings on each database in turn, without workers."""
    with database(request.param) as url:
        yield Settings(data=tmp_path / "data", database=url, workers=0, lease_s=1.0)


@pytest.fixture
def store(both: Settings) -> Iterator[Store]:
    """An empty store, on each database in turn."""
    store = Store(both)
    yield store
    store.close()


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Settings of a small service on SQLite, without workers."""
    return Settings(data=tmp_path / "data", workers=0, upload_mb=1, jobs_waiting=3)


@pytest.fixture
def app(settings: Settings) -> FastAPI:
    """A service whose files are read in this process."""
    return create_app(settings, inline=True)


@pytest.fixture
def client(app: FastAPI) -> Iterator[TestClient]:
    """A client on this machine, without a token."""
    with TestClient(app, base_url=HERE, client=("127.0.0.1", 50000)) as client:
        yield client


@pytest.fixture
def token(app: FastAPI) -> dict[str, str]:
    """The header of a token that may control."""
    return bearer(app, "control")


Shared = tuple[TestClient, dict[str, str]]


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Shared]:
    """A client and the header of a token that may control, for tests that leave nothing behind."""
    settings = Settings(data=tmp_path_factory.mktemp("shared"), workers=0, upload_mb=1, jobs_waiting=1000)
    app = create_app(settings, inline=True)
    with TestClient(app, base_url=HERE, client=("127.0.0.1", 50000)) as client:
        yield client, bearer(app, "control")


@pytest.fixture(scope="module")
def pages() -> Iterator[tuple[str, Made]]:
    """The address of the pages with a made-up service behind them, and what is asked of it."""
    app = fake_app()
    with served(app) as base:
        yield base, app.state.made


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A real browser without a window."""
    with sync_playwright() as play:
        found = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def window(pages: tuple[str, Made], browser: Browser) -> Watched:
    """The page of `watched`."""
    return Watched(browser, pages[0], CONTROL)


@pytest.fixture
def watched(window: Watched) -> Watched:
    """A page with a token that may control, of which nothing was said yet; tests open what they need in it."""
    window.said.clear()
    window.asked.clear()
    return window


def bearer(app: FastAPI, scope: str) -> dict[str, str]:
    """The header of a new token of a scope."""
    return {"Authorization": f"Bearer {app.state.store.new_token(f'a {scope}', scope)}"}
