"""One more effect on top of a fit, and how far above chance it stands."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.identification.residual_models import build_linear_model, get_parameters
from vehicle.identification.cause_selection.candidate_fit import (
    CandidateFit,
    Projector,
    compute_strengths,
    fit_candidate,
)
from vehicle.identification.thresholds import FAR_LESS_SHARE, LEAST_PREDICTED_GAIN


def left_by(columns: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """What a least-squares fit leaves of a vector."""
    return vector - columns @ np.linalg.lstsq(columns, vector, rcond=None)[0]


@given(st.integers(0, 10**6))
def test_a_projector_leaves_what_least_squares_leaves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, vector = rng.standard_normal((20, 3)) * [1.0, 1e-3, 1e3], rng.standard_normal(20)
    project = Projector(columns)
    assert project(vector) == pytest.approx(left_by(columns, vector), abs=1e-9)
    assert project(project(vector)) == pytest.approx(project(vector), abs=1e-9)
    assert Projector(columns[:, [0, 0]])(vector) == pytest.approx(left_by(columns[:, :1], vector), abs=1e-6)
    assert Projector(np.zeros((20, 0)))(vector) is vector


@given(st.integers(0, 10**6))
def test_an_effect_takes_away_what_least_squares_takes_beyond_the_fit(seed: int) -> None:
    residual_model = build_linear_model(seed=seed, steering_offset=1.0, heading_bias=-2.0)
    fit = residual_model.fit("heading_bias")
    project = Projector(fit.jacobian)
    one = fit_candidate(residual_model.compute_changes, fit, get_parameters("steering_offset"), project)
    both = np.stack([residual_model.columns["heading_bias"], residual_model.columns["steering_offset"]], axis=1)
    alone, together = left_by(both[:, :1], fit.residuals), left_by(both, fit.residuals)
    assert one.gain == pytest.approx(float(alone @ alone - together @ together), rel=1e-6)
    assert one.coordinates == pytest.approx(np.linalg.lstsq(both, -residual_model.base, rcond=None)[0][1:], abs=1e-4)
    assert np.abs(residual_model.columns["heading_bias"] @ one.columns).max() < 1e-6


def test_what_promises_nothing_is_simulated_once() -> None:
    residual_model = build_linear_model()
    fit = residual_model.fit()
    residual_model.requests.clear()
    one = fit_candidate(residual_model.compute_changes, fit, get_parameters("steering_offset"), Projector(fit.jacobian))
    assert (
        residual_model.requests == [frozenset({"wheel to path"})]
        and one.gain == 0.0
        and one.coordinates.tolist() == [0.0]
    )


def test_what_promises_far_less_than_others_is_only_begun() -> None:
    residual_model = build_linear_model(steering_offset=5.0)
    fit = residual_model.fit()
    whole, begun, near = (
        fit_candidate(
            residual_model.compute_changes, fit, get_parameters("steering_offset"), Projector(fit.jacobian), worth
        )
        for worth in (0.0, 1e6, 1.0)
    )
    assert whole.is_finished and near.is_finished and near.gain == whole.gain > LEAST_PREDICTED_GAIN
    assert not begun.is_finished and begun.gain == 0.0 and begun.coordinates.tolist() == [0.0]
    less = fit_candidate(
        residual_model.compute_changes,
        fit,
        get_parameters("steering_offset"),
        Projector(fit.jacobian),
        0.9 * whole.gain / FAR_LESS_SHARE,
    )
    assert less.is_finished and less.gain == whole.gain
    nothing = build_linear_model()
    hopeless = fit_candidate(
        nothing.compute_changes,
        nothing.fit(),
        get_parameters("steering_offset"),
        Projector(nothing.fit().jacobian),
        1e6,
    )
    assert hopeless.is_finished, "what is hopeless by itself would come to no more"


def test_strength_is_the_gain_where_blocks_scatter_as_noise_does() -> None:
    """Every block leaves as much as noise or less: the scatter is that of the noise, and the strength the gain."""
    residual_model = build_linear_model(steering_offset=5.0)
    column = residual_model.columns["steering_offset"][:, None]
    left = np.zeros(len(residual_model.base))
    (strength,), chance = compute_strengths(
        residual_model, [CandidateFit(get_parameters("steering_offset"), np.array([5.0]), 80.0, column)], left
    )
    assert strength == pytest.approx(80.0) and chance == 0.0


def test_blocks_that_disagree_take_strength_away_and_chance_is_theirs() -> None:
    """One column, one number a block: the scatter is the sum of their squares."""
    residual_model = build_linear_model()
    column = np.ones(len(residual_model.base))
    sides = np.array([3.0, -3.0] * 6)
    left = sides[residual_model.residual_blocks]
    one = CandidateFit(get_parameters("steering_offset"), np.array([1.0]), 50.0, column[:, None])
    (strength,), chance = compute_strengths(residual_model, [one], left)
    square, scatter = 120.0, float(np.sum((10.0 * sides) ** 2))
    assert strength == pytest.approx(50.0 * square / scatter)
    assert 0.0 < chance <= 12.0  # twelve blocks of the same sign are the most that signs can do
    assert compute_strengths(
        residual_model, [CandidateFit(one.parameters, one.coordinates, 50.0, np.zeros((120, 1)))], left
    ) == ([0.0], 0.0)
