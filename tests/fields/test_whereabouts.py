"""Longitude and latitude that are exchanged, as far as the place alone tells."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fields.documents.reader import list_fields_with_notes, read_field

SIDE_DEG = 0.002


def written(folder: Path, *corners: tuple[float, float], line: tuple[float, float] | None = None) -> Path:
    """A file with small square fields at these corners (longitude, latitude), and a line that begins at a place."""
    features: list[dict[str, object]] = []
    for number, (x, y) in enumerate(corners):
        ring = [[x, y], [x + SIDE_DEG, y], [x + SIDE_DEG, y + SIDE_DEG], [x, y + SIDE_DEG], [x, y]]
        geometry = {"type": "Polygon", "coordinates": [ring]}
        features.append({"type": "Feature", "properties": {"name": f"Field {number}"}, "geometry": geometry})
    if line is not None:
        ends = {"type": "LineString", "coordinates": [line, [line[0], line[1] + SIDE_DEG]]}
        features.append({"type": "Feature", "properties": {"name": "AB"}, "geometry": ends})
    file = folder / "fields.geojson"
    file.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    return file


def test_a_field_of_india_in_the_arctic_sea(tmp_path: Path) -> None:
    file = written(tmp_path, (28.0, 77.0))
    (told,) = read_field(file).remarks
    assert told.startswith("'Field 0': latitude 77.00, longitude 28.00 is beyond all farmland")
    assert told.endswith("so try the option swap axes.")
    assert read_field(file, swap_axes=True).remarks == ()


def test_exchanged_by_somebody_who_should_not_have(tmp_path: Path) -> None:
    (told,) = list_fields_with_notes(written(tmp_path, (77.0, 28.0)), swap_axes=True)[1]
    assert told.endswith("so leave out the option swap axes.")


def test_the_one_of_three_fields_that_lies_apart(tmp_path: Path) -> None:
    (told,) = list_fields_with_notes(written(tmp_path, (9.5, 56.0), (56.1, 9.6), (9.6, 56.1)))[1]
    assert told.startswith("'Field 1': latitude 9.60, longitude 56.10 is far from everything else in the file")


def test_a_field_far_from_its_own_line(tmp_path: Path) -> None:
    (told,) = list_fields_with_notes(written(tmp_path, (56.0, 9.5), line=(9.5, 56.0)))[1]
    assert "far from everything else" in told


@pytest.mark.parametrize("corners", [
    [(9.5, 56.0)], [(56.0, 9.5)], [(25.7, 66.5)], [(-68.0, -54.0)], [(9.5, 56.0), (-93.6, 42.0), (30.0, -20.0)],
    [(9.5, 56.0), (56.0, 9.5)],
])  # fmt: skip
def test_nothing_is_said_where_nothing_is_known(tmp_path: Path, corners: list[tuple[float, float]]) -> None:
    assert list_fields_with_notes(written(tmp_path, *corners))[1] == ()
