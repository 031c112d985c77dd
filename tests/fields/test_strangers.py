"""Whatever is offered under whatever name: refused in a sentence, or read as what its ending says and nothing else."""

import sqlite3
import warnings
import zipfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyogrio
import pytest
import shapely

from fields.documents.reader import list_fields_with_notes, read_field
from fields.errors import FieldError, HeadlandError
from fields.formats.gdal import SHAPEFILE_DRIVER, restrict_gdal_drivers
from fields.geometry.geodesy import is_wgs84_longitude_latitude, project
from planner.task_logs.formats import isoxml_logs, point_shapefiles
from tests.examples import seldom
from tests.fields.strangers import BOX, SECRET, database, listening, offered, vacuum, vrt, written

DRIVERS = sorted(pyogrio.list_drivers())
TRIED = [name for place, name in enumerate(DRIVERS) if name in ("OGR_VRT", "CSV", "SQLite") or place % 4 == 0]
"""Drivers that are tried in every run of CI."""
ENDINGS = (".geojson", ".json", ".kml", ".kmz", ".gpkg", ".fgb", ".gpx", ".xml", ".shp", ".zip")
PACKED = (".geojson", ".kml", ".gpkg", ".fgb", ".gpx", ".shp", ".xml")
GEOJSON = {"GeoJSON", "GeoJSONSeq", "JSONFG"}
OWN = {
    ".geojson": GEOJSON, ".json": GEOJSON, ".zip": GEOJSON, ".kml": {"KML", "LIBKML"},
    ".kmz": {"KML", "LIBKML"}, ".gpkg": {"GPKG", "FlatGeobuf"}, ".fgb": {"GPKG", "FlatGeobuf"}, ".gpx": {"GPX"},
}  # fmt: skip
"""Drivers whose files are what an ending says. GeoPackage and FlatGeobuf are one form, a line of a GeoJSONSeq is
GeoJSON, and so is what has an ending that nobody knows, such as an archive that is none."""
GEOPACKAGE = (
    "CREATE TABLE gpkg_spatial_ref_sys (srs_name, srs_id INTEGER PRIMARY KEY, organization, organization_coordsys_id, "
    "definition, description)",
    "INSERT INTO gpkg_spatial_ref_sys VALUES ('WGS 84', 4326, 'EPSG', 4326, 'undefined', '')",
    "CREATE TABLE gpkg_contents (table_name PRIMARY KEY, data_type, identifier, description, last_change, min_x, "
    "min_y, max_x, max_y, srs_id)",
    "CREATE TABLE gpkg_geometry_columns (table_name, column_name, geometry_type_name, srs_id, z, m)",
    "INSERT INTO gpkg_contents VALUES ('f', 'features', 'f', '', '', 0, 0, 1, 1, 4326)",
    "INSERT INTO gpkg_geometry_columns VALUES ('f', 'geom', 'POLYGON', 4326, 0, 0)",
    "PRAGMA application_id = 1196444487", "PRAGMA user_version = 10300",
)  # fmt: skip


@pytest.fixture
def canary(tmp_path: Path) -> Path:
    """A file that nobody hands to a reader."""
    folder = tmp_path / "elsewhere"
    folder.mkdir()
    (folder / "secret.csv").write_text(f"name,WKT\n{SECRET},POINT(1 2)\n{SECRET},POINT(3 4)\n")
    return folder / "secret.csv"


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """The folder of what is handed to readers."""
    folder = tmp_path / "here"
    folder.mkdir()
    return folder


def places(folder: Path, content: bytes) -> Iterator[tuple[str, Path]]:
    """Content under every ending that is read, and in archives, each with the ending that counts."""
    for ending in ENDINGS:
        place = folder / f"x{ending}"
        place.write_bytes(content)
        if ending == ".shp":
            (folder / "x.shx").write_bytes(content)
            (folder / "x.dbf").write_bytes(content)
        yield ending, place
    for ending in PACKED:
        place = folder / f"packed{ending}.zip"
        with zipfile.ZipFile(place, "w") as archive:
            for part in (ending, *((".shx", ".dbf", ".prj", ".cpg") if ending == ".shp" else ())):
                archive.writestr(f"TASKDATA{part}" if ending == ".xml" else f"x{part}", content)
        yield ending, place
    with zipfile.ZipFile(folder / "x2.kmz", "w") as archive:
        archive.writestr("doc.kml", content)
    yield ".kml", folder / "x2.kmz"


def told(place: Path) -> tuple[str, bool]:
    """All that every reader says of a file, and whether one took it for a field; refusals are one sentence."""
    said, taken = [], False
    for read in (
        list_fields_with_notes,
        read_field,
        lambda one: point_shapefiles.LOG_FORMAT.read(str(one), "'x'"),
        _tasks,
    ):
        try:
            said.append(repr(read(place)))
            taken = taken or read in (list_fields_with_notes, read_field)
        except HeadlandError as refusal:
            said.append(str(refusal))
            assert "\n" not in said[-1] and said[-1].endswith(".")
    return " ".join(said), taken


def _tasks(place: Path) -> object:
    return isoxml_logs.LOG_FORMAT.read(str(place), "'x'")


def files(folder: Path) -> set[Path]:
    return set(folder.rglob("*"))


@pytest.mark.parametrize("driver", [*TRIED, *seldom(*(name for name in DRIVERS if name not in TRIED))])
def test_what_a_driver_of_gdal_would_take(driver: str, here: Path, canary: Path) -> None:
    with listening() as (port, calls):
        for content in offered(driver, canary, port):
            for ending, place in places(here, content):
                before = files(here.parent)
                said, taken = told(place)
                assert files(here.parent) == before, f"{place.name} made a file"
                if driver not in OWN.get(ending, ()):
                    assert not taken and SECRET not in said, f"{driver} as {place.name}: {said}"
        assert calls == []


def test_the_attack_works_on_gdal_itself(here: Path, canary: Path) -> None:
    """Else the tests of this module could not fail."""
    (here / "x.gpkg").write_bytes(vrt(f"CSV:{canary}"))
    if "OGR_VRT" not in DRIVERS:
        pytest.skip("this GDAL has no virtual layers")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert SECRET in repr(pyogrio.raw.read(here / "x.gpkg", layer=pyogrio.list_layers(here / "x.gpkg")[0][0]))


@pytest.mark.parametrize("source", ["CSV:{canary}", "{canary}", "/vsicurl/http://127.0.0.1:{port}/a.csv", "{url}"])
def test_a_virtual_layer_under_every_name(source: str, here: Path, canary: Path) -> None:
    with listening() as (port, calls):
        wanted = source.format(canary=canary, port=port, url=f"WFS:http://127.0.0.1:{port}/")
        for _, place in places(here, vrt(wanted)):
            said, taken = told(place)
            assert not taken and SECRET not in said
        assert calls == []


def test_sql_of_a_virtual_layer_writes_nothing(here: Path, canary: Path) -> None:
    database(canary.with_name("db.sqlite"), "CREATE TABLE a (b)")
    target = here / "made.db"
    for _, place in places(here, vacuum(canary.with_name("db.sqlite"), target)):
        assert not told(place)[1] and not target.exists()


def test_gdal_has_all_its_drivers_again_afterwards(here: Path) -> None:
    before, skipped = list(pyogrio.list_drivers()), pyogrio.get_gdal_config_option("GDAL_SKIP")
    with restrict_gdal_drivers(SHAPEFILE_DRIVER):
        assert list(pyogrio.list_drivers()) == [SHAPEFILE_DRIVER]
        assert pyogrio.get_gdal_config_option("OGR_SQLITE_LOAD_EXTENSIONS") is None
    with pytest.raises(FieldError, match="cannot read Sketches"), restrict_gdal_drivers("Sketches"):
        pass
    assert (list(pyogrio.list_drivers()), pyogrio.get_gdal_config_option("GDAL_SKIP")) == (before, skipped)


def test_a_read_that_fails_gives_the_drivers_back(here: Path) -> None:
    before = list(pyogrio.list_drivers())
    (here / "x.gpx").write_bytes(b"<gpx><trk></gpx>")
    with pytest.raises(FieldError):
        read_field(here / "x.gpx")
    assert list(pyogrio.list_drivers()) == before


def test_gdal_that_cannot_be_held_reads_nothing(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    content = written("FlatGeobuf")
    assert content is not None
    (here / "x.fgb").write_bytes(content)
    monkeypatch.setattr("pyogrio.core._register_drivers", lambda: None)
    with pytest.raises(FieldError, match="cannot be restricted to its"):
        read_field(here / "x.fgb")


@pytest.mark.parametrize(
    ("what", "statement"),
    [
        ("the view 'f'", "CREATE VIEW f AS SELECT 1 AS fid, NULL AS geom, ogr_geocode('here') AS name"),
        ("the view 'f'", "CREATE VIEW f AS SELECT 1 AS fid, NULL AS geom, load_extension('evil') AS name"),
        ("the virtual table 'f'", "CREATE VIRTUAL TABLE f USING fts5(fid, geom, name)"),
        ("a computed column in 'f'", "CREATE TABLE f (fid INTEGER PRIMARY KEY, geom, a AS (abs(fid)) STORED)"),
        ("a computed column in 'f'", "CREATE TABLE f (fid INTEGER PRIMARY KEY, geom, a AS (abs(fid)))"),
    ],
)
def test_a_geopackage_that_would_run_sql(what: str, statement: str, here: Path) -> None:
    content = database(here / "x.gpkg", *GEOPACKAGE, statement)
    with zipfile.ZipFile(here / "x.zip", "w") as archive:
        archive.writestr("y.gpkg", content)
    for place in (here / "x.gpkg", here / "x.zip"):
        with pytest.raises(FieldError, match="which runs SQL when it is read") as refusal:
            read_field(place)
        assert what in str(refusal.value)


def test_a_geopackage_with_a_virtual_table_by_another_spelling(here: Path) -> None:
    """What SQLite would run as a table of another program's, whatever its name says."""
    database(here / "x.gpkg", *GEOPACKAGE, "CREATE TABLE f (fid INTEGER PRIMARY KEY, geom)")
    with sqlite3.connect(here / "x.gpkg") as made:
        made.execute("PRAGMA writable_schema = ON")
        made.execute(
            "INSERT INTO sqlite_master VALUES ('table', 'rtree_f', 'rtree_f', 0, 'create/**/virtual table rtree_f "
            "using VirtualOGR(''CSV:x'')')"
        )
    made.close()
    with pytest.raises(FieldError):
        read_field(here / "x.gpkg")


def test_a_geopackage_that_is_open_elsewhere_is_read_with_what_was_written_last(here: Path) -> None:
    content = written("GPKG")
    assert content is not None
    (here / "x.gpkg").write_bytes(content)
    other = sqlite3.connect(here / "x.gpkg")
    other.execute("PRAGMA journal_mode = WAL")
    for (name,) in other.execute("SELECT name FROM sqlite_master WHERE type = 'trigger'").fetchall():
        other.execute(f'DROP TRIGGER "{name}"')  # they call functions of GDAL's
    other.execute("UPDATE made SET name = 'new'")
    other.commit()
    try:
        assert (here / "x.gpkg-wal").stat().st_size > 0
        assert read_field(here / "x.gpkg").name == "new"
    finally:
        other.close()


def test_a_geopackage_with_a_log_in_an_archive(here: Path) -> None:
    """Its header says that a log stands beside it, which in an archive none does."""
    content = bytearray(written("GPKG") or b"")
    content[18:20] = b"\x02\x02"
    (here / "x.gpkg").write_bytes(content)
    with zipfile.ZipFile(here / "x.zip", "w") as archive:
        archive.writestr("y.gpkg", bytes(content))
    assert read_field(here / "x.gpkg").name == read_field(here / "x.zip").name == SECRET


def shapefile(folder: Path, prj: bytes | None = None) -> Path:
    shapes = np.array([shapely.to_wkb(BOX)], dtype=object)
    pyogrio.raw.write(
        folder / "a.shp", shapes, [np.array(["A"], dtype=object)], np.array(["NAME"]), geometry_type="Polygon",
        crs="EPSG:4326", driver="ESRI Shapefile",
    )  # fmt: skip
    if prj is not None:
        (folder / "a.prj").write_bytes(prj)
    return folder / "a.shp"


@pytest.mark.slow
@pytest.mark.parametrize("first", [0, *(pytest.param(first, marks=pytest.mark.matrix) for first in range(1, 4))])
def test_every_byte_of_a_prj_turned(here: Path, first: int) -> None:
    """Every fourth one from the first on."""
    whole = (shapefile(here).with_suffix(".prj")).read_bytes()
    understood = 0
    for place in range(first, len(whole), 4):
        for flip in (0x01, 0x20, 0x80):
            turned = bytearray(whole)
            turned[place] ^= flip
            shapefile(here, bytes(turned))
            try:
                understood += read_field(here / "a.shp").name == "A"
            except FieldError as refusal:
                assert str(refusal).endswith(".") and "\n" not in str(refusal)
    assert understood > 0


def test_a_prj_that_nobody_understands_counts_as_none(here: Path) -> None:
    place = shapefile(here, b'GEOGCS["a",DATUM["\xff\xfe",SPHEROID["b",6378137,298]],PRIMEM["G",0]]')
    found = read_field(place, crs="EPSG:4326")
    assert found.name == "A" and "The .prj cannot be parsed and is ignored." in found.remarks
    with pytest.raises(FieldError, match="does not name its coordinate system"):
        read_field(place)


@pytest.mark.parametrize(
    "crs",
    [
        "+init={file}:a", "+proj=longlat +datum=WGS84 +nadgrids={file} +type=crs", "+proj=longlat +nadgrids=@../a",
        "+proj=longlat +nadgrids=@null,https://127.0.0.1/a +type=crs", "file://{file}", "{file}",
        'BOUNDCRS[SOURCECRS[x],PARAMETERFILE["Latitude and longitude difference file","{file}"]]',
        '{{"type": "BoundCRS", "value": "{file}"}}', "C:\\a\\b.gsb", "\\\\host\\share\\a.gsb",
    ],
)  # fmt: skip
def test_a_coordinate_system_that_names_a_file(crs: str, canary: Path) -> None:
    text = crs.format(file=canary)
    with pytest.raises(FieldError, match="names the file"):
        is_wgs84_longitude_latitude(text)
    with pytest.raises(FieldError, match="names the file"):
        project(np.zeros((1, 2)), text, "EPSG:4326")


@pytest.mark.parametrize(
    "crs",
    [
        "EPSG:4326", "urn:ogc:def:crs:OGC:1.3:CRS84", "http://www.opengis.net/def/crs/EPSG/0/4326",
        'GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],PRIMEM["Greenwich",0],'
        'UNIT["degree",0.0174532925199433],AUTHORITY["EPSG","4326"]]',
    ],
)  # fmt: skip
def test_usual_names_of_a_coordinate_system(crs: str) -> None:
    assert is_wgs84_longitude_latitude(crs) in (True, False)
    shown = project(np.array([[10.0, 50.0]]), crs, "EPSG:32632")[0]
    assert shown == pytest.approx([571_666.4, 5_539_109.8], abs=1.0)


def test_a_web_map_of_an_old_prj() -> None:
    """Its grids are the file @null, which is none."""
    text = "+proj=merc +a=6378137 +b=6378137 +nadgrids=@null +wktext +no_defs +type=crs"
    assert project(np.array([[0.0, 0.0]]), text, "EPSG:4326")[0] == pytest.approx([0.0, 0.0])
