"""Proposals that could lower the open-loop error: effects, discrepancy terms and the best pair, and effects at two
levels for two grounds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
import numpy.typing as npt

from vehicle.identification.fit.column_products import multiply_columns, subtract_columns, sum_squares
from vehicle.identification.fit.effect_parameters import (
    EffectParameters,
    build_discrepancy_parameters,
    build_parameters,
)
from vehicle.identification.fit.open_loop import (
    ModelTerm,
    ModelTerms,
    OpenLoopErrors,
    OpenLoopModel,
    compute_new_terms_jacobian,
    shift_term_coordinates,
)
from vehicle.identification.fit.solver import solve_linear_step
from vehicle.identification.logs.schema import Array
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.thresholds import CLEAR_LEVEL_SHARE, FEWEST_RUNS, TWO_LEVELS_SHARE
from vehicle.model.effects import CATALOGUE, Effect
from vehicle.model.tractor import Tractor


def fit_two_effect_levels(parameters: EffectParameters, starts: Sequence[Array], losses: Array) -> ModelTerms:
    """Return the effect at two of its starts, each run at the better one; empty unless two fit clearly better than one.

    `losses` (starts, runs) are the squared errors of every run from every start.
    """
    best = TWO_LEVELS_SHARE * float(losses.sum(axis=1).min())
    levels: ModelTerms = ()
    for first_start, second_start in combinations(range(len(starts)), 2):
        is_at_second = losses[second_start] < losses[first_start]
        loss = float(np.where(is_at_second, losses[second_start], losses[first_start]).sum())
        if loss < best and FEWEST_RUNS <= int(is_at_second.sum()) <= len(is_at_second) - FEWEST_RUNS:
            runs = frozenset(np.flatnonzero(is_at_second).tolist())
            other_runs = frozenset(range(len(is_at_second))) - runs
            best, levels = (
                loss,
                (
                    ModelTerm(parameters, starts[first_start], other_runs),
                    ModelTerm(parameters, starts[second_start], runs),
                ),
            )
    return levels


def select_level(terms: ModelTerms, level: int) -> ModelTerms:
    """Return terms with the first (0) or second (1) level of every effect that has two, in all runs."""
    levels_by_effect: dict[str, list[ModelTerm]] = {}
    for term in terms:
        levels_by_effect.setdefault(term.parameters.id, []).append(term)
    return tuple(replace(levels[min(level, len(levels) - 1)], runs=None) for levels in levels_by_effect.values())


def assign_clear_level_runs(loop: OpenLoopErrors, model: OpenLoopModel) -> list[tuple[ModelTerm, tuple[int, ...]]]:
    """Return terms of effects with two levels, each with the runs that fit clearly worse with the other one."""
    terms = model.terms
    losses = [loop.sum_by_run(loop.compute_errors(select_level(terms, level))) for level in (0, 1)]
    is_clear = np.abs(losses[0] - losses[1]) > CLEAR_LEVEL_SHARE * np.maximum(losses[0], losses[1])
    return [(term, tuple(run for run in sorted(term.runs) if is_clear[run])) for term in terms if term.runs is not None]


def sum_driving_time(dataset: DriveDataset) -> Array:
    """Return the driving time used, per run (runs,)."""
    seconds = np.zeros(len(dataset.names))
    for segment in dataset.segments:
        seconds[segment.run] += segment.time[-1]
    return seconds


def select_main_terms(terms: Sequence[ModelTerm], seconds: Array) -> ModelTerms:
    """Return the terms; of two levels the one of the longer driving, or the one that is not neutral."""

    def compute_weight(term: ModelTerm) -> tuple[bool, float]:
        if term.runs is None:
            return True, float(seconds.sum())
        return term.parameters.compute_deviation(term.coordinates) > 0.0, float(seconds[sorted(term.runs)].sum())

    main_by_effect = {term.parameters.id: term for term in sorted(terms, key=compute_weight)}
    return tuple(term for term in terms if main_by_effect[term.parameters.id] is term)


ReportStep = Callable[[], None]


@dataclass(frozen=True, eq=False)
class TermProposal:
    """New terms for a model: starting coordinates, errors there, their jacobian, and the predicted loss.

    `loss` is a linear prediction with every coordinate following.
    """

    new_terms: ModelTerms
    errors: Array
    jacobian: Array
    change: Array
    loss: float

    @property
    def is_starting_at_neutral(self) -> bool:
        """Whether the terms start at neutral, unlike those of a limit."""
        return all(np.array_equal(term.coordinates, term.parameters.neutral) for term in self.new_terms)


def propose_terms(
    loop: OpenLoopErrors, model: OpenLoopModel, tractor: Tractor, step: ReportStep, skip: frozenset[str] = frozenset()
) -> list[TermProposal]:
    """Propose every effect and discrepancy term not in the model, each at its best with the others following."""
    proposed = []
    taken_ids = model.term_ids | skip | {term.parameters.id for term in loop.fixed_terms}
    for entry in CATALOGUE:
        if entry.id in taken_ids or entry.is_stand_in:
            continue
        step()
        proposed += _propose_effect(loop, model, tractor, entry)
    for group in build_discrepancy_parameters():
        if group[0].id not in model.term_ids:
            step()
            new_terms = tuple(ModelTerm(parameters, np.zeros(1)) for parameters in group)
            proposed.append(_build_proposal(loop, model, new_terms, model.errors))
    return proposed


def _propose_effect(loop: OpenLoopErrors, model: OpenLoopModel, tractor: Tractor, entry: Effect) -> list[TermProposal]:
    """Propose an effect from its best start and, for one of the ground, at two levels."""
    parameters = build_parameters(tractor, entry.id, loop.residual_model.dataset.effect_places).reduce_starts()
    neutral = np.array(parameters.neutral)
    starts = [np.array(coordinates) for coordinates in parameters.starts if coordinates != parameters.neutral]
    errors = [
        model.errors,
        *loop.compute_errors_per_term_list(
            [(*model.terms, ModelTerm(parameters, coordinates)) for coordinates in starts]
        ),
    ]
    starts = [neutral, *starts]
    losses = np.array([loop.sum_by_run(start_errors) for start_errors in errors])
    first = int(np.argmin(losses.sum(axis=1)))
    proposed = [_build_proposal(loop, model, (ModelTerm(parameters, starts[first]),), errors[first])]
    if entry.depends_on_ground:
        levels = fit_two_effect_levels(parameters, starts, losses)
        if levels:
            proposed.append(_build_proposal(loop, model, levels, loop.compute_errors((*model.terms, *levels))))
    return proposed


def _build_proposal(loop: OpenLoopErrors, model: OpenLoopModel, new_terms: ModelTerms, errors: Array) -> TermProposal:
    """Build a proposal from new terms with known errors at their start."""
    new_jacobian = compute_new_terms_jacobian(loop, (*model.terms, *new_terms), errors, len(new_terms))
    jacobian = np.concatenate([model.jacobian, new_jacobian], axis=1)
    change = solve_linear_step(jacobian, errors)
    residuals = subtract_columns(errors, jacobian, -change)
    return TermProposal(new_terms, errors, new_jacobian, change, sum_squares(residuals))


def simulate_best_proposal_pair(
    loop: OpenLoopErrors, model: OpenLoopModel, proposed: Sequence[TermProposal]
) -> list[tuple[ModelTerms, float]]:
    """Simulate the two proposals with the best joint prediction: causes that mask each other show only together."""
    base = [proposal for proposal in proposed if proposal.is_starting_at_neutral]
    columns = np.concatenate([model.jacobian, *[proposal.jacobian for proposal in base]], axis=1)
    square, side = multiply_columns(columns, columns), multiply_columns(columns, model.errors)
    shared, last = model.jacobian.shape[1], np.cumsum([proposal.jacobian.shape[1] for proposal in base])
    places = [
        np.arange(end - proposal.jacobian.shape[1], end) + shared for proposal, end in zip(base, last, strict=True)
    ]

    def select_columns(pair: tuple[int, int]) -> npt.NDArray[np.int64]:
        return np.concatenate([np.arange(shared), places[pair[0]], places[pair[1]]])

    def compute_pair_gain(pair: tuple[int, int]) -> float:
        pair_columns = select_columns(pair)
        return float(
            side[pair_columns]
            @ np.linalg.pinv(square[np.ix_(pair_columns, pair_columns)], hermitian=True)
            @ side[pair_columns]
        )

    options = list(combinations(range(len(base)), 2))
    if not options:
        return []
    best = max(options, key=compute_pair_gain)
    new_terms = (*base[best[0]].new_terms, *base[best[1]].new_terms)
    terms = shift_term_coordinates(
        (*model.terms, *new_terms), solve_linear_step(columns[:, select_columns(best)], model.errors)
    )
    errors = loop.compute_errors(terms)
    return [(terms, sum_squares(errors))]


def simulate_proposals(
    loop: OpenLoopErrors, model: OpenLoopModel, proposed: Sequence[TermProposal]
) -> list[tuple[ModelTerms, float]]:
    """Simulate proposals as terms of the model, at the predicted coordinates or at their start, the best first."""
    term_losses = []
    places = [shift_term_coordinates((*model.terms, *proposal.new_terms), proposal.change) for proposal in proposed]
    for proposal, promised_terms, promised_errors in zip(
        proposed, places, loop.compute_errors_per_term_list(places), strict=True
    ):
        loss, start = sum_squares(promised_errors), sum_squares(proposal.errors)
        term_losses.append((promised_terms, loss) if loss < start else ((*model.terms, *proposal.new_terms), start))
    return sorted(term_losses, key=lambda each: each[1])


def get_term_group_name(name: str) -> str:
    """Return the name under which terms enter and leave together: an effect, or both components of a direction."""
    return name.split("_to_")[0]
