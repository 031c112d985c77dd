"""Verdicts: what may be said of each hypothesis, with which interval, and how small an effect these logs would show.

From amounts of a fit come values of effects: settings of a tractor file, correlations, laws and what values of single
runs have in common, and their sentences.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fields.arrays import Floats
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
from vehicle.identification.diagnosis.results import EQUIVALENT, LIKELY, NAMED, ParameterCorrelations, ParameterLaw
from vehicle.identification.diagnosis.search import (
    ADD_NATS,
    Judgement,
    PredictiveComparison,
    SearchResult,
    build_patch,
    find_straightest_circle,
)
from vehicle.identification.logs.thresholds import (
    CLEAR_SIGMAS,
    DOUBT_SIGMAS,
    MEASURED_SIGMAS,
    NEARLY_SHARE,
    STRAY_CORRELATION,
    SURE_SIGMAS,
)
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import CIRCLE, INTERVAL_SIGMAS, Interval
from vehicle.model.effects import CATALOGUE, DISCREPANCY_KEY, EFFECTS_BY_ID, get_effect
from vehicle.model.tractor import Settings

LIKELY_Z = 0.5 * CLEAR_SIGMAS  # standard errors of the predictive difference from which something is likely
EXCLUDED_LAW_Z = 1.0  # standard errors from which a law or a circle is excluded
EXCLUDED_NATS = 6.0  # the same in nats: 400 to 1
CLEAR_LAW_Z = 2.0 * CLEAR_SIGMAS  # from which a law has a name: what lies outside the catalogue is often like some law
CLEAR_OF_NEUTRAL = 2.5  # standard deviations of the value
# Of the finest size that may be claimed: standard deviation of a value by what the base model is off, for any data.
MODEL_SHARE = 0.5
CLOCK_SHARE = 0.1  # of the step between rows: what inputs known so seldom leave open of a time (dt / sqrt 12, 8 events)
LARGE_END_WIDTHS = DOUBT_SIGMAS  # a limit so far from neutral is not reached by a fault; no dead band at all is near
FAR_WIDTHS = MEASURED_SIGMAS  # an amount beyond says that the grammar does not hold these logs: nothing is certain then
TIME_FIELDS = frozenset({"dead_steps", "lag", "latency", "speed_lag", "position_late", "heading_late"})
TRIED_SHARES = (0.25, 0.5, 1.0, 2.0)  # of the typical size, to find the smallest that would be seen

Values = dict[str, float]
LAW_SENTENCES = {
    "by_speed": "{at_0:.2f}{unit} at a crawl and changes by {per_mps:+.3f}{unit} per m/s",
    "by_angle": "{at_0:.2f}{unit} at 0 degrees and {at_27:.2f}{unit} at 27 degrees",
    "by_implement": "{lifted:.2f}{unit} with the implement lifted and {working:.2f}{unit} with it working",
    "over_minutes": "{start:.2f}{unit} at the start of a run and changes by {per_minute:+.3f}{unit} per minute",
    BY_RUN: "{value:.2f}{unit} in {run} and {other:.2f}{unit} in the other runs",
    "over_day": "{mean:.2f}{unit} on average and swings by {amplitude:.2f}{unit} over the day",
    "by_side": "{right:.2f}{unit} to the right and {left:.2f}{unit} to the left",
}
LAW_VALUES: Mapping[str, Callable[[float, float, bool], Values]] = {
    "by_speed": lambda at, amount, _: {"at_0": at, "per_mps": amount},
    "by_angle": lambda at, amount, _: {"at_0": at, "at_27": at + math.radians(WIDEST_ANGLE_DEG) * amount},
    "by_implement": lambda at, amount, _: {"lifted": at, "working": at + amount},
    "over_minutes": lambda at, amount, _: {"start": at, "per_minute": amount},
    "by_side": lambda at, amount, is_left: {"right": at + amount * (not is_left), "left": at + amount * is_left},
}
"""Numbers of a law, as in LOGS.md, by the value without it, the amount, and whether it is of the left side."""
LEVELS = ("value", "other", "mean")
OTHER_LAW_SENTENCE = "not the same in all directions ({amount:+.3f}{unit})"
WIDEST_ANGLE_DEG = 27.0  # to which a law by angle is described, as in LOGS.md
FEWEST_FOR_SWING = 7  # runs: four numbers describe a swing, and fewer runs than this follow one by chance
PERIODS = np.geomspace(0.7, 4.0, 40)  # of the time from the first run to the last; longer ones are straight lines
RELATIVE_STEP = 1e-4  # of a width: small against any curvature of a value over its coordinate


@dataclass(frozen=True, eq=False)
class Verdict:
    """What is said of a hypothesis: status, amounts (k,) with their covariance (k, k), nats against nothing, and
    the ids of effects that explain the logs as well. `others` are the comparisons behind these."""

    hypothesis: Hypothesis
    status: str
    amounts: Floats
    covariance: Floats
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


def centre_laws(problem: Problem, fit: Fit) -> Floats:
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


def _is_far(hypothesis: Hypothesis, amounts: Floats) -> bool:
    """Whether amounts are beyond what any tractor has, or at a limit: then the grammar does not hold these logs. Widths
    are standard deviations of priors. A limit near neutral is reached by no fault: no dead band at all is near."""
    widths = np.array([one.width for one in hypothesis.coordinates])
    ends = np.array([[one.low, one.high] for one in hypothesis.coordinates])
    sizes = np.abs(amounts) / widths
    is_large_end = np.isclose(amounts[:, None], ends).any(axis=1) & (sizes > LARGE_END_WIDTHS)
    is_at_end = hypothesis.law == CONSTANT and bool(is_large_end.any())
    return is_at_end or (hypothesis.law != BY_RUN and float(sizes.max()) > FAR_WIDTHS)


def _choose_status(judgement: Judgement, amounts: Floats, covariance: Floats) -> str:
    """The status of a hypothesis, or an empty text where nothing can be said."""
    against = judgement.against_none
    sigmas = np.sqrt(np.maximum(np.diag(covariance), 1e-30))
    scatter = np.sqrt(np.maximum(sigmas**2 - (MODEL_SHARE * judgement.hypothesis.finest) ** 2, 1e-30))
    is_clear = float(np.max(np.abs(amounts) / sigmas)) >= CLEAR_OF_NEUTRAL
    is_large = float(np.linalg.norm(amounts)) >= judgement.hypothesis.finest
    if against.z < LIKELY_Z or not is_clear or not is_large:
        return ""
    # Whether the size, less its scatter, is what may be claimed at the least; of a law, of which many are tried, twice
    # as much, and of values of single runs that of the one most unlike the others.
    hypothesis, place = judgement.hypothesis, int(np.argmax(np.abs(amounts) / scatter))
    if hypothesis.law == BY_RUN:
        away = np.abs(amounts - np.median(amounts)) - INTERVAL_SIGMAS * scatter
        is_firm = bool(away.max() >= 2.0 * hypothesis.finest)
    else:
        least = hypothesis.finest * (2.0 if hypothesis.penalty and hypothesis.law != "by_place" else 1.0)
        is_firm = float(np.linalg.norm(amounts) - INTERVAL_SIGMAS * scatter[place]) >= least
    if judgement.hypothesis.law not in (CONSTANT, "by_place"):
        if not is_firm:
            return ""
        return NAMED if against.z >= CLEAR_LAW_Z and not _list_equivalents(judgement) else LIKELY
    if against.z < SURE_SIGMAS or not is_firm:
        return LIKELY
    return EQUIVALENT if _list_equivalents(judgement) else NAMED


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


def compute_covariance(problem: Problem, fit: Fit) -> Floats:
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
    """The smallest size of every effect (unit of its first parameter) that these logs would have shown, of a place
    wherever it is; effects that no size of up to twice the typical one would show are left out."""
    linear = problem.linearise_inside(fit)
    data, tractor, visible = problem.data, problem.rig.tractor, dict[str, float]()
    for effect in CATALOGUE:
        if any(one.id == effect.id and one.is_catalogued for one in fit.model):
            continue
        if effect.kind is CIRCLE:
            circle = find_straightest_circle(data, problem.bases)
            if circle is None:
                continue
            hypothesis = build_patch(circle)
        else:
            hypothesis = build_constant(effect, data, tractor)
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


def compute_interval(
    problem: Problem, hypothesis: Hypothesis, amounts: Floats, covariance: Floats
) -> dict[str, Interval]:
    """95 % intervals of the values; none for the place of a circle."""
    effect = get_effect(hypothesis.id)
    kind, _, box = scale_effect(effect, problem.data, problem.rig.tractor)
    return kind.compute_interval(effect.params, box, np.array(box.neutral) + amounts, covariance)


def build_settings(problem: Problem, parts: Sequence[tuple[Hypothesis, Floats]]) -> Settings:
    """What a tractor file would hold of these hypotheses; those that none can hold are left out."""
    settings: dict[str, Values] = {}
    amounts_by_term: Values = {}
    for hypothesis, amounts in parts:
        if hypothesis.terms:
            for term, amount, one in zip(hypothesis.terms, amounts, hypothesis.coordinates, strict=True):
                amounts_by_term[term] = float(amount) * one.slopes[0][1] / TERMS_BY_NAME[term].scale
        elif hypothesis.is_storable:
            settings[hypothesis.id] = compute_values(problem, hypothesis, amounts)
    finite = {name: values for name, values in settings.items() if all(map(math.isfinite, values.values()))}
    return {**finite, **({DISCREPANCY_KEY: amounts_by_term} if amounts_by_term else {})}


def describe_law(problem: Problem, verdict: Verdict, constant: Floats | None) -> ParameterLaw:
    """How the parameter of an effect varies; `constant` are the amounts of the same effect without a law."""
    hypothesis, effect = verdict.hypothesis, get_effect(verdict.hypothesis.id)
    neutral = compute_values(problem, hypothesis.make_constant(), np.zeros(1))[effect.size.name]
    pattern, at = find_pattern(problem, verdict), neutral
    if constant is not None:
        at += float(constant[0])
        at -= 0.0 if pattern or hypothesis.is_storable else float(
            problem.bases.compute_means(hypothesis) @ verdict.amounts)  # fmt: skip
    if pattern is not None:
        kind = pattern.kind
        values = {name: at + value if name in LEVELS else value for name, value in pattern.values.items()}
    else:
        kind, amount = hypothesis.law, float(verdict.amounts[0])
        compute = LAW_VALUES.get(kind, lambda _at, amount, _is_left: {"amount": amount})
        values = compute(at, amount, hypothesis.basis.endswith("left"))
    unit = f" {effect.size.unit}" if effect.size.unit else ""
    run = "" if pattern is None else problem.data.dataset.names[pattern.run]
    words = LAW_SENTENCES.get(kind, OTHER_LAW_SENTENCE).format(**values, unit=unit, run=run)
    return ParameterLaw(kind, values, f"The {effect.label} is {words}.")


def find_pattern(problem: Problem, verdict: Verdict) -> RunPattern | None:
    """The simplest pattern that describes the values of single runs; None for other laws.

    That is the run whose own value leaves the least misfit of the others' mean. A swing needs FEWEST_FOR_SWING runs
    at different times; it is taken where it describes them better, by the Bayesian information criterion.
    """
    if verdict.hypothesis.law != BY_RUN:
        return None
    amounts, sigmas, starts_s = verdict.amounts, np.sqrt(np.diag(verdict.covariance)), problem.data.dataset.run_starts_s
    found: list[tuple[float, int, float]] = []
    for run in range(len(amounts)):
        others, weights = np.arange(len(amounts)) != run, 1.0 / (sigmas * sigmas)
        mean = float(np.average(amounts[others], weights=weights[others]))
        found.append((float((weights[others] * (amounts[others] - mean) ** 2).sum()), run, mean))
    misfit, run, mean = min(found)
    best, span = RunPattern(BY_RUN, {"value": float(amounts[run]), "other": mean}, run), float(np.ptp(starts_s))
    if len(np.unique(starts_s)) < FEWEST_FOR_SWING:
        return best
    least = misfit - 2.0 * math.log(len(amounts))  # for two more numbers
    for period_s in (PERIODS * span).tolist():
        angle = 2.0 * math.pi * starts_s / period_s
        columns = np.stack([np.ones(len(amounts)), np.sin(angle), np.cos(angle)], axis=1) / sigmas[:, None]
        numbers = np.linalg.lstsq(columns, amounts / sigmas, rcond=None)[0]
        misfit = float(((columns @ numbers - amounts / sigmas) ** 2).sum())
        if misfit < least:
            size, phase = math.hypot(*numbers[1:]), math.atan2(numbers[2], numbers[1])
            lowest_s = (-0.25 - phase / (2.0 * math.pi)) % 1.0 * period_s  # a time of the lowest value
            values = {"mean": float(numbers[0]), "amplitude": size, "period_s": period_s,
                      "phase_deg": math.degrees(phase) % 360.0, "lowest_s": lowest_s}  # fmt: skip
            best, least = RunPattern("over_day", values), misfit
    return best


def compute_values(problem: Problem, hypothesis: Hypothesis, amounts: Floats) -> Values:
    """The values by name of amounts: of the tractor file, where the catalogue has it; of laws the amounts alone."""
    effect = EFFECTS_BY_ID.get(hypothesis.id)
    if effect is None or hypothesis.law not in (CONSTANT, "by_place", "with_speed"):
        names = [one.slopes[0][0] for one in hypothesis.coordinates]
        if effect is not None and hypothesis.size == 1:
            names = [effect.size.name]
        return dict(zip(names, map(float, amounts), strict=True))
    kind, _, box = scale_effect(effect, problem.data, problem.rig.tractor)
    origin, place = problem.data.dataset.origin, hypothesis.place
    circle = (place[0] + origin[0], place[1] + origin[1], *place[2:]) if place else ()
    return kind.compute_values(effect.params, np.array(box.neutral) + amounts, circle)


@dataclass(frozen=True)
class RunPattern:
    """How the amounts of runs vary: `kind` by_run (`run` unlike the others) or over_day (a swing); `values` are the
    numbers of its sentence, those of LEVELS about the value that the amounts add to."""

    kind: str
    values: Values
    run: int = 0


def compute_value_correlations(problem: Problem, fit: Fit) -> ParameterCorrelations | None:
    """The correlations of all values but nuisances, a law named as ``steering_offset:by_speed``; None for one."""
    widths = collect_widths(fit.model)
    covariance = np.linalg.pinv(fit.curvature, hermitian=True) * np.outer(widths, widths)
    names: list[tuple[str, str]] = []
    rows = [np.empty((0, len(widths)))]
    for hypothesis in fit.model:
        if not hypothesis.is_nuisance:
            of_amounts, own, amounts = [], list[str](), fit.get_amounts(hypothesis)
            for place, coordinate in enumerate(hypothesis.coordinates):
                step = np.zeros(hypothesis.size)
                step[place] = RELATIVE_STEP * coordinate.width
                after, before = (compute_values(problem, hypothesis, amounts + sign * step) for sign in (1.0, -1.0))
                own = list(after)
                changes = np.array([after[name] - before[name] for name in own]) / (2.0 * step[place])
                of_amounts.append(np.where(np.isfinite(changes), changes, 0.0))
            block = np.zeros((len(own), len(widths)))
            block[:, fit.locate(hypothesis)] = np.stack(of_amounts, axis=1)
            label = hypothesis.id if hypothesis.law in (CONSTANT, "by_place") else f"{hypothesis.id}:{hypothesis.law}"
            names += [(label, name) for name in own]
            rows.append(block)
    slopes = np.concatenate(rows)
    of_values = slopes @ covariance @ slopes.T
    spread = np.sqrt(np.maximum(np.diag(of_values), 0.0))
    known = spread > 0.0
    if known.sum() < 2:
        return None
    matrix = of_values[np.ix_(known, known)] / np.outer(spread[known], spread[known])
    kept = tuple(name for name, is_known in zip(names, known, strict=True) if is_known)
    return ParameterCorrelations(kept, np.clip(matrix, -1.0, 1.0))
