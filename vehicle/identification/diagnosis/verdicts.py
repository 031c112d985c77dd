"""Verdicts: what may be said of each hypothesis, with which interval, and how small an effect these logs would show."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vehicle.identification.diagnosis.grammar import (
    BY_RUN,
    CONSTANT,
    WIDTH_PER_TYPICAL,
    Hypothesis,
    build_constant,
    collect_widths,
    scale_effect,
    split_amounts,
)
from vehicle.identification.diagnosis.model_fit import CHANNELS, FIT_STEP, Fit, Problem
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED
from vehicle.identification.diagnosis.search import (
    ADD_NATS,
    Judgement,
    PredictiveComparison,
    SearchResult,
    build_patch,
    find_middle_circle,
)
from vehicle.identification.logs.schema import Array
from vehicle.identification.logs.thresholds import (
    CLEAR_SIGMAS,
    NEARLY_SHARE,
    STRAY_CORRELATION,
    SURE_SIGMAS,
)
from vehicle.model.effect_kinds import CIRCLE, INTERVAL_SIGMAS
from vehicle.model.effects import CATALOGUE

LIKELY_Z = 1.5  # standard errors of the predictive difference from which something is likely
EXCLUDED_LAW_Z = 1.0  # standard errors from which a law or a circle is excluded
EXCLUDED_NATS = 6.0  # the same in nats: 400 to 1
CLEAR_LAW_Z = 6.0  # from which a law has a name: what lies outside the catalogue is often like some law
CLEAR_OF_NEUTRAL = 2.5  # standard deviations of the value
# Of the finest size that may be claimed: standard deviation of a value by what the base model is off, for any data.
MODEL_SHARE = 0.5
CLOCK_SHARE = 0.1  # of the step between rows: what inputs known so seldom leave open of a time (dt / sqrt 12, 8 events)
LARGE_END_WIDTHS = 2.0  # a limit so far from neutral is not reached by a fault; no dead band at all is near
FAR_WIDTHS = 5.0  # an amount beyond says that the grammar does not hold these logs: nothing is certain then
TIME_FIELDS = frozenset({"dead_steps", "lag", "latency", "speed_lag", "position_late", "heading_late"})
TRIED_SHARES = (0.25, 0.5, 1.0, 2.0)  # of the typical size, to find the smallest that would be seen


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is said of a hypothesis: status, amounts (k,) with their covariance (k, k), nats against nothing, and
    the ids of effects that explain the logs as well. `others` are the comparisons behind these."""

    hypothesis: Hypothesis
    status: str
    amounts: Array
    covariance: Array
    nats: float
    equivalent_to: tuple[str, ...] = ()
    others: tuple[PredictiveComparison, ...] = ()


def decide(problem: Problem, result: SearchResult) -> list[Verdict]:
    """Verdicts on the hypotheses of the final model that anything can be said of, the clearest first."""
    fit = result.fit
    centre = centre_laws(problem, fit)
    covariance, all_amounts = centre @ compute_covariance(problem, fit) @ centre.T, centre @ fit.amounts
    is_far = any(_is_far(one.hypothesis, fit.get_amounts(one.hypothesis)) for one in result.judgements)
    # Nuisances of the path to either side that are as large as they may be: the base model then lacks more than it is
    # known to. Tyres that relax for long are no such thing.
    spent = list[slice]()
    for one, part in split_amounts(fit.model, fit.amounts):
        coordinate = one.coordinates[0]
        is_path = one.is_nuisance and "path" in one.chains and coordinate.low < 0.0
        if is_path and np.abs(part).max() >= NEARLY_SHARE * coordinate.high:
            spent.append(fit.locate(one))
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    correlations = np.abs(covariance / np.outer(sigmas, sigmas))
    verdicts = []
    for judgement in result.judgements:
        place = fit.locate(judgement.hypothesis)
        own, amounts = covariance[place, place], all_amounts[place]
        status = _choose_status(judgement, amounts, own)
        # The logs could exchange it with what the base model lacks.
        is_doubtful = is_far or any(correlations[place, one].max() > STRAY_CORRELATION for one in spent)
        if status == NAMED and is_doubtful:
            status = LIKELY
        others, nats = _list_equivalents(judgement), judgement.against_none.nats
        ids = tuple(dict.fromkeys(one.alternative.id for one in others if one.alternative is not None))
        verdicts += [Verdict(judgement.hypothesis, status, amounts, own, nats, ids, others)] if status else []
    return sorted(verdicts, key=lambda one: -one.nats)


def centre_laws(problem: Problem, fit: Fit) -> Array:
    """The matrix (k, k) that gives a constant what laws of the same effect add on average, where no file holds these;
    values of single runs are then about their mean."""
    centre = np.eye(len(fit.amounts))
    for law in [one for one in fit.model if not one.is_storable and one.coordinates[0].basis != CONSTANT]:
        constants = [one for one in fit.model if one.id == law.id and one.law == CONSTANT]
        if constants:
            own, is_by_run = fit.locate(law), law.law == BY_RUN
            means = np.full(law.size, 1.0 / law.size) if is_by_run else problem.bases.compute_means(law)
            centre[fit.locate(constants[0]), own] += means if constants[0].size == 1 else np.diag(means)
            if is_by_run:
                centre[own, own] -= 1.0 / law.size
    return centre


def _is_far(hypothesis: Hypothesis, amounts: Array) -> bool:
    """Whether amounts are beyond what any tractor has, or at a limit: then the grammar does not hold these logs.

    Widths are standard deviations of priors. A limit near neutral is reached by no fault: no dead band at all is near.
    """
    widths = np.array([one.width for one in hypothesis.coordinates])
    ends = np.array([[one.low, one.high] for one in hypothesis.coordinates])
    sizes = np.abs(amounts) / widths
    is_large_end = np.isclose(amounts[:, None], ends).any(axis=1) & (sizes > LARGE_END_WIDTHS)
    is_at_end = hypothesis.law == CONSTANT and bool(is_large_end.any())
    return is_at_end or (hypothesis.law != BY_RUN and float(sizes.max()) > FAR_WIDTHS)


def _choose_status(judgement: Judgement, amounts: Array, covariance: Array) -> str:
    """The status of a hypothesis, or an empty text where nothing can be said."""
    against = judgement.against_none
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    scatter = np.sqrt(np.maximum(sigmas**2 - (MODEL_SHARE * judgement.hypothesis.finest) ** 2, 1e-30))
    is_clear = float(np.max(np.abs(amounts) / sigmas)) >= CLEAR_OF_NEUTRAL
    is_large = float(np.linalg.norm(amounts)) >= judgement.hypothesis.finest
    if against.z < LIKELY_Z or not is_clear or not is_large:
        return ""
    is_firm = _is_firm(judgement.hypothesis, amounts, scatter)
    if judgement.hypothesis.law not in (CONSTANT, "by_place"):
        if not is_firm:
            return ""
        return NAMED if against.z >= CLEAR_LAW_Z and not _list_equivalents(judgement) else LIKELY
    if against.z < SURE_SIGMAS or not is_firm:
        return LIKELY
    return EQUIVALENT if _list_equivalents(judgement) else NAMED


def _is_firm(hypothesis: Hypothesis, amounts: Array, sigmas: Array) -> bool:
    """Whether the size, less its scatter, is what may be claimed at the least; of a law, of which many are tried,
    twice as much, and of values of single runs that of the one most unlike the others."""
    if hypothesis.law == BY_RUN:
        away = np.abs(amounts - np.median(amounts)) - INTERVAL_SIGMAS * sigmas
        return bool(away.max() >= 2.0 * hypothesis.finest)
    place = int(np.argmax(np.abs(amounts) / sigmas))
    least = hypothesis.finest * (2.0 if hypothesis.penalty and hypothesis.law != "by_place" else 1.0)
    return float(np.linalg.norm(amounts) - INTERVAL_SIGMAS * sigmas[place]) >= least


def _list_equivalents(judgement: Judgement) -> tuple[PredictiveComparison, ...]:
    """Comparisons with competitors with another id that do not predict the logs clearly worse: a law or a circle, of
    which many are tried, by posterior probability alone, an effect of the catalogue also in standard errors."""
    equivalents = []
    for one in judgement.against_others:
        if one.alternative is not None and one.alternative.id != judgement.hypothesis.id:
            penalty = one.alternative.penalty
            least_z = EXCLUDED_LAW_Z if penalty else CLEAR_SIGMAS
            if one.nats + penalty < EXCLUDED_NATS or one.z < least_z:
                equivalents.append(one)
    return tuple(equivalents)


def compute_covariance(problem: Problem, fit: Fit) -> Array:
    """Covariance (k, k) of all amounts: by the curvature, or by the scatter between runs where that is larger, and at
    least what the base model and, of a time, the clock of the inputs leave open."""
    widths = collect_widths(fit.model)
    linear = problem.linearise(fit.model, fit.amounts, fit.residuals, 2.0 * FIT_STEP)
    groups = problem.data.window_runs
    if len(np.unique(groups)) < 3:
        groups = np.arange(len(groups)) % max(len(groups) // 2, 1)
    names = np.unique(groups)
    slopes = np.stack([linear.sum_windows(groups == group)[1] for group in names])
    inverse = linear.inverse
    robust = inverse @ slopes.T @ slopes @ inverse * len(names) / max(len(names) - 1, 1)
    growth = np.sqrt(np.maximum(np.diag(robust) / np.diag(inverse), 1.0))
    covariance = inverse * np.outer(growth, growth) * np.outer(widths, widths)
    variances = list[float]()
    for hypothesis in fit.model:
        is_time = any(name in TIME_FIELDS for one in hypothesis.coordinates for name, _ in one.slopes)
        clock = CLOCK_SHARE * problem.data.row_step_s if is_time else 0.0
        variances += [(MODEL_SHARE * hypothesis.finest) ** 2 + clock**2] * hypothesis.size
    return np.asarray(covariance + np.diag(variances))


def find_smallest_visible(problem: Problem, fit: Fit) -> dict[str, float]:
    """The smallest size of every effect (unit of its first parameter) that these logs would have shown; effects that no
    size of up to twice the typical one would show are left out."""
    linear = problem.linearise(fit.model, fit.amounts, fit.residuals)
    data, tractor, visible = problem.data, problem.rig.tractor, dict[str, float]()
    for effect in CATALOGUE:
        is_circle = effect.kind is CIRCLE
        hypothesis = build_patch(find_middle_circle(data)) if is_circle else build_constant(effect, data, tractor)
        if any(one.id == effect.id and one.is_catalogued for one in fit.model):
            continue
        kind, parameter, _ = scale_effect(effect, data, tractor)
        coordinate, size = hypothesis.coordinates[0], len(fit.amounts)
        typical = coordinate.width / WIDTH_PER_TYPICAL
        sign = -1.0 if coordinate.high <= 0.0 or effect.is_worse_when_less else 1.0
        for share in TRIED_SHARES:
            step = sign * share * typical / coordinate.width
            moved = np.concatenate([fit.amounts, np.zeros(hypothesis.size)])
            moved[size] += step * coordinate.width
            shown = problem.compute_residuals((*fit.model, hypothesis), moved)
            columns = linear.stack(
                {c: problem.noise[c].whiten(fit.residuals[c] - shown[c])[:, :, None] for c in CHANNELS}
            )
            own = float(np.vdot(columns, linear.reduce(columns)))
            # An effect of this size would enter by evidence and be clear: half its squares are the nats it brings.
            needed = 2.0 * (ADD_NATS + 0.5 * np.log1p(own)) + SURE_SIGMAS**2
            if own >= needed:
                tried, fraction = np.array([share * typical]), share * float(np.sqrt(needed / own))
                visible[effect.id] = kind.compute_smallest_detectable(
                    tried, fraction, parameter.typical, parameter.finest
                )
                break
    return visible
