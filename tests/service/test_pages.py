"""The pages in a real browser, with a made-up service behind them: every page, both widths, dark and light, by keys."""

import json
import re
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from planner.service.settings import ServiceSettings
from tests.drawn_fields import feature, rectangle, write_features
from tests.service.fake_service import CONTROL, NASTY, Made
from tests.service.one_process import create_app
from tests.service.test_files import HERE_M, shapefile
from tests.service.watching import (
    WatchedPage,
    evaluate_in_page,
    watch_app,
)

pytestmark = pytest.mark.slow
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
COST = "18"  # 3 tractors x 470 s / 80, as it is stated: the expected cost, in whole units from 10 on
EMPTY = {
    "/": "text=No fleet yet",
    "/diagnose": "text=Try it with a sample log",
    "/replay": "text=Nothing was recorded yet",
}
"""The same of a service that is new."""
LONGEST_SILENCE = """() => new Promise((done) => {
  const clock = () => performance.now(), shown = (one) => one.offsetParent && one.textContent.trim();
  let first = null, silent = clock(), silence = 0;
  const begin = silent, words = new Set();
  const look = () => {
    const places = "main .panel [role=status]:not(.lead), main .page > .soft:only-child";
    const said = [...document.querySelectorAll(places)].filter(shown).map((one) => one.textContent);
    if (said.length) { first ??= clock() - begin; silent = null; said.forEach((text) => words.add(text)); }
    else silence = Math.max(silence, clock() - (silent ??= clock()));
    if (document.querySelector("[aria-label='Ranked plans']")) return done({ first, silence, words: [...words] });
    requestAnimationFrame(look);
  };
  document.querySelector("form button.main").click();
  look();
})"""
"""Milliseconds from the click to the first text of progress, the longest without any, and the texts."""


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


def test_a_plan_is_asked_for_in_the_words_of_the_service_and_no_second_of_its_progress_is_silent(
    watched: WatchedPage, pages: tuple[str, Made]
) -> None:
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
    seen = page.evaluate(LONGEST_SILENCE)
    asked = {"field": NASTY, "width": 3.5, "deadline": "17:00", "tractors": "1-3", "tractor": "eg105"}
    plans = [request for request in made.requests if request[0] == "plans"]
    assert plans == [("plans", asked | {"strategies": "split-field,interleaved"})]
    assert seen["first"] < 1000 and seen["silence"] < 1000, seen
    shares = [each for each in seen["words"] if re.fullmatch(r"Simulating plans: [12] of 3, (33|67)\xa0%", each)]
    assert "Checking what was asked" in seen["words"] and shares, seen
    page.wait_for_selector("text=Plans, best first")
    watched.said.clear()  # the refusal above is a failed request, which a browser tells of


def test_a_job_is_cancelled_and_a_failure_is_shown(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    watched.open("/access")
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
    (drawing,) = (sent for kind, sent in made.requests if kind == "fields")  # the page also asks for estimates
    ring = json.loads(drawing)["features"][0]["geometry"]["coordinates"][0]
    assert ring == [[0, 0], [100, 0], [100, 50], [0, 50], [0, 0]]
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
    words = ["1:02:03", "45\xa0s", "10.0\xa0%", "99.9\xa0%", "99.8\xa0%", "100\xa0%", "\u2013"]
    assert evaluate_in_page(page, f"[m.clock(3723), m.span(45), ...{shares}, m.number(null)]") == words
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
    parcels = [feature(rectangle(lon, 51, 0.002, 0.001), id=name) for name, lon in (("a", 0), ("b", 0.01))]
    write_features(folder / "two.geojson", *parcels)
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


def test_the_plan_to_take_is_first_and_any_is_played_and_saved_for_a_terminal(
    watched: WatchedPage, pages: tuple[str, Made]
) -> None:
    watched.open("/plan").wait_for_selector("form section:first-child p:text-is('Yanmar EG105')")
    assert watched.page.locator("form h2").first.inner_text() == "Tractor"
    page, made = watched.open("/plan/old"), pages[1]
    page.wait_for_selector("text=Plans, best first")
    assert page.locator("h1").inner_text().startswith("Yanmar EG105: "), "the tractor is named first in both"
    table = page.locator("[aria-label='Ranked plans']")
    heads = [head for head in table.locator("th").all_inner_texts() if head]
    assert len([each for each in table.locator("th").all() if each.is_visible()]) <= 8
    first = dict(zip(heads, table.locator("tbody tr").first.locator("td").all_inner_texts(), strict=False))
    assert (first["Tractors"], first["Strategy"], first["Cost"], first["In time %"]) == ("3", "split-field", COST, "93")
    assert "chosen" in (table.locator("tbody tr").first.get_attribute("class") or "")
    figures = page.locator("dl").first.inner_text()
    assert f"Cost\n{COST}" in figures and "In time\n93\xa0%" in figures
    for is_shown in (True, False):
        page.click("text=All columns")
        assert table.locator("th:has-text('Turning')").is_visible() == is_shown
        pressed = page.locator("button:has-text('All columns')").get_attribute("aria-pressed")
        assert pressed == str(is_shown).lower()
    assert page.locator("summary:has-text('not possible')").inner_text() == "1 plan not possible, with the reason"
    for reason in ("others are estimated to be faster.", "tractors may come nearer than 0.5"):
        assert page.locator(f"text=1 plan not simulated, as {reason}").is_visible(), "it was not tried"
    page.click("summary:has-text('Guidance for terminals')")
    page.select_option("select[name=form]", "agopengps")
    page.select_option("select[name=of]", "2")
    made.requests.clear()
    with page.expect_download() as saved:
        page.click("text=Save for the terminal")
    assert saved.value.suggested_filename.endswith("-tractor-2-plan-agopengps.zip")
    exported = [each for each in made.requests if each[0].endswith("/export")]
    assert exported == [("plans/old/results/plan.json/export", {"to": "agopengps", "tractor": 2})]
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


def test_a_second_tab_may_plan_until_the_token_is_forgotten(watched: WatchedPage) -> None:
    first = watched.open("/plan")
    second = first.context.new_page()
    second.goto(f"{watched.base}#/plan")
    second.wait_for_selector("text=Run the plan")
    assert second.evaluate("sessionStorage.getItem('headland-token')") == CONTROL
    assert second.locator("text=You can look at everything here").count() == 0
    second.goto(f"{watched.base}#/access")
    second.click("text=Forget it")
    first.wait_for_function("() => sessionStorage.getItem('headland-token') === null")
    second.close()
