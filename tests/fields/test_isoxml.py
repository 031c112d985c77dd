"""ISOXML task data, versions 3 and 4: fields, lines and obstacles as drawn, and what is wrong with a file said."""

import zipfile
from pathlib import Path

import pytest

from fields.documents.reader import list_fields, read_field
from fields.documents.sources import list_field_files
from fields.errors import FieldError
from tests.fields.farm_files import INNER, OUTER, partfield, pattern, place, points, polygon, taskdata, write_taskdata

AREA_M2 = 300 * 200 - 40 * 40
AB = points((10, 0), kind="6") + points((10, 200), kind="7")


def read(folder: Path, *inside: str, **more: int):  # type: ignore[no-untyped-def]
    return read_field(write_taskdata(folder, taskdata(*inside, **more)))


def test_a_partfield_with_a_hole_a_line_a_gate_and_obstacles(tmp_path: Path) -> None:
    gate = '<PNT A="3" C="{:.9f}" D="{:.9f}"/>'.format(*place(0, 50))
    pole = '<PNT A="5" B="mast" C="{:.9f}" D="{:.9f}"/>'.format(*place(200, 50))
    pond = f'<PLN A="3" B="pond"><LSG A="1">{points((20, 20), (40, 20), (40, 40), (20, 40))}</LSG></PLN>'
    field = read(tmp_path, partfield(polygon() + pattern("Main", "1", AB) + gate + pole + pond))
    assert (field.name, field.crs) == ("Long acre", "EPSG:32633")
    assert field.boundary.area == pytest.approx(AREA_M2, rel=1e-3)
    assert sorted((one.kind, one.name) for one in field.obstacles) == [("pole", "mast"), ("water", "pond")]
    assert field.entrance is not None
    (line,) = field.guidance_lines
    assert (line.name, line.line.length) == ("Main", pytest.approx(200.0, rel=1e-3))
    assert line.bearing_deg % 180 == pytest.approx(0.0, abs=0.01) or line.bearing_deg % 180 > 179.9
    assert field.remarks == ()


def test_of_several_gates_none_is_guessed(tmp_path: Path) -> None:
    gates = "".join('<PNT A="3" B="North" C="{:.9f}" D="{:.9f}"/>'.format(*place(0, north)) for north in (50, 90))
    field = read(tmp_path, partfield(polygon() + gates))
    assert field.entrance is None and not field.obstacles
    names = ", ".join("'North at {1:.6f},{0:.6f}'".format(*place(0, north)) for north in (50, 90))
    assert f"Which is the entrance is unclear: {names}; choose one with --entrance LON,LAT." in field.remarks


def test_version_3_has_its_lines_beside_the_polygons(tmp_path: Path) -> None:
    line = f'<LSG A="5" B="Old line" C="3000">{points((0, 0), (300, 0))}</LSG>'
    field = read(tmp_path, partfield(line + polygon()), version=3)
    assert field.guidance_lines[0].name == "Old line"
    assert field.guidance_lines[0].bearing_deg == pytest.approx(90.0, abs=0.01)


def test_a_line_by_point_and_heading(tmp_path: Path) -> None:
    field = read(tmp_path, partfield(polygon() + pattern("Plus", "2", points((10, 10), kind="6"), 'G="30"')))
    assert field.guidance_lines[0].bearing_deg == pytest.approx(30.0, abs=0.01)
    assert field.guidance_lines[0].line.length == pytest.approx(100.0, rel=1e-3)


def test_archive_folder_and_file_are_the_same(tmp_path: Path) -> None:
    folder = write_taskdata(tmp_path, taskdata(partfield(polygon())))
    with zipfile.ZipFile(tmp_path / "TASKDATA.zip", "w") as archive:
        archive.write(folder / "TASKDATA.XML", "taskdata/TaskData.xml")
        archive.writestr("__MACOSX/taskdata/._TASKDATA.XML", b"\0\0")
    fields = [read_field(where) for where in (folder, tmp_path, folder / "TASKDATA.XML", tmp_path / "TASKDATA.zip")]
    assert all(field.boundary.equals(fields[0].boundary) for field in fields)


def test_partfields_in_external_files(tmp_path: Path) -> None:
    folder = write_taskdata(tmp_path, taskdata('<XFR A="PFD00000" B="1"/><XFR A="DVC00000" B="1"/>'))
    with pytest.raises(FieldError, match=r"PFD00000\.XML, which is missing"):
        read_field(folder)
    (folder / "pfd00000.xml").write_text(f"<XFC>{partfield(polygon())}</XFC>")
    assert read_field(folder).boundary.area == pytest.approx(AREA_M2, rel=1e-3)


def test_exchanged_rings_are_turned_and_told(tmp_path: Path) -> None:
    field = read(tmp_path, partfield(polygon(rings=(INNER, OUTER))))
    assert field.boundary.area == pytest.approx(AREA_M2, rel=1e-3)
    assert any("outer and inner rings of 'Long acre' are swapped" in one for one in field.remarks)


def test_rings_of_one_point_are_counted(tmp_path: Path) -> None:
    field = read(tmp_path, partfield(polygon(rings=(OUTER, INNER, ((5, 5),), ((6, 6), (7, 7))))))
    assert len(field.boundary.interiors) == 1
    assert "Skipped in 'Long acre': 2 rings with fewer than 3 points." in field.remarks


def test_several_outer_rings_are_several_fields(tmp_path: Path) -> None:
    east = tuple((x + 400, y) for x, y in OUTER)
    folder = write_taskdata(tmp_path, taskdata(partfield(polygon("1", "1", (OUTER, east)), area_m2=0)))
    assert [round(one.area_ha or 0.0, 1) for one in list_fields(folder)] == [6.0, 6.0]


def test_the_same_ring_again_is_one_field(tmp_path: Path) -> None:
    folder = write_taskdata(tmp_path, taskdata(partfield(polygon() + polygon())))
    assert len(list_fields(folder)) == 1


def test_fields_without_boundary_and_without_name(tmp_path: Path) -> None:
    second = partfield("", name="No ground", key="PFD2")
    field = read(tmp_path, partfield(polygon(), name=""), second)
    assert field.name == "PFD1"
    assert "Partfields without a boundary are skipped: No ground." in field.remarks


def test_ids_that_stand_twice_get_a_number(tmp_path: Path) -> None:
    east = tuple((x + 400, y) for x, y in OUTER)
    folder = write_taskdata(
        tmp_path, taskdata(partfield(polygon()), partfield(polygon(rings=(east,)), "Other", 60_000, "PFD1"))
    )
    assert [one.key for one in list_fields(folder)] == ["PFD1-1", "PFD1-2"]
    assert read_field(f"{folder}#PFD1-2").name == "Other"


def test_latitude_and_longitude_exchanged_are_told_by_the_stated_area(tmp_path: Path) -> None:
    text = taskdata(partfield(polygon())).replace(' C="4', ' X="4').replace(' D="1', ' C="1').replace(' X="', ' D="')
    field = read_field(write_taskdata(tmp_path, text))
    assert any("latitude and longitude seem to be swapped" in one for one in field.remarks)
    right = read_field(write_taskdata(tmp_path, text), swap_axes=True)
    assert right.boundary.area == pytest.approx(AREA_M2, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<a/>", "not ISOXML"),
        ("<ISO11783_TaskData>", "is not valid XML"),
        (taskdata(), "without a partfield with points"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><ISO11783_TaskData/>', "entities"),
        ("<ISO11783_TaskData>" + "<PFD>" * 3000, "nested too deeply"),
        ("", "is empty"),
    ],
)
def test_bad_files_are_one_sentence(tmp_path: Path, text: str, words: str) -> None:
    folder = write_taskdata(tmp_path, text)
    with pytest.raises(FieldError, match=words):
        read_field(folder / "TASKDATA.XML")


def test_a_named_file_is_read_and_not_another_of_its_name(tmp_path: Path) -> None:
    east = tuple((x + 400, y) for x, y in OUTER)
    write_taskdata(tmp_path, taskdata(partfield(polygon(rings=(east,)), "Other", 60_000)))
    (tmp_path / "TASKDATA.XML").write_text(taskdata(partfield(polygon())))
    assert read_field(tmp_path / "TASKDATA.XML").name == "Long acre"
    assert [one.key for one in list_fields(tmp_path)] == ["PFD1-1", "PFD1-2"]


@pytest.mark.parametrize("number", ["nan", "inf"])
def test_positions_without_numbers_are_counted(tmp_path: Path, number: str) -> None:
    ring = points(*OUTER).replace('C="48.000000000"', f'C="{number}"', 1)
    text = taskdata(partfield(f'<PLN A="1"><LSG A="1">{ring}{points((0, 100))}</LSG></PLN>', area_m2=0))
    field = read_field(write_taskdata(tmp_path, text))
    assert "Skipped in 'Long acre': 1 point without a valid position." in field.remarks


def test_what_is_no_line_is_counted(tmp_path: Path) -> None:
    field = read(tmp_path, partfield(polygon() + pattern("Round", "4", points((10, 10), kind="8"))))
    assert "Skipped in 'Long acre': 1 guidance pattern (pivots, spirals, or without points)." in field.remarks


def test_every_file_that_a_field_is_read_from_is_known(tmp_path: Path) -> None:
    folder = write_taskdata(tmp_path, taskdata('<XFR A="PFD00000" B="1"/>'))
    (folder / "PFD00000.XML").write_text(f"<XFC>{partfield(polygon())}</XFC>")
    both = (folder / "PFD00000.XML", folder / "TASKDATA.XML")
    assert list_field_files(str(folder / "TASKDATA.XML")) == both == list_field_files(str(folder))
    assert list_field_files("denmark") == ()


def test_a_boundary_that_is_said_to_be_the_hole_of_its_holes(tmp_path: Path) -> None:
    """By hand: 300 by 200 m less two squares of 40 m."""
    other = tuple((east + 80, north) for east, north in INNER)
    text = taskdata(partfield(polygon("1", "2", (INNER, OUTER, other)), area_m2=56_800))
    field = read_field(write_taskdata(tmp_path, text))
    assert field.boundary.area == pytest.approx(56_800, rel=2e-3) and len(field.boundary.interiors) == 2
    assert any("swapped" in one for one in field.remarks)


def test_flags_named_like_obstacles_and_lines_of_obstacles(tmp_path: Path) -> None:
    flags = "".join(
        '<PNT A="{}" B="{}" C="{:.9f}" D="{:.9f}"/>'.format(kind, name, *place(east, 50))
        for kind, name, east in (("1", "Strommast", 50), ("2", "Marker 7", 90), ("1", "Einfahrt", 0), ("9", "Mast", 70))
    )
    ditch = f'<LSG A="9" B="ditch" C="1500">{points((120, 20), (120, 80))}</LSG>'
    wall = f'<LSG A="9">{points((150, 20), (150, 80))}</LSG>'
    field = read(tmp_path, partfield(polygon() + flags + ditch + wall))
    assert [(one.kind, one.name, one.half_width_m) for one in field.obstacles] == [
        ("line", "ditch", 0.75),
        ("line", "", 0.5),
        ("pylon", "Strommast", 3.0),
    ]
    assert field.entrance is not None
