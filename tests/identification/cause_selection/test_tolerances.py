"""Tolerances of the tractor file as an error of values, and effects that they may look like."""

from __future__ import annotations

import numpy as np
import pytest

from tests.identification.residual_models import DRAFT_PER_M, build_draft_model, build_programme_model, get_parameters
from vehicle.identification.cause_selection.evidence import estimate_robust_covariance
from vehicle.identification.cause_selection.refit import add_part, refit_with_new_weights
from vehicle.identification.cause_selection.tolerances import (
    estimate_crab_covariance,
    estimate_form_covariance,
    estimate_run_variances,
    estimate_tolerance_covariance,
    estimate_value_covariance,
    is_within_tolerances,
)
from vehicle.identification.fit.residual_fit import EffectFit, make_empty_fit, refine_fit
from vehicle.identification.model_extension.tractor_extension import build_fit_extension
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import DIFFERENCE_FORM_SHARE
from vehicle.model.effect_kinds import INTERVAL_SIGMAS


def _fit_alone(model: ResidualModel, name: str) -> EffectFit:
    parameters = get_parameters(name)
    start = np.array(parameters.neutral) + 0.5 * np.array(parameters.typical)
    return refine_fit(model, add_part(model, refit_with_new_weights(model, (), None), (parameters, start)))


@pytest.mark.parametrize("ratio, is_open", [(1.005, True), (1.08, False)])
def test_a_gain_as_small_as_the_tolerance_of_radii_is_open(ratio: float, is_open: bool) -> None:
    model = build_programme_model("circles", {"steering_gain": {"ratio": ratio}})
    assert is_within_tolerances(model, _fit_alone(model, "steering_gain"), "steering_gain") is is_open


def test_on_a_circle_to_one_side_tolerances_leave_an_offset_more_open_than_on_both() -> None:
    """An offset of the wheels and a gain look alike on one circle; a circle to the other side tells them apart."""
    one, both = (
        build_programme_model(name, {"steering_offset": {"angle_deg": 1.0}}) for name in ("two-speeds", "circles")
    )
    sigmas = []
    for model in (one, both):
        fit = _fit_alone(model, "steering_offset")
        place = fit.find_columns("steering_offset")
        sigmas.append(float(np.sqrt(estimate_tolerance_covariance(model, fit)[place, place][0, 0])))
    assert sigmas[0] > 1.5 * sigmas[1] > 0.0


def test_an_interval_is_never_narrower_for_tolerances_and_scatter_of_runs() -> None:
    model = build_programme_model("circles", {"steering_gain": {"ratio": 1.08}})
    fit = _fit_alone(model, "steering_gain")
    robust = np.diag(estimate_robust_covariance(model, fit, widen_for_few=True))
    assert np.all(np.diag(estimate_value_covariance(model, fit)) >= robust * (1.0 - 1e-9))
    assert np.all(estimate_run_variances(model, fit) >= 0.0)


def test_without_parts_tolerances_shift_nothing() -> None:
    model = build_programme_model("circles", {})
    assert estimate_tolerance_covariance(model, make_empty_fit(model)).shape == (0, 0)


def test_half_of_the_shift_by_differences_between_tractors_is_in_doubt() -> None:
    """With all columns but those of the differences, the value moves by what they take up."""
    model = build_programme_model("circles", {"understeer": {"deg_per_mps2": 2.0}})
    fit = _fit_alone(model, "understeer")
    assert fit.linear_terms is not None
    columns, amounts = fit.linear_terms.columns[:, : fit.linear_terms.unknown_count], fit.linear_terms.amounts
    place = fit.find_columns("understeer")
    alone = fit.jacobian[:, place]
    shifts = [
        float((alone.T @ column * amount / (alone.T @ alone)).item())
        for column, amount in zip(columns.T, amounts, strict=True)
    ]
    expected = DIFFERENCE_FORM_SHARE**2 * float(np.sum(np.square(shifts)))
    assert expected > 0.0
    assert estimate_form_covariance(fit)[place, place].item() == pytest.approx(expected, rel=1e-6)


def test_a_fit_without_differences_between_tractors_has_none_in_doubt() -> None:
    model = build_programme_model("circles", {})
    assert estimate_form_covariance(make_empty_fit(model)).shape == (0, 0)


DRAFT = "implement_side_draft"


@pytest.mark.parametrize("rear", [0.1, 0.5, 1.0, 20.0])
def test_a_side_draft_is_as_uncertain_as_the_crab_under_it(rear: float) -> None:
    """From a rear axle that hardly holds to one that hardly slides; without noise the crab is all that is wrong."""
    model = build_draft_model("implement-lifted", rear)
    fit = _fit_alone(model, DRAFT)
    place = fit.find_columns(DRAFT)
    sigma = float(np.sqrt(estimate_crab_covariance(model, fit)[place, place].item()))
    assert abs(fit.settings[DRAFT]["curvature_per_m"] - DRAFT_PER_M) < INTERVAL_SIGMAS * sigma
    low, high = build_fit_extension(model, fit, {DRAFT}).intervals[DRAFT]["curvature_per_m"]
    assert high - low > 2.0 * INTERVAL_SIGMAS * sigma


def test_a_crab_unlike_the_stated_one_widens_the_interval() -> None:
    sigmas = []
    for rear in (1.0, 20.0):
        model = build_draft_model("implement-lifted", rear)
        fit = _fit_alone(model, DRAFT)
        place = fit.find_columns(DRAFT)
        sigmas.append(float(np.sqrt(estimate_crab_covariance(model, fit)[place, place].item())))
    assert sigmas[1] > 1.3 * sigmas[0]


def test_without_a_side_draft_no_crab_is_in_doubt() -> None:
    model = build_programme_model("circles", {"steering_gain": {"ratio": 1.08}})
    assert not estimate_crab_covariance(model, _fit_alone(model, "steering_gain")).any()
