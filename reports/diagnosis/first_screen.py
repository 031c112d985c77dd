"""The first screen of a diagnosis for a terminal: the verdict, the errors, what was found, and where to read more."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reports.common.effect_names import get_effect_label
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.wording import format_number
from reports.diagnosis.log_checks import SHOWN_HORIZON_S, describe_unsaved_finds, sort_runs
from reports.diagnosis.sentences import (
    describe_next_drive,
    describe_remaining_error,
    describe_saved_effects,
    format_count,
    format_effect_estimate,
    format_gain_pct,
    name_held_out_data,
    sort_findings,
)
from reports.diagnosis.tables import build_error_table, build_holdout_parts, build_verdict_lines
from vehicle.identification.diagnosis.results import EQUIVALENT, NAMED, NOT_VISIBLE, REFUTED, Diagnosis

if TYPE_CHECKING:
    from rich.console import Group

MOST_EFFECTS, MOST_LISTED_RUNS = 6, 3
MORE_HINT = "Add --explain (every effect, every run, how to read it), --html report.html (pictures)."
_EFFECT_COLUMNS = (
    TableColumn("Effect", is_text=True),
    TableColumn("Status", is_text=True, is_unbroken=True),
    TableColumn("Value (95 %)", is_text=True),
    TableColumn("Gain %", drop_order=1),
)


def build_diagnosis_screen(diagnosis: Diagnosis) -> Group:
    """Build the verdict, the errors by length of the pieces, the effects that were found, and what remains."""
    from rich.console import Group
    from rich.text import Text

    parts: list[object] = list(build_verdict_lines(diagnosis))
    if diagnosis.undiagnosed_reason:
        return Group(*parts, format_sentence(MORE_HINT, style="dim"))  # type: ignore[arg-type]
    if diagnosis.holdout is None or not diagnosis.holdout.is_requested:
        data = name_held_out_data(diagnosis)
        title = f"Error on {data} not used for fitting, by length of the pieces (cm, cm, degrees)"
        parts += [Text(""), format_sentence(title, style="italic"), build_error_table(diagnosis)]
    else:
        parts += build_holdout_parts(diagnosis, by_run=False)
    parts += [Text(""), *_list_effect_parts(diagnosis)]
    parts += [format_sentence(line) for line in _list_last_sentences(diagnosis)]
    parts.append(format_sentence(MORE_HINT, style="dim"))
    return Group(*parts)  # type: ignore[arg-type]


def _list_effect_parts(diagnosis: Diagnosis) -> list[object]:
    """The effects with a value, and how many others there are."""
    findings = sort_findings(diagnosis.findings)
    found = [one for one in findings if one.value is not None or one.status in (NAMED, EQUIVALENT)]
    rows = [
        (get_effect_label(one.id), one.status, format_effect_estimate(one), format_gain_pct(one))
        for one in found[:MOST_EFFECTS]
    ]
    counts = [
        f"{count} {status}"
        for status in (REFUTED, NOT_VISIBLE)
        if (count := sum(one.status == status and one not in found for one in findings))
    ]
    if len(found) > MOST_EFFECTS:
        counts.insert(0, f"{len(found) - MOST_EFFECTS} more found")
    styles = tuple("bold" if one.status in (NAMED, EQUIVALENT) else "" for one in found[:MOST_EFFECTS])
    parts: list[object] = [FittedTable(_EFFECT_COLUMNS, tuple(rows), styles)] if rows else []
    if counts:
        others = "Other effects" if rows else "Effects"
        parts.append(format_sentence(f"{others}: {', '.join(counts)}."))
    return parts


def _list_last_sentences(diagnosis: Diagnosis) -> list[str]:
    """The worst runs, what remains, the next drive, what is saved, and how many notes there are."""
    lines = [_describe_worst_runs(diagnosis), describe_remaining_error(diagnosis)[0], describe_next_drive(diagnosis)]
    if diagnosis.holdout is not None and not diagnosis.holdout.is_requested:
        lines.append(diagnosis.holdout.words)
    lines.append(describe_saved_effects(diagnosis) if diagnosis.is_savable else describe_unsaved_finds(diagnosis))
    if diagnosis.notes:
        lines.append(f"{format_count(len(diagnosis.notes), 'note')} on the logs and the tractor file: --explain.")
    return [line for line in lines if line]


def _describe_worst_runs(diagnosis: Diagnosis) -> str:
    """The error of the worst runs in one sentence; empty with one run."""
    runs = sort_runs(diagnosis)
    if len(runs) < 2:
        return ""
    parts = [
        f"{run.name} {format_number(run.error_before_cm, 1)} to {format_number(run.error_after_cm, 1)}"
        for run in runs[:MOST_LISTED_RUNS]
    ]
    parts += [f"{len(runs) - MOST_LISTED_RUNS} more" if len(runs) > MOST_LISTED_RUNS else ""]
    return f"By run over {SHOWN_HORIZON_S:g} s, cm, worst first: {'; '.join(part for part in parts if part)}."
