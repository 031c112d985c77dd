"""The pages in a real browser, with a made-up service behind them: every page, both widths, dark and light, by keys."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

from planner.service.api import create_app
from planner.service.settings import Settings
from tests.service.fake_service import CONTROL, NASTY, Made, fake_app
from tests.service.test_files import HERE_M, shapefile
from tests.service.watching import NARROW, WIDE, Watched, painted, served, until, wide_by

NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next((path for name in NAMES if (path := shutil.which(name))), None)
pytestmark = pytest.mark.skipif(
    BROWSER is None and not os.environ.get("HEADLAND_TEST_BROWSER"), reason="no browser is installed"
)
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
    "/access": "text=needed to control",
}
"""What each page has when it is whole."""
EMPTY = {
    "/": "text=No fleet is out yet",
    "/diagnose": "text=No logs yet",
    "/replay": "text=Nothing was recorded yet",
}
"""The same of a service that is new."""


@pytest.fixture(scope="module")
def service() -> Iterator[tuple[str, Made]]:
    app = fake_app()
    with served(app) as base:
        yield base, app.state.made


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as play:
        found = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox", "--disable-gpu"])
        yield found
        found.close()


@pytest.fixture(scope="module")
def watched(service: tuple[str, Made], browser: Browser) -> Watched:
    """A page with a token that may control; tests open what they need in it."""
    return Watched(browser, service[0], CONTROL)


@pytest.mark.parametrize(("path", "whole"), PAGES.items())
def test_a_page_fits_both_widths_and_is_dark_and_light(watched: Watched, path: str, whole: str) -> None:
    page = watched.open(path)
    page.wait_for_selector(whole)
    back = []
    for size in (WIDE, NARROW):
        page.set_viewport_size(size)
        for scheme in ("light", "dark"):
            page.emulate_media(color_scheme=scheme)
            assert page.evaluate("document.documentElement.scrollWidth") <= size["width"], wide_by(page)
            assert wide_by(page) == []
            back.append(page.evaluate("getComputedStyle(document.body).backgroundColor"))
    assert back[0] == back[2] != back[1] == back[3]
    if page.locator("canvas").count():
        page.wait_for_function("() => document.querySelector('canvas').width > 0")
        assert painted(page) > 3
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


def test_every_tab_is_reached_by_keys_with_a_visible_focus(watched: Watched) -> None:
    page = watched.open("/access")
    page.reload()
    page.wait_for_selector("main h1")
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.className") == "skip"
    seen = set()
    for _ in range(9):
        page.keyboard.press("Tab")
        seen.add(page.evaluate("document.activeElement.dataset.tab ?? document.activeElement.id"))
        assert page.evaluate("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    assert {"overview", "plan", "day", "diagnose", "replay", "access", "theme"} <= seen
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


def test_a_fleet_is_watched_and_ordered(watched: Watched, service: tuple[str, Made]) -> None:
    page, made = watched.open("/fleet/f1"), service[1]
    page.wait_for_selector("text=waits for tractor 1")
    tiles = page.locator(".tractor").all_inner_texts()
    assert len(tiles) == 3 and "connection broken" in tiles[2] and "fix 42" in tiles[2].replace("\xa0", " ")
    page.click("text=Acknowledge")
    page.wait_for_selector("text=seen by office")
    page.click("text=STOP ALL")
    page.click("summary:has-text('Failures, obstacles')")
    page.select_option("select[aria-label='Tractor that failed']", "3")
    page.click("text=Plan without it")
    page.click("button:text-is('Accept')")
    wanted = [
        {"kind": "acknowledge", "alarm": 1},
        {"kind": "stop_all"},
        {"kind": "fail", "tractor": 3},
        {"kind": "replan", "without": [3]},
        {"kind": "accept", "proposal": 7},
    ]
    until(page, lambda: len(made.frames) >= len(wanted))
    assert made.frames == wanted
    made.frames.clear()
    page.click("text=Mark an obstacle")
    box = page.locator(".map canvas").bounding_box()
    assert box is not None
    for x, y in ((0.5, 0.4), (0.6, 0.4), (0.55, 0.5)):
        page.locator(".map canvas").click(position={"x": box["width"] * x, "y": box["height"] * y})
    page.click("text=Block it")
    until(page, lambda: bool(made.frames))
    corners = made.frames.pop()["polygon_m"]
    assert len(corners) == 3 and all(499_990 < east < 500_140 for east, _ in corners), "metres of the grid"
    watched.well()


def test_hands_drive_only_while_the_dead_man_switch_is_held(watched: Watched, service: tuple[str, Made]) -> None:
    page, made = watched.open("/fleet/f1/tractor/1"), service[1]
    made.frames.clear()
    page.keyboard.press("Space")
    page.click("text=Take control")
    page.wait_for_selector("text=the yard drives this tractor")
    page.click("text=Take over")
    page.wait_for_selector("text=You drive this tractor")
    page.focus("[aria-label='Remote control']")
    page.keyboard.down("ArrowUp")
    page.keyboard.down("ArrowRight")
    page.wait_for_timeout(250)
    still = [frame for frame in made.frames if frame["kind"] == "command"]
    assert all(frame["speed_command_mps"] == 0 and frame["start"] == 0 for frame in still), "nobody holds the switch"
    page.keyboard.down("Space")
    page.wait_for_selector("text=Driving by keys")
    until(page, lambda: made.frames[-1].get("steering_command_deg", 0) >= 28)
    held = made.frames[-1]
    assert held["speed_command_mps"] == pytest.approx(0.4 * 1.4) and held["shuttle"] == 1 and held["start"] == 1
    assert held["steering_command_deg"] == pytest.approx(28.0), "to the right is positive, at full lock of the machine"
    page.evaluate("window.dispatchEvent(new Event('blur'))")
    page.wait_for_selector("text=Let go: it stands")
    until(page, lambda: made.frames[-1]["speed_command_mps"] == 0)
    page.locator(".pad").scroll_into_view_if_needed()
    pad = page.locator(".pad").bounding_box()
    assert pad is not None
    page.mouse.move(pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] * 0.9)
    page.mouse.down()
    page.wait_for_selector("text=Driving by touch")
    until(page, lambda: made.frames[-1]["shuttle"] == -1)
    page.mouse.up()
    page.wait_for_selector("text=Let go: it stands")
    watched.well()


def test_a_twin_in_doubt_is_diagnosed_and_mended(watched: Watched) -> None:
    page = watched.open("/fleet/f1/tractor/2")
    page.click("text=Find the cause")
    page.wait_for_selector("text=The diagnosis of its recording is ready.")
    assert page.get_attribute("text=Read the diagnosis", "href") == "#/diagnose/old"
    page.click("text=Take it into the tractor file")
    page.wait_for_selector("text=Saved as the tractor file eg105 mended")
    watched.well()


def test_without_a_token_nothing_can_be_sent(service: tuple[str, Made], browser: Browser) -> None:
    looking = Watched(browser, service[0])
    page = looking.open("/fleet/f1")
    page.wait_for_selector("text=waits for tractor 1")
    assert page.locator("button.stop").is_disabled() and page.locator("text=Pause all").is_disabled()
    page.goto(f"{service[0]}#/access")
    page.fill("input[name=token]", CONTROL)
    page.click("text=Use it in this tab")
    page.wait_for_selector("text=The service takes this token")
    assert page.evaluate("[sessionStorage.getItem('headland-token'), localStorage.length]") == [CONTROL, 0]
    page.click("text=Forget it")
    assert page.evaluate("sessionStorage.getItem('headland-token')") is None
    looking.well()
    page.context.close()


def test_a_plan_is_asked_for_in_the_words_of_the_service(watched: Watched, service: tuple[str, Made]) -> None:
    page, made = watched.open("/plan"), service[1]
    page.select_option("select[name=fields]", NASTY)
    page.fill("input[name=width]", "-1")
    page.fill("input[name=before]", "17:00")
    page.click("text=Run the plan")
    page.wait_for_selector("text=width is -1; use metres above 0.")
    assert page.evaluate("document.activeElement.name") == "width"
    page.fill("input[name=width]", "3.5")
    made.requests.clear()
    made.polls = 0
    page.click("text=Run the plan")
    page.wait_for_selector("text=Simulating plans")
    asked = {
        "field": NASTY,
        "width": 3.5,
        "before": "17:00",
        "tractors": "1-3",
        "strategies": "split-field,interleaved",
        "tractor": "eg105",
    }
    assert made.requests == [("plans", asked)]
    page.wait_for_selector("text=Plans, best first")
    watched.said.clear()  # the refusal above is a failed request, which a browser tells of


def test_any_plan_of_the_table_is_played(watched: Watched) -> None:
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
    assert [row.split("\t")[2].strip() for row in page.locator("tbody tr").all_inner_texts()[:3]] == ["2", "3", "3"]
    page.click("summary:has-text('The whole report')")
    page.frame_locator("iframe").locator("text=the report runs").wait_for()
    watched.well()


def test_a_job_is_cancelled_and_a_failure_is_told_in_its_sentence(watched: Watched, service: tuple[str, Made]) -> None:
    service[1].polls = 0
    page = watched.open("/plan/made")
    page.click("text=Cancel")
    page.wait_for_selector("text=It was cancelled.")
    service[1].polls = 0
    watched.open("/access")
    watched.open("/plan/bad")
    page.wait_for_selector("text=use a narrower implement")


def test_a_field_is_drawn_by_keys_and_uploaded(watched: Watched, service: tuple[str, Made]) -> None:
    page, made = watched.open("/plan"), service[1]
    made.requests.clear()
    page.click("summary:has-text('Draw a field')")
    for east, north in ((0, 0), (100, 0), (100, 50), (0, 50)):
        page.fill("[aria-label='Metres east']", str(east))
        page.fill("[aria-label='Metres north']", str(north))
        page.click("text=Add corner")
    page.wait_for_selector("text=4 corners, 0.50\xa0ha")
    page.click("text=Use this field")
    page.wait_for_function("() => document.querySelector('select[name=fields]').value === 'myfield'")
    kind, text = made.requests[0]
    ring = json.loads(text)["features"][0]["geometry"]["coordinates"][0]
    assert kind == "fields" and ring == [[0, 0], [100, 0], [100, 50], [0, 50], [0, 0]]
    assert page.is_checked("input[name=local]"), "a drawing without a place is in metres"
    watched.well()


def test_a_log_without_a_needed_column_is_refused_in_a_sentence(watched: Watched, tmp_path: Path) -> None:
    log = tmp_path / "bad.csv"
    log.write_text("time_s,easting_m\n0,1\n", encoding="utf-8")
    page = watched.open("/replay")
    page.set_input_files("input[type=file]", log)
    page.wait_for_selector("text=bad.csv has no column northing_m")
    watched.well()


def told_by(page: Page, expression: str) -> Any:
    """What an expression comes to, with modules of the page as `m`."""
    return page.evaluate(f"""async () => {{
      const m = {{}};
      for (const name of ["words", "control", "player", "camera", "drawfield", "livemap", "files"]) {{
        Object.assign(m, await import(`./static/js/${{name}}.js`));
      }}
      return {expression};
    }}""")


def test_modules_by_their_closed_forms(watched: Watched) -> None:
    page = watched.open("/access")
    assert told_by(page, "[m.clock(3723), m.span(45), m.percent(9.96), m.percent(99.96), m.number(null)]") == [
        "1:02:03",
        "45\xa0s",
        "10.0\xa0%",
        "99.9\xa0%",
        "\u2013",
    ]
    assert told_by(page, "m.area([[0, 0], [4, 0], [4, 3]])") == 6
    lane = "{ time_s: [0, 10, 20], points_m: [[0, 0], [10, 0], [10, -5]], status: [1, 4] }"
    there = told_by(page, f"[m.poseAt({lane}, 5), m.poseAt({lane}, 15)]")
    assert [there[0]["x"], there[0]["heading"]] == [5, 90]
    assert there[1]["y"] == -2.5 and there[1]["heading"] % 360 == 0, "backwards to the south it looks north"
    seen = told_by(
        page,
        """(() => { const one = new m.Camera("c"); one.aim({ x: 0, y: 0, heading: 90 }, 600, 400);
      return [one.pixel(one.see(20, 0, 0)), one.pixel(one.see(20, -3, 0)), one.pixel(one.see(40, 0, 0))]; })()""",
    )
    assert seen[0][0] == pytest.approx(300) and seen[1][0] > 300 and seen[2][1] < seen[0][1], "ahead, right, farther"


def test_fields_far_apart_stand_beside_each_other_on_one_map(watched: Watched) -> None:
    page = watched.open("/access")
    fields = """[{ grid: "a", box: [0, 0, 200, 100] }, { grid: "b", box: [9000, 0, 9300, 100] },
      { grid: "a", box: [500, 0, 700, 100] }, { grid: "a", box: [90000, 0, 90100, 100] }]"""
    placed = told_by(page, f"m.arranged({fields})")
    assert [one["group"] for one in placed] == [0, 1, 0, 2]
    assert placed[0]["shift"] == placed[2]["shift"] == [0, 0], "neighbours keep their distance, the first its place"
    boxes = [[0, 0, 700, 100], [9000, 0, 9300, 100], [90000, 0, 90100, 100]]
    shown = [
        [west + x, south + y, east + x, north + y]
        for (west, south, east, north), (x, y) in zip(boxes, (placed[k]["shift"] for k in (0, 1, 3)), strict=True)
    ]
    for k, one in enumerate(shown):
        for other in shown[:k]:
            apart = max(one[0] - other[2], other[0] - one[2], one[1] - other[3], other[1] - one[3])
            assert apart == pytest.approx(105) or apart > 105, "a gap of 15 % of the largest side"
    assert max(abs(value) for one in shown for value in one) < 1500
    assert told_by(page, "m.arranged([{ grid: 'a', box: [7, 8, 9, 10] }])") == [{"group": 0, "shift": [0, 0]}]


def test_a_gamepad_drives_by_its_shoulder_buttons_and_standing_is_what_else_there_is(watched: Watched) -> None:
    page = watched.open("/access")
    told = told_by(
        page,
        """(() => { const box = document.createElement("div");
          const pad = { connected: true, axes: [0.5, 0.04], buttons: [] }, limits = { limit_mps: 2, steering_deg: 30 };
          for (let k = 0; k < 8; k++) pad.buttons.push({ pressed: false, value: 0 });
          navigator.getGamepads = () => [null, pad];
          let hidden = false;
          Object.defineProperty(document, "hidden", { configurable: true, get: () => hidden });
          const hands = new m.Hands({ surface: box, pad: box, ready: () => true });
          const said = [m.commandOf(hands.read(), limits)];
          pad.buttons[5].pressed = true;
          said.push(m.commandOf(hands.read(), limits));
          pad.buttons[6].value = 0.5;
          said.push(m.commandOf(hands.read(), limits));
          for (const away of [() => dispatchEvent(new Event("blur")), () => { hidden = true; }]) {
            away();
            said.push(m.commandOf(hands.read(), limits));
            hidden = false;
            said.push(m.commandOf(hands.read(), limits));
            pad.buttons[5].pressed = false;
            hands.read();
            pad.buttons[5].pressed = true;
            said.push(m.commandOf(hands.read(), limits));
          }
          pad.connected = false;
          said.push(m.commandOf(hands.read(), limits));
          hands.close();
          delete document.hidden;
          return said; })()""",
    )
    still = {"steering_command_deg": 0, "speed_command_mps": 0, "shuttle": 0, "start": 0}
    assert told[0] == told[9] == still, "no button held, and no gamepad any more"
    assert told[3] == told[4] == told[6] == told[7] == still, "the page was left, and the button not let go since"
    assert told[5] == told[8] == told[2], "pressed anew"
    assert told[1] == {"steering_command_deg": 15, "speed_command_mps": 0, "shuttle": 0, "start": 0}
    assert told[2] == {"steering_command_deg": 15, "speed_command_mps": 1, "shuttle": -1, "start": 1}


def test_commands_are_numbered_and_dated_by_the_clock_of_the_service(watched: Watched) -> None:
    page = watched.open("/access")
    told = told_by(
        page,
        """(() => { const clock = new m.ServiceClock(), stamp = new m.Stamp(clock), said = [stamp.next(0)];
          clock.heard("2026-06-01T08:00:00.700Z", 1000);
          clock.heard("2026-06-01T08:00:01.900Z", 2000);
          clock.heard("2026-06-01T08:00:01.950Z", 3000);
          said.push(stamp.next(3000), stamp.next(3100));
          return said; })()""",
    )
    assert told[0] is None, "nothing is said before the clock is known"
    assert [one["sequence"] for one in told[1:]] == [0, 1]
    assert told[1]["time"] == "2026-06-01T08:00:02.899Z", "a frame that was held up does not set the clock back"


def test_the_pages_speak_with_the_service_itself(
    browser: Browser, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("planner.service.links.hub.warm", lambda: None)  # no fleet drives here: nothing to compile for
    app = create_app(Settings(data=tmp_path, workers=0), inline=True)
    token = app.state.store.new_token("office", "control")
    with served(app) as base:
        watched = Watched(browser, base, token)
        for path, whole in EMPTY.items():
            watched.open(path).wait_for_selector(whole)
        page = watched.open("/plan")
        page.wait_for_selector("text=1.89\xa0ha")
        page.click("summary:has-text('Draw a field')")
        for east, north in ((0, 0), (100, 0), (100, 50), (0, 50)):
            page.fill("[aria-label='Metres east']", str(east))
            page.fill("[aria-label='Metres north']", str(north))
            page.click("text=Add corner")
        page.click("text=Use this field")
        page.wait_for_selector(".under >> text=0.50\xa0ha")
        watched.well()
        page.fill("input[name=width]", "-1")
        page.click("text=Run the plan")
        page.wait_for_selector("text=it must be above 0")
        page.fill("input[name=width]", "3")
        page.click("text=Run the plan")
        page.wait_for_selector("text=Waiting for its turn.")
        asked = app.state.store.jobs("plan")[0].request
        assert asked["field"] == "myfield" and asked["local"] is True and asked["width"] == 3
        page.click("text=Cancel")
        page.wait_for_selector("text=It was cancelled.")
        _add_files(watched, tmp_path)
        page.context.close()


def _add_files(watched: Watched, folder: Path) -> None:
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
    page.wait_for_selector("text=coordinate system its numbers are in")
    page.fill("input[name=upload-crs]", "EPSG:25832")
    page.click("text=Add it so")
    page.wait_for_selector(".under >> text=0.36\xa0ha")
    page.set_input_files("input[aria-label='Add a file: Field']", folder / "two.geojson")
    page.wait_for_selector("text=The file holds 2 fields; choose one of them.")
    page.select_option("select[name=parcel]", "b")
    page.wait_for_selector(".under >> text=1.56\xa0ha")
    page.click("text=Run the plan")
    page.wait_for_selector("h1:has-text('two b')")


def test_the_overview_opens_on_the_newest_fleet_that_runs(watched: Watched) -> None:
    page = watched.page
    told = [("f1", "08:00", "running"), ("f2", "09:00", "running"), ("f3", "10:00", "ready")]
    items = [
        {"id": id, "name": id, "created": f"2026-11-20T{at}:00Z", "fleet": {"state": state}, "tractors": []}
        for id, at, state in told
    ]
    page.route("**/api/v1/fleets", lambda route: route.fulfill(json={"items": items}))
    watched.open("/")
    page.wait_for_selector(".rest .tile")
    found = page.eval_on_selector_all(".rest .tile", "all => all.map((one) => one.getAttribute('href'))")
    page.unroute("**/api/v1/fleets")
    assert found == ["#/fleet/f2", "#/fleet/f1", "#/fleet/f3"]


def test_stop_all_goes_another_way_where_the_link_does_not_answer(watched: Watched, service: tuple[str, Made]) -> None:
    page, made = watched.open("/fleet/f1"), service[1]
    page.wait_for_selector("text=waits for tractor 1")
    for deaf, wanted in ((False, []), (True, [("fleets/f1/stop", None)])):
        made.deaf = deaf
        made.frames.clear()
        made.requests.clear()
        page.click("text=STOP ALL")
        page.wait_for_timeout(800)
        assert made.requests == wanted and made.frames == [{"kind": "stop_all"}]
    made.deaf = False
    watched.well()


def test_a_plan_is_saved_for_a_terminal(watched: Watched, service: tuple[str, Made]) -> None:
    page, made = watched.open("/plan/old"), service[1]
    page.click("summary:has-text('Guidance for terminals')")
    page.select_option("select[name=form]", "agopengps")
    page.select_option("select[name=of]", "2")
    made.requests.clear()
    with page.expect_download() as saved:
        page.click("text=Save for the terminal")
    assert saved.value.suggested_filename.endswith("-tractor-2-plan-agopengps.zip")
    assert made.requests == [("plans/old/results/plan.json/export", {"to": "agopengps", "tractor": 2})]
    watched.well()


def test_names_of_a_chart_never_run_into_its_title(watched: Watched) -> None:
    page = watched.open("/fleet/f1/tractor/2")
    page.wait_for_selector("text=larger than noise")
    drawn = """async (width) => {
      const { StripChart } = await import("./static/js/charts.js");
      const series = [{ name: "ahead", colour: "t2" }, { name: "right", colour: "t3" }];
      const chart = new StripChart("Corrections", { unit: "cm", series }), place = chart.node;
      place.style.cssText = `display:block;width:${width}px;height:120px`;
      document.body.append(place);
      const seen = [], draw = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {
        const wide = this.measureText(words).width, left = this.textAlign === "right" ? x - wide : x;
        seen.push([words, left, left + wide, y]);
      };
      chart.set([[0, -12.3, 10.4]]);
      CanvasRenderingContext2D.prototype.fillText = draw;
      chart.close();
      place.remove();
      return seen.filter(([, , , y]) => y < 30); }"""
    for width in (600, 220, 190):
        words = page.evaluate(drawn, width)
        assert len(words) == 3 and all(left >= 0.0 for _, left, _, _ in words)
        for one, left, right, y in words:
            assert not any(o != one and abs(h - y) < 10 and a < right and b > left for o, a, b, h in words), words
    watched.well()
