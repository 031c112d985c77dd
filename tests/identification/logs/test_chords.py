"""What positions alone say of circles whose radius is known, and steering against bends."""

import math

import numpy as np
import pytest

from tests.identification.analytic_drives import SPEED_MPS, circle, joined, log
from tests.identification.log_tables import refusal
from vehicle.identification.logs.motion import (
    compute_bends,
    compute_path_chords,
    find_largest_steering,
    is_steering_mirrored,
    select_chord_steering,
    select_clear_bends,
)


@pytest.mark.parametrize("curvature", [0.1, -0.1, 0.02])
def test_chords_of_a_circle_have_its_curvature_and_its_steering(curvature: float) -> None:
    result = compute_bends(log(circle(curvature)))
    assert result is not None
    angle, bent, gear = result
    assert angle == pytest.approx(np.full(len(angle), 100.0 * curvature))
    assert bent == pytest.approx(np.full(len(bent), curvature), rel=0.01)
    assert (gear == 1.0).all()


def test_in_reverse_the_curvature_is_that_of_a_forward_gear() -> None:
    """A circle to the right of the travel, driven backwards, is one to the left for a forward gear."""
    result = compute_bends(log(circle(0.1), shuttle=-1.0))
    assert result is not None and result[1] == pytest.approx(np.full(len(result[1]), -0.1), rel=0.01)


def test_only_clear_steering_is_judged() -> None:
    logs = [log(circle(0.1)), log(circle(0.02))]
    angle, curvature = select_clear_bends(logs)
    assert angle == pytest.approx(np.full(len(angle), 10.0)) and len(angle) == len(curvature) > 0
    assert len(select_clear_bends(logs, gear=-1.0)[0]) == 0


@pytest.mark.parametrize(("sign", "mirrored"), [(1.0, False), (-1.0, True)])
def test_a_path_that_turns_away_from_the_steering_is_mirrored(sign: float, mirrored: bool) -> None:
    angle = np.array([5.0, -5.0, 10.0, -10.0, 8.0, 4.0])
    assert is_steering_mirrored(angle, sign * 0.01 * angle) is mirrored
    assert is_steering_mirrored(angle[:4], sign * 0.01 * angle[:4]) is None, "four bends are too few"


def test_the_sensor_goes_before_the_command() -> None:
    both = log(circle(0.1), steering_command_deg=12.0)
    assert (select_chord_steering(both) == 10.0).all() and find_largest_steering(both) == pytest.approx(10.0)


def test_columns_that_contradict_each_other_are_refused() -> None:
    wave = 10.0 * np.sin(np.arange(200) / 10.0)
    opposite = log(circle(0.1), steering_deg=wave, steering_command_deg=-wave)
    assert "opposite signs" in refusal(lambda: select_chord_steering(opposite))
    # Wheels that stood at their commands before they ran to the other end are no other sign.
    command, wheel = np.full(200, -18.0), np.full(200, 35.0)
    command[:40], wheel[:40] = -8.0, -8.0
    ran_away = log(circle(0.1), steering_deg=wheel, steering_command_deg=command)
    assert (select_chord_steering(ran_away) == wheel).all()
    radians = log(circle(0.1), steering_deg=wave, steering_command_deg=np.radians(wave))
    assert "one is in radians" in refusal(lambda: select_chord_steering(radians))
    assert find_largest_steering(log(joined(circle(0.0), circle(0.1)))) == pytest.approx(10.0)


@pytest.mark.parametrize("curvature", [0.25, 0.1, -0.05, 0.0])
def test_speed_and_curvature_of_a_circle(curvature: float) -> None:
    chords = compute_path_chords(log(circle(curvature)))
    assert chords is not None
    assert chords.speed == pytest.approx(np.full(len(chords.row), SPEED_MPS), rel=0.01)
    assert chords.curvature == pytest.approx(np.full(len(chords.row), curvature), rel=0.01, abs=1e-9)


def test_the_course_is_clockwise_from_north() -> None:
    chords = compute_path_chords(log(circle(0.0, bearing_deg=120.0)))
    assert chords is not None and chords.course == pytest.approx(np.full(len(chords.row), math.radians(120.0)))


def test_tighter_bends_get_shorter_chords() -> None:
    wide, tight = compute_path_chords(log(circle(0.05))), compute_path_chords(log(circle(0.8)))
    assert wide is not None and tight is not None and wide.span_s == 2.0 > tight.span_s


def test_a_log_of_a_moment_or_a_standstill_has_no_chords() -> None:
    assert compute_path_chords(log(circle(0.0, seconds=0.3))) is None
    assert compute_path_chords(log(circle(0.0).assign(easting_m=1.0, northing_m=2.0))) is None
