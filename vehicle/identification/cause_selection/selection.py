"""Which effects the logs support: forward and backward selection with all other effects refitted, and challenges.

An effect enters when its gain exceeds chance: the threshold is the largest gain of any candidate on these very
residuals with random signs of blocks of ten seconds. It must also help runs that had no part in the fit, and most of
the runs that it concerns. The base tractor is the given file within the tolerance of each effect: an effect within its
tolerance is a calibration without a name.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

from vehicle.identification.cause_selection.candidate_fit import (
    CandidateFit,
    Projector,
    compute_needed_gain,
    compute_strengths,
    fit_candidate,
    resume_candidate,
)
from vehicle.identification.cause_selection.challenge import Lookalikes, challenge_causes, drop_exchangeable
from vehicle.identification.cause_selection.covariates import CovariateScore, ErrorCovariate, score_covariates
from vehicle.identification.cause_selection.evidence import is_helping_held_out, predict_removal_costs
from vehicle.identification.cause_selection.grip_patches import find_best_patch
from vehicle.identification.cause_selection.merging import simplify_delays
from vehicle.identification.cause_selection.refit import (
    add_candidate,
    add_part,
    refit_with_covariates,
    refit_with_new_weights,
    refit_without,
    reweigh_residual_model,
)
from vehicle.identification.cause_selection.scan_cache import GainPredictor, ScanCache, drop_old_motions
from vehicle.identification.fit.effect_parameters import build_parameters
from vehicle.identification.fit.residual_fit import EffectFit, FitPart, refine_fit
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.thresholds import (
    ABOVE_CHANCE_FACTOR,
    CHANCE_SIGMAS,
    CLEARLY_MORE_FACTOR,
    CLEARLY_MORE_PER_RUN_FACTOR,
    LEAST_GAIN,
    LEAST_STRENGTH,
    MATERIAL_SHARE,
    MOST_CHANGES,
    MOST_PARTS,
    MOST_UNNAMED,
    PATCH_HANDICAP,
    PLAINLY_NEEDED_FACTOR,
    PREDICTED_SHARE,
)
from vehicle.model.effects import CATALOGUE, STEERING, get_effect
from vehicle.model.tractor import Tractor

LEADING_CANDIDATES = 4  # chosen: the best of one scan are usually the best of the next, apart from the one that entered
ReportEffect = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class CauseSelection:
    """Result of the selection: the fit of effects and covariates, the covariates, equivalent effects by name and
    refused effects."""

    residual_model: ResidualModel
    fit: EffectFit
    unnamed: tuple[ErrorCovariate, ...]
    threshold: float
    lookalikes: Mapping[str, Lookalikes] = field(default_factory=dict)
    refused: frozenset[str] = frozenset()

    @property
    def effect_ids(self) -> frozenset[str]:
        """Effects in the fit."""
        return frozenset(self.fit.settings)


def scan_candidates(
    residual_model: ResidualModel,
    fit: EffectFit,
    tractor: Tractor,
    skip: Collection[str],
    progress: ReportEffect | None = None,
    previous: ScanCache | None = None,
    unnamed: bool = True,
) -> ScanCache:
    """Fit every effect that is not in the fit, the best first; those predicted to gain far less are only started.

    The best predictions, and the best of the previous scan, come first: an early best saves most of the time. Results
    of the previous scan that still apply are reused. Covariates are scored where one more may enter.
    """
    projector = Projector(fit.jacobian)
    residuals = projector(fit.residuals)
    unchanged_blocks = previous.find_unchanged_blocks(residual_model, fit, residuals) if previous else frozenset[str]()
    predictor, seen = GainPredictor(residual_model, fit, projector, residuals), previous.seen if previous else {}
    expected_gains = (
        {candidate.parameters.id: candidate.gain for candidate in previous.candidates[:LEADING_CANDIDATES]}
        if previous
        else {}
    )
    candidates = list((previous.get_finished_candidates(unchanged_blocks) if previous else {}).values())
    candidates = [
        candidate
        for candidate in candidates
        if candidate.parameters.id not in skip and candidate.parameters.id not in fit.settings
    ]
    settled_ids = {candidate.parameters.id for candidate in candidates} | set(skip) | set(fit.settings)
    untried_effects = [candidate for candidate in CATALOGUE if candidate.id not in settled_ids]
    predictions = predictor.predict_gains(seen, [candidate.id for candidate in untried_effects])
    expected_gains |= {name: candidate.best_gain for name, candidate in predictions.items()}
    motions = drop_old_motions(seen)
    for entry in sorted(untried_effects, key=lambda candidate: -expected_gains.get(candidate.id, 0.0)):
        parameters = build_parameters(tractor, entry.id, residual_model.dataset.effect_places)
        if not residual_model.has_measured_wheel_angle:
            parameters = parameters.reduce_starts()
        if entry.kind.is_searched:
            patch = find_best_patch(residual_model, fit)
            if patch is None:
                continue
            parameters = build_parameters(tractor, entry.id, {entry.id: patch})
        worth = max((-_compute_candidate_sort_key(candidate) for candidate in candidates), default=0.0)
        new_candidate = (
            predictor.build_hopeless_candidate(predictions[entry.id], worth) if entry.id in predictions else None
        )
        if new_candidate is None:
            new_candidate = fit_candidate(residual_model.compute_changes, fit, parameters, projector, worth, residuals)
            if fit.parts:  # with one cause the second scan is the last, and the predictions would not be used
                motions |= predictor.collect_motions(new_candidate)
        candidates.append(new_candidate)
        if progress:
            progress(entry.id)
    is_same_path = previous is not None and previous.is_same_path(residual_model, fit)
    covariate_scores = (
        () if not unnamed else previous.scores if previous and is_same_path else score_covariates(residual_model, fit)
    )
    return ScanCache(
        fit, projector, residuals, sorted(candidates, key=_compute_candidate_sort_key), covariate_scores, motions
    )


def finish_candidates(
    residual_model: ResidualModel,
    scan_cache: ScanCache,
    candidates: Sequence[CandidateFit],
    best: CandidateFit | None = None,
) -> list[CandidateFit]:
    """Finish the candidates that were only started, the best first.

    Except those predicted to gain far less than another one.
    """
    worth = 0.0 if best is None else max(-_compute_candidate_sort_key(best), 0.0)

    def finish_candidate(candidate: CandidateFit) -> CandidateFit:
        if candidate.is_finished or (
            best
            and candidate.predicted_gain is not None
            and candidate.predicted_gain < PREDICTED_SHARE * compute_needed_gain(worth)
        ):
            return candidate
        return resume_candidate(
            residual_model.compute_changes, scan_cache.fit, candidate, scan_cache.projector, scan_cache.residuals, worth
        )

    return sorted(map(finish_candidate, candidates), key=_compute_candidate_sort_key)


def _compute_candidate_sort_key(candidate: CandidateFit) -> float:
    """Return the sort key of a candidate: a circle of free position must explain clearly more than a plain effect."""
    if get_effect(candidate.parameters.id).kind.is_searched:
        return -(candidate.gain / PATCH_HANDICAP - LEAST_GAIN)
    return -candidate.gain


def select_causes(
    residual_model: ResidualModel, tractor: Tractor, progress: ReportEffect | None = None
) -> CauseSelection:
    """Select forward and backward, then challenge every cause; start again when one is replaced."""
    chosen = CauseSelection(residual_model, refit_with_new_weights(residual_model, (), None), (), LEAST_STRENGTH)
    refused: set[str] = set()
    for _ in range(MOST_CHANGES):
        chosen = drop_superfluous(_select_forward(chosen, tractor, refused, progress))
        chosen = replace(chosen, fit=simplify_delays(chosen.residual_model, chosen.fit))
        chosen = replace(chosen, fit=drop_exchangeable(chosen.residual_model, chosen.fit))
        outcome = challenge_causes(chosen.residual_model, chosen.fit, chosen.unnamed, tractor)
        if outcome.better_fit is None:
            return replace(chosen, lookalikes=outcome.lookalikes, refused=frozenset(refused))
        better = reweigh_residual_model(chosen.residual_model, outcome.better_fit)
        fit = refit_with_new_weights(better, outcome.better_fit.parts, outcome.unnamed)
        chosen = replace(chosen, residual_model=better, fit=fit, unnamed=outcome.unnamed)
    return replace(drop_superfluous(chosen), refused=frozenset(refused))


def drop_superfluous(chosen: CauseSelection) -> CauseSelection:
    """Drop parts that have become superfluous."""
    residual_model, fit, unnamed = chosen.residual_model, prune_fit(chosen.residual_model, chosen.fit), chosen.unnamed
    for covariate in unnamed:
        other_covariates = tuple(other_covariate for other_covariate in unnamed if other_covariate is not covariate)
        smaller = refit_with_covariates(residual_model, fit, other_covariates)
        freedoms = fit.jacobian.shape[1] - smaller.jacobian.shape[1]
        if not _is_beyond_random_gain(residual_model, smaller.loss - fit.loss, freedoms, chosen.threshold):
            return drop_superfluous(replace(chosen, fit=smaller, unnamed=other_covariates))
    return replace(chosen, fit=fit)


def _select_forward(
    chosen: CauseSelection, tractor: Tractor, refused: set[str], progress: ReportEffect | None
) -> CauseSelection:
    """Select forward from a given selection; `refused` collects effects that did not help held-out runs."""
    residual_model, fit, unnamed, threshold = chosen.residual_model, chosen.fit, chosen.unnamed, chosen.threshold
    scan_cache: ScanCache | None = None
    candidates: list[CandidateFit] | None = None
    competitor: CovariateScore | None = None
    while len(fit.parts) < MOST_PARTS:
        if scan_cache is None or candidates is None:
            scan_cache = scan_candidates(
                residual_model, fit, tractor, refused, progress, scan_cache, len(unnamed) < MOST_UNNAMED
            )
            candidates, competitor = list(scan_cache.candidates), _find_unnamed_competitor(scan_cache.scores, unnamed)
        best, threshold = _find_clear_candidate(residual_model, scan_cache, candidates)
        # If the best is not clear, another one may be, unless a covariate comes before all of them.
        if (
            candidates
            and best is not candidates[0]
            and not _is_certain_to_enter(residual_model, competitor, unnamed, candidates, threshold)
        ):
            for reference in (best, None) if best else (None,):  # all candidates are finished until one is clear
                candidates = finish_candidates(residual_model, scan_cache, candidates, reference)
                best, threshold = _find_clear_candidate(residual_model, scan_cache, candidates)
                if best is not None:
                    break
            scan_cache = replace(scan_cache, candidates=candidates)
        if (
            competitor
            and len(unnamed) < MOST_UNNAMED
            and _is_clearly_better_covariate(residual_model, competitor, best, threshold)
        ):
            unnamed, candidates = (*unnamed, competitor.covariate), None
            fit = refit_with_covariates(residual_model, fit, unnamed)
            continue
        if best is None:
            break
        larger = _add_helping(residual_model, fit, best, tractor, threshold)
        if larger is None:
            refused.add(best.parameters.id)
            candidates = finish_candidates(
                residual_model,
                scan_cache,
                [candidate for candidate in candidates if candidate.parameters.id != best.parameters.id],
            )
            continue
        residual_model, candidates = reweigh_residual_model(residual_model, larger), None
        fit = refit_with_new_weights(residual_model, larger.parts, unnamed)
    return replace(chosen, residual_model=residual_model, fit=fit, unnamed=unnamed, threshold=threshold)


def _add_helping(
    residual_model: ResidualModel, fit: EffectFit, best: CandidateFit, tractor: Tractor, threshold: float
) -> EffectFit | None:
    """Return the fit with one more effect that helps held-out runs, alone or with another one of the steering, if any.

    Beside a lag, a dead band that is right to its tolerance in the file may be wrong by more than the wheel angle
    shows, and small corrections on straights then speak against the lag that turns ask for.
    """
    larger = refine_fit(residual_model, add_candidate(residual_model, fit, best), 2)
    if is_helping_held_out(residual_model, fit, larger, threshold):
        return larger
    actuator_ids = [entry.id for entry in CATALOGUE if entry.block == STEERING and not entry.is_of_log_alone]
    if best.parameters.id not in actuator_ids or not residual_model.has_measured_wheel_angle:
        return None
    projector = Projector(larger.jacobian)
    partners = [
        fit_candidate(residual_model.compute_changes, larger, build_parameters(tractor, name), projector)
        for name in actuator_ids
        if name not in larger.settings
    ]
    partner = max(partners, key=lambda one: one.gain, default=None)
    if partner is None or partner.gain < LEAST_GAIN:
        return None
    both = refine_fit(residual_model, add_candidate(residual_model, larger, partner), 2)
    return both if is_helping_held_out(residual_model, fit, both, threshold) else None


def _find_clear_candidate(
    residual_model: ResidualModel, scan_cache: ScanCache, candidates: list[CandidateFit]
) -> tuple[CandidateFit | None, float]:
    """Return the best candidate that is clearly above chance, if any, and the strength needed."""
    strength, chance_strength = compute_strengths(residual_model, candidates, scan_cache.residuals)
    threshold = max(LEAST_STRENGTH, ABOVE_CHANCE_FACTOR * chance_strength)
    clear_candidates = (
        candidate
        for candidate, candidate_strength in zip(candidates, strength, strict=True)
        if candidate.gain > LEAST_GAIN and candidate_strength > threshold
    )
    return next(clear_candidates, None), threshold


def _find_unnamed_competitor(
    ranked: Sequence[CovariateScore], unnamed: tuple[ErrorCovariate, ...]
) -> CovariateScore | None:
    """Return the strongest covariate that is not in the fit; a neighbouring period counts as the same."""
    taken = {
        (covariate.regressor if not covariate.per_run else "time", covariate.changed_quantity) for covariate in unnamed
    }
    for score in ranked:
        if (
            score.covariate.regressor if not score.covariate.per_run else "time",
            score.covariate.changed_quantity,
        ) not in taken:
            return score
    return None


def _is_certain_to_enter(
    residual_model: ResidualModel,
    competitor: CovariateScore | None,
    unnamed: tuple[ErrorCovariate, ...],
    candidates: Sequence[CandidateFit],
    threshold: float,
) -> bool:
    """Whether a covariate enters whichever candidate is clear: unfinished ones are predicted to gain less than the
    best."""
    best_candidate = max(candidates, key=lambda one: one.gain)
    return (
        competitor is not None
        and len(unnamed) < MOST_UNNAMED
        and _is_clearly_better_covariate(residual_model, competitor, best_candidate, threshold)
    )


def _is_clearly_better_covariate(
    residual_model: ResidualModel, competitor: CovariateScore, best: CandidateFit | None, threshold: float
) -> bool:
    """Whether a covariate explains clearly more than chance and than the best effect."""
    if not _is_beyond_random_gain(residual_model, competitor.gain, competitor.freedoms, threshold):
        return False
    if best is None:
        return True
    factor = CLEARLY_MORE_PER_RUN_FACTOR if competitor.covariate.per_run else CLEARLY_MORE_FACTOR
    return competitor.gain - _compute_random_gain(competitor.freedoms) > factor * best.gain + LEAST_GAIN


def _is_beyond_random_gain(residual_model: ResidualModel, gain: float, freedoms: int, threshold: float) -> bool:
    """Whether covariates remove more loss than chance does, and more than simulators differ by."""
    return gain - _compute_random_gain(freedoms) >= max(threshold, MATERIAL_SHARE * 3.0 * residual_model.dataset.rows)


def _compute_random_gain(freedoms: int) -> float:
    """Return the loss that this many free amounts remove by chance."""
    return freedoms + CHANCE_SIGMAS * math.sqrt(2.0 * freedoms)


def _list_doubtful_parts(fit: EffectFit) -> list[FitPart]:
    """List parts that may be superfluous: those not clearly needed, and all of the steering, where linear predictions
    fail.

    A delayed wheel is explained by a dead time, a lag or a rate, at distant values.
    """
    removal_costs = predict_removal_costs(fit)
    return [
        part
        for part in fit.parts
        if get_effect(part[0].id).block == STEERING or removal_costs[part[0].id] < PLAINLY_NEEDED_FACTOR * LEAST_GAIN
    ]


def prune_fit(residual_model: ResidualModel, fit: EffectFit) -> EffectFit:
    """Backward selection: remove, one by one, parts that the others have made superfluous.

    A part that only allowed the others to reach their best is removed if, after it was there, they explain as much
    without it.
    """
    put_back_ids: set[str] = set()
    while fit.parts:
        doubtful = _list_doubtful_parts(fit)
        if not doubtful:
            return fit
        smaller, part = min(
            ((refit_without(residual_model, fit, part[0].id), part) for part in doubtful), key=lambda one: one[0].loss
        )
        if smaller.loss - fit.loss > LEAST_GAIN:
            return fit
        if part[0].id not in put_back_ids:
            put_back_ids.add(part[0].id)
            refitted = refine_fit(residual_model, add_part(residual_model, smaller, part))
            smaller = refitted if smaller.loss - refitted.loss > LEAST_GAIN else smaller
        fit = smaller
    return fit
