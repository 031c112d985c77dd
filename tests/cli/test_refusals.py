"""Bad input: one clear sentence, exit status 2, and nothing touched."""

import errno
import json
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest


def ring(*corners: tuple[float, float]) -> dict[str, Any]:
    return {"type": "Polygon", "coordinates": [[list(c) for c in (*corners, corners[0])]]}


SQUARE = ring((0, 0), (100, 0), (100, 60), (0, 60))


def feature(geometry: Any, **properties: Any) -> dict[str, Any]:
    return {"type": "Feature", "properties": properties, "geometry": geometry}


FILES: dict[str, Any] = {
    "good": SQUARE,
    "text": "this is no field",
    "empty": "",
    "list": [1, 2, 3],
    "null": None,
    "deep": "[" * 50_000,
    "bow": ring((0, 0), (100, 100), (100, 0), (0, 100)),
    "two": ring((0, 0), (100, 0)),
    "flat": ring((0, 0), (50, 0), (100, 0)),
    "nan": '{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 0], [100, 100], [0, 0]]]}',
    "infinite": '{"type": "Polygon", "coordinates": [[[0, 0], [1e999, 0], [100, 100], [0, 0]]]}',
    "collection": {"type": "FeatureCollection", "features": []},
    "point": {"type": "Point", "coordinates": [0, 0]},
    "words": {"type": "Polygon", "coordinates": [[["a", "b"], [1, 2], [3, 4], ["a", "b"]]]},
    "degrees": ring((10, 50), (10.002, 50), (10.002, 50.001), (10, 50.001)),
    "tiny": ring((0, 0), (19, 0), (19, 5.5), (0, 5.5)),
    "narrow": ring((0, 0), (200, 0), (200, 2), (0, 2)),
    "huge": ring((0, 0), (1e6, 0), (1e6, 1e6), (0, 1e6)),
    "several": {"type": "FeatureCollection", "features": [feature(SQUARE), feature(SQUARE)]},
    "ground": feature(SQUARE, default_ground="lava"),
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder of field files to work in; at the end every file must be as it was, and none added."""
    for name, content in FILES.items():
        text = content if isinstance(content, str) else json.dumps(content)
        (tmp_path / f"{name}.geojson").write_text(text)
    (tmp_path / "binary.geojson").write_bytes(b"\xff\xfe\x00\x81")
    (tmp_path / "broken.toml").write_text("nonsense = [")
    (tmp_path / "partial.toml").write_text('name = "half a tractor"')
    (tmp_path / "old.html").write_text("an earlier result")
    (tmp_path / "inner").mkdir()
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    yield tmp_path
    assert contents(tmp_path) == before


def contents(folder: Path) -> dict[str, tuple[bytes, int]]:
    return {
        str(path.relative_to(folder)): (path.read_bytes(), path.stat().st_mtime_ns)
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def assert_refused(outcome: Any, *words: str) -> None:
    assert outcome.status == 2, outcome
    assert outcome.out == ""
    assert len(outcome.sentences) == 1, outcome.err
    (sentence,) = outcome.sentences
    assert sentence.startswith("Error: ") and "Traceback" not in sentence
    assert sentence.endswith(".") and (len(sentence) < 500 or "9" * 300 in sentence)
    for word in words:
        assert word in sentence, sentence


FIELD_FILES = [
    ("text", "is not JSON"),
    ("empty", "is not JSON"),
    ("list", "not GeoJSON"),
    ("null", "not GeoJSON"),
    ("deep", "is not JSON"),
    ("bow", "crosses itself"),
    ("two", "at least 3"),
    ("flat", "'flat'"),
    ("nan", "nan"),
    ("infinite", "inf"),
    ("collection", "empty collection"),
    ("point", "1 Point"),
    ("words", "is not a number"),
    ("degrees", "look like degrees; leave out --local"),
    ("tiny", "headland"),
    ("narrow", "working width 3 m"),
    ("huge", "100 km2"),
    ("several", "holds 2 fields; choose one"),
    ("ground", "'lava'"),
    ("binary", "UTF-8"),
    ("missing", "no field file"),
]


@pytest.mark.parametrize("command", ["plan", "field"])
@pytest.mark.parametrize(("name", "words"), FIELD_FILES)
def test_field_files(headland: Callable[..., Any], folder: Path, command: str, name: str, words: str) -> None:
    assert_refused(headland(command, f"{name}.geojson", "--local"), words)


def line(*points: tuple[float, float]) -> dict[str, Any]:
    return {"type": "LineString", "coordinates": [list(point) for point in points]}


OBSTACLES: list[tuple[list[Any], tuple[str, ...]]] = [
    ([feature(ring((-1, -1), (101, -1), (101, 61), (-1, 61)), role="obstacle")], ("(--margin) of 0.3 m", "leave 0 m2")),
    ([feature({"type": "Point", "coordinates": [50, 30]}, role="obstacle", kind="cow")], ("'cow'", "'radius_m'")),
    ([feature(line((0, 0), (100, 0)), edge="wall")], ("'edge' of a line", "'wall'", "use 'fence' or 'open'")),
    ([feature(line((0, 0), (100, 0)), edge=3)], ("'edge' of a line", "is 3", "use 'fence' or 'open'")),
    ([feature(line((20, 30), (80, 30)), edge="fence")], ("nowhere along the boundary", "20.0 m away")),
    ([feature(line((20, 5), (80, 5)), edge="open", id="gap")], ("line 'gap' with edge 'open'", "5.0 m away")),
    (
        [feature({"type": "Point", "coordinates": [350, 30]}, role="obstacle", kind="pole", id="mast")],
        ("Obstacle 'mast' (pole)", "lies outside the field, 250 m away", "check the coordinates"),
    ),
    ([feature(line((5, 5)), edge="fence")], ("fewer than 2 positions",)),
    ([feature(line((0, 0), (0, "x")), edge="fence")], ("is not a number",)),
]


@pytest.mark.parametrize("command", ["plan", "field"])
@pytest.mark.parametrize(("features", "words"), OBSTACLES)
def test_obstacles_and_edges(
    headland: Callable[..., Any], folder: Path, command: str, features: list[Any], words: tuple[str, ...]
) -> None:
    assert_refused(_with(headland, folder, command, [feature(SQUARE), *features]), *words)


def _with(headland: Callable[..., Any], folder: Path, command: str, features: list[Any], *options: str) -> Any:
    """What a command says to a file of these features, which is gone afterwards."""
    place = folder / "features.geojson"
    place.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    try:
        return headland(command, place.name, "--local", *options)
    finally:
        place.unlink()


@pytest.mark.parametrize("command", ["plan", "field"])
def test_fences_and_margins(headland: Callable[..., Any], folder: Path, command: str) -> None:
    closed = [feature(SQUARE, edge="fence", name="pen")]
    assert_refused(_with(headland, folder, command, closed), "fence round field 'pen' has no way in", "'entrance'")
    gap = feature(line((40, 0), (42, 0)), edge="open")
    assert_refused(_with(headland, folder, command, [*closed, gap]), "no way in", "3 m or more")
    hedge = [feature(SQUARE, edge="hedge")]
    assert_refused(_with(headland, folder, command, hedge), "'edge' of the boundary", "'hedge'")
    gate = feature({"type": "Point", "coordinates": [50, 0]}, role="entrance")
    margin = ("--margin", "40")
    assert_refused(_with(headland, folder, command, [*closed, gate], *margin), "fences", "--margin) of 40 m", "smaller")
    assert_refused(_with(headland, folder, command, [feature(SQUARE)], "--margin", "60"), "60 m", "60 m across")
    pole = feature({"type": "Point", "coordinates": [50, 30]}, role="obstacle", kind="pole")
    told = _with(headland, folder, command, [feature(SQUARE, name="plot"), pole], "--margin", "45")
    assert_refused(told, "--margin) of 45 m is too wide for field 'plot'", "leaves 50", "of 6000 m2")


def test_a_margin_that_leaves_no_room_for_any_plan(headland: Callable[..., Any], folder: Path) -> None:
    """A pole in the middle of 60 m with a margin of 29 m leaves a neck of 0.75 m on either side of it."""
    pole = feature({"type": "Point", "coordinates": [50, 30]}, role="obstacle", kind="pole")
    options = ("--margin", "29", "--tractors", "1", "--strategies", "split-field", "--tracks-only", "--processes", "1")
    outcome = _with(headland, folder, "plan", [feature(SQUARE), pole], *options)
    assert_refused(outcome, "--margin) of 29 m leaves 5", "no plan works there", "smaller margin")


def test_a_margin_that_takes_most_of_the_field_is_refused_though_plans_work(
    headland: Callable[..., Any], folder: Path
) -> None:
    """A pole at the end of 100 m x 60 m with a margin of 60 m: some 43 m of the length are left."""
    pole = feature({"type": "Point", "coordinates": [0, 30]}, role="obstacle", kind="pole")
    options = ("--tractors", "1", "--strategies", "split-field", "--tracks-only", "--processes", "1")
    wide = _with(headland, folder, "plan", [feature(SQUARE), pole], "--margin", "60", *options)
    assert_refused(wide, "--margin) of 60 m leaves 4", "less than half", "smaller margin")
    assert _with(headland, folder, "plan", [feature(SQUARE), pole], "--margin", "40", *options).status == 0


def test_what_is_not_used_is_named_and_what_is_fenced_is_told(headland: Callable[..., Any], folder: Path) -> None:
    features = [
        feature(SQUARE), feature(line((0, 0), (100, 0)), edge="fence"), feature(line((3, 3), (9, 9)), role="drain"),
        feature({"type": "Point", "coordinates": [5, 5]}),
        feature(line((100, 0), (100, 30), (160, 30)), edge="fence"),
    ]  # fmt: skip
    outcome = _with(headland, folder, "field", features, "--json")
    assert outcome.status == 0
    assert json.loads(outcome.out)["fence_m"] == pytest.approx(130, abs=7), "it bends off gradually"
    told = " ".join(outcome.err.split())
    assert "1 LineString with role 'drain', 1 Point;" in told
    assert "Of 90 m of a line with edge 'fence'" in told and "the rest is not used" in told


def test_obstacles_off_the_field_are_named(headland: Callable[..., Any], folder: Path) -> None:
    def pole(x: float, **more: Any) -> Any:
        return feature({"type": "Point", "coordinates": [x, 30]}, role="obstacle", kind="pole", **more)

    outcome = _with(headland, folder, "field", [feature(SQUARE), pole(50), pole(400, id="mast"), pole(105)], "--json")
    assert outcome.status == 0 and len(json.loads(outcome.out)["obstacles"]) == 2
    told = " ".join(outcome.err.split())
    assert "Obstacle 'mast' (pole), 300 m away, lies outside the field and is left out." in told
    assert "An obstacle (pole) stands beside the field, not in it" in told
    several = [feature(SQUARE, id="a"), feature(ring((500, 0), (600, 0), (600, 60), (500, 60)), id="b"), pole(550)]
    place = folder / "many.geojson"
    place.write_text(json.dumps({"type": "FeatureCollection", "features": several}))
    try:
        told = headland("field", "many.geojson#a", "--local").err
    finally:
        place.unlink()
    assert "An obstacle of 'many' lies away from this field and is left out." in " ".join(told.split())


@pytest.mark.parametrize("command", ["plan", "field"])
def test_metres_passed_as_degrees(headland: Callable[..., Any], folder: Path, command: str) -> None:
    assert_refused(headland(command, "good.geojson"), "add --local")


def test_a_folder_is_no_field(headland: Callable[..., Any], folder: Path) -> None:
    assert_refused(headland("plan", "inner"), "'inner' is a folder")


def test_a_sample_misspelt_names_the_nearest(headland: Callable[..., Any], folder: Path) -> None:
    assert_refused(headland("plan", "iwamisawa"), "nearest", "'iwamizawa'")


def test_a_part_that_is_not_there_lists_those_that_are(headland: Callable[..., Any], folder: Path) -> None:
    assert_refused(headland("plan", "several.geojson#7", "--local"), "'7'", "0.60 ha")


OPTIONS: list[tuple[str, tuple[str, ...]]] = [
    ("--width 0", ("--width", "0", "above 0")),
    ("--width -3", ("-3",)),
    ("--width nan", ("nan",)),
    ("--width inf", ("inf",)),
    ("--width 500", ("500 m", "narrower")),
    ("--width 1e-9", ("20000 lines",)),
    ("--headland 0", ("--headland",)),
    ("--headland -2", ("-2",)),
    ("--headland nan", ("nan",)),
    ("--headland 1e308", ("1e+308 m", "1000 m or less")),
    ("--headland 1000", ("1000 m", "smaller headland")),
    ("--bearing nan", ("bearing", "nan")),
    ("--bearing inf", ("inf",)),
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
    ("--tractor=", ("An empty name is no file",)),
]
PLAN_OPTIONS: list[tuple[str, tuple[str, ...]]] = [
    ("--rain soon", ("--rain 'soon' is none of: a time",)),
    ("--rain 17:00", ("--rain at 17:00 needs a start", "--start")),
    ("--rain 16:00=70,17:00=50 --start 8:00", ("add up to 120", "100 together")),
    ("--rain none.csv --start 8:00", ("no file 'none.csv'",)),
    ("--prefer cheap", ("--prefer 'cheap' is unknown", "did you mean 'cheapest'")),
    ("--draws 0 --prefer surest", ("--draws is 0", "--prefer")),
    ("--draws 0 --rain 17:00 --start 8:00", ("--draws is 0", "--rain")),
    ("--draws -1", ("--draws is -1", "0 to 1000000")),
    ("--tractors 0", ("0 tractors", "1 to 50")),
    ("--tractors 51", ("51 tractors", "1 to 50")),
    ("--tractors 1-99999999999", ("1 to 50",)),
    ("--tractors x", ("'x' is not a count",)),
    ("--tractors 3-1", ("write 1-3",)),
    ("--tractors 1,,2", ("'1,,2'",)),
    ("--tractors -1", ("'-1'",)),
    ("--tractors=", ("is not a count",)),
    ("--strategies row-by-rov", ("'row-by-rov'", "did you mean 'row-by-row'")),
    ("--strategies split", ("did you mean 'split-field'",)),
    ("--strategies=", ("is unknown",)),
    ("--strategies split-field,", ("is unknown",)),
    ("--turn omegga", ("did you mean 'omega'",)),
    ("--start 13:00 --before 13:00", ("13:00 is the start itself", "--before")),
    ("--before 12:00", ("needs a start",)),
    ("--start 25:00", ("'25:00' is not a time of day",)),
    ("--start noon", ("hh:mm",)),
    ("--start 13:00 --before 7pm", ("--before '7pm'",)),
    ("--price-per-hour -1", ("-1", "0 or more")),
    ("--price-per-hour nan", ("nan",)),
    ("--price-per-tractor -0.5", ("--price-per-tractor is -0.5",)),
    ("--speed-kmh 500", ("500 km/h", "30 km/h or less")),
    ("--speed-kmh 0", ("--speed-kmh",)),
    ("--turn-speed-kmh 0", ("--turn-speed-kmh",)),
    ("--turn-speed-kmh inf", ("inf",)),
    ("--radius 1", ("tighter", "EG105")),
    ("--radius 0", ("--radius",)),
    ("--clearance 0", ("--clearance", "0.05")),
    ("--margin -1", ("--margin", "0 to 100 m")),
    ("--radius 1000", ("1000 m", "no room", "smaller")),
    ("--json --csv", ("choose one",)),
    ("--processes 0", ("--processes is 0",)),
    ("--html nowhere/x.html", ("nowhere", "does not exist")),
    ("--html good.geojson/x.html", ("cannot be written",)),
    ("--save inner", ("is a folder",)),
    ("--html old.html --tractors 0", ("0 tractors",)),
    ("--save good.geojson", ("would overwrite the field",)),
    ("--gnss-table=", ("An empty name is no file",)),
    ("--gnss-table inner", ("'inner' is a folder",)),
    (f"--tractors {'9' * 5000}", ("is not a count",)),
    ("--html new.html --save ./new.html", ("would overwrite another result",)),
]


@pytest.mark.parametrize(("options", "words"), OPTIONS)
@pytest.mark.parametrize("command", ["plan", "field"])
def test_options_of_both(headland: Callable[..., Any], folder: Path, command: str, options: str, words: Any) -> None:
    assert_refused(headland(command, "good.geojson", "--local", *options.split(" ")), *words)


@pytest.mark.parametrize(("options", "words"), PLAN_OPTIONS)
def test_options_of_plan(headland: Callable[..., Any], folder: Path, options: str, words: Any) -> None:
    assert_refused(headland("plan", "good.geojson", "--local", *options.split(" ")), *words)


@pytest.mark.parametrize("option", ["--html", "--png", "--save"])
def test_an_unwritable_place_is_found_before_anything_is_simulated(
    headland: Callable[..., Any], folder: Path, option: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    import planner.warmup
    import vehicle.world

    def never(*_: Any, **__: Any) -> None:
        raise AssertionError("something was simulated")

    monkeypatch.setattr(planner.warmup, "run_once", never)
    monkeypatch.setattr(vehicle.world.World, "run", never)
    assert_refused(headland("plan", option, folder / "nowhere" / "x"), "nowhere")


DRAWING: list[tuple[str, ...]] = [
    ("plan",), ("field",), ("validate", "zigzag"), ("design", "mass"), ("drive", "--steer", "20"),
    ("replay", "run.csv"), ("diagnose", "run.csv"),
]  # fmt: skip
KINDS = [(words, "--png", ".png") for words in DRAWING if words[0] != "diagnose"]
KINDS += [(words, "--html", ".html") for words in DRAWING if words[0] != "field"]


@pytest.mark.parametrize(("words", "option", "kind"), KINDS)
def test_a_name_that_tells_another_kind_of_file(
    headland: Callable[..., Any], folder: Path, words: tuple[str, ...], option: str, kind: str
) -> None:
    assert_refused(headland(*words, option, "x.txt"), f"x.txt does not end in {kind}; name the file x{kind}")


@pytest.mark.skipif(os.name != "posix" or not Path("/proc/self").exists(), reason="needs a place that takes no files")
def test_a_place_that_takes_no_files(headland: Callable[..., Any], folder: Path) -> None:
    assert_refused(headland("plan", "--save", "/proc/plan.json"), "/proc/plan.json cannot be written")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_permission(headland: Callable[..., Any], folder: Path) -> None:
    (folder / "inner").chmod(0o500)
    assert_refused(headland("plan", "--save", "inner/x.json"), "cannot be written")


@pytest.mark.parametrize(
    "arguments", [("--radius", "abc"), ("--seed", "x"), ("--processes", "1.5"), ("--unknown",), ("--width",)]
)
def test_misuse_ends_with_2_and_names_the_word(
    headland: Callable[..., Any], folder: Path, arguments: tuple[str, ...]
) -> None:
    outcome = headland("plan", "good.geojson", "--local", *arguments)
    assert_refused(outcome, arguments[0], "--help shows what there is")


def test_an_unknown_command(headland: Callable[..., Any], folder: Path) -> None:
    assert_refused(headland("plant"), "'plant' (did you mean 'plan'?)", "headland --help")
    assert_refused(headland("farm", "new"), "'file'", "headland farm new --help")


def test_in_a_process_of_its_own(headland_process: Callable[..., Any]) -> None:
    assert_refused(headland_process("plan", "--tractors", "51"), "51 tractors")
    assert_refused(headland_process("field", "nowhere.geojson"), "no field file")


def test_an_earlier_result_stays_when_the_run_fails(headland: Callable[..., Any], folder: Path) -> None:
    assert_refused(headland("plan", "bow.geojson", "--local", "--html", "old.html"), "crosses itself")
    assert (folder / "old.html").read_text() == "an earlier result"


def test_no_plan_that_works_is_told_apart_from_bad_input(headland: Callable[..., Any], folder: Path) -> None:
    outcome = headland("plan", "good.geojson", "--local", "--tractors", "40", "--html", "none.html", "--json")
    page = folder / "none.html"
    page.unlink(missing_ok=True)
    assert outcome.status == 3
    answer = json.loads(outcome.out)
    assert answer["best"] is None
    assert answer["plans"] and not any(plan["feasible"] for plan in answer["plans"])
    assert all("40 tractors are more than" in plan["reason"] for plan in answer["plans"])


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
        self, headland: Callable[..., Any], folder: Path, monkeypatch: pytest.MonkeyPatch, fault: Exception,
        status: int, words: str,
    ) -> None:  # fmt: skip
        import planner.warmup

        def fail() -> None:
            raise fault

        monkeypatch.setattr(planner.warmup, "run_once", fail)
        outcome = headland("field", "good.geojson", "--local")
        assert outcome.status == status and outcome.out == ""
        assert len(outcome.sentences) == 1 and outcome.sentences[0].startswith("Error: ") and words in outcome.err

    def test_the_place_of_a_fault_is_shown_on_demand(
        self, headland: Callable[..., Any], folder: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        import planner.warmup

        def fail() -> None:
            raise ZeroDivisionError("by nothing")

        monkeypatch.setattr(planner.warmup, "run_once", fail)
        monkeypatch.setenv("HEADLAND_DEBUG", "1")
        outcome = headland("field", "good.geojson", "--local")
        assert outcome.status == 1 and "Traceback" in outcome.err and "in fail" in outcome.err
        last = "Error: A fault of Headland (ZeroDivisionError: by nothing); nothing was written."
        assert outcome.sentences[-1] == last


class TestTerminals:
    """A table is printed whatever the terminal: its width unknown or tiny, its characters few."""

    @pytest.mark.parametrize(("columns", "widest"), [("0", 80), ("1", 20), ("30", 30), ("60", 60), ("500", 160)])
    def test_widths(
        self, headland: Callable[..., Any], folder: Path, monkeypatch: pytest.MonkeyPatch, columns: str, widest: int
    ) -> None:
        monkeypatch.setenv("COLUMNS", columns)
        text = headland("field", "good.geojson", "--local").out
        told = " ".join(text.split())
        assert "Area (ha) 0.6 " in told and "tracks" in told.lower()
        assert max(map(len, text.splitlines())) <= widest

    @pytest.mark.parametrize("settings", [
        {"PYTHONIOENCODING": "ascii"}, {"LC_ALL": "C", "PYTHONCOERCECLOCALE": "0", "PYTHONUTF8": "0"},
    ])  # fmt: skip
    def test_characters_that_are_lacking_are_replaced(
        self, command: list[str], folder: Path, settings: dict[str, str]
    ) -> None:
        place = folder / "far.geojson"
        place.write_text(json.dumps(feature(SQUARE, name="f\u00e4lt \u2713 \ud800")))
        words = [*command, "field", "far.geojson", "--local"]
        done = subprocess.run(words, capture_output=True, env={**os.environ, **settings}, timeout=60, check=False)
        place.unlink()
        assert done.returncode == 0, done.stderr
        assert b"f?lt ? ?" in done.stdout


class TestFieldFiles:
    """What of a field file is not used, and the fields in it."""

    @pytest.fixture
    def pond(self, folder: Path) -> Iterator[Path]:
        place = folder / "pond.geojson"
        point = feature({"type": "Point", "coordinates": [20, 20]}, role="tree")
        place.write_text(json.dumps({"type": "FeatureCollection", "features": [feature(SQUARE), point]}))
        yield place
        for path in (place, folder / "pond.html"):
            path.unlink(missing_ok=True)

    def test_what_is_not_used_is_named(self, headland: Callable[..., Any], pond: Path) -> None:
        words = "Not used of the field file: 1 Point with role 'tree'"
        outcome = headland("field", "pond.geojson", "--local", "--json")
        assert outcome.status == 0 and len(outcome.sentences) == 1 and f"Note: {words}" in outcome.err
        assert json.loads(outcome.out)["area_ha"] == 0.6
        one = ("--tractors", "1", "--strategies", "split-field", "--processes", "1")
        outcome = headland("plan", "pond.geojson", "--local", *one, "--html", "pond.html")
        assert outcome.status == 0 and f"Note: {words}" in outcome.err
        assert words.replace("'", "&#39;") in (pond.parent / "pond.html").read_text(encoding="utf-8")

    def test_every_field_of_a_file_is_listed(self, headland: Callable[..., Any], folder: Path) -> None:
        place = folder / "farm.geojson"
        blocks = [feature(SQUARE, name=f"plot-{i}") for i in range(94)]
        blocks[7] = feature(ring((0, 0), (100, 100), (100, 0), (0, 100)), name="bow")
        place.write_text(json.dumps({"type": "FeatureCollection", "features": blocks}))
        refused = headland("plan", "farm.geojson", "--local")
        table = headland("field", "farm.geojson", "--local", "--list")
        rows = json.loads(headland("field", "farm.geojson", "--local", "--list", "--json").out)
        drawn = headland("field", "farm.geojson", "--local", "--list", "--png", "x.png")
        place.unlink()
        assert_refused(refused, "holds 94 fields", "and 82 more", "headland field FILE --list lists all")
        assert_refused(drawn, "--png draws one field; leave it out with --list")
        assert table.status == 0 and all(f"plot-{i}" in table.out for i in range(94) if i != 7)
        assert [row["position"] for row in rows] == list(range(94))
        assert rows[93] == {"position": 93, "id": "plot-93", "area_ha": 0.6, "holes": 0, "fault": None}
        assert rows[7]["area_ha"] is None and "crosses itself" in rows[7]["fault"]

    def test_other_forms_and_names(self, headland: Callable[..., Any], folder: Path) -> None:
        (folder / "farm.kml").write_text("<kml/>")
        outcome = headland("plan", "farm.kml")
        (folder / "farm.kml").unlink()
        assert_refused(outcome, "'farm.kml' is KML", "ogr2ogr", "farm.geojson")
        missing = headland("plan", "nofile.geojson")
        assert_refused(missing, "There is no field file 'nofile.geojson'; check its name")
        assert "sample" not in missing.err
        assert_refused(headland("plan", "x" * 300 + ".geojson"), "no field file")
        assert_refused(headland("replay", "x" * 300 + ".csv"), "x.csv")
