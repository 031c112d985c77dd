"""Effects that only a heading tells apart, by hand at one pace, and in logs with and without one."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.diagnosis.sets import LogSet
from tests.truth.drives import three_speeds_programme
from tests.truth.second import second_logs
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import EQUIVALENT, NAMED, REFUTED
from vehicle.identification.logs.reader import build_log
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.verdict.findings import add_delay_like_competitors, list_delay_like_effects
from vehicle.model.tractor import load_tractor

THREE_SPEEDS, ONE_SPEED = (1.0, 2.0, 3.0), (0.0, 2.0, 2.0, 2.0)


def residual_model(
    heading_measured: bool = False, has_wheel: bool = True, speeds: tuple[float, ...] = THREE_SPEEDS
) -> ResidualModel:
    segments = tuple(
        SimpleNamespace(heading_measured=heading_measured, heading=np.zeros(9), speed_in_gear=np.full(9, speed))
        for speed in speeds
    )
    made: Any = SimpleNamespace(dataset=SimpleNamespace(segments=segments), has_measured_wheel_angle=has_wheel)
    return cast(ResidualModel, made)


def test_a_heading_or_a_wheel_angle_tells_them_apart() -> None:
    assert list_delay_like_effects(residual_model(heading_measured=True)) == ()
    assert list_delay_like_effects(residual_model()) == ("antenna_forward", "gnss_latency")
    assert list_delay_like_effects(residual_model(has_wheel=False)) == (
        "antenna_forward",
        "gnss_latency",
        "steering_dead_time",
    )


def test_at_one_speed_beside_halts_a_heading_does_not_tell_an_antenna_from_late_positions() -> None:
    one_speed, back = residual_model(heading_measured=True, speeds=ONE_SPEED), {"antenna_forward": {"distance_m": -0.4}}
    assert list_delay_like_effects(one_speed) == ("antenna_forward", "position_delay")
    assert add_delay_like_competitors(one_speed, {"antenna_forward": {}}, back, back) == {
        "antenna_forward": {"position_delay": {"time_s": 0.2}}
    }


def test_competitors_are_as_late_as_what_was_found() -> None:
    back, late = {"antenna_forward": {"distance_m": -0.4}}, {"gnss_latency": {"time_s": 0.3}}
    told = add_delay_like_competitors(residual_model(has_wheel=False), {"antenna_forward": {}}, back, back)
    assert told == {"antenna_forward": {"gnss_latency": {"time_s": 0.2}, "steering_dead_time": {"time_s": 0.2}}}
    assert add_delay_like_competitors(residual_model(), {"gnss_latency": {}}, late, late) == {
        "gnss_latency": {"antenna_forward": {"distance_m": -0.6}}
    }


def test_what_is_early_has_a_heading_or_stands_in_the_model_has_no_competitor() -> None:
    ahead, back = {"antenna_forward": {"distance_m": 0.4}}, {"antenna_forward": {"distance_m": -0.4}}
    both = {**back, "gnss_latency": {"time_s": 0.1}}
    assert add_delay_like_competitors(residual_model(), {"antenna_forward": {}}, ahead, ahead) == {
        "antenna_forward": {}
    }
    assert add_delay_like_competitors(residual_model(heading_measured=True), {"antenna_forward": {}}, back, back) == {
        "antenna_forward": {}
    }
    assert add_delay_like_competitors(residual_model(), {"antenna_forward": {}}, back, both) == {"antenna_forward": {}}
    offset = {"steering_offset": {"angle_deg": 1.0}}
    assert add_delay_like_competitors(residual_model(), {"steering_offset": {}}, offset, offset) == {
        "steering_offset": {}
    }


def test_a_competitor_that_residuals_told_keeps_its_value() -> None:
    back, told = {"antenna_forward": {"distance_m": -0.4}}, {"antenna_forward": {"gnss_latency": {"time_s": 0.17}}}
    assert add_delay_like_competitors(residual_model(), told, back, back) == told


@pytest.mark.matrix
@pytest.mark.parametrize("dropped", [
    ["heading_deg"],
    *(pytest.param(["heading_deg", more], marks=pytest.mark.matrix) for more in ("speed_mps", "steering_deg")),
])  # fmt: skip
def test_an_antenna_further_back_is_not_told_as_another_without_a_heading(dropped: list[str]) -> None:
    one = LogSet(905, ("antenna_forward",), "clear", "eg105")
    frames = second_logs(one.effects(), one.seed, three_speeds_programme(), one.tractor)
    logs = [build_log(frame.drop(columns=dropped), frame.attrs["name"]) for frame in frames]
    found = diagnose_logs(logs, load_tractor(one.tractor), "soil")
    status = {finding.id: finding.status for finding in found.findings}
    assert not [name for name in found.named if name != "antenna_forward"] and status["antenna_forward"] != REFUTED
    for name in ("gnss_latency", "steering_dead_time"):
        assert status[name] != NAMED and (status[name] != EQUIVALENT or status["antenna_forward"] == EQUIVALENT)
