"""The pages in a real browser, with a made-up service behind them: every page, both widths, dark and light, by keys."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from planner.service.settings import ServiceSettings
from tests.service.fake_service import CONTROL, NASTY, Made
from tests.service.one_process import create_app
from tests.service.test_files import HERE_M, shapefile
from tests.service.watching import (
    NARROW,
    WIDE,
    WatchedPage,
    count_colours,
    evaluate_in_page,
    find_overflow,
    needs_browser,
    watch_app,
)

pytestmark = [needs_browser, pytest.mark.slow]
PAGES = {
    "/": "text=waits for tractor 1",
    "/fleet/f1": "text=To the deadline",
    "/fleet/f1/tractor/2": "text=larger than noise",
    "/plan": "text=Earlier plans",
    "/plan/old": "text=Plans, best first",
    "/day": "text=Earlier days",
    "/day/old": "iframe",
    "/diagnose": "text=Earlier diagnoses",
    "/diagnose/old": "iframe",
    "/replay/f1": ".player",
    "/library": "li.shelf",
    "/library/plans": "li.shelf",
    "/farm": "[name='tractors.1.file']",
    "/access": "text=office: operate, plan, read",
}
"""What each page has when it is whole."""
EMPTY = {
    "/": "text=No fleet yet",
    "/diagnose": "text=Try it with a sample log",
    "/replay": "text=Nothing was recorded yet",
}
"""The same of a service that is new."""


@pytest.mark.slow
@pytest.mark.parametrize(("path", "whole"), PAGES.items())
def test_a_page_fits_both_widths_and_is_dark_and_light(watched: WatchedPage, path: str, whole: str) -> None:
    page = watched.open(path)
    page.wait_for_selector(whole)
    back = []
    for size in (WIDE, NARROW):
        page.set_viewport_size(size)
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            assert page.evaluate("document.documentElement.scrollWidth") <= size["width"], find_overflow(page)
            assert find_overflow(page) == []
            back.append(page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert back[0] == back[2] != back[1] == back[3]
    if page.locator("canvas").count():
        page.wait_for_function("() => document.querySelector('canvas').width > 0")
        assert count_colours(page) > 3
    assert (
        page.evaluate(
            "[...document.querySelectorAll('button, input, select, textarea')].filter((one) =>"
            " !one.labels?.length && !one.getAttribute('aria-label') && !one.textContent.trim()).length"
        )
        == 0
    )
    assert page.title() != "1" and page.evaluate("document.images.length") <= 1, "text of data is no markup"
    page.set_viewport_size(WIDE)
    page.emulate_media(color_scheme="light")
    watched.well()


def test_every_tab_is_reached_by_keys_with_a_visible_focus(watched: WatchedPage) -> None:
    page = watched.open("/access")
    page.reload()
    page.wait_for_selector("main h1")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    seen = set()
    for _ in range(12):
        page.keyboard.press("Tab")
        seen.add(page.evaluate("document.activeElement.dataset.tab ?? document.activeElement.id"))
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert {"overview", "plan", "day", "diagnose", "replay", "library", "access", "theme"} <= seen
    page.focus("[data-tab=plan]")
    page.keyboard.press("Enter")
    page.wait_for_function(
        "() => document.activeElement.tagName === 'H1' && document.activeElement.textContent.includes('Plan')"
    )
    page.focus("#theme")
    page.keyboard.press("Enter")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    page.keyboard.press("Enter")
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(20, 22, 15)"
    page.keyboard.press("Enter")


def test_without_a_token_nothing_can_be_sent(pages: tuple[str, Made], browser: Browser) -> None:
    looking = WatchedPage(browser, pages[0])
    page = looking.open("/fleet/f1")
    page.wait_for_selector("text=waits for tractor 1")
    assert page.locator("button.stop").is_disabled() and page.locator("text=Pause all").is_disabled()
    page.goto(f"{pages[0]}#/access")
    page.fill("input[name=token]", CONTROL)
    page.click("text=Use it in this tab")
    page.wait_for_selector("text=The service accepts this token")
    assert page.evaluate("[sessionStorage.getItem('headland-token'), localStorage.length]") == [CONTROL, 0]
    page.click("text=Forget it")
    assert page.evaluate("sessionStorage.getItem('headland-token')") is None
    looking.well()
    page.context.close()


def test_a_plan_is_asked_for_in_the_words_of_the_service(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/plan"), pages[1]
    page.select_option("select[name=fields]", NASTY)
    page.fill("input[name=width]", "-1")
    page.fill("input[name=deadline]", "17:00")
    page.click("text=Run the plan")
    page.wait_for_selector("text=width is -1; use metres above 0.")
    page.wait_for_function("() => document.activeElement.name === 'width'")
    page.fill("input[name=width]", "3.5")
    made.requests.clear()
    made.polls = 0
    page.click("text=Run the plan")
    page.wait_for_selector("text=Simulating plans")
    asked = {
        "field": NASTY,
        "width": 3.5,
        "deadline": "17:00",
        "tractors": "1-3",
        "strategies": "split-field,interleaved",
        "tractor": "eg105",
    }
    assert made.requests == [("plans", asked)]
    page.wait_for_selector("text=Plans, best first")
    watched.said.clear()  # the refusal above is a failed request, which a browser tells of


def test_any_plan_of_the_table_is_played(watched: WatchedPage) -> None:
    page = watched.open("/plan/old")
    page.wait_for_selector("text=Plans, best first")
    assert page.locator(".under .who").count() == 3
    page.click("[aria-label='Show plan 2 on the map']")
    assert page.locator(".under .who").count() == 2
    page.evaluate("""() => { const slider = document.querySelector(".player input"); slider.value = 100;
      slider.dispatchEvent(new Event("input")); }""")
    assert page.locator(".player output").inner_text() == "0:01:40" and "track 2" in page.locator(".under").inner_text()
    page.click("th button:has-text('Cost')")
    assert page.locator("th[aria-sort=ascending]").inner_text().startswith("Cost")
    assert [row.split("\t")[1].strip() for row in page.locator("tbody tr").all_inner_texts()[:3]] == ["2", "3", "3"]
    page.click("summary:has-text('Full report')")
    page.frame_locator("iframe").locator("text=the report runs").wait_for()
    watched.well()


def test_a_job_is_cancelled_and_a_failure_is_shown(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    pages[1].polls = 0
    page = watched.open("/plan/made")
    page.click("text=Cancel")
    page.wait_for_selector("text=It was cancelled.")
    pages[1].polls = 0
    watched.open("/access")
    watched.open("/plan/bad")
    page.wait_for_selector("text=use a narrower implement")


def draw_field(page: Page) -> None:
    """Draw a field of 100 m x 50 m by the coordinates of its corners."""
    page.click("summary:has-text('Draw a field')")
    for east, north in ((0, 0), (100, 0), (100, 50), (0, 50)):
        page.fill("[aria-label='Metres east']", str(east))
        page.fill("[aria-label='Metres north']", str(north))
        page.click("text=Add corner")


def test_a_field_is_drawn_by_keys_and_uploaded(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/plan"), pages[1]
    made.requests.clear()
    draw_field(page)
    page.wait_for_selector("text=4 corners, 0.50\xa0ha")
    page.click("text=Use this field")
    page.wait_for_function("() => document.querySelector('select[name=fields]').value === 'myfield'")
    kind, text = made.requests[0]
    ring = json.loads(text)["features"][0]["geometry"]["coordinates"][0]
    assert kind == "fields" and ring == [[0, 0], [100, 0], [100, 50], [0, 50], [0, 0]]
    assert page.is_checked("input[name=local]"), "a drawing without a place is in metres"
    watched.well()


def test_a_log_without_a_needed_column_is_refused_in_a_sentence(watched: WatchedPage, tmp_path: Path) -> None:
    log = tmp_path / "bad.csv"
    log.write_text("time_s,easting_m\n0,1\n", encoding="utf-8")
    page = watched.open("/replay")
    page.set_input_files("input[type=file]", log)
    page.wait_for_selector("text=bad.csv has no column northing_m")
    watched.well()


def test_modules_by_their_closed_forms(watched: WatchedPage) -> None:
    page = watched.open("/access")
    shares = "[9.96, 99.96, 99.75, 100].map(m.percent)"
    assert evaluate_in_page(page, f"[m.clock(3723), m.span(45), ...{shares}, m.number(null)]") == [
        "1:02:03",
        "45\xa0s",
        "10.0\xa0%",
        "99.9\xa0%",
        "99.8\xa0%",
        "100\xa0%",
        "\u2013",
    ]
    assert evaluate_in_page(page, "m.area([[0, 0], [4, 0], [4, 3]])") == 6
    lane = "{ time_s: [0, 10, 20], points_m: [[0, 0], [10, 0], [10, -5]], status: [1, 4] }"
    there = evaluate_in_page(page, f"[m.poseAt({lane}, 5), m.poseAt({lane}, 15)]")
    assert [there[0]["x"], there[0]["heading"]] == [5, 90]
    assert there[1]["y"] == -2.5 and there[1]["heading"] % 360 == 0, "backwards to the south it looks north"
    seen = evaluate_in_page(
        page,
        """(() => { const one = new m.Camera("c"); one.aim({ x: 0, y: 0, heading: 90 }, 600, 400);
      return [one.pixel(one.see(20, 0, 0)), one.pixel(one.see(20, -3, 0)), one.pixel(one.see(40, 0, 0))]; })()""",
    )
    assert seen[0][0] == pytest.approx(300) and seen[1][0] > 300 and seen[2][1] < seen[0][1], "ahead, right, farther"


@pytest.mark.slow
def test_the_pages_speak_with_the_service_itself(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # No fleet drives here: nothing to compile for.
    monkeypatch.setattr("planner.service.fleets.fleet_sessions.warm_up", lambda: None)
    app = create_app(ServiceSettings(data=tmp_path, workers=0), reads_inline=True)
    with watch_app(browser, app, "operator planner") as watched:
        for path, whole in EMPTY.items():
            watched.open(path).wait_for_selector(whole)
        page = watched.open("/plan")
        page.wait_for_selector("text=1.89\xa0ha")
        draw_field(page)
        page.click("text=Use this field")
        page.wait_for_selector(".under >> text=0.50\xa0ha")
        watched.well()
        page.fill("input[name=width]", "-1")
        page.click("text=Run the plan")
        page.wait_for_selector("text=use 0.5 to 100")
        page.fill("input[name=width]", "3")
        page.click("text=Run the plan")
        page.wait_for_selector("text=Waiting for its turn.")
        asked = app.state.store.list_jobs("plan")[0].request
        assert asked["field"] == "myfield" and asked["local"] is True and asked["width"] == 3
        page.click("text=Cancel")
        page.wait_for_selector("text=It was cancelled.")
        _add_files(watched, tmp_path)


def _add_files(watched: WatchedPage, folder: Path) -> None:
    """A Shapefile without its .prj is added once its coordinate system is said; one of several fields is chosen."""
    (folder / "north.zip").write_bytes(shapefile(HERE_M))
    ring = [[lon / 1e3, 51 + lat / 1e3] for lon, lat in ((0, 0), (2, 0), (2, 1), (0, 1), (0, 0))]
    parcels = [
        {"type": "Feature", "properties": {"id": name}, "geometry": {"type": "Polygon", "coordinates": [shape]}}
        for name, shape in (("a", ring), ("b", [[lon + 0.01, lat] for lon, lat in ring]))
    ]
    (folder / "two.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": parcels}))
    page = watched.open("/plan")
    page.set_input_files("input[aria-label='Add a file: Field']", folder / "north.zip")
    page.wait_for_selector("text=does not name its coordinate system")
    page.fill("input[name=upload-crs]", "EPSG:25832")
    page.click("text=Add with these settings")
    page.wait_for_selector(".under >> text=0.36\xa0ha")
    page.set_input_files("input[aria-label='Add a file: Field']", folder / "two.geojson")
    page.wait_for_selector("text=The file holds 2 fields; choose one of them.")
    page.select_option("select[name=parcel]", "b")
    page.wait_for_selector(".under >> text=1.56\xa0ha")
    page.click("text=Run the plan")
    page.wait_for_selector("h1:has-text('two b')")


@pytest.mark.slow
def test_a_plan_is_saved_for_a_terminal(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/plan/old"), pages[1]
    page.click("summary:has-text('Guidance for terminals')")
    page.select_option("select[name=form]", "agopengps")
    page.select_option("select[name=of]", "2")
    made.requests.clear()
    with page.expect_download() as saved:
        page.click("text=Save for the terminal")
    assert saved.value.suggested_filename.endswith("-tractor-2-plan-agopengps.zip")
    assert made.requests == [("plans/old/results/plan.json/export", {"to": "agopengps", "tractor": 2})]
    watched.well()
