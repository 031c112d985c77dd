"""Parts of a diagnosis against closed forms: rigid fits, the filter, the file written, the commands."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from planner.cli import diagnosis as diagnose_command
from planner.cli.main import app
from tests.diagnosis.hiding import eg105
from tests.examples import count_examples
from tests.truth.drives import circles, straight
from tests.truth.model import make_logs
from vehicle.identification.diagnosis.demo_logs import draw_hidden_effect, simulate_demo_logs
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.identification.replay.horizon_errors import (
    compute_anchored_errors,
    compute_horizon_errors,
    sum_squared_errors_by_run,
)
from vehicle.identification.replay.rig import build_rig
from vehicle.identification.residuals.noise_floor import compute_noise_floor
from vehicle.identification.residuals.noise_weights import estimate_first_noise
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model
from vehicle.model.tractor import EffectSetting, load_tractor
from vehicle.model.tractor_writer import format_tractor_toml


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    frames = make_logs({}, 4, [straight(60.0, seconds=30.0), circles(1)])
    course = build_dataset([build_log(frame, frame.attrs["name"]) for frame in frames])
    return build_residual_model(course, build_rig(eg105(), "soil", course.origin), {})


@given(st.floats(-3.0, 3.0), st.floats(-500.0, 500.0), st.floats(-500.0, 500.0))
@settings(max_examples=count_examples(30))
def test_a_rigid_motion_is_no_error(residual_model: ResidualModel, turn: float, east: float, north: float) -> None:
    segment = residual_model.dataset.segments[1]
    c, s = math.cos(turn), math.sin(turn)
    moved = np.stack(
        [c * segment.east - s * segment.north + east, s * segment.east + c * segment.north + north], axis=1
    )
    errors = compute_anchored_errors(segment, moved, segment.heading + turn, slice(0, 200))
    assert np.abs(errors).max() < 1e-9


def test_a_longer_way_is_an_error_along_it(residual_model: ResidualModel) -> None:
    """On a straight line, a simulation that drives 10 % too far is off by a uniform spread of 10 % of the way."""
    segment = residual_model.dataset.segments[0]
    line = np.linspace(0.0, 10.0, 201)
    plain = replace(segment, east=line, north=0.0 * line, heading=0.0 * line)
    errors = compute_anchored_errors(plain, np.stack([1.1 * line, 0.0 * line], axis=1), 0.0 * line, slice(0, 201))
    assert np.sqrt(np.mean(errors[:, 1] ** 2)) == pytest.approx(1.0 / math.sqrt(12.0), rel=0.01)
    assert np.abs(errors[:, [0, 2]]).max() < 1e-9


def test_residuals_of_a_true_model_are_white_and_of_size_one(residual_model: ResidualModel) -> None:
    found = residual_model.compute_path_residuals(residual_model.simulate_increments({}), {}).reshape(-1, 3)[20:]
    assert found.std() == pytest.approx(1.0, abs=0.12)
    neighbours = [np.corrcoef(found[:-1, axis], found[1:, axis])[0, 1] for axis in range(3)]
    assert np.abs(neighbours).max() < 0.1


def test_residuals_are_linear_in_the_motion(residual_model: ResidualModel) -> None:
    """Twice the change of a small effect gives twice the change of the residuals."""
    one, two = (
        residual_model.compute_path_residuals(residual_model.simulate_increments(effect), effect)
        - residual_model.compute_path_residuals(residual_model.simulate_increments({}), {})
        for effect in ({"antenna_right": {"distance_m": 1e-3}}, {"antenna_right": {"distance_m": 2e-3}})
    )
    assert np.abs(two - 2.0 * one).max() < 1e-6 + 1e-3 * np.abs(two).max()


def test_the_noise_floor_is_what_a_nominal_tractor_leaves() -> None:
    """In the mean of a line and of circles to both sides: a single run of soil is one draw."""
    frames = make_logs({}, 4, [straight(60.0), circles(1), circles(-1)])
    course = build_dataset([build_log(frame, frame.attrs["name"]) for frame in frames])
    residual_model = build_residual_model(course, build_rig(eg105(), "soil", course.origin), {})
    bare: dict[int, dict[str, dict[str, float]]] = {run: {} for run in range(3)}
    found = compute_horizon_errors(sum_squared_errors_by_run(course, residual_model.rig, bare))[5.0]
    floor = compute_horizon_errors(compute_noise_floor(residual_model, bare))[5.0]
    assert found.cross_cm == pytest.approx(floor.cross_cm, rel=0.2)
    assert found.heading_deg == pytest.approx(floor.heading_deg, rel=0.2)


def test_white_noise_is_told_from_the_path(residual_model: ResidualModel) -> None:
    noise = estimate_first_noise(residual_model.dataset)
    assert noise.position == pytest.approx(0.010, rel=0.15)
    assert noise.heading == pytest.approx(math.radians(0.12), rel=0.15)


def test_a_tractor_survives_its_file(tmp_path: Path) -> None:
    effects = {
        "steering_offset": EffectSetting(
            value={"angle_deg": 1.25}, interval={"angle_deg": (1.0, 1.5)}, logs=("a b", 'c"d')
        ),
        "side_slip": EffectSetting(value={"limit_g": 0.08}),
    }
    for name in ("eg105", "mr1000a"):
        tractor = load_tractor(name).model_copy(update={"effects": effects})
        path = tmp_path / "mine.toml"
        path.write_text(format_tractor_toml(tractor), encoding="utf-8")
        assert load_tractor(path) == tractor


def test_the_demonstration_repeats_and_hides_what_it_says() -> None:
    hidden = draw_hidden_effect(5, eg105(), "wheel_slip")
    one, two = (simulate_demo_logs(hidden, eg105(), "soil", 5) for _ in range(2))
    assert all(np.array_equal(a.easting_m, b.easting_m) for a, b in zip(one, two, strict=True))
    run = next(log for log in one if log.name == "straight_east")
    assert run.speed_mps is not None and run.speed_command_mps is not None
    ratio = float(np.median(run.speed_mps[100:] / run.speed_command_mps[100:]))
    assert ratio == pytest.approx(1.0 - hidden.values["ratio"], abs=0.01)


def test_replay_command_prints_errors_and_draws(tmp_path: Path) -> None:
    frame = make_logs({}, 9, [circles(-1)])[0]
    frame.to_csv(tmp_path / "run.csv", index=False)
    picture = tmp_path / "run.png"
    result = CliRunner().invoke(app, ["replay", str(tmp_path / "run.csv"), "--json", "--png", str(picture)])
    assert result.exit_code == 0, result.output
    errors = json.loads(result.stdout)["error"]
    assert set(errors) == {"1", "5", "10", "20"}
    assert errors["1"]["cross_cm"] < errors["20"]["cross_cm"] < 40.0
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("arguments", [[], ["run.csv", "--demo"], ["nowhere.csv"], ["--demo", "--hide", "gremlins"]])
def test_impossible_orders_are_refused(arguments: list[str]) -> None:
    result = CliRunner().invoke(app, ["diagnose", *arguments])
    assert isinstance(result.exception, ValueError)
    assert str(result.exception).endswith(".") and len(str(result.exception)) > 20


def test_left_positive_steering_is_recognised_and_mended(tmp_path: Path) -> None:
    frame = make_logs({}, 9, [circles(-1)])[0]
    frame[["steering_deg", "steering_command_deg"]] *= -1.0
    path = tmp_path / "run.csv"
    frame.to_csv(path, index=False)
    refused = CliRunner().invoke(app, ["replay", str(path)])
    assert "steering-left-positive" in str(refused.exception)
    assert CliRunner().invoke(app, ["replay", str(path), "--fix", "steering-left-positive"]).exit_code == 0


@pytest.mark.matrix
def test_one_command_from_logs_to_a_tractor_that_plans(tmp_path: Path) -> None:
    page, file = tmp_path / "report.html", tmp_path / "mine.toml"
    order = [
        "diagnose",
        "--demo",
        "--seed",
        "3",
        "--hide",
        "wheel_slip",
        "--json",
        "--html",
        str(page),
        "--save",
        str(file),
    ]
    result = CliRunner().invoke(app, order)
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert {"runs", "rows_used", "rows_gated", "error_before", "error_after", "noise_floor", "guilty_block", "effects",
            "named", "unexplained_share", "next_drive", "tractor"} <= set(found)  # fmt: skip
    assert found["named"] == ["wheel_slip"] and found["guilty_block"] == "speed"
    assert found["plan"]["time_after_s"] > found["plan"]["time_before_s"]
    assert set(load_tractor(file).effects) == {"wheel_slip"}
    text = page.read_text(encoding="utf-8")
    assert "slower over ground" in text and "http://" not in text.replace("http://www.w3.org", "")
    assert diagnose_command.diagnose.__doc__
