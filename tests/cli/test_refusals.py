"""Bad options: one clear sentence, exit status 2, and nothing touched."""

import errno
import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import SQUARE, assert_refused
from tests.drawn_fields import feature, point, ring, write_features

pytestmark = pytest.mark.usefixtures("first_layout")

OPTIONS: list[tuple[str, tuple[str, ...]]] = [
    ("--width 0", ("--width", "0 m", "0.5 to 100 m")),
    ("--width 90", ("90 m", "59.5 m or less")),
    ("--width 0.2", ("0.2 m", "0.5 to 100 m")),
    ("--width 1e-9", ("1e-09 m", "0.5 to 100 m")),
    ("--width 3m", ("'3m' is not a ", "(write it in metres: 3)")),
    (
        "--width 6 12",
        ("'12' stands alone after --width 6", "where --width takes a list, write that without spaces: 6,12"),
    ),
    ("--margin 30cm", ("'--margin': '30cm' is not a number (write it in metres: 0.3)",)),
    ("--margin 0,5", ("'--margin': '0,5' is not a number (write 0.5)",)),
    ("--margin 5kg", ("'--margin': '5kg' is not a number; headland",)),
    ("--headland 0", ("--headland",)),
    ("--headland 1e308", ("1e+308 m", "at most 1000 m")),
    ("--bearing nan", ("bearing", "nan")),
    ("--cell-bearing 2=45", ("Cell 2", "--cell-bearing", "has 1 cell", "use 1")),
    ("--cell-bearing 45", ("--cell-bearing", "'45'", "2=45")),
    ("--cell-bearing 1=400", ("cell 1", "400", "360")),
    ("--cell-bearing 1=4 --bearing 3", ("--bearing", "--cell-bearing", "leave out one")),
    ("--tractor nope", ("'nope'", "eg105")),
    ("--tractor broken.toml", ("broken.toml", "not TOML")),
    ("--tractor partial.toml", ("partial.toml", "mass_kg")),
    ("--tractor inner", ("'inner'",)),
    ("--png nowhere/x.png", ("nowhere", "does not exist")),
    ("--png inner", ("inner is a folder",)),
    ("--tractor=", ("The file name is empty",)),
]
PLAN_OPTIONS: list[tuple[str, tuple[str, ...]]] = [
    ("--rain soon", ("--rain 'soon' is none of: a time",)),
    ("--rain 17:00", ("--rain at 17:00 needs a start", "--start")),
    ("--rain none.csv --start 8:00", ("no file 'none.csv'",)),
    ("--objective cheap", ("--objective 'cheap' is unknown", "did you mean 'cheapest'")),
    ("--operation mow --objective fuel", ("--objective is 'fuel'", "takes power from the shaft", "--farm")),
    ("--elevation none.asc", ("none.asc",)),
    ("--soil lome", ("The soil 'lome' is unknown", "loam")),
    ("--soil loam --moisture 99", ("The moisture 99 %", "from")),
    ("--moisture 20", ("--moisture is of a soil", "--soil")),
    ("--rain-mm 3", ("--rain-mm is of a soil", "--soil")),
    ("--soil loam --rain-mm 3,x", ("--rain-mm '3,x' has 'x'", "such as 0,12,5")),
    ("--soil firm --rain-mm 3", ("The soil 'firm' does not say how much water", "field capacity")),
    ("--soil loam --et0-mm 3", ("--et0-mm is of the days with --rain-mm", "give that as well")),
    ("--draft ploughs", ("The implement 'ploughs'", "did you mean 'plough'?")),
    ("--draft plough --depth-cm 50", ("The working depth is 50 cm", "'plough' works 10 to 35 cm")),
    ("--operation mow --draft plough", ("--draft plough is of an implement", "--operation is mow", "till or sow")),
    ("--samples 0 --objective surest", ("--samples is 0", "--objective")),
    ("--samples 0 --rain 17:00 --start 8:00", ("--samples is 0", "--rain")),
    ("--headland-passes x", ("'--headland-passes': 'x' is not a whole number", "--help")),
    ("--bearing=x1", ("'--bearing': 'x1' is not a number",)),
    ("--speed-kmh 2m/s", ("'2m/s' is not a number (write it in km/h: 7.2)",)),
    ("--samples -1", ("--samples is -1", "0 to 1,000,000")),
    ("--start 13:00 --deadline 7pm", ("--deadline '7pm'",)),
    ("--price-per-tractor -0.5", ("--price-per-tractor is -0.5",)),
    ("--radius 1", ("tighter", "EG105")),
    ("--radius 1000", ("1000 m", "no room", "smaller")),
    ("--json --csv", ("choose one",)),
    ("--processes 0", ("--processes is 0",)),
    ("--html nowhere/x.html", ("nowhere", "does not exist")),
    ("--html good.geojson/x.html", ("cannot be written",)),
    ("--save inner", ("is a folder",)),
    ("--html old.html --tractors 0", ("0 tractors",)),
    ("--gnss-table=", ("The file name is empty",)),
    ("--gnss-table inner", ("'inner' is a folder",)),
    (f"--tractors {'9' * 5000}", ("is not a count",)),
]
DRAWING: list[tuple[str, ...]] = [
    ("plan",), ("field",), ("validate", "zigzag"), ("design", "mass"), ("drive", "--steer", "20"),
    ("replay", "run.csv"), ("diagnose", "run.csv"),
]  # fmt: skip
KINDS = [
    *((words, "--png", ".png") for words in DRAWING if words[0] != "diagnose"),
    *((words, "--html", ".html") for words in DRAWING if words[0] != "field"),
]


@pytest.mark.parametrize(("options", "words"), OPTIONS)
@pytest.mark.parametrize("command", ["plan", "field"])
def test_options_of_both(headland: Run, folder: Path, command: str, options: str, words: Any) -> None:
    assert_refused(headland(command, "good.geojson", "--local", *options.split(" ")), *words)


@pytest.mark.parametrize(("options", "words"), PLAN_OPTIONS)
def test_options_of_plan(headland: Run, folder: Path, options: str, words: Any) -> None:
    assert_refused(headland("plan", "good.geojson", "--local", *options.split(" ")), *words)


@pytest.mark.parametrize("option", ["--html", "--png", "--save"])
def test_an_unwritable_place_is_found_before_anything_is_simulated(
    headland: Run, folder: Path, option: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import planner.pipeline.worker_tasks
    import vehicle.sim.world

    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("something was simulated")

    monkeypatch.setattr(planner.pipeline.worker_tasks, "warm_up_simulation", never)
    monkeypatch.setattr(vehicle.sim.world.World, "run", never)
    assert_refused(headland("plan", option, folder / "nowhere" / "x"), "nowhere")


@pytest.mark.parametrize(("words", "option", "kind"), KINDS)
def test_a_name_that_tells_another_kind_of_file(
    headland: Run, folder: Path, words: tuple[str, ...], option: str, kind: str
) -> None:
    assert_refused(headland(*words, option, "x.txt"), f"x.txt does not end in {kind}; name the file x{kind}")


@pytest.mark.skipif(os.name != "posix" or not Path("/proc/self").exists(), reason="needs a place that takes no files")
def test_a_place_that_takes_no_files(headland: Run, folder: Path) -> None:
    assert_refused(headland("plan", "--save", "/proc/plan.json"), "/proc/plan.json cannot be written")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_permission(headland: Run, folder: Path) -> None:
    (folder / "inner").chmod(0o500)
    assert_refused(headland("plan", "--save", "inner/x.json"), "cannot be written")


@pytest.mark.parametrize(
    "arguments", [("--radius", "abc"), ("--seed", "x"), ("--processes", "1.5"), ("--unknown",), ("--width",)]
)
def test_misuse_ends_with_2_and_names_the_word(headland: Run, folder: Path, arguments: tuple[str, ...]) -> None:
    outcome = headland("plan", "good.geojson", "--local", *arguments)
    assert_refused(outcome, arguments[0], "; headland plan --help lists the options")


def test_an_unknown_command(headland: Run, folder: Path) -> None:
    assert_refused(headland("plant"), "'plant' (did you mean 'plan'", "headland --help")
    assert_refused(headland("farm", "new"), "'file'", "headland farm new --help")


@pytest.mark.slow
def test_in_a_process_of_its_own(headland_process: Run) -> None:
    assert_refused(headland_process("plan", "--tractors", "51"), "51 tractors")


def test_an_earlier_result_stays_when_the_run_fails(headland: Run, folder: Path) -> None:
    refused = headland("plan", "bow.geojson", "--local", "--html", "old.html", "--force")
    assert_refused(refused, "crosses itself")
    assert (folder / "old.html").read_text() == "an earlier result"


@pytest.mark.slow
def test_no_plan_that_works_is_told_apart_from_bad_input(headland: Run, folder: Path) -> None:
    words = ("--local", "--tractors", "40", "--strategies", "split-field,row-by-row", "--html", "none.html", "--json")
    outcome = headland("plan", "good.geojson", *words)
    page = folder / "none.html"
    page.unlink(missing_ok=True)
    assert outcome.status == 3
    answer = json.loads(outcome.out)
    assert answer["best"] is None
    assert len(answer["plans"]) == 2 and not any(plan["feasible"] for plan in answer["plans"])
    assert all(plan["reason"].startswith("40 tractors") for plan in answer["plans"])


class TestFaults:
    """What is nobody's input ends in a sentence as well."""

    @pytest.mark.parametrize(("fault", "status", "words"), [
        (MemoryError(), 1, "There is not enough memory; nothing was written"),
        (ImportError("libblas.so: failed to map segment from shared object"), 1, "There is not enough memory"),
        (OSError(errno.ENOMEM, "Cannot allocate memory"), 1, "There is not enough memory"),
        (OSError(errno.ENOSPC, "No space left on device"), 1, "No space left on device; nothing was written"),
        (PermissionError(errno.EACCES, "Permission denied", "x" * 300), 2, f"'{'x' * 80}' cannot be used: Permission"),
        (RecursionError("too deep"), 1, "A fault of Headland (RecursionError: too deep); nothing was written"),
        (ValueError("two\nlines"), 1, "A fault of Headland (ValueError: two lines)"),
    ])  # fmt: skip
    def test_one_sentence(
        self, headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, fault: Exception,
        status: int, words: str,
    ) -> None:  # fmt: skip
        import planner.pipeline.worker_tasks

        def fail() -> None:
            raise fault

        monkeypatch.setattr(planner.pipeline.worker_tasks, "warm_up_simulation", fail)
        outcome = headland("field", "good.geojson", "--local")
        assert outcome.status == status and outcome.out == ""
        assert len(outcome.sentences) == 1 and outcome.sentences[0].startswith("Error: ") and words in outcome.err

    def test_the_place_of_a_fault_is_shown_on_demand(
        self, headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        import planner.pipeline.worker_tasks

        def fail() -> None:
            raise ZeroDivisionError("by nothing")

        monkeypatch.setattr(planner.pipeline.worker_tasks, "warm_up_simulation", fail)
        monkeypatch.setenv("HEADLAND_DEBUG", "1")
        outcome = headland("field", "good.geojson", "--local")
        assert outcome.status == 1 and "Traceback" in outcome.err and "in fail" in outcome.err
        last = "Error: A fault of Headland (ZeroDivisionError: by nothing); nothing was written."
        assert outcome.sentences[-1] == last


class TestTerminals:
    """A table is printed whatever the terminal: its width unknown or tiny, its characters few."""

    @pytest.mark.parametrize(("columns", "widest"), [("0", 80), ("1", 20), ("30", 30), ("60", 60), ("500", 160)])
    def test_widths(
        self, headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch, columns: str, widest: int
    ) -> None:
        monkeypatch.setenv("COLUMNS", columns)
        text = headland("field", "good.geojson", "--local").out
        told = " ".join(text.split())
        assert "Area (ha) 0.6 " in told and "swaths" in told.lower()
        assert max(map(len, text.splitlines())) <= widest

    @pytest.mark.slow
    @pytest.mark.parametrize("settings", [
        pytest.param({"PYTHONIOENCODING": "ascii"}, marks=pytest.mark.matrix),
        {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    ])  # fmt: skip
    def test_characters_that_are_lacking_are_replaced(
        self, command: list[str], folder: Path, settings: dict[str, str]
    ) -> None:
        place = folder / "far.geojson"
        place.write_text(json.dumps(feature(SQUARE, name="f\u00e4lt \u2713 \ud800")))
        words = [*command, "field", "far.geojson", "--local"]
        done = subprocess.run(words, capture_output=True, env={**os.environ, **settings}, timeout=240, check=False)
        place.unlink()
        assert done.returncode == 0, done.stderr
        assert b"f?lt ? ?" in done.stdout


class TestFieldFiles:
    """What of a field file is not used, and the fields in it."""

    @pytest.fixture
    def pond(self, folder: Path) -> Iterator[Path]:
        place = write_features(folder / "pond.geojson", feature(SQUARE), feature(point(20, 20), role="crop"))
        yield place
        for path in (place, folder / "pond.html"):
            path.unlink(missing_ok=True)

    @pytest.mark.slow
    def test_what_is_not_used_is_named(self, headland: Run, pond: Path) -> None:
        words = "Features of the field file that are not used: 1 Point with role 'crop'"
        outcome = headland("field", "pond.geojson", "--local", "--json")
        assert outcome.status == 0 and len(outcome.sentences) == 1 and f"Note: {words}" in outcome.err
        assert json.loads(outcome.out)["area_ha"] == 0.6
        one = ("--tractors", "1", "--strategies", "split-field", "--no-headland", "--processes", "1")
        outcome = headland("plan", "pond.geojson", "--local", *one, "--html", "pond.html")
        assert outcome.status == 0 and f"Note: {words}" in outcome.err
        assert words.replace("'", "&#39;") in (pond.parent / "pond.html").read_text(encoding="utf-8")

    def test_every_field_of_a_file_is_listed(self, headland: Run, folder: Path) -> None:
        blocks = [feature(SQUARE, name=f"plot-{i}") for i in range(94)]
        blocks[7] = feature(ring((0, 0), (100, 100), (100, 0), (0, 100)), name="bow")
        place = write_features(folder / "farm.geojson", *blocks)
        refused, unknown = (headland("plan", f"farm.geojson{key}", "--local") for key in ("", "#PLOT-78"))
        table = headland("field", "farm.geojson", "--local", "--list")
        rows = json.loads(headland("field", "farm.geojson", "--local", "--list", "--json").out)
        drawn = headland("field", "farm.geojson", "--local", "--list", "--png", "x.png")
        place.unlink()
        assert_refused(refused, "holds 94 fields", "and 82 more", "headland field FILE --list lists all")
        assert_refused(unknown, "no field 'PLOT-78' (did you mean 'plot-78'?); choose one of its 94", "and 89 more")
        assert_refused(drawn, "--png draws one field; leave it out with --list")
        assert table.status == 0 and all(f"plot-{i}" in table.out for i in range(94) if i != 7)
        assert [row["position"] for row in rows] == list(range(94))
        plain = {"position": 93, "id": "plot-93", "area_ha": 0.6, "holes": 0, "fault": None, "inside": None}
        assert rows[93] == plain
        assert rows[7]["area_ha"] is None and "crosses itself" in rows[7]["fault"]

    def test_other_forms_and_names(self, headland: Run, folder: Path) -> None:
        (folder / "farm.dxf").write_text("<kml/>")
        outcome = headland("plan", "farm.dxf")
        (folder / "farm.dxf").unlink()
        assert_refused(outcome, "'farm.dxf' is DXF", "ogr2ogr", "farm.geojson")
        missing = headland("plan", "nofile.geojson")
        assert_refused(missing, "There is no field file 'nofile.geojson'; check its name")
        assert "sample" not in missing.err
        assert_refused(headland("plan", "x" * 300 + ".geojson"), "no field file")
        assert_refused(headland("replay", "x" * 300 + ".csv"), "x.csv")
