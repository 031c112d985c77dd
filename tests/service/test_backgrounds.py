"""Backgrounds of maps: the grid against PROJ, addresses, files, what is kept, and hostile servers and templates."""

import asyncio
import io
import os
import sqlite3
import struct
import sys
import time
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import rasterio
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from pyproj import Transformer
from starlette.testclient import TestClient

from fields.arrays import Floats
from planner.service.backgrounds.map_background import MapBackground
from planner.service.backgrounds.tile_server import (
    CACHE_FOLDER,
    HALF_WIDTH_M,
    MOST_TILE_BYTES,
    Tile,
    TileAddress,
    TileCache,
    TileError,
    place_degrees,
    place_metres,
)
from planner.service.errors import ServiceError
from planner.service.settings import ServiceSettings
from tests.examples import count_examples
from tests.service.conftest import HERE, bearer
from tests.service.one_process import create_app
from tests.service.tiles import Answer, answer_png, paint_tile, serve_tiles, write_mbtiles

TILE = Tile(16, 33601, 21613)
TEMPLATE = "https://tiles.example/{z}/{x}/{y}.png"
PNG = {"content-type": "image/png"}
HEADER = b"IHDR" + struct.pack(">IIBBBBB", 60_000, 60_000, 8, 2, 0, 0, 0)
BOMB = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + HEADER + struct.pack(">I", zlib.crc32(HEADER)) + bytes(1_000)
SVG = b'<svg xmlns="http://www.w3.org/2000/svg"><script/></svg>'
NO_TILES = (
    ((200, PNG, b"<!doctype html><script>alert(1)</script>" + b" " * 600), "something other than a PNG"),
    ((200, {"content-type": "image/svg+xml"}, SVG), "something other than a PNG"),
    ((200, PNG, paint_tile(0, 0) + bytes(2 * MOST_TILE_BYTES)), "larger than 2 MB"),
    ((200, PNG, paint_tile(0, 0, 1_300)), "1300 x 1300 pixels"),
    ((302, {"location": "http://127.0.0.1:1/secret"}, b""), "status 302"),
    ((200, PNG | {"content-encoding": "gzip"}, b"\x1f\x8b" + bytes(100)), "compressed pictures"),
    ((200, PNG, paint_tile(0, 0)[:20]), "something other than a PNG"),
    ((200, PNG, BOMB), "pixels|something other"),
)
IMPOSSIBLE_PLACES = (
    "crs=EPSG:32631&easting=500000", "longitude=4", "longitude=4&latitude=52&crs=EPSG:32631",
    "longitude=181&latitude=0", "longitude=0&latitude=89", "crs=EPSG:999999&easting=0&northing=0",
    "crs=/etc/passwd&easting=0&northing=0", "crs=EPSG:32631&easting=nan&northing=0",
    "crs=EPSG:32631&easting=9e7&northing=-9e7",
)  # fmt: skip


def make_settings(folder: Path, background: str | Path, **more: object) -> ServiceSettings:
    return ServiceSettings(data=folder / "data", workers=0, background=str(background), **more)  # type: ignore[arg-type]


def read_tiles(background: MapBackground, *tiles: Tile) -> list[tuple[bytes, str] | None]:
    """Tiles asked for at once; the connection to the server is closed afterwards."""

    async def read_all() -> list[tuple[bytes, str] | None]:
        try:
            return list(await asyncio.gather(*(background.read_tile(tile) for tile in tiles)))
        finally:
            await background.close()

    return asyncio.run(read_all())


def evaluate_polynomial(coefficients: list[list[float]], points_m: Floats) -> Floats:
    """What a page makes of the coefficients of a placement, in the order that the API tells, at points (n, 2)."""
    u, v = points_m.T / 1000.0
    terms = np.stack([u**0, u, v, u**2, u * v, v**2, u**3, u**2 * v, u * v**2, v**3], axis=1)
    values: Floats = terms @ np.array(coefficients).T
    return values


@settings(max_examples=count_examples(25))
@given(
    st.sampled_from(["EPSG:32632", "EPSG:32654", "EPSG:32719", "EPSG:28992", "EPSG:2180"]),
    st.floats(-2e5, 2e5),
    st.floats(-2e5, 2e5),
)
def test_metres_of_a_field_lie_where_proj_says(crs: str, east_m: float, north_m: float) -> None:
    base = {"EPSG:32632": (5e5, 5.6e6), "EPSG:32654": (5e5, 4.7e6), "EPSG:32719": (5e5, 6.2e6)}
    middle = base.get(crs, (155_000.0, 463_000.0) if crs == "EPSG:28992" else (5e5, 5e5))
    scale = 0.1 if crs == "EPSG:28992" else 1.0
    placement = place_metres(crs, middle[0] + scale * east_m, middle[1] + scale * north_m)
    points = np.random.default_rng(7).uniform(-placement.reach_m, placement.reach_m, (200, 2))
    x, y = Transformer.from_crs(crs, "EPSG:3857", always_xy=True).transform(*(points + placement.origin_m).T)
    found = evaluate_polynomial(placement.to_mercator, points) + placement.mercator_m
    assert np.abs(found - np.column_stack([x, y])).max() < 0.002, "within 2 mm at 6 km"
    assert np.abs(evaluate_polynomial(placement.to_metres, found - placement.mercator_m) - points).max() < 0.002
    assert placement.error_m < 0.002


def test_a_field_across_180_degrees_is_one_piece() -> None:
    placement = place_degrees(179.99, -17.0)
    offset = evaluate_polynomial(placement.to_mercator, np.array([[5_000.0, 0.0]]))
    assert 5_000.0 < offset[0, 0] < 5_400.0


def test_bounds_of_a_tile_are_those_of_the_web_grid() -> None:
    west, south, east, north = TILE.compute_bounds_m()
    assert east - west == pytest.approx(2 * HALF_WIDTH_M / 2**16) == pytest.approx(north - south)
    lon, lat = Transformer.from_crs("EPSG:3857", "EPSG:4326", always_xy=True).transform(west, north)
    assert (lon, lat) == pytest.approx(
        (33601 / 2**16 * 360 - 180, np.degrees(np.arctan(np.sinh(np.pi * (1 - 2 * 21613 / 2**16)))))
    )
    assert Tile(0, 0, 0).compute_bounds_m() == pytest.approx((-HALF_WIDTH_M, -HALF_WIDTH_M, HALF_WIDTH_M, HALF_WIDTH_M))


@pytest.mark.parametrize(
    ("template", "url"),
    [
        (TEMPLATE, "https://tiles.example/16/33601/21613.png"),
        ("http://10.0.0.7:8080/{z}/{x}/{-y}.jpg?key=a%20b", "http://10.0.0.7:8080/16/33601/43922.jpg?key=a%20b"),
        ("https://maps.example/?M={TileMatrix}&R={TileRow}&C={TileCol}", "https://maps.example/?M=16&R=21613&C=33601"),
    ],
)
def test_addresses_of_xyz_tms_wmts_and_wms(template: str, url: str) -> None:
    assert TileAddress(template).build_url(TILE) == url
    url = TileAddress("https://maps.example/wms?BBOX={bbox}&WIDTH={width}&HEIGHT={height}").build_url(TILE)
    bounds = [float(one) for one in url.split("BBOX=")[1].split("&")[0].split(",")]
    assert bounds == pytest.approx(TILE.compute_bounds_m(), abs=1e-6) and url.endswith("&WIDTH=256&HEIGHT=256")


@pytest.mark.parametrize(
    ("template", "said"),
    [
        ("https://{s}.tiles.example/{z}/{x}/{y}.png", "has {s}"),
        ("https://{x}.tiles.example/{z}/{x}/{y}.png", "names no single host"),
        ("https://tiles.example@{x}/{z}/{y}", "names no single host"),
        ("https://user:secret@tiles.example/{z}/{x}/{y}.png", "holds a name and a password"),
        ("file:///etc/{z}/{x}/{y}", "is not an address of the web"),
        ("ftp://tiles.example/{z}/{x}/{y}", "is not an address of the web"),
        ("javascript:alert({z}{x}{y})", "is not an address of the web"),
        ("https:///{z}/{x}/{y}", "names no host"),
        ("http://169.254.169.254/latest/{z}/{x}/{y}", "where no map can be"),
        ("http://[fe80::1]/{z}/{x}/{y}", "where no map can be"),
        ("http://0.0.0.0/{z}/{x}/{y}", "where no map can be"),
        ("http://[::1/{z}/{x}/{y}", "has a host or port that cannot be"),
        ("https://user:secret@tiles.example:port/{z}/{x}/{y}", "has a host or port that cannot be"),
        ("https://tiles..example/{z}/{x}/{y}", "is no host that can be"),
        ("https://tiles.example/tile.png", "does not say which tile"),
        ("https://tiles.example/{z}/{x}.png", "does not say which tile"),
        ("https://tiles.example/{z}/{x}/{y} .png", "characters that an address cannot have"),
        ("https://tiles.example/{z}/{x}/{y}\nHost: other", "characters that an address cannot have"),
        ("https://tiles.example\\@other.example/{z}/{x}/{y}", "characters that an address cannot have"),
        ("https://tiles.example/{z}/{x}/{y}" + "a" * 1_000, "at most 1000"),
        ("/etc/passwd", "neither an address nor an .mbtiles or .tif file"),
        ("../none.mbtiles", "There is no background"),
    ],
)
def test_wrong_backgrounds_are_refused_in_a_sentence(tmp_path: Path, template: str, said: str) -> None:
    with pytest.raises(ServiceError, match="background") as refusal:
        MapBackground(make_settings(tmp_path, template))
    assert said in str(refusal.value) and "secret" not in str(refusal.value) and refusal.value.parameter == "background"


@pytest.mark.parametrize("tile", [(-1, 0, 0), (23, 0, 0), (3, 8, 0), (3, 0, -1)])
def test_tiles_outside_the_grid_are_refused(tile: tuple[int, int, int]) -> None:
    with pytest.raises(ServiceError, match="use 0 to"):
        Tile(*tile)


def test_a_tile_is_fetched_once_kept_over_a_restart_and_renewed_when_it_is_old(tmp_path: Path) -> None:
    def read_again() -> tuple[bytes, str] | None:
        return read_tiles(MapBackground(make_settings(tmp_path, host.address)), TILE)[0]

    with serve_tiles() as host:
        first, second = read_tiles(MapBackground(make_settings(tmp_path, host.address)), TILE, TILE)
        assert first is not None and first == second and first[1] == "image/png"
        assert first[0] == paint_tile(TILE.column, TILE.row) and host.paths == ["/16/33601/21613.png"]
        sent = host.headers[0]
        assert "Headland" in sent["user-agent"] and not {"cookie", "referer", "authorization"} & sent.keys()
        assert read_again() == first and len(host.paths) == 1
        [kept] = [path for path in (tmp_path / "data" / CACHE_FOLDER).rglob("*") if path.is_file()]
        os.utime(kept, (0.0, 0.0))
        host.answer = lambda _: (200, {}, paint_tile(1, 1))
        renewed = read_again()
        assert renewed is not None and renewed[0] == paint_tile(1, 1)
        os.utime(kept, (0.0, 0.0))
        host.answer = lambda _: (500, {}, b"")
        assert read_again() == renewed
    assert read_again() == renewed, "kept tiles do without the server"


@pytest.mark.parametrize(("answer", "said"), NO_TILES)
def test_what_is_no_picture_of_a_tile_is_neither_sent_nor_kept(tmp_path: Path, answer: Answer, said: str) -> None:
    with serve_tiles() as host:
        host.answer = lambda _: answer
        background = MapBackground(make_settings(tmp_path, host.address))
        with pytest.raises(TileError, match=said):
            read_tiles(background, TILE)
        assert host.paths == ["/16/33601/21613.png"], "no redirection is followed"
    assert [path for path in (tmp_path / "data").rglob("*") if path.is_file()] == []


def test_a_failing_server_is_left_in_peace_for_a_while(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with serve_tiles() as host:
        background = MapBackground(make_settings(tmp_path, host.address))
        host.answer = lambda _: (500, {}, b"")
        with pytest.raises(TileError, match="answers with status 500"):
            read_tiles(background, TILE)
        host.answer = answer_png
        with pytest.raises(TileError, match="answers with status 500"):
            read_tiles(background, TILE)
        assert len(host.paths) == 1
        monkeypatch.setattr("planner.service.backgrounds.tile_server.PAUSE_S", 0.0)
        assert read_tiles(background, TILE) != [None]


def test_a_server_that_is_gone_or_slow_costs_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with serve_tiles() as host:
        gone = host.address
    with pytest.raises(TileError, match=r"127\.0\.0\.1 cannot be reached"):
        read_tiles(MapBackground(make_settings(tmp_path, gone)), TILE)
    monkeypatch.setattr("planner.service.backgrounds.tile_server.TILE_TIMEOUT_S", 0.2)
    with serve_tiles() as host:
        host.answer = lambda path: (time.sleep(0.6), answer_png(path))[1]  # type: ignore[func-returns-value]
        with pytest.raises(TileError, match=r"cannot be reached|too slow"):
            read_tiles(MapBackground(make_settings(tmp_path, host.address)), TILE)


def test_the_room_for_tiles_is_kept_and_the_oldest_go_first(tmp_path: Path) -> None:
    now = [1_000.0]
    cache = TileCache(tmp_path, "a", 10_000, clock=lambda: now[0])
    for column in range(12):
        now[0] += 10.0
        cache.keep_tile(Tile(8, column, 0), bytes(1_000))
        assert cache.read_tile(Tile(8, 0, 0)) is not None, "used all the time"
        assert sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) <= 10_000
    assert cache.read_tile(Tile(8, 1, 0)) is None and cache.read_tile(Tile(8, 11, 0)) == (bytes(1_000), 0.0)
    cache.keep_tile(Tile(8, 50, 0), bytes(20_000))
    assert cache.read_tile(Tile(8, 50, 0)) is None
    assert TileCache(tmp_path, "b", 10_000).read_tile(Tile(8, 11, 0)) is None, "another background"


def test_mbtiles_are_read_with_their_rows_from_the_south(tmp_path: Path) -> None:
    path = write_mbtiles(
        tmp_path / "farm.mbtiles", {(16, 33601, 21613): paint_tile(1, 2)},
        format="png", attribution="Drone of the farm", bounds="4.5,52.1,4.6,52.2",
    )  # fmt: skip
    background = MapBackground(make_settings(tmp_path, path))
    found, missing = read_tiles(background, TILE, Tile(16, 33602, 21613))
    assert found is not None and found[0] == paint_tile(1, 2) and missing is None
    assert background.facts.attribution == "Drone of the farm" and background.facts.bounds_deg == (4.5, 52.1, 4.6, 52.2)


def write_geotiff(path: Path, crs: str | None, corner_m: tuple[float, float], kind: str = "uint8") -> Path:
    """A picture of 400 x 400 m with pixels of 0.5 m: red in its south-western quarter, else green."""
    colours = np.zeros((3, 800, 800), dtype=kind)
    colours[1] = 200
    colours[:, 400:, :400] = np.array([220, 0, 0], dtype=kind)[:, None, None]
    place = rasterio.Affine(0.5, 0.0, corner_m[0], 0.0, -0.5, corner_m[1])
    with rasterio.open(
        path, "w", driver="GTiff", width=800, height=800, count=3, dtype=kind, crs=crs, transform=place
    ) as picture:
        picture.write(colours)
    return path


def write_no_database(path: Path) -> None:
    path.write_bytes(b"not a database at all" * 100)


def write_other_tables(path: Path) -> None:
    with sqlite3.connect(path) as database:
        database.execute("CREATE TABLE notes (text TEXT)")
    database.close()


@pytest.mark.parametrize(
    ("file", "write", "said"),
    [
        ("it.mbtiles", write_no_database, "cannot be read as MBTiles"),
        (
            "it.mbtiles",
            partial(write_mbtiles, tiles={(1, 0, 0): b"pbf"}, format="pbf"),
            "of it.mbtiles are 'pbf'",
        ),
        ("it.mbtiles", partial(write_mbtiles, tiles={}, format="png"), "has no tiles"),
        ("it.mbtiles", write_other_tables, "cannot be read as MBTiles"),
        ("it.tif", write_no_database, "cannot be read as a GeoTIFF"),
        ("it.tif", partial(write_geotiff, crs=None, corner_m=(0.0, 400.0)), "where on the earth"),
        ("it.tif", partial(write_geotiff, crs="EPSG:32631", corner_m=(0.0, 400.0), kind="uint16"), "-ot Byte"),
    ],
)
def test_files_that_are_no_backgrounds_are_refused(
    tmp_path: Path, file: str, write: Callable[[Path], object], said: str
) -> None:
    write(path := tmp_path / file)
    with pytest.raises(ServiceError, match=said):
        MapBackground(make_settings(tmp_path, path))


def test_tiles_in_a_file_that_are_too_large_or_text_are_refused(tmp_path: Path) -> None:
    tiles = {(1, 0, 0): bytes(MOST_TILE_BYTES + 1), (1, 1, 0): b"<html>", (1, 0, 1): b""}
    background = MapBackground(make_settings(tmp_path, write_mbtiles(tmp_path / "it.mbtiles", tiles, format="png")))
    with pytest.raises(TileError, match="larger than 2 MB"):
        read_tiles(background, Tile(1, 0, 0))
    with pytest.raises(TileError, match="something other than a PNG"):
        read_tiles(background, Tile(1, 1, 0))
    assert read_tiles(background, Tile(1, 0, 1)) == [None]


def test_a_geotiff_of_utm_lies_where_proj_says_and_takes_its_library(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    west_m, north_m = 608_000.0, 5_775_500.0
    write_geotiff(path := tmp_path / "o.tif", "EPSG:32631", (west_m, north_m))
    background = MapBackground(make_settings(tmp_path, path))
    facts = background.facts
    assert facts is not None and 17 <= facts.most_zoom <= 19 and facts.kind == "geotiff"
    zoom, side_m = facts.most_zoom, 2 * HALF_WIDTH_M / 2**facts.most_zoom
    into = Transformer.from_crs("EPSG:32631", "EPSG:3857", always_xy=True)
    red, green = (220, 0, 0), (0, 200, 0)
    for east_m, south_m, colour in ((100, 300, red), (199, 201, red), (201, 199, green), (350, 50, green)):
        x, y = into.transform(west_m + east_m, north_m - south_m)
        column, row = int((x + HALF_WIDTH_M) / side_m), int((HALF_WIDTH_M - y) / side_m)
        [picture] = read_tiles(background, Tile(zoom, column, row))
        assert picture is not None and picture[1] == "image/png"
        image = Image.open(io.BytesIO(picture[0]))
        pixel = (int(((x + HALF_WIDTH_M) / side_m - column) * 256), int(((HALF_WIDTH_M - y) / side_m - row) * 256))
        assert image.getpixel(pixel) == (*colour, 255)
    assert read_tiles(background, Tile(zoom, 0, 0)) == [None]
    monkeypatch.setitem(sys.modules, "rasterio", None)
    with pytest.raises(ServiceError, match=r"pip install 'headland\[geotiff\]'"):
        MapBackground(make_settings(tmp_path, path))


def test_nobody_sees_tiles_without_the_right_to_read(tmp_path: Path) -> None:
    with serve_tiles() as host:
        app = create_app(make_settings(tmp_path, host.address), reads_inline=True)
        with TestClient(app, base_url=HERE) as client:
            for path in ("", "/tiles/1/0/0", "/placement?longitude=4&latitude=52"):
                assert client.get(f"/api/v1/background{path}").status_code == 401
            assert host.paths == []
            client.headers.update(bearer(app, "read"))
            answer = client.get("/api/v1/background/tiles/1/0/0")
            assert (
                answer.headers["x-content-type-options"] == "nosniff" and "private" in answer.headers["cache-control"]
            )
            assert client.get("/api/v1/background/tiles/1/2/0").json()["parameter"] == "column"
            assert client.get("/api/v1/background/tiles/1/%2e%2e/0").status_code in (404, 422)
            assert client.get("/api/v1/background/tiles/20/0/0").status_code == 204, "finer than the address has"
            assert client.get("/api/v1/background?host=other.example").status_code == 422
            assert host.paths == ["/1/0/0.png"]


def test_places_that_cannot_be_are_refused(tmp_path: Path) -> None:
    app = create_app(make_settings(tmp_path, ""), reads_inline=True)
    with TestClient(app, base_url=HERE, headers=bearer(app, "read")) as client:
        for query in IMPOSSIBLE_PLACES:
            answer = client.get(f"/api/v1/background/placement?{query}")
            assert answer.status_code == 422 and len(answer.json()["error"]) > 20, query
        assert client.get("/api/v1/background").json()["kind"] == "none"
        assert client.get("/api/v1/background/tiles/1/0/0").status_code == 204
