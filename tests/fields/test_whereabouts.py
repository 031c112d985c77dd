"""Longitude and latitude that are exchanged, as far as the place alone tells."""

import json
import re
from importlib import resources
from pathlib import Path

import pytest
import shapely

from fields.documents.reader import list_fields_with_notes, read_field
from fields.geometry.geodesy import can_be_farmland
from tests.drawn_fields import feature, line, rectangle, write_features
from tests.fields.geojson import refusal

SIDE_DEG = 0.002
FARMS = {
    (9.5, 56.0): True, (13.3, 55.7): True, (5.5, 52.5): True, (11.5, 52.1): True, (141.8, 43.2): True,
    (0.6, 52.5): True, (-8.5, 51.9): True, (-20.3, 63.8): True, (17.6, 59.9): False, (1.6, 48.2): False,
    (-4.7, 41.7): False, (10.6, 45.1): False, (20.5, 47.0): False, (32.0, 49.4): False, (39.0, 45.2): False,
    (82.5, 52.3): True, (63.6, 53.2): False, (75.8, 30.9): True, (79.1, 10.8): True, (92.8, 26.5): True,
    (80.8, 7.2): True, (32.6, 37.9): False, (31.0, 30.9): False, (39.0, 8.6): False, (36.1, -0.3): False,
    (31.0, -17.5): False, (27.0, -28.5): False, (18.9, -33.6): True, (47.5, -19.0): False, (7.7, 10.6): False,
    (-5.5, 33.9): False, (-93.5, 42.0): True, (-120.0, 36.8): True, (-81.0, 26.7): True, (-156.4, 20.8): True,
    (-106.0, 51.5): True, (-63.3, 46.4): True, (-103.0, 20.6): True, (-80.0, 22.4): True, (-55.5, -12.8): True,
    (-48.0, -21.5): True, (-35.3, -8.1): True, (-61.5, -34.5): True, (-65.3, -43.3): True, (-71.4, -34.9): True,
    (-62.8, -17.4): True, (-76.3, 3.6): True, (-59.0, -51.8): True, (127.0, 47.0): True, (86.0, 44.3): True,
    (105.5, 48.8): True, (110.5, -7.3): True, (117.5, -31.5): True, (147.0, -41.6): True, (171.8, -43.7): True,
}  # fmt: skip
"""Longitude and latitude of farmland, and whether it is certain that the place with these swapped is none."""


def written(folder: Path, *corners: tuple[float, float], begin: tuple[float, float] | None = None) -> Path:
    """A file with small square fields at these corners (longitude, latitude), and a line that begins at a place."""
    squares = [rectangle(x, y, SIDE_DEG, SIDE_DEG) for x, y in corners]
    features = [feature(square, name=f"Field {number}") for number, square in enumerate(squares)]
    if begin is not None:
        features.append(feature(line(begin, (begin[0], begin[1] + SIDE_DEG)), name="AB"))
    return write_features(folder / "fields.geojson", *features)


def test_a_field_of_india_in_the_arctic_sea(tmp_path: Path) -> None:
    file = written(tmp_path, (28.0, 77.0))
    assert refusal(file).startswith("'fields.geojson' lies at latitude 77.00, longitude 28.00, in the sea")
    assert refusal(file).endswith("lies on land: add swap_axes.")
    assert read_field(file, swap_axes=True).remarks == ()


@pytest.mark.parametrize("name", ["denmark", "netherlands", "sweden"])
def test_a_sample_with_its_axes_swapped(tmp_path: Path, name: str) -> None:
    degrees = read_field(name).to_wgs84(read_field(name).boundary.exterior.coords)
    file = tmp_path / "swapped.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [degrees[:, ::-1].tolist()]}))
    assert "add swap_axes" in refusal(file)
    assert list_fields_with_notes(file)[0][0].fault.endswith("lies on land: add swap_axes.")
    assert read_field(file, swap_axes=True).area_m2 == pytest.approx(
        shapely.Polygon(read_field(name).boundary.exterior).area, rel=1e-6
    )
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [degrees.tolist()]}))
    assert "leave out swap_axes" in refusal(file, swap_axes=True)


def test_northing_before_easting(tmp_path: Path) -> None:
    ring = [[6_200_000.0, 560_000.0], [6_200_100.0, 560_000.0], [6_200_100.0, 560_100.0], [6_200_000.0, 560_000.0]]
    crs = {"type": "name", "properties": {"name": "EPSG:25832"}}
    file = tmp_path / "utm.geojson"
    file.write_text(json.dumps({"type": "Polygon", "coordinates": [ring], "crs": crs}))
    assert "add swap_axes" in refusal(file)
    assert read_field(file, swap_axes=True).area_m2 == pytest.approx(5_000.0, rel=0.01)


def test_null_island_is_water(tmp_path: Path) -> None:
    file = written(tmp_path, (0.0, 0.0))
    for swap_axes in (False, True):
        assert "in the sea off Africa" in refusal(file, swap_axes=swap_axes)


def test_a_field_in_the_sea_does_not_hide_the_others(tmp_path: Path) -> None:
    fields = list_fields_with_notes(written(tmp_path, (9.5, 56.0), (56.95, 9.9)))[0]
    assert fields[0].fault == "" and "add swap_axes" in fields[1].fault


def test_places_of_farms() -> None:
    assert all(can_be_farmland(*place) for place in FARMS)
    told = {(x, y): abs(x) > 90.0 or not can_be_farmland(y, x) for x, y in FARMS}
    assert told == FARMS


def test_no_inhabited_place_is_refused() -> None:
    """Of the places after which time zones are named, outside Antarctica."""
    table = (resources.files("tzdata") / "zoneinfo" / "zone.tab").read_text(encoding="utf-8")
    rows = [line.split("\t") for line in table.splitlines() if not line.startswith(("#", "AQ"))]
    assert len(rows) > 300
    for _, place, name, *_ in rows:
        latitude, longitude = (parse_degrees(one) for one in re.findall(r"[+-]\d+", place))
        can_be_swapped = abs(longitude) <= 90.0 and can_be_farmland(latitude, longitude)
        assert can_be_farmland(longitude, latitude) or not can_be_swapped or latitude > 72.0, name


def parse_degrees(text: str) -> float:
    """Degrees of a text such as +5540 or -0730130: degrees, minutes and perhaps seconds."""
    digits, has_seconds = text[1:], len(text) > 6
    degrees, rest = (digits[:-4], digits[-4:]) if has_seconds else (digits[:-2], digits[-2:] + "00")
    return float(f"{text[0]}1") * (int(degrees) + int(rest[:2]) / 60.0 + int(rest[2:]) / 3600.0)


def test_the_one_of_three_fields_that_lies_apart(tmp_path: Path) -> None:
    (told,) = list_fields_with_notes(written(tmp_path, (9.5, 56.0), (56.1, 9.6), (9.6, 56.1)))[1]
    assert told.startswith("'Field 1': latitude 9.60, longitude 56.10 is far from everything else in the file")


def test_a_field_far_from_its_own_line(tmp_path: Path) -> None:
    (told,) = list_fields_with_notes(written(tmp_path, (56.0, 9.5), begin=(9.5, 56.0)))[1]
    assert "far from everything else" in told


@pytest.mark.parametrize("corners", [
    [(9.5, 56.0)], [(56.0, 9.5)], [(25.7, 66.5)], [(-68.0, -54.0)], [(9.5, 56.0), (-93.6, 42.0), (30.0, -20.0)],
    [(9.5, 56.0), (56.0, 9.5)],
])  # fmt: skip
def test_nothing_is_said_where_nothing_is_known(tmp_path: Path, corners: list[tuple[float, float]]) -> None:
    assert list_fields_with_notes(written(tmp_path, *corners))[1] == ()
