"""What the tractor file cannot know, as an error of every value found.

A file states radii, tyres, instruments and their places to a tolerance: the finest size that may be claimed of each
effect. An effect that is not in the fit may be there within its tolerance, and bends the values of those that are. The
sensitivity of the values to all such differences, as far as the logs leave them open, is a covariance of its own beside
that of the scatter: large where logs cannot tell an effect from a tolerance, as a play from a zero of the sensor on
turns to one side, and small where they can. The place at which a side draft pulls is such a difference as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import LEAST_DIRECTION_SHARE
from vehicle.identification.cause_selection.evidence import estimate_robust_covariance
from vehicle.identification.fit.column_products import multiply_columns, stack_columns
from vehicle.identification.fit.effect_parameters import build_parameters, find_finest_size, get_shown_blocks
from vehicle.identification.fit.residual_fit import EffectFit, sum_normal_equations_by_block
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import ResidualModel, SettingsChange
from vehicle.identification.thresholds import DATA_DISCOUNT, DIFFERENCE_FORM_SHARE, RADIUS_SHAPE_TOLERANCE
from vehicle.model.effect_kinds import INTERVAL_SIGMAS
from vehicle.model.effects import DISCREPANCY_KEY, PATH, get_effect
from vehicle.sim.effect_terms import compute_draft_crab_share

RADIUS_SHAPE, SIDE_DRAFT = "grip_by_angle", "implement_side_draft"
# What a file states of the path: its radii, zero and scale of its sensors, the places of antenna and heading; and that
# positions and headings are of one time, as an antenna ahead looks like early positions.
STATED = (
    "steering_gain",
    "steering_asymmetry",
    "steering_offset",
    "antenna_forward",
    "antenna_right",
    "heading_bias",
    "speed_scale",
    "position_delay",
)


LEAST_INFORMATION = 1e-9  # on a coordinate: with less the logs do not show it, and no tolerance shifts it


def estimate_value_covariance(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the covariance (m, m) of the coordinates of a fit: scatter of blocks, of runs, tolerances of the file,
    the form of differences between tractors, and the crab under a side draft.

    Errors that last, as of soil or of a controller that steers back, make blocks of a run alike, so runs may scatter
    more than their blocks tell: the larger of both variances counts.
    """
    covariance = estimate_robust_covariance(residual_model, fit, widen_for_few=True)
    by_run = estimate_run_variances(residual_model, fit)
    factor = np.sqrt(np.maximum(by_run / np.maximum(np.diag(covariance), 1e-300), 1.0))
    scatter = covariance * np.outer(factor, factor)
    differences = estimate_tolerance_covariance(residual_model, fit) + estimate_form_covariance(fit)
    return np.asarray(scatter + differences + estimate_crab_covariance(residual_model, fit))


def estimate_form_covariance(fit: EffectFit) -> Array:
    """Return the covariance (m, m) of the coordinates of a fit by the form of the differences between tractors.

    Tyres and lags of another make are no multiple of the standard ones, only like it: of the shift of a value that each
    difference found in these logs makes, a share (DIFFERENCE_FORM_SHARE) is in doubt.
    """
    size = fit.jacobian.shape[1]
    out, terms = np.zeros((size, size)), fit.linear_terms
    if terms is None or not terms.unknown_count or not fit.parts:
        return out
    first = size - terms.columns.shape[1]
    unknown = np.arange(first, first + terms.unknown_count)
    kept = np.setdiff1d(np.arange(size), unknown)
    columns, changes = fit.jacobian[:, kept], fit.jacobian[:, unknown] * terms.amounts[: terms.unknown_count]
    square = multiply_columns(columns, columns)
    scale = np.sqrt(np.maximum(np.diag(square), LEAST_INFORMATION))
    inverse = np.linalg.pinv(square / np.outer(scale, scale), rcond=LEAST_DIRECTION_SHARE, hermitian=True)
    shifts = DIFFERENCE_FORM_SHARE * (inverse / np.outer(scale, scale)) @ multiply_columns(columns, changes)
    out[np.ix_(kept, kept)] = shifts @ shifts.T
    return out


def estimate_crab_covariance(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the covariance (m, m) of the coordinates of a fit by the share of compute_draft_crab_share.

    Tyres, soil and the place of the pull decide it: from 0 (all at the front axle) to 1 (all at the rear axle), of
    which the end farther from the stated share counts as that of the 95 % interval. Nothing in the fit can take up
    another share, so its mean square counts, by that prior and the logs: the variance and the squared mean, which lies
    no farther away than that end.
    """
    size = fit.jacobian.shape[1]
    if SIDE_DRAFT not in fit.settings:
        return np.zeros((size, size))
    column = compute_crab_column(residual_model, fit)[:, None]
    square, cross = multiply_columns(fit.jacobian, fit.jacobian), multiply_columns(fit.jacobian, column)
    scale = np.sqrt(np.maximum(np.diag(square), LEAST_INFORMATION))
    inverse = np.linalg.pinv(square / np.outer(scale, scale), rcond=LEAST_DIRECTION_SHARE, hermitian=True)
    shift = (inverse / np.outer(scale, scale)) @ cross
    shown = float((multiply_columns(column, column) - cross.T @ shift).item())
    side = float((column[:, 0] - fit.jacobian @ shift[:, 0]) @ fit.residuals)
    mean = min(abs(side) / (DATA_DISCOUNT + shown), INTERVAL_SIGMAS)
    return np.asarray((mean * mean + 1.0 / (1.0 + shown / DATA_DISCOUNT)) * shift @ shift.T)


def compute_crab_column(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the change of the residuals (n,) by one standard deviation of the share of compute_draft_crab_share."""
    rig, segments = residual_model.rig, residual_model.dataset.segments
    share = float(compute_draft_crab_share(rig.model[0], rig.ground[0]))
    sigma_m = max(share, 1.0 - share) / INTERVAL_SIGMAS * rig.tractor.wheelbase_m
    slide = sigma_m * fit.settings[SIDE_DRAFT][get_effect(SIDE_DRAFT).size.name]
    moves = residual_model.simulate_increments(fit.settings)
    crabbing = [
        replace(move, aside=move.aside - slide * segment.working[:-1] * move.ahead)
        for segment, move in zip(segments, moves, strict=True)
    ]
    bare, changed = (residual_model.compute_path_residuals(each, fit.settings) for each in (moves, crabbing))
    return np.concatenate([changed - bare, np.zeros(2 * residual_model.dataset.rows)])


def estimate_run_variances(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the variances (m,) of the coordinates by the scatter between runs (sandwich estimate), 0 with one run.

    A scatter of n runs is too small by n / (n - 1); n counts runs by their shares in the information.
    """
    sums = sum_normal_equations_by_block(residual_model, fit.jacobian, fit.residuals)
    runs, size = len(residual_model.dataset.names), fit.jacobian.shape[1]
    sides, information = np.zeros((runs, size)), np.zeros((runs, size))
    np.add.at(sides, residual_model.block_runs, sums.sides)
    np.add.at(information, residual_model.block_runs, np.diagonal(sums.squares, axis1=1, axis2=2))
    inverse = np.linalg.pinv(sums.squares.sum(axis=0), rcond=1e-14, hermitian=True)
    shares = information / np.maximum(information.sum(axis=0), 1e-300)
    count = 1.0 / np.maximum((shares * shares).sum(axis=0), 1e-12)
    scatter = sides @ inverse
    return np.asarray((scatter * scatter).sum(axis=0) * count / np.maximum(count - 1.0, 1.0))


def estimate_tolerance_covariance(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the covariance (m, m) of the coordinates of a fit by the tolerances of everything that it leaves out."""
    if residual_model not in fit.tolerance_covariances:
        fit.tolerance_covariances[residual_model] = _compute_tolerance_covariance(residual_model, fit)
    return fit.tolerance_covariances[residual_model]


def _compute_tolerance_covariance(residual_model: ResidualModel, fit: EffectFit) -> Array:
    size = fit.jacobian.shape[1]
    if not fit.parts:
        return np.zeros((size, size))
    columns = compute_tolerance_columns(residual_model, fit)
    square, cross = multiply_columns(fit.jacobian, fit.jacobian), multiply_columns(fit.jacobian, columns)
    information = np.diag(square)
    scale = np.sqrt(np.where(information > LEAST_INFORMATION, information, np.inf))
    inverse = np.linalg.pinv(square / np.outer(scale, scale), rcond=LEAST_DIRECTION_SHARE, hermitian=True)
    shift = (inverse / np.outer(scale, scale)) @ cross
    shown = multiply_columns(columns, columns) - cross.T @ shift
    return np.asarray(shift @ np.linalg.inv(np.eye(len(shown)) + shown / DATA_DISCOUNT) @ shift.T)


def compute_tolerance_columns(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the changes of the residuals (n, t) by one standard deviation of each tolerance that the fit leaves out.

    Tyres and the timing of sensors are free in every fit, and none of these: see estimate_form_covariance.
    """
    bare = residual_model.compute_residuals(fit.settings)
    shape = {RADIUS_SHAPE: RADIUS_SHAPE_TOLERANCE / INTERVAL_SIGMAS / residual_model.rig.tractor.max_steering_deg}
    changes: list[SettingsChange] = [({**fit.settings, DISCREPANCY_KEY: shape}, frozenset({PATH}))]
    changes += [_build_change(residual_model, fit, name) for name in STATED if name not in fit.settings]
    columns = [changed - bare for changed in residual_model.compute_changes(changes, bare)]
    return stack_columns(columns, len(bare))


def _build_change(residual_model: ResidualModel, fit: EffectFit, name: str) -> SettingsChange:
    """Return the settings of a fit with one more effect, at one standard deviation of its tolerance."""
    tractor = residual_model.rig.tractor
    parameters = build_parameters(tractor, name)
    coordinates = np.array(parameters.neutral) + find_finest_size(tractor, name) / INTERVAL_SIGMAS
    return {**fit.settings, name: parameters.compute_values(coordinates)}, get_shown_blocks(name)


def is_within_tolerances(residual_model: ResidualModel, fit: EffectFit, name: str) -> bool:
    """Whether the logs leave open that an effect is none, but the tolerances of what the file states."""
    parameters, coordinates = next(part for part in fit.parts if part[0].id == name)
    place, deviation = fit.find_columns(name), coordinates - np.array(parameters.neutral)
    covariance = estimate_tolerance_covariance(residual_model, fit)[place, place]
    length = float(np.linalg.norm(deviation))
    if length == 0.0:
        return True
    direction = deviation / length
    return INTERVAL_SIGMAS * float(np.sqrt(max(direction @ covariance @ direction, 0.0))) > length
