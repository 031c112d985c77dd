"""A page in a browser, and an app for it to speak with."""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import patch

import pytest
import uvicorn
from fastapi import FastAPI
from playwright.sync_api import Browser, ConsoleMessage, Error, Page, Request, ViewportSize

from planner.service.gateway.connection_limits import RateLimiter
from tests.browsers import LONGEST_WAIT_S

WIDE: ViewportSize = {"width": 1280, "height": 860}
NARROW: ViewportSize = {"width": 390, "height": 844}


@contextlib.contextmanager
def serve_app(app: FastAPI) -> Iterator[str]:
    """The address of an app that is served in a thread of its own."""
    server = uvicorn.Server(uvicorn.Config(app, host="127.0.0.1", port=0, log_level="error", ws="websockets-sansio"))
    thread = threading.Thread(target=server.run, daemon=True)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}/"
    finally:
        server.should_exit = server.force_exit = True
        thread.join(LONGEST_WAIT_S)
        assert not thread.is_alive(), "the app ends when it is asked to"


class WatchedPage:
    """A page with what its console said and what it asked for."""

    def __init__(self, browser: Browser, base: str, token: str | None = None) -> None:
        self.base = base
        self.said: list[str] = []
        self.asked: list[str] = []
        self.page: Page = browser.new_context(viewport=WIDE, color_scheme="light", reduced_motion="reduce").new_page()
        self.page.set_default_timeout(1000 * LONGEST_WAIT_S)
        self.page.on("console", self._note_message)
        self.page.on("pageerror", self._note_error)
        self.page.on("request", self._note_request)
        if token:
            self.page.add_init_script(f'if (origin !== "null") sessionStorage.setItem("headland-token", "{token}")')

    def _note_message(self, message: ConsoleMessage) -> None:
        if message.type != "log":
            self.said.append(message.text)

    def _note_error(self, error: Error) -> None:
        self.said.append(str(error))

    def _note_request(self, request: Request) -> None:
        self.asked.append(request.url)

    def open(self, path: str) -> Page:
        self.page.goto(f"{self.base}#{path}")
        self.page.wait_for_selector("main h1")
        return self.page

    def well(self) -> None:
        """Nothing was complained of, and nothing asked of anybody else."""
        assert self.said == [], self.said
        here = (self.base, "data:", "blob:")
        assert [url for url in self.asked if not url.startswith(here)] == []


@contextlib.contextmanager
def watch_app(browser: Browser, app: FastAPI, scopes: str) -> Iterator[WatchedPage]:
    """A page with a token of some scopes, with an app behind it.

    Many tests share its user, whose estimates may compute more than those of one; on a busy machine the process that
    estimates may take long to begin.
    """
    token = app.state.store.create_token_text("office", scopes)
    app.state.estimator.budget = RateLimiter(1.0, math.inf)
    with patch("planner.service.jobs.plan_estimates.START_WAIT_S", 240.0), serve_app(app) as base:
        watched = WatchedPage(browser, base, token)
        yield watched
        watched.page.context.close()


def until(page: Page, holds: Callable[[], bool]) -> None:
    """Wait until something holds, and fail where it does not in good time."""
    end_s = time.monotonic() + LONGEST_WAIT_S
    while time.monotonic() < end_s:
        if holds():
            return
        page.wait_for_timeout(25)
    pytest.fail("it never came to hold")


def find_overflow(page: Page) -> list[str]:
    """What sticks out at the right of the window, but for what scrolls in a box of its own."""
    found: list[str] = page.evaluate("""() => [...document.querySelectorAll("main *")].filter((one) =>
      !one.closest(".scroll, .spoken") && one.getBoundingClientRect().right > innerWidth + 1)
      .map((one) => `${one.tagName}.${one.className}`)""")
    return found


def count_colours(page: Page) -> int:
    """How many colours the largest canvas has: more than a few when something is drawn."""
    found: int = page.evaluate("""() => {
      const all = [...document.querySelectorAll("canvas")].sort((a, b) => b.width * b.height - a.width * a.height);
      if (!all.length) return 0;
      const data = all[0].getContext("2d").getImageData(0, 0, all[0].width, all[0].height).data, seen = new Set();
      for (let k = 0; k < data.length; k += 4 * 7) seen.add(`${data[k]},${data[k + 1]},${data[k + 2]}`);
      return seen.size; }""")
    return found


def evaluate_in_page(page: Page, expression: str) -> Any:
    """What an expression comes to, with modules of the page as `m`."""
    return page.evaluate(f"""async () => {{
      const m = {{}};
      for (const name of ["words", "control", "player", "camera", "drawfield", "livemap", "files"]) {{
        Object.assign(m, await import(`./static/js/${{name}}.js`));
      }}
      return {expression};
    }}""")
