"""The browser that tests of pages look through, where one is installed."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager

from playwright.sync_api import Browser, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)
LONGEST_WAIT_S = 240.0  # as long as a service may take to start: a busy machine is slow, and no fault of the page


@contextmanager
def open_browser(*more: str) -> Iterator[Browser]:
    """A browser without a window, started with these arguments as well."""
    with sync_playwright() as play:
        arguments = ["--no-sandbox", "--disable-gpu", *more]
        browser = play.chromium.launch(executable_path=BROWSER, args=arguments, timeout=1000 * LONGEST_WAIT_S)
        yield browser
        browser.close()
