"""The page of a sweep in a browser: a point shows its command, by pointer and keyboard, on every width."""

from dataclasses import replace
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from reports.sweep.report import render_sweep_page
from tests.service.accessibility import find_violations
from tests.sweep.results import build_result

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def tab(browser: Browser) -> Page:
    return browser.new_page()


@pytest.mark.parametrize("width", [390, 1280])
def test_a_point_shows_its_command(tab: Page, tmp_path: Path, width: int) -> None:
    page = tmp_path / "page.html"
    result = replace(build_result(), link="https://farm.example/#/plan?field=my+field&margin=1")
    page.write_text(render_sweep_page(result), encoding="utf-8")
    tab.set_viewport_size({"width": width, "height": 900})
    tab.goto(page.as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") <= width
    assert find_violations(tab) == []
    command = "headland plan --margin 1 'my field.geojson' --width 6 --tractors {} --price-per-hour 40"
    assert tab.text_content("#command") == command.format(1)
    tab.focus("#walk")
    tab.keyboard.press("Home")
    assert tab.text_content("#command") == command.format(3)
    tab.keyboard.press("ArrowRight")
    assert tab.text_content("#command") == command.format(2)
    tab.locator(".front").last.click(force=True)
    assert tab.text_content("#command") == command.format(1)
    assert "1:40:00, cost 71.67 EUR, " in (tab.text_content("#figures") or "")
    link = result.link + "&width=6&tractors={}&price_per_hour=40"
    assert tab.get_attribute("#form", "href") == link.format(1)
    tab.click("[data-point] >> nth=0")
    assert tab.get_attribute("#form", "href") == link.format(3)
    assert tab.text_content("#command") == command.format(3)
