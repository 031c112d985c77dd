"""What a diagnosis says in words, for the terminal and the page alike."""

from __future__ import annotations

import math
from collections.abc import Iterable

from reports.effect_words import both, capital, label, spelled
from reports.wording import listed, number
from vehicle.effects import effect
from vehicle.measured.answer.verdict import EQUIVALENT, NAMED, NOT_VISIBLE, REFUTED, Diagnosis, Finding, PlanGain
from vehicle.rest import BY_NAME
from vehicle.tractor import Rest

FITTED = "fitted, no name"
PLACES = ("first", "second")
ORDER = (NAMED, EQUIVALENT, FITTED, REFUTED, NOT_VISIBLE)
SMALLEST_VISIBLE = (
    "Smallest visible: the smallest deviation from the tractor file that these logs would have shown, as a change of "
    "the value; of a limit the highest that they would have shown."
)


def is_calibration(one: Finding) -> bool:
    """Whether an effect is in the model without being shown to be a cause."""
    return one.status == NOT_VISIBLE and one.value is not None


def status_words(one: Finding) -> str:
    """Status for a reader: one of `ORDER`."""
    return FITTED if is_calibration(one) else one.status


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Findings by status, as `ORDER` has it."""
    return sorted(findings, key=lambda one: ORDER.index(status_words(one)))


def counted(count: int, noun: str) -> str:
    """``1 run``, ``2 runs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def value_text(one: Finding) -> str:
    """Value of the size with its interval, or nothing."""
    if one.value is None:
        return ""
    name = next(iter(one.value))
    text = _figure(one.value[name])
    if one.interval and name in one.interval:
        low, high = one.interval[name]
        text += f" ({_figure(low)} to {_figure(high)})"
    return f"{text} {one.unit}".strip()


def _figure(value: float) -> str:
    return "no limit" if math.isinf(value) else f"{value:.3g}"


def visible_text(one: Finding) -> str:
    """Smallest visible size."""
    if one.smallest_visible is None:
        return "none"
    return f"{effect(one.id).kind.size_word}{one.smallest_visible:.2g} {one.unit}".strip()


def gain_text(one: Finding) -> str:
    """Gain in percent, or nothing."""
    return "" if one.gain_pct is None else number(one.gain_pct, 0)


def size_words(diagnosis: Diagnosis) -> str:
    """How much was driven and read."""
    return (
        f"{counted(len(diagnosis.names), 'run')}, {diagnosis.minutes:.1f} minutes, "
        f"{counted(diagnosis.rows_used, 'row')} used, {diagnosis.rows_gated} left out"
    )


def held_out_words(diagnosis: Diagnosis) -> str:
    """The data that errors and gains are measured on."""
    return "windows of 20 s" if len(diagnosis.names) == 1 else "runs"


def ground_words(diagnosis: Diagnosis) -> list[str]:
    """Sentences per effect that runs had at two levels: the runs that show each, and which the tractor file gets."""
    found = []
    for name in dict.fromkeys(one.id for one in diagnosis.grounds):
        levels = [one for one in diagnosis.grounds if one.id == name]
        told = {run for one in levels for run in one.runs}
        parts = [f"These runs were made on two grounds ({label(name)})."]
        elsewhere = "Elsewhere" if told else "On some runs"
        parts += [f"{f'On {listed(one.runs)}' if one.runs else elsewhere}: {one.words}" for one in levels]
        if told and told < set(diagnosis.names):
            parts.append("The other runs do not clearly show which.")
        setting = diagnosis.tractor.effects.get(name)
        kept = [place for place, one in zip(PLACES, levels, strict=False) if setting and one.value == setting.value]
        parts += [f"The tractor file gets the {kept[0]}."] if kept else []
        found.append(" ".join(parts))
    return found


def rest_terms(rest: Rest) -> list[str]:
    """The terms of a rest with amounts and 95 % intervals, a clause each; both parts of a direction in one."""
    found: dict[str, list[str]] = {}
    for name, amount in rest.amounts.items():
        term, side = BY_NAME[name], name.rpartition("_to_")[2] if "_to_" in name else ""
        text = f"{amount:.3g}"
        if name in rest.interval:
            low, high = rest.interval[name]
            text += f" ({low:.3g} to {high:.3g})"
        words = " ".join(word for word in (text, term.unit, f"towards {side}" if side else "") if word)
        found.setdefault(f"{term.changes} that depends on {term.on}", []).append(words)
    return [f"{what}: {listed(parts)}" for what, parts in found.items()]


def rest_words(rest: Rest) -> str:
    """Where a rest is trusted, and how it is switched off."""
    (slow, fast), (left, right) = rest.speed_mps, rest.angle_deg
    where = (
        f"where these logs were: at {slow:.2g} to {fast:.2g} m/s and wheel angles of {left:.1f} to {right:.1f} degrees "
        "(positive right)"
    )
    trusted = f"so it is trusted only {where}, and fades to nothing within a tenth of these ranges beyond them."
    return (
        f"It is told from data and names no cause, {trusted} The line \"on = false\" under [rest] in the tractor file "
        f"switches it off.{'' if rest.on else ' It is off.'}"
    )


def exchange_words(diagnosis: Diagnosis) -> list[str]:
    """What looks alike in these logs, a sentence per effect of the model."""
    alike = [one for one in diagnosis.findings if one.exchange and one.interval]
    return [f"{capital(label(one.id))}: {spelled(one.exchange)}." for one in alike]


def unexplained_words(diagnosis: Diagnosis) -> str:
    """What has no name, and what it depends on."""
    share, depends = 100.0 * diagnosis.unexplained_share, "; ".join(diagnosis.depends_on)
    large = share >= 0.5
    if not depends:
        if not large:
            return "Nothing is left that depends on anything these logs hold."
        return (
            f"{share:.0f} % of what is wrong beyond the noise has no name, and it depends on nothing that was looked "
            "for."
        )
    much = f"{share:.0f} %" if large else "Less than 1 %"
    return f"{much} of what is wrong beyond the noise has no name. The logs show there: {depends}."


def saved_words(diagnosis: Diagnosis) -> str:
    """What the extended tractor file holds; nothing when it holds no effect and no rest."""
    told = {one.id: one for one in diagnosis.findings}
    parts = []
    for name, setting in diagnosis.tractor.effects.items():
        one = told.get(name)
        if one is None or one.value is None:
            parts.append(f"{both(name)}, kept as it was")
        elif setting.equivalent_to:
            parts.append(f"{both(name)}, or {listed(map(label, setting.equivalent_to), 'or')} in its place")
        else:
            parts.append(both(name) if setting.named else f"{both(name)}, {FITTED}")
    parts += ["a rest"] if diagnosis.tractor.rest else []
    return f"The tractor file gets: {'; '.join(parts)}." if parts else ""


def plan_words(diagnosis: Diagnosis) -> list[str]:
    """What the tractor file gets and what that changes in a plan, in sentences."""
    saved = saved_words(diagnosis)
    if not saved and diagnosis.plan is None:
        return ["Nothing was added to the tractor, so plans stay as they are."]
    first = [saved or "The tractor file loses the effects it had."]
    if diagnosis.plan is None:
        return first
    unsure = [name for name, one in diagnosis.tractor.effects.items() if one.equivalent_to]
    doubt = [f"That holds if it is {listed(map(label, unsure))}."] if unsure else []
    return [*first, *_driven_words(diagnosis.plan), *doubt]


def _driven_words(plan: PlanGain) -> list[str]:
    by_file = _drive_words(plan.time_before_s, plan.lateral_before_cm)
    by_logs = _drive_words(plan.time_after_s, plan.lateral_after_cm)
    return [
        f"A plan for one tractor on the field {plan.field}, made with the file as it was. Simulated by that file: "
        f"{by_file}. As these logs say the tractor drives: {by_logs}.",
        "The second is what that plan would come to on the field; planning with the new file counts on it.",
    ]


def _drive_words(seconds: float | None, lateral_cm: float) -> str:
    time = "it is not finished" if seconds is None else f"{seconds / 60.0:.1f} min"
    return f"{time}, {number(lateral_cm, 1)} cm off the tracks (root mean square)"
