"""What a diagnosis says in words, for the terminal and the page alike."""

from __future__ import annotations

import math
from collections.abc import Iterable

from reports.effect_words import both, capital, label, spelled
from reports.wording import listed, number
from vehicle.effects import effect
from vehicle.measured.answer.record import LIKELY_OF, LIKELY_RIGHT
from vehicle.measured.answer.verdict import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
    Diagnosis,
    Finding,
    PlanGain,
)
from vehicle.rest import BY_NAME
from vehicle.tractor import Rest

LIKELY_MEANS = (
    "Likely: it is clearly not neutral and helps runs not used for fitting, but another cause or what is left is not "
    "excluded."
)
PLACES = ("first", "second")
SHOWN_S = 5.0
ALONG = "along_cm"
LEFT_KINDS = (("cross_cm", "cm across", 1), (ALONG, "cm along", 1), ("heading_deg", "degrees", 2))
ORDER = (NAMED, EQUIVALENT, LIKELY, REFUTED, NOT_VISIBLE)
SMALLEST_VISIBLE = (
    "Smallest visible: the smallest deviation from the tractor file that these logs would have shown, as a change of "
    "the value; of a limit the highest that they would have shown. What is refuted is refuted from that size on."
)


def likely_words(right: int = LIKELY_RIGHT, of: int = LIKELY_OF) -> str:
    """What likely means, and how often it was right where that was measured."""
    told = "How often it is right is not known."
    if of:
        told = f"Of {of} called so in the tests' own logs {right} were right."
    return f"{LIKELY_MEANS} {told}"


def is_calibration(one: Finding) -> bool:
    """Whether an effect is in the model without being shown to be a cause."""
    return one.status == LIKELY


def status_words(one: Finding) -> str:
    """Status for a reader; what is refuted, from which size on, a limit up to which."""
    if one.status != REFUTED or one.smallest_visible is None:
        return one.status
    bound = "to" if effect(one.id).kind.size_word else "from"
    return f"{one.status} {bound} {one.smallest_visible:.2g} {one.unit}".strip()


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Findings by status, as `ORDER` has it."""
    return sorted(findings, key=lambda one: ORDER.index(one.status))


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


def left_words(diagnosis: Diagnosis) -> list[str]:
    """What is left, in sentences: how large against the noise, what it changes in a plan, what it depends on."""
    lines = [f"{_against_noise(diagnosis)}{_share_words(diagnosis)}"]
    if not diagnosis.along_judged:
        lines.append("The way along is not judged, because not every log has a measured speed.")
    if diagnosis.as_good_as_noise:
        return lines
    if diagnosis.unexplained_share == 0.0:
        return [*lines, *_left_in_plan(diagnosis)]
    depends = "; ".join(diagnosis.depends_on) or "nothing that was looked for"
    return [*lines, *_left_in_plan(diagnosis), f"It depends on: {depends}."]


def _against_noise(diagnosis: Diagnosis) -> str:
    """The errors left over pieces of 5 s (or of the shortest length there is) beside those of noise alone."""
    if not diagnosis.after:
        return "What is left"
    over = SHOWN_S if SHOWN_S in diagnosis.after else min(diagnosis.after)
    after, floor = diagnosis.after[over], diagnosis.floor[over]
    parts = [
        f"{number(getattr(after, key), digits)} {unit} (noise {number(getattr(floor, key), digits)})"
        for key, unit, digits in LEFT_KINDS
        if math.isfinite(getattr(after, key)) and (diagnosis.along_judged or key != ALONG)
    ]  # fmt: skip
    return f"What is left over pieces of {over:g} s, {', '.join(parts)},"


def _share_words(diagnosis: Diagnosis) -> str:
    if diagnosis.as_good_as_noise:
        return " is as good as the noise."
    if diagnosis.unexplained_share == 0.0:
        return f" is {_over_others(diagnosis)}."
    share = 100.0 * diagnosis.unexplained_share
    much = f"{share:.0f} %" if share >= 0.5 else "less than 1 %"
    return f" is above the noise: no effect explains {much} of what was wrong beyond it."


def _over_others(diagnosis: Diagnosis) -> str:
    """How what is left stands to the noise where no share of it is left to explain, but not every horizon is at it."""
    above = diagnosis.above_noise_s
    pieces = f"over pieces of {listed([f'{one:g}' for one in above])} s"
    return f"hardly above the noise {pieces}" if SHOWN_S in above else f"as good as the noise, and above it {pieces}"


def _left_in_plan(diagnosis: Diagnosis) -> list[str]:
    """What is left as seconds and centimetres: of the plan that was driven, else of the longest pieces."""
    plan, left = diagnosis.plan, diagnosis.left
    if plan is not None and plan.left_cm is not None:
        time = "" if plan.left_s is None else f"{plan.left_s:+.0f} s and "
        comes = f"{time}{plan.left_cm:+.1f} cm off the tracks"
        return [f"In the plan below, the rest that was fitted to it comes to {comes}."]
    if left is None:
        return []
    late = f"{number(left.late_s, 1)} s early or late and " if diagnosis.along_judged else ""
    aside = f"{number(left.aside_cm, 1)} cm aside while nobody steers back"
    return [f"In a plan, within {left.over_s:g} s, that is {late}{aside}."]


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
            parts.append(both(name) if setting.named else f"{both(name)}, {LIKELY}")
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
