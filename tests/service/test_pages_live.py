"""The pages of fleets and tractors that drive, in a real browser: watching, ordering, driving by hand, old data."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, ViewportSize

from tests.examples import seldom
from tests.service.fake_service import NOTHING, UNDERSTEER, Made
from tests.service.watching import NARROW, WIDE, WatchedPage, evaluate_in_page, until

pytestmark = pytest.mark.slow

SMALL_WINDOW = ViewportSize(width=390, height=664)  # with the bars of a telephone's browser
HOST = "http://camera.example:8080"
PIXEL = bytes.fromhex(
    "47494638396101000100800000ff000000000021f90400000000002c00000000010001000002024401003b"  # a GIF of one pixel
)


def test_a_fleet_is_watched_and_ordered(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/fleet/f1"), pages[1]
    page.wait_for_selector("text=waits for tractor 1")
    tiles = page.locator(".tractor").all_inner_texts()
    assert len(tiles) == 3 and "connection broken" in tiles[2] and "fix 42" in tiles[2].replace("\xa0", " ")
    page.click("text=Acknowledge")
    page.wait_for_selector("text=seen by office")
    page.click("text=STOP ALL")
    page.click("summary:has-text('Failures, obstacles')")
    page.select_option("select[aria-label='Tractor that failed']", "3")
    page.click("text=Plan without it")
    page.click("button:text-is('Send to the tractors')")
    said = page.get_by_text("The tractors have the new plan and stand: Resume lets them drive it.")
    said.wait_for()
    made.state = "running"
    said.wait_for(state="detached")
    page.click("text=Go on from here")
    page.select_option("select[aria-label='Who goes on']", "2")
    page.click("text=Go on from here")
    wanted = [
        {"kind": "acknowledge", "alarm": 1},
        {"kind": "stop_all"},
        {"kind": "fail", "tractor": 3},
        {"kind": "replan", "without": [3]},
        {"kind": "accept", "proposal": 7},
        {"kind": "replan", "without": []},
        {"kind": "replan", "without": [2]},
    ]
    until(page, lambda: len(made.frames) >= len(wanted))
    first = made.frames[0]
    assert first.pop("time").endswith("Z"), "an order to go on tells when it was given"
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


def test_hands_drive_only_while_the_dead_man_switch_is_held(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/fleet/f1/tractor/1"), pages[1]
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
    page.wait_for_selector("text=Released: it stands")
    until(page, lambda: made.frames[-1]["speed_command_mps"] == 0)
    page.locator(".pad").scroll_into_view_if_needed()
    pad = page.locator(".pad").bounding_box()
    assert pad is not None
    page.mouse.move(pad["x"] + pad["width"] / 2, pad["y"] + pad["height"] * 0.9)
    page.mouse.down()
    page.wait_for_selector("text=Driving by touch")
    until(page, lambda: made.frames[-1]["shuttle"] == -1)
    page.mouse.up()
    page.wait_for_selector("text=Released: it stands")
    watched.well()


def test_who_stands_for_what_cannot_be_read_is_let_go_on_by_a_button_that_says_so(
    watched: WatchedPage, pages: tuple[str, Made]
) -> None:
    page, made = watched.open("/fleet/f1"), pages[1]
    made.frames.clear()
    alarm = page.locator(".alarm:has-text('could not be read')")
    alarm.wait_for()
    assert alarm.get_by_role("button").all_inner_texts() == ["Let it resume"]
    alarm.get_by_role("button").click()
    until(page, lambda: bool(made.frames))
    assert {key: made.frames[0][key] for key in ("kind", "alarm")} == {"kind": "acknowledge", "alarm": 3}
    alarm.locator("text=Acknowledge").wait_for()  # it is over: nothing goes on by it any more
    made.looked = False
    watched.well()


def test_the_circle_that_a_tractor_in_doubt_may_be_in_is_on_the_map_and_grows(
    watched: WatchedPage, pages: tuple[str, Made]
) -> None:
    page, made = watched.open("/fleet/f1"), pages[1]
    page.wait_for_selector("text=waits for tractor 1")
    plain = count_reddened(page)
    made.area_m = 10.0
    until(page, lambda: count_reddened(page) > plain + 1000)
    small = count_reddened(page) - plain
    made.area_m = 20.0
    until(page, lambda: count_reddened(page) - plain > 2 * small)
    alarm = page.locator(".alarm:has-text('contradicts itself')")
    assert "acknowledge this if it is not to drive" in alarm.inner_text()
    inside = "all => all.every((one) => one.scrollHeight <= one.clientHeight + 1)"
    for size in (WIDE, NARROW):
        page.set_viewport_size(size)
        assert page.eval_on_selector_all("[aria-label='Alarms'], [aria-label='Alarms'] .alarm", inside), (
            "nothing is cut"
        )
    page.set_viewport_size(WIDE)
    made.area_m = None
    watched.well()


def count_reddened(page: Page) -> int:
    """Pixels of the map in which red is well above green and blue, as where a tractor in doubt may be."""
    found: int = page.evaluate("""() => {
      const map = document.querySelector(".map canvas"), copy = new OffscreenCanvas(map.width, map.height);
      const context = copy.getContext("2d", { willReadFrequently: true });
      context.drawImage(map, 0, 0);
      const { data } = context.getImageData(0, 0, map.width, map.height);
      let count = 0;
      for (let k = 0; k < data.length; k += 4) {
        count += data[k] > data[k + 1] + 25 && Math.abs(data[k + 1] - data[k + 2]) < 30;
      }
      return count; }""")
    return found


def test_a_twin_in_doubt_is_diagnosed_and_mended_where_something_was_found(
    watched: WatchedPage, pages: tuple[str, Made]
) -> None:
    made = pages[1]
    made.diagnosed, made.finding = True, NOTHING
    page = watched.open("/fleet/f1/tractor/2")
    page.wait_for_selector("text=Nothing was found that the tractor file lacks.")
    assert page.locator("text=Read the diagnosis").count() == 1
    assert page.locator("text=Add it to the tractor file").count() == 0
    made.diagnosed, made.finding = False, UNDERSTEER
    watched.open("/access")
    watched.open("/fleet/f1/tractor/2")
    page.click("text=Find the cause")
    page.wait_for_selector("text=The tractor turns less than its wheels say.")
    assert page.get_attribute("text=Read the diagnosis", "href") == "#/diagnose/old"
    page.click("text=Add it to the tractor file")
    page.wait_for_selector("text=Saved as the tractor file eg105 mended")
    page.wait_for_selector("text=Add it to the tractor file", state="detached")
    assert page.locator("text=Saved as the tractor file eg105 mended").count() == 1, "it is said as long as it counts"
    made.diagnosed = False
    watched.well()


def test_the_overview_opens_on_the_newest_fleet_that_runs(watched: WatchedPage) -> None:
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


def test_stop_all_uses_http_where_the_link_does_not_answer(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/fleet/f1"), pages[1]
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


def test_a_page_left_while_its_link_connects_reports_no_error(watched: WatchedPage, pages: tuple[str, Made]) -> None:
    page, made = watched.open("/access"), pages[1]
    until(page, lambda: made.left == made.knocks)
    made.shut, knocks = True, made.knocks
    try:
        watched.open("/fleet/f1")
        until(page, lambda: made.knocks > knocks)
        watched.open("/access")
        page.wait_for_selector("text=Version")
        page.wait_for_timeout(200)
        watched.well()
    finally:
        made.shut = False
    until(page, lambda: made.left == made.knocks)
    page.wait_for_timeout(200)
    assert made.knocks == knocks + 1, "a link that was left does not come back"
    watched.well()


def test_fields_far_apart_stand_beside_each_other_on_one_map(watched: WatchedPage) -> None:
    page = watched.open("/access")
    fields = """[{ grid: "a", box: [0, 0, 200, 100] }, { grid: "b", box: [9000, 0, 9300, 100] },
      { grid: "a", box: [500, 0, 700, 100] }, { grid: "a", box: [90000, 0, 90100, 100] }]"""
    placed = evaluate_in_page(page, f"m.arranged({fields})")
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
    assert evaluate_in_page(page, "m.arranged([{ grid: 'a', box: [7, 8, 9, 10] }])") == [{"group": 0, "shift": [0, 0]}]


def test_a_gamepad_drives_by_its_shoulder_buttons_and_standing_is_what_else_there_is(watched: WatchedPage) -> None:
    page = watched.open("/access")
    told = evaluate_in_page(
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


def test_commands_are_numbered_and_dated_by_the_clock_of_the_service(watched: WatchedPage) -> None:
    page = watched.open("/access")
    told = evaluate_in_page(
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


@pytest.mark.slow
def test_names_of_a_chart_never_run_into_its_title(watched: WatchedPage) -> None:
    page = watched.open("/fleet/f1/tractor/2")
    page.wait_for_selector("text=larger than noise")
    drawn = """async (width) => {
      const { StripChart, short } = await import("./static/js/charts.js");
      if ([0.05, 20, -50000].map(short).join(" ") !== "0.05 20 -50k") throw new Error("words of a scale");
      const series = [{ name: "ahead", colour: "t2" }, { name: "right", colour: "t3" }];
      const chart = new StripChart("Corrections", { unit: "cm", series }), place = chart.node;
      place.style.cssText = `display:block;width:${width}px;height:120px`;
      document.body.append(place);
      const seen = [], draw = CanvasRenderingContext2D.prototype.fillText;
      CanvasRenderingContext2D.prototype.fillText = function (words, x, y) {
        const wide = this.measureText(words).width, left = this.textAlign === "right" ? x - wide : x;
        seen.push([words, left, left + wide, y]);
      };
      chart.set([[-90, 5000, 0], [0, -12.3, 10.4]]);
      if (chart.rows.length !== 1) throw new Error("a row from before what is shown");
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


@pytest.fixture
def made(pages: tuple[str, Made], watched: WatchedPage) -> Iterator[Made]:
    """What the page speaks with, as it was afterwards."""
    made = pages[1]
    yield made
    made.silent = made.cut = False
    made.videos, made.holder = {}, None
    watched.page.set_viewport_size(ViewportSize(width=WIDE["width"], height=WIDE["height"]))
    watched.page.goto("about:blank")


def read_age(page: Page, selector: str) -> int:
    found = re.search(r"(\d+)\s*s old", page.locator(selector).first.inner_text())
    return int(found[1]) if found else -1


def test_data_older_than_a_second_are_grey_and_their_age_counts_up(watched: WatchedPage, made: Made) -> None:
    page = watched.open("/fleet/f1")
    page.wait_for_selector("text=waits for tractor 1")
    tiles = page.locator(".tractor")
    assert "stale" not in (tiles.nth(0).get_attribute("class") or "")
    assert "stale" in (tiles.nth(2).get_attribute("class") or ""), "its last fix is 42 s old"
    made.silent = True
    page.wait_for_selector(".tractor.stale >> nth=2")
    page.wait_for_selector(".rest .stale")
    until(page, lambda: read_age(page, ".tractor") >= 2)
    first = read_age(page, ".tractor")
    until(page, lambda: read_age(page, ".tractor") >= first + 1)
    made.silent = False
    page.wait_for_selector(".tractor:not(.stale) >> nth=1")
    assert page.locator(".rest .stale").count() == 0


def test_no_link_covers_the_map_and_the_drawn_view(watched: WatchedPage, made: Made) -> None:
    page = watched.open("/fleet/f1/tractor/1")
    page.wait_for_selector("text=Drawn view")
    until(page, lambda: not page.locator(".cover").first.is_visible())
    assert page.locator("text=Camera").count() == 0
    made.cut = True
    for cover in (".map .cover", ".picture .cover"):
        page.wait_for_selector(f"{cover}:has-text('No link')")
        page.wait_for_selector(f"{cover}:has-text('s old')")
        outer, inner = page.locator(cover).locator("..").bounding_box(), page.locator(cover).bounding_box()
        assert outer is not None and inner is not None
        assert inner["width"] >= outer["width"] - 2 and inner["height"] >= outer["height"] - 2
    page.wait_for_selector(".near.stale")
    made.cut = False
    page.wait_for_selector(".map .cover", state="hidden")
    watched.said.clear()  # the browser complains of the links that were refused


def test_alarms_that_last_stand_above_those_that_are_over(watched: WatchedPage, made: Made) -> None:
    watched.open("/")
    alarms = [
        {"id": 1, "level": "critical", "acknowledged": None, "over": True},
        {"id": 2, "level": "warning", "acknowledged": "office", "over": False},
        {"id": 3, "level": "warning", "acknowledged": None, "over": False},
        {"id": 4, "level": "critical", "acknowledged": "office", "over": True},
        {"id": 5, "level": "critical", "acknowledged": None, "over": False},
    ]
    items = [one | {"code": "x", "tractor": 1, "sentence": f"alarm {one['id']}", "since": 1.79e9} for one in alarms]
    found = watched.page.evaluate(
        """async (alarms) => {
          const { alarmList } = await import("./static/js/board.js");
          const { node } = alarmList(() => [{ id: "f1", name: "f1", alarms, mayControl: true }]);
          return [...node.querySelectorAll(".alarm b + *, .alarm p:first-child")].map((one) => one.textContent);
        }""",
        items,
    )
    assert [int(text.rsplit(" ", 1)[1]) for text in found] == [5, 3, 2, 1, 4]
    watched.well()


@pytest.mark.parametrize("size", [SMALL_WINDOW, *seldom(ViewportSize(width=390, height=844))])
def test_steering_on_a_telephone_keeps_map_distance_and_stop_in_sight(
    watched: WatchedPage, made: Made, size: ViewportSize
) -> None:
    watched.page.set_viewport_size(size)
    page = watched.open("/fleet/f1/tractor/1")
    page.wait_for_selector("text=Take control")
    page.click("text=Take control")
    page.click("text=Take over")
    page.wait_for_selector("body.steering", state="attached")
    seen = {}
    controls = (".near", ".pad", ".dead", "button.stop", "text=Give back", "[aria-label='Speed limit']")
    for name in (".map canvas", *controls):
        box = page.locator(name).first.bounding_box()
        assert box is not None, name
        assert box["y"] >= 0 and box["y"] + box["height"] <= size["height"] + 0.5, (name, box)
        assert box["x"] >= 0 and box["x"] + box["width"] <= size["width"] + 0.5, (name, box)
        seen[name] = box
    assert seen[".map canvas"]["height"] >= 130 and seen[".pad"]["width"] >= 150
    assert seen[".pad"]["y"] + seen[".pad"]["height"] <= seen["button.stop"]["y"], "the pad is not below the stop"
    assert "could not be read" in page.inner_text(".urgent"), "the newest grave alarm that lasts stays in sight"
    assert page.evaluate("document.documentElement.scrollHeight <= innerHeight")
    assert re.search(r"\d\sm to .+, (ahead|behind|left|right)", page.inner_text(".near").replace("\xa0", " "))
    page.click("text=Give back")
    page.evaluate("location.hash = '#/fleet/f1'")
    page.wait_for_selector("body:not(.steering)", state="attached")
    watched.well()


def test_the_nearest_thing_is_measured_from_the_side_of_the_tractor(watched: WatchedPage, made: Made) -> None:
    watched.open("/access")
    poses = "numbers: () => [1, 2], pose: (n) => ({ x: n === 1 ? 0 : -20, y: 0, heading: 90 })"
    wall, bale = "[[10, 8], [12, 8], [12, 12], [10, 12]]", "[[6, -1], [8, -1], [8, 1], [6, 1]]"
    scene = f'scene: {{ width: 4, marked: [{{ name: "bale" }}], obstacles: [{wall}, {bale}] }}'

    def find_nearest(live: str) -> object:
        return evaluate_in_page(watched.page, f"(await import('./static/js/nearness.js')).nearestThing({live}, 1)")

    assert find_nearest(f"{{ {poses}, {scene} }}") == {"name": "bale", "metres": pytest.approx(4.0), "side": "ahead"}
    alone = f"{{ {poses}, scene: {{ width: 4, marked: [], obstacles: [] }} }}"
    assert find_nearest(alone) == {"name": "tractor 2", "metres": pytest.approx(16.0), "side": "behind"}


@pytest.mark.slow
def test_video_of_a_host_that_was_set_stands_for_the_drawn_view(watched: WatchedPage, made: Made) -> None:
    page = watched.page
    page.route(f"{HOST}/**", lambda route: route.fulfill(body=PIXEL, content_type="image/gif"))
    watched.open("/fleet/f1/tractor/1")
    page.click("summary:has-text('Video address')")
    address = page.get_by_label("Address of an MJPEG or HLS stream")
    until(page, address.is_enabled)
    address.fill("rtsp://camera.example/1")
    page.click(".view button:text-is('Save')")
    page.wait_for_selector("text=let a gateway such as MediaMTX make HLS of it")
    address.fill(f"{HOST}/tractor-1.mjpg")
    page.click(".view button:text-is('Save')")
    page.wait_for_selector(".view h2:text-is('Video')")
    page.wait_for_function("() => document.querySelector('img.camera')?.naturalWidth === 1")
    page.click(".view button:text-is('Drawn view')")
    page.wait_for_selector(".view canvas.camera")
    refused: list[str] = page.evaluate(
        """(other) => new Promise((done) => {
          const told = (event) => done([event.effectiveDirective, event.blockedURI]);
          document.addEventListener("securitypolicyviolation", told);
          document.body.append(Object.assign(document.createElement("img"), { src: other }));
        })""",
        "http://elsewhere.example/x.png",
    )
    assert refused[0] == "img-src" and "elsewhere" in refused[1], "no other host is allowed"
    page.unroute(f"{HOST}/**")
    watched.said.clear()  # of the refusals
