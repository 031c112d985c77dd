"""Search for terms that lower the open-loop error where residuals have no cause, and for those that may still be named.

Terms are effects, effects of the ground at two levels, and discrepancy terms. A term stays when runs that had no part
in its fit are simulated clearly better. An effect may be named when nothing else lowers the error as it does.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vehicle.identification.cause_selection.refit import MOST_FIT_BYTES
from vehicle.identification.fit.effect_parameters import find_finest_size
from vehicle.identification.fit.open_loop import (
    ModelTerm,
    ModelTerms,
    OpenLoopErrors,
    OpenLoopModel,
    estimate_held_out_loss,
    fit_terms,
)
from vehicle.identification.model_extension.term_proposals import (
    ReportStep,
    TermProposal,
    get_term_group_name,
    propose_terms,
    simulate_best_proposal_pair,
    simulate_proposals,
)
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    CLEARLY_LARGE_FACTOR,
    COMPETITOR_LOSS_FACTOR,
    LEAST_REMAINING_SHARE,
    MARKED_SHARE,
    MOST_FITTED,
    MOST_SIMULATED,
    MOST_TERMS,
    PAIR_LOSS_SHARE,
    WORTH_SHARE,
)
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.tractor import Settings, Tractor


@dataclass(frozen=True, eq=False)
class OpenLoopFit:
    """The model found, and the open-loop error it lowers.

    `smaller_models` are cached fits without one entry, by its name.
    """

    loop: OpenLoopErrors
    model: OpenLoopModel
    smaller_models: Mapping[str, OpenLoopModel] = field(default_factory=dict)

    def refit_without_term(self, name: str) -> OpenLoopModel:
        """Return the other terms, refitted."""
        return self.smaller_models[name] if name in self.smaller_models else _fit_without(self.loop, self.model, name)


def search_terms(
    residual_model: ResidualModel,
    tractor: Tractor,
    fixed_terms: ModelTerms,
    step: ReportStep,
    tolerated: Settings | None = None,
) -> OpenLoopFit:
    """Search for terms that lower the open-loop error of held-out runs in addition to `fixed_terms`, the best first.

    `tolerated` and `fixed_terms` are those of OpenLoopErrors: values from the residuals stay, because the open-loop
    error allows for neither instruments nor differences between tractors.
    """
    loop = OpenLoopErrors(residual_model, tolerated or {}, fixed_terms)
    model = fit_terms(loop, ())
    best = estimate_held_out_loss(loop, model)
    while len(model.terms) < MOST_TERMS:
        larger_model = _enlarge_model(loop, model, best, tractor, step)
        if larger_model is None:
            break
        model, best = larger_model
    return _prune_terms(loop, model, best)


def _enlarge_model(
    loop: OpenLoopErrors, model: OpenLoopModel, best: float, tractor: Tractor, step: ReportStep
) -> tuple[OpenLoopModel, float] | None:
    """Return the model with the best proposal or pair of proposals that helps held-out runs."""
    proposed = propose_terms(loop, model, tractor, step)
    single_terms = simulate_proposals(loop, model, sorted(proposed, key=lambda option: option.loss)[:MOST_SIMULATED])
    pair_terms = [
        terms
        for terms, loss in simulate_best_proposal_pair(loop, model, proposed)
        if loss < PAIR_LOSS_SHARE * single_terms[0][1]
    ]
    accepted = [_enlarge_if_worthwhile(loop, model, best, terms) for terms in pair_terms]
    for terms, loss in single_terms[:MOST_FITTED]:
        larger = _enlarge_if_worthwhile(loop, model, best, terms) if loss < (1.0 - WORTH_SHARE) * model.loss else None
        if larger:
            accepted.append(larger)
            break
    # Each of two terms must be worth its place, also against the best single one.
    return min(
        (option for option in accepted if option),
        key=lambda option: option[1] / _compute_allowed_error_share(option[0], model),
        default=None,
    )


def _compute_allowed_error_share(larger: OpenLoopModel, model: OpenLoopModel) -> float:
    """Return the share of the error that may remain, for the number of additional terms of a model."""
    added_ids = {get_term_group_name(name) for name in larger.term_ids} - {
        get_term_group_name(name) for name in model.term_ids
    }
    return float((1.0 - WORTH_SHARE) ** len(added_ids))


def _enlarge_if_worthwhile(
    loop: OpenLoopErrors, model: OpenLoopModel, best: float, terms: ModelTerms
) -> tuple[OpenLoopModel, float] | None:
    """Return a larger model and its held-out error if that is worth its terms."""
    larger = fit_terms(loop, terms)
    loss = estimate_held_out_loss(loop, larger)
    new_terms = larger.terms[len(model.terms) :]
    if not all(is_beyond_tolerance(loop, term) for term in new_terms if term.runs is None):
        return None
    return (
        (larger, loss)
        if loss < _compute_allowed_error_share(larger, model) * best and not is_at_limit(new_terms)
        else None
    )


def is_beyond_tolerance(loop: OpenLoopErrors, term: ModelTerm, times: float = 1.0) -> bool:
    """Whether an effect exceeds the tolerance of the tractor file; a discrepancy term has none."""
    name, residual_model = term.parameters.id, loop.residual_model
    if name in TERMS_BY_NAME:
        return True
    tractor = residual_model.rig.tractor
    return term.parameters.compute_deviation(term.coordinates) > times * find_finest_size(
        tractor, name, residual_model.get_interval_s(name)
    )


def is_at_limit(terms: ModelTerms) -> bool:
    """Whether a coordinate is at the limit of its range: such a fit stands in for something else."""
    return any(
        np.any(
            (term.coordinates <= np.array(term.parameters.low))
            & (np.array(term.parameters.low) < np.array(term.parameters.neutral))
        )
        or np.any(
            (term.coordinates >= np.array(term.parameters.high))
            & (np.array(term.parameters.high) > np.array(term.parameters.neutral))
        )
        for term in terms
    )


def _prune_terms(loop: OpenLoopErrors, model: OpenLoopModel, best: float) -> OpenLoopFit:
    """Remove, one by one, terms that later ones have made superfluous."""
    smaller_models: dict[str, OpenLoopModel] = {}
    for name in sorted({get_term_group_name(name) for name in model.term_ids}):
        smaller_model = _fit_without(loop, model, name)
        loss = estimate_held_out_loss(loop, smaller_model)
        if loss < best / (1.0 - WORTH_SHARE):
            return _prune_terms(loop, smaller_model, loss)
        if len(model.terms) * model.jacobian.nbytes <= MOST_FIT_BYTES:
            smaller_models[name] = smaller_model
    return OpenLoopFit(loop, model, smaller_models)


def _fit_without(loop: OpenLoopErrors, model: OpenLoopModel, name: str) -> OpenLoopModel:
    return fit_terms(loop, tuple(term for term in model.terms if get_term_group_name(term.parameters.id) != name), 2)


def find_irreplaceable(
    open_loop_fit: OpenLoopFit,
    tractor: Tractor,
    noise: float,
    step: ReportStep,
    is_holding: Callable[[str], bool] = lambda _: True,
) -> list[str]:
    """Return effects that may be named although parts of the error have no name.

    Without such an effect the others, refitted, leave clearly more error, and so does the best other effect or
    discrepancy term in its place (of those that may enter here). Losses count from what `noise` alone leaves, a share
    of the loss without terms, and are at least LEAST_REMAINING_SHARE of what can be removed. Only effects that hold
    (`is_holding`) are tested.
    """
    loop, model = open_loop_fit.loop, open_loop_fit.model

    def compute_excess(loss: float) -> float:
        return max(loss - noise, LEAST_REMAINING_SHARE * (1.0 - noise))

    def is_near(loss: float) -> bool:
        return compute_excess(loss) <= COMPETITOR_LOSS_FACTOR * compute_excess(model.loss)

    names = []
    for name in sorted(model.term_ids - frozenset(TERMS_BY_NAME)):
        step()
        if not _is_clearly_large(loop, model, name):
            continue
        smaller_model = open_loop_fit.refit_without_term(name)
        if (
            compute_excess(model.loss) > (1.0 - MARKED_SHARE) * compute_excess(smaller_model.loss)
            or is_near(smaller_model.loss)
            or not is_holding(name)
        ):
            continue  # the loss without it is near, so any competitor's is
        competitors = propose_terms(loop, smaller_model, tractor, step, frozenset({name}))
        if not _has_close_competitor(loop, smaller_model, competitors, is_near):
            names.append(name)
    return names


def _has_close_competitor(
    loop: OpenLoopErrors, smaller: OpenLoopModel, competitors: Sequence[TermProposal], is_near: Callable[[float], bool]
) -> bool:
    """Whether one of the best other proposals leaves nearly as little error.

    A fit leaves no more than it starts from, so none is made where that is already near.
    """
    simulated_terms: list[tuple[ModelTerms, float]] = []
    for proposal in sorted(competitors, key=lambda proposal: proposal.loss)[:MOST_SIMULATED]:
        simulated_terms += simulate_proposals(loop, smaller, [proposal])
        if is_near(simulated_terms[-1][1]):
            return True
    best = sorted(simulated_terms, key=lambda each: each[1])[:MOST_FITTED]
    return any(is_near(fit_terms(loop, terms, 2).loss) for terms, _ in best)


def _is_clearly_large(loop: OpenLoopErrors, model: OpenLoopModel, name: str) -> bool:
    return any(
        is_beyond_tolerance(loop, term, CLEARLY_LARGE_FACTOR) for term in model.terms if term.parameters.id == name
    )
