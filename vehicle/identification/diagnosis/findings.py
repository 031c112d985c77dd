"""Findings: one per effect of the catalogue, from verdicts, with value, interval, law and sentence."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.diagnosis.grammar import build_constant
from vehicle.identification.diagnosis.model_fit import Problem
from vehicle.identification.diagnosis.other_vehicles import ARTICULATED, OtherTurning
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
    Finding,
)
from vehicle.identification.diagnosis.saving import Saved
from vehicle.identification.diagnosis.search import SearchResult
from vehicle.identification.diagnosis.values import ValueConverter
from vehicle.identification.diagnosis.verdicts import Verdict, find_smallest_visible, is_refutable
from vehicle.model.effect_kinds import CIRCLE, Interval
from vehicle.model.effects import CATALOGUE, EFFECTS_BY_ID, Effect, get_effect, get_neutral_values


@dataclass(frozen=True, eq=False)
class FindingBuilder:
    """Builds the findings of a problem from its verdicts and what of them is saved."""

    problem: Problem
    result: SearchResult
    saved: Saved
    converter: ValueConverter

    def build(self, verdicts: Sequence[Verdict]) -> list[Finding]:
        """A finding for every effect of the catalogue, in its order."""
        visible = find_smallest_visible(self.problem, self.result.fit)
        by_id: dict[str, list[Verdict]] = {}
        for verdict in verdicts:
            if verdict.hypothesis.id in EFFECTS_BY_ID:
                by_id.setdefault(verdict.hypothesis.id, []).append(verdict)
        findings = {effect_id: self._build_found(own, visible.get(effect_id)) for effect_id, own in by_id.items()}
        for verdict in verdicts:
            for finding in self._build_alternatives(verdict, visible):
                findings.setdefault(finding.id, finding)
        return [
            findings[effect.id]
            if effect.id in findings
            else self._build_absent(effect, visible.get(effect.id), verdicts)
            for effect in CATALOGUE
        ]

    def _build_found(self, verdicts: Sequence[Verdict], visible: float | None) -> Finding:
        """The finding of an effect: its constant with a law, if it has one."""
        converter = self.converter
        constants = [one for one in verdicts if one.hypothesis.is_catalogued]
        main = (constants or list(verdicts))[0]
        effect = get_effect(main.hypothesis.id)
        is_circle = effect.kind is CIRCLE  # its place is its law
        laws = [one for one in verdicts if not (one.hypothesis.is_catalogued or is_circle) and
                one.hypothesis.law != "with_speed"]  # fmt: skip
        value: Mapping[str, float] = {}
        interval: dict[str, Interval] | None = None
        if constants or main.hypothesis.law == "with_speed":
            value = converter.compute_values(main.hypothesis, main.amounts)
            interval = dict(converter.compute_interval(main.hypothesis, main.amounts, main.covariance))
        law = converter.describe_law(laws[0], constants[0].amounts if constants else None) if laws else None
        if law is not None and not constants:
            value, interval = self._average_law(laws[0], effect), None
        if main.status == EQUIVALENT and interval is not None:
            interval[effect.size.name] = self._extend_to_neutral(effect, interval[effect.size.name])
        gain = self.saved.gains.get(effect.id)
        return Finding(
            effect.id, main.status, dict(value), interval, gain and gain[0], gain and gain[1], visible,
            effect.size.unit, effect.block, effect.describe(value), self._list_ids(main.equivalent_to),
            self._describe_exchange(main), law,
        )  # fmt: skip

    def _average_law(self, verdict: Verdict, effect: Effect) -> dict[str, float]:
        """The mean value over the logs of an effect that follows a law."""
        hypothesis = verdict.hypothesis
        mean = float(verdict.amounts @ self.problem.bases.compute_means(hypothesis))
        return self.converter.compute_values(hypothesis.make_constant(), np.array([mean]))

    def _extend_to_neutral(self, effect: Effect, interval: Interval) -> Interval:
        """The interval of an effect that another could replace reaches to neutral."""
        neutral = get_neutral_values(effect.id, self.problem.rig.tractor.steering)[effect.size.name]
        return min(interval[0], neutral), max(interval[1], neutral)

    def _list_ids(self, ids: Sequence[str]) -> tuple[str, ...]:
        return tuple(one for one in ids if one in EFFECTS_BY_ID)

    def _describe_exchange(self, verdict: Verdict) -> str:
        names = [get_effect(one).label for one in self._list_ids(verdict.equivalent_to)]
        return f"these logs cannot tell it from {' or '.join(names)}" if names else ""

    def _build_alternatives(self, verdict: Verdict, visible: Mapping[str, float]) -> list[Finding]:
        """Findings of the effects that could take the place of one."""
        if verdict.status != EQUIVALENT or verdict.hypothesis.id not in EFFECTS_BY_ID:
            return []
        found = []
        for other in verdict.others:
            alternative, amounts = other.alternative, other.amounts
            if alternative is None or amounts is None or not alternative.is_catalogued:
                continue
            effect, value = get_effect(alternative.id), self.converter.compute_values(alternative, amounts)
            sets = (verdict.hypothesis.id, *(one for one in verdict.equivalent_to if one != effect.id))
            found.append(
                Finding(
                    effect.id, EQUIVALENT, value, None, None, None, visible.get(effect.id), effect.size.unit,
                    effect.block, effect.describe(value), self._list_ids(sets),
                    f"looks like {get_effect(verdict.hypothesis.id).label}",
                )
            )  # fmt: skip
        return found

    def _build_absent(self, effect: Effect, visible: float | None, verdicts: Sequence[Verdict]) -> Finding:
        """The finding of an effect that the logs do not call for."""
        own = build_constant(effect, self.problem.data, self.problem.rig.tractor) if effect.kind is not CIRCLE else None
        channels = frozenset({"pose"}) if own is None else self.problem.list_channels(own)
        said = {str(one.hypothesis) for one in verdicts}
        # What the model holds and nothing can be said of may be this effect.
        is_open = any(
            str(one.hypothesis) not in said and self.problem.list_channels(one.hypothesis) & channels
            for one in self.result.judgements
        )
        status = REFUTED if is_refutable(effect, visible, self.problem) and not is_open else NOT_VISIBLE
        shown = None if visible is None or not math.isfinite(visible) else visible
        return Finding(effect.id, status, None, None, None, None, shown, effect.size.unit, effect.block, "")


def order_names(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Ids of named findings, the most important first: by the error of left-out runs that returns without it."""
    named = [finding for finding in findings if finding.status == NAMED]
    return tuple(finding.id for finding in sorted(named, key=lambda one: -(one.gain_pct or 0.0)))


def withdraw_refused(verdicts: Sequence[Verdict], refused: Sequence[Verdict]) -> list[Verdict]:
    """The verdicts without those that left-out runs refuse: a name becomes likely, anything else is dropped.

    Columns that no path shows stay as they are.
    """
    kept = []
    for verdict in verdicts:
        effect = EFFECTS_BY_ID.get(verdict.hypothesis.id)
        is_refused = any(one is verdict for one in refused) and not (effect is not None and effect.is_of_log_alone)
        if not is_refused:
            kept.append(verdict)
        elif verdict.status == NAMED:
            kept.append(replace(verdict, status=LIKELY))
    return kept


def doubt_by_turning(verdicts: Sequence[Verdict], turning: OtherTurning | None) -> list[Verdict]:
    """The verdicts without what only stands in for a vehicle that turns otherwise; with a joint nothing has a name, as
    rams that move half of the vehicle are not those of the file."""
    if turning is None:
        return list(verdicts)
    kept = [one for one in verdicts if one.hypothesis.id not in turning.faked_ids]
    return [replace(one, status=LIKELY) if turning.kind == ARTICULATED else one for one in kept]
