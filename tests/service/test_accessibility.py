"""Every page by axe-core, without sideways scrolling, dark and light, and printed; and each of its texts is a key.

Texts are read with a catalogue that puts all of them into ⟦brackets⟧: what stands outside of them is data, or no key.
"""

import io
import json
import re
import unicodedata
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser
from pypdf import PageObject, PdfReader

from tests.reports.catalogues import collect_texts
from tests.service.accessibility import WIDTHS_PX, find_faults_at_widths, find_violations, open_all_details
from tests.service.fake_service import CONTROL, Made
from tests.service.test_pages import PAGES
from tests.service.watching import NARROW, WIDE, WatchedPage, count_colours, find_overflow

pytestmark = pytest.mark.slow
EACH_PAGE = [*PAGES.items(), ("/nowhere", "text=No such page")]
VISITS = [
    visit
    for place, page in enumerate(EACH_PAGE)
    for cut in [1 if place % 2 == 0 else 0]
    for visit in (
        pytest.param(*page, WIDTHS_PX[:cut], id=page[0]),
        pytest.param(*page, WIDTHS_PX[cut:], id=f"{page[0]} more", marks=pytest.mark.matrix),
    )
]
"""Axe looks at every other page in every run of CI; of the others all texts are read."""

COUNT_NAMELESS = """[...document.querySelectorAll('button, input, select, textarea')].filter((one) =>
  !one.labels?.length && !one.getAttribute('aria-label') && !one.textContent.trim()).length"""
PRINTED = {
    "/plan/old": ("text=Plans, best first", ["Plans, best first", "Strategy"], ["Send it out", "Choose File", "Save"]),
    "/plan": ("text=Earlier plans", ["Plan a field", "Working width, m"], ["Run the plan", "Choose File", "Overview"]),
    "/farm": ("[name='tractors.1.file']", ["Tractors", "Fuel per litre"], ["Save the farm", "Remove this tractor"]),
    "/library": ("li.shelf", ["Library", "north field"], ["Rename", "Choose File"]),
}
"""What a page has on paper, and what it has on the screen alone."""
WAIT_MS, LEAST_TEXTS = 150, 12
DATA = re.compile(
    r"[\W\d_]*|Headland|English|Deutsch|Español|Français|日本語|m, ha|ft, acres|office|ok|u|hl_…|AgOpenGPS|rain"
    r"|\S+\.(toml|csv|json|html|geojson|zip|svg|png|m3u8)|ISOXML .*|GeoJSON|Shapefile|KML|GPX|omega|switch-back"
    r"|(row-by-row|col-by-col|split-field|interleaved)(-optimised)?|.*<img src=x.*|(. )?[Nn]orth field(, till)?"
    r"|iwamizawa|hill|(Yanmar )?EG105|eg105|run-\d|example|farm|bale|Fendt 724|cultivator|drill|sprayer|tanker"
    r"|tractor-\d|[\d.:,\s]*(m|m²|ha|km/h|cm|s|EUR|l|kB|MB|%|(h\s\d+\s)?min)?"
    r"|Three tractors .*|The field is called .*|.* 9 cm across\.|[\d/.: ]+ · office · .*",
    re.DOTALL,
)
"""What may stand outside of brackets: figures, names (some of them nasty), and sentences that only the test has."""
INNERMOST = re.compile("⟦[^⟦⟧]*⟧")
READ_TEXTS = """() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
  while (walker.nextNode()) {
    const node = walker.currentNode, text = node.textContent.trim(), parent = node.parentElement;
    if (!text || parent.closest('script, style, noscript, pre, code, kbd, textarea, svg, iframe')) continue;
    if (parent.closest('option, details') || parent.offsetParent !== null) found.push(text);
  }
  for (const name of ['aria-label', 'title', 'alt', 'placeholder'])
    found.push(...[...document.querySelectorAll(`[${name}]`)].map((node) => node.getAttribute(name)).filter(Boolean));
  return [...new Set(found)];
}"""


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
@pytest.mark.parametrize(("path", "whole", "widths_px"), VISITS)
def test_a_page_fits_both_widths_is_dark_and_light_and_accessible(
    watched: WatchedPage, path: str, whole: str, widths_px: tuple[int, ...]
) -> None:
    page = watched.open(path)
    page.wait_for_selector(whole)
    back = []
    try:
        for size in (WIDE, NARROW):
            page.set_viewport_size(size)
            for scheme in ("light", "dark"):
                page.emulate_media(color_scheme=scheme)  # type: ignore[arg-type]
                assert page.evaluate("document.documentElement.scrollWidth") <= size["width"], find_overflow(page)
                assert find_overflow(page) == []
                back.append(page.evaluate("getComputedStyle(document.body).backgroundColor"))
        assert back[0] == back[2] != back[1] == back[3]
        if page.locator("canvas").count():
            page.wait_for_function("() => document.querySelector('canvas').width > 0")
            assert count_colours(page) > 3
        assert page.evaluate(COUNT_NAMELESS) == 0
        assert page.title() != "1" and page.evaluate("document.images.length") <= 1, "text of data is no markup"
        watched.well()
        if widths_px:
            open_all_details(page)
            assert find_violations(page) == [], "in the dark"
            page.emulate_media(color_scheme="light")
            assert find_faults_at_widths(page, widths_px=widths_px) == []
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


def is_known(text: str) -> bool:
    """Whether a text is in brackets but for what may stand outside of them."""
    while (rest := INNERMOST.sub("", text)) != text:
        text = rest
    return bool(DATA.fullmatch(text)) or all(DATA.fullmatch(part.strip()) for part in re.split("[,;:·]", text))


@pytest.fixture(scope="module")
def bracketed(pages: tuple[str, Made], browser: Browser) -> Iterator[WatchedPage]:
    """A page in German, whose catalogue is the one with brackets."""
    watched = WatchedPage(browser, pages[0], CONTROL)
    texts = (each for text in collect_texts() for each in ((text,) if isinstance(text, str) else text))
    content = json.dumps({text: f"⟦{text}⟧" for text in texts})
    watched.page.add_init_script("if (origin !== 'null') localStorage.setItem('headland-language', 'de')")
    watched.page.route(
        "**/static/languages/de.json", lambda route: route.fulfill(body=content, content_type="application/json")
    )
    yield watched
    watched.page.context.close()


@pytest.mark.parametrize(
    "path", [pytest.param(path, marks=() if place % 2 else pytest.mark.matrix) for place, path in enumerate(PAGES)]
)
def test_every_text_of_a_page_is_a_key(bracketed: WatchedPage, path: str) -> None:
    bracketed.page.goto("about:blank")
    page = bracketed.open(path)
    page.wait_for_load_state("networkidle")
    page.wait_for_timeout(WAIT_MS)
    texts = page.evaluate(READ_TEXTS)
    assert sum("⟦" in text for text in texts) > LEAST_TEXTS
    assert "\n".join(text for text in texts if not is_known(text)) == ""


def test_every_sentence_of_a_new_plan_is_translated_by_itself(bracketed: WatchedPage) -> None:
    bracketed.page.goto("about:blank")
    page = bracketed.open("/fleet/f1")
    page.click("text=Go on from here")
    note = page.locator(".note:has-text('Send to the tractors')")
    assert "⟦Tractor 3 is left out.⟧ ⟦0.28 of 0.42 ha are left to work.⟧" in note.inner_text()


def test_a_list_in_a_sentence_has_its_word_in_the_language_of_the_page(bracketed: WatchedPage) -> None:
    page = bracketed.open("/plan")
    sentence = "The tractor is weak: check it, or try 5 km/h, 2.5 m or 3 m."
    told = page.evaluate(f"(async () => (await import('./static/js/language.js')).translate('{sentence}'))()")
    assert "⟦5 km/h, 2.5 m or 3 m⟧" in told
