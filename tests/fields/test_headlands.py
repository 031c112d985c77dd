"""Headlands that stand in field files: their inner edges and widths, whatever the form."""

from pathlib import Path

import pytest

from fields.documents.reader import list_fields, read_field
from fields.documents.writer import write_field
from fields.geometry.field import Field
from tests.drawn_fields import feature, write_features
from tests.fields.farm_files import agopengps, partfield, place, points, polygon, taskdata, write_taskdata

FIELD_M = ((0, 0), (300, 0), (300, 200), (0, 200))
EDGE_M = ((12, 12), (288, 12), (288, 188), (12, 188))


def geojson(folder: Path, *headland: dict[str, object]) -> Path:
    boundary = feature({"type": "Polygon", "coordinates": [degrees(FIELD_M)]}, role="boundary")
    return write_features(folder / "field.geojson", boundary, *(feature(one, role="headland") for one in headland))


def degrees(ring: tuple[tuple[float, float], ...]) -> list[list[float]]:
    return [[*reversed(place(*one))] for one in (*ring, ring[0])]


def twelve_metres(field: Field) -> None:
    (edge,) = field.headland_edges
    assert edge.min_width_m == pytest.approx(12.0, abs=0.02) and edge.max_width_m == pytest.approx(12.0, abs=0.02)
    assert edge.line.length == pytest.approx(2 * (276 + 176), rel=1e-3)
    assert not [one for one in field.remarks if "headland" in one]


def test_of_isoxml(tmp_path: Path) -> None:
    headland = f'<PLN A="10"><LSG A="1">{points(*FIELD_M)}</LSG><LSG A="2">{points(*EDGE_M)}</LSG></PLN>'
    twelve_metres(read_field(write_taskdata(tmp_path, taskdata(partfield(polygon(rings=(FIELD_M,)) + headland)))))


def test_of_geojson_as_a_line_or_as_an_area(tmp_path: Path) -> None:
    twelve_metres(read_field(geojson(tmp_path, {"type": "LineString", "coordinates": degrees(EDGE_M)})))
    ring = {"type": "Polygon", "coordinates": [degrees(FIELD_M), degrees(EDGE_M)]}
    twelve_metres(read_field(geojson(tmp_path, ring)))
    assert len(list_fields(geojson(tmp_path, ring))) == 1


def test_of_agopengps(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    edge = [(-85, -65), (85, -65), (85, 65), (-85, 65)]
    rows = "".join(f"{east},{north},0.0\n" for east, north in edge)
    (folder / "Headland.txt").write_text(f"$Headland\n4\n{rows}0\n0\n")
    (found,) = read_field(folder).headland_edges
    assert (
        found.min_width_m < found.median_width_m == pytest.approx(15.0, rel=1e-3)
    )  # the ponds lie nearer to some places


def test_lines_and_headlands_are_kept_when_a_field_is_written(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    (folder / "Headland.txt").write_text("$Headland\n4\n-85,-65\n85,-65\n85,65\n-85,65\n")
    once = read_field(folder)
    write_field(once, tmp_path / "again.geojson")
    again = read_field(tmp_path / "again.geojson")
    assert (
        [one.name for one in again.guidance_lines] == [one.name for one in once.guidance_lines] == ["AB north", "Bend"]
    )
    assert again.headland_edges[0].line.hausdorff_distance(once.headland_edges[0].line) < 1e-6
