"""Replayed states and what instruments show of them, for motions that can be written down."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tests.identification.analytic_drives import SPEED_MPS, backwards, circle, course, log, rig
from vehicle.errors import VehicleError
from vehicle.identification.diagnosis.next_drive import build_command_segment
from vehicle.identification.replay.drive_segments import (
    DriveSegment,
    build_dataset,
    build_rig,
    build_rig_and_corrections,
)
from vehicle.identification.replay.simulation import (
    ANGLE_COLUMN,
    FORWARD_COLUMN,
    STEERING_COLUMN,
    X_COLUMN,
    Y_COLUMN,
    make_settled_state,
    replay_segment,
    simulate_logged_values,
)
from vehicle.model.tractor import EffectSetting, load_tractor
from vehicle.records import DT_S

EG105 = load_tractor("eg105")
LEVER = EG105.antenna_forward_m - EG105.rear_axle_m
OFFSET, BIAS = {"steering_offset": {"angle_deg": 1.0}}, {"heading_bias": {"angle_deg": 2.0}}
LATE = {"steering_dead_time": {"time_s": 0.3}}


def straight(seconds: float = 10.0) -> DriveSegment:
    """Due east with the wheels straight."""
    return course(circle(0.0, seconds, bearing_deg=90.0)).segments[0]


def test_measured_speed_and_straight_wheels_give_a_straight_line() -> None:
    one = straight()
    states = replay_segment(rig(), one, {}, from_sensor=True, from_speed=True)
    grid = DT_S * np.arange(len(states))
    assert states[:, X_COLUMN] - states[0, X_COLUMN] == pytest.approx(SPEED_MPS * grid, abs=1e-9)
    assert np.abs(states[:, [ANGLE_COLUMN, STEERING_COLUMN]]).max() < 1e-9 and np.ptp(states[:, Y_COLUMN]) < 1e-9
    assert (states[:, FORWARD_COLUMN] == SPEED_MPS).all()


def test_a_measured_wheel_angle_gives_the_measured_radius() -> None:
    radius = EG105.get_power_law("soil").compute_radius_m(12.0)
    frame = circle(1.0 / radius, 30.0).assign(steering_deg=12.0)
    one = course(frame).segments[0]
    states = replay_segment(rig(), one, {}, from_sensor=True, from_speed=True)
    antenna = simulate_logged_values(rig(), one, states, {})[0][100:]
    way = float(np.hypot(*np.diff(antenna, axis=0).T).sum())
    turned = abs(
        float(np.interp(one.time[-1], DT_S * np.arange(len(states)), states[:, ANGLE_COLUMN]))
        - float(np.interp(one.time[100], DT_S * np.arange(len(states)), states[:, ANGLE_COLUMN]))
    )
    assert way / turned == pytest.approx(radius, rel=0.01)


@pytest.mark.parametrize("angle_deg", [12.0, -12.0])
def test_in_reverse_a_wheel_angle_gives_its_radius_and_turns_the_other_way(angle_deg: float) -> None:
    side = math.copysign(1.0, angle_deg)
    radius = EG105.get_power_law("soil").compute_radius_m(angle_deg)
    frame = circle(side / radius, 30.0).assign(steering_deg=angle_deg)
    turned = []
    for drive in (frame, backwards(frame)):
        one = course(drive).segments[0]
        states = replay_segment(rig(), one, {}, from_sensor=True, from_speed=True)
        turned.append(states[-1, ANGLE_COLUMN] - states[600, ANGLE_COLUMN])
        assert (states[:, FORWARD_COLUMN] == one.speed[0]).all()
    assert side * turned[0] < 0.0 < side * turned[1]
    assert turned[1] == pytest.approx(-turned[0], rel=0.01)


@pytest.mark.parametrize("pace", [0.8, 2.2])
@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_a_measured_speed_bends_the_path_as_the_same_speed_commanded(pace: float, gear: float) -> None:
    """The engine holds a measured speed against the ground: it is not rolled out, and no tyre is braked by it."""
    drive = build_command_segment(0, 0.0, ((20.0, 12.0, gear, 0.0),), pace)
    turned = []
    for from_speed in (True, False):
        states = replay_segment(rig(), drive, {}, from_sensor=False, from_speed=from_speed)
        way = float(np.sum(states[600:-1, FORWARD_COLUMN])) * DT_S
        turned.append((states[-1, ANGLE_COLUMN] - states[600, ANGLE_COLUMN]) / way)
    assert turned[0] == pytest.approx(turned[1], rel=1e-3)


def test_in_reverse_commands_reach_their_speed_and_a_slope_still_pulls_downhill() -> None:
    drive = build_command_segment(0, 0.0, ((12.0, 0.0, -1.0, 0.0),), SPEED_MPS)
    slope = {"cross_slope_drift": {"ratio": 0.1, "bearing_deg": 180.0}}
    states = replay_segment(rig(), drive, slope, from_sensor=False, from_speed=False)
    assert states[-1, FORWARD_COLUMN] == pytest.approx(-SPEED_MPS, abs=0.02)
    way = states[-1, X_COLUMN] - states[0, X_COLUMN]
    assert way < -10.0 and states[-1, Y_COLUMN] - states[0, Y_COLUMN] == pytest.approx(-0.1 * abs(way), rel=0.02)


@pytest.mark.parametrize(
    ("settings", "ahead", "aside", "bias_deg"),
    [
        ({}, 0.0, 0.0, 0.0),
        ({"antenna_forward": {"distance_m": 0.4}}, 0.4, 0.0, 0.0),
        ({"antenna_right": {"distance_m": 0.2}}, 0.0, -0.2, 0.0),
        ({"gnss_latency": {"time_s": 0.3}}, -0.3 * SPEED_MPS, 0.0, 0.0),
        ({"heading_bias": {"angle_deg": 5.0}}, 0.0, 0.0, -5.0),
    ],
)
def test_instruments_on_a_straight_line_by_hand(settings: Any, ahead: float, aside: float, bias_deg: float) -> None:
    """Heading east: ahead is east, to the right is south; a clockwise bias is a negative mathematical angle."""
    one = straight()
    states = replay_segment(rig(), one, {}, from_sensor=True, from_speed=True)
    antenna, heading, wheel, speed = simulate_logged_values(rig(), one, states, settings)
    rows = one.time > 0.5
    assert antenna[rows, 0] - states[0, X_COLUMN] == pytest.approx(SPEED_MPS * one.time[rows] + LEVER + ahead, abs=1e-9)
    assert antenna[rows, 1] - states[0, Y_COLUMN] == pytest.approx(np.full(rows.sum(), aside), abs=1e-9)
    assert np.degrees(heading) == pytest.approx(np.full(one.rows, bias_deg), abs=1e-9)
    assert np.abs(wheel).max() < 1e-9 and speed == pytest.approx(np.full(one.rows, SPEED_MPS))


def test_a_rig_is_bare_and_its_own_settings_are_those_of_the_file() -> None:
    taught = EG105.model_copy(update={"effects": {"wheel_slip": EffectSetting(value={"ratio": 0.1})}})
    own, settings = build_rig_and_corrections(taught, "soil", (3.0, 4.0))
    assert settings == {"wheel_slip": {"ratio": 0.1}} and own.tractor == EG105 and own.origin == (3.0, 4.0)
    assert own.model == build_rig(EG105, "soil", (3.0, 4.0)).model
    assert own.build_effective_model(settings)[0]["slip"] == pytest.approx(0.1)
    with pytest.raises(VehicleError, match="moon"):
        build_rig(EG105, "moon", (0.0, 0.0))


def test_places_in_the_field_are_moved_to_the_origin_of_the_course() -> None:
    patch = {"grip_patch": {"ratio": 0.5, "east_m": 10.0, "north_m": 20.0, "radius_m": 5.0}}
    model = build_rig(EG105, "soil", (4.0, 15.0)).build_effective_model(patch)
    assert (model[0]["patch_east"], model[0]["patch_north"]) == (6.0, 5.0)


def test_commands_drive_where_sensors_are_left_out() -> None:
    """A commanded speed is reached with the acceleration of the file, a wheel angle at the rate of Eq. 2.8."""
    drive = build_command_segment(0, 0.0, ((2.0, 0.0, 1.0, 0.0), (10.0, 20.0, 1.0, 0.0)), SPEED_MPS)
    states = replay_segment(rig(), drive, {}, from_sensor=False, from_speed=False)
    assert states[-1, FORWARD_COLUMN] == pytest.approx(SPEED_MPS, abs=0.02)
    moving = math.degrees(states[150, STEERING_COLUMN])
    assert moving == pytest.approx(EG105.steering.rate_deg_per_s * (150 - 120) * DT_S, abs=0.3)
    assert math.degrees(states[-1, STEERING_COLUMN]) == pytest.approx(20.0, abs=0.11)


def test_a_measured_wheel_angle_without_a_command_is_not_delayed_again() -> None:
    """The wheels were where they were measured: a slow steering and a dead time of a second change nothing."""
    frame = circle(0.08, 20.0)
    frame.loc[: len(frame) // 2, "steering_deg"] = 0.0
    (segment,) = build_dataset([log(frame)]).segments
    slow = {"steering_lag": {"time_s": 2.0}, "steering_dead_time": {"time_s": 1.0}}
    sensed, bare, late = (
        replay_segment(rig(), segment, settings, from_sensor, from_speed=True)
        for settings, from_sensor in (({}, True), ({}, False), (slow, False))
    )
    assert np.array_equal(sensed, bare) and np.array_equal(sensed, late)
    assert math.degrees(sensed[-1, STEERING_COLUMN]) == pytest.approx(8.0)


def test_a_delayed_steering_follows_the_commands_of_the_segment_before() -> None:
    """The command steps 0.2 s before a change of gear: wheels late by 0.6 s stand for the first 0.4 s after it."""
    frame = circle(0.0, 20.0)
    time = frame.time_s.to_numpy()
    commands = np.where(time < 8.05, 0.0, 10.0)
    steered = log(
        frame, steering_deg=0.0 * time, steering_command_deg=commands, shuttle=np.where(time < 8.25, 1.0, -1.0)
    )
    (_, second) = build_dataset([steered]).segments
    assert np.degrees(second.earlier_commands[[0, -1]]) == pytest.approx([0.0, 10.0])
    late = {"steering_dead_time": {"time_s": 0.6}}
    angles = replay_segment(rig(), second, late, False, True)[:, STEERING_COLUMN]
    begun_s = DT_S * int(np.argmax(np.abs(angles) > 1e-6))
    assert begun_s == pytest.approx(0.4, abs=0.06)
    without = replace(second, earlier_commands=np.empty(0))
    early = replay_segment(rig(), without, late, False, True)[:, STEERING_COLUMN]
    assert DT_S * int(np.argmax(np.abs(early) > 1e-6)) < 0.1


def test_a_settled_state_reaches_back_as_far_as_delays_do() -> None:
    earlier = np.arange(120.0)
    state = make_settled_state(np.array([7.0, 8.0]), earlier)[0]
    reached = int(state["clock"])
    assert reached == len(state["commands"]) - 2
    assert state["commands"][:reached].tolist() == earlier[-reached:].tolist() and state["commands"][-1] == 7.0
    assert make_settled_state(np.array([7.0]), np.empty(0))[0]["clock"] == 0


@pytest.mark.parametrize(("moved_deg", "expected_deg"), [(0.0, 3.0), (4.0, None)])
def test_wheels_that_stand_where_a_log_begins_had_reached_their_command(
    moved_deg: float, expected_deg: float | None
) -> None:
    """Of wheels that move nothing is known: they follow a command given before."""
    frame = circle(0.0, 20.0)
    wheel = 3.0 + np.minimum(frame.time_s.to_numpy() / 0.2, 1.0) * moved_deg
    (one,) = build_dataset([log(frame, steering_deg=wheel, steering_command_deg=9.0 + 0.0 * wheel)]).segments
    assert np.degrees(one.earlier_commands).tolist() == ([] if expected_deg is None else pytest.approx([3.0] * 96))


def test_at_the_measured_speed_it_is_driven_until_there_is_no_number() -> None:
    (one,) = course(circle(0.05, 20.0)).segments
    speed = np.where(np.arange(len(one.grids["speed"])) < 40, one.grids["speed"], np.nan)
    states = replay_segment(rig(), replace(one, grids=one.grids | {"speed": speed}), {}, True, True)
    assert np.array_equal(states[:, FORWARD_COLUMN], speed, equal_nan=True)
    assert np.isfinite(states[:40]).all() and np.isnan(states[-1, X_COLUMN])
    short = replace(one, grids={name: values[:1] for name, values in one.grids.items()})
    assert replay_segment(rig(), short, {}, True, True)[0, X_COLUMN] == one.grids["east"][0]


def test_a_sensor_cuts_off_what_lies_before_it() -> None:
    one = course(circle(0.05, 20.0).assign(steering_deg=8.0)).segments[0]
    plain, late, bare = (
        replay_segment(rig(), one, settings, from_sensor=True, from_speed=True)
        for settings in (OFFSET, {**OFFSET, **BIAS, **LATE}, {})
    )
    assert np.array_equal(late, plain) and not np.array_equal(bare, plain)
