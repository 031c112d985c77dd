"""Speed controller (Eq. 2.3), braking, the follower of Eq. 6.1 and the ramp."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.control.speed import apply_ramp, compute_approach_speed, compute_drive_force, compute_follower_speed

GAINS = (8000.0, 3000.0, 400.0, 15000.0)
SPEED = 5.0 / 3.6


@pytest.mark.parametrize(("error", "integral", "derivative", "expected"), [
    (1.0, 0.0, 0.0, 8000.0),
    (0.0, 0.5, 0.0, 1500.0),
    (0.0, 0.0, -2.0, -800.0),
    (0.5, 0.2, 1.0, 5000.0),
    (-0.5, 0.2, 1.0, -3000.0),
    (3.0, 0.0, 0.0, 15000.0),
    (-3.0, 0.0, 0.0, -15000.0),
])  # fmt: skip
def test_drive_force_by_hand(error: float, integral: float, derivative: float, expected: float) -> None:
    assert compute_drive_force(error, integral, derivative, *GAINS) == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(("distance", "end", "expected"), [
    (0.0, 0.0, 0.0),
    (1.4, 0.0, 1.4),  # sqrt(2 x 0.7 x 1.4)
    (0.0, 1.5, 1.5),
    (-3.0, 1.5, 1.5),
    (10.0, 1.0, math.sqrt(15.0)),
])  # fmt: skip
def test_approach_speed_by_hand(distance: float, end: float, expected: float) -> None:
    assert compute_approach_speed(distance, end, 0.7) == pytest.approx(expected, abs=1e-12)


@given(st.floats(0.0, 100.0), st.floats(0.0, 5.0), st.floats(0.1, 2.0))
def test_braking_from_the_approach_speed_takes_exactly_the_distance(
    distance: float, end: float, deceleration: float
) -> None:
    start = compute_approach_speed(distance, end, deceleration)
    seconds = (start - end) / deceleration
    assert 0.5 * (start + end) * seconds == pytest.approx(distance, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize(("distance", "expected"), [
    (12.0, SPEED),
    (10.0, SPEED),
    (9.0, SPEED - 0.5),
    (8.0, SPEED - 1.0),
    (7.0, 0.0),  # 1.389 - 1.5 is negative
    (-5.0, 0.0),
])  # fmt: skip
def test_follower_by_hand(distance: float, expected: float) -> None:
    assert compute_follower_speed(distance, 10.0, SPEED) == pytest.approx(expected, abs=1e-12)


@given(st.floats(-20.0, 40.0), st.floats(0.0, 5.0), st.floats(2.0, 30.0))
def test_a_follower_is_never_faster_than_its_leader_nor_reverses(distance: float, leader: float, gap: float) -> None:
    assert 0.0 <= compute_follower_speed(distance, gap, leader) <= leader


@given(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(0.001, 1.0))
def test_the_ramp_arrives_in_the_steps_its_slope_takes(value: float, target: float, step: float) -> None:
    needed = math.ceil(abs(target - value) / step - 1e-9)
    for _ in range(needed):
        after = apply_ramp(value, target, step)
        assert abs(after - value) <= step * (1 + 1e-9)
        value = after
    assert value == pytest.approx(target, abs=1e-9)
