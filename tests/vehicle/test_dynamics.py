"""One step of the tractor body: balance of forces, symmetry, energy, steady circles and the size of the step."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fields.arrays import Floats
from tests.benchmarks.plain_pymunk import advance
from tests.vehicle.bits import drive_fixed
from vehicle.model.ground import GROUNDS, find_ground_index
from vehicle.model.tractor import Tractor
from vehicle.records import GRAVITY_MPS2
from vehicle.sim.calibration import build_identity_table, compute_kinematic_radius, drive_base_circle
from vehicle.sim.dynamics import step_body

DT = 1.0 / 60.0
SPEED = 5.0 / 3.6
SOIL = find_ground_index("soil")
FORWARD = st.floats(-5.0, 5.0)
RIGHT = st.floats(-2.0, 2.0)
SPIN = st.floats(-1.0, 1.0)
TANGENT = st.floats(-0.7, 0.7)


def energy(model: Any, forward: float, right: float, spin: float) -> float:
    return 0.5 * float(model["mass"]) * (forward**2 + right**2) + 0.5 * float(model["inertia"]) * spin**2


def fixed_run(tractor: Tractor, steering_deg: float, dt: float, seconds: float) -> Floats:
    """Raw body track (t, 6) in pymunk with the wheels at a fixed angle, from standstill to 5 km/h."""
    angle = math.radians(steering_deg)
    tables = np.array([build_identity_table(tractor.max_steering_deg)] * len(GROUNDS))
    return drive_fixed(tractor, tables, round(seconds / dt), dt, command=angle, steering=angle, target_speed=SPEED)


def record(values: Any) -> dict[str, float]:
    return {name: float(values[name]) for name in values.dtype.names if values.dtype[name].shape == ()}


@given(
    FORWARD, RIGHT, SPIN, TANGENT, st.floats(-15000.0, 15000.0), st.sampled_from([1.0, 0.03, 1e-3]),
    st.floats(1.0, 30.0),
)  # fmt: skip
def test_the_step_is_that_of_four_wheels_in_plain_python(
    model: Any, soil: Any, forward: float, right: float, spin: float, tangent: float, drive: float, scale: float,
    limit_deg: float,
) -> None:  # fmt: skip
    """`advance` takes each wheel by its angle, slip and force; both axles slip little, much and beyond their limit."""
    soil = soil.copy()
    soil["front_limit"] = soil["rear_limit"] = math.radians(limit_deg)
    right, spin, tangent = right * scale, spin * scale, tangent * scale
    found = step_body(forward, right, spin, tangent, drive, DT, model, soil)
    expected = advance(forward, right, spin, tangent, drive, record(model), record(soil))
    assert found == pytest.approx(expected, abs=1e-13)


@given(st.floats(0.2, 5.0), st.floats(-15000.0, 15000.0))
def test_straight_on_only_drive_and_rolling_resistance_count(model: Any, soil: Any, speed: float, drive: float) -> None:
    forward, right, spin = step_body(speed, 0.0, 0.0, 0.0, drive, DT, model, soil)
    resistance = 0.06 * 3850.0 * GRAVITY_MPS2 * speed / (speed + 0.05)
    assert forward == pytest.approx(speed + DT * (drive - resistance) / 3850.0, abs=1e-12)
    assert (right, spin) == (0.0, 0.0)


def test_straight_running_keeps_its_speed(model: Any, soil: Any) -> None:
    drive = 0.06 * 3850.0 * GRAVITY_MPS2 * SPEED / (SPEED + 0.05)
    velocity = (SPEED, 0.0, 0.0)
    for _ in range(6000):
        velocity = step_body(*velocity, 0.0, drive, DT, model, soil)
    assert velocity == (pytest.approx(SPEED, abs=1e-9), 0.0, 0.0)


@given(FORWARD, RIGHT, SPIN, TANGENT, st.floats(-15000.0, 15000.0))
def test_left_and_right_are_mirror_images(
    model: Any, soil: Any, forward: float, right: float, spin: float, tangent: float, drive: float
) -> None:
    a = step_body(forward, right, spin, tangent, drive, DT, model, soil)
    b = step_body(forward, -right, -spin, -tangent, drive, DT, model, soil)
    assert b == pytest.approx((a[0], -a[1], -a[2]), abs=1e-9)


@given(FORWARD, RIGHT, SPIN, TANGENT, st.sampled_from([1.0, 0.1, 0.01, 0.001]))
def test_without_drive_the_energy_never_grows(
    model: Any, soil: Any, forward: float, right: float, spin: float, tangent: float, scale: float
) -> None:
    before = (forward * scale, right * scale, spin * scale)
    assert energy(model, *step_body(*before, tangent, 0.0, DT, model, soil)) <= energy(model, *before)


@given(FORWARD, RIGHT, SPIN)
def test_a_sliding_tractor_with_straight_wheels_comes_to_rest(
    model: Any, soil: Any, forward: float, right: float, spin: float
) -> None:
    velocity = (forward, right, spin)
    for _ in range(2400):  # 40 s; at 0.06 g even 5 m/s are gone after some 10 s
        velocity = step_body(*velocity, 0.0, 0.0, DT, model, soil)
    assert energy(model, *velocity) < 1e-3


@given(st.floats(-3.0, 3.0), st.floats(-0.3, 0.3))
def test_side_forces_leave_the_momentum_they_should(model: Any, soil: Any, forward: float, right: float) -> None:
    """With the wheels straight, all four push against the sideways motion and none pushes forward."""
    after = step_body(forward, right, 0.0, 0.0, 0.0, 1e-7, model, soil)
    rolling = 0.06 * GRAVITY_MPS2 * forward / (abs(forward) + 0.05)
    assert after[0] - forward == pytest.approx(-1e-7 * rolling, abs=1e-12)
    slip = math.degrees(abs(math.atan(right / max(abs(forward), 0.05))))
    # Front axle carries l_r / l = 1.1 / 2.4 of the weight, rear axle 1.3 / 2.4.
    friction = (0.15 * 1.1 + 0.20 * 1.3) / 2.4 * min(slip, 5.0)
    assert after[1] - right == pytest.approx(-math.copysign(1e-7 * friction * GRAVITY_MPS2, right), rel=2e-3, abs=1e-12)


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.2])
@pytest.mark.parametrize("steering_deg", [-35.0, -5.0, 5.0, 20.0, 35.0, 50.0])
def test_crawling_follows_the_kinematic_circle(eg105: Tractor, steering_deg: float, speed: float) -> None:
    circle = drive_base_circle(eg105, steering_deg, SOIL, speed_mps=speed)
    assert circle.radius_m == pytest.approx(compute_kinematic_radius(eg105, np.radians(abs(steering_deg))), rel=1e-3)


@pytest.mark.parametrize("steering_deg", [10.0, 20.0, 30.0])
def test_slip_widens_the_circle_with_the_square_of_the_speed(eg105: Tractor, steering_deg: float) -> None:
    """Understeer of a linear tyre: the extra radius is proportional to v^2."""
    kinematic = float(compute_kinematic_radius(eg105, np.radians(steering_deg)))
    extra = [
        drive_base_circle(eg105, steering_deg, SOIL, speed_mps=speed).radius_m / kinematic - 1.0 for speed in (0.7, 1.4)
    ]
    assert 0.0 < extra[0] < 0.002
    assert extra[1] / extra[0] == pytest.approx(4.0, rel=0.02)


@pytest.mark.parametrize("steering_deg", [3.0, -15.0, 30.0])
def test_half_the_step_gives_nearly_the_same_track(eg105: Tractor, steering_deg: float) -> None:
    """A minute at 5 km/h, 80 m, from standstill with the wheels at the angle; the start makes most of it."""
    coarse = fixed_run(eg105, steering_deg, DT, 60.0)
    fine = fixed_run(eg105, steering_deg, 0.5 * DT, 60.0)[::2]
    assert np.hypot(*coarse[-1, 3:5]) == pytest.approx(np.hypot(*fine[-1, 3:5]), abs=1e-9)
    assert np.hypot(*(coarse[:, :2] - fine[:, :2]).T).max() < 0.01


def test_positive_steering_turns_right(eg105: Tractor) -> None:
    track = fixed_run(eg105, 10.0, DT, 3.0)
    assert track[-1, 2] < -0.1 and track[-1, 1] < 0.0
