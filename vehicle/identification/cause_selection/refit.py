"""Variants of a fit: with one part more or less, with covariates, and with retuned weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import CandidateFit, Projector
from vehicle.identification.cause_selection.covariates import (
    ErrorCovariate,
    compute_covariate_columns,
    compute_tractor_difference_columns,
)
from vehicle.identification.fit.column_products import stack_columns
from vehicle.identification.fit.effect_parameters import collect_settings
from vehicle.identification.fit.residual_fit import EffectFit, FitPart, LinearTerms, add_linear_terms, refine_fit
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.rig import ReplayRig
from vehicle.identification.residuals.noise_weights import (
    build_filters,
    estimate_first_noise,
    estimate_soil_and_speed_noise,
)
from vehicle.identification.residuals.residual_model import ResidualModel, build_residual_model
from vehicle.identification.thresholds import EASING_FACTOR, MOST_EASINGS, WRONG_EVERYWHERE_LOSS
from vehicle.model.tractor import Settings

MOST_FIT_BYTES = 300_000_000  # chosen: eight parts and four dozen columns of a quarter of an hour, a sixth of 2 GB


def add_candidate(residual_model: ResidualModel, fit: EffectFit, candidate: CandidateFit) -> EffectFit:
    """Return the fit with a fitted candidate added, not yet refined."""
    return add_part(residual_model, fit, (candidate.parameters, candidate.coordinates))


def add_part(residual_model: ResidualModel, fit: EffectFit, part: FitPart) -> EffectFit:
    """Return the fit with a part added, not yet refined."""
    parts = (*fit.parts, part)
    residuals = residual_model.compute_residuals(collect_settings(list(parts)))
    return EffectFit(
        parts, add_linear_terms(residuals, fit.linear_terms), np.zeros((len(residuals), 0)), fit.linear_terms
    )


def refit_with_covariates(
    residual_model: ResidualModel, fit: EffectFit, unnamed: tuple[ErrorCovariate, ...]
) -> EffectFit:
    """Fit the amounts of covariates, in addition to the unknowns of any tractor.

    The fit without any is cached: see refit_without.
    """
    if unnamed:
        return refit_with_new_weights(residual_model, fit.parts, unnamed)
    return _get_or_make_smaller_fit(
        residual_model, fit, "", lambda: refit_with_new_weights(residual_model, fit.parts, ())
    )


def refit_with_new_weights(
    residual_model: ResidualModel, parts: tuple[FitPart, ...], unnamed: tuple[ErrorCovariate, ...] | None
) -> EffectFit:
    """As refit_with_covariates, for parts of a fit on a residual model with other weights."""
    residuals = residual_model.compute_residuals(collect_settings(list(parts)))
    bare_fit = EffectFit(parts, residuals, np.zeros((len(residuals), 0)))
    unknown_columns = compute_tractor_difference_columns(residual_model, bare_fit)
    column_sets = [
        unknown_columns,
        *[compute_covariate_columns(residual_model, bare_fit, covariate) for covariate in unnamed or ()],
    ]
    linear_columns = stack_columns([column for covariate in column_sets for column in covariate.T], len(residuals))
    extra = LinearTerms(linear_columns, np.zeros(linear_columns.shape[1]), unknown_columns.shape[1])
    return refine_fit(residual_model, EffectFit(parts, residuals, bare_fit.jacobian, extra))


def reweigh_residual_model(residual_model: ResidualModel, fit: EffectFit) -> ResidualModel:
    """Return the residual model with noise and weights from the residuals of the fit."""
    weighted = build_weighted_residual_model(residual_model.dataset, residual_model.rig, fit.settings)
    return replace(
        residual_model,
        noise=weighted.noise,
        filters=weighted.filters,
        wheel=weighted.wheel,
        speed=weighted.speed,
    )


def build_weighted_residual_model(dataset: DriveDataset, rig: ReplayRig, settings: Settings) -> ResidualModel:
    """Return a residual model with noise and weights from the residuals with these effects."""
    noise = estimate_soil_and_speed_noise(dataset, rig, estimate_first_noise(dataset), settings)
    eased_model = build_residual_model(dataset, rig, settings, noise)
    for _ in range(MOST_EASINGS):
        # A model that is wrong everywhere, as of another kind of vehicle, must not be judged by millimetres: with less
        # weight on each measurement, longer distances count.
        path = eased_model.compute_path_residuals(eased_model.simulate_increments(settings), settings)
        if float(np.mean(path * path)) < WRONG_EVERYWHERE_LOSS:
            break
        wider_sigmas = {name: EASING_FACTOR * getattr(eased_model.noise, name) for name in ("position", "heading")}
        wide_noise = replace(eased_model.noise, **wider_sigmas)
        eased_model = replace(eased_model, noise=wide_noise, filters=build_filters(dataset, rig, wide_noise, settings))
    return eased_model


def refit_without(residual_model: ResidualModel, fit: EffectFit, name: str) -> EffectFit:
    """The fit refitted without one of its parts, found once where all such fits take no more than KEPT_BYTES."""
    parts = tuple(part for part in fit.parts if part[0].id != name)

    def refit() -> EffectFit:
        residuals = add_linear_terms(residual_model.compute_residuals(collect_settings(list(parts))), fit.linear_terms)
        return refine_fit(residual_model, EffectFit(parts, residuals, np.zeros((len(residuals), 0)), fit.linear_terms))

    return _get_or_make_smaller_fit(residual_model, fit, name, refit)


def _get_or_make_smaller_fit(
    residual_model: ResidualModel, fit: EffectFit, name: str, make_fit: Callable[[], EffectFit]
) -> EffectFit:
    """A fit without a part, or without the unnamed terms, where there is room made once."""
    if (residual_model, name) in fit.smaller_fits:
        return fit.smaller_fits[residual_model, name]
    smaller = make_fit()
    if len(fit.parts) * fit.jacobian.nbytes <= MOST_FIT_BYTES:
        fit.smaller_fits[residual_model, name] = smaller
    return smaller


def compute_unnamed_gain(fit: EffectFit) -> float:
    """Return the loss that the covariates remove, with the other coordinates following."""
    if fit.linear_terms is None:
        return 0.0
    terms = fit.linear_terms.term_columns
    first = fit.jacobian.shape[1] - fit.linear_terms.columns.shape[1]
    projector = Projector(fit.jacobian[:, : first + terms.start])
    removed = projector(fit.linear_terms.columns[:, terms] @ fit.linear_terms.amounts[terms])
    return float(removed @ removed)
