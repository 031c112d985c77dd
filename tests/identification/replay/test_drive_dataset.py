"""Logs on the simulation's grid: lines by hand."""

import math

import numpy as np
import pytest

from tests.identification.analytic_drives import SPEED_MPS, backwards, circle, log
from tests.identification.log_tables import refusal
from vehicle.identification.replay.drive_segments import build_dataset, find_compared_rows
from vehicle.records import DT_S


def test_columns_are_in_si_from_the_origin_of_the_set() -> None:
    frame = circle(0.0, bearing_deg=90.0)
    course = build_dataset([log(frame, speed_command_mps=1.6, implement=1)])
    (one,) = course.segments
    # Driven east from (500, 700): the median of 0 to 29.85 m is 14.925, the origin the nearest whole metre.
    assert course.origin == (515.0, 700.0) and course.rows == course.rows_read == 200
    assert one.east == pytest.approx(SPEED_MPS * frame.time_s - 15.0, abs=1e-9) and np.abs(one.north).max() < 1e-9
    assert one.heading == pytest.approx(np.zeros(200), abs=1e-9), "a heading of 90 degrees is east, 0 of the circle"
    assert one.heading_measured and one.speed_measured and (one.speed == SPEED_MPS).all() and (one.working == 1.0).all()
    assert one.command is None and one.target is not None and (one.target == 1.6).all()
    assert course.seconds == pytest.approx(19.9) and course.has_speed


def test_measurements_are_read_along_lines_and_commands_from_halfway_on() -> None:
    steps = np.where(np.arange(60) < 30, 4.0, -8.0)
    (one,) = build_dataset([log(circle(0.0, seconds=6.0), steering_deg=steps, steering_command_deg=steps)]).segments
    grid = DT_S * np.arange(len(one.grids["wheel"]))
    assert len(grid) == math.ceil(5.9 * 60.0) + 1
    assert np.degrees(one.grids["wheel"]) == pytest.approx(np.interp(grid, [2.9, 3.0], [4.0, -8.0]))
    apart = np.abs(grid - 2.95) > 1e-6  # at halfway itself, rounding decides
    assert np.degrees(one.grids["command"])[apart] == pytest.approx(np.where(grid < 2.95, 4.0, -8.0)[apart])


def test_headings_go_on_past_north() -> None:
    (one,) = build_dataset([log(circle(0.2, seconds=60.0))]).segments
    turned = 0.2 * SPEED_MPS * 59.9
    assert one.heading[-1] - one.heading[0] == pytest.approx(-turned), "clockwise is negative"
    assert np.abs(np.diff(one.heading)).max() < 0.1


def test_what_was_not_logged_is_told_from_the_positions() -> None:
    frame = circle(0.05).drop(columns=["heading_deg", "speed_mps"])
    (one,) = build_dataset([log(frame)]).segments
    assert not one.heading_measured and not one.speed_measured
    inner = slice(5, -5)
    # Over a chord of 0.6 s a circle of 20 m is short of its arc by a 12,000th, and its course is the tangent.
    assert one.speed[inner] == pytest.approx(np.full(190, SPEED_MPS), rel=1e-3)
    assert one.heading[inner] == pytest.approx(0.5 * math.pi - 0.05 * SPEED_MPS * one.time[inner], abs=1e-3)


def test_time_starts_with_the_run_and_a_later_segment_knows_its_start() -> None:
    gear = np.ones(200)
    gear[80:90] = 0.0
    one, two = build_dataset([log(circle(0.0), shuttle=gear)]).segments
    assert (one.start_s, two.start_s) == pytest.approx((0.0, 9.0)) and two.time[0] == 0.0 and one.run == two.run == 0


def test_in_reverse_speeds_are_negative_and_headings_point_away_from_the_way() -> None:
    frame = backwards(circle(0.05))
    (told,) = build_dataset([log(frame, speed_command_mps=1.6)]).segments
    assert told.gear == -1.0 and (told.speed == -SPEED_MPS).all() and (told.speed_in_gear == SPEED_MPS).all()
    assert told.target is not None and (told.target == -1.6).all() and (told.grids["target"] == -1.6).all()
    assert (told.grids["speed"] == -SPEED_MPS).all()
    (one,) = build_dataset([log(frame.drop(columns=["heading_deg", "speed_mps"]))]).segments
    inner = slice(5, -5)
    assert one.speed[inner] == pytest.approx(np.full(190, -SPEED_MPS), rel=1e-3)
    off = np.angle(np.exp(1j * (one.heading - told.heading)))[inner]
    assert np.abs(off).max() < 1e-3 and np.abs(np.diff(one.heading)).max() < 0.1


def test_runs_are_numbered_and_named_and_nothing_long_is_refused() -> None:
    course = build_dataset([log(circle(0.0), "a"), log(circle(0.0, seconds=3.0), "b"), log(circle(0.1), "c")])
    assert course.names == ("a", "b", "c") and [one.run for one in course.segments] == [0, 2]
    message = refusal(lambda: build_dataset([log(circle(0.0, seconds=3.0), "b")]))
    assert "in b the longest lasts 2.9 s" in message


def test_wheel_angles_between_two_commands_that_differ_say_what_the_last_of_them_says() -> None:
    """Commands read in rows 0, 4, 8 and 12: they stand still up to row 4, and differ afterwards."""
    command = np.array([3.0] * 5 + [4.0, 5.0, 6.0, 7.0] + [8.0] * 4)
    commanded = np.isin(np.arange(13), (0, 4, 8, 12))
    for angle, expected in (
        (range(13), [0, 1, 2, 3, 4, 8, 12]),
        ((1, 3, 5, 7, 9), [1, 3, 7, 9]),
        ((0, 4, 8), [0, 4, 8]),
    ):
        assert (
            np.flatnonzero(find_compared_rows(np.isin(np.arange(13), angle), commanded, command)).tolist() == expected
        )
    every = np.ones(13, dtype=np.bool_)
    assert find_compared_rows(every, every, command).all()
