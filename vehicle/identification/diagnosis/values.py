"""From amounts of a fit to values of effects: settings of a tractor file, intervals and correlations, laws and what
values of single runs have in common, and their sentences."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.diagnosis.drive_data import DriveData
from vehicle.identification.diagnosis.grammar import BY_RUN, CONSTANT, Hypothesis, collect_widths, scale_effect
from vehicle.identification.diagnosis.model_fit import Fit, Problem
from vehicle.identification.diagnosis.results import ParameterCorrelations, ParameterLaw
from vehicle.identification.diagnosis.verdicts import Verdict
from vehicle.identification.logs.schema import Array, Log
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import Interval
from vehicle.model.effects import DISCREPANCY_KEY, EFFECTS_BY_ID, get_effect
from vehicle.model.tractor import Settings, Tractor

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
OTHER_LAW_SENTENCE = "not the same in all directions ({amount:+.3f}{unit})"
WIDEST_ANGLE_DEG = 27.0  # to which a law by angle is described, as in LOGS.md
FEWEST_FOR_SWING = 7  # runs: four numbers describe a swing, and fewer runs than this follow one by chance
PERIODS = np.geomspace(0.7, 4.0, 40)  # of the time from the first run to the last; longer ones are straight lines
RELATIVE_STEP = 1e-4  # of a width: small against any curvature of a value over its coordinate


@dataclass(frozen=True, eq=False)
class ValueConverter:
    """Converts amounts of hypotheses for the tractor and the logs of a problem."""

    problem: Problem
    run_starts_s: Array

    def compute_values(self, hypothesis: Hypothesis, amounts: Array) -> Values:
        """The values of compute_values for this tractor and these logs."""
        return compute_values(hypothesis, amounts, self.problem.data, self.problem.rig.tractor)

    def compute_interval(self, hypothesis: Hypothesis, amounts: Array, covariance: Array) -> dict[str, Interval]:
        """95 % intervals of the values; none for the place of a circle."""
        effect = get_effect(hypothesis.id)
        kind, _, box = scale_effect(effect, self.problem.data, self.problem.rig.tractor)
        return kind.compute_interval(effect.params, box, np.array(box.neutral) + amounts, covariance)

    def build_settings(self, parts: Sequence[tuple[Hypothesis, Array]]) -> Settings:
        """What a tractor file would hold of these hypotheses; those that none can hold are left out."""
        settings: dict[str, Values] = {}
        amounts_by_term: Values = {}
        for hypothesis, amounts in parts:
            if hypothesis.terms:
                for term, amount, one in zip(hypothesis.terms, amounts, hypothesis.coordinates, strict=True):
                    amounts_by_term[term] = float(amount) * one.slopes[0][1] / TERMS_BY_NAME[term].scale
            elif hypothesis.is_storable:
                settings[hypothesis.id] = self.compute_values(hypothesis, amounts)
        finite = {name: values for name, values in settings.items() if all(map(math.isfinite, values.values()))}
        return {**finite, **({DISCREPANCY_KEY: amounts_by_term} if amounts_by_term else {})}

    def describe_law(self, verdict: Verdict, constant: Array | None) -> ParameterLaw:
        """How the parameter of an effect varies; `constant` are the amounts of the same effect without a law."""
        hypothesis, effect = verdict.hypothesis, get_effect(verdict.hypothesis.id)
        neutral = self.compute_values(hypothesis.make_constant(), np.zeros(1))[effect.size.name]
        pattern, at = self.find_pattern(verdict), neutral
        if constant is not None:
            at += float(constant[0])
            at -= 0.0 if pattern or hypothesis.is_storable else float(
                self.problem.bases.compute_means(hypothesis) @ verdict.amounts)  # fmt: skip
        if pattern is not None:
            kind, values = pattern.kind, pattern.compute_values(at)
        else:
            kind, amount = hypothesis.law, float(verdict.amounts[0])
            compute = LAW_VALUES.get(kind, lambda _at, amount, _is_left: {"amount": amount})
            values = compute(at, amount, hypothesis.basis.endswith("left"))
        unit = f" {effect.size.unit}" if effect.size.unit else ""
        run = "" if pattern is None else self.problem.data.dataset.names[pattern.run]
        words = LAW_SENTENCES.get(kind, OTHER_LAW_SENTENCE).format(**values, unit=unit, run=run)
        return ParameterLaw(kind, values, f"The {effect.label} is {words}.")

    def find_pattern(self, verdict: Verdict) -> RunPattern | None:
        """What the values of single runs have in common; None for other laws."""
        if verdict.hypothesis.law != BY_RUN:
            return None
        sigmas = np.sqrt(np.diag(verdict.covariance))
        return find_run_pattern(verdict.amounts, sigmas, self.run_starts_s)


def compute_values(hypothesis: Hypothesis, amounts: Array, data: DriveData, tractor: Tractor) -> Values:
    """The values by name that amounts of a hypothesis stand for: of the tractor file, where it is in the catalogue.

    Those of a law, or of what no tractor file holds, are the amounts themselves.
    """
    effect = EFFECTS_BY_ID.get(hypothesis.id)
    if effect is None or hypothesis.law not in (CONSTANT, "by_place", "with_speed"):
        names = [one.slopes[0][0] for one in hypothesis.coordinates]
        if effect is not None and hypothesis.size == 1:
            names = [effect.size.name]
        return dict(zip(names, map(float, amounts), strict=True))
    kind, _, box = scale_effect(effect, data, tractor)
    origin, place = data.dataset.origin, hypothesis.place
    circle = (place[0] + origin[0], place[1] + origin[1], *place[2:]) if place else ()
    return kind.compute_values(effect.params, np.array(box.neutral) + amounts, circle)


@dataclass(frozen=True)
class RunPattern:
    """How the amounts of runs vary: `kind` by_run (`run` has `amount`, the others `other`), or over_day, a swing of
    `amount` about `other` with a period (s) and a phase (rad) at time 0 of the logs."""

    kind: str
    amount: float
    other: float
    run: int = 0
    period_s: float = 0.0
    phase: float = 0.0

    def compute_values(self, at: float) -> Values:
        """Its numbers about a value, as in LOGS.md; `lowest_s` is a time of the lowest value."""
        if self.kind == BY_RUN:
            return {"value": at + self.amount, "other": at + self.other}
        return {
            "mean": at + self.other,
            "amplitude": self.amount,
            "period_s": self.period_s,
            "phase_deg": math.degrees(self.phase) % 360.0,
            "lowest_s": (-0.25 - self.phase / (2.0 * math.pi)) % 1.0 * self.period_s,
        }


def list_run_starts(logs: Sequence[Log]) -> Array:
    """The time (s) of the first used row of every log."""
    return np.array([float(log.time_s[log.used][0]) if log.used.any() else 0.0 for log in logs])


def find_run_pattern(amounts: Array, sigmas: Array, starts_s: Array) -> RunPattern:
    """The simplest pattern that describes the amounts (r,) of runs that began at `starts_s` (r,).

    That is the run whose own value leaves the least misfit of the others' mean. A swing needs FEWEST_FOR_SWING runs at
    different times; it is taken where it describes them better, by the Bayesian information criterion.
    """
    found: list[tuple[float, int, float]] = []
    for run in range(len(amounts)):
        others, weights = np.arange(len(amounts)) != run, 1.0 / (sigmas * sigmas)
        mean = float(np.average(amounts[others], weights=weights[others]))
        found.append((float((weights[others] * (amounts[others] - mean) ** 2).sum()), run, mean))
    misfit, run, mean = min(found)
    best, span = RunPattern(BY_RUN, float(amounts[run]), mean, run), float(np.ptp(starts_s))
    if len(np.unique(starts_s)) < FEWEST_FOR_SWING:
        return best
    least = misfit - 2.0 * math.log(len(amounts))  # for two more numbers
    for period_s in PERIODS * span:
        angle = 2.0 * math.pi * starts_s / period_s
        columns = np.stack([np.ones(len(amounts)), np.sin(angle), np.cos(angle)], axis=1) / sigmas[:, None]
        numbers = np.linalg.lstsq(columns, amounts / sigmas, rcond=None)[0]
        misfit = float(((columns @ numbers - amounts / sigmas) ** 2).sum())
        if misfit < least:
            size, phase = math.hypot(numbers[1], numbers[2]), math.atan2(numbers[2], numbers[1])
            best, least = RunPattern("over_day", size, float(numbers[0]), 0, float(period_s), phase), misfit
    return best


def compute_value_correlations(problem: Problem, fit: Fit) -> ParameterCorrelations | None:
    """The correlations of the values of all hypotheses of a fit but nuisances, which are free; None for fewer than two.

    A hypothesis with a law is named by effect and law, as ``steering_offset:by_speed``.
    """
    widths = collect_widths(fit.model)
    covariance = np.linalg.pinv(fit.curvature, hermitian=True) * np.outer(widths, widths)
    names: list[tuple[str, str]] = []
    rows = [np.empty((0, len(widths)))]
    for hypothesis in fit.model:
        if not hypothesis.is_nuisance:
            own, slopes = _list_value_slopes(problem, hypothesis, fit.get_amounts(hypothesis))
            block = np.zeros((len(own), len(widths)))
            block[:, fit.locate(hypothesis)] = slopes
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


def _list_value_slopes(problem: Problem, hypothesis: Hypothesis, amounts: Array) -> tuple[list[str], Array]:
    """The names of the values of a hypothesis, and the change of each (rows) per amount (columns)."""
    columns = []
    names: list[str] = []
    for place, coordinate in enumerate(hypothesis.coordinates):
        step = np.zeros(hypothesis.size)
        step[place] = RELATIVE_STEP * coordinate.width
        after, before = (
            compute_values(hypothesis, amounts + sign * step, problem.data, problem.rig.tractor) for sign in (1.0, -1.0)
        )
        names = list(after)
        changes = np.array([after[name] - before[name] for name in names]) / (2.0 * step[place])
        columns.append(np.where(np.isfinite(changes), changes, 0.0))
    return names, np.stack(columns, axis=1)
