"""The plot that shows a cause: bins by hand, and the residual of a known offset."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model
from vehicle.identification.cause_selection.covariates import ErrorCovariate
from vehicle.identification.verdict.residual_curves import (
    _QUANTITIES,
    _REGRESSORS,
    CURVE_BINS,
    _bin_residuals,
    _select_inner_rows,
    build_residual_plot,
)
from vehicle.model.effects import CATALOGUE

# Ten rows a second, so that a bin of 100 rows has ten independent ones.
TEN_HZ = SimpleNamespace(dataset=SimpleNamespace(rows=1200, seconds=120.0))


def test_bins_hold_means_and_their_errors() -> None:
    at = np.repeat(np.arange(12.0), 100)
    before = at * 2.0 + np.tile([1.0, -1.0], 600)
    plot = _bin_residuals("x", "y", at, before, 0.0 * at, TEN_HZ)
    assert plot is not None and plot.regressor == "x" and plot.quantity == "y"
    whole = plot.regressor_values[:-2]
    assert len(plot.regressor_values) <= CURVE_BINS and whole == pytest.approx(np.arange(len(whole)), abs=1.0)
    assert plot.before == pytest.approx(2.0 * plot.regressor_values)
    assert plot.before_error[0] == pytest.approx(1.0 / np.sqrt(10.0)) and not plot.after.any()


def test_one_value_and_two_values_are_bins_as_well() -> None:
    one = _bin_residuals("x", "y", np.full(100, 3.0), np.ones(100), np.zeros(100), TEN_HZ)
    assert one is not None and one.regressor_values.tolist() == [3.0] and one.before.tolist() == [1.0]
    two = np.repeat([0.0, 1.0], 100)
    plot = _bin_residuals("x", "y", two, two, 0.0 * two, TEN_HZ)
    assert plot is not None and plot.regressor_values.tolist() == [0.0, 1.0] and plot.before.tolist() == [0.0, 1.0]


def test_too_few_rows_are_no_plot() -> None:
    assert _bin_residuals("x", "y", np.arange(49.0), np.zeros(49), np.zeros(49), TEN_HZ) is None


def test_every_effect_has_a_plot() -> None:
    for entry in CATALOGUE:
        assert entry.plot[0] in _QUANTITIES and entry.plot[1] in _REGRESSORS


def test_an_offset_turns_the_tractor_evenly_until_it_is_known() -> None:
    """Straight ahead at 1.4 m/s: what is left of the turning rate is the speed times the curvature of the offset."""
    truth = {"steering_offset": {"angle_deg": 1.0}}
    residual_model = build_programme_model("there-and-back", truth)
    plot = build_residual_plot(residual_model, {0: truth, 1: truth}, ["steering_offset"], ())
    assert plot is not None
    assert (plot.quantity, plot.regressor) == ("remaining turning rate, deg/s", "wheel angle, deg")
    segment = residual_model.dataset.segments[0]
    rate = -np.degrees(np.gradient(segment.heading, segment.time))[50:150].mean()
    assert rate > 0.1 and plot.before == pytest.approx(rate, rel=0.1) and np.abs(plot.after).max() < 0.02 * rate


def test_an_unnamed_dependence_is_plotted_against_what_it_depends_on() -> None:
    residual_model = build_programme_model("four-ways", {"discrepancy_model": {"push_to_east": 0.05}})
    push = ErrorCovariate("the direction of travel and the driving time", "a push over the ground", lambda s, m, b: [])
    nothing: dict[int, dict[str, dict[str, float]]] = {run: {} for run in range(4)}
    plot = build_residual_plot(residual_model, nothing, (), (push,))
    assert plot is not None and plot.regressor == "direction of travel, deg from north"
    assert plot.quantity == "remaining angle between heading and course, deg"
    grip = ErrorCovariate("the implement", "a change of grip", lambda s, m, b: [])
    other = build_residual_plot(residual_model, nothing, (), (grip,))
    assert other is not None and other.regressor == "wheel angle, deg"
    assert build_residual_plot(residual_model, nothing, (), ()) is None


def test_rows_in_motion_away_from_the_ends_count() -> None:
    time = np.arange(0.0, 5.0, 0.5)
    segment = SimpleNamespace(time=time, speed_in_gear=np.where(time < 3.0, 1.4, 0.1))
    assert time[_select_inner_rows(segment)].tolist() == [1.5, 2.0, 2.5]


def test_bins_of_a_limit_reach_it_though_few_rows_are_there() -> None:
    rng = np.random.default_rng(4)
    at = np.concatenate([rng.uniform(-0.1, 0.1, 900), rng.uniform(0.6, 0.7, 10), rng.uniform(-0.7, -0.6, 10)])
    by_rows, to_limit = (_bin_residuals("x", "y", at, at, at, TEN_HZ, limit) for limit in (None, 0.7))
    assert by_rows is not None and to_limit is not None
    assert by_rows.regressor_values[-1] < 0.5 and by_rows.limit is None
    assert to_limit.regressor_values[-1] > 0.6 and to_limit.regressor_values[0] < -0.6 and to_limit.limit == 0.7
