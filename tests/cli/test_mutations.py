"""Odd values wherever one may stand, in saved plans, names and words: no fault, no file lost, one line each."""

import json
import random
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.mutations import FIELD, ODD, paths, replaced, small_field, small_plan
from tests.cli.mutations import Path as Place
from tests.examples import count_examples

CONTROLS = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\u202e]")
SAVED = (
    ("show", "plan.json"), ("show", "plan.json", "--json"),
    ("export", "plan.json", "--to", "isoxml4", "--out", "o.zip"),
    ("export", "plan.json", "--to", "gpx", "--out", "o.gpx", "--tractor", "1"), ("compare", "plan.json", "runs"),
    ("logs", "example", "plan.json", "-o", "made"),
    ("robot", "--plan", "plan.json", "--fleet", "x", "--seconds", "0.01", "--url", "http://127.0.0.1:9"),
)  # fmt: skip
"""Every command that reads a saved plan."""
EVERY, SHARE = 8, 100  # of places and values together each command is given every so many

WORDS = (
    "", "9" * 10_000, "x" * 10_000, "x y " * 3000, "nan", "-inf", "1e400", "a\nb", "\x1b[2J", "\u2028", "\u202e", "..",
    "/", "/dev/null", "[", "#", "{}", "'", '"', "%s", "1=2=3", "25:00", "EPSG:0", "http://[",
)  # fmt: skip
PLAN = ("plan", FIELD, "--tractors", "0", "--turn", "none")  # refused twice, so that nothing is ever simulated
LINES = (
    (*PLAN, "--width", "3"), (*PLAN, "--start", "8:00", "--rain", "x"), (*PLAN, "--farm", "farm.toml", "--seed", "1"),
    (*PLAN, "--checkpoint", "kept.csv"),
    ("field", FIELD, "--crs", "EPSG:1", "--width", "3"), ("field", FIELD, "--entrance", "1", "--margin", "0.3"),
    ("show", "plan.json", "--tractor", "9"), ("export", "plan.json", "--to", "none", "--out", "x"),
    ("compare", "plan.json", "none"), ("logs", "import", "none", "-o", "made"),
    ("logs", "example", "none", "-o", "made"),
    ("learn", "runs", "--farm", "none.toml"), ("replay", "run.csv", "--ground", "lava"), ("drive", "--steer", "x"),
    ("drive", "--steer", "1", "--ground", "lava"), ("design", "--tractor", "none"), ("gnss", "fit", "plan.json"),
    ("farm", "check", "none.toml"), ("day", "none.toml", "--samples", "2"), ("tractor", "check", "none.toml"),
    ("restore", "none.zip", "--data", "other"), ("token", "new", "--scope", "none", "--name", "x"),
    ("token", "revoke", "none"), ("serve", "--port", "99999"), ("serve", "--public-url", "none", "--port", "99999"),
    ("robot", "--plan", "none", "--hide", "x", "--noise-m", "-1"), ("diagnose", "none.csv", "--seed", "1"),
    ("validate", "none", "--seed", "1"), ("study", "none"), ("backup", "none.txt"), ("demo", "none"),
)  # fmt: skip
"""Of every command a line that is refused: whatever a word of it is replaced by, it is refused quickly."""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("mutations")


@pytest.fixture
def folder(place: Path, headland: Run, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder with a field, a plan of it, logs of that, and a farm; the plan is put back after each test."""
    monkeypatch.chdir(place)
    monkeypatch.setenv("HEADLAND_DATA", str(place / "data"))
    (place / FIELD).write_text(json.dumps(small_field()))
    (place / "plan.json").write_text(json.dumps(small_plan()))
    if not (place / "runs").exists():
        for words in (
            ("logs", "example", "plan.json", "-o", "TASKDATA"), ("logs", "import", "TASKDATA", "-o", "runs"),
            ("farm", "new", "farm.toml"),
        ):  # fmt: skip
            assert headland(*words).status == 0
    yield place


def assert_sealed(outcome: Any, what: object) -> None:
    """A documented status; a refusal in one short line and nothing else; no control character anywhere."""
    assert outcome.status in (0, 2, 3), (what, outcome)
    assert "Traceback" not in outcome.err, what
    assert not CONTROLS.search(outcome.err), (what, outcome.err[:300])
    assert all(len(line) < 1000 for line in outcome.sentences), (what, outcome.err[:1500])
    if outcome.status == 2 and not outcome.out.lstrip().startswith("Usage"):
        assert outcome.out == "" and sum(line.startswith("Error: ") for line in outcome.sentences) == 1, (what, outcome)
        assert all(line.startswith(("Error: ", "Note: ")) for line in outcome.sentences), (what, outcome.err)


@pytest.mark.parametrize("machines", [pytest.param(False, marks=pytest.mark.matrix), True])
@pytest.mark.parametrize("words", SAVED, ids=" ".join)
def test_no_value_of_a_saved_plan_is_a_fault(
    headland: Run, folder: Path, words: tuple[str, ...], machines: bool
) -> None:
    plan = small_plan(machines)
    cases = [(where, name) for where in paths(plan) for name in ODD]
    remove_outputs(folder)
    assert headland(*words).status == 0  # whole, it is read
    for where, name in chosen(cases, words, machines):
        (folder / "plan.json").write_text(json.dumps(replaced(plan, where, ODD[name])))
        remove_outputs(folder)
        assert_sealed(headland(*words), (where, name))


def remove_outputs(folder: Path) -> None:
    """Remove what earlier commands wrote."""
    for made in (*folder.glob("o.*"), *folder.glob("made/*")):
        made.unlink()


def chosen(cases: list[tuple[Place, str]], words: tuple[str, ...], machines: bool) -> list[tuple[Place, str]]:
    """A share of the cases, the same each time and another for each command; those once found are always in it."""
    known = [(("scenario", "strategies", 0), "list"), (("scenario", "strategies", 0), "nan"), (("origin_m", 0), "huge"),
             (("notes", "strategy"), "deep"), (("scenario", "cell_bearings", 0, 1), "huge")]  # fmt: skip
    assert set(known) <= set(cases)
    draw = random.Random(f"{words} {machines}")
    return [*known, *draw.sample(cases, count_examples(len(cases) // SHARE))]


@pytest.mark.parametrize("line", LINES, ids=" ".join)
def test_no_word_is_a_fault(headland: Run, folder: Path, line: tuple[str, ...]) -> None:
    before = sorted(path for path in folder.iterdir())
    cases = [(index, word) for index in range(2, len(line)) for word in WORDS]
    for index, word in cases[:: max(1, len(cases) // EVERY)]:
        assert_sealed(headland(*line[:index], word, *line[index + 1 :]), (line, index, word[:20]))
    assert set(before) <= set(folder.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("name", [
    "a\nb.geojson",
    *(pytest.param(f"a{odd}b.geojson", marks=pytest.mark.matrix) for odd in ("\x1b[31m", "\u2028", "\u202e")),
])  # fmt: skip
def test_a_file_name_breaks_no_line(headland: Run, folder: Path, name: str) -> None:
    (folder / name).write_bytes((folder / FIELD).read_bytes())
    one = ("--tractors", "1", "--strategies", "split-field", "--no-headland", "--processes", "1")
    for words in (("field", name), ("plan", name, *one), ("plan", name, *one, "--width", "3,4")):
        outcome = headland(*words)
        assert outcome.status == 0 and not CONTROLS.search(outcome.out + outcome.err)
    refused = headland("plan", name, *one, "--save", name)
    (folder / name).unlink()
    assert refused.status == 2 and len(refused.sentences) == 1 and not CONTROLS.search(refused.err)


def test_names_in_a_farm_file_break_no_line(headland: Run, folder: Path) -> None:
    text = (folder / "farm.toml").read_text(encoding="utf-8")
    name = re.search(r'^name = "([^"]*)"', text, flags=re.MULTILINE)
    assert name
    (folder / "odd.toml").write_text(text.replace(f'"{name[1]}"', '"two\\nlines\\u001b[2J"'), encoding="utf-8")
    for words in (("farm", "check", "odd.toml"), ("plan", FIELD, "--farm", "odd.toml", "--tractor", "none")):
        outcome = headland(*words)
        assert outcome.status in (0, 2) and not CONTROLS.search(outcome.out + outcome.err)
        assert outcome.status == 0 or len(outcome.sentences) == 1
