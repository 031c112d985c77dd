"""The tracks of an estimate on the page of a plan: left out, worked first, given to a tractor by pointer and keys."""

from collections.abc import Iterator
from typing import Any

import pytest
from playwright.sync_api import Page, Route

from tests.service.accessibility import find_faults_at_widths
from tests.service.fake_service import Made
from tests.service.watching import WIDE, WatchedPage, until

pytestmark = pytest.mark.slow
LAID_OUT, AT_ONCE = "**/api/v1/estimates", "**/api/v1/estimates?at_once=true"
MAP = "canvas[aria-label^='Tracks of the estimate']"
WIDE_M, HIGH_M, TRACKS = 100.0, 60.0, range(1, 7)


class Answers:
    """Answers for six tracks, the first three of tractor 1, as a service would give them.

    At 7 km/h they are numbered from the other side; of another width than 3 m they lie elsewhere.
    """

    def __init__(self) -> None:
        self.asked = list[dict[str, Any]]()
        self.is_borrowed = False

    def answer(self, route: Route) -> None:
        values = route.request.post_data_json
        self.asked.append(values)
        out = (values.get("leave_out") or "").split(",")
        given = {name: int(text[0]) for text in values.get("give") or [] for name in text[2:].split(",")}
        lines = []
        for number in TRACKS:
            east_m = find_east_m(7 - number if values.get("speed_kmh") == 7 else number) + values["width"] - 3.0
            name, points = str(number), [[east_m, 10.0], [east_m, 50.0]]
            deal = (None, None) if name in out else (given.get(name, 1 if number <= 3 else 2), number)
            lines.append({"name": name, "tractor": deal[0], "place": deal[1], "points": points})
        ring = [[0.0, 0.0], [WIDE_M, 0.0], [WIDE_M, HIGH_M], [0.0, HIGH_M], [0.0, 0.0]]
        plan = {"tractors": 2, "feasible": True, "done_s": 600.0, "cost": 10.0, "worked_pct": 99.0}
        is_borrowed = self.is_borrowed and "bearing" not in values
        layout = {"bearing": 12.5, "headland_passes": 1, "is_layout_borrowed": is_borrowed, "is_scaled": False}
        route.fulfill(json={"recommended": 2, "plans": [plan], "lines": lines, "outlines": [ring], **layout})

    @property
    def last(self) -> dict[str, Any]:
        return self.asked[-1]


def find_east_m(number: int) -> float:
    """Where a track lies."""
    return 15.0 * number - 2.5


@pytest.fixture
def answers(watched: WatchedPage, pages: tuple[str, Made]) -> Iterator[Answers]:
    """The form with the tracks of its first answer."""
    found, page = Answers(), watched.page
    page.route(LAID_OUT, found.answer)
    page.route(AT_ONCE, found.answer)
    watched.open("/access")
    watched.open("/plan?width=3&tractors=2&strategies=all&field=iwamizawa&tractor=eg105")
    until(page, lambda: choice(page).locator("option").count() == 7)
    yield found
    page.unroute_all()
    page.set_viewport_size(WIDE)
    watched.open("/access")


def choice(page: Page) -> Any:
    return page.locator("label:has-text('Chosen track') select")


def locate_track(page: Page, number: int) -> tuple[float, float]:
    """The middle of a track on the screen: the map shows the whole field, as `MapView.fit` says."""
    canvas = page.locator(MAP)
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    scale = min((box["width"] - 40.0) / WIDE_M, (box["height"] - 96.0) / HIGH_M)
    east_px = box["x"] + box["width"] / 2.0 + (find_east_m(number) - WIDE_M / 2.0) * scale
    return east_px, box["y"] + box["height"] / 2.0 + 12.0


def press(page: Page, words: str) -> None:
    page.locator(f"section:has({MAP}) button:text-is('{words}')").click()


def test_a_tap_chooses_a_track_and_a_button_leaves_it_out(answers: Answers, watched: WatchedPage) -> None:
    page = watched.page
    page.mouse.click(*locate_track(page, 2))
    assert choice(page).input_value() == "2"
    assert page.locator("text=Track 2: tractor 1, number 2 of its tour").is_visible()
    press(page, "Leave out")
    until(page, lambda: answers.last.get("leave_out") == "2")
    assert page.locator("text=Left out: 2.").is_visible()
    until(page, lambda: page.locator("text=Track 2: left").is_visible())
    until(page, lambda: "leave_out=2" in page.evaluate("location.hash"))
    assert page.evaluate("document.activeElement.textContent") == "Leave out", "the focus stays where it was"
    press(page, "As planned")
    until(page, lambda: "leave_out" not in answers.last)
    watched.well()


def test_a_track_dragged_onto_one_of_another_tractor_is_given_to_that(answers: Answers, watched: WatchedPage) -> None:
    page = watched.page
    page.mouse.click(*locate_track(page, 1))
    page.mouse.down()
    page.mouse.move(*locate_track(page, 4), steps=5)
    page.mouse.move(*locate_track(page, 6), steps=5)
    assert page.locator("text=Track 1: to tractor 2").is_visible()
    page.mouse.up()
    until(page, lambda: answers.last.get("give") == ["2=1"])
    until(page, lambda: page.locator("text=Track 1: tractor 2, number 1 of its tour").is_visible())
    page.mouse.move(*locate_track(page, 3))
    page.mouse.down()
    page.mouse.move(*locate_track(page, 5), steps=5)
    page.mouse.up()
    assert answers.last["give"] == ["2=1"], "what is not chosen moves the map"


def test_keys_put_tracks_first_the_last_wish_before_all(answers: Answers, watched: WatchedPage) -> None:
    page = watched.page
    for name in ("2", "4"):
        choice(page).select_option(name)
        page.locator("button:text-is('Work first')").focus()
        page.keyboard.press("Enter")
    until(page, lambda: answers.last.get("work_first") == "4,2")
    assert page.locator("text=First: 4, 2.").is_visible()
    press(page, "Clear all")
    until(page, lambda: "work_first" not in answers.last)


def test_what_was_wanted_goes_to_the_tracks_in_the_same_places(answers: Answers, watched: WatchedPage) -> None:
    page = watched.page
    choice(page).select_option("3")
    press(page, "Tractor 2")
    until(page, lambda: answers.last.get("give") == ["2=3"])
    page.fill("input[name=price_per_hour]", "70")
    until(page, lambda: answers.last.get("price_per_hour") == 70 and answers.last.get("give") == ["2=3"])
    page.fill("input[name=speed_kmh]", "7")
    until(page, lambda: answers.last.get("speed_kmh") == 7 and answers.last.get("give") == ["2=4"])
    assert page.locator("text=Tractor 2: 4.").is_visible()
    assert not any(each.get("give") == ["2=3"] for each in answers.asked if each.get("speed_kmh") == 7)
    page.fill("input[name=width]", "4")
    until(page, lambda: answers.last.get("width") == 4 and "give" not in answers.last)
    until(page, lambda: page.locator("text=its tracks are numbered anew").is_visible())


def test_a_link_wants_the_same_and_a_borrowed_layout_is_kept(answers: Answers, watched: WatchedPage) -> None:
    answers.is_borrowed = True
    watched.open("/access")
    page = watched.open("/plan?width=3&tractors=2&strategies=all&field=iwamizawa&leave_out=1,5-6&give=1=4")
    until(page, lambda: (answers.last.get("leave_out"), answers.last.get("give")) == ("1,5-6", ["1=4"]))
    until(page, lambda: choice(page).locator("option").count() == 7)
    choice(page).select_option("2")
    press(page, "Work first")
    until(page, lambda: answers.last.get("work_first") == "2")
    assert answers.last["leave_out"] == "1,5,6", "the lines of the map"
    assert (answers.last["bearing"], answers.last["headland_passes"]) == (12.5, 1)
    choice(page).select_option("3")
    press(page, "Leave out")
    until(page, lambda: set(answers.last["leave_out"].split(",")) == set("1356"))
    assert (answers.last["bearing"], answers.last["headland_passes"]) == (12.5, 1), "also after its own answer"
    press(page, "Clear all")
    until(page, lambda: "bearing" not in answers.last)
    watched.open("/access")
    watched.open("/plan?width=3&tractors=2&strategies=all&field=iwamizawa&no_headland=true&leave_out=1")
    until(page, lambda: answers.last.get("leave_out") == "1" and choice(page).locator("option").count() == 7)
    choice(page).select_option("2")
    press(page, "Work first")
    until(page, lambda: answers.last.get("work_first") == "2")
    assert answers.last["bearing"] == 12.5 and "headland_passes" not in answers.last, "there is no headland"


@pytest.mark.parametrize("wanted", ["leave_out=true", "leave_out=1&leave_out=2", "give=true", "give=99999999=1"])
def test_whatever_a_link_wants_opens_the_form(answers: Answers, watched: WatchedPage, wanted: str) -> None:
    watched.open("/access")
    watched.open(f"/plan?width=3&tractors=2&field=iwamizawa&{wanted}").wait_for_selector("text=Run the plan")
    watched.well()


def test_the_map_is_accessible_on_a_desk_and_on_a_telephone(answers: Answers, watched: WatchedPage) -> None:
    choice(watched.page).select_option("3")
    assert find_faults_at_widths(watched.page) == []
