"""Rasters of heights, written from closed forms and read as a grid in the plane of a field."""

import builtins
import tracemalloc
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fields.arrays import Floats
from fields.errors import HeadlandError
from fields.geometry.field import Field
from fields.terrain.elevation import read_elevation
from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.rasters import Raster, open_raster
from fields.terrain.slopes import compute_gradients, summarise_slopes
from tests.fields.terrain.heights import (
    CRS,
    FIELD,
    ORIGIN_M,
    Surface,
    bowl,
    build_plane,
    hills,
    write_ascii_grid,
    write_geotiff,
)

pytest.importorskip("rasterio")
LOCAL_FIELD = Field("Yard", FIELD.boundary)


def measure_error_m(grid: ElevationGrid, surface: Surface) -> float:
    """The largest difference at any node, those beyond the raster included."""
    return float(np.abs(grid.heights_m - surface(*np.meshgrid(grid.xs_m, grid.ys_m))).max())


@pytest.mark.parametrize("surface", [build_plane(0.05, -0.03), bowl])
@pytest.mark.parametrize(
    ("raster", "error_m"),
    [
        ({}, 1e-6),
        ({"south_up": True}, 1e-6),
        ({"turned_deg": 25.0, "margin_m": 100.0}, 1e-6),
        ({"crs": "EPSG:4326", "cell": 5e-5}, 1e-4),
        ({"crs": "EPSG:3857"}, 1e-4),
        ({"crs": "EPSG:25833", "margin_m": 90.0}, 1e-4),
        ({"cell": 25.0, "margin_m": 75.0}, 1e-6),
        ({"unit": "ft", "scale": 0.3048}, 1e-6),
        ({"unit": "US survey foot", "scale": 1200 / 3937}, 1e-6),
        ({"nodata": None, "dtype": "float32"}, 1e-4),
    ],
    ids=lambda value: "-".join(map(str, value)) if isinstance(value, dict) else "",
)
def test_planes_and_bowls_are_read_exactly(
    tmp_path: Path, surface: Surface, raster: dict[str, Any], error_m: float
) -> None:
    grid = read_elevation(write_geotiff(tmp_path / "dtm.tif", surface, **{"margin_m": 60.0} | raster), FIELD)
    assert measure_error_m(grid, surface) < error_m
    west, south, east, north = grid.bounds_m
    assert west <= -140.0 and south <= -120.0 and east >= 140.0 and north >= 120.0  # machines turn beyond the outline
    assert grid.is_measured is not None and grid.is_measured.all()


def test_fine_cells_are_averaged_and_coarse_ones_bent_smoothly(tmp_path: Path) -> None:
    fine = read_elevation(write_geotiff(tmp_path / "fine.tif", bowl, cell=0.5, margin_m=60.0), FIELD)
    assert fine.spacing_m == 2.0
    # The mean of x2 / 4000 + y2 / 3000 over 2 m squares of 0.5 m cells is larger than that at the middle by its
    # curvatures times the variance of the cells, 5/16 m2.
    assert measure_error_m(fine, lambda x, y: bowl(x, y) + 0.3125 * (1 / 4000 + 1 / 3000)) < 1e-6
    coarse = read_elevation(write_geotiff(tmp_path / "coarse.tif", hills, cell=20.0, margin_m=80.0), FIELD)
    assert coarse.spacing_m == 10.0 and "cells of 20 m, on a grid of 10 m" in coarse.source
    assert measure_error_m(coarse, hills) < 0.01


@pytest.mark.slow
def test_more_cells_than_fit_in_memory_are_averaged_as_they_are_read(tmp_path: Path) -> None:
    # 2400 by 2000 cells, so read as means of 2 by 2, in strips.
    path = write_geotiff(tmp_path / "drone.tif", build_plane(0.05, -0.03), cell=0.1, margin_m=20.0, dtype="float32")
    grid = read_elevation(path, FIELD)
    assert measure_error_m(grid, build_plane(0.05, -0.03)) < 0.02
    assert "cells of 0.1 m, on a grid of 2 m" in grid.source


@given(
    east=st.floats(-0.3, 0.3), north=st.floats(-0.3, 0.3), cell=st.floats(1.0, 15.0),
    turned=st.floats(-180.0, 180.0), south_up=st.booleans(), base=st.floats(-100.0, 3000.0),
)  # fmt: skip
@settings(max_examples=15, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_any_raster_of_a_plane_gives_the_plane(
    tmp_path: Path, east: float, north: float, cell: float, turned: float, south_up: bool, base: float
) -> None:
    surface = build_plane(east, north, base)
    path = write_geotiff(
        tmp_path / "plane.tif", surface, cell=cell, turned_deg=turned, south_up=south_up, margin_m=100.0
    )
    grid = read_elevation(path, FIELD)
    assert measure_error_m(grid, surface) < 1e-5
    slopes = summarise_slopes(grid, FIELD.boundary)
    assert slopes is not None
    assert slopes.median == pytest.approx(np.hypot(east, north), abs=1e-6)
    assert slopes.steepest == pytest.approx(np.hypot(east, north), abs=1e-6)


@pytest.mark.parametrize("by_centre", [False, True])
def test_ascii_grids_run_from_north_to_south(tmp_path: Path, by_centre: bool) -> None:
    surface = build_plane(0.02, 0.08)
    path = write_ascii_grid(tmp_path / "dtm.asc", surface, by_centre=by_centre)
    assert measure_error_m(read_elevation(path, FIELD, crs=CRS), surface) < 1e-5


@pytest.mark.parametrize("suffix", [".prj", ".PRJ"])
def test_an_ascii_grid_takes_its_system_from_the_prj_beside_it(tmp_path: Path, suffix: str) -> None:
    import pyproj

    path = write_ascii_grid(tmp_path / "dtm.asc", bowl)
    path.with_suffix(suffix).write_text(pyproj.CRS.from_user_input(CRS).to_wkt("WKT1_ESRI"), encoding="ascii")
    assert measure_error_m(read_elevation(path, FIELD), bowl) < 1e-5


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("cellsize 5.0", "cellsize inf", "has cells of inf by inf .* export it again"),
        ("cellsize 5.0", "cellsize 1e-200", "cells need a place and a size"),
        ("cellsize 5.0", "cellsize nan", "does not begin like an ASCII grid"),
        ("NODATA_value -9999\n", "NODATA_value -9999\n1.5 ", "has 3585 heights, but 56 rows and 64 columns"),
        ("NODATA_value -9999\n", "NODATA_value -9999\n1;5 ", "has heights that are not numbers"),
        ("NODATA_value -9999\n", "NODATA_value -9999\n1,5 ", "has 3586 heights, but 56 rows and 64 columns"),
    ],
)
def test_an_ascii_grid_without_places_or_numbers_is_refused(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = write_ascii_grid(tmp_path / "dtm.asc", bowl)
    text = path.read_text(encoding="ascii")
    path.write_text(text.replace(old, new), encoding="ascii")
    with pytest.raises(HeadlandError, match=words):
        read_elevation(path, FIELD, crs=CRS)


def test_a_header_without_heights_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "empty.asc"
    path.write_text("ncols 1\nnrows 1\nxllcorner 0\nyllcorner 0\ncellsize 1\n  \n", encoding="ascii")
    with pytest.raises(HeadlandError, match="has 0 heights, but 1 rows"):
        open_raster(str(path))


@pytest.mark.parametrize("steps", [(5.0, 10.0, 5.0, 10.0), (0.0, 0.0, 0.0, 0.0), (np.inf, 0.0, 0.0, -5.0)])
def test_a_raster_whose_cells_have_no_area_is_refused(tmp_path: Path, steps: tuple[float, ...]) -> None:
    import rasterio

    path = write_geotiff(tmp_path / "line.tif", bowl)
    a, b, d, e = steps
    with rasterio.open(path, "r+") as dataset:
        dataset.transform = rasterio.Affine(a, b, ORIGIN_M[0], d, e, ORIGIN_M[1])
    with pytest.raises(HeadlandError, match="cells need a place and a size"):
        read_elevation(path, FIELD)


def test_more_cells_than_can_be_read_are_refused() -> None:
    raster = Raster("drone.tif", CRS, np.array([[0.01, 0.0, 0.0], [0.0, -0.01, 0.0]]), (40_000, 40_000))
    with pytest.raises(HeadlandError, match=r"has 1600 million cells over the field; at most 1074 million are read"):
        raster.read_cells(slice(0, 40_000), slice(0, 40_000), 20)


def test_a_field_in_local_metres_takes_a_raster_without_a_system(tmp_path: Path) -> None:
    def surface(x: Floats, y: Floats) -> Floats:
        return bowl(x + ORIGIN_M[0], y + ORIGIN_M[1])

    moved_m = (-ORIGIN_M[0], -ORIGIN_M[1])
    path = write_geotiff(tmp_path / "yard.tif", surface, crs=None, moved_m=moved_m, margin_m=60.0)
    assert measure_error_m(read_elevation(path, LOCAL_FIELD), bowl) < 1e-5


def test_scaled_whole_numbers_are_heights(tmp_path: Path) -> None:
    import rasterio

    path = write_geotiff(tmp_path / "cm.tif", build_plane(0.05, 0.0), scale=0.01, dtype="int32")
    with rasterio.open(path, "r+") as dataset:
        dataset.scales, dataset.offsets = (0.01,), (100.0,)
    assert measure_error_m(read_elevation(path, FIELD), build_plane(0.05, 0.0, 150.0)) < 0.01


def make_hole(rows: slice, columns: slice, mark: float = -9999.0) -> Any:
    def edit(heights: Floats) -> None:
        heights[rows, columns] = mark

    return edit


def find_remark(grid: ElevationGrid) -> str:
    (remark,) = grid.remarks
    return remark


@pytest.mark.parametrize("mark", [-9999.0, -32768.0, np.nan, -3.4e38])
def test_a_small_hole_is_filled_and_told(tmp_path: Path, mark: float) -> None:
    hole = make_hole(slice(20, 23), slice(25, 28), mark)
    grid = read_elevation(write_geotiff(tmp_path / "hole.tif", build_plane(0.1, 0.02), edit=hole), FIELD)
    assert measure_error_m(grid, build_plane(0.1, 0.02)) < 1e-6
    assert "has no heights for 0.74 % of field 'Hill' (up to 10 m away); they are continued" in find_remark(grid)


def test_a_thin_edge_beyond_the_raster_is_told_and_continued(tmp_path: Path) -> None:
    # The raster begins 7 m inside of the western edge, so one of 39 columns of nodes in the field has no heights.
    path = write_geotiff(tmp_path / "edge.tif", build_plane(0.1, 0.02), moved_m=(47.0, 0.0))
    grid = read_elevation(path, FIELD)
    assert "has no heights for 2.6 % of field 'Hill' (up to 5 m away)" in find_remark(grid)
    assert measure_error_m(grid, build_plane(0.1, 0.02)) < 1e-6


def test_a_hole_inside_an_obstacle_is_no_gap(tmp_path: Path) -> None:
    pond = shapely.box(-30.0, -30.0, 30.0, 30.0)
    field = Field("Pond", FIELD.boundary.difference(pond), CRS, ORIGIN_M)
    path = write_geotiff(tmp_path / "pond.tif", bowl, edit=make_hole(slice(18, 30), slice(22, 34)))
    assert read_elevation(path, field).remarks == ()
    with pytest.raises(HeadlandError, match=r"has no heights for 12 % of field 'Hill'.*whole field"):
        read_elevation(path, FIELD)


def test_single_spikes_are_left_out_and_told(tmp_path: Path) -> None:
    def add_spikes(heights: Floats) -> None:
        heights[20, 20] += 50.0
        heights[30, 40] -= 30.0

    grid = read_elevation(write_geotiff(tmp_path / "spike.tif", build_plane(0.1, 0.0), edit=add_spikes), FIELD)
    assert "2 heights of" in find_remark(grid) and "the largest 50 m above those around at longitude" in find_remark(
        grid
    )
    assert measure_error_m(grid, build_plane(0.1, 0.0)) < 1e-6


def test_a_south_up_raster_is_told(tmp_path: Path) -> None:
    grid = read_elevation(write_geotiff(tmp_path / "up.tif", bowl, south_up=True), FIELD)
    assert "Rows of" in find_remark(grid) and "run from south to north" in find_remark(grid)


def add_many_spikes(heights: Floats) -> None:
    heights[::5, ::5] += 50.0


REFUSED: list[tuple[dict[str, Any], str | None, tuple[str, ...], str]] = [
    ({"moved_m": (40_000.0, 0.0)}, None, ("40 km from field 'Hill'", "check the coordinate system"), "elevation"),
    ({"moved_m": (260.0, 0.0)}, None, ("from field 'Hill'", "give heights of the field"), "elevation"),
    ({"moved_m": (60.0, 0.0)}, None, ("has no heights for", "at most 5 % and 30 m are filled in"), "elevation"),
    ({"crs": None}, None, ("does not name its coordinate system", "EPSG:25832"), "elevation_crs"),
    ({}, "EPSG:25833", ("is in 'EPSG:32632' by its own header", "leave out"), "elevation_crs"),
    ({"crs": None}, "EPSG:99999999", ("EPSG:99999999", "is unknown"), "elevation_crs"),
    ({"unit": "furlong"}, None, ("are in 'furlong'", "convert them to metres"), "elevation"),
    ({"edit": make_hole(slice(15, 30), slice(15, 40))}, None, ("has no heights for", "whole field"), "elevation"),
    ({"edit": make_hole(slice(None), slice(None))}, None, ("no height in field 'Hill'", "no-data"), "elevation"),
    ({"edit": add_many_spikes}, None, ("are spikes, the largest 50", "at most 1 %", "clean"), "elevation"),
    ({"scale": 0.001}, None, ("reach from", "farmland lies from -500 to 6000 m", "convert"), "elevation"),
]


@pytest.mark.parametrize(("raster", "crs", "parts", "parameter"), REFUSED)
def test_what_is_no_ground_of_the_field_is_refused(
    tmp_path: Path, raster: dict[str, Any], crs: str | None, parts: tuple[str, ...], parameter: str
) -> None:
    path = write_geotiff(tmp_path / "bad.tif", bowl, **raster)
    with pytest.raises(HeadlandError) as refused:
        read_elevation(path, FIELD, crs)
    assert all(part in str(refused.value) for part in parts), str(refused.value)
    assert refused.value.parameter == parameter
    assert str(refused.value).count(". ") == 0


def test_a_slope_of_70_percent_is_refused(tmp_path: Path) -> None:
    path = write_geotiff(tmp_path / "steep.tif", build_plane(0.42, 0.56))
    with pytest.raises(HeadlandError, match=r"a slope of 70 % at longitude .* over 60 % on 100 % .* in metres \(feet"):
        read_elevation(path, FIELD)


def test_a_steep_bank_is_told(tmp_path: Path) -> None:
    def dig_ditch(heights: Floats) -> None:
        heights[30:32, 30:38] -= 4.0

    grid = read_elevation(write_geotiff(tmp_path / "bank.tif", bowl, cell=2.0, edit=dig_ditch), FIELD)
    assert "gives a slope of" in find_remark(grid) and "as of a bank" in find_remark(grid)


def test_feet_along_the_ground_and_no_unit_of_heights_are_told(tmp_path: Path) -> None:
    field = Field("Acre", shapely.box(-100.0, -80.0, 100.0, 80.0), "EPSG:32615", (500_000.0, 4_600_000.0))
    import rasterio
    from pyproj import Transformer

    east, north = Transformer.from_crs("EPSG:32615", "EPSG:3417", always_xy=True).transform(500_000.0, 4_600_000.0)
    place = rasterio.Affine(15.0, 0.0, east - 600.0, 0.0, -15.0, north + 600.0)
    options: dict[str, Any] = {"height": 80, "width": 80, "count": 1, "dtype": "float32", "transform": place}
    path = tmp_path / "feet.tif"
    with rasterio.open(path, "w", driver="GTiff", crs="EPSG:3417", **options) as dataset:
        dataset.write(np.full((80, 80), 300.0, dtype=np.float32), 1)
    remark = find_remark(read_elevation(path, field))
    assert "does not say the unit of its heights; they are taken as metres, though its places are in feet" in remark


def test_pictures_and_broken_files_are_refused(tmp_path: Path) -> None:
    import rasterio

    picture = tmp_path / "photo.tif"
    place = rasterio.Affine(5.0, 0.0, ORIGIN_M[0] - 200.0, 0.0, -5.0, ORIGIN_M[1] + 200.0)
    options: dict[str, Any] = {"height": 80, "width": 80, "count": 3, "dtype": "uint8", "transform": place}
    with rasterio.open(picture, "w", driver="GTiff", crs=CRS, **options) as dataset:
        dataset.write(np.zeros((3, 80, 80), dtype=np.uint8))
    (tmp_path / "text.tif").write_text("no raster", encoding="ascii")
    cut = tmp_path / "cut.asc"
    cut.write_text("\n".join(write_ascii_grid(cut, bowl).read_text().splitlines()[:-3]), encoding="ascii")
    (tmp_path / "odd.asc").write_text("ncols 3\nnrows x\n", encoding="ascii")
    (tmp_path / "bare.asc").write_text("1 2 3\n", encoding="ascii")
    for name, part in (
        ("photo.tif", "is a picture of 3 colours"), ("text.tif", "cannot be read as a GeoTIFF"),
        ("none.tif", "There is no file of heights"), ("none.asc", "There is no file"), ("cut.asc", "is cut off"),
        ("odd.asc", "nrows 'x'"), ("bare.asc", "does not begin like an ASCII grid"),
        ("dtm.xyz", "has an ending that says no format of heights"),
    ):  # fmt: skip
        with pytest.raises(HeadlandError, match=part):
            read_elevation(tmp_path / name, FIELD)


def test_a_local_field_and_a_raster_of_the_earth_do_not_meet(tmp_path: Path) -> None:
    with pytest.raises(HeadlandError, match="in local metres without a place on the earth"):
        read_elevation(write_geotiff(tmp_path / "dtm.tif", bowl), LOCAL_FIELD)


def test_without_rasterio_the_extra_is_named_and_ascii_grids_are_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write_geotiff(tmp_path / "dtm.tif", bowl)
    load = builtins.__import__

    def refuse_rasterio(name: str, *rest: Any, **options: Any) -> Any:
        if name.startswith("rasterio"):
            raise ImportError(name)
        return load(name, *rest, **options)

    monkeypatch.setattr(builtins, "__import__", refuse_rasterio)
    with pytest.raises(HeadlandError, match=r"needs rasterio .* pip install 'headland\[geotiff\]'.*\.asc"):
        read_elevation(path, FIELD)
    assert read_elevation(write_ascii_grid(tmp_path / "dtm.asc", bowl), FIELD, CRS).heights_m.size > 0


def write_package(path: Path, dtype: str = "float32", bands: int = 1, tables: tuple[str, ...] = ("dtm",)) -> Path:
    """A GeoPackage with rasters of a plane of 10 % in cells of 5 m."""
    import rasterio

    place = rasterio.Affine(5.0, 0.0, ORIGIN_M[0] - 200.0, 0.0, -5.0, ORIGIN_M[1] + 200.0)
    centres = 5.0 * (np.arange(80) + 0.5) - 200.0
    cells = build_plane(0.06, 0.08)(*np.meshgrid(centres, -centres))
    for table in tables:
        options: dict[str, Any] = {"RASTER_TABLE": table, "APPEND_SUBDATASET": "NO" if table == tables[0] else "YES"}
        with rasterio.open(
            path, "w", driver="GPKG", height=80, width=80, count=bands, dtype=dtype, crs=CRS, transform=place, **options
        ) as dataset:
            dataset.write(np.broadcast_to(cells, (bands, 80, 80)).astype(dtype))
    return path


def test_a_geopackage_holds_a_raster(tmp_path: Path) -> None:
    grid = read_elevation(write_package(tmp_path / "dtm.gpkg"), FIELD)
    assert measure_error_m(grid, build_plane(0.06, 0.08)) < 1e-4 and grid.remarks == ()


def test_packages_without_one_raster_of_heights_are_refused(tmp_path: Path) -> None:
    write_package(tmp_path / "two.gpkg", tables=("dtm", "dsm"))
    write_package(tmp_path / "photo.gpkg", "uint8", 3)
    whole = write_package(tmp_path / "whole.gpkg").read_bytes()
    (tmp_path / "cut.gpkg").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "text.gpkg").write_text("no package", encoding="ascii")
    for name, part in (
        ("two.gpkg", r"has 2 rasters \(dtm, dsm\); keep the one with heights"), ("photo.gpkg", "is a picture of"),
        ("cut.gpkg", "cannot be read as a GeoPackage"), ("text.gpkg", "is not a GeoPackage"),
        ("none.gpkg", "There is no file"),
    ):  # fmt: skip
        with pytest.raises(HeadlandError, match=part) as refused:
            read_elevation(tmp_path / name, FIELD)
        assert refused.value.parameter == "elevation"


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (".", ","),  # decimal commas, in the header as well
        (" ", ", "),  # commas between heights
        ("cellsize 5.0", "dx 5.0\ndy 5.0"),  # of GDAL
        ("NODATA_value -9999\n", ""),
    ],
)
def test_ways_to_write_an_ascii_grid(tmp_path: Path, old: str, new: str) -> None:
    path = write_ascii_grid(tmp_path / "dtm.asc", bowl)
    head, _, rows = path.read_text(encoding="ascii").partition("-9999\n")
    head += "-9999\n"
    text = head + rows.replace(old, new) if new == ", " else (head + rows).replace(old, new)
    assert text != head + rows
    path.write_text(text, encoding="ascii")
    assert measure_error_m(read_elevation(path, FIELD, CRS), bowl) < 1e-5


def test_a_raster_without_georeference_or_with_huge_cells_is_refused(tmp_path: Path) -> None:
    import rasterio

    cells = np.full((2, 2), 50.0, dtype=np.float32)
    options: dict[str, Any] = {"driver": "GTiff", "height": 2, "width": 2, "count": 1, "dtype": "float32", "crs": CRS}
    place = rasterio.Affine(400.0, 0.0, ORIGIN_M[0] - 400.0, 0.0, -400.0, ORIGIN_M[1] + 400.0)
    for name, transform, part in (
        ("nowhere.tif", None, "does not say where its cells are"),
        ("coarse.tif", place, "has cells of 400 m; the slopes of a field need cells of 100 m or less"),
    ):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", rasterio.errors.NotGeoreferencedWarning)
            with rasterio.open(tmp_path / name, "w", transform=transform, **options) as dataset:
                dataset.write(cells, 1)
        with pytest.raises(HeadlandError, match=part):
            read_elevation(tmp_path / name, FIELD)


def test_coarse_cells_whole_metres_and_steep_fields_are_told(tmp_path: Path) -> None:
    plane = build_plane(0.06, 0.08)
    coarse = read_elevation(write_geotiff(tmp_path / "coarse.tif", plane, cell=25.0, margin_m=120.0), FIELD)
    assert "has cells of 25 m; slopes shorter than that are not in it" in find_remark(coarse)
    whole = read_elevation(write_geotiff(tmp_path / "whole.tif", plane, dtype="int16"), FIELD)
    assert "are rounded to 1 m, so slopes are good to 4.1 % only" in find_remark(whole)
    errors = np.hypot(*np.moveaxis(compute_gradients(whole)[2:-2, 2:-2] - (0.06, 0.08), -1, 0))
    assert 0.02 < float(np.sqrt((errors**2).mean())) < 0.06, "as large as is said: 4.1 % each way"
    level = read_elevation(write_geotiff(tmp_path / "level.tif", build_plane(0.0, 0.0), dtype="int16"), FIELD)
    assert level.remarks == ()
    steep = read_elevation(write_geotiff(tmp_path / "steep.tif", build_plane(0.3, 0.0)), FIELD)
    assert "Half of field 'Hill' is steeper than 30 %" in find_remark(steep)


def test_many_spikes_take_little_memory(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(0.0, 10.0, (720, 840))
    path = write_geotiff(tmp_path / "noise.tif", bowl, cell=1.0 / 3.0, edit=lambda heights: heights.__iadd__(noise))
    tracemalloc.start()
    try:
        with pytest.raises(HeadlandError, match=r"heights of .* are spikes"):
            read_elevation(path, FIELD)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < 160 * noise.size, "bytes; 25 neighbours of every cell at once would take 200 a copy"
