"""`validate`, `drive`, `design` and `gnss` as a user and a program meet them."""

import json
import math
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from planner.cli import experiments
from reports.trials.report import format_drive_json
from tests.cli.conftest import Run
from tests.cli.examples import EXPERIMENTS, list_guide_commands, run_as_written
from tests.cli.refusals import assert_refused
from vehicle.trials.sheets.fixed_steering import describe_drive
from vehicle.trials.sheets.sheet import SteeredDrive

pytestmark = pytest.mark.slow

KEYS = {"experiment", "quantity", "unit", "thesis", "ours", "difference_pct", "note"}


@pytest.fixture(scope="module")
def driven() -> Iterator[None]:
    """Every experiment is driven once for all commands that show it."""
    validate = experiments.run_experiments

    @cache
    def sheet(name: str, seed: int) -> Any:
        return validate((name,), seed=seed)[0]

    def known(names: tuple[str, ...] = experiments.EXPERIMENTS, *, seed: int = 1, progress: Any = None) -> Any:
        return tuple(sheet(name, seed) for name in names)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(experiments, "run_experiments", known)
        yield


@pytest.mark.usefixtures("driven")
def test_every_experiment_reports_numbers_as_promised(headland: Run) -> None:
    outcome = headland("validate", "--json")
    assert outcome.status == 0
    rows = json.loads(outcome.out)
    assert {frozenset(row) for row in rows} == {frozenset(KEYS)}
    assert len({(row["experiment"], row["quantity"]) for row in rows}) == len(rows)
    tables = {name: sum(row["experiment"].startswith(name + " ") for row in rows)
              for name in ("3.1", "3.2", "3.3", "3.4", "4.1", "4.3", "Eq. 2.9", "Eq. 2.10", "Eq. 5.1")}  # fmt: skip
    assert tables == {"3.1": 32, "3.2": 64, "3.3": 48, "3.4": 8, "4.1": 9, "4.3": 24, "Eq. 2.9": 14, "Eq. 2.10": 14,
                      "Eq. 5.1": 14}  # fmt: skip
    for row in rows:
        if row["thesis"] is None or row["ours"] is None:
            assert row["difference_pct"] is None and row["note"]
        else:
            assert row["difference_pct"] == pytest.approx(100.0 * (row["ours"] / row["thesis"] - 1.0))
    row = next(row for row in rows if row["experiment"] == "4.1 linear 25 deg")
    assert (row["thesis"], row["unit"]) == (5.89, "m") and row["ours"] == pytest.approx(5.89, rel=0.03)


@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize("line", [
    pytest.param(line, marks=pytest.mark.matrix if line == "headland validate" else ())
    for line in list_guide_commands() if line.startswith(EXPERIMENTS)
])  # fmt: skip
def test_a_command_of_the_readme(line: str, headland: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    run_as_written(line, tmp_path, headland)


@pytest.mark.usefixtures("driven")
def test_the_zigzag_has_numbers_of_ours_only(headland: Run) -> None:
    rows = json.loads(headland("validate", "zigzag", "--json").out)
    assert len(rows) == 30 and {frozenset(row) for row in rows} == {frozenset(KEYS)}
    assert all(row["thesis"] is None and "prints no number" in row["note"] for row in rows)
    ours = {(row["experiment"], row["quantity"]): row["ours"] for row in rows}
    text = " ".join(headland("validate", "zigzag").out.split())
    apart = [ours[f"zigzag lookahead 5 m omega 1/{n}", "proposed and traditional apart, largest"] for n in (5, 4, 3)]
    assert "5 m they are " + ", ".join(f"{value:.1f}" for value in apart) + " cm apart" in text
    assert "Thesis" not in text, "a table with nothing beside the thesis is not shown"


def test_the_same_seed_gives_the_same_bytes(headland: Run) -> None:
    one, again, other = (headland("validate", "navigation", "--json", "--seed", seed).out for seed in (3, 3, 4))
    assert one == again != other


def test_a_drive_as_promised(headland: Run) -> None:
    outcome = headland("drive", "--steer", "-20", "--ground", "mud", "--model", "linear", "--seconds", "40", "--json")
    found = json.loads(outcome.out)
    assert set(found) == {"radius_m", "stable", "slip_front_deg", "slip_rear_deg", "track"}
    track = np.array(found["track"])
    assert track.shape == (400, 5) and track[1, 0] == pytest.approx(0.1)
    assert track[-1, 4] == pytest.approx(-20.0) and found["stable"]
    # A left turn lies west of the start, and its heading falls from north.
    assert track[:, 1].min() < -5.0 and 300.0 < track[25, 3] < 360.0
    end = track[-100:, 1:3]
    system = np.concatenate([2.0 * end, np.ones((len(end), 1))], axis=1)
    x, y, rest = np.linalg.lstsq(system, (end**2).sum(axis=1), rcond=None)[0]
    assert math.sqrt(rest + x * x + y * y) == pytest.approx(found["radius_m"], rel=1e-3)


def test_oversteer_has_no_radius() -> None:
    driven = SteeredDrive(None, False, 3.0, 12.5, np.empty((0, 5)))
    slips = "slip 3.00 degrees at the front axle and 12.50 at the rear"
    assert describe_drive(driven) == f"Oversteer: the side-slip does not settle; at the end {slips}."
    found = json.loads(format_drive_json(driven))
    assert found["radius_m"] is None and found["stable"] is False


def test_straight_on_has_no_radius_either(headland: Run) -> None:
    found = json.loads(headland("drive", "--steer", "0", "--json").out)
    assert found["radius_m"] is None and found["stable"] is True


@pytest.mark.usefixtures("driven")
@pytest.mark.parametrize("words", [
    ("validate", "changing"), ("design", "mass"),
    ("drive", "--steer", "30", "--ground", "mud", "--seconds", "20"),
    *(pytest.param(words, marks=pytest.mark.matrix) for words in (
        ("validate", "slip"), ("validate", "zigzag"), ("validate", "navigation"), ("design", "tyres"),
    )),
])  # fmt: skip
def test_pages_and_pictures_stand_alone(headland: Run, tmp_path: Path, words: tuple[str, ...]) -> None:
    page, picture = tmp_path / "page.html", tmp_path / "picture.png"
    assert headland(*words, "--html", page, "--png", picture).status == 0
    text = page.read_text(encoding="utf-8")
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert text.count("data:image/svg+xml;base64,") >= 2
    assert not re.search(r"""(?:src|href)=["'](?!data:)""", text)


def test_a_design_study_as_json(headland: Run) -> None:
    found = json.loads(headland("design", "tyres", "--json").out)
    assert [len(panel["values"]) for panel in found["panels"]] == [20] * 4
    assert any(value is None for row in found["panels"][0]["values"] for value in row)


def test_a_table_of_errors_from_fixes(headland: Run, tmp_path: Path) -> None:
    fixes, table = tmp_path / "fixes.csv", tmp_path / "table.csv"
    cells = [(0, 0), (0, 0), (1, 0), (0, 1)] * 50
    fixes.write_text("x_m,y_m\n" + "".join(f"{100 + x / 1000},{y / 1000}\n" for x, y in cells), encoding="utf-8")
    assert headland("gnss", "fit", fixes, "-o", table).status == 0
    assert table.read_text(encoding="utf-8") == headland("gnss", "fit", fixes).out
    assert table.read_text(encoding="utf-8").splitlines() == [
        "east_mm,north_mm,above,up_to", "0,1,0,50", "1,0,50,100", "0,0,100,200",
    ]  # fmt: skip
    assert len(headland("gnss", "default").out.splitlines()) > 100


@pytest.mark.parametrize(("words", "sentence"), [
    (("validate", "zigzak"), "The experiment 'zigzak' is unknown (did you mean 'zigzag'?); use one of: circles, step"),
    (("validate", "--png", "x.png"), "--png shows one experiment; name one of: circles"),
    (("validate", "--seed", "-1"), "--seed is -1; use 0 or more"),
    (("design", "wheels"), "The study 'wheels' is unknown"),
    (("drive", "--steer", "36"), "36 degrees is beyond the stop; use 35 or less"),
    (("drive", "--steer", "nan"), "--steer is nan; give a number"),
    (("drive", "--steer", "20", "--ground", "sand"), "The ground 'sand' is unknown; use one of: asphalt, soil, mud"),
    (("drive", "--steer", "20", "--model", "rigid"), "use one of: kinematic, linear, nonlinear"),
    (("drive", "--steer", "20", "--steering", "rigid"), "use one of: proposed, traditional, none, unlatched"),
    (("drive", "--steer", "20", "--mass", "2.5"), "outside the wheelbase of 2.4 m"),
    (("drive", "--steer", "20", "--speed-kmh", "0"), "--speed-kmh is 0"),
    (("drive", "--steer", "20", "--seconds", "1"), "--seconds is 1; use 20 to 3600"),
    (("drive", "--steer", "20", "--png", "nowhere/x.png"), "the folder nowhere does not exist"),
    (("gnss", "fit", "nowhere.csv"), "There is no file 'nowhere.csv'"),
])  # fmt: skip
def test_bad_input_is_one_sentence(headland: Run, words: tuple[str, ...], sentence: str) -> None:
    assert_refused(headland(*words), sentence)


def test_a_negative_wheelbase_is_refused(headland: Run, tmp_path: Path) -> None:
    from importlib import resources

    text = (resources.files("vehicle") / "data" / "eg105.toml").read_text(encoding="utf-8")
    path = tmp_path / "my.toml"
    path.write_text(text.replace("front_axle_m = 1.3\n", "front_axle_m = -1.3\n", 1), encoding="utf-8")
    assert_refused(headland("drive", "--steer", "20", "--tractor", path), "front_axle_m = -1.3")
