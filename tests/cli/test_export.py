"""`headland export`: lines of a saved plan for terminals, written whole and over nothing."""

import errno
import io
import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pytest
import shapely

from fields.documents.reader import read_field
from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused, contents
from tests.drawn_fields import ring
from tests.planner.saved_plans import saved
from vehicle.missions.plan_file import format_plan

pytestmark = pytest.mark.usefixtures("first_layout")

TASKDATA = Path("TASKDATA", "TASKDATA.XML")
NEW = {
    "isoxml4": {"plan-isoxml4/TASKDATA/TASKDATA.XML"},
    "isoxml3": {"plan-isoxml3/T1/TASKDATA/TASKDATA.XML", "plan-isoxml3/T2/TASKDATA/TASKDATA.XML"},
    "agopengps": {
        f"plan-agopengps/Sondre Mark T{number}/{name}.txt"
        for number in (1, 2)
        for name in ("Field", "Boundary", "Headland", "TrackLines")
    },
    "kml": {"plan.kml"},
    "shapefile": {
        f"plan-shapefile/{name}{ending}"
        for name in ("boundary", "obstacles", "headland", "entrance", "lines")
        for ending in (".shp", ".shx", ".dbf", ".prj", ".cpg")
    },
    "geojson": {"plan.geojson"},
    "gpx": {"plan-gpx/T1.gpx", "plan-gpx/T2.gpx"},
}
REFUSED: list[tuple[tuple[str, ...], str]] = [
    (("none.json", "--to", "kml"), "There is no file 'none.json'"),
    (("plan.json", "--to", "isobus"), "use one of: isoxml4, isoxml3, agopengps, kml, shapefile, geojson, gpx"),
    (("plan.json", "--to", "isoxml"), "did you mean 'isoxml"),
    (("plan.json", "--to", "kml", "--tractor", "3"), "--tractor is 3; the plan has tractors 1 to 2"),
    (("plan.json", "--to", "kml", "-o", "plan.json"), "does not end in .kml"),
    (("plan.json", "--to", "kml", "--force", "-o", "link.kml"), "link.kml would overwrite the plan"),
    (("plan.json", "--to", "gpx", "-o", "all.gpx"), "one for each tractor"),
    (("plan.json", "--to", "isoxml4", "-o", "plan.json"), "is a file"),
    (("plan.json", "--to", "isoxml4", "-o", "none/stick"), "the folder none does not exist; make it first"),
    (("plan.json", "--to", "kml", "-o", "none/x.kml"), "the folder none does not exist; make it first"),
    (("plan.json", "--to", "isoxml4", "-o", "none/x.zip"), "the folder none does not exist; make it first"),
    (("plan.json", "--to", "isoxml4", "-o", "there"), "there/TASKDATA/TASKDATA.XML exists already"),
    (("local.json", "--to", "kml"), "in local metres, and guidance needs longitude and latitude"),
    (("kept.kml", "--to", "kml", "-o", "new.kml"), "is not JSON"),
    (("plan.json", "--to", "kml", "-o", "kept.kml"), "kept.kml exists already; choose another name, or add --force"),
    (("empty.json", "--to", "kml"), "it needs at least one"),
    (("plan.json",), "Missing option '--to'"),
]


@pytest.fixture
def plan(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A plan made by hand, alone in the folder that is worked in."""
    monkeypatch.chdir(tmp_path)
    one = saved()
    text = format_plan(one.plan, crs=one.crs, origin_m=one.origin_m, scenario=one.scenario, ground=one.ground)
    Path("plan.json").write_text(text, encoding="utf-8")
    return Path("plan.json")


def files() -> set[str]:
    return {str(path) for path in Path().rglob("*") if path.is_file()}


@pytest.mark.parametrize("form", NEW)
def test_every_form_is_written_beside_the_plan(headland: Run, plan: Path, form: str) -> None:
    done = headland("export", plan, "--to", form, "--json")
    assert done.status == 0 and all(one.startswith("Wrote plan") for one in done.sentences)
    assert files() - {"plan.json"} == NEW[form]
    told = json.loads(done.out)
    assert told["format"] == form and {str(Path(name)) for name in told["files"]} == NEW[form]
    curves = 0 if form == "isoxml3" else 1
    assert sum(line["written"] for line in told["lines"]) == 3 + curves
    assert [line["name"] for line in told["lines"]][1:3] == ["T1 02 track 1", "T2 01 track 2a"]
    assert ("curves" in {one["what"] for one in told["left_out"]}) == (curves == 0)
    assert [one["what"] for one in told["not_for_older"]] == (["curves"] if form == "isoxml4" else [])


def test_the_table_tells_what_was_written_and_what_not(headland: Run, plan: Path) -> None:
    done = headland("export", plan, "--to", "isoxml4")
    assert done.status == 0
    assert done.sentences[-1] == "Wrote plan-isoxml4/TASKDATA/TASKDATA.XML."
    assert "Not for older terminals: curves (1, 94 m): ISOXML version 3 has straight lines" in done.out
    assert "Left out: turns (2)" in done.out and "Left out: curves" not in done.out
    done = headland("export", plan, "--to", "isoxml3")
    assert "Left out: curves (1, 94 m): some terminals refuse curves, and these have more" in done.out


def test_curves_for_terminals_of_version_3_come_with_a_warning(headland: Run, plan: Path) -> None:
    done = headland("export", plan, "--to", "isoxml3", "--curves")
    assert done.status == 0 and len(done.sentences) == 2 and "terminals refuse" in done.sentences[0]


def test_a_zip_holds_the_same_files(headland: Run, plan: Path) -> None:
    assert headland("export", plan, "--to", "isoxml4", "-o", "TASKDATA.zip").status == 0
    assert headland("export", plan, "--to", "isoxml4").status == 0
    with zipfile.ZipFile(io.BytesIO(Path("TASKDATA.zip").read_bytes())) as archive:
        assert archive.namelist() == ["TASKDATA/TASKDATA.XML"]
        assert archive.read(archive.namelist()[0]) == ("plan-isoxml4" / TASKDATA).read_bytes()


@pytest.mark.parametrize("target", ["stick", "stick/TASKDATA", "stick/taskdata"])
def test_a_stick_gets_its_folder(headland: Run, plan: Path, target: str) -> None:
    Path("stick").mkdir()
    Path("stick", "holiday.jpg").write_bytes(b"sun")
    assert headland("export", plan, "--to", "isoxml4", "--tractor", "2", "-o", target).status == 0
    assert files() == {"plan.json", "stick/holiday.jpg", f"stick/{TASKDATA}"}


def test_one_tractor_is_one_file(headland: Run, plan: Path) -> None:
    assert headland("export", plan, "--to", "gpx", "--tractor", "2", "-o", "two.gpx").status == 0
    assert {line.name for line in read_field("two.gpx").guidance_lines} == {"T2 01 track 2a", "T2 02 track 2b"}


@pytest.mark.parametrize(("words", "said"), REFUSED)
def test_refusals_are_one_sentence_and_write_nothing(
    headland: Run, plan: Path, words: tuple[str, ...], said: str
) -> None:
    content = json.loads(plan.read_text(encoding="utf-8"))
    Path("local.json").write_text(json.dumps({**content, "crs": None}), encoding="utf-8")
    Path("empty.json").write_text(json.dumps({**content, "tractors": []}), encoding="utf-8")
    Path("kept.kml").write_text("mine", encoding="utf-8")
    Path("there", "TASKDATA").mkdir(parents=True)
    Path("there", TASKDATA).write_text("mine", encoding="utf-8")
    os.symlink("plan.json", "link.kml")
    before, paths = contents(Path()), set(Path().rglob("*"))
    assert_refused(headland("export", *words), said)
    assert contents(Path()) == before and set(Path().rglob("*")) == paths


def test_force_writes_over_what_is_there_and_nothing_else(headland: Run, plan: Path) -> None:
    Path("TASKDATA").mkdir()
    TASKDATA.write_text("old", encoding="utf-8")
    Path("TASKDATA", "TLG00001.BIN").write_bytes(b"log")
    assert headland("export", plan, "--to", "isoxml4", "-o", ".", "--force").status == 0
    assert TASKDATA.read_text(encoding="utf-8").startswith("<?xml")
    assert Path("TASKDATA", "TLG00001.BIN").read_bytes() == b"log"


def test_a_full_disk_leaves_nothing_behind(headland: Run, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def full(number: int) -> None:
        calls.append(number)
        if len(calls) == 5:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    done = headland("export", plan, "--to", "agopengps")
    assert done.status == 1 and done.out == "" and len(done.sentences) == 1
    assert "the disk is full; nothing was written" in done.sentences[0]
    assert [str(path) for path in Path().rglob("*")] == ["plan.json"]


def test_a_folder_that_takes_no_files_is_refused(headland: Run, plan: Path) -> None:
    assert_refused(headland("export", plan, "--to", "kml", "-o", "/proc/x.kml"), "cannot be written")


def test_a_plan_of_a_field_is_exported_with_it(headland: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lines of a real plan lie in the boundary that was planned, have its worked metres, and work most of it."""
    monkeypatch.chdir(tmp_path)
    corners = ((10.0, -30.0), (10.0006, -30.0), (10.0006, -29.9993), (10.0, -29.9993))
    Path("farm.geojson").write_text(json.dumps(ring(*corners)), encoding="utf-8")
    words = ("--width", "6", "--tractors", "1", "--strategies", "split-field", "--processes", "1", "--json")
    assert headland("plan", "farm.geojson", *words, "--save", "plan.json").status == 0
    Path("farm.geojson").unlink()
    assert headland("export", "plan.json", "--to", "isoxml4").status == 0
    field = read_field("plan-isoxml4")
    assert (
        field.name == "farm"
        and np.abs(field.to_wgs84(shapely.get_coordinates(field.boundary))[:4] - corners).max() < 1e-6
    )
    lines = [one.line for one in field.guidance_lines]
    assert all(shapely.covers(field.boundary.buffer(0.01), line) for line in lines)
    legs = [leg for mission in json.loads(Path("plan.json").read_text())["tractors"] for leg in mission]
    worked = [shapely.LineString(leg["points_m"]) for leg in legs if leg["implement"]]
    assert sum(line.length for line in lines) == pytest.approx(sum(line.length for line in worked), abs=0.1)
    swept = shapely.union_all([line.buffer(3.0, cap_style="flat") for line in lines])
    assert shapely.intersection(swept, field.boundary).area > 0.9 * field.boundary.area
