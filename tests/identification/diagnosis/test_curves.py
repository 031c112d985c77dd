"""The plot that shows a cause: bins by hand, means in closed form, and the residual of known effects."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tests.identification.diagnosis.problems import PACE_MPS, build_drive_problem, build_hypothesis, fit_with
from vehicle.identification.diagnosis.curves import (
    CURVE_BINS,
    QUANTITIES,
    REGRESSORS,
    build_residual_plot,
    estimate_bins,
    number_bins,
    select_axes,
)
from vehicle.identification.diagnosis.drive_data import PATH_STEP_S
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.results import ResidualPlot
from vehicle.model.effects import ANGLE, CATALOGUE, CRAB, DIRECTION, SPEED, TURN
from vehicle.records import GRAVITY_MPS2


def build_unit_problem() -> Any:
    """Unit noise, and windows that all count."""
    noise = SimpleNamespace(whiten=lambda values: values, compute_weights=lambda white: np.ones(len(white)))
    return SimpleNamespace(noise={"wheel": noise})


def plot_effect(problem: Problem, name: str) -> tuple[ResidualPlot, Fit]:
    """The plot of an effect and its fit, with the nuisances at zero before and after."""
    hypothesis = build_hypothesis(problem, name)
    base = Fit((), np.empty(0), 0.0, problem.compute_residuals((), np.empty(0)), np.eye(0))
    fit = problem.refit((hypothesis,), np.zeros(1))
    plot = build_residual_plot(problem, base, fit, name)
    assert plot is not None
    return plot, fit


def test_in_white_noise_bins_are_means_with_the_larger_of_two_errors() -> None:
    rng = np.random.default_rng(3)
    residuals = rng.normal(size=(2, 40))
    bins = np.arange(40) // 20
    design = np.stack([np.stack([np.diag(bins == number) @ np.ones(40) for number in (0, 1)], axis=1)] * 2)
    means, errors = estimate_bins(build_unit_problem(), "wheel", design, residuals)
    for number in (0, 1):
        inside = residuals[:, bins == number]
        assert means[number] == pytest.approx(inside.mean())
        scatter = np.sqrt((((inside - inside.mean()).sum(axis=1) / 40.0) ** 2).sum())
        assert errors[number] == pytest.approx(max(1.0 / np.sqrt(40.0), scatter))


def test_windows_that_differ_widen_the_error() -> None:
    residuals = np.repeat([[-3.0], [3.0]], 40, axis=1)
    means, errors = estimate_bins(build_unit_problem(), "wheel", np.ones((2, 40, 1)), residuals)
    assert means[0] == pytest.approx(0.0) and errors[0] == pytest.approx(3.0 / np.sqrt(2.0))


def test_bins_are_filled_and_reach_what_few_cells_reach() -> None:
    every = np.ones(1200, dtype=np.bool_)
    even = number_bins(np.linspace(0.0, 1.0, 1200), every)
    assert np.bincount(even).tolist() == pytest.approx([100] * CURVE_BINS, abs=1)
    few = number_bins(np.concatenate([np.zeros(1180), np.linspace(0.5, 1.0, 20)]), every)
    assert len(np.unique(few[:1180])) == 1 and len(np.unique(few[1180:])) >= 3
    assert len(np.unique(number_bins(np.zeros(1200), every))) == 1
    assert set(number_bins(np.zeros(4), np.array([True, False, True, False]))[[1, 3]]) == {-1}


def test_every_effect_has_a_plot_and_laws_are_plotted_against_what_they_depend_on() -> None:
    for entry in CATALOGUE:
        assert entry.plot[0] in QUANTITIES and entry.plot[1] in REGRESSORS and select_axes(entry.id) == entry.plot
    assert select_axes("steering_gain@by_speed") == (TURN, SPEED)
    assert select_axes("steering_gain@by_run:2") == (TURN, ANGLE)
    assert select_axes("push") == (CRAB, DIRECTION) and select_axes("wheel_sensor_scale") == (TURN, ANGLE)


@pytest.mark.parametrize("has_heading", [True, False])
def test_an_offset_turns_the_tractor_evenly_until_it_is_known(has_heading: bool) -> None:
    """Straight ahead the tractor turns as the measured heading does: heading or not, within two standard errors."""
    effects = {"steering_offset": {"angle_deg": 1.0}}
    rate = -np.degrees(
        np.gradient(build_drive_problem("there-and-back", effects).data.path["heading"], PATH_STEP_S)[300]
    )
    plot, _ = plot_effect(build_drive_problem("there-and-back", effects, has_heading), "steering_offset")
    assert (plot.quantity, plot.regressor) == ("remaining turning rate, deg/s", "wheel angle, deg")
    assert rate > 0.2 and (np.abs(plot.before - rate) < 2.0 * plot.before_error).all()
    assert (plot.before > 4.0 * plot.before_error).all() and np.abs(plot.after).max() < 0.1 * rate
    assert plot.limit is None


def test_an_antenna_further_ahead_turns_the_course_by_the_turning_rate() -> None:
    """The angle from heading to course is the distance times the turning rate over the speed."""
    plot, _ = plot_effect(build_drive_problem("circles", {"antenna_forward": {"distance_m": 0.5}}), "antenna_forward")
    assert plot.regressor == "turning rate, deg/s" and np.abs(plot.regressor_values).min() > 5.0
    shown = 0.5 * plot.regressor_values / PACE_MPS
    assert (np.abs(plot.before - shown) < 2.0 * plot.before_error).all()
    assert plot.before == pytest.approx(shown, rel=0.15) and np.abs(plot.after).max() < 0.1 * np.abs(shown).max()


def test_a_limit_is_drawn_where_it_was_found() -> None:
    problem = build_drive_problem("bends-at-speeds", {"side_slip": {"limit_g": 0.04}})
    slip = build_hypothesis(problem, "side_slip")
    base, fit = fit_with(problem), problem.refit((slip,), np.array([20.0]))
    plot = build_residual_plot(problem, base, fit, "side_slip")
    assert plot is not None and plot.limit == pytest.approx(0.04 * GRAVITY_MPS2, rel=0.1)
    assert plot.regressor_values.max() > plot.limit


def test_what_was_not_measured_has_no_plot() -> None:
    blind = build_drive_problem("circles", {}, has_heading=False, has_wheel=False)
    base = fit_with(blind)
    assert build_residual_plot(blind, base, base, "heading_bias") is None
    assert build_residual_plot(blind, base, base, "steering_lag") is None
