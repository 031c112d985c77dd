"""The basis of a verdict: the fit, the terms added to the tractor, held-out errors and the noise floor, in a subset and
in all of the logs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import Projector
from vehicle.identification.cause_selection.refit import refit_with_covariates
from vehicle.identification.cause_selection.selection import CauseSelection
from vehicle.identification.fit import open_loop
from vehicle.identification.fit.open_loop import ModelTerm, ModelTerms, collect_run_settings
from vehicle.identification.fit.residual_fit import EffectFit
from vehicle.identification.logs.schema import Array
from vehicle.identification.model_extension.term_proposals import select_level, select_main_terms, sum_driving_time
from vehicle.identification.model_extension.tractor_extension import ModelExtension, compute_shared_error, get_tolerance
from vehicle.identification.replay.data_subset import DataSubset
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.horizon_errors import (
    HalfSettings,
    HorizonSquares,
    compute_relative_run_errors,
    simulate_instruments,
    sum_squared_errors_by_run,
)
from vehicle.identification.residuals.noise_floor import compute_noise_floor
from vehicle.identification.residuals.noise_weights import (
    build_channels,
    estimate_first_noise,
    estimate_soil_and_speed_noise,
)
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    ABOVE_NOISE_FLOOR_FACTOR,
    ABOVE_NOISE_FLOOR_PER_ROW_S,
    CLEARLY_BEYOND_FACTOR,
    FEW_PIECES_SIGMAS,
)
from vehicle.model.effects import SPEED, STEERING, STEERING_SPEED, get_effect
from vehicle.model.tractor import Settings, Tractor

ERROR_PIECE_S = 5.0  # horizon of the errors in a verdict
BOOTSTRAP_SAMPLES = 400  # resampled sets of runs: chosen, the printed digits of an interval no longer change


@dataclass(frozen=True, eq=False)
class DiagnosisCase:
    """The basis of findings: the fit to the residuals, the extension of the tractor, and the noise floor.

    Errors are computed on top of the `tolerated` settings (see collect_calibrations). `refused_effects` are effects
    that the residuals supported, without a gain on held-out runs.
    """

    residual_model: ResidualModel
    fit: EffectFit
    extension: ModelExtension
    noise_floor: list[HorizonSquares]
    tolerated: Settings = field(default_factory=dict)
    refused_effects: frozenset[str] = frozenset()

    @property
    def tractor(self) -> Tractor:
        """The tractor without effects."""
        return self.residual_model.rig.tractor

    @cached_property
    def main_terms(self) -> dict[str, ModelTerm]:
        """Terms by id; the level of the longer driving where an effect has two levels."""
        main = select_main_terms(self.extension.terms, sum_driving_time(self.residual_model.dataset))
        return {term.parameters.id: term for term in main}

    @property
    def found_values(self) -> dict[str, dict[str, float]]:
        """Values of the terms added to the tractor."""
        return {name: term.value for name, term in self.main_terms.items()}

    @cached_property
    def fit_without_terms(self) -> EffectFit:
        """The fit of the effects without unnamed terms."""
        return refit_with_covariates(self.residual_model, self.fit, ())

    @cached_property
    def remaining_misfit(self) -> float:
        """Remaining squared error in units of the noise floor, at least 1: it hides small effects."""
        return max(1.0, float(self.final_errors.sum()) / float(self.compute_run_errors(self.noise_floor).sum()))

    def compute_run_errors(self, squares: list[HorizonSquares], horizon: float = ERROR_PIECE_S) -> Array:
        """Return the squared error of every run over a horizon, in units of the noise floor."""
        has_speed = all(segment.speed_measured for segment in self.residual_model.dataset.segments)
        return compute_relative_run_errors(squares, self.noise_floor, has_speed, horizon)

    def simulate_run_errors(self, settings: Mapping[int, HalfSettings], by_speed: bool = False) -> Array:
        """Return the error of every run; `by_speed` is that of simulate_instruments."""
        return self.compute_run_errors(self.simulate_squares(settings, by_speed))

    def simulate_squares(self, settings: Mapping[int, HalfSettings], by_speed: bool = False) -> list[HorizonSquares]:
        """Return the squared errors of every run by horizon, on top of the tolerated settings."""
        tolerated_settings: dict[int, HalfSettings] = {
            run: ({**self.tolerated, **even}, {**self.tolerated, **odd}) for run, (even, odd) in settings.items()
        }
        return sum_squared_errors_by_run(
            self.residual_model.dataset, self.residual_model.rig, tolerated_settings, by_speed
        )

    def compute_held_out_gain(self, name: str) -> tuple[float, tuple[float, float]]:
        """Return the percentage of held-out error over 5 s that an effect removes, with a 90 % interval over runs.

        Effects other than of the speed are judged at the measured speed.
        """
        if get_effect(name).block == SPEED:
            return estimate_error_reduction(
                self.simulate_run_errors(self.extension.drop_held_out_effect(name)), self.final_errors
            )
        return estimate_error_reduction(
            self.simulate_run_errors(self.extension.drop_held_out_effect(name), by_speed=True),
            self.final_errors_by_speed,
        )

    @cached_property
    def final_errors(self) -> Array:
        """Error of every run with everything that was found."""
        return self.simulate_run_errors(self.extension.held_out_settings)

    @cached_property
    def final_errors_by_speed(self) -> Array:
        """The same at the speed that was measured."""
        return self.simulate_run_errors(self.extension.held_out_settings, by_speed=True)

    @cached_property
    def fitted_residuals(self) -> tuple[Array, Projector]:
        """Residuals (n,) with the effects of the fit and without linear terms, and the projector of the fit."""
        return self.residual_model.compute_residuals(self.fit.settings), Projector(self.fit.jacobian)

    def compute_residuals_without(self, name: str) -> tuple[Array, Projector]:
        """As fitted_residuals, without one effect and its columns."""
        other_settings = {other_name: values for other_name, values in self.fit.settings.items() if other_name != name}
        return self.residual_model.compute_residuals(other_settings), Projector(
            np.delete(self.fit.jacobian, self.fit.find_columns(name), axis=1)
        )

    def compute_gain_where_visible(self, name: str) -> float:
        """Return the gain (percent) where the effect shows: of the wheel angle for the steering, else of the path."""
        if get_effect(name).block == STEERING and self.residual_model.has_measured_wheel_angle:
            settings = self.extension.drop_held_out_effect(name), self.extension.held_out_settings
            return estimate_error_reduction(
                *(_sum_wheel_squares(self.residual_model, half_settings) for half_settings in settings)
            )[0]
        return self.compute_held_out_gain(name)[0]


def _sum_wheel_squares(residual_model: ResidualModel, settings: Mapping[int, HalfSettings]) -> Array:
    """Return the squared error of the simulated wheel angle per run."""
    sums = np.zeros(len(residual_model.dataset.names))
    for segment in residual_model.dataset.segments:
        wheel = simulate_instruments(residual_model.rig, segment, settings[segment.run][0])[2]
        if segment.wheel is not None:
            sums[segment.run] += float(np.sum((segment.wheel - wheel) ** 2))
    return sums


def estimate_error_reduction(worse_errors: Array, final_errors: Array) -> tuple[float, tuple[float, float]]:
    """Return the percentage of the root mean square error that is removed, with a 90 % interval over runs."""
    rng = np.random.default_rng(11)
    sampled_runs = rng.integers(0, len(worse_errors), size=(BOOTSTRAP_SAMPLES, len(worse_errors)))
    shares = 100.0 * (
        1.0
        - np.sqrt(final_errors[sampled_runs].sum(axis=1) / np.maximum(worse_errors[sampled_runs].sum(axis=1), 1e-12))
    )
    gain_pct = 100.0 * (1.0 - math.sqrt(float(final_errors.sum()) / max(float(worse_errors.sum()), 1e-12)))
    return gain_pct, (float(np.quantile(shares, 0.05)), float(np.quantile(shares, 0.95)))


def build_case(selection: CauseSelection, extension: ModelExtension) -> DiagnosisCase:
    """Build the case of a selection and an extension, with the noise floor of these logs."""
    residual_model = restore_real_noise(selection.residual_model, selection.fit)
    runs = range(len(residual_model.dataset.names))
    settings = {run: collect_run_settings(extension.terms, run) for run in runs}
    tolerated = collect_calibrations(selection)
    noise_floor = compute_noise_floor(residual_model, settings, tolerated=tolerated)
    return DiagnosisCase(selection.residual_model, selection.fit, extension, noise_floor, tolerated, selection.refused)


def collect_calibrations(selection: CauseSelection) -> Settings:
    """Return the effects of the fit that are calibrations, with their values."""
    residual_model = selection.residual_model
    terms = (ModelTerm(parameters, coordinates) for parameters, coordinates in selection.fit.parts)
    return {
        term.parameters.id: term.parameters.compute_values(term.coordinates)
        for term in terms
        if is_calibration(residual_model, term)
    }


def is_calibration(residual_model: ResidualModel, term: ModelTerm) -> bool:
    """Whether an effect of the speed, a time or a play of the steering is within the tolerance of any tractor.

    Drive lines differ by more than the tolerance, as a lag is what many shapes of a start look like. All steering is
    late by the interval of commands and rows, which no file contains, and by what its own shape looks like; the way
    wheels of any make come to rest looks like a small play.
    """
    entry = get_effect(term.parameters.id)
    of_steering = (entry.block == STEERING and entry.size.unit == "s") or STEERING_SPEED in entry.plot
    factor = CLEARLY_BEYOND_FACTOR if entry.block == SPEED and entry.size.unit == "s" else 1.0
    beat_allowance = compute_shared_error(residual_model, term) if of_steering else 0.0
    return (of_steering or entry.block == SPEED) and term.parameters.compute_deviation(
        term.coordinates
    ) <= factor * get_tolerance(residual_model, term) + beat_allowance


def restore_real_noise(residual_model: ResidualModel, fit: EffectFit) -> ResidualModel:
    """Return the residual model with the noise of the logs, not the wider noise used where the model is very wrong."""
    return replace(
        residual_model,
        noise=estimate_soil_and_speed_noise(
            residual_model.dataset, residual_model.rig, estimate_first_noise(residual_model.dataset), fit.settings
        ),
    )


def is_within_noise(case: DiagnosisCase, error: Array, by_chance: bool = False, horizon: float = ERROR_PIECE_S) -> bool:
    """Whether an error over a horizon is no more than noise, and unobserved motion between rows, would leave.

    `by_chance` allows for the scatter of few pieces: used for the remaining error, but never for a name.
    """
    noise_floor = float(case.compute_run_errors(case.noise_floor, horizon).sum())
    few_pieces_factor = 1.0 + (
        compute_small_sample_spread(case.residual_model.dataset.seconds, horizon) if by_chance else 0.0
    )
    return (
        float(error.sum())
        < (
            max(ABOVE_NOISE_FLOOR_FACTOR, few_pieces_factor)
            + ABOVE_NOISE_FLOOR_PER_ROW_S * case.residual_model.row_interval_s
        )
        * noise_floor
    )


def find_horizons_above_noise(case: DiagnosisCase, squares: list[HorizonSquares]) -> tuple[float, ...]:
    """Return the horizons (s) with errors above noise, allowing for the scatter of few pieces."""
    driven_horizons = [
        horizon for horizon in squares[0] if sum(run_squares_of[horizon][3] for run_squares_of in squares) > 0.0
    ]
    return tuple(
        horizon
        for horizon in driven_horizons
        if not is_within_noise(case, case.compute_run_errors(squares, horizon), True, horizon)
    )


def compute_small_sample_spread(seconds: float, piece_s: float = ERROR_PIECE_S) -> float:
    """Return how far two mean squares differ by chance for the pieces of this much driving, as a share.

    A mean of n squares has a variance of 2 / n, the noise floor is drawn as often, and a piece has three errors.
    """
    pieces = max(seconds / piece_s, 1.0)
    return FEW_PIECES_SIGMAS * math.sqrt(4.0 / (3.0 * pieces))


def compute_noise_error_share(case: DiagnosisCase) -> float:
    """Return the share of the open-loop error without terms that noise alone would leave; all horizons and kinds weigh
    the same."""
    runs = range(len(case.residual_model.dataset.names))
    before = sum_squared_errors_by_run(case.residual_model.dataset, case.residual_model.rig, {run: {} for run in runs})
    shares = []
    for horizon in open_loop.FIT_HORIZONS_S:
        sums = [
            np.sum([run_sums[horizon][:3] for run_sums in squares], axis=0) for squares in (case.noise_floor, before)
        ]
        shares += [float(noise / run_total) for noise, run_total in zip(*sums, strict=True) if run_total > 0.0]
    return min(float(np.mean(shares)), 1.0) if shares else 0.0


def build_whole_dataset_case(dataset: DriveDataset, subset: DataSubset, case: DiagnosisCase) -> DiagnosisCase:
    """Return the case of a subset with the errors of the whole dataset; unchanged where the subset is the whole.

    Runs outside the subset had no part in the fit, and are driven with everything found.
    """
    if subset.dataset is dataset:
        return case
    # Filters of the path need most memory and only serve to find causes, which the subset did.
    noise = restore_real_noise(case.residual_model, case.fit).noise
    residual_model = ResidualModel(
        dataset,
        case.residual_model.rig,
        noise,
        (),
        *build_channels(dataset, case.residual_model.rig, case.fit.settings),
    )
    settings, held_out = collect_whole_settings(dataset, subset, case)
    noise_floor = compute_noise_floor(residual_model, settings, tolerated=case.tolerated)
    return replace(
        case,
        residual_model=residual_model,
        extension=replace(case.extension, held_out_settings=held_out),
        noise_floor=noise_floor,
    )


def collect_whole_settings(
    dataset: DriveDataset, subset: DataSubset, case: DiagnosisCase
) -> tuple[dict[int, Settings], dict[int, HalfSettings]]:
    """Return the settings of every run of the whole dataset, and those for its held-out windows.

    A run whose rows are all left out has no window.
    """
    unseen = _choose_unseen_settings(dataset, subset, case)
    settings = {run: collect_run_settings(case.extension.terms, number) for number, run in enumerate(subset.runs)}
    held_out: dict[int, HalfSettings] = {
        run: case.extension.held_out_settings.get(number, (settings[run], settings[run]))
        for number, run in enumerate(subset.runs)
    }
    return {**settings, **unseen}, {**held_out, **{run: (one, one) for run, one in unseen.items()}}


def list_level_settings(terms: ModelTerms) -> list[Settings]:
    """Return the settings that a run outside the fit may have: two where an effect has two levels."""
    levels = [collect_run_settings(select_level(terms, level), 0) for level in (0, 1)]
    return levels[:1] if levels[0] == levels[1] else levels


def _choose_unseen_settings(dataset: DriveDataset, subset: DataSubset, case: DiagnosisCase) -> Mapping[int, Settings]:
    """Return the settings of runs outside the subset; of two levels, the one that suits a run better."""
    terms: ModelTerms = case.extension.terms
    unseen = [run for run in range(len(dataset.names)) if run not in subset.runs]
    levels = list_level_settings(terms)
    if len(levels) == 1:
        return dict.fromkeys(unseen, levels[0])
    unseen_dataset = replace(
        dataset,
        segments=tuple(level_settings for level_settings in dataset.segments if level_settings.run not in subset.runs),
    )
    errors = [
        case.compute_run_errors(
            sum_squared_errors_by_run(
                unseen_dataset, case.residual_model.rig, dict.fromkeys(range(len(dataset.names)), level_settings)
            )
        )
        for level_settings in levels
    ]
    better = np.argmin(errors, axis=0)
    return {run: levels[better[run]] for run in unseen}
