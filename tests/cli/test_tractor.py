"""`headland tractor`: own machines from a datasheet, checked by driving them."""

import json
from io import StringIO
from pathlib import Path
from typing import Any

import pytest

from tests.cli.conftest import Run
from tests.cli.refusals import assert_refused
from vehicle.model.tractor import load_tractor

FENDT = ("--name", "Fendt 724", "--wheelbase", 2.78, "--width", 2.55, "--turning-radius", 5.5)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with nobody at the terminal."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", StringIO(""))
    return tmp_path


@pytest.mark.slow
def test_a_datasheet_makes_a_file_that_holds_together(headland: Run, folder: Path) -> None:
    made = headland("tractor", "new", "my.toml", *FENDT, "--mass", 8000)
    note = "Wrote my.toml.\nNote: Without --power-kw plans cannot check whether this tractor can pull its implement.\n"
    assert (made.status, made.err) == (0, note) and "Turning radius 5.50 m on asphalt" in made.out
    whose = "Radii are of the circle of the antenna, 1.11 m ahead of the rear axle: R_antenna^2 = R_rear^2 + 1.11^2"
    assert whose in " ".join(made.out.split())
    tractor = load_tractor(folder / "my.toml")
    assert (tractor.name, tractor.mass_kg, tractor.width_m) == ("Fendt 724", 8000.0, 2.55)
    assert tractor.source["mass_kg"] == "given" and tractor.source["length_m"].startswith("assumed: ")
    told = headland("tractor", "check", "my.toml", "--json", "--png", "my.png", "--html", "my.html")
    assert (told.status, told.err) == (0, "Wrote my.html, my.png.\n")
    answer = json.loads(told.out)
    assert answer["tractor"] == "Fendt 724" and answer["holds_together"] is True
    full = next(drive for drive in answer["drives"] if drive["drive"].startswith("circle right, full lock"))
    assert full["ground"] == "asphalt" and full["achieved"] == pytest.approx(5.5, rel=0.01)
    assert full["target"] == pytest.approx(5.5) and abs(full["difference_pct"]) < 1.0
    assert {"my.toml", "my.png", "my.html"} == {path.name for path in folder.iterdir()}
    assert "Circles on asphalt" in (folder / "my.html").read_text(encoding="utf-8")


def test_the_check_says_in_words_what_does_not_go_together(headland: Run, folder: Path) -> None:
    assert "need 27.3" in headland("tractor", "new", "odd.toml", *FENDT, "--max-steering", 45).err
    told = headland("tractor", "check", "odd.toml")
    words = " ".join(told.out.split())
    assert told.status == 0 and "The values do not fit together" in words
    assert "Radii are of the circle of the antenna" in words
    assert "Radius at full lock" in words and "look at [radius], max_steering_deg" in words


def test_a_radius_of_the_outer_wheel_is_told_apart(headland: Run, folder: Path) -> None:
    assert headland("tractor", "new", "my.toml", *FENDT, "--radius-of", "outer-wheel").status == 0
    assert load_tractor(folder / "my.toml").compute_smallest_radius_m("asphalt") == pytest.approx(3.89, abs=0.01)


def test_what_is_missing_is_asked_for_on_a_terminal(
    headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("planner.cli.machines.can_prompt", lambda: True)
    answers = iter(["Robot", "278", "wide", "2,78 m", "5.5"])
    monkeypatch.setattr("sys.stdin", StringIO("\n".join(answers) + "\n"))
    made = headland("tractor", "new", "my.toml", "--width", 2.55)
    assert made.status == 0, made.err
    for words in ("Distance between the axles, m (usually 1 to 3.5", "278 is not possible; use 0.5 to 5", "'wide' is"):
        assert words in made.err
    tractor = load_tractor(folder / "my.toml")
    assert tractor.name == "Robot" and tractor.wheelbase_m == pytest.approx(2.78)


def test_leaving_the_questions_writes_nothing(headland: Run, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.cli.machines.can_prompt", lambda: True)
    left = headland("tractor", "new", "my.toml")
    assert left.status == 130 and left.sentences[-1] == "Error: Interrupted; nothing was written."
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("new", "my.toml"), "--name (in quotes, for instance \"Fendt 724\") and --wheelbase (distance between the"),
        (("new", "my.toml", *FENDT[:6]), "--turning-radius (radius at full lock, half the turning circle, m, usually"),
        (("new", "my.toml", *FENDT[2:]), "--name"),
        (("new", "my.toml", *FENDT, "--name", " "), "--name is empty"),
        (("new", "my.toml", *FENDT, "--width", 25.5),
         "--width is 25.5 (width over all, m, usually 0.8 to 3); use 0.3 to 5, perhaps 2.55."),
        (("new", "my.toml", *FENDT, "--turning-radius", 2), "--turning-radius is 2 m, tighter than a wheelbase of 2"),
        (("new", "my.toml", *FENDT, "--mass", -3), "--mass is -3"),
        (("new", "my.toml", *FENDT, "--steering-rate", 0), "--steering-rate is 0"),
        (("new", "my.toml", *FENDT, "--radius-of", "left"), "--radius-of 'left' is unknown"),
        (("new", "my.json", *FENDT), "name the file my.toml"),
        (("new", "nowhere/my.toml", *FENDT), "the folder nowhere does not exist"),
        (("new", "there.toml", *FENDT), "there.toml exists already; choose another name, or add --force"),
        (("check", "there.toml"), "it lacks mass_kg"),
        (("check", "none.toml"), "neither a file nor one of"),
        (("check", "eg105", "--png", "there.toml"), "does not end in .png"),
    ],
)  # fmt: skip
def test_bad_input_is_one_sentence(headland: Run, folder: Path, arguments: tuple[Any, ...], words: str) -> None:
    (folder / "there.toml").write_text('name = "half"', encoding="utf-8")
    told = headland("tractor", *arguments)
    assert_refused(told, words)
    assert [path.name for path in folder.iterdir()] == ["there.toml"]
    assert (folder / "there.toml").read_text(encoding="utf-8") == 'name = "half"'


def test_force_writes_over_a_file(headland: Run, folder: Path) -> None:
    (folder / "my.toml").write_text("", encoding="utf-8")
    assert headland("tractor", "new", "my.toml", *FENDT, "--force").status == 0
    assert load_tractor(folder / "my.toml").name == "Fendt 724"


def test_what_looks_odd_is_a_note(headland: Run, folder: Path) -> None:
    made = headland("tractor", "new", "my.toml", *FENDT, "--turning-radius", 11)
    assert made.status == 0 and made.err.startswith("Note: ") and "diameter" in made.err
