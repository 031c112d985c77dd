"""The library and the forms of days and farms in a browser, with the service itself behind them."""

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi import FastAPI
from playwright.sync_api import Browser, Page

from planner.farm.settings import read_example_text
from planner.service.settings import ServiceSettings
from planner.service.store.tables import Owner
from tests.drawn_fields import feature, point, rectangle, write_features
from tests.service.accessibility import find_faults_at_widths, open_all_details
from tests.service.conftest import SMALL
from tests.service.one_process import create_app
from tests.service.test_library import LARGER
from tests.service.watching import WIDE, WatchedPage, until, watch_app

pytestmark = pytest.mark.slow
Service = tuple[WatchedPage, FastAPI]

MAST_FIELD = feature(rectangle(0, 0, 90, 120), name="mast field"), feature(point(40, 60), name="Strommast")


@pytest.fixture
def service(browser: Browser, tmp_path: Path) -> Iterator[Service]:
    """A page with a planner's token, and the service behind it."""
    app = create_app(ServiceSettings(data=tmp_path / "data", workers=0), reads_inline=True)
    with watch_app(browser, app, "operator planner") as watched:
        yield watched, app


def open_change(page: Page, name: str) -> None:
    """Unfold what can be done with a thing."""
    page.click(f"summary[aria-label='Change {name}']")
    page.wait_for_selector(f"[aria-label='Copy: {name}']")


def rename(page: Page, name: str, new_name: str) -> None:
    """Give a thing that is unfolded another name."""
    page.click(f"[aria-label='Rename: {name}']")
    page.fill("input[name=new-name]", new_name)
    page.keyboard.press("Enter")


def test_a_field_is_added_replaced_renamed_copied_and_deleted(service: Service, tmp_path: Path) -> None:
    watched, app = service
    field, store = tmp_path / "north.geojson", app.state.store
    field.write_bytes(SMALL)
    page = watched.open("/library")
    page.wait_for_selector("text=4 entries")
    page.set_input_files("input[type=file]", field)
    page.wait_for_selector("text=5 entries")
    assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "Change north"
    watched.well()
    field.write_bytes(LARGER)
    page.set_input_files("input[type=file]", field)
    page.click("text=Replace the older file")
    until(page, lambda: store.blobs.read_bytes(store.get_file("field", "north").sha256) == LARGER)
    page.wait_for_selector("[aria-label='The name is taken']", state="detached")
    field.write_bytes(SMALL)
    page.set_input_files("input[type=file]", field)
    page.fill("input[name=upload-name]", "south")
    page.click("text=Add under this name")
    page.wait_for_selector("text=6 entries")
    watched.said.clear()  # a refusal is a failed request, which a browser tells of

    open_change(page, "north")
    rename(page, "north", "a/b")
    page.wait_for_selector("text=The name 'a/b' cannot be used")
    rename(page, "north", "Große Breite")
    page.wait_for_selector("b:has-text('Große Breite')")
    open_change(page, "Große Breite")
    page.click("[aria-label='Copy: Große Breite']")
    page.wait_for_selector("b:has-text('Große Breite copy')")
    page.fill("input[name=search]", "BREITE copy")
    page.wait_for_selector("text=1 entry")
    open_change(page, "Große Breite copy")
    page.click("[aria-label='Delete: Große Breite copy']")
    page.click(".panel button.danger:has-text('Delete'):not([aria-label])")
    page.wait_for_selector("text=Nothing is called BREITE copy.")
    page.fill("input[name=search]", "")
    page.wait_for_selector("text=6 entries")
    assert [row.name for row in store.list_files("field")] == ["Große Breite", "south"]
    open_change(page, "denmark")
    assert page.locator("[aria-label='Delete: denmark']").is_disabled()
    page.wait_for_selector("text=This comes with Headland: copy it to change it.")
    open_change(page, "south")
    assert find_faults_at_widths(page) == []
    page.set_viewport_size(WIDE)
    page.click("[aria-label='Plan it: Große Breite']")
    page.wait_for_selector("select[name=fields]")
    assert page.input_value("select[name=fields]") == "Große Breite", "the selection follows"


def test_somebody_elses_things_are_only_looked_at(service: Service) -> None:
    watched, app = service
    app.state.store.add_file("field", "theirs", SMALL, owner=Owner("yard", "0"))
    done = app.state.store.add_job("plan", "their plan", {}, owner=Owner("yard", "0"))
    app.state.store.cancel_job(done.id)
    page = watched.open("/library/plans")
    open_change(page, "their plan")
    page.wait_for_selector("text=This belongs to yard")
    assert page.locator("[aria-label='Rename: their plan']").is_disabled()
    page.click("[aria-label='Copy: their plan']")
    page.wait_for_selector("b:has-text('their plan copy')")
    open_change(page, "their plan copy")
    rename(page, "their plan copy", "mine")
    page.wait_for_selector("b:text-is('mine')")
    assert page.locator("li.shelf b").all_inner_texts() == ["mine", "their plan"]
    page.click("nav[aria-label='Kinds of things'] >> text=Fields")
    open_change(page, "theirs")
    assert page.locator("[aria-label='Delete: theirs']").is_disabled()
    watched.well()


def test_a_thing_is_renamed_and_deleted_by_keys_alone(service: Service) -> None:
    watched, app = service
    app.state.store.add_file("field", "mine", SMALL)
    page = watched.open("/library")
    page.wait_for_selector("text=5 entries")

    def find_focus() -> str:
        found: str = page.evaluate(
            "document.activeElement.getAttribute('aria-label') ?? document.activeElement.name ?? ''"
        )
        return found

    page.focus("summary[aria-label='Change mine']")
    page.keyboard.press("Enter")
    page.wait_for_selector("[aria-label='Rename: mine']")
    page.keyboard.press("Tab")
    assert find_focus() == "Rename: mine"
    page.keyboard.press("Enter")
    assert find_focus() == "new-name"
    page.keyboard.type("renamed")
    page.keyboard.press("Enter")
    until(page, lambda: find_focus() == "Change renamed")
    assert page.locator("#spoken").inner_text() == "Renamed to renamed."
    page.keyboard.press("Enter")
    page.wait_for_selector("[aria-label='Delete: renamed']")
    for _ in range(5):
        page.keyboard.press("Tab")
    assert find_focus() == "Delete: renamed"
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")  # the focus is on the question
    page.wait_for_selector("text=4 entries")
    assert find_focus() == "search", "the focus is not lost with what it was on"
    watched.well()


def test_a_day_is_made_in_the_form_and_in_the_text(service: Service) -> None:
    watched, app = service
    page = watched.open("/day")
    page.wait_for_selector("text=Add at least one field.")
    page.click("text=Add a field")
    page.wait_for_function("() => document.activeElement.name === 'fields.0.file'")
    page.select_option("[name='fields.0.file']", "denmark")
    page.fill("[name='fields.0.windows']", "8 to 12")
    page.press("[name='fields.0.windows']", "Tab")
    page.wait_for_selector("[name='fields.0.windows'][aria-invalid=true]")
    described = page.get_attribute("[name='fields.0.windows']", "aria-describedby")
    assert "range of hours" in page.locator(f"[id='{described}']").inner_text()
    page.fill("[name='fields.0.windows']", "08:00-12:00, 13:00-19:00")
    page.click("text=Add a fleet")
    page.wait_for_selector("[name='fleets.0.tractor'] option:text-is('EG105')", state="attached")
    page.select_option("[name='fleets.0.tractor']", "EG105")
    page.fill("[name='fleets.0.count']", "2,5")
    page.press("[name='fleets.0.count']", "Tab")
    page.wait_for_selector("[name='fleets.0.count'][aria-invalid=true]")
    page.fill("[name='fleets.0.count']", "2")
    page.press("[name='fleets.0.count']", "Tab")
    page.wait_for_function("() => !document.querySelector('[aria-invalid]')")
    open_all_details(page)
    text = page.input_value("[name=day-text]")
    page.fill("[name=day-text]", text.replace("denmark", "netherlands") + "# from the office\n")
    page.wait_for_function("() => document.querySelector(\"[name='fields.0.file']\").value === 'netherlands'")
    page.fill("[name=start]", "06:30")
    page.press("[name=start]", "Tab")
    page.wait_for_function("() => document.querySelector('[name=day-text]').value.includes('06:30')")
    assert "# from the office" in page.input_value("[name=day-text]")
    assert find_faults_at_widths(page) == []
    page.set_viewport_size(WIDE)
    page.fill("[name=name]", "Tuesday")
    page.fill("[name='fields.0.name']", "polder")
    page.click("text=Plan the day")  # at once: what was typed last is in it
    page.wait_for_selector("text=Waiting for its turn.")
    job = app.state.store.list_jobs("day")[0]
    asked: dict[str, Any] = tomllib.loads(job.request["day"])
    assert job.name == "Tuesday" and asked["start"] == "06:30"
    windows = ["08:00-12:00", "13:00-19:00"]
    assert asked["fields"] == [{"file": "netherlands", "name": "polder", "windows": windows}]
    assert asked["fleets"] == [{"name": "fleet 1", "count": 2, "tractor": "EG105"}]
    page.click("text=Cancel")
    page.click("text=Change this day and plan again")
    page.wait_for_function("() => document.querySelector(\"[name='start']\")?.value === '06:30'")
    watched.well()


@pytest.mark.matrix
def test_a_farm_is_changed_and_saved_under_its_name(service: Service) -> None:
    watched, app = service
    page = watched.open("/farm")
    page.wait_for_selector("[name='tractors.1.file']")
    page.fill("[name='prices.fuel_per_l']", "1,35")
    page.fill("[name='implements.0.width_m']", "-3")
    page.press("[name='implements.0.width_m']", "Tab")
    page.wait_for_selector("[name='implements.0.width_m'][aria-invalid=true]")
    page.fill("[name=name]", "Hof Süd")
    page.click("text=Save the farm")
    page.wait_for_selector("text=implements.cultivator.width_m = -3")
    assert app.state.store.list_files("farm") == []
    watched.said.clear()
    page.fill("[name='implements.0.width_m']", "4")
    page.click("[aria-label='Remove this implement: tanker']")
    page.wait_for_selector("[name='implements.3.name']", state="detached")
    page.click("text=Save the farm")
    page.wait_for_selector("h1:has-text('Hof Süd')")
    content = app.state.store.blobs.read_bytes(app.state.store.get_file("farm", "Hof Süd").sha256).decode()
    farm = tomllib.loads(content)
    assert farm["prices"]["fuel_per_l"] == 1.35 and farm["implements"][0]["width_m"] == 4
    assert len(farm["implements"]) == 3 and "# behind the rear axle" in content
    page.fill("[name='times.shift_start']", "05:00")
    page.press("[name='times.shift_start']", "Tab")
    page.wait_for_function("() => document.querySelector('[name=farm-text]').value.includes('05:00')")
    page.click("text=Save the farm")
    page.wait_for_selector("text=Saved as Hof Süd")
    saved = app.state.store.get_file("farm", "Hof Süd")
    assert tomllib.loads(app.state.store.blobs.read_bytes(saved.sha256).decode())["times"]["shift_start"] == "05:00"
    watched.well()
    watched.open("/plan")
    until(page, lambda: page.input_value("select[name=farms]") == "Hof Süd")
    app.state.store.delete_file("farm", "Hof Süd")
    page.reload()
    page.wait_for_selector("text=Earlier plans")
    assert page.input_value("select[name=farms]") == "", "what is gone is not chosen"


def test_a_plan_begins_with_the_tractors_and_the_width_of_its_farm(service: Service) -> None:
    watched, app = service
    app.state.store.add_file("farm", "own", read_example_text("farm").encode())
    page = watched.open("/plan")
    page.wait_for_selector("text=Earlier plans")

    def read_values() -> tuple[str, str]:
        return page.input_value("[name=tractors]"), page.input_value("[name=width]")

    own = read_values()
    assert own == ("1-3", "3")
    page.select_option("select[name=farms]", "own")
    assert read_values() == ("", ""), "as the farm has them"
    page.select_option("select[name=farms]", "")
    assert read_values() == own
    page.fill("[name=width]", "4")
    page.select_option("select[name=farms]", "own")
    assert read_values() == ("", "4")
    page.click("text=Run the plan")
    page.wait_for_selector("text=Waiting for its turn.")
    request = app.state.store.list_jobs("plan")[0].request
    assert request["width"] == 4 and "tractors" not in request
    watched.well()


@pytest.mark.matrix
def test_every_choice_of_a_plan_is_asked_and_asked_again(service: Service, tmp_path: Path) -> None:
    watched, app = service
    store = app.state.store
    store.add_file("farm", "own", read_example_text("farm").encode())
    write_features(tmp_path / "mast.geojson", *MAST_FIELD)
    page = watched.open("/plan")
    page.click("summary:has-text('How the file is read')")
    page.set_input_files("input[aria-label='Add a file: Field']", tmp_path / "mast.geojson")
    page.wait_for_function("() => document.querySelector('select[name=fields]').value === 'mast'")
    page.check("input[name=local]")
    page.wait_for_selector("text=1: Strommast")
    page.uncheck("[name=keep]")
    page.select_option("select[name=farms]", "own")
    page.wait_for_selector("[name=implement] option:text-is('drill')", state="attached")
    page.select_option("[name=implement]", "drill")
    page.select_option("[name=farm_tractor]", "EG105")
    page.select_option("[name=headland_order]", "headland_last")
    page.fill("[name=headland_passes]", "2")
    page.select_option("[name=corners]", "round")
    open_all_details(page)
    page.fill("[name=min_speed_kmh]", "4,5")
    page.fill("[name=max_speed_kmh]", "3")
    page.fill("[name=overhang]", "0.2")
    page.fill("[name=obstacle]", "20,20,2; 30,30")
    page.click("text=Run the plan")
    page.wait_for_selector("[aria-invalid=true]")
    watched.said.clear()
    page.fill("[name=max_speed_kmh]", "9")
    page.click("text=Run the plan")
    page.wait_for_selector("text=Waiting for its turn.")
    first = store.list_jobs("plan")[0].request
    expected = {
        "field": "mast", "local": True, "ignore": ["Strommast"], "farm": "own", "implement": "drill",
        "tractor": "EG105", "headland_last": True, "headland_passes": 2, "corners": "round",
        "min_speed_kmh": 4.5, "max_speed_kmh": 9,
        "overhang": 0.2, "obstacle": ["20,20,2", "30,30"], "strategies": "split-field,interleaved",
    }  # fmt: skip
    assert first | expected == first
    page.click("text=Cancel")
    page.click("text=Change and plan again")
    page.wait_for_selector("text=1: Strommast")
    page.wait_for_selector("[name=implement] option:text-is('drill')", state="attached")
    page.click("text=Run the plan")
    page.wait_for_selector("text=Waiting for its turn.")
    assert store.list_jobs("plan")[0].request == first, "nothing is lost on the way back"
