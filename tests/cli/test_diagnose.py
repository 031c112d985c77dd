"""`diagnose --demo --json` says what it hid beside what it found; the sample log that comes with the program."""

import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

from tests.cli.conftest import Run
from tests.reports.test_diagnosis_logs import HARMFUL
from tests.truth.sample_log import HIDDEN, format_sample_log
from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.reader import resolve_log_path
from vehicle.model.tractor import load_tractor


@pytest.mark.matrix
def test_the_demonstration_says_what_it_hid(headland: Run) -> None:
    outcome = headland("diagnose", "--demo", "--seed", "3", "--hide", "steering_gain", "--json")
    assert outcome.status == 0, outcome.err
    found = json.loads(outcome.out)
    hidden = draw_hidden_effect(3, load_tractor("eg105"), "steering_gain")
    assert found["hidden"] == {"id": "steering_gain", "value": hidden.values, "words": hidden.description}
    assert found["named"] == ["steering_gain"]
    low, high = next(one["interval"]["ratio"] for one in found["effects"] if one["id"] == "steering_gain")
    assert low <= hidden.values["ratio"] <= high
    assert found["plan"]["field"] == "iwamizawa" and found["tractor"]["effects"]["steering_gain"]["named"] is True


@pytest.mark.slow
def test_the_sample_log_says_what_was_hidden_in_it_with_a_part_held_out(headland: Run, tmp_path: Path) -> None:
    page, plan = tmp_path / "sample.html", tmp_path / "next.json"
    words = ("diagnose", "sample", "--holdout", "auto", "--json", "--html", page, "--next-drive", plan)
    outcome = headland(*words)
    assert outcome.status == 0, outcome.err
    assert "no doubt" in outcome.err and not plan.exists()
    found = json.loads(outcome.out)
    assert found["named"] == ["understeer"]
    assert found["holdout"]["is_requested"] and found["holdout"]["helps"] and found["unsaved_reason"] is None
    low, high = next(one["interval"]["deg_per_mps2"] for one in found["effects"] if one["id"] == "understeer")
    assert low <= HIDDEN["understeer"]["deg_per_mps2"] <= high
    # The errors of all bins together are those of the table, for the file as it was.
    for bins in ("over_time_s", "by_angle_deg"):
        errors, expected = found["residuals"][bins], found["error_before"]["10"]["cross_cm"]
        squares = sum(one["rows"] * one["cross_before_cm"] ** 2 for one in errors) / sum(one["rows"] for one in errors)
        assert math.sqrt(squares) == pytest.approx(expected, rel=1e-3)
    by_speed = [one for one in found["residuals"]["by_speed_mps"] if one["low"] >= 2.0]
    assert all(one["cross_after_cm"] < 0.7 * one["cross_before_cm"] for one in by_speed), "it shows at speed"
    assert page.read_text(encoding="utf-8").count('class="at"') == 4


def test_the_sample_log_is_replayed_and_gives_way_to_a_file_of_that_name(
    headland: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = json.loads(headland("replay", "sample", "--json").out)
    assert found["run"] == "sample_log" and found["error"]["20"]["cross_cm"] > 10.0
    monkeypatch.chdir(tmp_path)
    Path("sample").write_text("time_s,easting_m\n", encoding="utf-8")
    assert headland("replay", "sample").status != 0


@pytest.mark.slow
def test_the_sample_log_is_that_of_the_truth_model() -> None:
    shipped = pd.read_csv(resolve_log_path("sample"))
    made = pd.read_csv(io.StringIO(format_sample_log()))
    assert list(made) == list(shipped) and resolve_log_path("sample").stat().st_size < 200_000
    np.testing.assert_allclose(made, shipped, atol=0.002)


def test_what_does_not_help_on_runs_held_out_is_not_saved(
    headland: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def answer(*_: Any, **options: Any) -> Diagnosis:
        asked.append(options["holdout"])
        return HARMFUL

    monkeypatch.setattr("planner.pipeline.diagnosis.diagnose", answer)
    file, page = tmp_path / "own.toml", tmp_path / "page.html"
    outcome = headland("diagnose", "sample", "--holdout", "a*", "--holdout", "#2", "--save", file, "--html", page)
    assert outcome.status == 3 and not file.exists() and page.exists() and asked == [["a*", "#2"]]
    wrote, sentence = outcome.sentences
    assert wrote.startswith("Wrote ") and wrote.endswith(f"{page.name}.")
    assert sentence.startswith(f"{file} is not written: What was found does not lower the error on runs held out")
    assert "does not help there" in outcome.out and "understeer" not in outcome.out
    explained = headland("diagnose", "sample", "--holdout", "auto", "--explain")
    assert explained.status == 0 and "understeer" in explained.out, "nothing was to be saved"
    told = json.loads(headland("diagnose", "sample", "--holdout", "auto", "--json").out)
    assert told["holdout"]["helps"] is False and told["unsaved_reason"]
