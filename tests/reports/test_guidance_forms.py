"""Guidance in every form, read back by readers that know nothing of the writers: geometry to a centimetre."""

import io
import math
import os
import re
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from fields.documents.reader import read_field
from fields.formats.guidance import GuidanceFormat, PlanGuidance, build_designator, build_folder_name, zip_files
from planner.pipeline.outputs.guidance_lines import build_guidance
from reports.common.rendering import ReportError
from reports.plan.guidance_export import (
    GUIDANCE_FORMATS,
    collect_remarks,
    find_guidance_format,
    list_content_for_newer_terminals,
    list_unwritten_content,
    write_guidance,
)
from tests.planner.saved_plans import BEND, GROUND, HOLE, POND, SQUARE, in_metres, saved
from vehicle.missions.plan_file import SavedPlan

CLOSE_M = 0.01
FORMS = {form.name: form for form in GUIDANCE_FORMATS}


def turned(one: SavedPlan, turn_rad: float, scale: float) -> SavedPlan:
    """The plan and its field turned about the corner and made larger."""
    matrix = scale * np.array([[math.cos(turn_rad), math.sin(turn_rad)], [-math.sin(turn_rad), math.cos(turn_rad)]])

    def moved(points: Any) -> Any:
        return (np.array(points, dtype=float) @ matrix).tolist()

    missions = tuple(
        replace(each, legs=tuple(replace(leg, points=np.array(moved(leg.points))) for leg in each.legs))
        for each in one.plan.missions
    )
    ground = {
        **GROUND,
        "boundary_m": [moved(ring) for ring in (SQUARE, HOLE)],
        "inside_headland_m": [[moved(ring) for ring in rings] for rings in GROUND["inside_headland_m"]],  # type: ignore[attr-defined]
        "obstacles": [{"name": "pond", "outline_m": [moved(POND)]}],
        "entrance_m": moved(GROUND["entrance_m"]),
    }
    return replace(one, plan=replace(one.plan, missions=missions), ground=ground)


def put(folder: Path, form: GuidanceFormat, guidance: PlanGuidance, curves: bool | None = True) -> list[Path]:
    """What is written, in a folder; what a person would name to read the fields again."""
    made = write_guidance(guidance, form, curves)
    for name, content in made.files.items():
        place = folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    if form.extension:
        return [folder / name for name in made.files]
    if form.name == "shapefile":
        return [folder]
    return sorted({(folder / name).parent for name in made.files})


@settings(max_examples=6)
@example(longitude=-71.3, latitude=-33.4, turn=1.0, scale=2.0)  # south and west
@example(longitude=179.9995, latitude=-17.0, turn=0.3, scale=1.0)  # across 180 degrees
@example(longitude=-0.0004, latitude=47.0, turn=0.0, scale=1.0)
@example(longitude=37.0, latitude=0.0, turn=0.0, scale=1.0)
@given(
    longitude=st.floats(20.0, 28.0), latitude=st.floats(-30.0, 12.0), turn=st.floats(0.0, 6.28),
    scale=st.floats(0.7, 3.0),
)  # fmt: skip
@pytest.mark.parametrize("name", FORMS)
def test_what_is_written_is_read_where_it_was(
    tmp_path_factory: pytest.TempPathFactory, name: str, longitude: float, latitude: float, turn: float, scale: float
) -> None:
    form = FORMS[name]
    assume(name != "shapefile" or longitude < 179.0)  # its rings cannot be told apart across 180 degrees
    one = turned(saved(longitude, latitude), turn, scale)
    guidance = build_guidance(one)
    fields = [read_field(path) for path in put(tmp_path_factory.mktemp(name), form, guidance)]
    found = [
        (line.name, in_metres(one, field.to_wgs84(shapely.get_coordinates(line.line))))
        for field in fields
        for line in field.guidance_lines
    ]
    assert [line.name for line in guidance.lines] == [called for called, _ in found]
    for line, (_, points) in zip(guidance.lines, found, strict=True):
        meant = in_metres(one, line.points)
        assert np.abs(points[[0, -1]] - meant[[0, -1]]).max() < CLOSE_M, line.name  # the same way round, too
        assert shapely.hausdorff_distance(shapely.linestrings(points), shapely.linestrings(meant)) < CLOSE_M, line.name
    for field in fields:
        _same_boundary(one, field.to_wgs84, field.boundary, form)


def _same_boundary(one: SavedPlan, degrees: Any, boundary: shapely.Polygon, form: GuidanceFormat) -> None:
    """Every ring of the boundary is that of the field; AgOpenGPS makes inner rings of obstacles as well."""
    assert build_guidance(one).boundary is not None
    meant = [shapely.LinearRing(ring) for ring in one.ground["boundary_m"]]
    if form.name == "agopengps":
        meant.append(shapely.LinearRing(one.ground["obstacles"][0]["outline_m"][0]))
    if "holes of the boundary" in form.unsupported_parts:
        meant = meant[:1]
    rings = [
        shapely.LinearRing(in_metres(one, degrees(shapely.get_coordinates(ring))))
        for ring in (boundary.exterior, *boundary.interiors)
    ]
    assert len(rings) == len(meant)
    for ring in meant:
        assert min(shapely.hausdorff_distance(ring, other) for other in rings) < CLOSE_M


@pytest.mark.parametrize("name", ["isoxml4", "isoxml3"])
def test_isoxml_is_read_by_another_library(tmp_path: Path, name: str) -> None:
    io_of = pytest.importorskip("isoxml.util.isoxml_io")
    one, form = saved(), FORMS[name]
    guidance = build_guidance(one)
    found = {}
    for folder in put(tmp_path, form, guidance):
        data, _ = io_of.isoxml_from_path(folder / "TASKDATA.XML")
        (field,) = data.partfields
        assert field.designator == "Sondre Mark" and field.area == 5850
        patterns = [p for group in getattr(field, "guidance_groups", ()) for p in group.guidance_patterns]
        lines = [(p.designator, p.line_strings[0]) for p in patterns] or [(e.designator, e) for e in field.line_strings]
        found |= {key: [(float(p.east), float(p.north)) for p in line.points] for key, line in lines}
        outer = np.array([(float(p.east), float(p.north)) for p in field.polygons[0].line_strings[0].points])
        assert np.abs(in_metres(one, outer) - [*SQUARE, SQUARE[0]]).max() < CLOSE_M
    assert list(found) == [line.name for line in guidance.lines]
    for line in guidance.lines:
        assert np.abs(in_metres(one, found[line.name]) - in_metres(one, line.points)).max() < CLOSE_M


def taskdata(name: str, guidance: PlanGuidance, curves: bool | None = None) -> list[ElementTree.Element]:
    form = FORMS[name]
    return [ElementTree.fromstring(content) for content in write_guidance(guidance, form, curves).files.values()]


@pytest.mark.parametrize("name", ["isoxml4", "isoxml3"])
def test_isoxml_keeps_the_rules_of_the_schemas(name: str) -> None:
    long = replace(build_guidance(saved()), field="Überlange Bezeichnung eines Schlages am Wald mit Graben")
    for root in taskdata(name, long, curves=True):
        ids = [one.get("A") for one in root.iter() if one.tag in ("PFD", "GGP", "GPN")]
        assert len(set(ids)) == len(ids) and all(re.fullmatch(r"(PFD|GGP|GPN)[0-9]{1,11}", one or "") for one in ids)
        for one in root.iter():
            designator_of = {"PFD": "C"}.get(one.tag, "B")
            assert len((one.get(designator_of) or "").encode()) <= 32
        for point in root.iter("PNT"):
            assert all(re.fullmatch(r"-?\d{1,3}\.\d{1,9}", point.get(key) or "") for key in "CD")
            assert point.get("A") in (("2",) if name == "isoxml3" else ("2", "3", "6", "7", "9"))
        assert {one.get("A") for one in root.iter("PLN")} <= ({"1", "6"} if name == "isoxml3" else {"1", "6", "10"})


@pytest.mark.parametrize(("name", "schema"), [("isoxml4", "V4-3"), ("isoxml3", "V3-3")])
def test_isoxml_is_valid_against_the_published_schemas(tmp_path: Path, name: str, schema: str) -> None:
    """They may not be shipped: HEADLAND_ISOXML_SCHEMAS names a folder with those of isobus.net."""
    xmlschema = pytest.importorskip("xmlschema")
    place = Path(os.environ.get("HEADLAND_ISOXML_SCHEMAS", "")) / f"ISO11783_TaskFile_{schema}.xsd"
    if not place.is_file():
        pytest.skip("HEADLAND_ISOXML_SCHEMAS names no folder with the schemas")
    rules, form, one = xmlschema.XMLSchema(place), FORMS[name], saved()
    for guidance in (build_guidance(one), build_guidance(one, 1), build_guidance(replace(one, ground={}))):
        for curves in (True, False):
            if any(line.is_straight for line in guidance.lines):
                for content in write_guidance(guidance, form, curves).files.values():
                    (tmp_path / "one.xml").write_bytes(content)
                    assert [error.reason for error in rules.iter_errors(tmp_path / "one.xml")] == []


def test_isoxml_has_curves_in_version_4_and_straight_lines_in_version_3() -> None:
    guidance = build_guidance(saved())
    straight = ["T1 02 track 1", "T2 01 track 2a", "T2 02 track 2b"]
    (root,) = taskdata("isoxml4", guidance, curves=False)
    assert [one.get("B") for one in root.iter("GPN")] == straight
    assert {one.get("C") for one in root.iter("GPN")} == {"1"}
    lines = [one for root in taskdata("isoxml3", guidance) for one in root.iter("LSG") if one.get("A") == "5"]
    assert [(one.get("B"), len(one)) for one in lines] == [(name, 2) for name in straight]
    (root,) = taskdata("isoxml4", guidance)
    kinds = [(one.get("C"), len(one.findall("LSG/PNT"))) for one in root.iter("GPN")]
    assert kinds == [("3", len(BEND)), ("1", 2), ("1", 2), ("1", 2)]
    assert [[one.get("B") for one in group] for group in root.iter("GGP")] == [
        ["T1 01 round 1 side 1", "T1 02 track 1"], ["T2 01 track 2a", "T2 02 track 2b"],
    ]  # fmt: skip


def measure_worked_m(one: SavedPlan) -> float:
    """Length of all legs with the implement down, from the legs themselves."""
    legs = [leg.points for mission in one.plan.missions for leg in mission.legs if leg.implement]
    return float(sum(np.hypot(*np.diff(points, axis=0).T).sum() for points in legs))


@settings(max_examples=10, deadline=None, derandomize=True)
@given(turn=st.floats(0.0, 6.28), scale=st.floats(0.7, 3.0))
def test_isoxml_4_has_every_metre_that_is_worked(
    tmp_path_factory: pytest.TempPathFactory, turn: float, scale: float
) -> None:
    """The lengths of the file, by our reader and by one that shares nothing with it, are those of the legs."""
    one, form = turned(saved(), turn, scale), FORMS["isoxml4"]
    folder = tmp_path_factory.mktemp("whole")
    (place,) = put(folder, form, build_guidance(one), curves=None)
    field = read_field(place)
    ours_m = sum(line.line.length for line in field.guidance_lines)
    assert ours_m == pytest.approx(measure_worked_m(one), abs=0.01)
    data, _ = pytest.importorskip("isoxml.util.isoxml_io").isoxml_from_path(place / "TASKDATA.XML")
    patterns = [each for group in data.partfields[0].guidance_groups for each in group.guidance_patterns]
    strings = [
        in_metres(one, [(float(point.east), float(point.north)) for point in each.line_strings[0].points])
        for each in patterns
    ]
    others_m = sum(np.hypot(*np.diff(points, axis=0).T).sum() for points in strings)
    assert others_m == pytest.approx(measure_worked_m(one), abs=0.01)
    assert [each.type.name for each in patterns] == ["Curve", "AB", "AB", "AB"]


def test_what_older_terminals_cannot_read_is_told() -> None:
    """The bend is 94 m long with an amplitude of 4 m: 94 (1 + (4 pi / 94)^2 / 4) m, nearly."""
    guidance, newer, older = build_guidance(saved()), FORMS["isoxml4"], FORMS["isoxml3"]
    made = write_guidance(guidance, newer)
    assert made.unwritten_curves == () and collect_remarks(guidance, made) == []
    (entry,) = list_content_for_newer_terminals(made)
    assert (entry["what"], entry["count"]) == ("curves", 1) and "--to isoxml3" in entry["why"]
    assert entry["length_m"] == pytest.approx(94.0 + 94.0 * (4.0 * math.pi / 94.0) ** 2 / 4.0, abs=0.1)
    (left_out, *_) = list_unwritten_content(guidance, write_guidance(guidance, older))
    assert (left_out["what"], left_out["count"], left_out["length_m"]) == ("curves", 1, entry["length_m"])
    assert list_content_for_newer_terminals(write_guidance(guidance, newer, include_curves=False)) == []
    assert list_content_for_newer_terminals(write_guidance(guidance, older, include_curves=True)) == []


def test_what_is_left_out_is_told() -> None:
    guidance, form = build_guidance(saved()), FORMS["isoxml3"]
    made = write_guidance(guidance, form)
    told = {one["what"]: one["count"] for one in list_unwritten_content(guidance, made)}
    assert told == {
        "curves": 1, "headland": 1, "entrance": 1, "turns": 2, "ways in and out": 1, "orders to give way": 1,
    }  # fmt: skip
    assert collect_remarks(guidance, made) == []
    (warning,) = collect_remarks(guidance, write_guidance(guidance, form, include_curves=True))
    assert "some terminals refuse" in warning
    for_kml = list_unwritten_content(guidance, write_guidance(guidance, FORMS["kml"]))
    assert "curves" not in {one["what"] for one in for_kml}


def test_nothing_but_curves_is_refused_where_they_are_not_wanted() -> None:
    guidance, form = build_guidance(saved()), FORMS["isoxml3"]
    bent = replace(guidance.tractors[0], lines=guidance.tractors[0].lines[:1])
    with pytest.raises(ReportError, match=r"all of them are curves; add curves\.$"):
        write_guidance(replace(guidance, tractors=(bent,)), form)


def test_agopengps_has_a_headland_round_each_ring() -> None:
    """By hand: the inside of the headland is 6 m from the square, the hole has one round it, the pond none."""
    form = FORMS["agopengps"]
    files = write_guidance(build_guidance(saved(), 1), form).files
    assert {Path(name).name for name in files} == {"Field.txt", "Boundary.txt", "Headland.txt", "TrackLines.txt"}
    rows = files["Sondre Mark T1/Headland.txt"].decode().split("\r\n")
    counts = [int(row) for row in rows if row.isdecimal()]
    assert rows[0] == "$Headland" and counts == [2 * 18 + 2 * 10, 2 * 5 + 2 * 6, 0]  # 5 m apart at most
    points = np.array([[float(each) for each in row.split(",")] for row in rows if row.count(",") == 2])
    east, north = np.ptp(points[: counts[0], :2], axis=0)
    turn = math.atan(math.tan(math.radians(0.94)) * math.sin(math.radians(56.97)))  # of the grid of UTM
    assert east == pytest.approx(88 * math.cos(turn) + 48 * math.sin(turn), abs=0.1)  # the grid is 0.04 % small
    assert north == pytest.approx(48 * math.cos(turn) + 88 * math.sin(turn), abs=0.1)


def test_agopengps_has_the_directions_of_its_lines() -> None:
    form = FORMS["agopengps"]
    guidance = build_guidance(saved(), 1)
    rows = write_guidance(guidance, form).files["Sondre Mark T1/TrackLines.txt"].decode().split("\r\n")
    assert rows[:2] == ["$TrackLines", "T1 01 round 1 side 1"] and rows[6:8] == ["4", "True"]
    curve = np.array([[float(each) for each in row.split(",")] for row in rows if row.count(",") == 2])
    steps = np.diff(curve[:, :2], axis=0)
    assert int(rows[8]) == len(curve) and np.hypot(*steps.T).max() < 2.01  # close enough for its look ahead
    assert np.abs(np.arctan2(*steps.T) % (2 * math.pi) - curve[:-1, 2]).max() < 2e-3
    straight = rows.index("T1 02 track 1")
    assert math.degrees(float(rows[straight + 1])) == pytest.approx(guidance.lines[1].bearing_deg, abs=1e-2)
    assert rows[straight + 5 : straight + 8] == ["2", "True", "0"]


@pytest.mark.parametrize("name", FORMS)
def test_the_same_plan_gives_the_same_bytes(name: str) -> None:
    form, guidance = FORMS[name], build_guidance(saved())
    one, other = (zip_files(write_guidance(guidance, form).files) for _ in range(2))
    assert one == other
    with zipfile.ZipFile(io.BytesIO(one)) as archive:
        assert archive.testzip() is None and archive.namelist() == list(write_guidance(guidance, form).files)


@pytest.mark.parametrize("name", FORMS)
def test_names_of_all_kinds_are_written(tmp_path: Path, name: str) -> None:
    form = FORMS[name]
    for number, called in enumerate(("", "..", 'a/b\\c:"<&>', "畑", "con", "x" * 300, "tab\tand\x07bell", "\ud800")):
        guidance = replace(build_guidance(saved(), 2), field=called)
        folder = tmp_path / str(number)
        (path,) = put(folder, form, guidance)
        assert len(read_field(path).guidance_lines) == 2
        assert all(found.resolve().is_relative_to(folder.resolve()) for found in folder.rglob("*"))


def test_names_that_terminals_take() -> None:
    assert all(find_guidance_format(name) is form for name, form in FORMS.items())
    assert build_designator("Ærø Straße łąka", "Field") == "AEro Strasse laka"
    assert build_designator("x" * 40, "Field") == "x" * 32 and build_designator("畑", "Field") == "Field"
    assert build_folder_name("a/b: c.", "Field") == "a b c" and build_folder_name("CON", "Field") == "Field CON"
    assert build_folder_name("..", "Field") == "Field"


def test_a_curve_of_few_straight_stretches_is_cut_into_them() -> None:
    """By hand: legs of 30, 40, 20 and 10 m with corners; the lines lie on the curve and stand in its order."""
    corners = np.array([[3.0, 3.0], [33.0, 3.0], [73.0, 6.0], [93.0, 6.0], [103.0, 9.0]])
    one = saved()
    first, *rest = one.plan.missions[0].legs
    mission = replace(one.plan.missions[0], legs=(replace(first, points=corners), *rest))
    one = replace(one, plan=replace(one.plan, missions=(mission, one.plan.missions[1])))
    form = FORMS["isoxml3"]
    guidance = build_guidance(one)
    made = write_guidance(guidance, form)
    names = [line.name for line in made.lines]
    assert names[:4] == [f"T1 01{letter} round 1 side 1" for letter in "abcd"] and len(set(names)) == len(names)
    assert made.unwritten_curves == () and [line.name for line in made.cut_lines] == ["T1 01 round 1 side 1"]
    for line, ends in zip(made.lines[:4], (corners[k : k + 2] for k in range(4)), strict=True):
        assert np.abs(in_metres(one, line.points) - ends).max() < CLOSE_M
        assert line.length_m == pytest.approx(float(np.hypot(*(ends[1] - ends[0]))), rel=1e-3)
    assert "Curves cut into straight lines: 1, into 4 lines" in collect_remarks(guidance, made)[0]
    assert write_guidance(guidance, form, include_curves=True).cut_lines == ()


def test_agopengps_has_the_headland_of_the_largest_part() -> None:
    form, guidance = FORMS["agopengps"], build_guidance(saved(), 1)
    (large,) = guidance.headland_interior
    small = replace(large, rings=(large.rings[0][:1] + 0.1 * (large.rings[0] - large.rings[0][:1]),))
    path = "Sondre Mark T1/Headland.txt"
    parted = write_guidance(replace(guidance, headland_interior=(small, large)), form).files[path]
    assert parted == write_guidance(guidance, form).files[path]
