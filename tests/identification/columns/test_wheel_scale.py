"""A wheel sensor of the wrong scale is found where commands and path agree against it."""

import math

import numpy as np
import pytest

from tests.diagnosis.hiding import brief_programme, eg105
from tests.identification.analytic_drives import SPEED_MPS, circle, joined, log
from tests.truth.second import second_logs
from vehicle.identification.columns.wheel_scale import (
    correct_wheel_scale,
    find_sensor_limit,
    leave_out_saturated_angles,
    measure_wheel_scale,
)
from vehicle.identification.diagnosis.log_notes import describe_columns
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log

PROGRAMME = brief_programme("circles_right")


def logs_of(scale: float = 1.0, **effects: dict[str, float]) -> list[Log]:
    frames = second_logs(effects, 6, PROGRAMME)
    return [build_log(frame.assign(steering_deg=scale * frame.steering_deg), frame.attrs["name"]) for frame in frames]


@pytest.mark.parametrize("scale", [0.9, 1.08])
def test_a_scale_of_the_sensor_is_taken_out_and_told(scale: float) -> None:
    logs = correct_wheel_scale(logs_of(scale), eg105(), "soil")
    assert measure_wheel_scale(logs) is None
    assert all(log.steering_factor == pytest.approx(scale, abs=0.01) for log in logs)
    told = {column.column: column.scale for column in describe_columns(logs, ())}
    assert told == {"steering": logs[0].steering_factor}
    assert all("a scale error of the wheel sensor" in log.corrections[-1] for log in logs)


def test_gain_of_the_path_and_honest_sensors_are_left_alone() -> None:
    for logs in (logs_of(), logs_of(steering_gain={"ratio": 0.9})):
        assert correct_wheel_scale(logs, eg105(), "soil") == logs


def test_wheels_that_fall_short_of_the_command_are_no_scale_of_the_sensor() -> None:
    """Path and sensor agree with each other: the command is what is not reached."""
    frames = second_logs({}, 6, PROGRAMME)
    short = [
        build_log(frame.assign(steering_command_deg=frame.steering_command_deg / 0.9), frame.attrs["name"])
        for frame in frames
    ]
    assert measure_wheel_scale(short) == pytest.approx(0.9, abs=0.02)
    assert correct_wheel_scale(short, eg105(), "soil") == short


BENDS_DEG = (4.0, -8.0, 12.0, -16.0, 22.0, -27.0, 0.0, 24.0)
LIMIT_DEG = 15.0


def drive_bends(driven_most_deg: float, shown_most_deg: float, seconds: float = 12.0) -> Log:
    """Circles, each commanded as BENDS_DEG: driven up to one angle, and read up to another one."""
    driven = [max(min(angle, driven_most_deg), -driven_most_deg) for angle in BENDS_DEG]
    parts, bearing_deg = [], 0.0
    for angle in driven:
        curvature = math.tan(math.radians(angle)) / 2.5
        parts.append(circle(curvature, seconds, bearing_deg=bearing_deg))
        bearing_deg += math.degrees(curvature * SPEED_MPS * seconds)
    frame = joined(*parts)
    command = np.repeat(BENDS_DEG, len(frame) // len(BENDS_DEG))
    wheel = np.clip(np.repeat(driven, len(frame) // len(BENDS_DEG)), -shown_most_deg, shown_most_deg)
    noise = 0.08 * np.random.default_rng(1).standard_normal(len(frame))
    return log(frame.drop(columns="heading_deg"), steering_command_deg=command, steering_deg=wheel + noise)


def test_a_sensor_that_shows_no_more_than_a_limit_is_left_out_and_has_no_scale() -> None:
    (left_out,) = leave_out_saturated_angles([drive_bends(90.0, LIMIT_DEG)])
    assert left_out.steering_deg is None and "no more than 15.0 degrees" in left_out.corrections[-1]
    told = {column.column: column.scale for column in describe_columns([left_out], ())}
    assert told == {"steering": None}


def test_few_rows_at_the_limit_are_left_out_alone() -> None:
    """The sensor is of use in all the other rows, those of a long easy drive."""
    angle_deg = math.degrees(math.atan(2.5 * 0.03))
    parts = [circle(side * 0.03, 750.0).assign(steering_deg=side * angle_deg) for side in (1.0, -1.0)]
    easy = joined(*parts).drop(columns="heading_deg")
    easy["steering_command_deg"] = easy["steering_deg"]
    short, long = leave_out_saturated_angles([drive_bends(90.0, LIMIT_DEG), log(easy)])
    assert short.steering_deg is not None and long.steering_deg is not None and long.gated == ()
    assert short.gated[-1].rule.endswith("saturated sensor") and 400 < short.gated[-1].rows < 500
    assert np.abs(short.steering_deg[short.used]).max() < LIMIT_DEG - 0.4


@pytest.mark.parametrize(("driven_deg", "shown_deg"), [(LIMIT_DEG, 90.0), (90.0, 90.0)])
def test_wheels_at_their_lock_and_honest_sensors_are_not_saturated(driven_deg: float, shown_deg: float) -> None:
    """At the lock the path bends as the wheels show."""
    assert find_sensor_limit([drive_bends(driven_deg, shown_deg)]) is None


@pytest.mark.parametrize(("half_play_deg", "scale", "expected"), [(1.0, 1.0, None), (0.0, 0.94, 0.94)])
def test_play_of_the_sensor_is_no_scale(half_play_deg: float, scale: float, expected: float | None) -> None:
    angles = np.array([0.0, 25.0, 0.0, -25.0, 0.0, 6.0, 0.0, -6.0, 0.0, 15.0, 0.0, -15.0] * 3)
    command = np.repeat(angles, 60)
    wheel, last = np.zeros(len(command)), 0.0
    for row, angle in enumerate(command.tolist()):
        last = min(max(last, angle - half_play_deg), angle + half_play_deg)
        wheel[row] = last
    frame = circle(0.0, len(command) / 10.0)
    one = log(frame, steering_command_deg=command, steering_deg=scale * wheel)
    assert measure_wheel_scale([one]) == (expected if expected is None else pytest.approx(expected, abs=0.005))
