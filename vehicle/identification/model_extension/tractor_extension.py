"""What a diagnosis adds to a tractor: terms with values and intervals, settings for held-out data, and the extended
tractor."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field

import numpy as np

from vehicle.identification.cause_selection.evidence import compute_small_sample_widening
from vehicle.identification.cause_selection.tolerances import estimate_value_covariance
from vehicle.identification.fit.effect_parameters import find_finest_size
from vehicle.identification.fit.open_loop import (
    ModelTerm,
    ModelTerms,
    OpenLoopErrors,
    build_normal_equations,
    collect_run_settings,
    compute_steps_to_neutral,
    shift_term_coordinates,
)
from vehicle.identification.fit.residual_fit import (
    EffectFit,
    NormalEquations,
    compute_held_out_steps,
    sum_normal_equations_by_block,
)
from vehicle.identification.logs.schema import Array
from vehicle.identification.model_extension.term_proposals import select_level, select_main_terms, sum_driving_time
from vehicle.identification.model_extension.term_search import OpenLoopFit
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.replay.horizon_errors import (
    HalfSettings,
    simulate_instruments,
    sum_squared_errors_by_horizon,
)
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import DRIVE_LINE_S, SENSOR_TIMING_S, TIMING_S, TOLERANCE_SHARE
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import INTERVAL_SIGMAS, Interval
from vehicle.model.effects import POSITION, SPEED, STEERING, STEERING_SPEED, get_effect
from vehicle.model.tractor import DiscrepancyModel, EffectSetting, Settings, Tractor


@dataclass(frozen=True, eq=False)
class ModelExtension:
    """Terms in use, 95 % intervals of their values by id, and the settings of every run for its even and odd windows.

    For an effect with two levels the interval is that of the longer driving. `tolerant_intervals` are at least as wide
    as the tolerance of the tractor file, and of two levels that farther from neutral: the basis of claims.
    """

    terms: ModelTerms
    intervals: Mapping[str, Mapping[str, Interval]]
    held_out_settings: Mapping[int, HalfSettings]
    tolerant_intervals: Mapping[str, Mapping[str, Interval]] = field(default_factory=dict)

    @property
    def term_ids(self) -> frozenset[str]:
        """Effects and discrepancy terms in use."""
        return frozenset(term.parameters.id for term in self.terms)

    def select_held_out_settings(self, names: Collection[str]) -> dict[int, HalfSettings]:
        """Return held-out settings with the named effects alone."""
        return self._filter_held_out_settings(lambda name: name in names)

    def drop_held_out_effect(self, name: str) -> dict[int, HalfSettings]:
        """Return held-out settings without one effect."""
        return self._filter_held_out_settings(lambda other: other != name)

    def merge(self, other_extension: ModelExtension) -> ModelExtension:
        """Combine both; for common effects `other` counts."""

        def join_halves(run: int) -> HalfSettings:
            (even, odd), (other_even, other_odd) = self.held_out_settings[run], other_extension.held_out_settings[run]
            return {**even, **other_even}, {**odd, **other_odd}

        own_ids = {term.parameters.id for term in self.terms}
        own_intervals, own_tolerant = (
            {name: interval_map[name] for name in own_ids if name in interval_map}
            for interval_map in (self.intervals, self.tolerant_intervals)
        )
        return ModelExtension(
            (*self.terms, *other_extension.terms),
            {**own_intervals, **other_extension.intervals},
            {run: join_halves(run) for run in self.held_out_settings},
            {**own_tolerant, **other_extension.tolerant_intervals},
        )

    def _filter_held_out_settings(self, is_kept: Callable[[str], bool]) -> dict[int, HalfSettings]:
        def filter_half(half: Settings) -> Settings:
            return {name: values for name, values in half.items() if is_kept(name)}

        return {run: (filter_half(even), filter_half(odd)) for run, (even, odd) in self.held_out_settings.items()}


def build_fit_extension(residual_model: ResidualModel, fit: EffectFit, names: Collection[str]) -> ModelExtension:
    """Build the extension of the named effects from a fit to the residuals."""
    terms = tuple(ModelTerm(parameters, coordinates) for parameters, coordinates in fit.parts)
    jacobian = drop_tractor_difference_columns(fit)
    extra_columns = jacobian.shape[1] - sum(parameters.count for parameters, _ in fit.parts)
    sums = sum_normal_equations_by_block(residual_model, jacobian, fit.residuals)
    pieces = NormalEquations(sums.squares, sums.sides, residual_model.block_runs, residual_model.block_halves)
    steps = compute_held_out_steps(pieces, np.concatenate([compute_steps_to_neutral(terms), np.zeros(extra_columns)]))
    covariance = estimate_value_covariance(residual_model, fit) if fit.jacobian.size else np.zeros((0, 0))
    placed_terms = [
        (term, covariance[place, place]) for term, place in zip(terms, _list_coordinate_slices(terms), strict=True)
    ]
    intervals = {
        term.parameters.id: compute_value_interval(term, term_covariance, compute_shared_error(residual_model, term))
        for term, term_covariance in placed_terms
    }
    tolerant = {
        term.parameters.id: compute_value_interval(term, term_covariance, get_tolerance(residual_model, term))
        for term, term_covariance in placed_terms
    }
    held_out: dict[int, HalfSettings] = {
        run: (
            collect_run_settings(shift_term_coordinates(terms, half_steps[0]), run),
            collect_run_settings(shift_term_coordinates(terms, half_steps[1]), run),
        )
        for run, half_steps in steps.items()
    }
    whole_extension = ModelExtension(terms, intervals, held_out)
    kept_terms = tuple(term for term in terms if term.parameters.id in names)
    return ModelExtension(kept_terms, intervals, whole_extension.select_held_out_settings(names), tolerant)


def drop_tractor_difference_columns(fit: EffectFit) -> Array:
    """Remove the columns of differences between tractors from the jacobian of a fit.

    They are the same in every run, so no effect may give way to them where a run is held out.
    """
    if fit.linear_terms is None:
        return fit.jacobian
    first = fit.jacobian.shape[1] - fit.linear_terms.columns.shape[1]
    return np.delete(fit.jacobian, slice(first, first + fit.linear_terms.unknown_count), axis=1)


def build_open_loop_extension(open_loop_fit: OpenLoopFit) -> ModelExtension:
    """Build the extension of the terms that lower the open-loop error."""
    loop, model = open_loop_fit.loop, open_loop_fit.model
    pieces = build_normal_equations(loop, model)
    steps = compute_held_out_steps(pieces, compute_steps_to_neutral(model.terms))
    inverse = np.linalg.pinv(pieces.squares.sum(axis=0), hermitian=True)
    widening = compute_small_sample_widening(pieces.squares, inverse)
    covariance = inverse @ (pieces.sides.T @ pieces.sides) @ inverse * np.outer(widening, widening)
    seconds = sum_driving_time(loop.residual_model.dataset)
    longest = select_main_terms(model.terms, seconds)
    term_intervals = [
        (
            term,
            compute_value_interval(
                term, covariance[place, place], _compute_open_loop_uncertainty(loop.residual_model, term)
            ),
        )
        for term, place in zip(model.terms, _list_coordinate_slices(model.terms), strict=True)
    ]
    intervals = {term.parameters.id: interval for term, interval in term_intervals if term in longest}
    # Of two grounds, the one further from neutral shows whether there is an effect.
    effects = sorted(
        (
            effect_interval
            for effect_interval in term_intervals
            if effect_interval[0].parameters.id not in TERMS_BY_NAME
        ),
        key=lambda effect_interval: effect_interval[0].parameters.compute_deviation(effect_interval[0].coordinates),
    )
    clearest = {term.parameters.id: interval for term, interval in effects}
    held_out = {run: _build_held_out_settings(loop, run, model.terms, half_steps) for run, half_steps in steps.items()}
    return ModelExtension(model.terms, intervals, held_out, clearest)


def _list_coordinate_slices(terms: ModelTerms) -> list[slice]:
    ends = np.cumsum(np.array([term.parameters.count for term in terms], dtype=np.int64))
    return [slice(int(end) - term.parameters.count, int(end)) for term, end in zip(terms, ends, strict=True)]


def _build_held_out_settings(
    loop: OpenLoopErrors, run: int, terms: ModelTerms, steps: tuple[Array, Array]
) -> HalfSettings:
    """Return the settings of a held-out run: of two levels, each half takes the one that suits the other half.

    So the simulated data determined neither the values nor the ground.
    """
    options = [select_level(terms, level) for level in (0, 1)]
    if len(options[0]) == len(terms):
        return collect_run_settings(shift_term_coordinates(terms, steps[0]), run), collect_run_settings(
            shift_term_coordinates(terms, steps[1]), run
        )
    chosen = []
    for half, step in enumerate(steps):
        level_settings = [
            collect_run_settings(select_level(shift_term_coordinates(terms, step), level), run) for level in (0, 1)
        ]
        acting_settings = [
            {**collect_run_settings(loop.fixed_terms, run), **level_of_run} for level_of_run in level_settings
        ]
        losses = [
            _compute_half_loss(loop.residual_model, run, level_of_run, 1 - half) for level_of_run in acting_settings
        ]
        if not any(losses):  # a run too short for two halves determines its own ground
            losses = [
                _compute_half_loss(loop.residual_model, run, level_of_run, half) for level_of_run in acting_settings
            ]
        chosen.append(level_settings[int(losses[1] < losses[0])])
    return chosen[0], chosen[1]


def _compute_half_loss(
    residual_model: ResidualModel, run: int, settings: Mapping[str, Mapping[str, float]], half: int
) -> float:
    """Return the squared error over 1 s of one half of a run, along the path as well where the speed was measured.

    A level of the speed shows along the path alone.
    """
    total, kinds = 0.0, 2 if residual_model.has_measured_speed else 1
    for segment in residual_model.dataset.get_segments(run):
        antenna, heading, _, _ = simulate_instruments(residual_model.rig, segment, settings)
        total += float(sum_squared_errors_by_horizon(segment, antenna, heading, half)[1.0][:kinds].sum())
    return total


def compute_value_interval(term: ModelTerm, covariance: Array, finest: float) -> dict[str, Interval]:
    """Return the 95 % interval of the values of a term from the covariance of its coordinates and `finest`.

    The place of an effect such as a patch is searched and not fitted: no interval is claimed for it.
    """
    parameters = term.parameters
    if parameters.id in TERMS_BY_NAME:
        amount, sigma = float(term.coordinates[0]), float(np.sqrt(np.maximum(np.diag(covariance), 0.0))[0])
        return {parameters.id: (amount - INTERVAL_SIGMAS * sigma, amount + INTERVAL_SIGMAS * sigma)}
    return parameters.compute_interval(term.coordinates, covariance, finest)


def get_tolerance(residual_model: ResidualModel, term: ModelTerm) -> float:
    """Return the tolerance of the tractor file for a term, for a time at least half a row; 0 for a discrepancy term."""
    return (
        0.0
        if term.parameters.id in TERMS_BY_NAME
        else find_finest_size(
            residual_model.rig.tractor, term.parameters.id, residual_model.get_interval_s(term.parameters.id)
        )
    )


def _compute_open_loop_uncertainty(residual_model: ResidualModel, term: ModelTerm) -> float:
    """Return the uncertainty of a value from the open-loop error, which does not allow for differences between
    tractors."""
    return max(get_tolerance(residual_model, term), compute_shared_error(residual_model, term, open_loop=True))


def compute_shared_error(residual_model: ResidualModel, term: ModelTerm, open_loop: bool = False) -> float:
    """Return the error (95 %) of a value that all runs share, however small its scatter.

    Commands take effect somewhere between two rows in which they were measured, and drive lines differ. The way a
    steering valve stops and starts differs between makes, and noise of the wheel sensor pushes a play from both sides.
    Other differences between tractors are part of the fit to the residuals and leave a share of the tolerance; the
    open-loop error does not contain them.
    """
    if term.parameters.id in TERMS_BY_NAME:
        return 0.0
    entry = get_effect(term.parameters.id)
    if entry.size.unit == "s" and entry.block == POSITION:
        # A late position, a late turning and an early speed look alike in the path; their priors separate them.
        return INTERVAL_SIGMAS * SENSOR_TIMING_S * (1.0 if open_loop else 1.0 / math.sqrt(3.0))
    if entry.size.unit == "s":
        sigma = DRIVE_LINE_S if entry.block == SPEED else TIMING_S
        return INTERVAL_SIGMAS * math.hypot(sigma, residual_model.get_interval_s(entry.id) / math.sqrt(12.0))
    is_whole_tolerance = open_loop or entry.block == STEERING or STEERING_SPEED in entry.plot
    return get_tolerance(residual_model, term) * (1.0 if is_whole_tolerance else TOLERANCE_SHARE)


FILE_DIGITS = 6  # significant digits of a value in a file: far finer than any interval


@dataclass(frozen=True)
class EquivalentEffect:
    """An effect in a tractor file that the logs cannot distinguish from others: its interval and the others."""

    interval: Mapping[str, Interval] | None
    equivalent_to: tuple[str, ...]


def build_extended_tractor(
    dataset: DriveDataset,
    tractor: Tractor,
    ground: str,
    extension: ModelExtension,
    named: Collection[str],
    equivalents: Mapping[str, EquivalentEffect],
    kept_ids: Collection[str],
) -> Tractor:
    """Return the tractor with the terms of an extension, their intervals and the logs they came from.

    `named` are the effects with a name, `equivalents` those that the logs cannot distinguish from others: their
    intervals extend to neutral. Effects of the file that these logs do not show (`unseen`) stay unchanged.
    """
    effects = {name: setting for name, setting in tractor.effects.items() if name in kept_ids}
    amounts: dict[str, float] = {}
    spread: dict[str, Interval] = {}
    for term in select_main_terms(extension.terms, sum_driving_time(dataset)):
        name, value, interval = term.parameters.id, term.value, dict(extension.intervals[term.parameters.id])
        if name in TERMS_BY_NAME:
            amounts, spread = amounts | value, spread | interval
            continue
        if not all(math.isfinite(number) for number in value.values()):
            continue  # a limit that is never reached: a ground on which nothing slides
        equivalent_to: tuple[str, ...] = ()
        if name in equivalents:
            interval, equivalent_to = dict(equivalents[name].interval or interval), equivalents[name].equivalent_to
        runs = range(len(dataset.names)) if term.runs is None else sorted(term.runs)
        effects[name] = EffectSetting(
            value={key: _round_value(number) for key, number in value.items()},
            interval={key: (_round_value(low), _round_value(high)) for key, (low, high) in interval.items()},
            named=name in named,
            equivalent_to=equivalent_to,
            ground=ground,
            logs=tuple(dataset.names[run] for run in runs),
        )
    discrepancy = _build_discrepancy(dataset, amounts, spread) if amounts else None
    return tractor.model_copy(update={"effects": effects, "discrepancy_model": discrepancy})


def _round_value(value: float) -> float:
    """Round a value to the digits that a file needs."""
    return float(f"{value:.{FILE_DIGITS}g}")


def _build_discrepancy(
    dataset: DriveDataset, amounts: dict[str, float], intervals: dict[str, Interval]
) -> DiscrepancyModel:
    """Build the discrepancy model, trusted where nearly all of the driving was."""
    speeds = np.concatenate([segment.speed_in_gear for segment in dataset.segments])
    angles = [segment.wheel if segment.wheel is not None else segment.command for segment in dataset.segments]
    degrees = np.degrees(np.concatenate([segment for segment in angles if segment is not None]))
    fast, low, high = float(np.quantile(speeds, 0.995)), *(float(np.quantile(degrees, q)) for q in (0.005, 0.995))
    slow = min(float(np.quantile(speeds, 0.005)), 0.9 * fast)
    if high - low < 1.0:
        low, high = low - 0.5, high + 0.5
    return DiscrepancyModel(
        amounts={name: _round_value(amount) for name, amount in amounts.items()},
        speed_mps=(_round_value(max(slow, 0.0)), _round_value(max(fast, 0.01))),
        angle_deg=(_round_value(low), _round_value(high)),
        interval={
            name: (_round_value(segment), _round_value(high_end)) for name, (segment, high_end) in intervals.items()
        },
        logs=dataset.names,
    )
