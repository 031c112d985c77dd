"""Maps of the pages in a real browser: backgrounds, drawing and changing fields, places set by a click, legends."""

import io
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fastapi import FastAPI
from PIL import Image
from playwright.sync_api import Browser, Page

from fields.documents.reader import read_field
from fields.geometry.geodesy import project
from planner.service.backgrounds.tile_server import place_metres
from planner.service.settings import ServiceSettings
from tests.drawn_fields import feature, point, ring, write_features
from tests.service.fake_service import Made
from tests.service.one_process import create_app
from tests.service.tiles import TileHost, paint_tile, serve_tiles, write_mbtiles
from tests.service.watching import NARROW, WIDE, WatchedPage, until, watch_app

pytestmark = pytest.mark.slow
PREVIEW, EDITOR = "canvas[aria-label^='Map of the chosen field']", "canvas[aria-label^='Drawing of the field']"
MIDDLE, ACCENT = {"width": 768, "height": 900}, (58, 101, 39)
MAPS = {"/": 1, "/fleet/f1": 1, "/fleet/f1/tractor/2": 1, "/plan": 1, "/plan/old": 1, "/replay/f1": 1}


class MapService:
    """A service of its own with a tile server as background, a page that plans, and its app."""

    def __init__(self, page: WatchedPage, app: FastAPI, host: TileHost, folder: Path) -> None:
        self.watched, self.app, self.host, self.folder = page, app, host, folder

    def open_plan(self, field: str = "netherlands") -> Page:
        """The plan form with a field whose place is known."""
        page = self.open_form()
        page.select_option("select[name=fields]", field)
        page.wait_for_selector(".map button:has-text('Background'):visible")
        return page

    def open_form(self) -> Page:
        """The plan form, loaded anew."""
        self.watched.open("/plan")
        self.watched.page.reload()
        self.watched.page.wait_for_selector("select[name=fields] option", state="attached")
        return self.watched.page

    def read_saved(self, name: str) -> tuple[dict[str, Any], Any]:
        """A stored field as GeoJSON, and as the reader has it."""
        row = self.app.state.store.get_file("field", name)
        content = self.app.state.store.blobs.read_bytes(row.sha256)
        (path := self.folder / f"{name}.geojson").write_bytes(content)
        return json.loads(content), read_field(path, **row.options)


@pytest.fixture(scope="module")
def service(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[MapService]:
    folder = tmp_path_factory.mktemp("maps")
    with serve_tiles() as host:
        shown = {"background": host.address, "background_attribution": "© Makers of tiles"}
        # A browser that many tests share asks as often as the machine is quick.
        settings = ServiceSettings(data=folder / "data", workers=0, rate_per_minute=10**6, **shown)  # type: ignore[arg-type]
        app = create_app(settings, reads_inline=True)
        with watch_app(browser, app, "planner") as watched:
            yield MapService(watched, app, host, folder)


def read_pixel(page: Page, canvas: str, x: int, y: int) -> tuple[int, ...]:
    """The colour of a map at a place, pixels from its top left."""
    picture = Image.open(io.BytesIO(page.locator(canvas).screenshot())).convert("RGB")
    colour = picture.getpixel((x, y))
    assert isinstance(colour, tuple)
    return tuple(int(one) for one in colour)


@pytest.mark.slow
def test_a_background_is_off_until_it_is_switched_on_and_then_remembered(service: MapService) -> None:
    page, host = service.open_plan(), service.host
    page.wait_for_timeout(200)
    assert host.paths == [] and page.locator(".credit").first.is_hidden()
    before = read_pixel(page, PREVIEW, 12, 150)
    page.click(".map button:has-text('Background')")
    until(page, lambda: bool(service.host.paths))
    count = -1
    while count != len(service.host.paths):
        count = len(service.host.paths)
        page.wait_for_timeout(300)
    assert page.locator(".credit:visible").inner_text() == "© Makers of tiles"
    assert page.locator("button[aria-pressed=true]:has-text('Background')").count() == 1
    after = read_pixel(page, PREVIEW, 12, 150)
    assert after != before and len(set(after)) > 1, "the colour of a tile"
    asked = len(host.paths)
    assert asked == len(set(host.paths)) < 40, "no tile twice"
    page = service.open_plan()
    page.wait_for_selector(".credit:visible")
    page.wait_for_timeout(300)
    assert len(host.paths) == asked, "kept by the service and by the browser"
    page.click(".map button:has-text('Background')")
    assert page.locator(".credit:visible").count() == 0
    service.watched.well()  # and nobody but the service was asked


def test_tiles_lie_where_proj_says_to_a_pixel(service: MapService) -> None:
    page = service.open_plan()
    field = read_field("netherlands")
    assert field.crs is not None
    shown = page.evaluate(
        """async ([crs, origin]) => {
          const { placementOf } = await import("./static/js/background.js");
          const placement = await placementOf(crs, origin, [100, 200]);
          return [[0, 0], [310, 420], [-900, 1500]].map((p) => [placement.toMercator(...p), placement.toDegrees(...p),
            placement.fromDegrees(...placement.toDegrees(...p))]); }""",
        [field.crs, list(field.origin_m)],
    )
    metres = np.array([[0.0, 0.0], [310.0, 420.0], [-900.0, 1500.0]])
    places = metres + np.asarray(field.origin_m)
    assert np.abs(np.array([one[0] for one in shown]) - project(places, field.crs, "EPSG:3857")).max() < 0.002
    assert np.abs(np.array([one[1] for one in shown]) - project(places, field.crs, "EPSG:4326")).max() < 1e-8
    assert np.abs(np.array([one[2] for one in shown]) - metres).max() < 0.002
    assert place_metres(field.crs, *places[0].tolist()).error_m < 0.002


def click_map(page: Page, canvas: str, share_x: float, share_y: float) -> None:
    """Click a place of a map by its share of width and height."""
    box = page.locator(canvas).bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + share_x * box["width"], box["y"] + share_y * box["height"])


def test_entrance_refill_and_obstacles_are_set_by_a_click(service: MapService) -> None:
    page = service.open_plan()
    page.locator(PREVIEW).scroll_into_view_if_needed()
    page.click("button:text-is('Entrance')")
    click_map(page, PREVIEW, 0.5, 0.16)
    page.wait_for_selector("[role=status]:has-text('Entrance: 4.5')")
    assert page.locator("button[aria-pressed=true]:text-is('Entrance')").count() == 0, "set once"
    page.click("button:text-is('Refill place')")
    click_map(page, PREVIEW, 0.5, 0.95)
    page.click("button:text-is('Obstacle')")
    click_map(page, PREVIEW, 0.49, 0.5)
    click_map(page, PREVIEW, 0.51, 0.6)
    values = {name: page.input_value(f"input[name={name}]") for name in ("entrance", "refill", "obstacle")}
    entrance, refill = ([float(one) for one in values[name].split(",")] for name in ("entrance", "refill"))
    assert entrance[0] == pytest.approx(4.5796, abs=0.002) and entrance[1] > refill[1] > 52.11
    assert [len(one.split(",")) for one in values["obstacle"].split("; ")] == [3, 3]
    page.eval_on_selector("input[name=refill]", "(one) => { one.value = ''; one.dispatchEvent(new Event('input')); }")
    page.click("text=Run the plan")  # without refills, as no implement here carries anything
    page.wait_for_selector("text=Waiting for its turn.")
    asked = service.app.state.store.list_jobs("plan")[0].request
    assert asked["entrance"] == values["entrance"] and asked["obstacle"] == values["obstacle"].split("; ")
    page.click("text=Cancel")
    page.wait_for_selector("text=It was cancelled.")
    page = service.open_plan()
    page.click("button:text-is('Obstacle')")
    click_map(page, PREVIEW, 0.5, 0.5)
    page.click("button:text-is('Clear')")
    assert page.input_value("input[name=obstacle]") == ""
    service.watched.well()


def find_chosen_point(page: Page) -> tuple[float, float]:
    """Where the chosen point is on the page: the middle of what has the colour of chosen points."""
    canvas = page.locator(EDITOR)
    canvas.scroll_into_view_if_needed()
    page.wait_for_timeout(100)
    box = canvas.bounding_box()
    assert box is not None
    colours = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("RGB"))[60:]
    rows, columns = np.nonzero((colours == ACCENT).all(axis=2))
    assert len(rows) > 50
    return box["x"] + float(columns.mean()), box["y"] + 60 + float(rows.mean())


def type_points(page: Page, *points: tuple[float, float]) -> None:
    """Points by keys alone: fields for the coordinates and Enter."""
    for east, north in points:
        page.fill("[aria-label='Metres east']", str(east))
        page.fill("[aria-label='Metres north']", str(north))
        page.keyboard.press("Enter")


def choose_kind(page: Page, words: str) -> None:
    page.select_option("[aria-label='What to draw']", label=words)


def test_a_field_with_everything_is_drawn_and_read(service: MapService) -> None:
    page = service.open_form()
    page.click("summary:has-text('Draw a field')")
    page.fill("input[placeholder='12.345, 51.678']", "10.5, 52.25")
    page.keyboard.press("Enter")
    page.wait_for_selector("text=Type longitude and latitude")
    type_points(page, (0, 0), (200, 0), (200, 120), (0, 120))
    page.wait_for_selector("text=4 corners, 2.40\xa0ha")
    choose_kind(page, "Hole")
    type_points(page, (20, 20), (30, 20), (30, 30), (20, 30))
    choose_kind(page, "Obstacle: a point")
    type_points(page, (100, 60))
    page.locator(".editor").get_by_label("Radius, m").fill("2.5")
    page.locator(".editor").get_by_label("Its name").fill("Mast")
    page.locator(".editor").get_by_label("Its name").press("Enter")
    type_points(page, (150, 60))
    choose_kind(page, "Obstacle: an area")
    type_points(page, (60, 80), (70, 80), (70, 90))
    choose_kind(page, "Entrance")
    type_points(page, (5, 5), (0, 10))
    choose_kind(page, "Refill place")
    type_points(page, (200, 60))
    choose_kind(page, "Fence along the edge")
    type_points(page, (0, 120), (200, 120))
    choose_kind(page, "Guidance line")
    type_points(page, (0, 50), (200, 60))
    page.locator(".editor").get_by_label("Its name").fill("A-B")
    page.locator(".editor").get_by_label("Its name").press("Enter")
    of_lines = ("dashed, thick: fence", "dash and dot: guidance line")
    for words in ("obstacle", "obstacle: a point, as wide as it is", "entrance", "refill place", *of_lines):
        assert page.locator(f".editor .legend li:text-is('{words}')").count() == 1
    page.locator(".editor").get_by_label("Name", exact=True).fill("drawn")
    page.click("text=Use this field")
    until(page, lambda: page.input_value("select[name=fields]") == "drawn")
    _, field = service.read_saved("drawn")
    assert field.crs == "EPSG:32632" and field.boundary.area == pytest.approx(24_000 - 100, abs=0.2)
    sizes = sorted(round(one.half_width_m, 3) for one in field.obstacles)
    assert sizes == [0.0, 1.0, 2.5] and {one.name for one in field.obstacles} == {"Mast", ""}
    assert len(field.fences) == 1 and 195 < field.fences[0].length < 210
    assert [line.name for line in field.guidance_lines] == ["A-B"]
    degrees = field.to_wgs84(np.array([field.entrance, field.service_point]))
    assert np.hypot(*(degrees[0] - [10.5, 52.25])) < 2e-4 and field.service_point is not None
    assert field.remarks == ()
    service.watched.well()


def test_an_uploaded_field_is_changed_by_pointer_and_keys_and_replaced(service: MapService, tmp_path: Path) -> None:
    outline = feature(ring((10.0, 52.0), (10.003, 52.0), (10.003, 52.002), (10.0, 52.002)), name="West field")
    tree = feature(point(10.0015, 52.001), role="obstacle", kind="tree", radius_m=1.5)
    content = write_features(tmp_path / "west.geojson", outline, tree).read_bytes()
    service.app.state.store.add_file("field", "west", content, ".geojson")
    _, before = service.read_saved("west")
    page = service.open_plan("west")
    page.click("text=Change this field")
    page.wait_for_selector("button:has-text('Replace west')")
    page.wait_for_selector("text=4 corners")
    page.select_option("[aria-label='Chosen point']", index=1)
    x, y = (float(page.input_value(f"[aria-label='{name}']")) for name in ("Metres east", "Metres north"))
    page.fill("[aria-label='Metres east']", str(x - 10))
    page.click("text=Move it there")
    page.focus(EDITOR)
    page.keyboard.press("Shift+ArrowUp")
    assert float(page.input_value("[aria-label='Metres north']")) == pytest.approx(y + 1, abs=0.01)
    page.click("button:text-is('Undo')")
    page.select_option("[aria-label='Chosen point']", index=5)
    x_px, y_px = find_chosen_point(page)
    page.mouse.move(x_px, y_px)
    page.mouse.down()
    page.mouse.move(x_px + 30, y_px + 5, steps=4)
    page.mouse.up()
    page.click("button:has-text('Replace west')")
    until(page, lambda: service.app.state.store.get_file("field", "west").size != len(content))
    text, after = service.read_saved("west")
    assert after.name == "West field" and text["features"][1]["properties"]["kind"] == "tree"
    assert after.obstacles[0].half_width_m == 1.5
    moved_m = after.obstacles[0].geometry.distance(before.obstacles[0].geometry)
    assert 5.0 < moved_m < 60.0, "by the pointer"
    corners = np.asarray(after.boundary.exterior.coords) + after.origin_m
    old = np.asarray(before.boundary.exterior.coords) + before.origin_m
    gaps = np.array([np.hypot(*(old - corner).T).min() for corner in corners[:-1]])
    assert sorted(gaps.round(1).tolist()) == [0.0, 0.0, 0.0, 10.0]
    service.watched.well()


@pytest.mark.slow
def test_points_are_inserted_and_removed_and_all_is_undone(service: MapService) -> None:
    page = service.open_form()
    page.click("summary:has-text('Draw a field')")
    type_points(page, (0, 0), (200, 0), (200, 100), (0, 100))
    page.select_option("[aria-label='Chosen point']", index=2)
    page.focus(EDITOR)
    page.keyboard.press("Delete")
    page.wait_for_selector("text=3 corners, 1.00\xa0ha")
    page.click("button:text-is('Undo')")
    page.wait_for_selector("text=4 corners, 2.00\xa0ha")
    page.click("button:text-is('Remove shape')")
    page.wait_for_selector("text=0 so far")
    for _ in range(6):
        if page.locator("button:text-is('Undo')").is_enabled():
            page.click("button:text-is('Undo')")
    assert page.locator("button:text-is('Undo')").is_disabled()
    assert page.locator("text=Use this field").is_disabled()
    for share in ((0.3, 0.3), (0.7, 0.3), (0.7, 0.7)):
        click_map(page, EDITOR, *share)
    page.wait_for_selector("text=3 corners")
    click_map(page, EDITOR, 0.5, 0.3)  # the middle of an edge of the chosen shape
    page.wait_for_selector("text=4 corners")
    typed = [float(page.input_value(f"[aria-label='Metres {way}']")) for way in ("east", "north")]
    first = page.locator("[aria-label='Chosen point'] option").nth(2).inner_text()
    assert first.startswith("Boundary 2") and f"{typed[0]:.1f}" in first, "between the first two, and chosen"
    service.watched.well()


@pytest.mark.slow
@pytest.mark.matrix
def test_a_file_of_tiles_is_a_background_without_any_server(browser: Browser, tmp_path: Path) -> None:
    from math import asinh, floor, pi, radians, tan

    lon, lat = 4.5796, 52.1176
    zoom = 16
    column = floor((lon + 180) / 360 * 2**zoom)
    row = floor((1 - asinh(tan(radians(lat))) / pi) / 2 * 2**zoom)
    tiles = {(zoom, column + i, row + j): paint_tile(column + i, row + j) for i in range(-2, 3) for j in range(-2, 3)}
    path = write_mbtiles(tmp_path / "farm.mbtiles", tiles, format="png", attribution="Farm drone")
    app = create_app(ServiceSettings(data=tmp_path / "data", workers=0, background=str(path)), reads_inline=True)
    with watch_app(browser, app, "planner") as watched:
        page = watched.open("/plan")
        page.select_option("select[name=fields]", "netherlands")
        page.click(".map button:has-text('Background'):visible")
        page.wait_for_function("() => document.querySelector('.credit').textContent === 'Farm drone'")
        page.wait_for_timeout(500)
        colours = {read_pixel(page, PREVIEW, x, 150)[:2] for x in (12, 180, 350)}
        assert len(colours) > 1, "tiles of several colours"
        watched.well()


@pytest.mark.slow
@pytest.mark.parametrize(
    "path", [pytest.param(path, marks=pytest.mark.matrix if place % 2 else ()) for place, path in enumerate(MAPS)]
)
def test_every_map_has_scale_north_zoom_and_a_legend_at_every_width(
    watched: WatchedPage, pages: tuple[str, Made], path: str
) -> None:
    page = watched.open(path)
    page.wait_for_selector(".map canvas")
    page.wait_for_selector(".legend li")
    for size in (NARROW, MIDDLE, WIDE):
        page.set_viewport_size(size)  # type: ignore[arg-type]
        page.wait_for_timeout(100)
        drawn = page.evaluate("""async () => {
          const seen = [], write = CanvasRenderingContext2D.prototype.fillText;
          CanvasRenderingContext2D.prototype.fillText = function (words, ...more) {
            seen.push(words);
            return write.call(this, words, ...more);
          };
          const press = (name) => document.querySelector(`.map [aria-label="${name}"]`).click();
          ["Zoom in", "Zoom out", "Show all"].forEach(press);
          await new Promise((done) => setTimeout(done, 200));
          CanvasRenderingContext2D.prototype.fillText = write;
          return seen; }""")
        assert "N" in drawn and any(one.endswith((" m", " km")) for one in drawn)
        assert page.evaluate("document.querySelector('.map').getBoundingClientRect().right") <= size["width"]
        assert page.locator(".legend li:visible").count() >= 1
        signs = page.evaluate(
            "[...document.querySelectorAll('.legend .swatch')].every((one) => one.getBoundingClientRect().width > 20)"
        )
        assert signs
    page.set_viewport_size(WIDE)
    watched.well()
