"""The steering system simulator (Eq. 2.8), the wheel angles (Eq. 2.1, 2.2) and the correction table."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.control.steering import (
    FOLLOW,
    HOLD,
    SLEW,
    compute_ackermann_directions,
    convert_to_base_angle,
    step_steering_simulator,
)
from vehicle.sim.calibration import build_identity_table

DT = 1.0 / 60.0
DEG = math.radians(1.0)
ANGLES = st.floats(-35.0, 35.0)
STAGES = st.sampled_from([HOLD, FOLLOW, SLEW])
WHEELBASE, TRACK_M = 2.4, 1.8


def step(angle_deg: float, command_deg: float, stage: int, lag: float = 0.1) -> tuple[float, int]:
    """One step with the numbers of the thesis, in degrees."""
    angle, stage = step_steering_simulator(
        angle_deg * DEG, command_deg * DEG, stage, DT, 0.1 * DEG, 5.0 * DEG, 16.0 * DEG, lag, 1.0
    )
    return math.degrees(angle), stage


@pytest.mark.parametrize("stage", [HOLD, FOLLOW, SLEW])
@pytest.mark.parametrize("gap", [0.0, 0.05, 0.0999, -0.0999])
def test_inside_the_dead_band_the_wheels_hold(gap: float, stage: int) -> None:
    assert step(2.0, 2.0 + gap, stage) == (pytest.approx(2.0, abs=1e-12), HOLD)


@pytest.mark.parametrize(("angle", "command", "expected"), [
    (0.0, 3.0, 0.5),  # a sixth of the gap: dt / tau = (1/60) / 0.1
    (0.5, 3.0, 0.5 + 2.5 / 6),
    (-1.0, -4.6, -1.6),
    (10.0, 9.8999, 10.0 - 0.1001 / 6),
    (0.0, 4.9999, 4.9999 / 6),
])  # fmt: skip
def test_small_gaps_are_followed_as_a_first_order_lag(angle: float, command: float, expected: float) -> None:
    assert step(angle, command, HOLD) == (pytest.approx(expected, abs=1e-9), FOLLOW)


@pytest.mark.parametrize(("angle", "command", "expected"), [
    (0.0, 30.0, 16.0 / 60),
    (0.0, 5.0001, 16.0 / 60),
    (0.0, -5.0001, -16.0 / 60),
    (35.0, -35.0, 35.0 - 16.0 / 60),
])  # fmt: skip
@pytest.mark.parametrize("stage", [HOLD, FOLLOW])
def test_large_gaps_are_slewed_at_sixteen_degrees_a_second(
    angle: float, command: float, expected: float, stage: int
) -> None:
    assert step(angle, command, stage) == (pytest.approx(expected, abs=1e-9), SLEW)


def test_slewing_goes_on_below_the_switch_and_stops_on_the_command() -> None:
    assert step(0.0, 2.0, SLEW) == (pytest.approx(16.0 / 60, abs=1e-9), SLEW)
    assert step(0.0, 0.2, SLEW) == (pytest.approx(0.2, abs=1e-12), SLEW)


def test_thirty_degrees_take_113_steps() -> None:
    angle, stage, steps = 0.0, HOLD, 0
    while stage != HOLD or steps == 0:
        previous = angle
        angle, stage = step(angle, 30.0, stage)
        steps += 1
        if steps <= 112:
            assert angle - previous == pytest.approx(16.0 / 60, abs=1e-9)
    assert angle == pytest.approx(30.0, abs=1e-9)
    assert steps == 114, "113 steps to arrive (30 / 16 s = 112.5 steps), one more to see that it has"


def test_a_step_of_three_degrees_decays_by_five_sixths_a_step() -> None:
    angle, stage = 0.0, HOLD
    for count in range(1, 19):
        angle, stage = step(angle, 3.0, stage)
        assert 3.0 - angle == pytest.approx(3.0 * (5 / 6) ** count, abs=1e-9)
    # 3 (5/6)^18 = 0.113 deg is outside the dead band and 3 (5/6)^19 = 0.094 deg inside.
    angle, stage = step(angle, 3.0, stage)
    assert stage == FOLLOW
    assert step(angle, 3.0, stage) == (pytest.approx(angle, abs=1e-12), HOLD)


@given(st.lists(ANGLES, min_size=1, max_size=40), ANGLES, STAGES)
def test_slewing_ends_only_in_hold(commands: list[float], angle: float, stage: int) -> None:
    for command in commands:
        for _ in range(5):
            before = stage
            angle, stage = step(angle, command, stage)
            assert not (before == SLEW and stage == FOLLOW)


@given(ANGLES, ANGLES, STAGES, st.floats(DT, 1.0))
def test_never_past_the_command_and_never_away_from_it(angle: float, command: float, stage: int, lag: float) -> None:
    after, _ = step(angle, command, stage, lag)
    low, high = sorted((angle, command))
    assert low - 1e-9 <= after <= high + 1e-9


@given(ANGLES, ANGLES, STAGES)
def test_left_and_right_are_alike(angle: float, command: float, stage: int) -> None:
    after, became = step(angle, command, stage)
    assert step(-angle, -command, stage) == (-after, became)


@given(ANGLES, ANGLES, STAGES)
def test_slewing_is_never_faster_than_its_rate(angle: float, command: float, stage: int) -> None:
    after, became = step(angle, command, stage)
    if became == SLEW:
        assert abs(after - angle) <= 16.0 / 60 + 1e-9


def wheel_tangents(mean: float, base: float, track: float) -> tuple[float, float]:
    """Tangents of the left and the right wheel angle; cosine and sine of each must be of one angle."""
    cos_left, sin_left, cos_right, sin_right = compute_ackermann_directions(math.tan(mean), 0.5 * track / base)
    assert (math.hypot(cos_left, sin_left), math.hypot(cos_right, sin_right)) == pytest.approx((1.0, 1.0), abs=1e-15)
    return sin_left / cos_left, sin_right / cos_right


@given(st.one_of(st.floats(-50.0, -0.01), st.floats(0.01, 50.0)), st.floats(1.5, 4.0), st.floats(1.0, 2.5))
def test_wheel_angles_against_their_formulas(angle_deg: float, base: float, track: float) -> None:
    mean = angle_deg * DEG
    left, right = wheel_tangents(mean, base, track)
    assert math.atan(left) == pytest.approx(math.atan(base / (0.5 * track + base / math.tan(mean))), abs=1e-12)
    if abs(base / math.tan(mean)) > 0.5 * track + 1e-3:
        expected = math.atan(base / (base / math.tan(mean) - 0.5 * track))
        assert math.atan(right) == pytest.approx(expected, abs=1e-12)


def test_the_right_wheel_is_the_inner_one_of_a_right_turn() -> None:
    left, right = wheel_tangents(30 * DEG, WHEELBASE, TRACK_M)
    # 2.4 / tan 30 = 4.15692 m; 2.4 / (4.15692 + 0.9) and 2.4 / (4.15692 - 0.9)
    assert left == pytest.approx(0.474597, abs=1e-6)
    assert right == pytest.approx(0.736892, abs=1e-6)
    assert compute_ackermann_directions(0.0, 0.375) == (1.0, 0.0, 1.0, 0.0)


@given(st.one_of(st.floats(-50.0, -0.5), st.floats(0.5, 50.0)), st.floats(1.5, 4.0), st.floats(1.0, 2.5))
def test_both_front_wheels_roll_about_one_point_of_the_rear_axle_line(
    angle_deg: float, base: float, track: float
) -> None:
    tangents = wheel_tangents(angle_deg * DEG, base, track)
    centres = []
    for tangent, aside in zip(tangents, (-0.5 * track, 0.5 * track), strict=True):
        wheel = np.array([base, aside])
        normal = np.array([-tangent, 1.0])  # square to the wheel, in (forward, right)
        centres.append(wheel + base / tangent * normal)
    for centre in centres:
        assert centre == pytest.approx([0.0, base / math.tan(angle_deg * DEG)], abs=1e-8)


@given(st.lists(st.floats(-0.9, 0.9), min_size=2, max_size=30), st.floats(-0.8, 0.8))
def test_the_table_is_read_by_linear_interpolation(values: list[float], angle: float) -> None:
    table, limit = np.array(values), 0.6
    expected = np.interp(angle, np.linspace(-limit, limit, len(table)), table)
    assert convert_to_base_angle(angle, table, limit) == pytest.approx(expected, abs=1e-12)


@given(ANGLES)
def test_the_identity_table_changes_nothing(angle_deg: float) -> None:
    table = build_identity_table(35.0)
    assert convert_to_base_angle(angle_deg * DEG, table, 35 * DEG) == pytest.approx(angle_deg * DEG, abs=1e-12)
