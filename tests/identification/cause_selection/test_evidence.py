"""What runs that had no part say, and how sure coordinates are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.examples import count_examples
from tests.identification.residual_models import build_linear_model, eg105
from vehicle.identification.cause_selection.evidence import (
    _restrict_to_affected_channels,
    compute_small_sample_widening,
    estimate_held_out_losses,
    estimate_robust_covariance,
    is_helping_held_out,
    list_nameable_parts,
)
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit


@given(st.integers(0, 10**6))
@settings(max_examples=count_examples(20))
def test_held_out_losses_are_those_of_fits_without_the_run(seed: int) -> None:
    residual_model = build_linear_model(seed=seed, steering_offset=1.0)
    fit = refine_fit(residual_model, residual_model.fit("steering_offset"))
    column = residual_model.columns["steering_offset"]
    for run, loss in enumerate(estimate_held_out_losses(residual_model, fit)):
        others, mine = residual_model.residual_runs != run, residual_model.residual_runs == run
        best = np.linalg.lstsq(column[others, None], -residual_model.base[others], rcond=None)[0]
        left = residual_model.base[mine] + column[mine] * best
        assert loss == pytest.approx(float(left @ left), rel=1e-4)


def test_without_coordinates_the_held_out_loss_is_the_loss() -> None:
    residual_model = build_linear_model()
    losses = estimate_held_out_losses(residual_model, residual_model.fit())
    assert losses == pytest.approx(
        [float(np.sum(residual_model.base[residual_model.residual_runs == run] ** 2)) for run in range(4)]
    )


def test_an_effect_of_all_runs_helps_and_none_does_not() -> None:
    residual_model = build_linear_model(steering_offset=1.0)
    assert is_helping_held_out(
        residual_model, residual_model.fit(), refine_fit(residual_model, residual_model.fit("steering_offset")), 12.0
    )
    clean = build_linear_model()
    assert not is_helping_held_out(clean, clean.fit(), refine_fit(clean, clean.fit("steering_offset")), 12.0)


def test_an_effect_of_one_run_helps_where_its_blocks_agree() -> None:
    residual_model = build_linear_model()
    alone = np.where(residual_model.residual_runs == 2, residual_model.columns["steering_offset"], 0.0)
    shown = replace(
        residual_model, base=residual_model.base - alone, columns=residual_model.columns | {"steering_offset": alone}
    )
    assert is_helping_held_out(shown, shown.fit(), refine_fit(shown, shown.fit("steering_offset")), 12.0)


def test_the_covariance_is_that_of_least_squares_and_wider_where_blocks_scatter() -> None:
    """With one coordinate: sum of squared block sides over the square of the sum of squares, or its inverse."""
    residual_model = build_linear_model()
    column = np.ones(len(residual_model.base))
    sides = np.array([3.0, -3.0] * 6)[residual_model.residual_blocks]
    fit = EffectFit(residual_model.fit("steering_offset").parts, sides, column[:, None])
    assert estimate_robust_covariance(residual_model, fit) == pytest.approx(12 * 30.0**2 / 120.0**2)
    calm = replace(fit, residuals=np.zeros(len(column)) + 1e-9)
    assert estimate_robust_covariance(residual_model, calm) == pytest.approx(1.0 / 120.0)


def test_a_scatter_of_few_pieces_is_students() -> None:
    """Quantiles of Student's distribution for 95 % of two and of eleven freedoms: 4.303 and 2.201."""
    for pieces, quantile in ((3, 4.303), (12, 2.201)):
        same = np.ones((pieces, 1, 1))
        wider = compute_small_sample_widening(same, np.array([[1.0 / pieces]]))
        assert wider == pytest.approx([quantile / 1.96 * (pieces / (pieces - 1)) ** 0.5], rel=1e-3)
    # A piece that tells next to nothing is no piece.
    unlike = compute_small_sample_widening(np.array([1.0, 1.0, 1.0, 1e-6]).reshape(4, 1, 1), np.array([[1.0 / 3.0]]))
    assert unlike == pytest.approx(compute_small_sample_widening(np.ones((3, 1, 1)), np.array([[1.0 / 3.0]])), rel=1e-4)


def test_bent_slopes_of_others_do_not_decide_where_an_effect_does_not_reach() -> None:
    """Columns of an effect in one channel: what another coordinate does in the others is no harm of it."""
    residual_model = build_linear_model(steering_offset=1.0)
    channel = np.arange(len(residual_model.base)) >= 4 * residual_model.dataset.rows
    mine = np.where(channel, residual_model.columns["steering_offset"], 0.0)
    shown = replace(residual_model, columns=residual_model.columns | {"steering_offset": mine})
    smaller = shown.fit("heading_bias", at=0.0)
    larger = refine_fit(shown, shown.fit("heading_bias", "steering_offset"))
    bent = replace(larger, jacobian=larger.jacobian * np.where(channel[:, None], 1.0, [[0.0, 1.0]]))
    spoilt = replace(bent, residuals=np.where(channel, bent.residuals, 3.0 * bent.residuals))
    assert is_helping_held_out(shown, smaller, spoilt, 12.0)


def test_what_is_empty_where_an_effect_does_not_reach_is_not_copied() -> None:
    residual_model = build_linear_model(steering_offset=1.0)
    channel = np.arange(len(residual_model.base)) >= 4 * residual_model.dataset.rows
    mine = np.where(channel, residual_model.columns["steering_offset"], 0.0)
    shown = replace(residual_model, columns=residual_model.columns | {"steering_offset": mine})
    smaller, larger = shown.fit(), shown.fit("steering_offset", at=0.5)
    for one in _restrict_to_affected_channels(shown, smaller, larger):
        assert np.array_equal(
            one.residuals, np.where(channel, shown.base if one.parts == () else larger.residuals, 0.0)
        )
    empty = replace(larger, residuals=np.where(channel, larger.residuals, 0.0))
    assert _restrict_to_affected_channels(shown, smaller, empty)[1] is empty


def test_a_name_takes_more_than_the_tolerance_and_clearly_more_than_nothing() -> None:
    """The tolerance of the offset is 0.12 degrees; the coordinate is sure to about 0.03 of them."""
    for value, nameable in ((1.0, True), (0.11, False), (0.2, True)):
        residual_model = build_linear_model(seed=3, steering_offset=value)
        named = list_nameable_parts(residual_model, residual_model.fit("steering_offset", at=value), eg105())
        assert named == (["steering_offset"] if nameable else [])
    residual_model = build_linear_model(seed=3)
    vague = {name: 0.05 * column for name, column in residual_model.columns.items()}
    blurred = replace(residual_model, columns=vague)
    assert not list_nameable_parts(blurred, blurred.fit("steering_offset", at=0.2), eg105())
