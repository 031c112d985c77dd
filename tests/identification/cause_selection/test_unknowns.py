"""What differs from tractor to tractor is free in every fit, as far as tractors differ in it."""

import numpy as np
import pytest

from tests.identification.residual_models import build_programme_model, get_parameters
from vehicle.identification.cause_selection.covariates import compute_tractor_difference_columns
from vehicle.identification.cause_selection.refit import refit_with_new_weights
from vehicle.identification.fit.residual_fit import make_empty_fit
from vehicle.identification.residuals.residual_model import ResidualModel


@pytest.fixture(scope="module")
def residual_model() -> ResidualModel:
    return build_programme_model("circles", {})


def test_an_amount_of_one_residuals_the_first_rows_by_one(residual_model: ResidualModel) -> None:
    columns = compute_tractor_difference_columns(residual_model, make_empty_fit(residual_model))
    ends = np.cumsum([3 * one.rows for one in residual_model.dataset.segments])
    starts = [int(end) - 3 * one.rows for end, one in zip(ends, residual_model.dataset.segments, strict=True)]
    firsts = np.concatenate([np.arange(start, start + 3) for start in starts])
    assert (columns[firsts] ** 2).sum(axis=0) == pytest.approx([1.0, 1.0, 1.0])
    assert residual_model.compute_residuals({})[firsts] == pytest.approx(np.zeros(len(firsts)))
    assert not columns[3 * residual_model.dataset.rows :].any()  # wheel angle and speed are no part of it


def test_a_turn_that_comes_earlier_is_a_wheel_angle_ahead_of_its_time(residual_model: ResidualModel) -> None:
    """The second column is the derivative of the turn: nothing while the tractor circles evenly."""
    column = compute_tractor_difference_columns(residual_model, make_empty_fit(residual_model))[
        : 3 * residual_model.dataset.rows, 1
    ].copy()
    column[:3] = 0.0
    first = residual_model.dataset.segments[0]
    size = np.abs(column[: 3 * first.rows]).reshape(-1, 3).sum(axis=1)
    steady = np.abs(np.gradient(np.gradient(first.heading, first.time), first.time)) < 1e-3
    assert size[~steady].max() > 5.0 * np.median(size[steady])


def test_a_fit_without_effects_has_them_and_an_effect_is_told_beside_them() -> None:
    hidden = build_programme_model("circles", {"steering_offset": {"angle_deg": 1.0}})
    plain = refit_with_new_weights(hidden, (), None)
    assert (
        plain.linear_terms is not None and plain.linear_terms.unknown_count == plain.linear_terms.columns.shape[1] == 3
    )
    assert np.all(np.abs(plain.linear_terms.amounts) < 3.0)
    fit = refit_with_new_weights(hidden, ((get_parameters("steering_offset"), np.zeros(1)),), None)
    assert fit.settings["steering_offset"]["angle_deg"] == pytest.approx(1.0, abs=0.02)
    assert fit.linear_terms is not None and np.all(np.abs(fit.linear_terms.amounts) < 0.2)
