"""Effects that only a heading tells apart, by hand at one pace, and in logs with and without one."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from tests.diagnosis.sets import LogSet
from tests.truth.drives import three_speeds_programme
from tests.truth.second import second_logs
from vehicle.measured.answer.diagnose import diagnose
from vehicle.measured.answer.late import kin, with_kin
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, REFUTED
from vehicle.measured.logs.reading import log_from_frame
from vehicle.measured.surprise.bench import Bench
from vehicle.tractor import load_tractor


def bench(heading_seen: bool = False, has_wheel: bool = True) -> Bench:
    stretch = SimpleNamespace(heading_seen=heading_seen, heading=np.zeros(9), pace=np.full(9, 2.0))
    made: Any = SimpleNamespace(course=SimpleNamespace(stretches=(stretch,)), has_wheel=has_wheel)
    return cast(Bench, made)


def test_a_heading_or_a_wheel_angle_tells_them_apart() -> None:
    assert kin(bench(heading_seen=True)) == ()
    assert kin(bench()) == ("antenna_forward", "gnss_latency")
    assert kin(bench(has_wheel=False)) == ("antenna_forward", "gnss_latency", "steering_dead_time")


def test_rivals_are_as_late_as_what_was_found() -> None:
    back, late = {"antenna_forward": {"distance_m": -0.4}}, {"gnss_latency": {"time_s": 0.3}}
    told = with_kin(bench(has_wheel=False), {"antenna_forward": {}}, back, back)
    assert told == {"antenna_forward": {"gnss_latency": {"time_s": 0.2}, "steering_dead_time": {"time_s": 0.2}}}
    assert with_kin(bench(), {"gnss_latency": {}}, late, late) == {
        "gnss_latency": {"antenna_forward": {"distance_m": -0.6}}
    }


def test_what_is_early_has_a_heading_or_stands_in_the_model_has_no_rival() -> None:
    ahead, back = {"antenna_forward": {"distance_m": 0.4}}, {"antenna_forward": {"distance_m": -0.4}}
    both = {**back, "gnss_latency": {"time_s": 0.1}}
    assert with_kin(bench(), {"antenna_forward": {}}, ahead, ahead) == {"antenna_forward": {}}
    assert with_kin(bench(heading_seen=True), {"antenna_forward": {}}, back, back) == {"antenna_forward": {}}
    assert with_kin(bench(), {"antenna_forward": {}}, back, both) == {"antenna_forward": {}}
    offset = {"steering_offset": {"angle_deg": 1.0}}
    assert with_kin(bench(), {"steering_offset": {}}, offset, offset) == {"steering_offset": {}}


def test_a_rival_that_surprises_told_keeps_its_value() -> None:
    back, told = {"antenna_forward": {"distance_m": -0.4}}, {"antenna_forward": {"gnss_latency": {"time_s": 0.17}}}
    assert with_kin(bench(), told, back, back) == told


@pytest.mark.parametrize("dropped", [["heading_deg"], ["heading_deg", "speed_mps"], ["heading_deg", "steering_deg"]])
def test_an_antenna_further_back_is_not_told_as_another_without_a_heading(dropped: list[str]) -> None:
    one = LogSet(905, ("antenna_forward",), "clear", "eg105")
    frames = second_logs(one.effects(), one.seed, three_speeds_programme(), one.tractor)
    logs = [log_from_frame(frame.drop(columns=dropped), frame.attrs["name"]) for frame in frames]
    found = diagnose(logs, load_tractor(one.tractor), "soil")
    status = {finding.id: finding.status for finding in found.findings}
    assert not [name for name in found.named if name != "antenna_forward"] and status["antenna_forward"] != REFUTED
    for name in ("gnss_latency", "steering_dead_time"):
        assert status[name] != NAMED and (status[name] != EQUIVALENT or status["antenna_forward"] == EQUIVALENT)
