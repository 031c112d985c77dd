"""Drives with given steering: slip, simulators, limits, and what must hold of any model."""

import math
from typing import Any

import numpy as np
import pytest

from vehicle.control.steering import SLEW
from vehicle.errors import VehicleError
from vehicle.model.ground import TYRE_GROUNDS, TYRE_MODELS, get_tyres
from vehicle.sim.calibration import compute_kinematic_radius
from vehicle.trials.drive import (
    MAX_GROWTH_DEG,
    MAX_REAR_SLIP_DEG,
    STEERING_SIMULATORS,
    Trace,
    compute_settled_radius,
    drive_by_steering_commands,
    is_sideslip_settled,
    replace_steering,
)

DT = 1.0 / 60.0
SPEED = 5.0 / 3.6


def constant(angle_deg: float, seconds: float, dt: float = DT) -> Any:
    return np.full((round(seconds / dt), 1), angle_deg)


def one(tractor: Any, tyres: Any, commands: Any, **options: Any) -> Trace:
    trace: Trace = drive_by_steering_commands([tractor], [tyres], commands, **options)[0]
    return trace


@pytest.mark.parametrize("ground", TYRE_GROUNDS)
@pytest.mark.parametrize("model", TYRE_MODELS)
@pytest.mark.parametrize("angle", [10.0, -25.0])
def test_at_a_crawl_every_model_drives_the_kinematic_circle(eg105: Any, ground: str, model: str, angle: float) -> None:
    """Slip goes with the square of the speed, so the circle tends to pure rolling."""
    direct = replace_steering(eg105, "none")
    tyres = get_tyres(ground, model, curve=None)
    rolling = float(compute_kinematic_radius(eg105, np.radians(abs(angle))))
    excess = [
        abs(compute_settled_radius(one(direct, tyres, constant(angle, 60.0), speed_mps=speed), 0.0) / rolling - 1.0)
        for speed in (0.4, 0.2)
    ]
    assert excess[1] < 0.01
    assert excess[1] < max(0.3 * excess[0], 1e-4)


@pytest.mark.parametrize("ground", TYRE_GROUNDS)
@pytest.mark.parametrize("model", ["linear", "nonlinear"])
def test_with_the_curve_the_excess_over_the_kinematic_circle_halves_with_the_speed(
    eg105: Any, ground: str, model: str
) -> None:
    """Force goes with the square of the slip, so slip and excess go with the speed itself."""
    direct = replace_steering(eg105, "none")
    rolling = float(compute_kinematic_radius(eg105, np.radians(10.0)))
    excess = [
        compute_settled_radius(one(direct, get_tyres(ground, model), constant(10.0, 60.0), speed_mps=speed), 0.0)
        / rolling
        - 1.0
        for speed in (0.4, 0.2)
    ]
    assert 0.0 < excess[1] < 0.025
    assert excess[0] / excess[1] == pytest.approx(2.0, abs=0.25)


@pytest.mark.parametrize("ground", TYRE_GROUNDS)
@pytest.mark.parametrize("model", TYRE_MODELS)
def test_half_the_step_gives_nearly_the_same_minute(eg105: Any, ground: str, model: str) -> None:
    """From standstill at 5 km/h. Non-linear tyres on soil and in mud are compared below the angles at which they
    slide from the first moment: there the direction of the first metre depends on the step.
    """
    direct, tyres = replace_steering(eg105, "none"), get_tyres(ground, model)
    slides = model == "nonlinear" and ground != "asphalt"
    for angle in (3.0, 10.0) if slides else (3.0, 10.0, 25.0, 35.0):
        coarse, fine = (
            one(direct, tyres, constant(angle, 60.0, dt), dt=dt, from_standstill=True).compute_path(0.0)
            for dt in (DT, DT / 2)
        )
        assert np.hypot(*(coarse - fine[::2]).T).max() < 0.01


def test_slip_angles_of_a_rolling_tractor_are_zero_and_signs_follow_the_thesis(eg105: Any) -> None:
    track = one(
        replace_steering(eg105, "none"), get_tyres("soil", "kinematic"), constant(20.0, 20.0), from_standstill=True
    )
    front, rear = (np.degrees(slip[-60:]) for slip in track.compute_slips())
    assert np.abs(front).max() < 0.05 and np.abs(rear).max() < 0.05
    soft = one(replace_steering(eg105, "none"), get_tyres("soil", "linear"), constant(20.0, 20.0), from_standstill=True)
    # In a right turn the tyres slide to the left, which is negative.
    assert all(slip[-1] < -1.0 for slip in map(np.degrees, soft.compute_slips()))


def test_slip_by_hand() -> None:
    """Heading north at 1 m/s, drifting 0.1 m/s to the right, turning right at 0.2 rad/s, wheels 10 degrees right."""
    rows = np.array([[0.0, 0.0, 0.5 * math.pi, 0.1, 1.0, -0.2, math.radians(10.0), 0.0, 1.0, 0.0, 0.0, 0.0]])
    track = Trace(np.zeros(1), rows, 1.3, 1.1, 0.0)
    front, rear = track.compute_slips()
    assert front[0] == pytest.approx(math.atan(0.1 + 0.26) - math.radians(10.0))
    assert rear[0] == pytest.approx(math.atan(0.1 - 0.22))
    assert track.compute_radius(0.5)[0] == pytest.approx(math.hypot(1.0, 0.2) / 0.2)
    assert track.compute_path(2.0)[0] == pytest.approx((0.0, 2.0))


def test_positive_angles_turn_right(eg105: Any) -> None:
    track = one(replace_steering(eg105, "none"), get_tyres("mud", "linear"), constant(15.0, 5.0))
    assert track.compute_path()[-1, 0] > 0.5


def test_tractors_of_one_drive_do_not_touch_each_other(eg105: Any) -> None:
    direct = replace_steering(eg105, "none")
    tyres = [get_tyres("soil", model) for model in TYRE_MODELS]
    angles = (10.0, -20.0, 30.0)
    together = drive_by_steering_commands([direct] * 3, tyres, np.tile(angles, (1200, 1)))
    for tyre, angle, track in zip(tyres, angles, together, strict=True):
        alone = one(direct, tyre, constant(angle, 20.0))
        moved = track.compute_path(0.0) - track.compute_path(0.0)[0]
        assert np.abs(moved - alone.compute_path(0.0)).max() < 1e-7


def test_every_sixth_row_of_a_drive(eg105: Any) -> None:
    direct, tyres = replace_steering(eg105, "none"), get_tyres("soil", "linear")
    every, sixth = (one(direct, tyres, constant(20.0, 10.0), record_every=steps) for steps in (1, 6))
    assert (every.rows[::6] == sixth.rows).all() and (every.time_s[::6] == pytest.approx(sixth.time_s))


def test_none_puts_the_command_on_the_wheels_at_once(eg105: Any) -> None:
    commands = np.linspace(-35.0, 35.0, 600)[:, None]
    track = one(replace_steering(eg105, "none"), get_tyres("asphalt", "linear"), commands)
    assert np.degrees(track.get_column("steering")) == pytest.approx(commands[:, 0])


def test_the_traditional_simulator_is_a_first_order_lag(eg105: Any) -> None:
    track = one(replace_steering(eg105, "traditional"), get_tyres("asphalt", "linear"), constant(30.0, 2.0))
    steps = np.arange(1, 121)
    expected = 30.0 * (1.0 - (1.0 - DT / 0.1) ** steps)
    assert np.degrees(track.get_column("steering")) == pytest.approx(expected, abs=1e-9)
    assert not (track.get_column("stage") == SLEW).any()


def rates(track: Trace) -> Any:
    """Size of the wheels' rate of turn (degrees/s) per step."""
    return np.abs(np.diff(np.degrees(track.get_column("steering")))) / DT


def test_without_the_latch_the_broken_line_is_back(eg105: Any) -> None:
    """Section 3.2.2: leaving stage 3 for stage 2 the wheels jump to the command in a broken line; Eq. 2.8 with its
    memory runs up at 16 degrees a second all the way.
    """
    tracks = {
        name: one(replace_steering(eg105, name), get_tyres("asphalt", "linear"), constant(25.0, 3.0))
        for name in ("proposed", "unlatched")
    }
    assert rates(tracks["proposed"]).max() == pytest.approx(16.0, abs=1e-6)
    kink = rates(tracks["unlatched"])
    # At a gap of just under 5 degrees the lag of 0.1 s moves the wheels at nearly 50 degrees a second.
    assert 45.0 < kink.max() < 50.0
    assert kink[: int(kink.argmax())].max() == pytest.approx(16.0, abs=1e-6)


def test_unknown_simulators_and_angles_beyond_the_stop_are_refused(eg105: Any) -> None:
    with pytest.raises(VehicleError, match=rf"'magic' is unknown; use one of: {', '.join(STEERING_SIMULATORS)}"):
        replace_steering(eg105, "magic")
    with pytest.raises(VehicleError, match=r"40 degrees is beyond the stop; use 35 or less"):
        one(eg105, get_tyres("soil", "linear"), constant(40.0, 1.0))


def slipping(rear_deg: Any) -> Trace:
    """A trace heading north at 1 m/s whose rear axle slips by the given angles."""
    rear = np.radians(np.asarray(rear_deg, dtype=float))
    rows = np.zeros((len(rear), 12))
    rows[:, 2], rows[:, 4], rows[:, 3], rows[:, 5] = 0.5 * math.pi, 1.0, np.tan(rear), 1e-9
    return Trace(DT * np.arange(len(rear)), rows, 1.3, 1.1, 0.0)


def test_the_criterion_of_stability_on_made_up_slips() -> None:
    time = np.linspace(0.0, 40.0, 400)
    assert is_sideslip_settled(slipping(5.0 * (1.0 - np.exp(-time))))
    assert is_sideslip_settled(slipping(np.full(400, MAX_REAR_SLIP_DEG - 0.1)))
    assert not is_sideslip_settled(slipping(np.full(400, MAX_REAR_SLIP_DEG + 0.1)))
    assert not is_sideslip_settled(slipping(-np.where(time < 5.0, 40.0, 1.0)))  # lost for a while is lost
    assert is_sideslip_settled(slipping(0.9 * MAX_GROWTH_DEG / 10.0 * time))
    assert not is_sideslip_settled(slipping(1.1 * MAX_GROWTH_DEG / 10.0 * time))
    assert math.isnan(compute_settled_radius(slipping(0.5 * time), 0.0))
