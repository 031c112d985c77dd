"""What a diagnosis says of the logs themselves: columns that are late, runs, rows left out, and runs held out."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import chain

from reports.common.wording import NO_VALUE, capitalize_first, format_number, replace_effect_ids
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    ColumnTiming,
    Diagnosis,
    ErrorsByHorizon,
    HoldoutResult,
    HoldoutRun,
    RunCheck,
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
MOST_RUNS = 8
SHOWN_HORIZON_S = 5.0
_TIMING_WORDS = (
    ("delay_s", "{:.2g} s late"),
    ("hold_s", "new every {:.2g} s"),
    ("filter_s", "low-passed by {:.2g} s"),
    ("clock_offset_s", "stamped {:+.2g} s by another clock"),
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
        words = column.words or _describe_timing(column)
        for sentence in repeated:
            words = words.replace(sentence, "").strip()
        sentences += [end_sentence(words)] if words else []
    return sentences


def _describe_timing(column: ColumnTiming) -> str:
    parts = [text.format(value) for name, text in _TIMING_WORDS if (value := getattr(column, name))]
    stale = f"{format_percentage(column.stale_share)} of its rows repeat an older value" if column.stale_share else ""
    return f"{column.column.replace('_', ' ')}: {', '.join([*parts, *([stale] if stale else [])])}"


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
    pairs = [one and (one.cross_cm, one.along_cm if diagnosis.along_judged else 0.0) for one in found]
    return [NO_VALUE if pair is None else format_number(math.hypot(*pair), decimals) for pair in pairs]


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


def describe_rows_left_out(diagnosis: Diagnosis) -> str:
    """The count of rows left out with the reason for most of them: ``12 left out (10: shuttle in neutral)``."""
    left_out = f"{diagnosis.rows_gated} left out"
    reasons = diagnosis.rows_gated_by_reason
    if not reasons:
        return left_out
    rule = max(reasons, key=lambda one: reasons[one])
    return f"{left_out} ({reasons[rule]}: {rule})" if len(reasons) > 1 else f"{left_out} ({rule})"
