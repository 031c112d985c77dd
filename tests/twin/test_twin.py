"""The twin: a correct model needs no correction, late frames are predicted, and the two methods differ as expected."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.twin.conftest import fix_of, hook
from vehicle.errors import VehicleError
from vehicle.model.effects import get_effect
from vehicle.model.tractor import Implement, load_tractor
from vehicle.trials.sheets.twin_link import (
    FIELD_MPS,
    HIDDEN,
    PRE_MPS,
    LinkDeviation,
    MasterDrive,
    drive_master,
    simulate_twin_link,
)
from vehicle.twin.robot_tractor import RobotTractor
from vehicle.twin.step_motion import TractorNoise, add_hidden_effects
from vehicle.twin.twin import CORRECTION_METHODS, PREDICT, THESIS, PoseFix, Twin

Following = Callable[..., Any]
SPEED = 1.1


def build_standing_twin(method: str = PREDICT) -> Twin:
    return Twin(load_tractor("eg105"), Implement(), PoseFix(0.0, 1.0, 2.0, 0.5 * math.pi, 0.0, 0.0), method=method)


def test_a_correct_model_needs_no_correction(following: Following) -> None:
    """With exact commands and no noise the prediction is the truth to the last bits, at any age of a fix."""
    one = following(PREDICT, 10.0, 0.3, exact=True)
    for name in ("ahead_m", "right_m", "heading_rad"):
        assert np.abs(one.twin.corrections[name]).max() < 1e-9
    assert one.distance_m.max() < 1e-9 and one.twin.find_mismatch() is None and one.twin.rejected_count == 0


def test_a_late_fix_pulls_the_thesiss_method_back_by_its_age(following: Following) -> None:
    """Closed form: at a steady speed a twin moved to where the tractor was is off by speed times age."""
    one = following(THESIS, 10.0, 0.5)
    rows = slice(60, 130)  # the first straight at full speed
    assert one.distance_m[rows].mean() == pytest.approx(SPEED * 0.5, abs=0.05)


def test_prediction_is_much_closer_with_noise_another_tractor_and_dead_time(following: Following) -> None:
    wrong = {"hidden": {"steering_dead_time": 0.2, "wheel_slip": 0.05}, "noise": TractorNoise(), "master": "mr1000a"}
    ours, thesis = (following(method, 3.0, 0.3, **wrong) for method in CORRECTION_METHODS)
    assert ours.distance_m.mean() < 0.05 < 0.2 < thesis.distance_m.mean()
    assert np.degrees(np.abs(ours.heading_rad)).mean() < 0.5 < np.degrees(np.abs(thesis.heading_rad)).max()


def test_the_twin_reports_a_mismatch_and_its_effect(following: Following) -> None:
    clean = following(PREDICT, 10.0, 0.05, noise=TractorNoise())
    assert clean.twin.find_mismatch() is None and clean.twin.evidence_s < 1e4
    mismatch = following(PREDICT, 10.0, 0.05, noise=TractorNoise(), hidden={"wheel_slip": 0.08}).twin.find_mismatch()
    assert mismatch is not None and mismatch.detected_s < 10.0 and mismatch.innovation_ratio > 1.5
    assert mismatch.effect_id in ("wheel_slip", "implement_slip") and mismatch.amount == pytest.approx(0.08, abs=0.03)
    assert get_effect(mismatch.effect_id).label in mismatch.words


@pytest.mark.parametrize("method", CORRECTION_METHODS)
def test_the_step_size_does_not_matter(method: str) -> None:
    one, other = build_standing_twin(method), build_standing_twin(method)
    for twin in (one, other):
        twin.add_command(0.0, 0.2, 1.0, is_exact=True)
        twin.add_fix(PoseFix(1.5, 1.1, 2.9, 1.5, 0.9, 1.9))
    for step in range(1, 121):
        one.advance(step / 40.0)
    assert one.state == other.advance(3.0)


def test_the_predicted_path_is_driven() -> None:
    twin = build_standing_twin()
    twin.add_command(0.0, 0.3, 1.2, is_exact=True)
    twin.advance(4.0)
    path = twin.predict_path(2.0)
    assert path.shape == (21, 3)
    now = twin.state
    assert path[0].tolist() == [now.x_m, now.y_m, now.heading_rad]
    then = twin.advance(6.0)
    assert path[-1] == pytest.approx([then.x_m, then.y_m, then.heading_rad], abs=1e-12)


def test_a_late_command_counts_from_its_time() -> None:
    early, late = build_standing_twin(), build_standing_twin()
    for twin, arrived_s in ((early, 0.0), (late, 1.0)):
        twin.advance(arrived_s)
        twin.add_command(0.5, 0.2, 1.0, is_exact=True)
    # The first one gets it in advance.
    assert early.advance(3.0) == late.advance(3.0)


def test_outliers_and_old_fixes_are_ignored_and_a_moved_tractor_is_found_again() -> None:
    twin = build_standing_twin()
    twin.advance(5.0)
    twin.add_fix(PoseFix(0.5, 1.0, 2.0, 1.5, 0.0, 5.0))
    assert twin.advance(5.1).x_m == 1.0 and twin.late_count == 1, "4.5 s old"
    for number in range(3):
        time_s = 5.2 + 0.1 * number
        assert twin.state.x_m == pytest.approx(1.0, abs=0.05)
        twin.add_fix(PoseFix(time_s, 51.0, 2.0, 0.5 * math.pi, 0.0, time_s))
        twin.advance(time_s)
    assert twin.rejected_count == 3 and twin.state.x_m == pytest.approx(51.0, abs=0.05)


def test_a_tractor_that_ignores_its_speed_command_is_followed_by_its_measured_speed() -> None:
    """Section 5.2.2: after a lasting difference of 0.5 km/h the measured speed replaces the commanded one."""
    twin = build_standing_twin(THESIS)
    twin.add_command(0.0, 0.0, 1.0, is_exact=True)
    for step in range(1, 80):
        time_s = step / 10.0
        twin.add_fix(PoseFix(time_s, 1.0, 2.0, 0.5 * math.pi, 0.0, time_s))
        twin.advance(time_s)
    assert abs(twin.state.speed_mps) < 0.05


def test_refusals() -> None:
    with pytest.raises(VehicleError, match="The correction method 'best' is unknown; use one of: predict, thesis"):
        build_standing_twin("best")
    twin = build_standing_twin()
    with pytest.raises(VehicleError, match="not finite"):
        twin.add_fix(PoseFix(1.0, math.nan, 0.0, 0.0, 0.0, 1.0))
    with pytest.raises(VehicleError, match="cannot arrive at"):
        twin.add_fix(PoseFix(1.0, 0.0, 0.0, 0.0, 0.0, 0.5))
    with pytest.raises(VehicleError, match="give numbers"):
        twin.add_command(0.0, math.inf, 1.0)


def test_the_frame_of_a_state_is_a_fix() -> None:
    from tests.twin.test_stepper import stepper

    one = stepper()
    state = one.advance(2.0)
    assert fix_of(state, 0.3).arrived_s == pytest.approx(2.3) and fix_of(state).x_m == state.x_m


def test_the_slip_in_the_file_is_no_mismatch() -> None:
    effects = {"wheel_slip": 0.05, "implement_slip": 0.12}
    real = RobotTractor(
        hook(), load_tractor("eg105"), Implement(), hidden_effects=effects, noise=TractorNoise(), seed=3
    )
    real.base_legs = 3
    twin = Twin(add_hidden_effects(load_tractor("eg105"), effects), Implement(), fix_of(real.state))
    while not real.state.done:
        state = real.advance(real.time_s + 0.2)
        twin.add_command(state.time_s, state.steering_command_rad, state.speed_command_mps, state.implement)
        twin.add_fix(fix_of(state))
        twin.advance(state.time_s)
    assert twin.find_mismatch() is None and twin.evidence_s < 3600.0


# --- Section 5.3: both methods compared with the thesis, and how they depend on rate and age ---


@pytest.fixture(scope="module")
def field() -> MasterDrive:
    """A master of 5.3.2 on short straights, with noise and hidden effects."""
    return drive_master(load_tractor("eg105"), FIELD_MPS, hidden=HIDDEN, noise=TractorNoise(), straight_share=0.3)


def measure(drive: MasterDrive, method: str, rate_hz: float, age_s: float) -> LinkDeviation:
    return simulate_twin_link(drive, load_tractor("mr1000a"), method, rate_hz=rate_hz, age_s=age_s, sample_hz=5)[0]


def test_two_simulated_tractors_stay_within_what_the_thesis_prints() -> None:
    drive = drive_master(load_tractor("eg105"), PRE_MPS, straight_share=0.3)
    for method in (THESIS, PREDICT):
        one = measure(drive, method, 10.0, 0.05)
        assert one.across_m.max() < 0.145 and (one.across_m < 0.05).mean() > 0.9
    alone, _ = simulate_twin_link(drive, load_tractor("mr1000a"), THESIS, rate_hz=10.0, age_s=0.05, poses=False)
    assert alone.across_m.max() > 1.0, "without correction the paths diverge"


def test_prediction_follows_a_different_tractor(field: MasterDrive) -> None:
    one = measure(field, PREDICT, 3.0, 0.3)
    assert one.distance_m.mean() <= 0.10 and np.degrees(np.abs(one.heading_rad)).mean() <= 0.5


def test_age_costs_the_thesiss_method_the_driven_distance_and_prediction_little(field: MasterDrive) -> None:
    thesis = [measure(field, THESIS, 10.0, age).distance_m.mean() for age in (0.0, 0.5, 1.0)]
    ours = [measure(field, PREDICT, 10.0, age).distance_m.mean() for age in (0.0, 0.5, 1.0)]
    # A frame 0.5 s older is as much further behind.
    assert np.diff(thesis) == pytest.approx([0.95 * FIELD_MPS * 0.5] * 2, abs=0.1)
    assert max(ours) < 0.06 and thesis[2] > 10.0 * ours[2]
