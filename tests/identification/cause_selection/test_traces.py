"""Traces: what they promise in the place of a part is what a trial there takes away, where lines are straight."""

from typing import Any

import numpy as np
import pytest

from tests.identification.residual_models import build_linear_model, build_programme_model, eg105, get_parameters
from vehicle.identification.cause_selection.candidate_fit import EffectTraces, Projector, fit_candidate, predict_gain
from vehicle.identification.cause_selection.challenge import challenge_causes
from vehicle.identification.cause_selection.refit import refit_with_new_weights, refit_without
from vehicle.identification.fit.residual_fit import refine_fit
from vehicle.identification.thresholds import FAR_LESS_SHARE


def test_a_competitor_is_hopeless_where_a_trial_would_gain_far_less() -> None:
    residual_model: Any = build_linear_model(steering_offset=1.0, heading_bias=-2.0)
    residual_model.columns["grip_drift"] += 0.5 * residual_model.columns["heading_bias"]
    fit = refine_fit(residual_model, residual_model.fit("steering_offset", "heading_bias"))
    rest, competitor = refit_without(residual_model, fit, "heading_bias"), get_parameters("grip_drift")
    assert refit_without(residual_model, fit, "heading_bias") is rest, "asked again it is not fitted again"
    project, traces = (
        Projector(rest.jacobian),
        EffectTraces(residual_model.compute_changes, fit, residual_model.compute_residuals(fit.settings)),
    )
    gain = fit_candidate(residual_model.compute_changes, rest, competitor, project).gain
    asked, left = len(residual_model.requests), project(rest.residuals)
    assert not traces.is_hopeless(left, project, competitor, 0.99 * gain / FAR_LESS_SHARE)
    assert traces.is_hopeless(left, project, competitor, 1.01 * gain / FAR_LESS_SHARE)
    assert len(residual_model.requests) <= asked + len(competitor.starts), (
        "simulated once, however often it is asked for"
    )


def test_products_of_what_a_projector_leaves() -> None:
    rng = np.random.default_rng(4)
    slope, columns, left = rng.standard_normal((30, 3)), rng.standard_normal((30, 2)), rng.standard_normal(30)
    project = Projector(slope)
    alone = np.stack([project(one) for one in columns.T], axis=1)
    assert project.multiply_columns(columns) == pytest.approx(alone.T @ alone, abs=1e-9)
    exact = np.linalg.lstsq(alone, left, rcond=None)[0]
    assert predict_gain(alone.T @ alone, alone.T @ left) == pytest.approx(float((alone.T @ left) @ exact), rel=1e-6)


def test_with_two_parts_the_stand_in_still_gives_way() -> None:
    """As with one part (test_challenge), beside a second one that is true: traces leave the better competitor in."""
    residual_model = build_programme_model(
        "circles", {"steering_offset": {"angle_deg": 1.0}, "heading_bias": {"angle_deg": -1.5}}
    )
    parts = (
        (get_parameters("steering_asymmetry"), np.array([0.9])),
        (get_parameters("heading_bias"), np.array([-1.5])),
    )
    outcome = challenge_causes(residual_model, refit_with_new_weights(residual_model, parts, None), (), eg105())
    assert outcome.better_fit is not None and set(outcome.better_fit.settings) == {"steering_offset", "heading_bias"}
