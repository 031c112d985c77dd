"""One more effect on top of a fit with the other coordinates following, its significance, and predictions of its gain.

The trace of an effect hardly depends on the other effects. So a competitor that is predicted to gain far less than
needed is dismissed without a simulation for every part.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from vehicle.identification.fit.column_products import (
    IndexedColumns,
    multiply_columns,
    stack_columns,
    subtract_columns,
    sum_squares,
)
from vehicle.identification.fit.effect_parameters import EffectParameters, collect_settings, get_shown_blocks
from vehicle.identification.fit.residual_fit import EffectFit, add_linear_terms
from vehicle.identification.fit.solver import FIRST_STEP, SolverPoint, StopRule, minimise_loss, perturb_coordinate
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import ResidualModel, SettingsChange
from vehicle.identification.thresholds import FAR_LESS_SHARE, LEAST_PREDICTED_GAIN, NULL_QUANTILE, NULL_SAMPLES

TRIAL_ITERATIONS = 3  # chosen: a candidate is refitted once it has entered
TRIAL_SETTLED_STEP = 0.01  # chosen, of a typical size: the fit ends at a step this small
LEAST_DIRECTION_SHARE = 1e-10  # of the largest eigenvalue: smaller ones are rounding
ComputeChanges = Callable[[Sequence[SettingsChange], Array], Iterator[Array]]


@dataclass(frozen=True, eq=False)
class CandidateFit:
    """A fitted candidate: coordinates, loss removed beyond the fit, columns with the fit projected out.

    One that is not `is_finished` was stopped because its predicted gain is far below others'. `first_coordinates` (m,)
    is where its first jacobian was computed; it can be resumed from `resume_point`, if known. One with a
    `predicted_gain` was not tried at all.
    """

    parameters: EffectParameters
    coordinates: Array
    gain: float
    columns: Array
    is_finished: bool = True
    first_coordinates: Array | None = None
    resume_point: SolverPoint | None = None
    predicted_gain: float | None = None


class Projector:
    """Removes the columns of a fit from vectors."""

    def __init__(self, jacobian: Array) -> None:
        """Compute what makes the columns orthonormal, from their products."""
        self.jacobian, self.directions, self._tall_columns = (
            jacobian,
            np.zeros((jacobian.shape[1], 0)),
            IndexedColumns(jacobian),
        )
        if jacobian.size:
            square = self._tall_columns.column_products
            scale = np.maximum(np.sqrt(np.diag(square)), 1e-12)
            eigenvalues, eigenvectors = np.linalg.eigh(square / np.outer(scale, scale))
            is_significant = eigenvalues > LEAST_DIRECTION_SHARE * eigenvalues[-1]
            self.directions = eigenvectors[:, is_significant] / np.sqrt(eigenvalues[is_significant]) / scale[:, None]

    def __call__(self, vector: Array) -> Array:
        """Return the part of a vector (n,) that no column explains."""
        if not self.directions.size:
            return vector
        return self._tall_columns.subtract_columns_from(
            vector, self.directions @ (self.directions.T @ self._tall_columns.multiply_vector(vector))
        )

    def multiply_columns(self, columns: Array) -> Array:
        """Return products (k, k) of the parts of columns (n, k) that no column of the fit explains."""
        share = self.directions.T @ self._tall_columns.multiply_columns(columns)
        return multiply_columns(columns, columns) - share.T @ share


@dataclass(frozen=True, eq=False)
class _CandidateProblem:
    """The problem of one more effect: what no column of the fit explains."""

    changes_of: ComputeChanges
    fit: EffectFit
    parameters: EffectParameters
    projector: Projector

    @property
    def typical(self) -> Array:
        return np.array(self.parameters.typical)

    @property
    def low(self) -> Array:
        return np.array(self.parameters.low)

    @property
    def high(self) -> Array:
        return np.array(self.parameters.high)

    @property
    def linear(self) -> None:
        return None

    @cached_property
    def _bare_residuals(self) -> Array:
        fit = self.fit
        return fit.residuals if fit.linear_terms is None else fit.residuals - fit.linear_terms.summed_columns

    def iterate_points(self, places: Sequence[Array]) -> Iterator[SolverPoint]:
        """Return the points at coordinates, one after another."""
        block = get_shown_blocks(self.parameters.id)
        changes = [
            (collect_settings([*self.fit.parts, (self.parameters, coordinates)]), block) for coordinates in places
        ]
        for coordinates, changed in zip(places, self.changes_of(changes, self._bare_residuals), strict=True):
            yield SolverPoint(coordinates, self.projector(add_linear_terms(changed, self.fit.linear_terms)))

    def compute_residuals(self, coordinates: Array, start: SolverPoint) -> Array:
        return next(self.iterate_points([coordinates])).residuals

    def compute_changes(self, places: Sequence[Array], axes: Sequence[int], start: SolverPoint) -> Iterator[Array]:
        return (point.residuals - start.residuals for point in self.iterate_points(places))


def fit_candidate(
    changes_of: ComputeChanges,
    fit: EffectFit,
    parameters: EffectParameters,
    projector: Projector,
    worth: float = 0.0,
    residuals: Array | None = None,
) -> CandidateFit:
    """Fit one more effect while the coordinates of the others follow linearly.

    `compute_changes` is that of ResidualModel, `projector` removes the columns of the fit, and `residuals` (n,) are its
    projected residuals, if known. A candidate that is predicted to gain far less than `worth` is not simulated further.
    """
    problem = _CandidateProblem(changes_of, fit, parameters, projector)
    best_point = neutral_point = SolverPoint(
        np.array(parameters.neutral), projector(fit.residuals) if residuals is None else residuals
    )
    for start_point in problem.iterate_points(
        [np.array(start) for start in parameters.starts if start != parameters.neutral]
    ):
        best_point = start_point if start_point.loss < best_point.loss else best_point
    return _minimise_candidate_loss(problem, best_point, neutral_point.loss, worth)


def resume_candidate(
    changes_of: ComputeChanges,
    fit: EffectFit,
    candidate: CandidateFit,
    projector: Projector,
    residuals: Array,
    worth: float = 0.0,
) -> CandidateFit:
    """Resume a candidate of the same fit: returns what fit_candidate would find with this `worth`."""
    if candidate.resume_point is None:
        return fit_candidate(changes_of, fit, candidate.parameters, projector, worth, residuals)
    return _minimise_candidate_loss(
        _CandidateProblem(changes_of, fit, candidate.parameters, projector),
        candidate.resume_point,
        sum_squares(residuals),
        worth,
    )


def _minimise_candidate_loss(problem: _CandidateProblem, best: SolverPoint, loss: float, worth: float) -> CandidateFit:
    """Fit the candidate from its best start, or from its first jacobian, given the `loss` without it."""

    def is_settled(previous: SolverPoint, current: SolverPoint) -> bool:
        return bool(np.all(np.abs(current.coordinates - previous.coordinates) < TRIAL_SETTLED_STEP * problem.typical))

    predicted_gains: list[float] = []

    def is_worthwhile(point: SolverPoint) -> bool:
        predicted_gains.append(loss - point.loss + _predict_point_gain(point))
        return not predicted_gains[-1] < compute_needed_gain(worth)

    end = minimise_loss(
        problem,
        best,
        StopRule(
            TRIAL_ITERATIONS,
            is_settled,
            is_worthwhile=is_worthwhile,
            jacobian_count=int(best.jacobian_coordinates is not None),
        ),
    )
    is_finished = not LEAST_PREDICTED_GAIN <= predicted_gains[-1] < FAR_LESS_SHARE * worth
    resume_point = end if not is_finished and len(predicted_gains) == 1 else None
    return CandidateFit(
        problem.parameters, end.coordinates, loss - end.loss, end.jacobian, is_finished, best.coordinates, resume_point
    )


def compute_needed_gain(worth: float) -> float:
    """Return the predicted gain a candidate needs to be simulated further, given the gain that is `worth` something."""
    return max(LEAST_PREDICTED_GAIN, FAR_LESS_SHARE * worth)


def list_perturbed_coordinates(parameters: EffectParameters, coordinates: Array) -> list[Array]:
    """Return the points of the first jacobian at coordinates, one per axis."""
    return [
        perturb_coordinate(parameters.typical, parameters.high, coordinates, axis, FIRST_STEP)
        for axis in range(parameters.count)
    ]


def _predict_point_gain(point: SolverPoint) -> float:
    """Return the loss that a linear prediction removes."""
    return predict_gain(
        multiply_columns(point.jacobian, point.jacobian), multiply_columns(point.jacobian, point.residuals)
    )


def predict_gain(square: Array, side: Array) -> float:
    """Return the loss that columns remove, from their products with each other (m, m) and with the residuals (m,)."""
    scale = np.maximum(np.diag(square), 1e-12)
    return float(side @ np.linalg.solve(square + 1e-9 * np.diag(scale), side))


def compute_strengths(
    residual_model: ResidualModel, candidates: Sequence[CandidateFit], residuals: Array
) -> tuple[list[float], float]:
    """Return the strength of every candidate, and the strength that the best reaches by chance in 1 of 100 draws.

    Strength is the squared gradient of the loss over its scatter between blocks of ten seconds (at least that of noise
    alone). Chance is drawn from the residuals after the best candidate, with random signs of the blocks.
    """
    rng = np.random.default_rng(20)
    count = len(residual_model.block_runs)
    signs = rng.choice([-1.0, 1.0], size=(NULL_SAMPLES, count))
    largest, strength_values = np.zeros(NULL_SAMPLES), []
    for candidate in candidates:
        square = multiply_columns(candidate.columns, candidate.columns)
        if not np.all(np.diag(square) > 1e-9):
            strength_values.append(0.0)
            continue
        amounts: Array = np.linalg.solve(square, multiply_columns(candidate.columns, residuals)).astype(np.float64)
        remaining = subtract_columns(residuals, candidate.columns, amounts)
        sides = np.stack(
            [np.bincount(residual_model.residual_blocks, column * remaining, count) for column in candidate.columns.T],
            axis=1,
        )
        spread = sides.T @ sides
        scatter = square * max(1.0, float(np.trace(np.linalg.solve(square, spread))) / len(square))
        inverse = np.linalg.inv(scatter)
        strength_values.append(candidate.gain * float(np.trace(square @ inverse)) / len(square))
        null_sums = signs @ sides
        largest = np.maximum(largest, np.einsum("di,ij,dj->d", null_sums, inverse, null_sums))
    return strength_values, float(np.quantile(largest, NULL_QUANTILE))


@dataclass(frozen=True, eq=False)
class EffectTraces:
    """Traces of effects on top of a fit; `compute_changes` is that of ResidualModel, `bare_residuals` (n,) those
    without linear terms."""

    changes_of: ComputeChanges
    fit: EffectFit
    bare: Array
    _cached_traces: dict[str, Array] = field(init=False, default_factory=dict)

    def is_hopeless(self, residuals: Array, projector: Projector, parameters: EffectParameters, worth: float) -> bool:
        """Whether an effect is predicted to gain far less than `worth` in the place of a part.

        `residuals` (n,) are those of the fit without the part; `projector` removes its columns.
        """
        return self.predict_gain(residuals, projector, parameters) < compute_needed_gain(worth)

    def predict_gain(self, residuals: Array, projector: Projector, parameters: EffectParameters) -> float:
        """Return the loss that an effect removes from residuals, in a linear prediction."""
        if parameters.id not in self._cached_traces:
            self._cached_traces[parameters.id] = self._compute_trace(parameters)
        trace = self._cached_traces[parameters.id]
        square, side = projector.multiply_columns(trace), multiply_columns(trace, residuals)
        column_slices = [slice(0, parameters.count), *[slice(k, k + 1) for k in range(parameters.count, len(side))]]
        return max(
            predict_gain(square[column_slice, column_slice], side[column_slice]) for column_slice in column_slices
        )

    def _compute_trace(self, parameters: EffectParameters) -> Array:
        """Return changes of the residuals (n, m + s) by an effect: per coordinate from neutral, and at its other
        starts."""
        neutral = np.array(parameters.neutral)
        places = []
        for step in FIRST_STEP * np.diag(parameters.typical):
            forward = parameters.clip(neutral + step)
            places.append(forward if np.any(forward != neutral) else parameters.clip(neutral - step))
        return self._compute_columns(
            parameters, [*places, *[np.array(start) for start in parameters.starts if start != parameters.neutral]]
        )

    def _compute_columns(self, parameters: EffectParameters, places: Sequence[Array]) -> Array:
        block = get_shown_blocks(parameters.id)
        changes = [(collect_settings([*self.fit.parts, (parameters, coordinates)]), block) for coordinates in places]
        return stack_columns([changed - self.bare for changed in self.changes_of(changes, self.bare)], len(self.bare))
