"""What is kept of replays: the least recently asked for goes, and only what acts on a replay makes another one."""

import numpy as np
import pytest

from tests.measured.drawn import circle, course, rig
from vehicle.effects import PATH, SPEED
from vehicle.measured.replay.keeping import Kept, key_of, of_blocks
from vehicle.measured.replay.replaying import replay, wheel_angles
from vehicle.measured.replay.states import STEERING

OFFSET, BIAS = {"steering_offset": {"angle_deg": 1.0}}, {"heading_bias": {"angle_deg": 2.0}}
LATE = {"steering_dead_time": {"time_s": 0.3}}


def test_the_least_recently_asked_for_goes_first() -> None:
    kept, made = Kept(3 * 80), []

    def ask(name: str) -> None:
        def make() -> tuple[np.ndarray]:
            made.append(name)
            return (np.zeros(10),)

        kept.get(name, make)

    for name in ("one", "two", "three", "one", "four", "one", "three", "two"):
        ask(name)
    assert made == ["one", "two", "three", "four", "two"]


def test_what_is_kept_cannot_be_written_to() -> None:
    one = Kept().get("one", lambda: (np.zeros(3),))[0]
    with pytest.raises(ValueError, match="read-only"):
        one[0] = 1.0


def test_settings_make_a_key_whatever_their_order() -> None:
    both = {**OFFSET, **BIAS, "rest": {"grip_by_speed": 0.1}}
    assert key_of(both) == key_of(dict(reversed(both.items()))) != key_of(OFFSET)
    assert of_blocks(both, frozenset({PATH})) == {**OFFSET, "rest": both["rest"]}
    assert of_blocks(both, frozenset({SPEED})) == {"rest": both["rest"]}


def test_a_sensor_cuts_off_what_lies_before_it() -> None:
    tractor, one = rig(), course(circle(0.05, 20.0).assign(steering_deg=8.0)).stretches[0]
    plain = replay(tractor, one, OFFSET, from_sensor=True, from_speed=True)
    assert replay(tractor, one, {**OFFSET, **BIAS, **LATE}, from_sensor=True, from_speed=True) is plain
    assert replay(tractor, one, {}, from_sensor=True, from_speed=True) is not plain
    assert replay(rig(), one, OFFSET, from_sensor=True, from_speed=True) is not plain


def test_wheel_angles_are_those_of_the_whole_replay() -> None:
    frame = circle(0.05, 20.0)
    frame["steering_command_deg"] = 10.0 * np.sign(np.sin(frame["time_s"]))
    one = course(frame).stretches[0]
    for settings in ({}, LATE, {"steering_rate": {"rate_deg_per_s": 5.0}, **OFFSET}):
        whole = replay(rig(), one, settings, from_sensor=False, from_speed=True)[:, STEERING]
        alone = wheel_angles(rig(), one, settings)
        assert np.array_equal(alone, whole) and np.ptp(alone) > 0.1
