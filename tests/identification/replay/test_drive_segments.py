"""Logs on the simulation's grid: lines by hand."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.analytic_drives import SPEED_MPS, backwards, circle, log
from tests.identification.log_tables import refusal
from tests.truth import rolling
from tests.truth.drives import three_speeds_programme
from tests.truth.second import Receiver, Second
from vehicle.identification.logs.series import denoise_angles, estimate_angle_noise
from vehicle.identification.replay.drive_segments import build_dataset, compute_course_offset, find_compared_rows
from vehicle.records import DT_S

NOISY_TIME = np.arange(0.0, 60.0, 0.1)
TIME = np.arange(0.0, 30.0, 0.1)


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


# --- A measured signal loses the noise of its sensor and keeps its steps, its bends and the play that it opens ---


def noise(size: float, seed: int = 1) -> np.ndarray:
    return size * np.random.default_rng(seed).standard_normal(len(NOISY_TIME))


def played(angles: np.ndarray, half: float) -> np.ndarray:
    """The wheels behind a play that opens half a width to both sides of the angles."""
    out, wheels = np.empty(len(angles)), angles[0]
    for row, angle in enumerate(angles):
        wheels = out[row] = min(max(wheels, angle - half), angle + half)
    return out


def width_told(angles: np.ndarray, wheels: np.ndarray) -> float:
    """Width of the play of the angles that comes nearest to the wheels."""
    widths = np.linspace(0.8, 3.2, 121)
    return float(widths[np.argmin([np.sum((played(angles, 0.5 * one) - wheels) ** 2) for one in widths])])


def test_a_clean_signal_stays_as_it_is() -> None:
    for clean in (np.full(len(NOISY_TIME), 0.3), np.floor(NOISY_TIME / 5.0), NOISY_TIME * 1e-8):
        assert denoise_angles(NOISY_TIME, clean) == pytest.approx(clean, abs=1e-6)
    assert list(denoise_angles(NOISY_TIME[:2], np.array([1.0, 2.0]))) == [1.0, 2.0]


def test_noise_goes_where_the_signal_rests_and_steps_stay_sharp() -> None:
    steps = np.floor(NOISY_TIME / 5.0) % 3
    out = denoise_angles(NOISY_TIME, steps + noise(0.05))
    off = np.abs(out - steps)
    assert np.sqrt(np.mean(off**2)) < 0.3 * 0.05
    assert off.max() < 0.15, "a step is smeared over no row"


def test_nothing_comes_late() -> None:
    ramp = 0.02 * NOISY_TIME
    out = denoise_angles(NOISY_TIME, ramp + noise(0.05))
    assert abs(float(np.mean((out - ramp)[50:-50]))) < 0.005
    assert denoise_angles(NOISY_TIME, (ramp + noise(0.05))[::-1])[::-1] == pytest.approx(out)


def test_the_noise_is_told_of_slow_signals_and_of_last_digits() -> None:
    assert estimate_angle_noise(5.0 * np.sin(NOISY_TIME / 3.0) + noise(0.1)) == pytest.approx(0.1, rel=0.1)
    assert estimate_angle_noise(0.001 * np.round(np.sin(NOISY_TIME / 3.0) + noise(0.2))) == pytest.approx(
        0.001 / np.sqrt(12.0)
    )
    assert estimate_angle_noise(np.zeros(9)) == estimate_angle_noise(np.zeros(2)) == 0.0


@pytest.mark.parametrize("size", [0.0, 0.05, 0.2, 0.4])
@pytest.mark.parametrize("name", ["right", "steps", "waves"])
def test_play_reads_alike_at_every_noise_of_the_sensor(name: str, size: float) -> None:
    """Driven by the rows as they are, a play of 1.5 degrees would read as 2.3 at a noise of 0.2."""
    index, drive = next((at, one) for at, one in enumerate(three_speeds_programme()) if one.name == name)
    second = Second({}, 501, receiver=Receiver(wheel_deg=size))
    rolled, log = second.roll(drive, index), second.log(drive, index)
    time = log.time_s.to_numpy() - 100.0
    wheels = played(np.interp(time, rolled.time_s, rolled.column(rolling.WHEEL)), 0.75)
    angles = log.steering_deg.to_numpy()
    steady = np.degrees(denoise_angles(time, np.radians(angles)))
    assert width_told(steady, wheels) == pytest.approx(1.5, abs=0.02 + 0.4 * size)
    if size >= 0.2:
        assert width_told(angles, wheels) > 1.5 + 2.0 * size


# --- Headings of which only the antenna's path is known: circles in closed form, and any path of a rear axle ---


@pytest.mark.parametrize("ahead", [1.1, 0.3, -0.8])
@pytest.mark.parametrize("gear", [1.0, -1.0])
def test_on_a_circle_the_angle_is_that_of_the_antenna_beside_the_axle(ahead: float, gear: float) -> None:
    radius, pace = 6.0, 1.5
    outer = math.hypot(radius, ahead)
    course = gear * pace / outer * TIME
    off = compute_course_offset(TIME, course, np.full(len(TIME), pace), gear * ahead)
    assert off == pytest.approx(np.full(len(TIME), math.atan(ahead / radius)), abs=2e-3)


def test_without_a_lever_and_straight_on_there_is_none() -> None:
    pace = np.full(len(TIME), 2.0)
    assert not compute_course_offset(TIME, 0.3 * TIME, pace, 0.0).any()
    assert compute_course_offset(TIME, np.full(len(TIME), 0.7), pace, 1.1) == pytest.approx(
        np.zeros(len(TIME)), abs=1e-12
    )
    assert not compute_course_offset(TIME[:1], TIME[:1], TIME[:1], 1.1).any()


@given(
    bends=st.lists(st.floats(-0.2, 0.2), min_size=4, max_size=8),
    ahead=st.floats(0.2, 2.5), sign=st.sampled_from((1, -1)),
)  # fmt: skip
def test_a_rear_axle_is_found_again_from_the_path_of_its_antenna(bends: list[float], ahead: float, sign: int) -> None:
    ahead *= sign
    time = np.arange(0.0, 40.0, 0.05)
    speed, bend = 1.4, np.interp(time, np.linspace(0.0, 40.0, len(bends)), bends)
    heading = np.concatenate([[0.0], np.cumsum(0.5 * (bend[1:] + bend[:-1]) * speed * 0.05)])
    # Forward speed v and v times bend to the left are what the antenna moves by, in the tractor's frame.
    off = np.arctan(ahead * bend)
    found = compute_course_offset(time, heading + off, np.hypot(speed, speed * ahead * bend), ahead)
    inner = slice(250, -250)  # where it begins the bend is taken for that of a circle
    assert found[inner] == pytest.approx(off[inner], abs=5e-3)


@pytest.mark.parametrize("ahead", [1.1, -0.6])
def test_heading_and_speed_of_a_course_are_those_of_the_axle(ahead: float) -> None:
    for frame, gear in ((circle(0.15), 1.0), (backwards(circle(0.15)), -1.0)):
        east = frame.easting_m + ahead * np.sin(np.radians(frame.heading_deg))
        north = frame.northing_m + ahead * np.cos(np.radians(frame.heading_deg))
        seen = log(frame.assign(easting_m=east, northing_m=north).drop(columns=["heading_deg", "speed_mps"]))
        (told,) = build_dataset([seen], (ahead, 0.0)).segments
        (true,) = build_dataset([log(frame)]).segments
        inner = slice(20, -20)
        off = np.angle(np.exp(1j * (told.heading - true.heading)))[inner]
        assert np.abs(off).max() < 0.01, "without the lever it is 0.09 to 0.16"
        assert told.speed[inner] == pytest.approx(np.full(len(off), gear * SPEED_MPS), rel=2e-3)


def test_a_tractor_that_stands_for_most_of_the_time_points_where_it_drives_off_to() -> None:
    frame, standing = circle(0.15), 900
    first = frame.iloc[[0] * standing].assign(time_s=0.1 * np.arange(standing))
    drive = pd.concat([first, frame.assign(time_s=frame.time_s + 0.1 * standing)], ignore_index=True)
    noise = np.random.default_rng(4).normal(0.0, 0.02, (2, len(drive)))
    seen = drive.assign(easting_m=drive.easting_m + noise[0], northing_m=drive.northing_m + noise[1])
    (told,) = build_dataset([log(seen.drop(columns=["heading_deg", "speed_mps"]))]).segments
    assert np.ptp(told.heading[: standing - 10]) < 0.2, "noise has no direction"
    off = np.angle(np.exp(1j * (told.heading + np.radians(drive.heading_deg.to_numpy()) - 0.5 * math.pi)))
    assert np.abs(off[standing + 20 :]).max() < 0.15


def test_an_antenna_beside_the_line_is_slower_on_the_inside() -> None:
    aside = 0.5
    frame = circle(0.1)
    heading = np.radians(frame.heading_deg)
    east, north = frame.easting_m + aside * np.cos(heading), frame.northing_m - aside * np.sin(heading)
    seen = log(frame.assign(easting_m=east, northing_m=north).drop(columns="speed_mps"))
    (told,) = build_dataset([seen], (0.0, aside)).segments
    assert told.speed[10:-10] == pytest.approx(np.full(len(frame) - 20, SPEED_MPS), rel=2e-3)
