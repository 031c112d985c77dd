"""The answer on the page of a plan, which follows its controls; the address that holds them."""

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
from playwright.sync_api import Browser, Error, JSHandle, Page, Route

from tests.service.accessibility import find_faults_at_widths
from tests.service.fake_service import CONTROL, Made
from tests.service.watching import NARROW, WIDE, WatchedPage, until

pytestmark = pytest.mark.slow
AT_ONCE, LAID_OUT = "**/api/v1/estimates?at_once=true", "**/api/v1/estimates"


@pytest.fixture
def page(watched: WatchedPage, pages: tuple[str, Made]) -> Iterator[Page]:
    """The form with its first answer, for one tractor."""
    pages[1].requests.clear()
    pages[1].polls = 0
    watched.open("/access")
    page = watched.open("/plan?width=3&tractors=1&strategies=all&field=iwamizawa&tractor=eg105")
    wait_for_done(page, "1:00:00")
    yield page
    page.unroute_all()
    page.set_viewport_size(WIDE)
    watched.open("/access")


def slider(page: Page, name: str) -> Any:
    return page.locator(f".knob:has(input[name={name}]) input[type=range]")


def read_done(page: Page) -> str:
    return page.locator(".answer .facts dd").nth(1).inner_text()


def watch_done(page: Page) -> JSHandle:
    """The list of all times that are shown from now on."""
    return page.evaluate_handle("""() => { const seen = [], done = document.querySelectorAll(".answer .facts dd")[1];
      new MutationObserver(() => seen.push(done.textContent)).observe(done, { childList: true, subtree: true,
        characterData: true }); return seen; }""")


def wait_for_done(page: Page, done: str) -> None:
    until(page, lambda: page.locator(".answer[aria-busy=false]").count() == 1 and read_done(page) == done)


def test_the_answer_follows_texts_sliders_and_keys(page: Page, watched: WatchedPage) -> None:
    assert page.locator(".answer .badge").inner_text() == "estimated"
    page.fill("input[name=width]", "6")
    wait_for_done(page, "0:30:00")
    assert slider(page, "width").input_value() == "6"
    slider(page, "width").focus()
    for _ in range(10):
        page.keyboard.press("ArrowLeft")
    wait_for_done(page, "0:36:00")
    assert page.input_value("input[name=width]") == "5"
    box = slider(page, "tractors").bounding_box()
    page.mouse.click(box["x"] + box["width"] - 2, box["y"] + box["height"] / 2)
    assert page.input_value("input[name=tractors]") == "1-8"
    wait_for_done(page, "0:04:30")
    assert page.locator(".answer tbody tr:visible").count() == 8
    assert page.locator(".answer tr.chosen td").first.inner_text() == "8"
    watched.well()


def test_the_form_with_an_answer_is_accessible_and_the_ring_of_a_slider_covers_no_text(page: Page) -> None:
    page.focus("input[name=width]")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.type") == "range"
    gaps = page.evaluate("""() => { const range = document.activeElement, look = getComputedStyle(range);
      const ring = parseFloat(look.outlineOffset) + parseFloat(look.outlineWidth), own = range.getBoundingClientRect();
      const [text, hint] = ["input:not([type=range])", ".hint"].map((one) =>
        range.closest(".knob").querySelector(one).getBoundingClientRect());
      return [own.top - ring - text.bottom, hint.top - own.bottom - ring, parseFloat(look.outlineWidth)]; }""")
    assert min(gaps[:2]) >= 0.0 and gaps[2] >= 2.0, "and it is seen"
    assert find_faults_at_widths(page, widths_px=(390, 1280)) == []


def test_all_controls_have_sliders_that_say_what_the_text_says(page: Page) -> None:
    texts = {"speed_kmh": "7.5", "start": "06:45", "deadline": "17:15", "price_per_hour": "55"}
    for name, text in texts.items():
        assert slider(page, name).get_attribute("aria-valuetext") == "not given"
        page.fill(f"input[name={name}]", text)
        assert slider(page, name).get_attribute("aria-valuetext") == text
        slider(page, name).press("ArrowRight")
        slider(page, name).press("ArrowLeft")
        assert page.input_value(f"input[name={name}]") == text
    wait_for_done(page, "07:25")
    assert page.locator(".answer tbody td").nth(4).inner_text() == "yes"


def test_an_older_answer_never_replaces_a_newer_one(page: Page) -> None:
    held = list[Route]()
    page.route(LAID_OUT, lambda route: held.append(route))
    page.fill("input[name=width]", "4")
    wait_for_done(page, "0:45:00")
    until(page, lambda: len(held) == 1)
    page.fill("input[name=width]", "6")
    wait_for_done(page, "0:30:00")
    seen = watch_done(page)
    held[0].continue_()
    until(page, lambda: len(held) == 2)
    held[1].continue_()
    page.wait_for_timeout(300)
    assert seen.json_value() == [] and read_done(page) == "0:30:00"


def test_figures_of_another_field_are_gone_at_once_and_do_not_come_back(page: Page) -> None:
    held = list[Route]()
    page.route(AT_ONCE, lambda route: held.append(route))
    page.fill("input[name=width]", "4")
    until(page, lambda: len(held) == 1)
    page.locator("select:has(option[value='north field'])").first.select_option("north field")
    until(page, lambda: read_done(page) == "\u2013")
    seen = watch_done(page)
    held[0].continue_()
    until(page, lambda: len(held) == 2)
    held[1].continue_()
    wait_for_done(page, "0:45:00")
    assert set(seen.json_value()) == {"0:45:00"}


def test_an_older_answer_does_not_stop_the_drive_of_a_newer_one(page: Page) -> None:
    held = list[Route]()

    def lay_out(route: Route) -> None:
        answer = route.fetch()
        route.fulfill(response=answer, json=answer.json() | {"is_scaled": False})

    page.route(LAID_OUT, lambda route: held.append(route))
    page.fill("input[name=width]", "4")
    until(page, lambda: len(held) == 1)
    page.route(AT_ONCE, lay_out)
    page.fill("input[name=width]", "6")
    wait_for_done(page, "0:30:00")
    held[0].continue_()
    page.wait_for_selector(".answer >> text=Show the plan")


def test_changes_while_an_answer_is_due_are_asked_for_once(page: Page, pages: tuple[str, Made]) -> None:
    held, made = list[Route](), pages[1]
    page.route(AT_ONCE, lambda route: held.append(route))
    made.estimates.clear()
    for width in ("4", "5", "6"):
        page.fill("input[name=width]", width)
    until(page, lambda: len(held) == 1)
    held[0].continue_()
    until(page, lambda: len(held) == 2)
    assert page.locator(".answer").get_attribute("aria-busy") == "true" and read_done(page) == "0:45:00"
    held[1].continue_()
    wait_for_done(page, "0:30:00")
    assert [each["width"] for each in made.estimates[:2]] == [4, 6]


def test_a_drive_replaces_the_estimate_until_a_value_changes_and_is_shown_and_kept(
    page: Page, pages: tuple[str, Made]
) -> None:
    made = pages[1]
    page.fill("input[name=width]", "6")
    page.wait_for_selector(".answer >> text=Show the plan")
    assert not page.locator(".answer .badge").is_visible() and read_done(page) != "0:30:00"
    kind, body = made.requests[-1]  # a slow page may have asked for the default width before
    assert kind == "plans" and body["width"] == 6
    page.fill("input[name=width]", "5")
    wait_for_done(page, "0:36:00")
    assert page.locator(".answer .badge").is_visible() and not page.locator(".answer .line a").is_visible()
    until(page, lambda: ("plans/made/delete", None) in made.requests)
    page.wait_for_selector(".answer >> text=Show the plan")
    made.requests.clear()
    page.click("text=Run the plan")
    page.wait_for_selector("text=Plans, best first")
    assert page.url.endswith("#/plan/made") and made.requests == [], "it is driven already"


def test_progress_of_a_drive_that_begins_anew_does_not_go_back(page: Page) -> None:
    counts = iter([(2, 3), (0, 3), (1, 3), (5, 6)])

    def tell(route: Route) -> None:
        done, all = next(counts, (None, None))
        if done is None:
            route.continue_()
        else:
            route.fulfill(json={"status": "running", "progress": {"done": done, "all": all}})

    page.route("**/api/v1/plans/made", tell)
    told = page.evaluate_handle("""() => { const told = [], state = document.querySelector(".answer .state");
      new MutationObserver(() => told.push(state.textContent)).observe(state, { childList: true, subtree: true,
        characterData: true }); return told; }""")
    page.fill("input[name=width]", "6")
    page.wait_for_selector(".answer >> text=Show the plan")
    words = [each for each in told.json_value() if each.startswith("Driving it in full: ")]
    assert words[:2] == ["Driving it in full: 2 of 3", "Driving it in full: 5 of 6"]


def test_a_drive_is_followed_on_when_the_service_does_not_answer_for_a_while(page: Page, watched: WatchedPage) -> None:
    page.route("**/api/v1/plans/made", lambda route: route.abort())
    page.fill("input[name=width]", "6")
    page.wait_for_selector(".answer >> text=check that it is still running. It is asked again.")
    page.unroute("**/api/v1/plans/made")
    page.wait_for_selector(".answer >> text=Show the plan")
    watched.said.clear()  # a browser tells of a request that failed


def test_a_drive_whose_tab_was_killed_is_dropped_by_the_next(
    browser: Browser, watched: WatchedPage, pages: tuple[str, Made]
) -> None:
    made, context = pages[1], browser.new_context()
    context.add_init_script(f'sessionStorage.setItem("headland-token", "{CONTROL}")')
    address = f"{watched.base}#/plan?width=3&tractors=1&field=iwamizawa&tractor=eg105"
    killed = context.new_page()
    killed.goto(address)
    killed.wait_for_selector(".answer >> text=Show the plan")
    with suppress(Error):
        killed.goto("chrome://crash")
    made.requests.clear()
    after = context.new_page()
    after.goto(address)
    until(after, lambda: ("plans/made/delete", None) in made.requests)
    context.close()


def test_a_link_shows_the_same_in_another_browser(page: Page, browser: Browser, watched: WatchedPage) -> None:
    page.fill("input[name=width]", "4")
    page.fill("input[name=deadline]", "17:00")
    page.click("summary:has-text('More options')")
    page.fill("input[name=obstacle]", "1,2; 3,4,5")
    page.select_option("select[name=operation]", "sow")
    page.check("input[name=open_edges]")
    until(page, lambda: "open_edges=true" in page.url)
    other = WatchedPage(browser, watched.base, CONTROL)
    shown = other.page
    shown.goto(page.url)
    wait_for_done(shown, "0:45:00")
    state = "[...document.querySelectorAll('form [name]')].map((one) => [one.name, one.value, one.checked])"
    assert shown.evaluate(state) == page.evaluate(state)
    assert shown.input_value("input[name=obstacle]") == "1,2; 3,4,5"
    figures = ".answer .facts"
    assert shown.locator(figures).inner_text() == page.locator(figures).inner_text()
    other.well()
    shown.context.close()


def test_an_earlier_plan_is_changed_by_its_link_and_one_to_a_field_that_is_gone_says_so(watched: WatchedPage) -> None:
    page = watched.open("/plan?width=3&tractors=1&field=sold")
    page.wait_for_selector("text=Not in the library, and so not what is shown: sold.")
    watched.open("/plan/old")
    page.click("text=Change and plan again")
    page.wait_for_selector("text=Run the plan")
    assert page.input_value("select[name=fields]") == "north field" and "width=3" in page.url
    watched.well()


def test_the_box_keeps_its_size_on_a_phone_whatever_it_says(page: Page, watched: WatchedPage) -> None:
    assert page.locator(".answer .rows").is_visible()
    page.set_viewport_size(NARROW)
    until(page, lambda: not page.locator(".answer .rows").is_visible())
    heights = list[float]()

    def note_height() -> None:
        heights.append(page.evaluate("document.querySelector('.answer .now').getBoundingClientRect().height"))

    note_height()
    page.fill("input[name=width]", "-1")
    page.wait_for_selector(".answer >> text=width is -1; use metres above 0.")
    assert read_done(page) == "\u2013" and page.locator("[role=dialog]").count() == 0
    note_height()
    page.fill("input[name=start]", "08:00")
    page.fill("input[name=width]", "6")
    wait_for_done(page, "08:30")
    note_height()
    page.wait_for_selector(".answer >> text=Show the plan")
    note_height()
    assert len(set(heights)) == 1, heights
    assert page.evaluate("document.documentElement.scrollWidth") <= NARROW["width"]
    page.set_viewport_size(WIDE)
    until(page, lambda: page.locator(".answer .rows").is_visible())
    watched.said.clear()  # a browser tells of a refused request


def test_a_finger_moves_a_slider(browser: Browser, watched: WatchedPage) -> None:
    context = browser.new_context(viewport=NARROW, has_touch=True)
    page = context.new_page()
    page.add_init_script(f'sessionStorage.setItem("headland-token", "{CONTROL}")')
    page.goto(f"{watched.base}#/plan?width=3&tractors=1&field=iwamizawa&tractor=eg105")
    wait_for_done(page, "1:00:00")
    slider(page, "width").scroll_into_view_if_needed()
    box = slider(page, "width").bounding_box()
    page.touchscreen.tap(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    assert 6.0 <= float(page.input_value("input[name=width]")) <= 7.0
    until(page, lambda: read_done(page) < "0:31:00")
    context.close()
