"""Fitting effects to a residual model, statistics of its blocks, and coordinates for held-out data.

Held out are whole runs, or halves of a run where necessary: other runs cannot determine an effect that shows in one run
only. There, and with a single run, its own 20 s windows are used: those with even numbers are simulated with what the
odd ones give, and the reverse.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from vehicle.identification.fit.column_products import IndexedColumns, add_block_products, sum_squares
from vehicle.identification.fit.effect_parameters import EffectParameters, collect_settings, get_shown_blocks
from vehicle.identification.fit.solver import (
    LATER_STEP,
    SolverPoint,
    StopRule,
    compute_jacobian,
    minimise_loss,
    update_outdated_jacobian,
)
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import LEAST_INFORMATION_SHARE, MOST_USUAL_DIFFERENCES

FitPart = tuple[EffectParameters, Array]
FIT_ITERATIONS = 4  # chosen: as effects enter one by one, starts are near the best and the third step is already small
SETTLED_STEP = 0.02  # chosen, of a typical size: the fit ends at a step this small, far below any interval
LEAST_GAIN_SHARE = 1e-6  # of the loss, which is about the number of rows: less is rounding


@dataclass(frozen=True, eq=False)
class LinearTerms:
    """Further terms of the path that are linear: a column of residuals each, and their amounts.

    The first columns, `unknown_count` of them, are those of compute_tractor_difference_columns and part of every fit.
    """

    columns: Array
    amounts: Array
    unknown_count: int = 0

    @property
    def term_columns(self) -> slice:
        """The columns of covariates."""
        return slice(self.unknown_count, self.columns.shape[1])

    @cached_property
    def summed_columns(self) -> Array:
        """Sum of all columns times their amounts (n,)."""
        return self.indexed_columns.subtract_columns_from(np.zeros(len(self.columns)), -self.amounts)

    @cached_property
    def indexed_columns(self) -> IndexedColumns:
        """The columns, indexed once for all amounts."""
        return IndexedColumns(self.columns)

    def copy_with_amounts(self, amounts: Array) -> LinearTerms:
        """Return the same terms with other amounts."""
        copied_terms = replace(self, amounts=amounts)
        copied_terms.__dict__["laid"] = self.indexed_columns
        return copied_terms


@dataclass(frozen=True, eq=False)
class EffectFit:
    """Fitted effects.

    `residuals` (n,) remain, `jacobian` (n, m) is their change per coordinate, in the order of the parts and then of the
    linear terms. Both are meaningless for a fit that still has to be refined.
    """

    parts: tuple[FitPart, ...]
    residuals: Array
    jacobian: Array
    linear_terms: LinearTerms | None = None
    # Fits without one of the parts, or without covariates (""), which are needed several times.
    smaller_fits: dict[tuple[ResidualModel, str], EffectFit] = field(init=False, default_factory=dict)
    # Covariance of the coordinates by the tolerances of the tractor file, which is needed several times.
    tolerance_covariances: dict[ResidualModel, Array] = field(init=False, default_factory=dict)

    @property
    def loss(self) -> float:
        """Sum of squares."""
        return sum_squares(self.residuals)

    @property
    def settings(self) -> dict[str, dict[str, float]]:
        """The effects as settings of a tractor."""
        return collect_settings(list(self.parts))

    def find_columns(self, name: str) -> slice:
        """Return the columns of `jacobian` that belong to an effect."""
        first = 0
        for parameters, _ in self.parts:
            if parameters.id == name:
                return slice(first, first + parameters.count)
            first += parameters.count
        raise KeyError(name)


def make_empty_fit(residual_model: ResidualModel) -> EffectFit:
    """Return the fit without any effect."""
    residuals = residual_model.compute_residuals({})
    return EffectFit((), residuals, np.zeros((len(residuals), 0)))


def add_linear_terms(residuals: Array, linear_terms: LinearTerms | None) -> Array:
    """Return residuals with the linear terms added."""
    return residuals if linear_terms is None else residuals + linear_terms.summed_columns


@dataclass(frozen=True, eq=False)
class _FitProblem:
    """The least-squares problem of all parts and linear terms of a fit: coordinates of the parts, then amounts."""

    residual_model: ResidualModel
    fit: EffectFit

    @cached_property
    def typical(self) -> Array:
        return flatten([parameters.typical for parameters, _ in self.fit.parts])

    @cached_property
    def low(self) -> Array:
        return np.append(flatten([parameters.low for parameters, _ in self.fit.parts]), -self._largest_amounts)

    @cached_property
    def high(self) -> Array:
        return np.append(flatten([parameters.high for parameters, _ in self.fit.parts]), self._largest_amounts)

    @property
    def _largest_amounts(self) -> Array:
        """Largest amounts of the linear terms: usual differences between tractors are limited."""
        if self.fit.linear_terms is None:
            return np.zeros(0)
        limits = np.full(len(self.fit.linear_terms.amounts), np.inf)
        limits[: self.fit.linear_terms.unknown_count] = MOST_USUAL_DIFFERENCES
        return limits

    @property
    def linear(self) -> IndexedColumns | None:
        return None if self.fit.linear_terms is None else self.fit.linear_terms.indexed_columns

    @cached_property
    def coordinate_effects(self) -> list[str]:
        """Effect to which each coordinate belongs."""
        return [parameters.id for parameters, _ in self.fit.parts for _ in range(parameters.count)]

    @property
    def start(self) -> SolverPoint:
        amounts = np.zeros(0) if self.fit.linear_terms is None else self.fit.linear_terms.amounts
        return SolverPoint(
            np.append(flatten([coordinates for _, coordinates in self.fit.parts]), amounts), self.fit.residuals
        )

    def build_fit(self, point: SolverPoint) -> EffectFit:
        """Return the fit with coordinates, residuals and jacobian of a point."""
        return EffectFit(
            self._build_parts_at(point.coordinates),
            point.residuals,
            self.extend_jacobian(point.jacobian),
            self._get_linear_terms(point.coordinates),
        )

    def extend_jacobian(self, jacobian: Array) -> Array:
        """Append the columns of the linear terms to the jacobian (n, m) of the parts."""
        if self.linear is None:
            return jacobian
        linear_columns = self.linear.columns
        extended = np.empty((jacobian.shape[1] + linear_columns.shape[1], len(jacobian)))
        extended[: jacobian.shape[1]], extended[jacobian.shape[1] :] = jacobian.T, linear_columns.T
        return extended.T

    def compute_residuals(self, coordinates: Array, start: SolverPoint) -> Array:
        blocks = frozenset[str]().union(*(get_shown_blocks(name) for name in self.coordinate_effects))
        changed = self.residual_model.compute_change(
            collect_settings(list(self._build_parts_at(coordinates))), self._compute_bare_residuals(start), blocks
        )
        return add_linear_terms(changed, self._get_linear_terms(coordinates))

    def compute_changes(self, places: Sequence[Array], axes: Sequence[int], start: SolverPoint) -> Iterator[Array]:
        bare_residuals = self._compute_bare_residuals(start)
        settings = [collect_settings(list(self._build_parts_at(coordinates))) for coordinates in places]
        blocks = [get_shown_blocks(self.coordinate_effects[axis]) for axis in axes]
        changed = self.residual_model.compute_changes(list(zip(settings, blocks, strict=True)), bare_residuals)
        return (residuals - bare_residuals for residuals in changed)

    def _compute_bare_residuals(self, point: SolverPoint) -> Array:
        """Return the residuals without the linear terms."""
        linear_terms = self._get_linear_terms(point.coordinates)
        return point.residuals if linear_terms is None else point.residuals - linear_terms.summed_columns

    def _build_parts_at(self, coordinates: Array) -> tuple[FitPart, ...]:
        parts, first = [], 0
        for parameters, _ in self.fit.parts:
            parts.append((parameters, coordinates[first : first + parameters.count]))
            first += parameters.count
        return tuple(parts)

    def _get_linear_terms(self, coordinates: Array) -> LinearTerms | None:
        if self.fit.linear_terms is None:
            return None
        amounts = coordinates[len(self.typical) :]
        key = amounts.tobytes()
        if key not in self._linear_terms_by_amount:
            if len(self._linear_terms_by_amount) > 1:  # a point and the one before are used repeatedly
                self._linear_terms_by_amount.clear()
            self._linear_terms_by_amount[key] = self.fit.linear_terms.copy_with_amounts(amounts)
        return self._linear_terms_by_amount[key]

    @cached_property
    def _linear_terms_by_amount(self) -> dict[bytes, LinearTerms]:
        """Linear terms by their amounts."""
        return {} if self.fit.linear_terms is None else {self.fit.linear_terms.amounts.tobytes(): self.fit.linear_terms}


def flatten(vectors: Iterable[ArrayLike]) -> Array:
    """Concatenate vectors; an empty list gives an empty vector."""
    return np.concatenate([np.zeros(0), *map(np.asarray, vectors)])


def compute_fit_jacobian(residual_model: ResidualModel, fit: EffectFit, share: float = LATER_STEP) -> Array:
    """Return the change of the residuals per coordinate of the parts and per amount of the linear terms."""
    problem = _FitProblem(residual_model, fit)
    return problem.extend_jacobian(compute_jacobian(problem, problem.start, share))


def refine_fit(residual_model: ResidualModel, fit: EffectFit, iterations: int = FIT_ITERATIONS) -> EffectFit:
    """Fit all coordinates together."""
    if not fit.parts and fit.linear_terms is None:
        return fit
    problem = _FitProblem(residual_model, fit)

    def is_settled(before: SolverPoint, after: SolverPoint) -> bool:
        count = len(problem.typical)
        return bool(np.all(np.abs(after.coordinates - before.coordinates)[:count] / problem.typical < SETTLED_STEP))

    rule = StopRule(iterations, is_settled, least_gain=LEAST_GAIN_SHARE)
    return problem.build_fit(update_outdated_jacobian(problem, minimise_loss(problem, problem.start, rule)))


@dataclass(frozen=True, eq=False)
class BlockNormalEquations:
    """Normal equations per block: squares (b, m, m), sides (b, m), losses (b,)."""

    squares: Array
    sides: Array
    losses: Array


def sum_normal_equations_by_block(
    residual_model: ResidualModel, jacobian: Array, residuals: Array
) -> BlockNormalEquations:
    """Sum over the blocks of the residual model."""
    count, size = len(residual_model.block_runs), jacobian.shape[1]
    squares, sides = np.zeros((count, size, size)), np.zeros((count, size))
    add_block_products(residual_model.residual_blocks, jacobian, residuals, squares, sides)
    return BlockNormalEquations(
        squares, sides, np.bincount(residual_model.residual_blocks, residuals * residuals, count).astype(np.float64)
    )


DIAGONAL_GUARD = 1e-9  # of every diagonal entry: regularises, with no other effect
HeldOutSteps = dict[int, tuple[Array, Array]]


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Normal equations of a fit, piece by piece: squares (p, m, m), sides (p, m), run and half (0 or 1) of each."""

    squares: Array
    sides: Array
    runs: npt.NDArray[np.int64]
    halves: npt.NDArray[np.int64]


def compute_held_out_steps(pieces: NormalEquations, to_neutral: Array) -> HeldOutSteps:
    """Return, per run, the change of the coordinates (m,) for its even and odd windows, found without them.

    One step from the common fit. Coordinates that other data do not determine go back to neutral, by `to_neutral` (m,).
    """
    steps: HeldOutSteps = {}
    information = np.diag(pieces.squares.sum(axis=0))
    for run in np.unique(pieces.runs):
        is_other_run = pieces.runs != run
        has_information = np.diag(pieces.squares[is_other_run].sum(axis=0)) > LEAST_INFORMATION_SHARE * information
        if has_information.all():
            step = _solve_step(pieces, is_other_run, has_information, to_neutral)
            steps[int(run)] = (step, step)
            continue
        half_steps = []
        for half in (0, 1):
            is_kept = is_other_run | (pieces.halves != half)
            has_half_information = np.diag(pieces.squares[is_kept].sum(axis=0)) > LEAST_INFORMATION_SHARE * information
            half_steps.append(_solve_step(pieces, is_kept, has_half_information, to_neutral))
        steps[int(run)] = (half_steps[0], half_steps[1])
    return steps


def _solve_step(
    pieces: NormalEquations, is_kept: npt.NDArray[np.bool_], has_information: npt.NDArray[np.bool_], to_neutral: Array
) -> Array:
    square, side = pieces.squares[is_kept].sum(axis=0), pieces.sides[is_kept].sum(axis=0)
    step = np.where(has_information, 0.0, to_neutral)
    if has_information.any():
        inner = square[np.ix_(has_information, has_information)]
        gradient = (side + square @ step)[has_information]
        step[has_information] = -np.linalg.solve(
            inner + DIAGONAL_GUARD * np.diag(np.maximum(np.diag(inner), 1e-12)), gradient
        )
    return step
