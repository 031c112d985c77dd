"""Hundreds of damaged files for every reader: each is read or refused in one sentence, never anything else."""

import os
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from fields.errors import FieldError, HeadlandError
from fields.formats import agopengps, gpx, isoxml, kml
from fields.formats.geojson import parse_geojson
from tests.fields.farm_files import agopengps as draw_agopengps
from tests.fields.farm_files import partfield, pattern, points, polygon, taskdata, write_taskdata

CASES = int(os.environ.get("HEADLAND_TEST_CASES", "300"))
"""What is damaged is the same every time; HEADLAND_TEST_CASES damages more."""
ODD = [
    "",
    "-1",
    "0",
    "1e999",
    "nan",
    "99999999999",
    "$",
    "True",
    "\u0000",
    "ä€",
    "<PNT/>",
    "9" * 400,
    "1,5",
    "[]",
    "null",
]
GEOJSON = (
    '{"type": "FeatureCollection", "features": [{"type": "Feature", "id": 1, "properties": {"name": "a", "role": ""},'
    ' "geometry": {"type": "Polygon", "coordinates": [[[10.0, 50.0], [10.01, 50.0], [10.01, 50.01], [10.0, 50.0]]]}},'
    ' {"type": "Feature", "properties": {"role": "obstacle", "kind": "pole"}, "geometry":'
    ' {"type": "Point", "coordinates": [10.005, 50.002]}}]}'
)
KML = (
    '<kml xmlns="http://www.opengis.net/kml/2.2"><Document><Placemark><name>a</name><Polygon><outerBoundaryIs>'
    "<LinearRing><coordinates>10,50 10.01,50 10.01,50.01 10,50</coordinates></LinearRing></outerBoundaryIs></Polygon>"
    "</Placemark></Document></kml>"
)
GPX = (
    '<gpx version="1.1" creator="t" xmlns="http://www.topografix.com/GPX/1/1"><trk><name>a</name><trkseg>'
    '<trkpt lat="50" lon="10"/><trkpt lat="50" lon="10.01"/><trkpt lat="50.01" lon="10.01"/><trkpt lat="50" lon="10"/>'
    "</trkseg></trk></gpx>"
)


def damaged(text: str, draw: random.Random) -> str:
    """The text with one to four of its words changed, doubled, exchanged or cut, between the marks of its form."""
    for _ in range(draw.randint(1, 4)):
        marks = [place for place, letter in enumerate(text) if letter in '"<>,[]{} \n='] or [0]
        start = draw.choice(marks)
        end = min(
            draw.choice([start + 1, start + draw.randint(1, 40), *(one for one in marks if one > start)][:3]), len(text)
        )
        piece = draw.choice([draw.choice(ODD), text[start:end] * 2, text[end : 2 * end - start], ""])
        text = text[: start + 1] + piece + text[end:]
        if draw.random() < 0.05:
            text = text[: draw.randrange(len(text) + 1)]
    return text


def ends_well(read: Callable[[], object], refusal_type: type[HeadlandError] = FieldError) -> bool:
    """True where it is read, False where it is refused in one sentence."""
    try:
        read()
    except refusal_type as refusal:
        assert "\n" not in str(refusal) and str(refusal).rstrip().endswith(".")
        return False
    return True


def survey(read: Callable[[str], object], text: str) -> None:
    """Every case ends well, and some of both kinds come up, or the damage is of the wrong size."""
    draw = random.Random(20261)
    good = sum(ends_well(lambda: read(damaged(text, draw))) for _ in range(CASES))
    assert 10 < good < CASES - 10


def test_geojson() -> None:
    survey(lambda text: parse_geojson(text, "'x'"), GEOJSON)


def test_isoxml(tmp_path: Path) -> None:
    whole = taskdata(partfield(polygon() + pattern("Main", "1", points((10, 0), (10, 200), kind="6"))))
    folder = write_taskdata(tmp_path, whole)

    def read(text: str) -> object:
        (folder / "TASKDATA.XML").write_text(text, errors="replace")
        return isoxml.FIELD_FORMAT.read(str(folder), "'x'")

    survey(read, whole)


@pytest.mark.parametrize("file", ["Field.txt", "Boundary.txt", "TrackLines.txt"])
def test_agopengps(tmp_path: Path, file: str) -> None:
    folder = draw_agopengps(tmp_path)
    whole = (folder / file).read_text()
    draw = random.Random(20262)
    for _ in range(CASES // 3 + 1):
        (folder / file).write_text(damaged(whole, draw))
        ends_well(lambda: agopengps.FIELD_FORMAT.read(str(folder), "'x'"))


@pytest.mark.slow
@pytest.mark.parametrize(("form", "text", "name"), [(kml, KML, "a.kml"), (gpx, GPX, "a.gpx")])
def test_forms_that_gdal_reads(tmp_path: Path, form: object, text: str, name: str) -> None:
    def read(damage: str) -> object:
        (tmp_path / name).write_text(damage)
        return form.FIELD_FORMAT.read(str(tmp_path / name), "'x'")  # type: ignore[attr-defined]

    survey(read, text)


def test_archives(tmp_path: Path) -> None:
    import zipfile

    path = tmp_path / "farm.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("TASKDATA/TASKDATA.XML", taskdata(partfield(polygon())))
    whole = path.read_bytes()
    draw = random.Random(20263)
    for _ in range(CASES):
        content = bytearray(whole)
        for _ in range(draw.randint(1, 6)):
            content[draw.randrange(len(content))] = draw.randrange(256)
        path.write_bytes(bytes(content[: draw.choice([len(content), draw.randrange(len(content))])]))
        ends_well(lambda: isoxml.FIELD_FORMAT.read(str(path), "'x'"))
