"""From amounts of a fit to values of effects: settings of a tractor file, intervals, laws and their sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.diagnosis.drive_data import DriveData
from vehicle.identification.diagnosis.grammar import (
    BY_RUN,
    CONSTANT,
    Hypothesis,
    get_kind,
    scale_parameter,
)
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.results import ParameterLaw
from vehicle.identification.diagnosis.run_laws import RunPattern, find_run_pattern
from vehicle.identification.diagnosis.verdicts import Verdict
from vehicle.identification.logs.schema import Array
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effect_kinds import CIRCLE, INTERVAL_SIGMAS, Interval
from vehicle.model.effects import DISCREPANCY_KEY, EFFECTS_BY_ID, get_effect, get_neutral_values
from vehicle.model.tractor import Settings, Tractor

WIDEST_ANGLE_DEG = 27.0  # to which a law by angle is described, as in LOGS.md
Values = dict[str, float]


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
        tractor = self.problem.rig.tractor
        size = scale_parameter(effect.size, tractor)
        zero = float(get_neutral_values(effect.id, tractor.steering)[effect.size.name])
        if effect.kind is CIRCLE:
            half = INTERVAL_SIGMAS * math.sqrt(float(covariance[0, 0]))
            value = zero + float(amounts[0])
            return {size.name: (value - half, value + half)}
        kind = get_kind(effect, self.problem.data)
        box = kind.build_box(size, zero, ())
        return kind.compute_interval(effect.params, box, np.array(box.neutral) + amounts, covariance, 0.0)

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
        kind = pattern.kind if pattern is not None else hypothesis.law
        values = (
            self._compute_law_values(hypothesis, at, float(verdict.amounts[0]))
            if pattern is None
            else _compute_pattern_values(pattern, at)
        )
        unit = f" {effect.size.unit}" if effect.size.unit else ""
        run = "" if pattern is None else self.problem.data.dataset.names[pattern.run]
        return ParameterLaw(kind, values, f"The {effect.label} is {_describe_values(kind, values, unit, run)}.")

    def find_pattern(self, verdict: Verdict) -> RunPattern | None:
        """What the values of single runs have in common; None for other laws."""
        if verdict.hypothesis.law != BY_RUN:
            return None
        sigmas = np.sqrt(np.diag(verdict.covariance))
        return find_run_pattern(verdict.amounts, sigmas, self.run_starts_s)

    def _compute_law_values(self, hypothesis: Hypothesis, at: float, amount: float) -> Values:
        match hypothesis.law:
            case "by_speed":
                return {"at_0": at, "per_mps": amount}
            case "by_angle":
                return {"at_0": at, "at_27": at + math.radians(WIDEST_ANGLE_DEG) * amount}
            case "by_implement":
                return {"lifted": at, "working": at + amount}
            case "over_minutes":
                return {"start": at, "per_minute": amount}
            case "by_side":
                is_left = hypothesis.basis.endswith("left")
                return {"right": at + amount * (not is_left), "left": at + amount * is_left}
            case _:
                return {"amount": amount}


def _compute_pattern_values(pattern: RunPattern, at: float) -> Values:
    """The numbers of a pattern of runs, as in LOGS.md; `lowest_s` is a time of the lowest value."""
    if pattern.kind == BY_RUN:
        return {"value": at + pattern.amount, "other": at + pattern.other}
    lowest = (-0.25 - pattern.phase / (2.0 * math.pi)) % 1.0 * pattern.period_s
    return {
        "mean": at + pattern.other,
        "amplitude": pattern.amount,
        "period_s": pattern.period_s,
        "phase_deg": math.degrees(pattern.phase) % 360.0,
        "lowest_s": lowest,
    }


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
    kind, zero = get_kind(effect, data), get_neutral_values(effect.id, tractor.steering)[effect.size.name]
    neutral = kind.build_box(scale_parameter(effect.size, tractor), float(zero), ()).neutral
    origin, place = data.dataset.origin, hypothesis.place
    circle = (place[0] + origin[0], place[1] + origin[1], *place[2:]) if place else ()
    return kind.compute_values(effect.params, np.array(neutral) + amounts, circle)


def _describe_values(law: str, values: Values, unit: str, run: str) -> str:
    def show(name: str) -> str:
        return f"{values[name]:.2f}{unit}"

    match law:
        case "by_speed":
            return f"{show('at_0')} at a crawl and changes by {values['per_mps']:+.3f}{unit} per m/s"
        case "by_angle":
            return f"{show('at_0')} at 0 degrees and {show('at_27')} at 27 degrees"
        case "by_implement":
            return f"{show('lifted')} with the implement lifted and {show('working')} with it working"
        case "over_minutes":
            return f"{show('start')} at the start of a run and changes by {values['per_minute']:+.3f}{unit} per minute"
        case "by_run":
            return f"{show('value')} in {run} and {show('other')} in the other runs"
        case "over_day":
            return f"{show('mean')} on average and swings by {values['amplitude']:.2f}{unit} over the day"
        case "by_side":
            return f"{show('right')} to the right and {show('left')} to the left"
        case _:
            return f"not the same in all directions ({values['amount']:+.3f}{unit})"
