"""A wheel angle that is off by a fixed function of the angle is no fault that begins; one that is off once is."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest

from tests.truth.drives import stairs
from vehicle.identification.faults.angle_deviation import AngleDeviations
from vehicle.identification.faults.steering_evidence import build_evidence_segments, find_largest_angles, follow_command
from vehicle.identification.faults.steering_faults import mark_steering_faults
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Array, Log

BASE_M, TRACK_M, SPEED_MPS, STEP_S = 2.6, 1.9, 1.2, 0.1
COMMANDS = [(12.0, 0.0), (12.0, 26.0), (12.0, -30.0), (12.0, 15.0), (12.0, -15.0), (12.0, 0.0)]


def read_left_knuckle(angle_deg: Array) -> Array:
    """The angle (deg) of the left front wheel where that of the axle is this (Ackermann), positive to the right."""
    bend = np.tan(np.radians(angle_deg)) / BASE_M
    return np.degrees(np.arctan(BASE_M * bend / (1.0 + 0.5 * TRACK_M * bend)))


def drive(name: str, sensed: bool, broken_from_s: float = math.inf, until_s: float = math.inf) -> Log:
    """A run with a sensor of the left wheel or of the axle; from a moment on the axle goes 9 deg too far."""
    time = np.arange(0.0, 72.0, STEP_S)
    command = np.array([stairs(*COMMANDS)(second) for second in time])
    wheel = follow_command(command, 0.1, 16.0, 0.15)
    wheel[(time >= broken_from_s) & (time < until_s)] -= 9.0
    heading = np.cumsum(np.tan(np.radians(wheel)) / BASE_M) * SPEED_MPS * STEP_S
    east, north = (np.cumsum(axis(heading)) * SPEED_MPS * STEP_S for axis in (np.sin, np.cos))
    read_deg = read_left_knuckle(wheel) if sensed else wheel
    places = {"easting_m": east, "northing_m": north, "heading_deg": np.degrees(heading) % 360.0}
    columns = {"time_s": time, **places, "steering_deg": read_deg, "steering_command_deg": command}
    return build_log(pd.DataFrame(columns), name, check=False)


def list_faults(logs: list[Log]) -> list[tuple[str, str]]:
    return [(fault.id, fault.run) for log in mark_steering_faults(logs) for fault in log.faults]


def test_a_sensor_on_one_knuckle_is_no_fault() -> None:
    assert np.min(read_left_knuckle(np.array([-30.0]))) < -36.0
    assert list_faults([drive(name, True) for name in ("one", "two", "three")]) == []


@pytest.mark.parametrize("sensed", [False, True])
def test_wheels_that_leave_their_command_in_one_run_are_a_fault_at_an_angle_held_in_others(sensed: bool) -> None:
    logs = [drive("one", sensed), drive("two", sensed), drive("three", sensed, 38.0, 58.0)]
    assert [run for _, run in list_faults(logs)] == ["three"]


def test_what_is_usual_elsewhere_needs_time_and_one_value() -> None:
    def compute_usual(logs: list[Log]) -> float:
        parts = [part for log in logs for part in build_evidence_segments(log, find_largest_angles(logs))]
        return float(AngleDeviations(parts).compute_elsewhere(parts[0], 300, 350)[25])

    assert compute_usual([drive("one", True), drive("two", True)]) == pytest.approx(-6.4, abs=0.3)
    assert compute_usual([drive("one", True)]) == 0.0  # held once
    unlike = [drive("one", True), drive("two", True), drive("three", False)]
    assert compute_usual(unlike) == 0.0
