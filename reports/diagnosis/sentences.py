"""The sentences of a diagnosis, for the terminal and the page, and what it says of the logs themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

from reports.common.wording import (
    NO_VALUE,
    capitalize_first,
    format_effect_with_id,
    format_number,
    get_effect_label,
    join_list,
    replace_effect_ids,
)
from vehicle.identification.diagnosis.results import (
    ABOVE_FLOOR_FACTOR,
    EQUIVALENT,
    LIKELY,
    LIKELY_OF,
    LIKELY_RIGHT,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
    Diagnosis,
    ErrorsByHorizon,
    Finding,
    HoldoutResult,
    HoldoutRun,
    RunCheck,
)
from vehicle.model.discrepancy_model import TERMS_BY_NAME
from vehicle.model.effects import get_effect
from vehicle.model.tractor import DiscrepancyModel

MOST_RUNS = 8
SHOWN_HORIZON_S = 5.0
_TIMING_WORDS = (
    ("delay_s", "{:.2g} s late"),
    ("hold_s", "new every {:.2g} s"),
    ("filter_s", "low-passed by {:.2g} s"),
    ("clock_offset_s", "stamped {:+.2g} s by another clock"),
)
LIKELY_MEANS = (
    "Likely: clearly not neutral and helpful to runs not used for fitting, but another cause is not excluded."
)
STATUS_ORDER = (NAMED, EQUIVALENT, LIKELY, REFUTED, NOT_VISIBLE)
SMALLEST_VISIBLE = (
    "Smallest visible: the smallest change of the value in the tractor file that these logs would have shown; for a "
    "limit, the highest value. Refuted effects are refuted from that size on."
)


@dataclass(frozen=True)
class ErrorKind:
    """A kind of error: its attribute, heading and unit, where it lies in words, the unit that says so, decimals."""

    key: str
    heading: str
    unit: str
    place: str
    full_unit: str
    decimals: int

    def format(self, value: float) -> str:
        """A figure of this kind, without its unit."""
        return format_number(value, self.decimals)


ALONG = ErrorKind("along_cm", "Along", "cm", "along", "cm along", 1)
ERROR_KINDS = (
    ErrorKind("cross_cm", "Across", "cm", "across", "cm across", 1),
    ALONG,
    ErrorKind("heading_deg", "Heading", "deg", "in heading", "degrees", 2),
)


def format_errors(errors: ErrorsByHorizon, horizon_s: float) -> list[str]:
    """The errors over a horizon in the order of `ERROR_KINDS`."""
    return [kind.format(getattr(errors[horizon_s], kind.key)) for kind in ERROR_KINDS]


def list_error_rows(*errors: ErrorsByHorizon, by_kind: bool = False) -> list[tuple[str, ...]]:
    """A row per length of the pieces: the length, then `errors` one after another, or `by_kind` side by side."""
    rows = []
    for horizon in errors[0]:
        groups: list[Iterable[str]] = [format_errors(each, horizon) for each in errors]
        groups = list(zip(*groups, strict=True)) if by_kind else groups
        rows.append((f"{horizon:g} s", *chain.from_iterable(groups)))
    return rows


def end_sentence(text: str) -> str:
    """Text as a sentence: a capital first and one full stop, with labels of effects in place of ids."""
    return f"{capitalize_first(replace_effect_ids(text).rstrip('.'))}." if text else ""


def describe_columns(diagnosis: Diagnosis) -> list[str]:
    """One sentence per column that is late, held, low-passed or stamped by another clock, with sizes.

    What the verdict says already is left out.
    """
    repeated = [finding.sentence for finding in diagnosis.findings if finding.sentence in diagnosis.causes_sentence]
    sentences = []
    for column in diagnosis.columns:
        parts = [text.format(value) for name, text in _TIMING_WORDS if (value := getattr(column, name))]
        if column.stale_share:
            parts.append(f"{format_percentage(column.stale_share)} of its rows repeat an older value")
        words = column.words or f"{column.column.replace('_', ' ')}: {', '.join(parts)}"
        for sentence in repeated:
            words = words.replace(sentence, "").strip()
        sentences += [end_sentence(words)] if words else []
    return sentences


def format_percentage(share: float | None) -> str:
    """A share in percent; a dash without one."""
    return NO_VALUE if share is None else f"{100.0 * share:.0f} %"


def list_column_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """A row per column of the logs: delay, hold, filter and clock in s, and the share of stale rows."""
    return [
        (
            column.column.replace("_", " "),
            *(format_number(getattr(column, name), 2) for name, _ in _TIMING_WORDS),
            format_percentage(column.stale_share),
        )
        for column in diagnosis.columns
    ]


def describe_hints(diagnosis: Diagnosis) -> list[str]:
    """Where to look for what no known cause explains, without what the verdict says already."""
    verdict_clauses = [clause for clause in diagnosis.depends_on if clause in diagnosis.causes_sentence]
    return [
        end_sentence(hint.words)
        for hint in diagnosis.hints
        if not any(clause in hint.words for clause in verdict_clauses) and hint.words not in diagnosis.causes_sentence
    ]


def sort_runs(diagnosis: Diagnosis) -> list[RunCheck]:
    """The runs, those unlike the others first, then the worst after the diagnosis."""
    return sorted(diagnosis.runs, key=lambda run: (not run.unlike, -(run.error_after_cm or 0.0)))


def describe_unlike_runs(diagnosis: Diagnosis) -> list[str]:
    """One sentence per run that is unlike the others."""
    sentences = []
    for run in sort_runs(diagnosis):
        if run.unlike:
            words = run.words or "unlike the other runs"
            sentences.append(end_sentence(words) if run.name in words else f"{run.name}: {words.rstrip('.')}.")
    return sentences


def format_held_out_errors(
    diagnosis: Diagnosis, runs: HoldoutResult | HoldoutRun, horizon_s: float, decimals: int
) -> list[str]:
    """The error before and after over a horizon, across and along together, in cm; a dash where there is none.

    It is that across only where that along the path is not judged.
    """
    found = [errors.get(horizon_s) for errors in (runs.before, runs.after)]
    along = [one.along_cm if one is not None and diagnosis.along_judged else 0.0 for one in found]
    cm = [None if one is None else math.hypot(one.cross_cm, more) for one, more in zip(found, along, strict=True)]
    return [format_number(value, decimals) for value in cm]


def find_shown_horizon_s(holdout: HoldoutResult) -> float | None:
    """The length of the pieces that a verdict is about, else the longest; None where no piece was long enough."""
    if SHOWN_HORIZON_S in holdout.before:
        return SHOWN_HORIZON_S
    return max(holdout.before, default=None)


def describe_holdout(diagnosis: Diagnosis) -> list[str]:
    """Which runs were held out, and whether what was found helps there; empty without such runs."""
    holdout = diagnosis.holdout
    if holdout is None:
        return []
    horizon = find_shown_horizon_s(holdout)
    if horizon is None:
        return [holdout.words, "They hold no piece that is long enough for an error."]
    old, new = format_held_out_errors(diagnosis, holdout, horizon, 2)
    verdict = "it helps there" if holdout.helps else "it does not help there"
    change = "nothing was added" if holdout.is_unchanged else f"{old} cm before, {new} cm after: {verdict}"
    return [holdout.words, f"Error on runs held out over pieces of {horizon:g} s: {change}."]


def list_holdout_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """A row per run held out: its name, and its distance error before and after."""
    holdout = diagnosis.holdout
    horizon = None if holdout is None else find_shown_horizon_s(holdout)
    if holdout is None or horizon is None:
        return []
    return [(run.name, *format_held_out_errors(diagnosis, run, horizon, 1)) for run in holdout.by_run]


def describe_unsaved(diagnosis: Diagnosis) -> str:
    """Why the extended tractor is not to be saved; empty where it may be."""
    if diagnosis.is_savable:
        return ""
    if diagnosis.unsaved_reason:
        return end_sentence(diagnosis.unsaved_reason)
    return "What was found does not lower the error on runs held out, so no tractor file is saved."


def describe_unsaved_finds(diagnosis: Diagnosis) -> str:
    """Why what was found is not to be saved; empty where it may be, and where nothing was found that could be."""
    is_found = any(finding.status in (NAMED, EQUIVALENT, LIKELY) for finding in diagnosis.findings)
    is_requested = diagnosis.holdout is not None and diagnosis.holdout.is_requested
    if is_found or is_requested or diagnosis.depends_on or diagnosis.undiagnosed_reason:
        return describe_unsaved(diagnosis)
    return ""


def explain_likely_verdict() -> str:
    """Explain what likely means, and how often it was right in tests."""
    return f"{LIKELY_MEANS} In tests {LIKELY_RIGHT} of {LIKELY_OF} likely effects were true causes."


def describe_status(finding: Finding) -> str:
    """Return the status for a reader, with the size from which an effect is refuted (a limit: up to which)."""
    if finding.status != REFUTED or finding.smallest_visible is None:
        return finding.status
    bound = "to" if get_effect(finding.id).kind.size_word else "from"
    return f"{finding.status} {bound} {finding.smallest_visible:.2g} {finding.unit}".strip()


def sort_findings(findings: Iterable[Finding]) -> list[Finding]:
    """Sort findings by status, in the order of STATUS_ORDER."""
    return sorted(findings, key=lambda one: STATUS_ORDER.index(one.status))


def format_count(count: int, noun: str) -> str:
    """Format a count with its noun: ``1 run``, ``2 runs``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def format_effect_estimate(finding: Finding) -> str:
    """Format the value with its interval; empty without a value."""
    if finding.value is None:
        return ""
    name = next(iter(finding.value))
    text = _format_figure(finding.value[name])
    if finding.interval and name in finding.interval:
        low, high = finding.interval[name]
        text += f" ({_format_figure(low)} to {_format_figure(high)})"
    return f"{text} {finding.unit}".strip()


def _format_figure(value: float) -> str:
    return "no limit" if math.isinf(value) else f"{value:.3g}"


def format_smallest_visible(finding: Finding) -> str:
    """Format the smallest visible size."""
    if finding.smallest_visible is None:
        return "none"
    return f"{get_effect(finding.id).kind.size_word}{finding.smallest_visible:.2g} {finding.unit}".strip()


def format_gain_pct(finding: Finding) -> str:
    """Format the gain in percent; empty without one."""
    return "" if finding.gain_pct is None else format_number(finding.gain_pct, 0)


def describe_log_size(diagnosis: Diagnosis) -> str:
    """Describe how much was driven, read and left out, with the commonest reason: ``12 left out (10: in neutral)``."""
    left_out, reasons = f"{diagnosis.rows_gated} left out", diagnosis.rows_gated_by_reason
    if reasons:
        rule = max(reasons, key=lambda one: reasons[one])
        left_out += f" ({reasons[rule]}: {rule})" if len(reasons) > 1 else f" ({rule})"
    return (
        f"{format_count(len(diagnosis.names), 'run')}, {diagnosis.minutes:.1f} minutes, "
        f"{format_count(diagnosis.rows_used, 'row')} used, {left_out}"
    )


def name_held_out_data(diagnosis: Diagnosis) -> str:
    """Name the data on which errors and gains are measured."""
    return "windows of 20 s" if len(diagnosis.names) == 1 else "runs"


def describe_next_drive(diagnosis: Diagnosis) -> str:
    """Describe the drive that would settle a doubt; empty without one."""
    drive = diagnosis.next_drive
    if drive is None:
        return ""
    doubt = "" if drive.decides else " No known drive separates them better, but it may not be enough."
    alternatives = join_list(map(get_effect_label, drive.separates))
    length = format_count(round(drive.seconds), "second")
    return f"To distinguish {alternatives}: {drive.description} That takes {length}.{doubt}"


def list_discrepancy_terms(discrepancy: DiscrepancyModel) -> list[str]:
    """List the terms of a discrepancy model with amounts and 95 % intervals, one clause each; both parts of a direction
    in one."""
    parts_by_term: dict[str, list[str]] = {}
    for name, amount in discrepancy.amounts.items():
        term, side = TERMS_BY_NAME[name], name.rpartition("_to_")[2] if "_to_" in name else ""
        text = f"{amount:.3g}"
        if name in discrepancy.interval:
            low, high = discrepancy.interval[name]
            text += f" ({low:.3g} to {high:.3g})"
        clause = " ".join(part for part in (text, term.unit, f"towards {side}" if side else "") if part)
        parts_by_term.setdefault(f"{term.effect} that depends on {term.regressor}", []).append(clause)
    return [f"{what}: {join_list(parts)}" for what, parts in parts_by_term.items()]


def describe_trusted_range(discrepancy: DiscrepancyModel) -> str:
    """Describe where a discrepancy model is trusted, and how to switch it off."""
    (slow, fast), (leftmost, rightmost) = discrepancy.speed_mps, discrepancy.angle_deg
    where = (
        f"where these logs were driven: {slow:.2g} to {fast:.2g} m/s and wheel angles of {leftmost:.1f} to "
        f"{rightmost:.1f} degrees "
        "(positive right)"
    )
    trusted = f"so it is used only {where}, and fades out within a tenth of these ranges beyond them."
    return (
        f'It is fitted to data and names no cause, {trusted} The line "on = false" under [discrepancy_model] in the '
        f"tractor file switches it off.{'' if discrepancy.on else ' It is off.'}"
    )


def describe_confusable_effects(diagnosis: Diagnosis) -> list[str]:
    """Describe what looks alike in these logs, one sentence per effect of the model."""
    findings = [one for one in diagnosis.findings if one.exchange and one.interval]
    return [f"{capitalize_first(get_effect_label(one.id))}: {replace_effect_ids(one.exchange)}." for one in findings]


def describe_remaining_error(diagnosis: Diagnosis) -> list[str]:
    """Describe the remaining error: its size against the noise, its effect on a plan, what it depends on."""
    if diagnosis.undiagnosed_reason:
        return ["No error was measured."]
    lines = [_compare_with_noise(diagnosis)]
    if not diagnosis.along_judged:
        lines.append("The error along the path is not judged, because not every log has a measured speed.")
    if diagnosis.is_noise_only:
        return lines
    if diagnosis.unexplained_share == 0.0:
        return [*lines, *_describe_remaining_in_plan(diagnosis)]
    hinted = dict.fromkeys(hint.depends_on for hint in diagnosis.hints if hint.depends_on)
    depends = "; ".join(diagnosis.depends_on or hinted) or "none of the quantities examined"
    return [*lines, *_describe_remaining_in_plan(diagnosis), f"It depends on: {depends}."]


def _compare_with_noise(diagnosis: Diagnosis) -> str:
    """Compare the remaining error with noise alone, over pieces of 5 s or the shortest there are."""
    text, exceeding = "The remaining error", ""
    if diagnosis.after:
        over_s = SHOWN_HORIZON_S if SHOWN_HORIZON_S in diagnosis.after else min(diagnosis.after)
        parts, clearly_more = [], []
        for kind in ERROR_KINDS:
            if kind is ALONG and not diagnosis.along_judged:
                continue
            after, noise = (getattr(each[over_s], kind.key) for each in (diagnosis.after, diagnosis.noise_floor))
            if math.isfinite(after):
                parts.append(f"{kind.format(after)} {kind.full_unit} (noise {kind.format(noise)})")
            clearly_more += [kind.place] if after > ABOVE_FLOOR_FACTOR * noise else []
        text = f"The remaining error over pieces of {over_s:g} s, {', '.join(parts)},"
        exceeding = join_list(clearly_more) if clearly_more else ""
    if diagnosis.is_noise_only:
        within = f"is above the noise {exceeding}, but not in all together" if exceeding else "is no more than noise"
        return f"{text} {within}."
    if diagnosis.unexplained_share != 0.0:
        share = 100.0 * diagnosis.unexplained_share
        amount = f"{share:.0f} %" if share >= 0.5 else "less than 1 %"
        return f"{text} is above the noise: no effect explains {amount} of the error beyond it."
    # Nothing is unexplained over 5 s, but not every length is within the noise.
    pieces = f"over pieces of {join_list([f'{one:g}' for one in diagnosis.above_noise_s])} s"
    if SHOWN_HORIZON_S in diagnosis.above_noise_s:
        return f"{text} is hardly above the noise {pieces}."
    if exceeding:
        return f"{text} is above the noise {exceeding}, but in all together only {pieces}."
    return f"{text} is no more than noise, but above it {pieces}."


def _describe_remaining_in_plan(diagnosis: Diagnosis) -> list[str]:
    """Express the remaining error in seconds and centimetres: of the simulated plan, else of the longest pieces."""
    plan, remaining = diagnosis.plan, diagnosis.residual_error
    if plan is not None and plan.discrepancy_cm is not None:
        time = "" if plan.discrepancy_s is None else f"{plan.discrepancy_s:+.0f} s and "
        comes = f"{time}{plan.discrepancy_cm:+.1f} cm off the tracks"
        return [f"In the plan below, the discrepancy model fitted to it changes the result by {comes}."]
    if remaining is None:
        return []
    late = f"{format_number(remaining.late_s, 1)} s early or late and " if diagnosis.along_judged else ""
    aside = f"{format_number(remaining.aside_cm, 1)} cm to the side without steering correction"
    return [f"In a plan, within {remaining.over_s:g} s, that is {late}{aside}."]


def describe_saved_effects(diagnosis: Diagnosis) -> str:
    """List what the extended tractor file holds; empty when it has no effect and no discrepancy model."""
    findings = {finding.id: finding for finding in diagnosis.findings}
    parts = []
    for name, setting in diagnosis.tractor.effects.items():
        finding = findings.get(name)
        if finding is None or finding.value is None:
            parts.append(f"{format_effect_with_id(name)}, unchanged")
        elif setting.equivalent_to:
            parts.append(
                f"{format_effect_with_id(name)}, or {join_list(map(get_effect_label, setting.equivalent_to), 'or')} "
                "in its place"
            )
        else:
            parts.append(format_effect_with_id(name) if setting.named else f"{format_effect_with_id(name)}, {LIKELY}")
    parts += ["a discrepancy model"] if diagnosis.tractor.discrepancy_model else []
    return f"The tractor file gets: {'; '.join(parts)}." if parts else ""


def describe_plan_change(diagnosis: Diagnosis) -> list[str]:
    """Describe what the tractor file gets and how a plan changes; or why nothing is saved."""
    unsaved = describe_unsaved_finds(diagnosis)
    saved = describe_saved_effects(diagnosis) if diagnosis.is_savable else ""
    if unsaved:
        return [unsaved]
    if not saved and (diagnosis.plan is None or not diagnosis.is_savable):
        return ["Nothing was added to the tractor, so plans do not change."]
    first = [saved or "The effects in the tractor file are removed."]
    if diagnosis.plan is None:
        return first
    unsure = [name for name, one in diagnosis.tractor.effects.items() if one.equivalent_to]
    doubt = [f"That holds if it is {join_list(map(get_effect_label, unsure))}."] if unsure else []
    plan = diagnosis.plan
    by_file = _format_drive_result(plan.time_before_s, plan.lateral_before_cm)
    by_logs = _format_drive_result(plan.time_after_s, plan.lateral_after_cm)
    return [
        *first,
        f"A plan for one tractor on the field {plan.field}, made with the old file. Simulated with the old file: "
        f"{by_file}. Simulated as these logs say the tractor drives: {by_logs}.",
        "The second is what to expect on the field; planning with the new file takes it into account.",
        *doubt,
    ]


def _format_drive_result(seconds: float | None, lateral_cm: float) -> str:
    time = "not finished" if seconds is None else f"{seconds / 60.0:.1f} min"
    return f"{time}, {format_number(lateral_cm, 1)} cm off the tracks (root mean square)"
