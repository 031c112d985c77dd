"""Headings of which only the antenna's path is known: circles in closed form, and any path of a rear axle."""

import math

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.analytic_drives import SPEED_MPS, backwards, circle, log
from vehicle.identification.replay.drive_segments import build_dataset, compute_course_offset

TIME = np.arange(0.0, 30.0, 0.1)


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
