"""Whether a fit has a cause: its effect on held-out runs, and the uncertainty of its coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from vehicle.identification.fit.column_products import multiply_columns
from vehicle.identification.fit.effect_parameters import EffectParameters, find_finest_size
from vehicle.identification.fit.residual_fit import EffectFit, sum_normal_equations_by_block
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    CLEAR_SIGMAS,
    CONCERNED_LOSS,
    FEW_RUNS,
    FEW_RUNS_GAIN_SHARE,
    FEWEST_HELPED,
    HARM_SHARE,
    HELD_OUT_SHARE,
    HELPED_LOSS,
    LEAST_HELPED_SHARE,
)
from vehicle.model.effect_kinds import INTERVAL_COVERAGE, INTERVAL_SIGMAS
from vehicle.model.tractor import Tractor


def estimate_held_out_losses(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the loss of every run with coordinates from the other runs, by one step from the common fit."""
    runs = len(residual_model.dataset.names)
    by_block = sum_normal_equations_by_block(residual_model, fit.jacobian, fit.residuals)
    losses = np.bincount(residual_model.block_runs, by_block.losses, runs).astype(np.float64)
    size = fit.jacobian.shape[1]
    if size == 0:
        return losses
    squares, sides = np.zeros((runs, size, size)), np.zeros((runs, size))
    np.add.at(squares, residual_model.block_runs, by_block.squares)
    np.add.at(sides, residual_model.block_runs, by_block.sides)
    square, side = squares.sum(axis=0), sides.sum(axis=0)
    guard = 1e-6 * np.diag(np.maximum(np.diag(square), 1e-9))
    for run in range(runs):
        step = -np.linalg.solve(square - squares[run] + guard, side - sides[run])
        losses[run] += 2.0 * step @ sides[run] + step @ squares[run] @ step
    return losses


def estimate_robust_covariance(residual_model: ResidualModel, fit: EffectFit, widen_for_few: bool = False) -> Array:
    """Return the covariance of the coordinates from the scatter of blocks (sandwich estimate), at least that of noise.

    With `few` the scatter is widened where few blocks determine a coordinate: see compute_small_sample_widening.
    """
    sums = sum_normal_equations_by_block(residual_model, fit.jacobian, fit.residuals)
    inverse = np.linalg.pinv(sums.squares.sum(axis=0), rcond=1e-14, hermitian=True)
    scatter_sum = sums.sides.T @ sums.sides
    sandwich = inverse @ scatter_sum @ inverse
    if widen_for_few:
        widening = compute_small_sample_widening(sums.squares, inverse)
        sandwich = sandwich * np.outer(widening, widening)
    factor = np.sqrt(np.maximum(np.diag(inverse) / np.maximum(np.diag(sandwich), 1e-300), 1.0))
    out: Array = sandwich * np.outer(factor, factor)
    return out


def predict_removal_costs(fit: EffectFit) -> dict[str, float]:
    """Return the loss that returns without each part, with the other coordinates following, in a linear prediction."""
    inverse = np.linalg.pinv(multiply_columns(fit.jacobian, fit.jacobian), rcond=1e-14, hermitian=True)
    costs = {}
    for parameters, coordinates in fit.parts:
        part_columns, deviation = fit.find_columns(parameters.id), coordinates - np.array(parameters.neutral)
        costs[parameters.id] = float(
            deviation @ np.linalg.pinv(inverse[part_columns, part_columns], rcond=1e-12, hermitian=True) @ deviation
        )
    return costs


def compute_small_sample_widening(squares: Array, inverse: Array) -> Array:
    """Return the widening of a scatter between pieces that is needed to contain 95 %, per coordinate (m,).

    `squares` (p, m, m) are those of the pieces, `inverse` (m, m) that of their sum. A scatter between n equal pieces is
    Student's with n - 1 degrees of freedom, and its square too small by n / (n - 1); for unequal pieces n is the
    inverse of the sum of their squared shares.
    """
    information = np.maximum(np.einsum("pij,ji->pi", inverse @ squares, inverse), 0.0)
    shares = information / np.maximum(information.sum(axis=0), 1e-300)
    count = 1.0 / np.maximum((shares * shares).sum(axis=0), 1e-12)
    freedoms = np.maximum(count - 1.0, 1.0)
    return np.asarray(
        stdtrit(freedoms, 0.5 + 0.5 * INTERVAL_COVERAGE) / INTERVAL_SIGMAS * np.sqrt(np.maximum(count, 2.0) / freedoms)
    )


def is_helping_held_out(
    residual_model: ResidualModel, smaller_fit: EffectFit, fit: EffectFit, threshold: float
) -> bool:
    """Whether the larger fit helps held-out runs: most of those concerned, or some without harm to others.

    Tested in the channels that its additional effects reach: elsewhere the two fits differ only by where the jacobians
    of nonlinear effects, such as a dead band, were computed.
    """
    smaller_fit, fit = _restrict_to_affected_channels(residual_model, smaller_fit, fit)
    gain = estimate_held_out_losses(residual_model, smaller_fit) - estimate_held_out_losses(residual_model, fit)
    concerned = np.abs(gain) > CONCERNED_LOSS
    if float(gain.sum()) < HELD_OUT_SHARE * threshold:
        return _is_helping_within_runs(residual_model, smaller_fit, fit)
    harmless = (
        -gain[gain < 0.0].sum() < HARM_SHARE * gain[gain > 0.0].sum()
        and np.count_nonzero(gain > HELPED_LOSS) >= FEWEST_HELPED
    )
    return bool(harmless or np.count_nonzero(gain[concerned] > 0.0) >= LEAST_HELPED_SHARE * np.count_nonzero(concerned))


def _restrict_to_affected_channels(
    residual_model: ResidualModel, smaller_fit: EffectFit, fit: EffectFit
) -> tuple[EffectFit, EffectFit]:
    """Restrict both fits to the channels (path, wheel, speed) that only effects of the larger one reach."""
    added = [fit.find_columns(name) for name in fit.settings if name not in smaller_fit.settings]
    rows = residual_model.dataset.rows
    channels = slice(0, 3 * rows), slice(3 * rows, 4 * rows), slice(4 * rows, 5 * rows)
    unreached = [
        channel for channel in channels if not any(fit.jacobian[channel, part_columns].any() for part_columns in added)
    ]
    return _drop_fit_channels(smaller_fit, unreached), _drop_fit_channels(fit, unreached)


def _drop_fit_channels(fit: EffectFit, channels: Sequence[slice]) -> EffectFit:
    """Remove some channels from a fit; unchanged where it is 0 there."""
    channels_with_values = [
        channel for channel in channels if fit.residuals[channel].any() or fit.jacobian[channel].any()
    ]
    if not channels_with_values:
        return fit
    residuals, jacobian = fit.residuals.copy(), fit.jacobian.copy(order="K")
    for channel in channels_with_values:
        residuals[channel] = jacobian[channel] = 0.0
    return replace(fit, residuals=residuals, jacobian=jacobian)


def _is_helping_within_runs(residual_model: ResidualModel, smaller_fit: EffectFit, fit: EffectFit) -> bool:
    """Whether the blocks agree on an effect that only a few runs show."""
    count = len(residual_model.block_runs)
    gain = np.bincount(residual_model.residual_blocks, smaller_fit.residuals**2 - fit.residuals**2, count)
    by_run = np.bincount(residual_model.block_runs, gain, len(residual_model.dataset.names))
    best_runs = np.argsort(-by_run)[:FEW_RUNS]
    if by_run[best_runs].sum() < FEW_RUNS_GAIN_SHARE * gain.sum():
        return False
    inside = gain[np.isin(residual_model.block_runs, best_runs)]
    concerned = np.abs(inside) > CONCERNED_LOSS
    return bool(
        concerned.sum() >= 2 and np.count_nonzero(inside[concerned] > 0.0) >= LEAST_HELPED_SHARE * concerned.sum()
    )


def list_nameable_parts(residual_model: ResidualModel, fit: EffectFit, tractor: Tractor) -> list[str]:
    """List the parts that clearly exceed the tolerance of the base tractor."""
    if not fit.parts:
        return []
    covariance = estimate_robust_covariance(residual_model, fit)
    return [
        parameters.id
        for parameters, coordinates in fit.parts
        if parameters.compute_deviation(coordinates)
        > find_finest_size(tractor, parameters.id, residual_model.get_interval_s(parameters.id))
        and _compute_sigmas_from_neutral(parameters, coordinates, covariance, fit.find_columns(parameters.id))
        > CLEAR_SIGMAS
    ]


def _compute_sigmas_from_neutral(
    parameters: EffectParameters, coordinates: Array, covariance: Array, part_columns: slice
) -> float:
    """Return the number of standard deviations from neutral."""
    deviation = coordinates - np.array(parameters.neutral)
    # A direction that the logs do not determine, as of a slope driven one way only, is not tested.
    inverse = np.linalg.pinv(covariance[part_columns, part_columns], rcond=1e-12, hermitian=True)
    return float(np.sqrt(deviation @ inverse @ deviation))
