"""Instruments with clocks of their own, against closed forms: what a log shows, and what drives its replay."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.replay.drive_segments import DriveSegment, measure_wheel_lag
from vehicle.identification.replay.horizon_errors import simulate_instruments
from vehicle.identification.replay.rig import (
    InstrumentTiming,
    compute_shown_headings,
    compute_timing,
    restore_true_inputs,
)
from vehicle.model.effects import compute_effect_fields


@pytest.fixture(scope="module")
def segment() -> DriveSegment:
    return simulated("steps", {}).segments[0]


def test_ages_add_up() -> None:
    settings = {
        "gnss_latency": {"time_s": 0.2},
        "position_delay": {"time_s": 0.1},
        "clock_offset_heading": {"time_s": -0.3},
        "speed_scale": {"ratio": 1.1},
    }
    timing = compute_timing(compute_effect_fields(settings))
    assert (timing.position_s, timing.heading_s) == pytest.approx((0.3, -0.1))
    assert timing.speed_scale == 1.1 and not timing.has_neutral_inputs and not timing.is_heading_as_old
    assert compute_timing(compute_effect_fields({})) == InstrumentTiming() and InstrumentTiming().has_neutral_inputs


def test_headings_are_late_and_smoothed(segment: DriveSegment) -> None:
    ramp = 0.2 * segment.steps_s
    late = compute_shown_headings(segment, ramp, InstrumentTiming(heading_s=0.5))
    assert late[20:] == pytest.approx(0.2 * (segment.time - 0.5)[20:], abs=1e-9)
    smooth = compute_shown_headings(segment, ramp, InstrumentTiming(heading_filter_s=0.4))
    assert smooth[40:] == pytest.approx(0.2 * (segment.time - 0.4)[40:], abs=4e-3), "it trails a ramp by its time"
    assert smooth[0] == pytest.approx(0.0, abs=1e-3)


def test_inputs_of_a_replay_are_those_of_its_times(segment: DriveSegment) -> None:
    timing = InstrumentTiming(speed_s=0.4, speed_scale=1.1, steering_s=-0.3, command_s=0.2)
    true = restore_true_inputs(segment, timing)
    assert true.grids["speed"][0] == pytest.approx(segment.grids["speed"][24] / 1.1)
    assert true.grids["wheel"][200] == pytest.approx(segment.grids["wheel"][182])
    assert true.grids["command"][100] == pytest.approx(segment.grids["command"][112])
    assert true.logged_wheel is not None and true.logged_wheel[0][0] == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("name", "values", "shown"),
    [
        ("position_delay", {"time_s": 0.3}, "position"),
        ("heading_delay", {"time_s": 0.3}, "heading"),
        ("heading_filter", {"time_s": 0.3}, "heading"),
        ("speed_scale", {"ratio": 1.1}, "speed"),
        ("clock_offset_steering", {"time_s": 0.4}, "wheel"),
    ],
)
def test_each_effect_shows_in_its_own_column(
    segment: DriveSegment, name: str, values: dict[str, float], shown: str
) -> None:
    """Driven at the commanded speed, so that only what is shown differs and not what is driven, but for its start."""
    plain, seen = (simulate_instruments(rig(), segment, settings) for settings in ({}, {name: values}))
    for column, one, other in zip(("position", "heading", "wheel", "speed"), plain, seen, strict=True):
        assert np.allclose(one, other, atol=0.02) is (column != shown)


def test_wheels_follow_their_commands(segment: DriveSegment) -> None:
    assert 0.0 < measure_wheel_lag([segment]) < 0.6
    ahead = restore_true_inputs(segment, InstrumentTiming(steering_s=0.7))
    assert measure_wheel_lag([ahead]) < -0.05
    assert measure_wheel_lag([replace(segment, command=None)]) == np.inf
