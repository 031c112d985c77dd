"""The control centre in a browser: old data, a lost link, alarms in order, video, steering on a small screen."""

import re
from collections.abc import Iterator

import pytest
from playwright.sync_api import Page, ViewportSize

from tests.examples import seldom
from tests.service.fake_service import Made
from tests.service.watching import WIDE, WatchedPage, evaluate_in_page, needs_browser, until

pytestmark = [needs_browser, pytest.mark.slow]
SMALL_WINDOW = ViewportSize(width=390, height=664)  # with the bars of a telephone's browser
HOST = "http://camera.example:8080"
PIXEL = bytes.fromhex(
    "47494638396101000100800000ff000000000021f90400000000002c00000000010001000002024401003b"  # a GIF of one pixel
)


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
    for name in (
        ".map canvas",
        ".near",
        ".pad",
        ".dead",
        "button.stop",
        "text=Give back",
        "[aria-label='Speed limit']",
    ):
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
