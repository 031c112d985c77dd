"""The pages with a catalogue that puts every text into ⟦brackets⟧: what stands outside of them is data, or no key."""

import json
import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Browser

from tests.reports.catalogues import collect_texts
from tests.service.fake_service import CONTROL, Made
from tests.service.test_pages import PAGES
from tests.service.watching import WatchedPage, needs_browser

pytestmark = [needs_browser, pytest.mark.slow]

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
