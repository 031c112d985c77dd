"""Points with heights in every format, and the smooth grid through them."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from fields.arrays import Floats
from fields.errors import HeadlandError
from fields.geometry.field import Field
from fields.terrain.elevation import read_elevation
from fields.terrain.elevation_grid import ElevationGrid, NodeFrame
from fields.terrain.point_files import read_height_points
from fields.terrain.slopes import compute_gradients
from tests.drawn_fields import feature, line, point, write_features
from tests.fields.terrain.heights import (
    CRS,
    FIELD,
    ORIGIN_M,
    Surface,
    bowl,
    build_plane,
    hills,
    lay_passes,
    project,
    write_points_csv,
)

PLANE = build_plane(0.04, -0.02)
POINTS = lay_passes(8.0, 4.0)
HEIGHTS_M = PLANE(*POINTS.T)
DEGREES = project(POINTS + ORIGIN_M, CRS, "EPSG:4326")


def measure_errors(grid: ElevationGrid, surface: Surface) -> Floats:
    """Differences at the nodes in the field."""
    inside = NodeFrame(grid.west_m, grid.south_m, grid.spacing_m, *grid.heights_m.shape).find_inside(FIELD.boundary)
    return np.asarray((grid.heights_m - surface(*np.meshgrid(grid.xs_m, grid.ys_m)))[inside])


def write_csv(folder: Path) -> Path:
    return write_points_csv(folder / "points.csv", POINTS, HEIGHTS_M)


def write_csv_in_feet(folder: Path) -> Path:
    return write_points_csv(folder / "feet.csv", POINTS, HEIGHTS_M / 0.3048, ("Longitude", "Latitude", "Altitude (ft)"))


def write_csv_with_decimal_commas(folder: Path) -> Path:
    rows = [f"{x + ORIGIN_M[0]:.3f};{y + ORIGIN_M[1]:.3f};{z:.4f}" for (x, y), z in zip(POINTS, HEIGHTS_M, strict=True)]
    path = folder / "komma.csv"
    path.write_text("Easting;Northing;Höhe_m\n" + "\n".join(rows).replace(".", ","), encoding="utf-8")
    return path


def write_geojson_points(folder: Path) -> Path:
    rows = [[*place, height] for place, height in zip(DEGREES.tolist(), HEIGHTS_M.tolist(), strict=True)]
    first = {"type": "Point", "coordinates": rows[0]}
    return write_features(folder / "points.geojson", feature(first), feature(line(*rows[1:])))


def write_geojson_properties(folder: Path) -> Path:
    rows = zip(DEGREES.tolist(), HEIGHTS_M.tolist(), strict=True)
    return write_features(
        folder / "properties.json", *(feature(point(*place), elev_ft=z / 0.3048) for place, z in rows)
    )


def write_kml(folder: Path) -> Path:
    rows = " ".join(f"{lon:.9f},{lat:.9f},{z:.4f}" for (lon, lat), z in zip(DEGREES, HEIGHTS_M, strict=True))
    path = folder / "line.kml"
    path.write_text(
        '<?xml version="1.0"?><kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>a</name>'
        f"<LineString><coordinates>{rows}</coordinates></LineString></Placemark></Document></kml>",
        encoding="utf-8",
    )
    return path


def write_gpx(folder: Path) -> Path:
    rows = "".join(
        f'<trkpt lon="{lon:.9f}" lat="{lat:.9f}"><ele>{z:.4f}</ele></trkpt>'
        for (lon, lat), z in zip(DEGREES, HEIGHTS_M, strict=True)
    )
    path = folder / "track.gpx"
    path.write_text(
        '<?xml version="1.0"?><gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>'
        f"{rows}</trkseg></trk></gpx>",
        encoding="utf-8",
    )
    return path


def write_shapefile(folder: Path, shapes: Floats, columns: dict[str, Floats]) -> Path:
    from pyogrio.raw import write

    path = folder / "points.shp"
    has_heights = bool(shapely.has_z(shapes).any())
    write(
        path, np.array([one.wkb for one in shapes], dtype=object), list(columns.values()), list(columns), crs=CRS,
        geometry_type="Point Z" if has_heights else "Point", driver="ESRI Shapefile",
    )  # fmt: skip
    return path


def write_shapefile_with_heights(folder: Path) -> Path:
    return write_shapefile(
        folder, shapely.points(np.column_stack([POINTS + ORIGIN_M, HEIGHTS_M])), {"n": np.arange(len(POINTS))}
    )


def write_shapefile_with_a_column(folder: Path) -> Path:
    return write_shapefile(folder, shapely.points(POINTS + ORIGIN_M), {"Elev_m": HEIGHTS_M})


def write_agopengps(folder: Path) -> Path:
    head = (
        "2026-October-03 10:00:00 AM\r\n$FieldDir\r\nElevation\r\n$Offsets\r\n0,0\r\nConvergence\r\n0\r\nStartFix\r\n"
    )
    head += "56.9,9.9\r\nLatitude,Longitude,Elevation,Quality,Easting,Northing,Heading,Roll\r\n"
    rows = [
        f"{lat:.9f},{lon:.9f},{z:.3f},4,{x:.2f},{y:.2f},0.000,0\r\n"
        for (lon, lat), (x, y), z in zip(DEGREES, POINTS, HEIGHTS_M, strict=True)
    ]
    lost = f"{DEGREES[0, 1]},{DEGREES[0, 0]},3.0,1,0,0,0,0\r\n"  # a single position, metres off
    (folder / "Elevation.txt").write_text(head + "".join(rows) + lost + "56.9,9.9", encoding="utf-8", newline="")
    return folder


WRITERS: list[Callable[[Path], Path]] = [
    write_csv, write_csv_in_feet, write_csv_with_decimal_commas, write_geojson_points, write_geojson_properties,
    write_kml, write_gpx, write_shapefile_with_heights, write_shapefile_with_a_column, write_agopengps,
]  # fmt: skip


@pytest.mark.parametrize("write", WRITERS)
def test_a_plane_is_read_from_every_format(tmp_path: Path, write: Callable[[Path], Path]) -> None:
    crs = CRS if write is write_csv_with_decimal_commas else None
    grid = read_elevation(write(tmp_path), FIELD, crs)
    assert np.abs(measure_errors(grid, PLANE)).max() < 2e-3  # of millimetres in the files
    expected = {"feet": write in (write_csv_in_feet, write_geojson_properties), "RTK": write is write_agopengps}
    assert {word: any(word in remark for remark in grid.remarks) for word in expected} == expected
    assert f"{len(POINTS)} points of" in grid.source


@pytest.mark.parametrize(("surface", "error_m"), [(bowl, 0.005), (hills, 0.01)])
def test_curved_ground_is_followed_between_passes(tmp_path: Path, surface: Surface, error_m: float) -> None:
    points = lay_passes(8.0, 1.7)
    grid = read_elevation(write_points_csv(tmp_path / "hill.csv", points, surface(*points.T)), FIELD)
    assert np.abs(measure_errors(grid, surface)).max() < error_m


def test_noise_of_rtk_is_smoothed_over_a_stated_length(tmp_path: Path) -> None:
    # 2 cm for each point and 3 cm for each pass of 6 m; slopes are wanted to half a percent.
    points, chance = lay_passes(6.0), np.random.default_rng(3)
    passes = np.unique(points[:, 0], return_inverse=True)[1]
    noise = chance.normal(0.0, 0.02, len(points)) + chance.normal(0.0, 0.03, passes.max() + 1)[passes]
    grid = read_elevation(write_points_csv(tmp_path / "rtk.csv", points, hills(*points.T) + noise), FIELD)
    assert "smoothed over 5" in grid.source
    scatter_cm = float(grid.source.split("scatter ")[1].split(" cm")[0])
    assert 1.5 < scatter_cm < 3.6  # sqrt(2^2 + 3^2), less what the surface follows
    assert measure_errors(grid, hills).std() < 0.035
    x, y = np.meshgrid(grid.xs_m, grid.ys_m)
    slope_east = (hills(x + 0.01, y) - hills(x - 0.01, y)) / 0.02
    inside = (np.abs(x) < 95.0) & (np.abs(y) < 75.0)
    assert np.sqrt(np.mean((compute_gradients(grid)[..., 0] - slope_east)[inside] ** 2)) < 0.006


def test_spikes_of_points_are_left_out_and_told(tmp_path: Path) -> None:
    heights = HEIGHTS_M.copy()
    heights[[50, 120, 121]] += (50.0, -20.0, -20.0)
    grid = read_elevation(write_points_csv(tmp_path / "spikes.csv", POINTS, heights), FIELD)
    (remark,) = grid.remarks
    assert "3 heights of" in remark and "m above those around at longitude" in remark
    assert np.abs(measure_errors(grid, PLANE)).max() < 2e-3
    with pytest.raises(HeadlandError, match=r"are spikes, the largest 5\d.* at most 1 % of the heights"):
        heights[::20] += 50.0
        read_elevation(write_points_csv(tmp_path / "wild.csv", POINTS, heights), FIELD)


def test_a_gap_between_points_is_told_and_a_large_one_refused(tmp_path: Path) -> None:
    def write_gap(half_m: float) -> Path:
        kept = (np.abs(POINTS[:, 0]) > half_m) | (np.abs(POINTS[:, 1]) > half_m)
        return write_points_csv(tmp_path / "gap.csv", POINTS[kept], HEIGHTS_M[kept])

    grid = read_elevation(write_gap(15.0), FIELD)
    assert "has no heights for" in grid.remarks[0] and "they are continued from those around" in grid.remarks[0]
    assert np.abs(measure_errors(grid, PLANE)).max() < 2e-3
    with pytest.raises(HeadlandError, match=r"has no heights for .* give heights of the whole field"):
        read_elevation(write_gap(45.0), FIELD)


def write_text(text: str, name: str = "bad.csv") -> Callable[[Path], Path]:
    def write(folder: Path) -> Path:
        path = folder / name
        path.write_text(text, encoding="utf-8")
        return path

    return write


def write_elsewhere(folder: Path) -> Path:
    return write_points_csv(folder / "far.csv", POINTS + np.array([25_000.0, 0.0]), HEIGHTS_M)


def write_edge(folder: Path) -> Path:
    ring = shapely.get_coordinates(shapely.segmentize(FIELD.boundary.exterior, 3.0))
    return write_points_csv(folder / "edge.csv", ring, PLANE(*ring.T))


def write_one_pass(folder: Path) -> Path:
    line = np.column_stack([np.zeros(90), np.linspace(-80.0, 80.0, 90)])
    return write_points_csv(folder / "pass.csv", line, PLANE(*line.T))


def write_flat_kml(folder: Path) -> Path:
    path = write_kml(folder)
    path.write_text(path.read_text(encoding="utf-8").replace(",5", ",0.0 ").replace(",4", ",0.0 "), encoding="utf-8")
    places = " ".join(f"{lon:.9f},{lat:.9f},0" for lon, lat in DEGREES)
    text = path.read_text(encoding="utf-8")
    start, end = text.index("<coordinates>") + len("<coordinates>"), text.index("</coordinates>")
    path.write_text(text[:start] + places + text[end:], encoding="utf-8")
    return path


REFUSED: list[tuple[Callable[[Path], Path], str, str]] = [
    (write_elsewhere, r"is 24\.8 km from field 'Hill'; give heights of the field", "elevation"),
    (write_edge, "Half of the field is more than .* passes at most 60 m apart", "elevation"),
    (write_one_pass, "Half of the field is more than", "elevation"),
    (write_flat_kml, "are without a height or at 0; export them with heights", "elevation"),
    (write_text("a,b,c\n1,2,3\n"), "has the columns a, b, c; it needs longitude and latitude", "elevation"),
    (write_text("lon,lat,elevation_m\n9.9,56.9,20\n"), "has 1 point with a height; give at least 10", "elevation"),
    (write_text(""), "is empty", "elevation"),
    (write_text('lon,lat,elevation_m\n"' + "9" * 140_000 + '",56.9,20\n'), "is not a CSV file .*limit", "elevation"),
    (write_text("{", "bad.geojson"), "is not JSON", "elevation"),
    (write_text("[]", "bad.json"), "is JSON, but not GeoJSON", "elevation"),
    (write_text("<kml>", "bad.kml"), "bad.kml", "elevation"),
    (lambda folder: folder, "holds no Shapefile and no Elevation.txt", "elevation"),
    (write_csv_with_decimal_commas, "does not name its coordinate system", "elevation_crs"),
]


@pytest.mark.parametrize(("write", "pattern", "parameter"), REFUSED)
def test_points_that_say_no_heights_of_the_field_are_refused(
    tmp_path: Path, write: Callable[[Path], Path], pattern: str, parameter: str
) -> None:
    with pytest.raises(HeadlandError, match=pattern) as refused:
        read_elevation(write(tmp_path), FIELD)
    assert refused.value.parameter == parameter


@pytest.mark.parametrize(
    "position",
    [[int("1" * 400), 56.9, 5.0], [9.9, 56.9, int("1" * 400)], [True, 56.9, 5.0], [9.9, 56.9, False], [9.9, "x", 5.0]],
)
def test_geojson_positions_that_are_no_numbers_are_left_out_and_told(tmp_path: Path, position: list[Any]) -> None:
    path = write_geojson_points(tmp_path)
    root = json.loads(path.read_text(encoding="utf-8"))
    root["features"].append(feature({"type": "Point", "coordinates": position}))
    path.write_text(json.dumps(root), encoding="utf-8")
    points = read_height_points(str(path))
    assert len(points.heights_m) == len(POINTS)
    (remark,) = points.remarks
    assert remark.startswith("1 point of") and remark.endswith("without place or height left out.")


def test_a_unit_that_no_column_says_is_told(tmp_path: Path) -> None:
    path = write_points_csv(tmp_path / "unsaid.csv", POINTS, HEIGHTS_M, ("lon", "lat", "Elevation"))
    (remark,) = read_elevation(path, FIELD).remarks
    assert "does not say its unit; its heights are taken as metres" in remark and "Elevation_ft" in remark


def test_local_fields_take_points_in_their_metres(tmp_path: Path) -> None:
    rows = [f"{x:.3f},{y:.3f},{z:.4f}" for (x, y), z in zip(POINTS, HEIGHTS_M, strict=True)]
    path = tmp_path / "local.csv"
    path.write_text("x_m,y_m,z_m\n" + "\n".join(rows), encoding="utf-8")
    grid = read_elevation(path, Field("Yard", FIELD.boundary))
    assert np.abs(measure_errors(grid, PLANE)).max() < 2e-3 and grid.remarks == ()


def write_geopackage(path: Path, heights: Floats | None, layers: tuple[str, ...] = ("points",)) -> Path:
    """Layers of points in degrees, in a GeoPackage."""
    from pyogrio.raw import write

    places = DEGREES if heights is None else np.column_stack([DEGREES, heights])
    for number, layer in enumerate(layers):
        shapes = shapely.to_wkb(shapely.points(places), output_dimension=places.shape[1])
        kind, crs = ("Point" if heights is None else "Point Z"), ("EPSG:4326", "EPSG:4258")[number]
        numbers = [np.arange(len(places))]
        write(path, shapes, numbers, ["id"], geometry_type=kind, crs=crs, driver="GPKG", layer=layer, append=number > 0)
    return path


def test_a_geopackage_holds_points(tmp_path: Path) -> None:
    points = read_height_points(str(write_geopackage(tmp_path / "points.gpkg", HEIGHTS_M)))
    assert points.crs == "EPSG:4326" and points.heights_m == pytest.approx(HEIGHTS_M)
    with pytest.raises(HeadlandError, match="are without a height or at 0"):
        read_elevation(write_geopackage(tmp_path / "flat.gpkg", None), FIELD)
    with pytest.raises(HeadlandError, match="are in 2 coordinate systems; keep the one with heights"):
        read_elevation(write_geopackage(tmp_path / "two.gpkg", HEIGHTS_M, ("one", "two")), FIELD)


def test_a_collection_of_geometries_holds_points(tmp_path: Path) -> None:
    shapes = [
        {"type": "Point", "coordinates": [lon, lat, height]}
        for (lon, lat), height in zip(DEGREES.tolist(), HEIGHTS_M.tolist(), strict=True)
    ]
    path = tmp_path / "collection.geojson"
    path.write_text(json.dumps({"type": "GeometryCollection", "geometries": shapes}), encoding="utf-8")
    assert read_height_points(str(path)).heights_m == pytest.approx(HEIGHTS_M)
    flat = json.dumps({"type": "MultiPoint", "coordinates": [[*place, 0] for place in DEGREES.tolist()]})
    path.write_text(flat, encoding="utf-8")
    with pytest.raises(HeadlandError, match="are without a height or at 0"):
        read_height_points(str(path))
