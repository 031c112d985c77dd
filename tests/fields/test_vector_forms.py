"""Shapefile, KML, GeoPackage and GPX, written by GDAL and read back: the same ground, lines and gate."""

import zipfile
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from fields.documents.reader import list_fields, read_field
from fields.errors import FieldError
from fields.geometry.geodesy import project

CRS = "EPSG:25832"
CORNER = np.array([565_000.0, 6_210_000.0])
OUTLINE = shapely.Polygon(
    CORNER + np.array([(0, 0), (300, 0), (300, 200), (0, 200)]),
    [CORNER + np.array([(100, 80), (140, 80), (140, 120), (100, 120)])],
)
LINE = shapely.LineString(CORNER + np.array([(20, 10), (20, 190)]))
GATE = shapely.Point(CORNER + np.array([0.0, 50.0]))
AREA_M2 = 300 * 200 - 40 * 40


def write(path: Path, shapes: list[shapely.Geometry], names: list[str], crs: str | None = CRS, **more: object) -> None:
    kind = shapes[0].geom_type if len({one.geom_type for one in shapes}) == 1 else "Unknown"
    pyogrio.raw.write(
        path, np.array([shapely.to_wkb(one) for one in shapes], dtype=object),
        [np.array(names, dtype=object)], np.array(["Name" if path.suffix == ".kml" else "NAME"]),
        geometry_type=kind, crs=crs, **({"driver": "KML"} if path.suffix == ".kml" else {}), **more,
    )  # fmt: skip


def in_degrees(shape: shapely.Geometry) -> shapely.Geometry:
    return shapely.transform(shape, lambda points: project(points, CRS, "EPSG:4326"))


def assert_same_ground(path: Path) -> None:
    field = read_field(path)
    there = shapely.transform(OUTLINE, lambda points: project(points, CRS, str(field.crs)) - np.array(field.origin_m))
    assert field.boundary.symmetric_difference(there).area < 0.01 * field.boundary.length
    assert field.workable_region.area == pytest.approx(AREA_M2, rel=1e-3)


@pytest.fixture
def shapefile(tmp_path: Path) -> Path:
    folder = tmp_path / "farm"
    folder.mkdir()
    write(folder / "north.shp", [OUTLINE], ["North"])
    return folder


def test_a_shapefile_in_a_national_system(shapefile: Path) -> None:
    assert_same_ground(shapefile / "north.shp")
    assert_same_ground(shapefile / "north.dbf")
    assert_same_ground(shapefile)
    assert read_field(shapefile).name == "North"


def test_a_zipped_shapefile_in_a_folder_of_the_archive(shapefile: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "farm.zip", "w") as archive:
        for part in shapefile.iterdir():
            archive.write(part, f"Export/{part.name}")
    assert_same_ground(tmp_path / "farm.zip")


def test_without_prj_the_system_is_asked_for_and_never_guessed(shapefile: Path) -> None:
    (shapefile / "north.prj").unlink()
    with pytest.raises(FieldError, match=r"does not name its coordinate system.*crs.*EPSG:25832"):
        read_field(shapefile)
    field = read_field(shapefile, crs=CRS)
    assert field.workable_region.area == pytest.approx(AREA_M2, rel=1e-3)


def test_a_system_that_contradicts_the_file_is_refused(shapefile: Path) -> None:
    with pytest.raises(FieldError, match="leave out crs EPSG:28992"):
        read_field(shapefile, crs="EPSG:28992")


def test_a_shapefile_without_its_index(shapefile: Path) -> None:
    (shapefile / "north.shx").unlink()
    with pytest.raises(FieldError, match=r"lacks north\.shx"):
        read_field(shapefile / "north.shp")


def test_northing_before_easting_is_exchanged_when_asked(tmp_path: Path) -> None:
    turned = shapely.transform(OUTLINE, lambda points: points[:, ::-1])
    write(tmp_path / "turned.shp", [turned], ["N"])
    field = read_field(tmp_path / "turned.shp", swap_axes=True)
    assert field.workable_region.area == pytest.approx(AREA_M2, rel=1e-3)


def test_latitude_before_longitude_is_recognised_and_the_remedy_named(tmp_path: Path) -> None:
    turned = shapely.transform(in_degrees(OUTLINE), lambda points: points[:, ::-1] + np.array([0.0, 130.0]))
    write(tmp_path / "turned.shp", [turned], ["N"], crs="EPSG:4326")
    with pytest.raises(FieldError, match="latitude before longitude; swap them with swap"):
        read_field(tmp_path / "turned.shp")


@pytest.mark.parametrize("ending", ["gpkg", "fgb"])
def test_boundary_line_and_gate_of_one_layer(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"farm.{ending}"
    write(path, [OUTLINE, LINE, GATE], ["North", "AB 1", "Gate"])
    assert_same_ground(path)
    field = read_field(path)
    (line,) = field.guidance_lines
    assert (line.name, line.line.length) == ("AB 1", pytest.approx(180.0, rel=1e-3))
    assert field.entrance is not None
    assert field.boundary.exterior.distance(shapely.Point(field.entrance)) < 0.05


def test_layers_in_different_systems_meet(tmp_path: Path) -> None:
    path = tmp_path / "farm.gpkg"
    write(path, [OUTLINE], ["North"], layer="fields")
    write(path, [in_degrees(LINE)], ["AB 1"], crs="EPSG:4326", layer="lines", append=False)
    field = read_field(path)
    assert field.workable_region.area == pytest.approx(AREA_M2, rel=1e-3)
    assert field.guidance_lines[0].line.within(field.boundary)


def kml(tmp_path: Path) -> Path:
    path = tmp_path / "doc.kml"
    write(path, [in_degrees(one) for one in (OUTLINE, LINE, GATE)], ["North", "AB 1", "Gate"], crs="EPSG:4326")
    return path


def test_kml_and_kmz(tmp_path: Path) -> None:
    path = kml(tmp_path)
    assert_same_ground(path)
    with zipfile.ZipFile(tmp_path / "farm.kmz", "w") as archive:
        archive.write(path, "doc.kml")
    assert_same_ground(tmp_path / "farm.kmz")
    assert [one.name for one in read_field(tmp_path / "farm.kmz").guidance_lines] == ["AB 1"]


def test_a_track_round_the_field_is_its_boundary(tmp_path: Path) -> None:
    points = shapely.get_coordinates(in_degrees(shapely.LineString(OUTLINE.exterior.coords)))[:-1]
    way = "".join(f'<trkpt lat="{y:.8f}" lon="{x:.8f}"/>' for x, y in points)
    gap = in_degrees(shapely.Point(CORNER + np.array([0.0, 8.0])))
    way += f'<trkpt lat="{gap.y:.8f}" lon="{gap.x:.8f}"/>'
    (tmp_path / "walk.gpx").write_text(
        '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1">'
        f"<trk><name>Walk</name><trkseg>{way}</trkseg></trk></gpx>"
    )
    field = read_field(tmp_path / "walk.gpx")
    assert (field.name, field.workable_region.area) == ("Walk", pytest.approx(60_000, rel=1e-3))


def test_a_track_that_does_not_come_back(tmp_path: Path) -> None:
    line = shapely.get_coordinates(in_degrees(LINE))
    way = "".join(f'<trkpt lat="{y}" lon="{x}"/>' for x, y in line)
    (tmp_path / "walk.gpx").write_text(
        f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{way}</trkseg></trk></gpx>'
    )
    with pytest.raises(FieldError, match="no track that returns"):
        read_field(tmp_path / "walk.gpx")


def test_a_track_of_a_receiver_that_stood_still_is_no_boundary(tmp_path: Path) -> None:
    corners = shapely.get_coordinates(in_degrees(OUTLINE.exterior))
    tracks = [corners, np.repeat(corners[:1], 6, axis=0)]
    ways = ("".join(f'<trkpt lat="{y:.8f}" lon="{x:.8f}"/>' for x, y in points) for points in tracks)
    body = "".join(f"<trk><trkseg>{way}</trkseg></trk>" for way in ways)
    (tmp_path / "walk.gpx").write_text(f'<gpx version="1.1" creator="t">{body}</gpx>')
    assert read_field(tmp_path / "walk.gpx").workable_region.area == pytest.approx(60_000, rel=1e-3)


def test_a_boundary_with_the_point_of_its_label_is_a_boundary(tmp_path: Path) -> None:
    ring = " ".join(f"{x},{y},0" for x, y in shapely.get_coordinates(in_degrees(OUTLINE.exterior)))
    label = in_degrees(shapely.Point(CORNER + 20.0))
    (tmp_path / "label.kml").write_text(
        '<kml xmlns="http://www.opengis.net/kml/2.2"><Placemark><name>North</name><MultiGeometry>'
        f"<Point><coordinates>{label.x},{label.y}</coordinates></Point><Polygon><outerBoundaryIs><LinearRing>"
        f"<coordinates>{ring}</coordinates></LinearRing></outerBoundaryIs></Polygon></MultiGeometry></Placemark></kml>"
    )
    field = read_field(tmp_path / "label.kml")
    assert field.workable_region.area == pytest.approx(60_000, rel=1e-3) and not field.obstacles


@pytest.mark.parametrize("encoding", ["UTF-8", "ISO-8859-1"])
def test_names_of_a_shapefile_without_a_code_page(tmp_path: Path, encoding: str) -> None:
    write(tmp_path / "north.shp", [OUTLINE], ["Grüne Höhe"], encoding=encoding)
    (tmp_path / "north.cpg").unlink()
    assert read_field(tmp_path / "north.shp").name == "Grüne Höhe"


@pytest.mark.parametrize(("page", "name"), [("CP936", "一"), ("CP1251", "Поле"), ("UTF-8", "一"), ("1252", "Höhe")])
def test_the_code_page_that_a_shapefile_states_is_that_of_its_names(tmp_path: Path, page: str, name: str) -> None:
    write(tmp_path / "north.shp", [OUTLINE], [name], encoding=page if page.startswith(("CP", "UTF")) else f"CP{page}")
    (tmp_path / "north.cpg").write_text(page)
    assert read_field(tmp_path / "north.shp").name == name


def test_four_hundred_fields_in_a_file(tmp_path: Path) -> None:
    shapes = [
        shapely.transform(OUTLINE, lambda points, east=400.0 * i: points + np.array([east, 0.0])) for i in range(400)
    ]
    write(tmp_path / "many.gpkg", shapes, [f"f{i}" for i in range(400)])
    assert len(list_fields(tmp_path / "many.gpkg")) == 400
    assert read_field(f"{tmp_path / 'many.gpkg'}#f399").name == "f399"


@pytest.mark.parametrize("ending", ["shp", "kml", "gpkg", "gpx"])
def test_what_is_no_such_file_is_one_sentence(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"bad.{ending}"
    path.write_bytes(b"this is no field")
    (tmp_path / "bad.shx").write_bytes(b"nor is this")
    with pytest.raises(FieldError) as refusal:
        read_field(path)
    assert str(refusal.value).count("\n") == 0 and str(refusal.value).endswith(".")


def test_names_that_lead_out_of_an_archive(tmp_path: Path) -> None:
    for name in ("../evil.shp", "/evil.shp", "C:\\evil.shp"):
        with zipfile.ZipFile(tmp_path / "evil.zip", "w") as archive:
            archive.writestr(name, b"x")
        with pytest.raises(FieldError, match="a path outside the archive"):
            read_field(tmp_path / "evil.zip")


def test_an_archive_that_unpacks_to_too_much(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        info = zipfile.ZipInfo("a.shp")
        archive.writestr(info, b"\0" * 1000)
    content = bytearray((tmp_path / "bomb.zip").read_bytes())
    size = (2**31).to_bytes(4, "little")
    place = content.rindex(b"PK\x01\x02")
    content[place + 24 : place + 28] = size
    (tmp_path / "bomb.zip").write_bytes(bytes(content))
    with pytest.raises(FieldError, match="unpacks to more than 256 MB"):
        read_field(tmp_path / "bomb.zip")


def test_an_archive_that_says_it_is_small(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fields.formats.archive.MAX_BYTES", 10_000)
    with zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TASKDATA.XML", b" " * 1_000_000)
    content = bytearray((tmp_path / "bomb.zip").read_bytes())
    for mark, offset in ((b"PK\x01\x02", 24), (b"PK\x03\x04", 22)):
        place = content.rindex(mark)
        content[place + offset : place + offset + 4] = (100).to_bytes(4, "little")
    (tmp_path / "bomb.zip").write_bytes(bytes(content))
    with pytest.raises(FieldError):
        read_field(tmp_path / "bomb.zip")


def test_capital_endings(shapefile: Path) -> None:
    for part in list(shapefile.iterdir()):
        part.rename(part.with_name(part.name.upper()))
    assert_same_ground(shapefile / "NORTH.SHP")


def test_local_metres_of_a_shapefile_without_system(shapefile: Path) -> None:
    (shapefile / "north.prj").unlink()
    assert read_field(shapefile, local=True).workable_region.area == pytest.approx(AREA_M2)


@pytest.mark.parametrize(
    ("crs", "words"), [("", "crs is empty"), ("EPSG:25832", "look like degrees"), ("x", "is unknown")]
)
def test_systems_that_cannot_be(crs: str, words: str) -> None:
    with pytest.raises(FieldError, match=words):
        read_field("denmark", crs=crs)


@pytest.mark.filterwarnings("ignore:'crs' was not provided")
def test_a_geopackage_without_a_system_is_not_guessed_at(tmp_path: Path) -> None:
    write(tmp_path / "n.gpkg", [OUTLINE], ["N"], crs=None)
    with pytest.raises(FieldError, match="does not name its coordinate system"):
        read_field(tmp_path / "n.gpkg")


def test_a_walk_that_goes_on_past_its_start(tmp_path: Path) -> None:
    corners = np.array([(0, 0), (300, 0), (300, 200), (0, 200), (0, 0), (12, -2)])
    points = shapely.get_coordinates(in_degrees(shapely.LineString(CORNER + corners)))
    way = "".join(f'<trkpt lat="{y:.8f}" lon="{x:.8f}"/>' for x, y in points)
    (tmp_path / "walk.gpx").write_text(
        f'<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><trkseg>{way}</trkseg></trk></gpx>'
    )
    assert read_field(tmp_path / "walk.gpx").workable_region.area == pytest.approx(60_000, rel=1e-3)
