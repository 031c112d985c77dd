"""What axe-core finds wrong with a page for people who use a keyboard, a screen reader or a magnifier."""

from importlib import resources
from typing import Any

from playwright.sync_api import Frame, Page

RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
"""The rules of axe-core by their tags."""
WIDTHS_PX = (390, 768, 1280)


def find_violations(page: Page | Frame) -> list[str]:
    """One line for each element that breaks a rule: the rule, what to do, the element; frames are checked alone."""
    page.evaluate((resources.files("axe_playwright_python") / "axe.min.js").read_text(encoding="utf-8"))
    found: Any = page.evaluate(
        "(tags) => axe.run(document, { iframes: false, resultTypes: ['violations'],"
        " runOnly: { type: 'tag', values: tags } })",
        RULES,
    )
    return [
        f"{rule['id']}: {rule['help']}: {node['html'][:160]} ({'; '.join(each['message'] for each in node['any'][:1])})"
        for rule in found["violations"]
        for node in rule["nodes"]
    ]


def open_all_details(page: Page) -> None:
    """Unfold everything that is folded away, so that it is checked too."""
    page.evaluate("document.querySelectorAll('details').forEach((each) => { each.open = true; })")
    page.wait_for_timeout(200)


def find_faults_at_widths(page: Page, *, widths_px: tuple[int, ...] = WIDTHS_PX) -> list[str]:
    """Violations and sideways scrolling of a page at each width."""
    faults = []
    for width_px in widths_px:
        page.set_viewport_size({"width": width_px, "height": 860})
        page.wait_for_function("(wide) => innerWidth === wide", arg=width_px)
        # As tall as the page, so that the bars, which stay in place, cover nothing.
        page.set_viewport_size({"width": width_px, "height": page.evaluate("document.documentElement.scrollHeight")})
        page.wait_for_timeout(50)
        needed_px = page.evaluate("document.documentElement.scrollWidth")
        if needed_px > width_px:
            faults.append(f"at {width_px} px the page is {needed_px} px wide")
        faults += [f"at {width_px} px: {each}" for each in find_violations(page)]
    return faults
