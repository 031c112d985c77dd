"""What a diagnosis changes in a plan: for the tractor it is about, and told when there is no plan."""

from pathlib import Path
from typing import Any

import pytest

from planner import HeadlandError, diagnose, replay
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.diagnosis import (
    MIN_TRACTOR_LENGTH_M,
    PLAN_FIELD,
    PLAN_WIDTH_M,
    collect_logs,
    diagnose_demo,
    measure_plan_gain,
)
from planner.request.plan_request import PlanRequest
from tests.identification.log_tables import table
from vehicle.identification.logs.reader import build_log
from vehicle.model.tractor import EffectSetting, Tractor, load_tractor
from vehicle.model.tractor_writer import format_tractor_toml

OFFSET = {"steering_offset": EffectSetting(value={"angle_deg": 2.0})}
CRAWL = {"wheel_slip": EffectSetting(value={"ratio": 0.85})}


def like_eg105(**changes: Any) -> Tractor:
    return load_tractor("eg105").model_copy(update=changes)


@pytest.fixture
def wide(tmp_path: Path) -> tuple[str, Tractor]:
    """A tractor with little lock, as a file."""
    path = tmp_path / "wide.toml"
    path.write_text(format_tractor_toml(like_eg105(name="wide", max_steering_deg=25.0)), encoding="utf-8")
    return str(path), load_tractor(path)


@pytest.mark.slow
def test_the_plan_is_that_of_the_tractor_and_not_of_another(wide: tuple[str, Tractor]) -> None:
    where, machine = wide
    gain, why_not = measure_plan_gain(machine, machine.model_copy(update={"effects": OFFSET}))
    assert why_not == ""
    scenario = PlanRequest(field=PLAN_FIELD, width_m=PLAN_WIDTH_M, tractor=where, no_headland=True)
    alone = simulate_candidate(prepare_context(WorkOrder(scenario)), Candidate("row-by-row", 1)).result
    assert gain.time_before_s == pytest.approx(alone.time_s, abs=1e-6)
    assert gain.time_after_s is not None
    # The guidance knows nothing of the offset: it holds against it from beside the track.
    assert gain.lateral_after_cm > gain.lateral_before_cm + 2.0


@pytest.mark.slow
def test_a_plan_that_the_real_tractor_would_not_finish_has_no_time() -> None:
    gain, _ = measure_plan_gain(like_eg105(), like_eg105(effects=CRAWL))
    assert gain.time_before_s is not None and gain.time_after_s is None


def test_nothing_added_needs_no_words_and_what_was_kept_does() -> None:
    assert measure_plan_gain(like_eg105(), like_eg105()) == (None, "")
    kept = like_eg105(effects=OFFSET)
    gain, why_not = measure_plan_gain(kept, kept)
    assert gain is None and why_not == "The tractor stays as its file has it, so no plan was driven to compare."


def test_a_model_car_drives_no_plan() -> None:
    car = like_eg105(name="car", length_m=0.3)
    gain, why_not = measure_plan_gain(car, car.model_copy(update={"effects": OFFSET}))
    assert gain is None
    assert why_not == (
        "No plan was driven to compare: car is 0.3 m long, and plans are for tractors of "
        f"{MIN_TRACTOR_LENGTH_M:g} m or more."
    )


def test_a_tractor_without_measured_radii_drives_the_plan_by_its_wheelbase(tmp_path: Path) -> None:
    path = tmp_path / "ackermann.toml"
    path.write_text(format_tractor_toml(like_eg105(radius={})), encoding="utf-8")
    machine = load_tractor(path)
    gain, why_not = measure_plan_gain(machine, machine.model_copy(update={"effects": OFFSET}))
    assert why_not == "" and gain is not None and gain.time_before_s is not None


def test_a_tractor_whose_radii_are_not_known_there_is_diagnosed_all_the_same(tmp_path: Path) -> None:
    path = tmp_path / "asphalt.toml"
    radius = {"asphalt": like_eg105().radius["asphalt"]}
    path.write_text(format_tractor_toml(like_eg105(radius=radius)), encoding="utf-8")
    machine = load_tractor(path)
    gain, why_not = measure_plan_gain(machine, machine.model_copy(update={"effects": OFFSET}))
    assert gain is None
    assert why_not.startswith("No plan was driven to compare: No turning radii of Yanmar EG105 are known on 'soil'")
    assert why_not.endswith(".") and not why_not.endswith("..")


@pytest.mark.parametrize(("ask", "parameter"), [
    (lambda: diagnose([]), "logs"),
    (lambda: diagnose("nothing.csv"), "logs"),
    (lambda: diagnose(["nothing.csv"], tractor="nobody"), "tractor"),
    (lambda: diagnose(["nothing.csv"], fixes=["nonsense"]), "fixes"),
    (lambda: diagnose("sample", holdout="other"), "holdout"),
    (lambda: diagnose_demo(holdout=99), "holdout"),
    (lambda: replay("nothing.csv"), "log"),
    (lambda: replay("nothing.csv", tractor="nobody"), "tractor"),
])  # fmt: skip
def test_a_refusal_names_the_parameter_at_fault(ask: Any, parameter: str) -> None:
    with pytest.raises(HeadlandError) as refusal:
        ask()
    assert refusal.value.parameter == parameter


def test_logs_and_files_stay_in_their_order(tmp_path: Path) -> None:
    """By it runs are numbered (holdout="#1")."""
    table().to_csv(tmp_path / "file.csv", index=False)
    logs = [build_log(table(), name) for name in ("one", "two", "three")]
    mixed = [logs[0], tmp_path / "file.csv", *logs[1:]]
    collected = collect_logs(mixed, (), load_tractor("eg105"))
    assert [log.name for log in collected] == ["one", "file", "two", "three"]


def test_one_log_need_not_be_in_a_list() -> None:
    with pytest.raises(HeadlandError, match=r"nothing\.csv does not exist"):
        diagnose("nothing.csv")
