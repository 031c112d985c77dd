"""Fits to residuals against least squares, and one against an effect that the simulator itself drove."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import count_examples
from tests.identification.residual_models import build_linear_model, build_programme_model, get_parameters
from vehicle.identification.fit.residual_fit import (
    EffectFit,
    LinearTerms,
    add_linear_terms,
    compute_fit_jacobian,
    flatten,
    make_empty_fit,
    refine_fit,
    sum_normal_equations_by_block,
)


@given(st.integers(0, 10**6))
@settings(max_examples=count_examples(20))
def test_a_linear_model_is_fitted_by_least_squares(seed: int) -> None:
    residual_model = build_linear_model(seed=seed, steering_offset=1.2, heading_bias=-2.0)
    fit = refine_fit(residual_model, residual_model.fit("steering_offset", "heading_bias"))
    columns = np.stack([residual_model.columns["steering_offset"], residual_model.columns["heading_bias"]], axis=1)
    exact, (loss,), *_ = np.linalg.lstsq(columns, -residual_model.base, rcond=None)
    assert flatten([at for _, at in fit.parts]) == pytest.approx(exact, abs=1e-4)
    assert fit.loss == pytest.approx(loss, rel=1e-6)
    assert fit.jacobian == pytest.approx(columns, abs=1e-8)


def test_only_the_block_of_the_moved_effect_is_simulated_for_a_slope() -> None:
    residual_model = build_linear_model()
    compute_fit_jacobian(residual_model, residual_model.fit("steering_offset", "heading_bias"))
    assert residual_model.requests == [frozenset({"wheel to path"}), frozenset({"position to antenna"})]


def test_linear_terms_without_a_name_are_fitted_along() -> None:
    residual_model = build_linear_model(steering_offset=1.0)
    column = np.random.default_rng(5).standard_normal(len(residual_model.base))
    hidden = replace(residual_model, base=residual_model.base - 0.7 * column)
    start = replace(hidden.fit("steering_offset"), linear_terms=LinearTerms(column[:, None], np.zeros(1)))
    fit = refine_fit(hidden, start)
    both = np.stack([residual_model.columns["steering_offset"], column], axis=1)
    exact = np.linalg.lstsq(both, -hidden.base, rcond=None)[0]
    assert fit.linear_terms is not None
    assert [float(fit.parts[0][1][0]), float(fit.linear_terms.amounts[0])] == pytest.approx(exact, abs=1e-4)
    assert fit.jacobian == pytest.approx(both, abs=1e-8)
    bare = hidden.compute_residuals(fit.settings)
    assert fit.residuals == pytest.approx(add_linear_terms(bare, fit.linear_terms), abs=1e-9)
    assert add_linear_terms(bare, None) is bare


def test_a_fit_of_nothing_is_left_as_it_is() -> None:
    residual_model = build_linear_model()
    fit = make_empty_fit(residual_model)
    assert refine_fit(residual_model, fit) is fit and fit.jacobian.shape == (len(residual_model.base), 0)
    assert fit.loss == pytest.approx(float(np.sum(residual_model.base**2)))


def test_columns_belong_to_their_effects() -> None:
    parts = tuple(
        (get_parameters(name), np.zeros(get_parameters(name).count))
        for name in ("steering_offset", "cross_slope_drift")
    )
    fit = EffectFit(parts, np.zeros(3), np.zeros((3, 3)))
    assert fit.find_columns("steering_offset") == slice(0, 1) and fit.find_columns("cross_slope_drift") == slice(1, 3)
    with pytest.raises(KeyError):
        fit.find_columns("wheel_slip")


def test_sums_over_blocks_add_up_to_the_whole() -> None:
    residual_model = build_linear_model()
    fit = residual_model.fit("steering_offset", "heading_bias")
    sums = sum_normal_equations_by_block(residual_model, fit.jacobian, fit.residuals)
    assert sums.squares.sum(axis=0) == pytest.approx(fit.jacobian.T @ fit.jacobian)
    assert sums.sides.sum(axis=0) == pytest.approx(fit.jacobian.T @ fit.residuals)
    assert sums.losses.sum() == pytest.approx(fit.loss)
    assert sums.losses[0] == pytest.approx(float(np.sum(residual_model.base[:10] ** 2)))


def test_what_the_simulator_drove_is_fitted_to_its_value() -> None:
    residual_model = build_programme_model(
        "circles", {"steering_offset": {"angle_deg": 1.0}, "heading_bias": {"angle_deg": -1.5}}
    )
    start = EffectFit(
        tuple((get_parameters(name), np.zeros(1)) for name in ("steering_offset", "heading_bias")),
        residual_model.compute_residuals({}),
        np.zeros((5 * residual_model.dataset.rows, 0)),
    )
    fit = refine_fit(residual_model, start)
    assert flatten([at for _, at in fit.parts]) == pytest.approx([1.0, -1.5], abs=0.01)
    assert fit.loss < 0.05 * start.loss


def test_vectors_one_after_another() -> None:
    assert flatten([(1.0, 2.0), np.array([3.0])]).tolist() == [1.0, 2.0, 3.0] and flatten([]).shape == (0,)
