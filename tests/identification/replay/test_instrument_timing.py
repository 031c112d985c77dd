"""Instruments with clocks of their own, against closed forms: what a log shows, and what drives its replay."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.analytic_drives import rig, simulated
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment, measure_wheel_lag
from vehicle.identification.replay.simulation import (
    ANGLE_COLUMN,
    FORWARD_COLUMN,
    STEERING_COLUMN,
    X_COLUMN,
    replay_segment,
    simulate_instruments,
    simulate_logged_values,
)
from vehicle.model.tractor import Settings


@pytest.fixture(scope="module")
def segment() -> DriveSegment:
    return simulated("steps", {}).segments[0]


def show_ramps(segment: DriveSegment, settings: Settings) -> tuple[Array, Array, Array, Array]:
    """What is shown where place, heading, wheel angle and speed grow by 1 m, 0.2, 0.1 rad and 0.3 m/s a second."""
    states = np.zeros((len(segment.steps_s), 5))
    for column, rate in ((X_COLUMN, 1.0), (ANGLE_COLUMN, 0.2), (STEERING_COLUMN, 0.1), (FORWARD_COLUMN, 0.3)):
        states[:, column] = rate * segment.steps_s
    return simulate_logged_values(rig(), segment, states, settings)


def test_ages_add_up(segment: DriveSegment) -> None:
    settings = {
        "gnss_latency": {"time_s": 0.2},
        "position_delay": {"time_s": 0.1},
        "clock_offset_heading": {"time_s": -0.3},
        "clock_offset_steering": {"time_s": 0.4},
        "clock_offset_speed": {"time_s": -0.1},
        "speed_scale": {"ratio": 1.1},
    }
    lever = rig().tractor.antenna_forward_m - rig().tractor.rear_axle_m
    position, heading, wheel, speed = (one[10:-10] for one in show_ramps(segment, settings))
    time = segment.time[10:-10]
    assert position[:, 0] == pytest.approx(time - 0.3 + lever * np.cos(0.2 * (time - 0.3)), abs=1e-4)
    assert heading == pytest.approx(0.2 * (time + 0.1), abs=1e-9)
    assert wheel == pytest.approx(0.1 * (time - 0.4), abs=1e-9)
    assert speed == pytest.approx(1.1 * 0.3 * (time + 0.1), abs=1e-9)


def test_headings_are_smoothed(segment: DriveSegment) -> None:
    smooth = show_ramps(segment, {"heading_filter": {"time_s": 0.4}})[1]
    assert smooth[40:] == pytest.approx(0.2 * (segment.time - 0.4)[40:], abs=4e-3), "it trails a ramp by its time"
    assert smooth[0] == pytest.approx(0.0, abs=1e-3)


def test_inputs_of_a_replay_are_those_of_its_times(segment: DriveSegment) -> None:
    ramp = replace(segment, grids=segment.grids | {"speed": 1.0 + 0.05 * segment.steps_s})
    late = {"clock_offset_speed": {"time_s": 0.4}, "speed_scale": {"ratio": 1.1}}
    speed = replay_segment(rig(), ramp, late, from_sensor=True, from_speed=True)[:, FORWARD_COLUMN]
    assert speed[:-60] == pytest.approx((ramp.grids["speed"][:-60] + 0.05 * 0.4) / 1.1)
    plain, early = (
        replay_segment(rig(), segment, settings, from_sensor=False, from_speed=True)[:, STEERING_COLUMN]
        for settings in ({}, {"clock_offset_steering_command": {"time_s": 0.2}})
    )
    assert early[60:-60] == pytest.approx(plain[72:-48], abs=1e-6)
    turned, before = (
        replay_segment(rig(), segment, settings, from_sensor=True, from_speed=True)[:, ANGLE_COLUMN]
        for settings in ({}, {"clock_offset_steering": {"time_s": 0.2}})
    )
    assert before[60:-60] - before[60] == pytest.approx(turned[72:-48] - turned[72], abs=2e-3)


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
    ahead = np.interp(segment.steps_s + 0.7, segment.steps_s, segment.grids["wheel"])
    assert measure_wheel_lag([replace(segment, grids=segment.grids | {"wheel": ahead})]) < -0.05
    assert measure_wheel_lag([replace(segment, command=None)]) == np.inf
