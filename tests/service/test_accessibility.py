"""Every page by axe-core, without sideways scrolling, at three widths, dark and light, and printed."""

import io
import unicodedata

import pytest
from playwright.sync_api import Browser
from pypdf import PageObject, PdfReader

from tests.service.accessibility import WIDTHS_PX, find_faults_at_widths, find_violations, open_all_details
from tests.service.test_pages import PAGES
from tests.service.watching import WIDE, WatchedPage, find_overflow, needs_browser

pytestmark = [needs_browser, pytest.mark.slow]
EACH_PAGE = [
    pytest.param(*page, marks=pytest.mark.matrix if place % 2 else ())
    for place, page in enumerate([*PAGES.items(), ("/nowhere", "text=No such page")])
]
"""Every other page in every run of CI; of the others it reads all texts (test_pages_language.py)."""


@pytest.mark.slow
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
@pytest.mark.parametrize("widths_px", [WIDTHS_PX[:1], pytest.param(WIDTHS_PX[1:], marks=pytest.mark.matrix)], ids=str)
@pytest.mark.parametrize(("path", "whole"), EACH_PAGE)
def test_a_page_is_accessible_at_every_width(
    watched: WatchedPage, path: str, whole: str, widths_px: tuple[int, ...]
) -> None:
    page = watched.open(path)
    page.wait_for_selector(whole)
    open_all_details(page)
    try:
        assert find_faults_at_widths(page, widths_px=widths_px) == []
        page.emulate_media(color_scheme="dark")
        assert find_violations(page) == []
    finally:
        page.emulate_media(color_scheme="light")
        page.set_viewport_size(WIDE)


@pytest.mark.slow
@pytest.mark.parametrize(
    "path",
    [
        "guide/service",
        *(pytest.param(f"guide/{end}", marks=pytest.mark.matrix) for end in ("", "reference", "?q=headland")),
    ],
)
def test_the_guide_is_accessible(watched: WatchedPage, path: str) -> None:
    page = watched.page
    page.goto(f"{watched.base}{path}")
    assert find_faults_at_widths(page) == []
    page.set_viewport_size(WIDE)


PRINTED = {
    "/plan/old": ("text=Plans, best first", ["Plans, best first", "Strategy"], ["Send it out", "Choose File", "Save"]),
    "/plan": ("text=Earlier plans", ["Plan a field", "Working width, m"], ["Run the plan", "Choose File", "Overview"]),
    "/farm": ("[name='tractors.1.file']", ["Tractors", "Fuel per litre"], ["Save the farm", "Remove this tractor"]),
    "/library": ("li.shelf", ["Library", "north field"], ["Rename", "Choose File"]),
}
"""What a page has on paper, and what it has on the screen alone."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [pytest.param(path, marks=pytest.mark.matrix if place % 2 else ()) for place, path in enumerate(PRINTED)]
)
def test_a_page_is_readable_on_paper(watched: WatchedPage, path: str) -> None:
    whole, there, gone = PRINTED[path]
    page = watched.open(path)
    page.wait_for_selector(whole)
    pages = PdfReader(io.BytesIO(page.pdf(format="A4", prefer_css_page_size=True, print_background=True))).pages
    text = " ".join(unicodedata.normalize("NFKC", " ".join(each.extract_text() for each in pages)).split())
    assert [words for words in there if words not in text] == []
    assert [words for words in gone if words in text] == []
    assert 1 <= len(pages) <= 6
    for each in pages:
        right_pt = max((x_pt for x_pt, _ in list_text_places(each)), default=0.0)
        assert right_pt < float(each.mediabox.width) - 20.0, "text runs off the paper"
    page.emulate_media(media="print")
    page.set_viewport_size({"width": 700, "height": 1000})
    assert page.evaluate("document.documentElement.scrollWidth") <= 700, find_overflow(page)
    page.emulate_media(media="null")
    page.set_viewport_size(WIDE)


def list_text_places(page: PageObject) -> list[tuple[float, float]]:
    """Where each piece of text on a page begins, points from its lower left corner."""
    places: list[tuple[float, float]] = []

    def collect(text: str, matrix: list[float], text_matrix: list[float], _font: object, _size: float) -> None:
        if text.strip():
            x, y = text_matrix[4], text_matrix[5]
            places.append((matrix[0] * x + matrix[2] * y + matrix[4], matrix[1] * x + matrix[3] * y + matrix[5]))

    page.extract_text(visitor_text=collect)
    return places
