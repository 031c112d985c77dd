"""The open-loop error as one vector: what a model drives wrong from the commands, anchored piece by piece.

Unlike the residuals it does not allow for instruments and soil. It is lowered when no cause is known, at the measured
speed where there is one: every horizon and kind of error has the same weight, as a share of its value without terms.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from vehicle.identification.fit.column_products import add_block_products, sum_squares
from vehicle.identification.fit.effect_parameters import EffectParameters
from vehicle.identification.fit.residual_fit import NormalEquations, compute_held_out_steps, flatten
from vehicle.identification.fit.solver import (
    FIRST_STEP,
    LATER_STEP,
    SolverPoint,
    StopRule,
    compute_jacobian,
    minimise_loss,
    update_outdated_jacobian,
)
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveSegment, compute_window_numbers
from vehicle.identification.replay.horizon_errors import (
    PieceBounds,
    add_centred_values,
    compute_piece_errors,
    find_piece_bounds,
    simulate_poses,
)
from vehicle.identification.replay.rig import replay_segment
from vehicle.identification.replay.state_cache import FORWARD_COLUMN
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effects import DISCREPANCY_KEY, EFFECTS_BY_ID, SPEED
from vehicle.model.tractor import Settings
from vehicle.records import DT_S

FIT_HORIZONS_S = (1.0, 5.0)  # chosen: soil noise dominates longer ones, receiver noise shorter ones
ERROR_KINDS = 3  # errors across, along and of the heading
TERM_ITERATIONS = 3  # chosen: candidates start where a linear prediction is best, and every step costs m simulations
SETTLED_GAIN = 0.01  # chosen, of the loss: the fit ends at a step that gains less; half of what a term must gain


@dataclass(frozen=True, eq=False)
class ModelTerm:
    """An effect or discrepancy term at coordinates; `runs` None means all runs."""

    parameters: EffectParameters
    coordinates: Array
    runs: frozenset[int] | None = None

    @property
    def value(self) -> dict[str, float]:
        """Values of the effect, or the amount of the discrepancy term."""
        return self.parameters.compute_values(self.coordinates)

    def is_active_in(self, run: int) -> bool:
        """Whether the term acts in a run."""
        return self.runs is None or run in self.runs


ModelTerms = tuple[ModelTerm, ...]


def collect_run_settings(terms: Sequence[ModelTerm], run: int) -> Settings:
    """Return the settings of one run."""
    settings: dict[str, dict[str, float]] = {}
    for term in terms:
        if term.is_active_in(run):
            key = DISCREPANCY_KEY if term.parameters.id in TERMS_BY_NAME else term.parameters.id
            settings[key] = settings.get(key, {}) | term.value
    return settings


@dataclass(frozen=True, eq=False)
class OpenLoopErrors:
    """The errors of a residual model under terms, as a vector (n,) in units of the errors without terms.

    Errors along the path are computed on top of the `tolerated` effects of the speed, which no term has to remove.
    `fixed_terms` act in addition to all others and are not fitted.
    """

    residual_model: ResidualModel
    tolerated: Settings = field(default_factory=dict)
    fixed_terms: ModelTerms = ()

    def compute_errors(self, terms: Sequence[ModelTerm]) -> Array:
        """Return all errors; the sum of their squares is 1 without terms."""
        return next(self.compute_errors_per_term_list([terms]))

    def compute_errors_per_term_list(self, term_lists: Sequence[Sequence[ModelTerm]]) -> Iterator[Array]:
        """As compute_errors, for many lists of terms, driven side by side."""
        acting = [(*self.fixed_terms, *terms) for terms in term_lists]
        settings_by_run = [{run: collect_run_settings(terms, run) for run in range(self.run_count)} for terms in acting]
        for batch in self.residual_model.split_batches(settings_by_run):
            for out in self._compute_unscaled_errors(batch):
                out /= self._error_scales
                yield out

    def _compute_unscaled_errors(self, settings_by_run: Sequence[Mapping[int, Settings]]) -> Iterator[Array]:
        """Return the vectors in metres and radians, one for the settings of every run."""
        segments = self.residual_model.dataset.segments
        pairs = [(segment, settings[segment.run]) for settings in settings_by_run for segment in segments]
        poses = simulate_poses(self.residual_model.rig, pairs, by_speed=True)
        for first in range(0, len(pairs), len(segments)):
            segment_poses = zip(pairs[first : first + len(segments)], poses[first : first + len(segments)], strict=True)
            errors = np.concatenate(
                [part for pair, pose in segment_poses for part in self._compute_anchored_errors(*pair, *pose)]
            ).ravel()
            yield errors if np.isfinite(errors).all() else np.nan_to_num(errors, copy=False)

    def _compute_anchored_errors(
        self, segment: DriveSegment, settings: Settings, antenna: Array, heading: Array
    ) -> Iterator[Array]:
        """Return the errors (k, 3) of one segment per horizon, from its simulated poses."""
        speed_gain = self._compute_distance_ahead_of_command(segment, settings)
        for bounds in self._piece_bounds[segment]:
            errors = compute_piece_errors(segment, antenna, heading, bounds)
            if speed_gain is not None:
                add_centred_values(*bounds, speed_gain, errors[:, 1])
            yield errors

    @cached_property
    def _piece_bounds(self) -> dict[DriveSegment, list[PieceBounds]]:
        """Pieces of every segment, by horizon."""
        return {
            segment: [find_piece_bounds(segment.time, horizon) for horizon in FIT_HORIZONS_S]
            for segment in self.residual_model.dataset.segments
        }

    def _compute_distance_ahead_of_command(self, segment: DriveSegment, settings: Settings) -> Array | None:
        """Return how far the measured speed has come beyond the commanded one, per row (m); None where one was not
        logged.

        The path is driven at the measured speed, so that speed errors do not bend it; the speed error itself is added
        along the path. Only effects of the speed change it.
        """
        if segment.target is None or not segment.speed_measured:
            return None
        speed_settings = dict(self.tolerated)
        speed_settings |= {
            name: values
            for name, values in settings.items()
            if name in EFFECTS_BY_ID and EFFECTS_BY_ID[name].block == SPEED
        }
        key = (segment.run, segment.start_s, str(speed_settings))
        if key not in self._cached_distances_ahead:
            states = replay_segment(
                self.residual_model.rig, segment, speed_settings, from_sensor=True, from_speed=False
            )
            gained = np.cumsum(segment.grids["speed"] - states[:, FORWARD_COLUMN]) * DT_S
            self._cached_distances_ahead[key] = np.interp(segment.time, np.arange(len(gained)) * DT_S, gained)
        return self._cached_distances_ahead[key]

    @cached_property
    def _cached_distances_ahead(self) -> dict[tuple[int, float, str], Array]:
        """Computed speed gains, by segment and settings of the speed."""
        return {}

    @cached_property
    def _error_scales(self) -> Array:
        """Size of the horizon and kind of every entry without terms, so that each of them sums to its share."""
        (raw_errors,) = self._compute_unscaled_errors([{run: {} for run in range(self.run_count)}])
        group = np.concatenate(
            [
                np.repeat(np.arange(len(FIT_HORIZONS_S)), segment.rows * ERROR_KINDS) * ERROR_KINDS
                + np.tile(np.arange(ERROR_KINDS), segment.rows * len(FIT_HORIZONS_S))
                for segment in self.residual_model.dataset.segments
            ]
        )
        sums = np.bincount(group, raw_errors * raw_errors, len(FIT_HORIZONS_S) * ERROR_KINDS)
        group_count = np.count_nonzero(sums)
        return np.asarray(np.sqrt(np.maximum(sums[group], 1e-12) * group_count))

    @cached_property
    def run_numbers(self) -> npt.NDArray[np.int64]:
        """Run of every entry."""
        segments = self.residual_model.dataset.segments
        return np.concatenate(
            [np.full(segment.rows * ERROR_KINDS * len(FIT_HORIZONS_S), segment.run) for segment in segments]
        )

    @cached_property
    def window_numbers(self) -> npt.NDArray[np.int64]:
        """Window of 20 s of every entry, counted through all runs."""
        numbers, count = [], 0
        for segment in self.residual_model.dataset.segments:
            window = count + compute_window_numbers(segment.time)
            numbers.append(np.tile(np.repeat(window, ERROR_KINDS), len(FIT_HORIZONS_S)))
            count = int(window[-1]) + 1
        return np.concatenate(numbers)

    @cached_property
    def window_runs_and_halves(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Run and half of every window."""
        count = int(self.window_numbers.max()) + 1
        runs, halves = np.zeros(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
        runs[self.window_numbers] = self.run_numbers
        first = 0
        for segment in self.residual_model.dataset.segments:
            size = int(compute_window_numbers(segment.time[-1:])[0]) + 1
            halves[first : first + size] = np.arange(size) % 2
            first += size
        return runs, halves

    @property
    def run_count(self) -> int:
        """Number of runs."""
        return len(self.residual_model.dataset.names)

    def sum_by_run(self, errors: Array) -> Array:
        """Return the sum of squares per run (runs,)."""
        return np.bincount(self.run_numbers, errors * errors, self.run_count).astype(np.float64)


@dataclass(frozen=True, eq=False)
class OpenLoopModel:
    """Fitted terms: `errors` (n,) are the remaining errors, `jacobian` (n, m) their change per coordinate."""

    terms: ModelTerms
    errors: Array
    jacobian: Array

    @property
    def loss(self) -> float:
        """Remaining squared error; 1 without terms."""
        return sum_squares(self.errors)

    @property
    def term_ids(self) -> frozenset[str]:
        """Ids in use."""
        return frozenset(term.parameters.id for term in self.terms)


@dataclass(frozen=True, eq=False)
class _TermProblem:
    """The least-squares problem of the open-loop error over the coordinates of terms."""

    loop: OpenLoopErrors
    terms: ModelTerms

    @cached_property
    def typical(self) -> Array:
        return flatten([term.parameters.typical for term in self.terms])

    @cached_property
    def low(self) -> Array:
        return flatten([term.parameters.low for term in self.terms])

    @cached_property
    def high(self) -> Array:
        return flatten([term.parameters.high for term in self.terms])

    @property
    def linear(self) -> None:
        return None

    @property
    def start(self) -> Array:
        return flatten([term.coordinates for term in self.terms])

    def build_terms_at(self, coordinates: Array) -> ModelTerms:
        """Return the terms at other coordinates."""
        terms, first = [], 0
        for term in self.terms:
            terms.append(replace(term, coordinates=coordinates[first : first + term.parameters.count]))
            first += term.parameters.count
        return tuple(terms)

    def compute_residuals(self, coordinates: Array, start: SolverPoint) -> Array:
        return self.loop.compute_errors(self.build_terms_at(coordinates))

    def compute_changes(self, places: Sequence[Array], axes: Sequence[int], start: SolverPoint) -> Iterator[Array]:
        return (
            errors - start.residuals
            for errors in self.loop.compute_errors_per_term_list(
                [self.build_terms_at(coordinates) for coordinates in places]
            )
        )


def shift_term_coordinates(terms: ModelTerms, change: Array) -> ModelTerms:
    """Return terms with changed coordinates, clipped to possible values."""
    moved_terms, first = [], 0
    for term in terms:
        count = term.parameters.count
        moved_terms.append(
            replace(term, coordinates=term.parameters.clip(term.coordinates + change[first : first + count]))
        )
        first += count
    return tuple(moved_terms)


def compute_new_terms_jacobian(loop: OpenLoopErrors, terms: ModelTerms, errors: Array, new_count: int) -> Array:
    """Return the change of the errors of all terms per coordinate of the last `new` of them."""
    problem = _TermProblem(loop, terms)
    first = sum(term.parameters.count for term in terms[: len(terms) - new_count])
    return compute_jacobian(problem, SolverPoint(problem.start, errors), FIRST_STEP, first)


def fit_terms(loop: OpenLoopErrors, terms: ModelTerms, iterations: int = TERM_ITERATIONS) -> OpenLoopModel:
    """Fit all coordinates of the terms together."""
    problem = _TermProblem(loop, terms)
    start = SolverPoint(problem.start, loop.compute_errors(terms))

    def is_settled(before: SolverPoint, after: SolverPoint) -> bool:
        return before.loss - after.loss < SETTLED_GAIN * after.loss

    rule = StopRule(iterations if terms else 0, is_settled, first_step=LATER_STEP)
    end = update_outdated_jacobian(problem, minimise_loss(problem, start, rule))
    return OpenLoopModel(problem.build_terms_at(end.coordinates), end.residuals, end.jacobian)


def build_normal_equations(loop: OpenLoopErrors, model: OpenLoopModel) -> NormalEquations:
    """Return normal equations per window of 20 s."""
    count, size = int(loop.window_numbers.max()) + 1, model.jacobian.shape[1]
    squares, sides = np.zeros((count, size, size)), np.zeros((count, size))
    add_block_products(loop.window_numbers, model.jacobian, model.errors, squares, sides)
    return NormalEquations(squares, sides, *loop.window_runs_and_halves)


def compute_steps_to_neutral(terms: ModelTerms) -> Array:
    """Return the change of the coordinates that removes every term."""
    parts = [np.array(term.parameters.neutral) - term.coordinates for term in terms]
    return np.concatenate(parts) if parts else np.zeros(0)


def estimate_held_out_loss(loop: OpenLoopErrors, model: OpenLoopModel) -> float:
    """Return the squared error with the coordinates of every window fitted to other runs (or windows)."""
    pieces = build_normal_equations(loop, model)
    total = model.loss
    for run, steps in compute_held_out_steps(pieces, compute_steps_to_neutral(model.terms)).items():
        for half, step in enumerate(steps):
            is_half = (pieces.runs == run) & (pieces.halves == half)
            square, side = pieces.squares[is_half].sum(axis=0), pieces.sides[is_half].sum(axis=0)
            total += float(2.0 * step @ side + step @ square @ step)
    return total
