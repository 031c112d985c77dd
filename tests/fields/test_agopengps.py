"""AgOpenGPS folders: metres about a StartFix, whatever sign the computer writes for a decimal point."""

from pathlib import Path

import numpy as np
import pytest
from pyproj import Geod

from fields.documents.reader import read_field
from fields.errors import FieldError
from fields.geometry.geodesy import LocalPlane
from tests.fields.farm_files import agopengps


@pytest.mark.parametrize("comma", [False, True])
def test_the_rectangle_and_its_ponds(tmp_path: Path, comma: bool) -> None:
    field = read_field(agopengps(tmp_path, comma))
    assert field.name == "Back forty" and field.crs == "EPSG:32615"
    assert field.boundary.area == pytest.approx(200 * 160 - 2 * 20 * 20, rel=1e-3)
    assert len(field.boundary.interiors) == 2
    assert [one.name for one in field.guidance_lines] == ["AB north", "Bend"]
    assert field.guidance_lines[0].line.length == pytest.approx(100.0, rel=1e-3)
    assert field.guidance_lines[1].line.length == pytest.approx(np.hypot(20, 40) + np.hypot(30, 20), rel=1e-3)


def test_the_plane_is_that_of_the_program_and_true_to_the_earth() -> None:
    plane, geod = LocalPlane(-93.63, 42.03), Geod(ellps="WGS84")
    for east, north in ((0.0, 1000.0), (1000.0, 0.0), (-700.0, 700.0)):
        longitude, latitude = plane.to_degrees(east, north)
        azimuth, _, distance = geod.inv(-93.63, 42.03, longitude, latitude)
        assert distance == pytest.approx(np.hypot(east, north), rel=2e-4)
        assert azimuth % 360 == pytest.approx(np.degrees(np.arctan2(east, north)) % 360, abs=0.02)


def test_files_of_older_versions(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    (folder / "TrackLines.txt").unlink()
    (folder / "ABLines.txt").write_text("Old AB,90.0,10.0,20.0\n")
    (folder / "CurveLines.txt").write_text("$CurveLines\nOld bend\n0.5\n2\n0.0,0.0,0.0\n0.0,30.0,0.0\n")
    lines = {one.name: one for one in read_field(folder).guidance_lines}
    assert lines["Old AB"].bearing_deg == pytest.approx(90.0, abs=1.0)  # grid north is up to a degree off here
    assert lines["Old bend"].line.length == pytest.approx(30.0, rel=1e-3)


def test_lines_that_older_versions_left_behind_are_not_read_again(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    (folder / "ABLines.txt").write_text("AB north,0.0,6.0,0.0\nDeleted since,90.0,10.0,20.0\n")
    assert [one.name for one in read_field(folder).guidance_lines] == ["AB north", "Bend"]
    (folder / "TrackLines.txt").write_text("$TrackLines\n")
    assert [one.name for one in read_field(folder).guidance_lines] == ["AB north", "Deleted since"]


def test_a_ring_cut_short_is_told(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    text = (folder / "Boundary.txt").read_text().replace("False\n4\n40", "False\n9\n40")
    (folder / "Boundary.txt").write_text(text)
    field = read_field(folder)
    assert len(field.boundary.interiors) == 2
    assert "A ring of 'Back forty' has 4 points, not 9 as stated; these are used." in field.remarks


@pytest.mark.parametrize(
    ("file", "text", "words"),
    [
        ("Field.txt", "nothing", "no StartFix"),
        ("Field.txt", "StartFix\n95.0,200.0\n", "no StartFix"),
        ("Boundary.txt", "$Boundary\nFalse\n2\n0,0,0\n1,1,0\n", "no field with a boundary"),
        ("Boundary.txt", "", "no field with a boundary"),
        ("Boundary.txt", "$Boundary\nFalse\n" + "9" * 5000 + "\n0,0,0\n", "no field with a boundary"),
    ],
)
def test_bad_folders(tmp_path: Path, file: str, text: str, words: str) -> None:
    folder = agopengps(tmp_path)
    (folder / file).write_text(text)
    with pytest.raises(FieldError, match=words):
        read_field(folder)


def test_a_field_whose_outer_ring_is_lost_is_left_out(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    text = (folder / "Boundary.txt").read_text()
    outer = "".join(line + "\n" for line in text.splitlines()[2:7])
    (folder / "Boundary.txt").write_text(text.replace(outer, "1\n0.0,0.0,0.0\n", 1))
    with pytest.raises(FieldError, match="no field with a boundary"):
        read_field(folder)


def test_a_name_that_the_program_makes_up_gives_way_to_the_folder(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    (folder / "Field.txt").write_text((folder / "Field.txt").read_text().replace("Back forty", "FieldNew"))
    assert read_field(folder).name == "Back forty"


def test_lines_that_cannot_be_read_are_counted_and_those_behind_them_kept(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    whole = (folder / "TrackLines.txt").read_text().removeprefix("$TrackLines\n")
    odd = "Odd\n0\nhere,there\n6.0,9.0\n0\n2\nTrue\n0\n"
    pivot = "Pivot\n0\n1.0,1.0\n2.0,2.0\n0\n64\nTrue\n0\n"
    (folder / "TrackLines.txt").write_text("$TrackLines\n" + odd + pivot + whole)
    field = read_field(folder)
    assert [one.name for one in field.guidance_lines] == ["AB north", "Bend"]
    assert "Skipped in 'Back forty': 2 unreadable lines of tracklines.txt." in field.remarks


def test_field_txt_stands_for_its_folder(tmp_path: Path) -> None:
    folder = agopengps(tmp_path)
    assert read_field(folder / "Field.txt").boundary.equals(read_field(folder).boundary)
