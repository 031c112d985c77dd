"""Findings of parameters that change: the law of each, alternatives that the logs cannot tell from it, and values that
are no constants."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

from vehicle.identification.diagnosis.results import (
    CONSTANT_LAW,
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    Finding,
    ParameterLaw,
)
from vehicle.identification.laws.bases import (
    BY_ANGLE,
    BY_IMPLEMENT,
    BY_PLACE,
    BY_RUN,
    BY_SIDE,
    BY_SPEED,
    OVER_DAY,
    OVER_MINUTES,
    RunClock,
)
from vehicle.identification.laws.columns import GAIN
from vehicle.identification.laws.selection import DRIFT, PATCH, STAND_INS, UNDERSTEER, FoundLaw, is_gain_by_speed
from vehicle.identification.laws.settle import LawSelection, SettledLaw
from vehicle.identification.laws.sides import RIGHT, SIDED_EFFECTS, SideLaw, find_only_side, find_side_laws
from vehicle.identification.laws.words import compute_law_values, describe_alternatives, describe_law
from vehicle.identification.replay.drive_segments import DriveDataset
from vehicle.identification.thresholds import WITHDRAWING_LAW_SHARE, WORTH_OF_WHEEL_PCT
from vehicle.identification.verdict.findings import extend_to_neutral
from vehicle.identification.verdict.named_causes import ExplainedCase
from vehicle.model.effects import get_effect, get_neutral_values
from vehicle.model.tractor import Tractor

# What grows over the minutes is a clock that runs away: a delay shows no other way, and of the clocks of speeds and
# positions which one it is does not show.
RUNAWAY_CLOCKS = {
    "clock_offset_speed": "clock_offset_position",
    "position_delay": "clock_offset_position",
    "heading_delay": "clock_offset_heading",
}
ASYMMETRY, ANTENNA_RIGHT, SIDE_DRAFT = "steering_asymmetry", "antenna_right", "implement_side_draft"
LEANING_M = 0.015  # chosen: as far as a body that rolls by half a degree carries an antenna of 1.7 m outwards in a bend
# Chosen: a swing has four numbers (mean, size, period, time), near which the values of six runs may lie by chance.
FEWEST_RUNS_OF_SWING = 7
STAND_IN_KINDS = {DRIFT: OVER_MINUTES, PATCH: BY_PLACE}
# Terms of the discrepancy model that are laws of the steering gain.
GAIN_TERMS = {BY_ANGLE: "grip_by_angle", BY_SPEED: "grip_by_speed", BY_IMPLEMENT: "grip_by_implement"}


def list_law_terms(law_selection: LawSelection) -> frozenset[str]:
    """Return the terms of the discrepancy model that stand for a settled law."""
    kinds = [law.found.kind for law in law_selection.laws if law.found.effect_id == GAIN]
    return frozenset(GAIN_TERMS[kind] for kind in kinds if kind in GAIN_TERMS)


def leave_out_stand_ins(explained_case: ExplainedCase, law_selection: LawSelection) -> ExplainedCase:
    """Return the case with the terms of settled laws, and without names for what only stands in for such a law.

    A simulation without the law lowers its error by understeer in the place of a gain that falls with speed.
    """
    stand_ins = _list_path_stand_ins(law_selection) - law_selection.selection.effect_ids
    names = [name for name in explained_case.names if name not in stand_ins]
    return replace(explained_case, law_terms=list_law_terms(law_selection), names=names)


def _list_path_stand_ins(law_selection: LawSelection) -> set[str]:
    laws = {(law.found.effect_id, law.found.kind) for law in law_selection.laws}
    return {UNDERSTEER} if (GAIN, BY_SPEED) in laws else set()


def add_laws(
    findings: Sequence[Finding],
    law_selection: LawSelection,
    clock: RunClock,
    names: Sequence[str],
    tractor: Tractor,
    explained_case: ExplainedCase,
) -> list[Finding]:
    """Return the findings with laws: of every settled one, and a constant for values that were tested and named."""
    out = list(findings)
    for law in law_selection.laws:
        out = _add_settled_law(out, law, clock, tuple(names), tractor)
    stand_ins = _list_path_stand_ins(law_selection) - law_selection.selection.effect_ids
    out = [
        _remove_value(finding) if finding.id in stand_ins and finding.status in (NAMED, LIKELY) else finding
        for finding in out
    ]
    selection = law_selection.selection
    outside_fit = {name: value for name, value in explained_case.case.found_values.items() if name in SIDED_EFFECTS}
    settings = {**outside_fit, **selection.fit.settings}
    sides = {law.effect_id: law for law in find_side_laws(selection.residual_model, settings)}
    out = [
        _tell_sides(finding, sides[finding.id], explained_case.sure_ids) if finding.id in sides else finding
        for finding in out
    ]
    if is_gain_by_speed(selection.residual_model, selection.fit, clock):
        out = [_compare_with_gain_by_speed(finding) if finding.id == UNDERSTEER else finding for finding in out]
    settled_ids = {law.found.effect_id for law in law_selection.laws}
    by_effect: dict[str, FoundLaw] = {}
    for found in sorted(law_selection.outcome.scores, key=lambda one: one.score.gain):
        by_effect[found.effect_id] = found
    return [
        finding
        if finding.id in settled_ids or finding.law is not None
        else _withdraw_constant(finding, by_effect.get(finding.id), tractor)
        for finding in out
    ]


def _add_settled_law(
    findings: list[Finding], law: SettledLaw, clock: RunClock, names: tuple[str, ...], tractor: Tractor
) -> list[Finding]:
    effect_id, values = law.found.effect_id, compute_law_values(law, clock)
    kinds = [STAND_IN_KINDS[name] for name in law.competitors]
    kinds += [found.kind for found in law.found.alternatives if found.effect_id == effect_id]
    if law.found.kind == OVER_DAY and len(names) < FEWEST_RUNS_OF_SWING:
        kinds.append(BY_RUN)
    other_kinds = tuple(kind for kind in dict.fromkeys(kinds) if kind != law.found.kind)
    words = describe_law(law, values, names, clock)
    exchange = describe_alternatives(law.found, other_kinds)
    others = tuple(name for name, kind in STAND_IN_KINDS.items() if effect_id == GAIN and kind in kinds)
    others += tuple(found.effect_id for found in law.found.alternatives if found.effect_id != effect_id)
    others += tuple(format_law_id(effect_id, kind) for kind in other_kinds if not _is_stand_in(kind, effect_id))
    if law.found.kind == OVER_MINUTES and effect_id in RUNAWAY_CLOCKS:
        others += (RUNAWAY_CLOCKS[effect_id],)
    others = tuple(dict.fromkeys(others))
    parameter_law = ParameterLaw(law.found.kind, values, f"{words} {exchange}".strip())
    out = []
    for finding in findings:
        if finding.id == effect_id:
            is_sure = law.found.is_clear or finding.status == NAMED
            status = EQUIVALENT if other_kinds or others else NAMED if is_sure else LIKELY
            out.append(_tell_law(finding, law, status, others, parameter_law, tractor))
        elif finding.id in others and finding.status not in (NAMED, LIKELY):
            same = (effect_id, *[other for other in others if other != finding.id])
            sentence = f"The {get_effect(finding.id).label} explains them as well."
            alternative = replace(finding, status=EQUIVALENT, equivalent_to=same, exchange=exchange)
            out.append(replace(alternative, description=sentence))
        elif effect_id == GAIN and finding.id in STAND_INS and finding.status in (NAMED, LIKELY):
            # The law explains more than this stand-in, which is left with a part of the same change.
            out.append(_remove_value(finding))
        else:
            out.append(finding)
    return out


def _is_stand_in(kind: str, effect_id: str) -> bool:
    return effect_id == GAIN and kind in STAND_IN_KINDS.values()


def format_law_id(effect_id: str, kind: str) -> str:
    """Return the id of a law among alternatives: its effect and its kind, as ``steering_offset:by_speed``."""
    return f"{effect_id}:{kind}"


def _tell_law(
    finding: Finding,
    law: SettledLaw,
    status: str,
    others: tuple[str, ...],
    parameter_law: ParameterLaw,
    tractor: Tractor,
) -> Finding:
    """Return the finding of a changing parameter: its mean with an interval, and its law."""
    effect = get_effect(finding.id)
    size = effect.size.name
    interval = (law.mean - law.mean_error, law.mean + law.mean_error)
    if finding.interval is not None and finding.value is not None:
        shift = law.mean - finding.value[size]
        low, high = finding.interval[size]
        interval = min(interval[0], low + min(shift, 0.0)), max(interval[1], high + max(shift, 0.0))
    if status == EQUIVALENT:
        interval = extend_to_neutral(tractor, effect, interval)
    return replace(
        finding,
        status=status,
        value={size: law.mean},
        interval={size: interval},
        description=parameter_law.words,
        equivalent_to=others,
        exchange=finding.exchange,
        law=parameter_law,
    )


def _tell_sides(finding: Finding, law: SideLaw, sure_ids: Collection[str]) -> Finding:
    """Return the finding of an effect of the steering with a value for each side.

    One value for both sides may have had no name because it raises errors, as it is wrong to either side. With its law
    the effect has one where two values remove as much of the error of the wheel angle as a name must; else it is
    likely.
    """
    effect = get_effect(law.effect_id)
    unit = f" {effect.size.unit}"
    words = f"The {effect.label} is {law.right:.1f}{unit} to the right and {law.left:.1f}{unit} to the left."
    parameter_law = ParameterLaw(BY_SIDE, {"right": law.right, "left": law.left}, words)
    described = replace(finding, description=words, law=parameter_law)
    if finding.status in (NAMED, EQUIVALENT):
        return described
    status = NAMED if finding.id in sure_ids and law.worth_pct >= WORTH_OF_WHEEL_PCT else LIKELY
    if finding.status == LIKELY:
        return replace(described, status=status)
    ends = min(law.right, law.left), max(law.right, law.left)
    size = effect.size.name
    return replace(described, status=status, value={size: 0.5 * (law.right + law.left)}, interval={size: ends})


def _compare_with_gain_by_speed(finding: Finding) -> Finding:
    """Return the finding of an understeer with a word on the gain that explains as much.

    It keeps its name, as the simpler of both: the gain needs a value at rest as well.
    """
    if finding.status not in (NAMED, LIKELY):
        return finding
    words = (
        "a steering_gain that changes with the speed would look the same; the same bends at a lower and at a higher "
        "speed than any of these decide"
    )
    return finding.add_exchange(words)


def mark_one_sided(findings: Sequence[Finding], dataset: DriveDataset) -> list[Finding]:
    """Return the findings, with a word on a gain of the steering that bends to one side alone have shown, and with the
    place of the antenna as uncertain as a body that leans in these bends makes it."""
    side = find_only_side(dataset)
    if side is None:
        return list(findings)
    out = [_describe_one_side(finding, side) if is_gain_of_one_side(finding, side) else finding for finding in findings]
    return [_widen_by_leaning(finding) if finding.id == ANTENNA_RIGHT else finding for finding in out]


def _widen_by_leaning(finding: Finding) -> Finding:
    """Return the place of the antenna to the right as a body that leans in bends to one side leaves it uncertain."""
    if finding.interval is None:
        return finding
    low, high = finding.interval["distance_m"]
    return replace(finding, interval={"distance_m": (low - LEANING_M, high + LEANING_M)})


def is_gain_of_one_side(finding: Finding, side: int | None) -> bool:
    """Whether a finding is a constant gain that is only known to one side (1 right, -1 left)."""
    is_constant = finding.law is None or finding.law.kind == CONSTANT_LAW
    return side is not None and finding.id == GAIN and finding.status in (NAMED, LIKELY) and is_constant


def compute_other_side(finding: Finding, side: int) -> dict[str, dict[str, float]]:
    """Return the gain and the asymmetry with which the other side would be as the tractor file has it.

    The asymmetry is a further factor on the left side alone.
    """
    assert finding.value is not None
    ratio = finding.value["ratio"]
    if side == RIGHT:
        return {GAIN: {"ratio": ratio}, ASYMMETRY: {"ratio": 1.0 / ratio}}
    return {GAIN: {"ratio": 1.0}, ASYMMETRY: {"ratio": ratio}}


def _describe_one_side(finding: Finding, side: int) -> Finding:
    here, there = ("right", "left") if side == RIGHT else ("left", "right")
    other = compute_other_side(finding, side)
    gain = f" and a {GAIN} of 1" if side != RIGHT else ""
    words = (
        f"all bends of these logs are to the {here}, so it is not known to the {there}; with a {ASYMMETRY} of "
        f"{other[ASYMMETRY]['ratio']:.3g}{gain} these logs would be the same"
    )
    return finding.add_exchange(words)


def describe_offset_at_work(findings: Sequence[Finding], wheelbase_m: float) -> list[Finding]:
    """Return the findings, with the extra wheel angle that a side draft looks like while the implement works."""
    return [_compare_with_offset(one, wheelbase_m) if one.id == SIDE_DRAFT and one.value else one for one in findings]


def _compare_with_offset(finding: Finding, wheelbase_m: float) -> Finding:
    assert finding.value is not None
    angle_deg = math.degrees(math.atan(finding.value["curvature_per_m"] * wheelbase_m))
    side = "right" if angle_deg > 0.0 else "left"
    words = (
        f"a steering_offset of {abs(angle_deg):.1f} deg to the {side} that acts only while the implement works would "
        "look nearly the same"
    )
    return finding.add_exchange(words)


def _remove_value(finding: Finding) -> Finding:
    return replace(
        finding, status=NOT_VISIBLE, value=None, interval=None, gain_pct=None, gain_interval=None, description=""
    )


def _withdraw_constant(finding: Finding, found: FoundLaw | None, tractor: Tractor) -> Finding:
    """Return a name as likely where a law that the data support, and that explains too little, changes it by as much
    as the value itself; say of other names that they were tested and are constant."""
    if finding.status != NAMED or finding.value is None:
        return finding
    size = get_effect(finding.id).size.name
    deviation = abs(finding.value[size] - get_neutral_values(finding.id, tractor.steering)[size])
    if found is None or found.high - found.low < WITHDRAWING_LAW_SHARE * deviation:
        constant = ParameterLaw(CONSTANT_LAW, {"value": finding.value[size]}, "")
        return replace(finding, law=constant)
    return replace(finding, status=LIKELY)
