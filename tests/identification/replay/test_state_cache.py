"""What is kept of replays: the least recently asked for goes, and only what acts on a replay makes another one."""

import numpy as np
import pytest

from tests.identification.analytic_drives import circle, course, rig
from vehicle.identification.replay.rig import (
    STEERING_COLUMN,
    ReplayCache,
    make_settings_key,
    replay_segment,
    simulate_wheel_angles,
    split_settings_by_block,
)
from vehicle.model.effects import PATH, SPEED

OFFSET, BIAS = {"steering_offset": {"angle_deg": 1.0}}, {"heading_bias": {"angle_deg": 2.0}}
LATE = {"steering_dead_time": {"time_s": 0.3}}


def test_the_least_recently_asked_for_goes_first() -> None:
    kept, made = ReplayCache(3 * 80), []

    def ask(name: str) -> None:
        def make() -> np.ndarray:
            made.append(name)
            return np.zeros(10)

        kept.get_or_make(name, make)

    for name in ("one", "two", "three", "one", "four", "one", "three", "two"):
        ask(name)
    assert made == ["one", "two", "three", "four", "two"]


def test_what_is_kept_cannot_be_written_to() -> None:
    one = ReplayCache().get_or_make("one", lambda: np.zeros(3))
    with pytest.raises(ValueError, match="read-only"):
        one[0] = 1.0


def test_settings_make_a_key_whatever_their_order() -> None:
    both = {**OFFSET, **BIAS, "discrepancy_model": {"grip_by_speed": 0.1}}
    assert make_settings_key(both) == make_settings_key(dict(reversed(both.items()))) != make_settings_key(OFFSET)
    assert split_settings_by_block(both, frozenset({PATH})) == {
        **OFFSET,
        "discrepancy_model": both["discrepancy_model"],
    }
    assert split_settings_by_block(both, frozenset({SPEED})) == {"discrepancy_model": both["discrepancy_model"]}


def test_a_sensor_cuts_off_what_lies_before_it() -> None:
    tractor, one = rig(), course(circle(0.05, 20.0).assign(steering_deg=8.0)).segments[0]
    plain = replay_segment(tractor, one, OFFSET, from_sensor=True, from_speed=True)
    assert replay_segment(tractor, one, {**OFFSET, **BIAS, **LATE}, from_sensor=True, from_speed=True) is plain
    assert replay_segment(tractor, one, {}, from_sensor=True, from_speed=True) is not plain
    assert replay_segment(rig(), one, OFFSET, from_sensor=True, from_speed=True) is not plain


def test_wheel_angles_are_those_of_the_whole_replay() -> None:
    frame = circle(0.05, 20.0)
    frame["steering_command_deg"] = 10.0 * np.sign(np.sin(frame["time_s"]))
    one = course(frame).segments[0]
    for settings in ({}, LATE, {"steering_rate": {"rate_deg_per_s": 5.0}, **OFFSET}):
        whole = replay_segment(rig(), one, settings, from_sensor=False, from_speed=True)[:, STEERING_COLUMN]
        alone = simulate_wheel_angles(rig(), one, settings)
        assert np.array_equal(alone, whole) and np.ptp(alone) > 0.1
