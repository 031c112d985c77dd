"""The twin: a right model needs no correction, late frames are foretold, and the two ways differ as they should."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from tests.twin.conftest import fix_of, hook
from vehicle.effects import effect
from vehicle.errors import VehicleError
from vehicle.tractor import Implement, load_tractor
from vehicle.twin.motion import Noise, with_hidden
from vehicle.twin.stepper import Stepper
from vehicle.twin.twin import PREDICT, THESIS, WAYS, Fix, Twin

Following = Callable[..., Any]
SPEED = 1.1


def standing(way: str = PREDICT, **more: Any) -> Twin:
    return Twin(load_tractor("eg105"), Implement(), Fix(0.0, 1.0, 2.0, 0.5 * math.pi, 0.0, 0.0), way=way, **more)


def test_a_right_model_has_nothing_to_correct(following: Following) -> None:
    """Commands known to the step, no noise: prediction is the truth to the last bits, at any age of a fix."""
    one = following(PREDICT, 10.0, 0.3, exact=True)
    for name in ("ahead_m", "right_m", "heading_rad"):
        assert np.abs(one.twin.corrections[name]).max() < 1e-9
    assert one.distance_m.max() < 1e-9 and one.twin.doubt() is None and one.twin.rejected == 0


def test_a_late_fix_pulls_the_thesiss_way_back_by_its_age(following: Following) -> None:
    """Closed form: at a steady speed a twin moved to where the tractor was is off by speed times age."""
    one = following(THESIS, 10.0, 0.5)
    rows = slice(60, 130)  # the first straight at full speed
    assert one.distance_m[rows].mean() == pytest.approx(SPEED * 0.5, abs=0.05)


def test_prediction_is_far_nearer_with_noise_another_tractor_and_dead_time(following: Following) -> None:
    wrong = {"hidden": {"steering_dead_time": 0.2, "wheel_slip": 0.05}, "noise": Noise(), "master": "mr1000a"}
    ours, thesis = (following(way, 3.0, 0.3, **wrong) for way in WAYS)
    assert ours.distance_m.mean() < 0.05 < 0.2 < thesis.distance_m.mean()
    assert np.degrees(np.abs(ours.heading_rad)).mean() < 0.5 < np.degrees(np.abs(thesis.heading_rad)).max()


def test_the_twin_says_that_it_is_wrong_and_how(following: Following) -> None:
    clean = following(PREDICT, 10.0, 0.05, noise=Noise())
    assert clean.twin.doubt() is None and clean.twin.evidence_s < 1e4
    doubt = following(PREDICT, 10.0, 0.05, noise=Noise(), hidden={"wheel_slip": 0.08}).twin.doubt()
    assert doubt is not None and doubt.told_s < 10.0 and doubt.times > 1.5
    assert doubt.like in ("wheel_slip", "implement_slip") and doubt.amount == pytest.approx(0.08, abs=0.03)
    assert effect(doubt.like).label in doubt.words


@pytest.mark.parametrize("way", WAYS)
def test_steps_of_any_size_come_to_the_same(way: str) -> None:
    one, other = standing(way), standing(way)
    for twin in (one, other):
        twin.command(0.0, 0.2, 1.0, exact=True)
        twin.measured(Fix(1.5, 1.1, 2.9, 1.5, 0.9, 1.9))
    for step in range(1, 121):
        one.advance(step / 40.0)
    assert one.state == other.advance(3.0)


def test_ahead_is_where_it_then_is() -> None:
    twin = standing()
    twin.command(0.0, 0.3, 1.2, exact=True)
    twin.advance(4.0)
    path = twin.ahead(2.0)
    assert path.shape == (21, 3)
    now = twin.state
    assert path[0].tolist() == [now.x_m, now.y_m, now.heading_rad]
    then = twin.advance(6.0)
    assert path[-1] == pytest.approx([then.x_m, then.y_m, then.heading_rad], abs=1e-12)


def test_a_command_that_comes_late_counts_from_its_time() -> None:
    early, late = standing(), standing()
    for twin, told_at in ((early, 0.0), (late, 1.0)):
        twin.advance(told_at)
        twin.command(0.5, 0.2, 1.0, exact=True)
    # The first one knows of it beforehand.
    assert early.advance(3.0) == late.advance(3.0)


def test_absurd_and_old_fixes_are_left_out_and_a_moved_tractor_is_found_again() -> None:
    twin = standing()
    twin.advance(5.0)
    twin.measured(Fix(0.5, 1.0, 2.0, 1.5, 0.0, 5.0))
    assert twin.advance(5.1).x_m == 1.0 and twin.late == 1, "4.5 s old"
    for number in range(3):
        time_s = 5.2 + 0.1 * number
        assert twin.state.x_m == pytest.approx(1.0, abs=0.05)
        twin.measured(Fix(time_s, 51.0, 2.0, 0.5 * math.pi, 0.0, time_s))
        twin.advance(time_s)
    assert twin.rejected == 3 and twin.state.x_m == pytest.approx(51.0, abs=0.05)


def test_a_tractor_that_does_not_do_as_told_is_followed_by_its_speed() -> None:
    """Section 5.2.2: 0.5 km/h apart for long, the measured speed stands for the commanded one."""
    twin = standing(THESIS)
    twin.command(0.0, 0.0, 1.0, exact=True)
    for step in range(1, 80):
        time_s = step / 10.0
        twin.measured(Fix(time_s, 1.0, 2.0, 0.5 * math.pi, 0.0, time_s))
        twin.advance(time_s)
    assert abs(twin.state.speed_mps) < 0.05


def test_refusals() -> None:
    with pytest.raises(VehicleError, match="The way of correction 'best' is unknown; use one of: predict, thesis"):
        standing("best")
    with pytest.raises(VehicleError, match="ground"):
        standing(ground="moon")
    twin = standing()
    with pytest.raises(VehicleError, match="no finite number"):
        twin.measured(Fix(1.0, math.nan, 0.0, 0.0, 0.0, 1.0))
    with pytest.raises(VehicleError, match="cannot have come in at"):
        twin.measured(Fix(1.0, 0.0, 0.0, 0.0, 0.0, 0.5))
    with pytest.raises(VehicleError, match="give numbers"):
        twin.command(0.0, math.inf, 1.0)


def test_the_recording_is_a_log_of_the_project(following: Following, tmp_path: Any) -> None:
    from vehicle.measured.logs.reading import read_log

    twin = following(PREDICT, 10.0, 0.05, noise=Noise()).twin
    path = tmp_path / "run.csv"
    path.write_text(twin.recording.csv((500000.0, 4000000.0)), encoding="utf-8")
    log = read_log(path)
    assert log.rows_used == len(twin.recording) and log.easting_m.min() > 499000.0
    assert log.heading_deg is not None and math.cos(math.radians(log.heading_deg[30])) > 0.999, "north at first"
    assert set(log.implement) == {0.0, 1.0} and set(log.shuttle) == {1.0}
    assert log.speed_command_mps is not None and log.speed_command_mps.max() == pytest.approx(SPEED)


def test_the_frame_of_a_state_is_a_fix() -> None:
    from tests.twin.test_stepper import stepper

    one = stepper()
    state = one.advance(2.0)
    assert fix_of(state, 0.3).arrived_s == pytest.approx(2.3) and fix_of(state).x_m == state.x_m


def test_the_slip_of_its_own_file_is_not_taken_for_a_tractor_that_drives_otherwise_than_told() -> None:
    effects = {"wheel_slip": 0.05, "implement_slip": 0.12}
    real = Stepper(hook(), load_tractor("eg105"), Implement(), hidden=effects, noise=Noise(), seed=3)
    real.released = 3
    twin = Twin(with_hidden(load_tractor("eg105"), effects), Implement(), fix_of(real.state))
    while not real.state.done:
        told = real.advance(real.time_s + 0.2)
        twin.command(told.time_s, told.steering_command_rad, told.speed_command_mps, told.implement)
        twin.measured(fix_of(told))
        twin.advance(told.time_s)
    assert twin.doubt() is None and twin.evidence_s < 3600.0
