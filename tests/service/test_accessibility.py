"""Every page by axe-core, without sideways scrolling, at three widths, dark and light, and printed."""

from __future__ import annotations

import pytest
from playwright.sync_api import Browser

from tests.service.accessibility import find_faults_at_widths, find_violations, open_all_details
from tests.service.test_pages import PAGES
from tests.service.watching import WIDE, WatchedPage, needs_browser

pytestmark = needs_browser


def test_faults_are_found(browser: Browser) -> None:
    page = browser.new_page()
    page.set_content(
        '<html lang="en"><title>x</title><main><h1>A</h1><img src="x.png"><input>'
        '<div style="width:2000px;color:#999;background:#fff">pale</div></main>'
    )
    found = "\n".join(find_faults_at_widths(page, widths_px=(390,)))
    assert "2000 px wide" in found or "2008 px wide" in found
    assert {"image-alt", "label", "color-contrast"} <= {line.split(": ")[1] for line in found.split("\n")[1:]}
    page.close()


@pytest.mark.slow
@pytest.mark.parametrize(("path", "whole"), PAGES.items())
def test_a_page_is_accessible_at_every_width(watched: WatchedPage, path: str, whole: str) -> None:
    page = watched.open(path)
    page.wait_for_selector(whole)
    open_all_details(page)
    try:
        assert find_faults_at_widths(page) == []
        page.emulate_media(color_scheme="dark")
        assert find_violations(page) == []
    finally:
        page.emulate_media(color_scheme="light")
        page.set_viewport_size(WIDE)
