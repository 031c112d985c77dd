"""Reuse of earlier scans: predicted gains from cached motions, and candidates whose channels have not changed.

What an effect adds to the simulated motion hardly depends on the other effects. From one scan to the next the fit and
the weights change, so cached motions with new weights predict the start of a new fit, and a cause that falls far short
is not tried again in this scan. That is no verdict: before anything depends on it, it is tried.

Sensors cut a log into channels, and an effect of one does not show in another. A candidate whose channel has the same
residuals as before would give the same result.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.identification.cause_selection.candidate_fit import (
    CandidateFit,
    Projector,
    compute_needed_gain,
    list_perturbed_coordinates,
    predict_gain,
)
from vehicle.identification.cause_selection.covariates import CovariateScore
from vehicle.identification.fit.column_products import multiply_columns, stack_columns, subtract_columns, sum_squares
from vehicle.identification.fit.effect_parameters import EffectParameters, collect_settings, get_shown_blocks
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.innovations import PoseIncrements
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import OLDEST_SCANS, PREDICTED_SHARE, UNCHANGED_LOSS
from vehicle.model.effects import PATH, POSITION, SPEED, STEERING, get_effect

AddedMotion = npt.NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class TrialMotions:
    """What an effect added to the motion of a fit at the p points of a trial: its starts, then one side per axis.

    `motions` are (3, r) each: ahead, aside and turned between rows, of all segments in turn. The sides are next to
    `first_coordinates`, None for neutral; `scans` is the age in scans.
    """

    parameters: EffectParameters
    places: tuple[Array, ...]
    added_motions: tuple[AddedMotion, ...]
    start_index: int | None
    age_scans: int = 0

    @property
    def start_coordinates(self) -> Array:
        """Where the trial began (m,)."""
        return np.array(self.parameters.neutral) if self.start_index is None else self.places[self.start_index]

    @cached_property
    def jacobian_weights(self) -> Array:
        """Weights (p, m) of the points that form the first jacobian."""
        count = self.parameters.count
        first = len(self.places) - count
        out = np.zeros((len(self.places), count))
        for axis in range(count):
            step = self.places[first + axis][axis] - self.start_coordinates[axis]
            out[first + axis, axis] = 1.0 / step
            if self.start_index is not None:
                out[self.start_index, axis] = -1.0 / step
        return out


MotionsByEffect = Mapping[str, TrialMotions]


@dataclass(frozen=True, eq=False)
class GainPrediction:
    """Predicted start of a trial at `coordinates`: its jacobian (n, m), the gain there, and the linear prediction.

    `best_gain` is the largest linear prediction from there and from other starts.
    """

    parameters: EffectParameters
    coordinates: Array
    jacobian: Array
    gain: float
    best_gain: float


def drop_old_motions(seen: MotionsByEffect) -> dict[str, TrialMotions]:
    """Return the motions for the next scan, without those that are too old by then."""
    return {
        name: replace(motions, age_scans=motions.age_scans + 1)
        for name, motions in seen.items()
        if motions.age_scans + 1 < OLDEST_SCANS
    }


@dataclass(frozen=True, eq=False)
class GainPredictor:
    """Predictions on top of a fit; `projector` removes its columns, `residuals` (n,) are the projected residuals."""

    residual_model: ResidualModel
    fit: EffectFit
    projector: Projector
    residuals: Array

    def predict_gains(self, seen: MotionsByEffect, names: Collection[str]) -> dict[str, GainPrediction]:
        """Return the gains predicted from earlier trials, by name."""
        return {name: self._predict_gain(motions) for name, motions in seen.items() if name in names}

    def build_hopeless_candidate(self, prediction: GainPrediction, worth: float) -> CandidateFit | None:
        """Return the unfinished candidate of a cause whose prediction is far too low; None if it has to be tried."""
        if prediction.best_gain >= PREDICTED_SHARE * compute_needed_gain(worth):
            return None
        projected_jacobian = stack_columns(
            [self.projector(column) for column in prediction.jacobian.T], len(self.residuals)
        )
        return CandidateFit(
            prediction.parameters,
            prediction.coordinates,
            prediction.gain,
            projected_jacobian,
            False,
            prediction.coordinates,
            predicted_gain=prediction.best_gain,
        )

    def collect_motions(self, candidate: CandidateFit) -> dict[str, TrialMotions]:
        """Return the motions of a finished trial by its name; empty where the effect shows outside the path."""
        return (
            {candidate.parameters.id: self._simulate_motions(candidate)}
            if self._is_path_only(candidate.parameters)
            else {}
        )

    def _is_path_only(self, parameters: EffectParameters) -> bool:
        """Whether an effect without a search shows in the path alone."""
        blocks = {PATH, POSITION}
        if all(segment.wheel is None for segment in self.residual_model.dataset.segments):
            blocks |= {STEERING}
        return get_shown_blocks(parameters.id) <= blocks and not get_effect(parameters.id).kind.is_searched

    @cached_property
    def _current_increments(self) -> list[PoseIncrements]:
        return self.residual_model.simulate_increments(self.fit.settings)

    @cached_property
    def _current_residuals(self) -> Array:
        return self.residual_model.compute_path_residuals(self._current_increments, self.fit.settings)

    def _simulate_motions(self, candidate: CandidateFit) -> TrialMotions:
        """Return the motions of a trial on this fit, which are still cached."""
        assert candidate.first_coordinates is not None
        parameters = candidate.parameters
        starts = [np.array(coordinates) for coordinates in parameters.starts if coordinates != parameters.neutral]
        start_index = next(
            (k for k, coordinates in enumerate(starts) if np.array_equal(coordinates, candidate.first_coordinates)),
            None,
        )
        places = (*starts, *list_perturbed_coordinates(parameters, candidate.first_coordinates))
        return TrialMotions(
            parameters,
            places,
            tuple(self._simulate_added_motion(parameters, coordinates) for coordinates in places),
            start_index,
        )

    def _simulate_added_motion(self, parameters: EffectParameters, coordinates: Array) -> AddedMotion:
        moved_increments = self.residual_model.simulate_increments(
            collect_settings([*self.fit.parts, (parameters, coordinates)])
        )
        parts = [
            np.stack([moved.ahead - current.ahead, moved.aside - current.aside, moved.turned - current.turned])
            for moved, current in zip(moved_increments, self._current_increments, strict=True)
        ]
        return np.concatenate(parts, axis=1).astype(np.float32)

    def _predict_gain(self, motions: TrialMotions) -> GainPrediction:
        columns = stack_columns(
            [
                self._compute_column(motions.parameters, *pair)
                for pair in zip(motions.places, motions.added_motions, strict=True)
            ],
            len(self.residuals),
        )
        square, side = self.projector.multiply_columns(columns), multiply_columns(columns, self.residuals)
        amounts, gain, start_side = motions.jacobian_weights, 0.0, side
        if motions.start_index is not None:
            start_side = side + square[motions.start_index]
            gain = -float(2.0 * side[motions.start_index] + square[motions.start_index, motions.start_index])
        linear_gain = gain + predict_gain(amounts.T @ square @ amounts, amounts.T @ start_side)
        starts = range(len(motions.places) - motions.parameters.count)
        start_gains = [predict_gain(square[k : k + 1, k : k + 1], side[k : k + 1]) for k in starts]
        jacobian = stack_columns(
            [subtract_columns(np.zeros(len(self.residuals)), columns, -pair) for pair in amounts.T], len(self.residuals)
        )
        return GainPrediction(
            motions.parameters, motions.start_coordinates, jacobian, max(gain, 0.0), max([linear_gain, *start_gains])
        )

    def _compute_column(self, parameters: EffectParameters, coordinates: Array, added: AddedMotion) -> Array:
        """Return the change of the residuals (n,) by motions added to those of the fit."""
        increments, first = [], 0
        for current in self._current_increments:
            added_ahead, aside, turned = added[:, first : first + len(current.ahead)]
            increments.append(
                PoseIncrements(current.ahead + added_ahead, current.aside + aside, current.turned + turned)
            )
            first += len(current.ahead)
        out = np.zeros(len(self.residuals))
        path = (
            self.residual_model.compute_path_residuals(
                increments, collect_settings([*self.fit.parts, (parameters, coordinates)])
            )
            - self._current_residuals
        )
        out[: len(path)] = path
        return out


@dataclass(frozen=True, eq=False)
class ScanCache:
    """A scan: its fit, the projected residuals (n,), the candidates, and the scores of the covariates.

    `projector` removes the columns of the fit; `motions` are those of trials, for the next scan.
    """

    fit: EffectFit
    projector: Projector
    residuals: Array
    candidates: Sequence[CandidateFit]
    scores: Sequence[CovariateScore]
    seen: MotionsByEffect = field(default_factory=dict)

    def find_unchanged_blocks(self, residual_model: ResidualModel, fit: EffectFit, residuals: Array) -> frozenset[str]:
        """Return blocks whose channels have the same residuals in another fit of the same dataset."""
        unchanged: list[str] = []
        for blocks, rows in list_channel_slices(residual_model):
            old_parts, new_parts = (_list_parts_in_blocks(fit_to_compare, blocks) for fit_to_compare in (self.fit, fit))
            if old_parts == new_parts and sum_squares(residuals[rows] - self.residuals[rows]) < UNCHANGED_LOSS:
                unchanged += blocks
        return frozenset(unchanged)

    def is_same_path(self, residual_model: ResidualModel, fit: EffectFit) -> bool:
        """Whether the path residuals of another fit are the same, linear terms included: so are the scores."""
        _, path = list_channel_slices(residual_model)[0]
        same_terms = (
            self.fit.linear_terms is not None
            and fit.linear_terms is not None
            and (self.fit.linear_terms.columns.shape == fit.linear_terms.columns.shape)
        )
        return same_terms and sum_squares(fit.residuals[path] - self.fit.residuals[path]) < UNCHANGED_LOSS

    def get_finished_candidates(self, blocks: frozenset[str]) -> dict[str, CandidateFit]:
        """Return the finished candidates of some blocks by name."""
        return {
            candidate.parameters.id: candidate
            for candidate in self.candidates
            if candidate.is_finished and get_shown_blocks(candidate.parameters.id) <= blocks
        }


def list_channel_slices(residual_model: ResidualModel) -> list[tuple[tuple[str, ...], slice]]:
    """Return the blocks that show in the path, the wheel angle and the speed, with their slices of the residuals."""
    rows = residual_model.dataset.rows
    wheel, other_blocks = ((STEERING,), ()) if residual_model.has_measured_wheel_angle else ((), (STEERING,))
    return [
        ((PATH, POSITION, *other_blocks), slice(0, 3 * rows)),
        (wheel, slice(3 * rows, 4 * rows)),
        ((SPEED,), slice(4 * rows, 5 * rows)),
    ]


def _list_parts_in_blocks(fit: EffectFit, blocks: tuple[str, ...]) -> list[tuple[str, tuple[float, ...]]]:
    """Return the parts of a fit in some blocks, with their fixed values."""
    return sorted(
        (parameters.id, parameters.fixed_values)
        for parameters, _ in fit.parts
        if get_shown_blocks(parameters.id) & set(blocks)
    )
