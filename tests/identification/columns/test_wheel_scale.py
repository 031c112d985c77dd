"""A wheel sensor of the wrong scale is found where commands and path agree against it."""

import pytest

from tests.diagnosis.hiding import brief_programme, eg105
from tests.truth.second import second_logs
from vehicle.identification.columns.wheel_scale import correct_wheel_scale, measure_wheel_scale
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.identification.verdict.log_findings import describe_columns

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
