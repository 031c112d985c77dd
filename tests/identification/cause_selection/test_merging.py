"""Late positions and headings are one late receiver, and an age of all columns is none."""

from dataclasses import replace

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model
from vehicle.identification.cause_selection.merging import (
    FILTER,
    choose_reference_clock,
    drop_shared_filter,
    merge_delays,
    remove_common_age,
    share_out_delays,
)
from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.residuals.residual_model import ResidualModel

LATE = {"gnss_latency": {"time_s": 0.3}}


@pytest.fixture(scope="module")
def model() -> ResidualModel:
    return build_programme_model("steps", LATE)


def fit_of(model: ResidualModel, **sizes: float) -> EffectFit:
    parts = tuple((build_parameters(model.rig.tractor, name), np.array([size])) for name, size in sizes.items())
    residuals = model.compute_residuals({name: {"time_s": size} for name, size in sizes.items()})
    return EffectFit(parts, residuals, np.zeros((len(residuals), 0)))


def test_one_receiver_is_late(model: ResidualModel) -> None:
    both = refine_fit(model, fit_of(model, position_delay=0.28, heading_delay=0.32))
    merged = merge_delays(model, both)
    assert list(merged.settings) == ["gnss_latency"]
    assert merged.settings["gnss_latency"]["time_s"] == pytest.approx(0.3, abs=0.01)
    one = fit_of(model, position_delay=0.3)
    assert merge_delays(model, one) is one


def test_delays_that_differ_stay_apart() -> None:
    model = build_programme_model("steps", {"position_delay": {"time_s": 0.4}, "heading_delay": {"time_s": 0.15}})
    both = fit_of(model, position_delay=0.4, heading_delay=0.15)
    assert merge_delays(model, both) is both


def test_an_age_of_all_columns_is_none(model: ResidualModel) -> None:
    same = {"gnss_latency": 0.5, "clock_offset_speed": 0.2, "clock_offset_steering": 0.2}
    aged = fit_of(model, **same, clock_offset_steering_command=0.2)
    reduced = remove_common_age(model, aged)
    assert list(reduced.settings) == ["gnss_latency"]
    assert reduced.settings["gnss_latency"]["time_s"] == pytest.approx(0.3, abs=0.02)
    without_command = fit_of(model, **same)
    assert remove_common_age(model, without_command) is without_command


def test_a_column_that_nobody_logged_is_not_in_time() -> None:
    """Without a wheel sensor, all columns that there are 0.5 s late are none."""
    sensed = build_programme_model("steps", {})
    segments = tuple(replace(one, wheel=None) for one in sensed.dataset.segments)
    model = replace(sensed, dataset=replace(sensed.dataset, segments=segments))
    aged = fit_of(model, gnss_latency=0.5, clock_offset_speed=0.5, clock_offset_steering_command=0.5)
    assert remove_common_age(model, aged).settings == {}


def test_a_heading_smoothed_as_much_as_all_else_is_late_is_in_time() -> None:
    model = build_programme_model("steps", {})
    late = {f"clock_offset_{name}": 0.14 for name in ("speed", "steering", "steering_command")}
    fit = fit_of(model, **late, position_delay=0.14, heading_filter=0.14)
    assert FILTER not in drop_shared_filter(model, fit).settings
    alone = fit_of(model, heading_filter=0.14)
    assert drop_shared_filter(model, alone) is alone


def test_commands_stamped_later_than_wheels_are_slow_are_one_clock() -> None:
    model = build_programme_model("steps", {"clock_offset_steering_command": {"time_s": 0.06}})
    both = fit_of(model, steering_dead_time=0.2, clock_offset_steering_command=0.26)
    shared = share_out_delays(model, both)
    assert set(shared.settings) == {"clock_offset_steering_command"}
    assert shared.settings["clock_offset_steering_command"]["time_s"] == pytest.approx(0.06, abs=0.03)


def test_a_dead_time_that_makes_up_for_a_clock_is_a_late_receiver(model: ResidualModel) -> None:
    twice = fit_of(model, steering_dead_time=0.3, clock_offset_steering=-0.3)
    shared = share_out_delays(model, twice)
    assert list(shared.settings) == ["gnss_latency"]
    assert shared.settings["gnss_latency"]["time_s"] == pytest.approx(0.3, abs=0.02)


def test_a_clock_of_commands_and_a_dead_time_are_seen_together() -> None:
    model = build_programme_model("steps", {"steering_dead_time": {"time_s": 0.2}})
    both = fit_of(model, steering_dead_time=0.6, clock_offset_steering_command=0.4)
    shared = share_out_delays(model, both)
    assert list(shared.settings) == ["steering_dead_time"]
    assert shared.settings["steering_dead_time"]["time_s"] == pytest.approx(0.2, abs=0.03)


def test_early_wheel_angles_alone_are_a_clock() -> None:
    model = build_programme_model("steps", {"clock_offset_steering": {"time_s": -0.3}})
    one = fit_of(model, clock_offset_steering=-0.3)
    assert share_out_delays(model, one) is one


def test_four_late_columns_are_one_that_is_early() -> None:
    model = build_programme_model("steps", {"clock_offset_heading": {"time_s": -0.4}})
    late = {f"clock_offset_{column}": 0.38 for column in ("position", "speed", "steering", "steering_command")}
    simpler = choose_reference_clock(model, refine_fit(model, fit_of(model, **late)))
    assert list(simpler.settings) == ["clock_offset_heading"]
    assert simpler.settings["clock_offset_heading"]["time_s"] == pytest.approx(-0.4, abs=0.02)


def test_clocks_that_differ_stay_as_they_are() -> None:
    hidden = {"clock_offset_heading": {"time_s": -0.4}, "clock_offset_steering": {"time_s": 0.6}}
    model = build_programme_model("steps", hidden)
    both = fit_of(model, clock_offset_heading=-0.4, clock_offset_steering=0.6)
    assert choose_reference_clock(model, both) is both
