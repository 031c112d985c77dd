"""Challenges of a settled model: every cause against each other effect of its block and the adjacent ones.

An effect enters while others are missing, so the first to enter may stand in for the true one. When nothing more
enters, each part is removed in turn, and every competitor is fitted in its place from several starts. One that explains
more, in all runs and in held-out runs, replaces it; one that explains as much is reported with the drive that decides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from vehicle.identification.cause_selection.candidate_fit import (
    CandidateFit,
    EffectTraces,
    Projector,
    compute_needed_gain,
    fit_candidate,
)
from vehicle.identification.cause_selection.covariates import ErrorCovariate
from vehicle.identification.cause_selection.evidence import estimate_held_out_losses, list_nameable_parts
from vehicle.identification.cause_selection.refit import add_candidate, refit_with_covariates, refit_without
from vehicle.identification.cause_selection.tolerances import (
    LEAST_INFORMATION,
    SIDE_DRAFT,
    compute_crab_column,
    is_within_tolerances,
)
from vehicle.identification.fit.column_products import stack_columns, sum_squares
from vehicle.identification.fit.effect_parameters import EffectParameters, build_parameters, find_finest_size
from vehicle.identification.fit.residual_fit import EffectFit, refine_fit
from vehicle.identification.logs.schema import Array
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    EXCHANGEABLE_SHARE,
    LEAST_GAIN,
    LEAST_WITHIN_RUNS_SHARE,
    LOOK_ALIKE_LOSS,
    LOOK_ALIKE_SHARE,
    MOST_REFITTED,
    OPEN_LOOK_ALIKE_SHARE,
    PREDICTED_SHARE,
)
from vehicle.model.effects import CATALOGUE, PATH, POSITION, SPEED, STEERING, get_effect
from vehicle.model.tractor import Tractor

Lookalikes = Mapping[str, dict[str, float]]


@dataclass(frozen=True, eq=False)
class ChallengeOutcome:
    """Result of a challenge: the better fit, if any, or the equivalent effects and their values by name."""

    better_fit: EffectFit | None = None
    unnamed: tuple[ErrorCovariate, ...] = ()
    lookalikes: Mapping[str, Lookalikes] = field(default_factory=dict)


def find_adjacent_blocks(residual_model: ResidualModel, block: str) -> frozenset[str]:
    """Return the blocks whose effects could stand in for one of a block: sensors cut the chain between blocks."""
    joined = {PATH, POSITION}
    joined |= set() if residual_model.has_measured_wheel_angle else {STEERING}
    joined |= set() if residual_model.has_measured_speed else {SPEED}
    return frozenset(joined) if block in joined else frozenset({block})


def challenge_causes(
    residual_model: ResidualModel, fit: EffectFit, unnamed: tuple[ErrorCovariate, ...], tractor: Tractor
) -> ChallengeOutcome:
    """Challenge every part that may be named, and the covariates."""
    if unnamed:
        fit_without_terms = _fit_without_covariates(residual_model, fit, tractor)
        if fit_without_terms is not None:
            return ChallengeOutcome(fit_without_terms)
    lookalikes: dict[str, Lookalikes] = {}
    names = list_nameable_parts(residual_model, fit, tractor)
    # For a single part the traces cost as much as the fits they save.
    traces = (
        EffectTraces(residual_model.compute_changes, fit, residual_model.compute_residuals(fit.settings))
        if len(names) > 1
        else None
    )
    for name in names:
        better, lookalikes[name] = _find_competitors(residual_model, fit, name, traces)
        if better is not None:
            return ChallengeOutcome(better, unnamed)
    return ChallengeOutcome(lookalikes=lookalikes)


def drop_exchangeable(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Return the fit without the less needed of two effects of instruments of which either alone explains nearly what
    both explain.

    A place and a time of a receiver differ at one speed by the bend of the path alone, less than models of it are
    accurate: two values that share one cause would both be wrong.
    """
    names = [part[0].id for part in fit.parts if get_effect(part[0].id).block == POSITION]
    for name, other_name in combinations(names, 2):
        without_name, without_other = (refit_without(residual_model, fit, one) for one in (name, other_name))
        needed = max(without_name.loss, without_other.loss) - fit.loss
        gain = refit_without(residual_model, without_name, other_name).loss - fit.loss
        if needed < LOOK_ALIKE_LOSS + EXCHANGEABLE_SHARE * gain:
            smaller = min(without_name, without_other, key=lambda one: one.loss)
            return drop_exchangeable(residual_model, smaller)
    return fit


def _find_competitors(
    residual_model: ResidualModel, fit: EffectFit, name: str, traces: EffectTraces | None
) -> tuple[EffectFit | None, Lookalikes]:
    """Return the fit in which a competitor is clearly better in the place of an effect, if any, and those that are as
    good.

    An effect that tolerances of the tractor file may look like is as good as a competitor that explains half of it, of
    whatever size.
    """
    tractor = residual_model.rig.tractor
    reduced_fit = refit_without(residual_model, fit, name)
    gain, is_open = reduced_fit.loss - fit.loss, is_within_tolerances(residual_model, fit, name)
    slack = LOOK_ALIKE_LOSS + (OPEN_LOOK_ALIKE_SHARE if is_open else LOOK_ALIKE_SHARE) * gain
    held_out = float(estimate_held_out_losses(residual_model, fit).sum())
    better, lookalikes, least_excess = fit, {}, -LEAST_GAIN
    for competitor in _fit_replacing_effects(
        residual_model, reduced_fit, (*fit.settings,), get_effect(name).block, gain - slack, traces
    )[:MOST_REFITTED]:
        deviation = competitor.parameters.compute_deviation(competitor.coordinates)
        may_crab = SIDE_DRAFT in (name, competitor.parameters.id)
        if (competitor.gain < gain - slack and not may_crab) or (
            not is_open and deviation <= find_finest_size(tractor, competitor.parameters.id)
        ):
            continue
        competitor_fit = refine_fit(residual_model, add_candidate(residual_model, reduced_fit, competitor))
        by_crab = _compute_excess_by_crab(residual_model, fit, competitor_fit) if may_crab else 0.0
        excess = competitor_fit.loss - fit.loss
        worse = float(estimate_held_out_losses(residual_model, competitor_fit).sum()) - held_out
        # Better is what is so with and without the crab, as good what is so with or without it.
        if max(excess, excess - by_crab) < least_excess and max(worse, worse - by_crab) < 0.0:
            better, least_excess = competitor_fit, max(excess, excess - by_crab) - LEAST_GAIN
        elif min(excess, excess - by_crab) < slack and min(worse, worse - by_crab) < slack:
            lookalikes[competitor.parameters.id] = competitor_fit.settings[competitor.parameters.id]
    return (None, lookalikes) if better is fit else (better, {})


def _compute_excess_by_crab(residual_model: ResidualModel, fit: EffectFit, competitor_fit: EffectFit) -> float:
    """Return how much more loss the crab under a side draft removes from the fit of a competitor than from a fit.

    One of both has a side draft. How far the rear axle slides out under it depends on where it pulls, and a heading may
    be off by as much: what only the crab tells apart is equivalent.
    """
    draft_fit = fit if SIDE_DRAFT in fit.settings else competitor_fit
    column = compute_crab_column(residual_model, draft_fit)
    removed = []
    for one in (fit, competitor_fit):
        beside = Projector(one.jacobian)(column)
        removed.append(float(beside @ one.residuals) ** 2 / max(float(beside @ beside), LEAST_INFORMATION))
    return removed[1] - removed[0]


def _fit_replacing_effects(
    residual_model: ResidualModel,
    reduced_fit: EffectFit,
    skip: Iterable[str],
    block: str,
    worth: float,
    traces: EffectTraces | None = None,
) -> list[CandidateFit]:
    """Fit every effect of the adjacent blocks on top of a fit, each from several starts, the best first.

    Those predicted to gain far less than `worth` are only started; with `traces` they are skipped.
    """
    projector = Projector(reduced_fit.jacobian)
    residuals, competitors = projector(reduced_fit.residuals), _list_adjacent_competitors(residual_model, skip, block)
    promising_competitors = (
        competitors
        if traces is None
        else [
            competitor for competitor in competitors if not traces.is_hopeless(residuals, projector, competitor, worth)
        ]
    )
    return sorted(
        (
            fit_candidate(residual_model.compute_changes, reduced_fit, competitor, projector, worth, residuals)
            for competitor in promising_competitors
        ),
        key=lambda competitor: -competitor.gain,
    )


def _list_adjacent_competitors(
    residual_model: ResidualModel, skip: Iterable[str], block: str
) -> list[EffectParameters]:
    """List every effect of the adjacent blocks that needs no search, each with several starts."""
    blocks, taken_ids = find_adjacent_blocks(residual_model, block), frozenset(skip)
    return [
        add_typical_starts(build_parameters(residual_model.rig.tractor, entry.id, residual_model.dataset.effect_places))
        for entry in CATALOGUE
        if entry.block in blocks and entry.id not in taken_ids and not entry.kind.is_searched
    ]


def add_typical_starts(parameters: EffectParameters) -> EffectParameters:
    """Add starts of a typical size to either side, as far as possible."""
    if parameters.count > 1:
        return parameters
    typical = np.array(parameters.typical)
    sides = [
        (float(coordinate),)
        for side in (typical, -typical)
        for coordinate in parameters.clip(np.array(parameters.neutral) + side)
    ]
    return replace(parameters, starts=tuple(dict.fromkeys((*parameters.starts, *sides))))


def _fit_without_covariates(residual_model: ResidualModel, fit: EffectFit, tractor: Tractor) -> EffectFit | None:
    """Return a fit of effects alone that explains as much as this one with its covariates, if one effect achieves it.

    The effect replaces one that may be named, or is added to them.
    """
    plain_fit = refit_with_covariates(residual_model, fit, ())
    names = list_nameable_parts(residual_model, plain_fit, tractor)
    traces = (
        EffectTraces(residual_model.compute_changes, plain_fit, residual_model.compute_residuals(plain_fit.settings))
        if names
        else None
    )
    best: EffectFit | None = None

    def compute_worth(loss: float) -> float:
        return (1.0 - LOOK_ALIKE_SHARE) * (loss - fit.loss) - LEAST_GAIN

    for name in (None, *names):
        if traces and name and not _can_be_replaced(residual_model, plain_fit, name, compute_worth, traces):
            continue
        reduced_fit = plain_fit if name is None else refit_without(residual_model, plain_fit, name)
        worth = compute_worth(reduced_fit.loss)
        block = PATH if name is None else get_effect(name).block
        for competitor in _fit_replacing_effects(
            residual_model, reduced_fit, (*plain_fit.settings,), block, worth, traces
        )[:2]:
            if competitor.gain < worth:
                continue
            competitor_fit = refine_fit(residual_model, add_candidate(residual_model, reduced_fit, competitor))
            if competitor_fit.loss < fit.loss + LEAST_GAIN and (best is None or competitor_fit.loss < best.loss):
                best = competitor_fit
    return best


def _can_be_replaced(
    residual_model: ResidualModel,
    fit: EffectFit,
    name: str,
    compute_worth: Callable[[float], float],
    traces: EffectTraces,
) -> bool:
    """Whether a competitor may gain enough in the place of a part to justify refitting the others without it.

    A linear prediction where the others are; `compute_worth` is the gain needed for a given loss.
    """
    if (residual_model, name) in fit.smaller_fits:
        return True
    projector = Projector(np.delete(fit.jacobian, fit.find_columns(name), axis=1))
    other_settings = {other_name: values for other_name, values in fit.settings.items() if other_name != name}
    residuals = projector(residual_model.compute_residuals(other_settings))  # which also removes the linear terms
    least_gain = PREDICTED_SHARE * compute_needed_gain(compute_worth(sum_squares(residuals)))
    competitors = _list_adjacent_competitors(residual_model, fit.settings, get_effect(name).block)
    return any(traces.predict_gain(residuals, projector, competitor) >= least_gain for competitor in competitors)


def is_significant_alone(residual_model: ResidualModel, fit: EffectFit, name: str) -> bool:
    """Whether a part is beyond its tolerance, on the same side, without each other part of the same group.

    How a valve moves the wheels, and how tyres begin to slide, differs between makes by more than the effects describe.
    Two effects that cancel each other may compensate for that, and then neither is a fault.
    """
    parameters, coordinates = next(part for part in fit.parts if part[0].id == name)
    neutral, finest = (
        np.array(parameters.neutral),
        find_finest_size(residual_model.rig.tractor, name, residual_model.get_interval_s(name)),
    )
    for other_name in fit.settings:
        if (
            other_name == name
            or get_make_dependent_group(other_name) is None
            or get_make_dependent_group(other_name) != get_make_dependent_group(name)
        ):
            continue
        reduced_coordinates = next(
            place
            for parameters_of_part, place in refit_without(residual_model, fit, other_name).parts
            if parameters_of_part.id == name
        )
        if (
            float((reduced_coordinates - neutral) @ (coordinates - neutral)) <= 0.0
            or parameters.compute_deviation(reduced_coordinates) <= finest
        ):
            return False
    return True


def is_shown_within_runs(residual_model: ResidualModel, fit: EffectFit, name: str) -> bool:
    """Whether a local effect shows where runs enter and leave its place, not only as a difference between runs.

    Logs of two tractors or days bend differently as a whole: a circle around some of the runs explains that as well.
    Most of its gain must remain beside a separate steering gain for every run.
    """
    if not get_effect(name).kind.is_searched:
        return True
    parameters, coordinates = next(part for part in fit.parts if part[0].id == name)
    part_columns = fit.find_columns(name)
    contribution, other_columns = (
        fit.jacobian[:, part_columns] @ (coordinates - np.array(parameters.neutral)),
        np.delete(fit.jacobian, part_columns, axis=1),
    )
    bend_change = _compute_curvature_response(residual_model, fit)
    runs = [
        np.where(residual_model.residual_runs == run, bend_change, 0.0)
        for run in range(len(residual_model.dataset.names))
    ]
    columns_beside = stack_columns(
        [*other_columns.T, *[run_column for run_column in runs if run_column.any()]], len(other_columns)
    )
    alone_part, within_part = Projector(other_columns)(contribution), Projector(columns_beside)(contribution)
    return float(within_part @ within_part) > LEAST_WITHIN_RUNS_SHARE * float(alone_part @ alone_part)


def _compute_curvature_response(residual_model: ResidualModel, fit: EffectFit) -> Array:
    """Return the change of the residuals when all runs bend a little more."""
    name = "steering_gain"
    parameters, settings = build_parameters(residual_model.rig.tractor, name), fit.settings
    current = settings.get(name, parameters.compute_values(np.array(parameters.neutral)))
    increased = {key: value + parameters.typical[0] for key, value in current.items()}
    base = residual_model.compute_residuals(settings)
    return residual_model.compute_change({**settings, name: increased}, base, frozenset({PATH})) - base


def get_make_dependent_group(name: str) -> str | None:
    """Return the group of effects that differ between makes: the steering, or the tyres on their ground."""
    entry = get_effect(name)
    if entry.block == STEERING:
        return STEERING
    return PATH if entry.block == PATH and entry.depends_on_ground else None
