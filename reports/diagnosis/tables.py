"""A diagnosis for a terminal, on a first screen and in whole tables, and as JSON (a contract)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Group, RenderableType
from rich.text import Text

from reports.common.rendering import format_json, make_json_safe, pick_values
from reports.common.text_tables import (
    MOST_NAMED,
    FittedTable,
    TableColumn,
    WrappedSentence,
    build_table,
    format_sentence,
)
from reports.common.wording import format_number, get_effect_label, replace_effect_ids
from reports.diagnosis import sentences as words
from reports.diagnosis.evidence import build_residuals_dict, list_correlations
from vehicle.identification.diagnosis.results import (
    EQUIVALENT,
    LIKELY,
    NAMED,
    NOT_VISIBLE,
    REFUTED,
    Diagnosis,
    Finding,
    RunCheck,
)

if TYPE_CHECKING:
    from vehicle.identification.diagnosis.demo_logs import HiddenEffect


MOST_EFFECTS = 6
MORE_HINT = "Add --explain (every effect, every run, how to read it), --html report.html (pictures)."
_EFFECT_KEYS = (
    "value", "interval", "gain_pct", "gain_interval", "smallest_visible", "unit", "block", "equivalent_to", "exchange",
    "law",
)  # fmt: skip
_ERROR_COLUMNS = (
    TableColumn("Pieces"),
    *(
        TableColumn(f"{name} {who}", f"{name}\n{who}", drop_order=drop)
        for drop, who in enumerate(("before", "after", "noise"))
        for name in [kind.heading for kind in words.ERROR_KINDS]
    ),
)
_EFFECT_FIGURES: tuple[tuple[TableColumn, Callable[[Finding], str]], ...] = (
    (TableColumn("Effect", is_text=True), lambda one: get_effect_label(one.id)),
    (TableColumn("Id in files", is_text=True, drop_order=4, is_unbroken=True), lambda one: one.id),
    (TableColumn("Status", is_text=True, is_unbroken=True), lambda one: one.status),
    (TableColumn("Value (95 %)", is_text=True), words.format_effect_estimate),
    (TableColumn("Gain %", drop_order=2), words.format_gain_pct),
    (TableColumn("Smallest visible", drop_order=3), words.format_smallest_visible),
)
_HOLDOUT_COLUMNS = (TableColumn("Pieces"), *_ERROR_COLUMNS[1:7])
_CHANGE_COLUMNS = (TableColumn("Before, cm", "Before"), TableColumn("After, cm", "After"))
_HELD_OUT_RUN_COLUMNS = (TableColumn("Run held out", is_text=True, break_marks=" +-_/"), *_CHANGE_COLUMNS)
_RUN_COLUMNS = (
    TableColumn("Run", is_text=True, break_marks=" +-_/"), *_CHANGE_COLUMNS,
    TableColumn("Remark", is_text=True, drop_order=1),
)  # fmt: skip
_TIMING_COLUMNS = (
    TableColumn("Column", is_text=True),
    TableColumn("Late, s", "Late"),
    TableColumn("Held, s", "Held"),
    TableColumn("Low pass, s", "Low pass"),
    TableColumn("Clock, s", "Clock"),
    TableColumn("Stale rows", drop_order=1),
)


def format_diagnosis_json(diagnosis: Diagnosis, hidden: HiddenEffect | None = None) -> str:
    """Return the diagnosis as a JSON object; numbers that JSON cannot hold are null.

    `hidden` is the hidden effect of a demonstration.
    """
    return format_json(build_diagnosis_dict(diagnosis, hidden))


def build_diagnosis_dict(diagnosis: Diagnosis, hidden: HiddenEffect | None = None) -> dict[str, Any]:
    """Return the diagnosis as plain values, most of them as Diagnosis has them."""
    drive, remaining = diagnosis.next_drive, diagnosis.residual_error
    residual_error = {} if remaining is None else make_json_safe(remaining)
    if residual_error and not diagnosis.along_judged:
        residual_error["late_s"] = None
    content = {
        "runs": diagnosis.runs or [RunCheck(name, None, None) for name in diagnosis.names],
        **pick_values(diagnosis, ("rows_used", "rows_gated", "rows_gated_by_reason")),
        "verdict": diagnosis.headline,
        "faults": [pick_values(each, ("id", "run", "from_s", "to_s", "words")) for each in diagnosis.faults],
        "columns": diagnosis.columns,
        "error_before": diagnosis.before,
        "error_after": diagnosis.after,
        **pick_values(diagnosis, ("noise_floor", "guilty_block")),
        "effects": [
            {"id": one.id, "status": one.status, "calibrated": one.status == LIKELY} | pick_values(one, _EFFECT_KEYS)
            for one in diagnosis.findings
        ],
        "interval_note": diagnosis.interval_note or None,
        **pick_values(diagnosis, ("named", "unexplained_share")),
        "residual_error": {
            "as_good_as_noise": diagnosis.is_noise_only,
            "above_noise_s": list(diagnosis.above_noise_s),
            **residual_error,
        },
        "unexplained_depends_on": diagnosis.depends_on,
        **pick_values(diagnosis, ("hints", "holdout")),
        "unsaved_reason": words.describe_unsaved(diagnosis) or None,
        "next_drive": drive
        and {"words": drive.description, **pick_values(drive, ("id", "seconds", "separates", "score", "decides"))},
        **pick_values(diagnosis, ("calibration", "plan")),
        "residuals": None if diagnosis.evidence is None else build_residuals_dict(diagnosis.evidence),
        "correlations": list_correlations(diagnosis.correlations),
        "notes": diagnosis.notes,
        "tractor": diagnosis.tractor.model_dump(mode="python"),
        "hidden": hidden and {"id": hidden.id, "value": hidden.values, "words": hidden.description},
    }
    plain: dict[str, Any] = make_json_safe(content)
    return plain


def build_diagnosis_table(diagnosis: Diagnosis) -> Group:
    """Build everything for a terminal: verdict, errors, runs, columns, effects and remarks, from top to bottom."""
    parts: list[RenderableType] = list(build_verdict_lines(diagnosis))
    if diagnosis.undiagnosed_reason:
        return Group(*parts, *map(format_sentence, list_diagnosis_remarks(diagnosis)))
    title = (
        f"Error of replayed commands on {words.name_held_out_data(diagnosis)} not used for fitting: root mean square "
        "over pieces of that length, each aligned with the measurement; across and along in cm, heading in degrees"
    )
    parts += [Text(""), format_sentence(title, style="italic"), build_error_table(diagnosis)]
    if len(diagnosis.runs) > 1:
        title = f"Error of each run over pieces of {words.SHOWN_HORIZON_S:g} s, worst first"
        runs = words.sort_runs(diagnosis)
        rows = [
            (run.name, format_number(run.error_before_cm, 1), format_number(run.error_after_cm, 1),
             "unlike the others" if run.unlike else "")
            for run in runs[:words.MOST_RUNS]
        ]  # fmt: skip
        rows += [("...", "", "", f"{len(runs) - words.MOST_RUNS} more")] if len(runs) > words.MOST_RUNS else []
        parts += [Text(""), format_sentence(title, style="italic"), FittedTable(_RUN_COLUMNS, tuple(rows))]
    parts += build_holdout_parts(diagnosis, by_run=True)
    if diagnosis.columns:
        parts += [Text(""), format_sentence("Columns of the logs", style="italic")]
        parts.append(FittedTable(_TIMING_COLUMNS, tuple(words.list_column_rows(diagnosis))))
    parts += [
        Text(""),
        format_sentence("Effects", style="italic"),
        build_effect_table(words.sort_findings(diagnosis.findings)),
        Text(""),
    ]
    parts += [format_sentence(line) for line in list_diagnosis_remarks(diagnosis)]
    return Group(*parts)


def build_verdict_lines(diagnosis: Diagnosis) -> Iterator[WrappedSentence]:
    """Build the lines before the tables: faults that begin, columns, causes, hints, runs, and what was read."""
    for fault in diagnosis.faults:
        yield format_sentence(fault.sentence, style="bold")
    for line in words.describe_columns(diagnosis):
        yield format_sentence(line)
    yield format_sentence(replace_effect_ids(diagnosis.causes_sentence), style="bold")
    for line in (
        *words.describe_hints(diagnosis),
        *words.describe_unlike_runs(diagnosis),
        f"{words.describe_log_size(diagnosis)}.",
    ):
        yield format_sentence(line)
    if diagnosis.guilty_block:
        yield format_sentence(f"Guilty block: {diagnosis.guilty_block}.")


def build_holdout_parts(diagnosis: Diagnosis, by_run: bool) -> list[RenderableType]:
    """Build what runs held out say: errors by horizon and, with `by_run`, of each run."""
    holdout = diagnosis.holdout
    if holdout is None:
        return []
    parts: list[RenderableType] = [Text(""), *(format_sentence(line) for line in words.describe_holdout(diagnosis))]
    parts.append(FittedTable(_HOLDOUT_COLUMNS, tuple(words.list_error_rows(holdout.before, holdout.after))))
    if by_run and len(holdout.by_run) > 1:
        parts.append(FittedTable(_HELD_OUT_RUN_COLUMNS, tuple(words.list_holdout_rows(diagnosis))))
    return parts


def list_diagnosis_remarks(diagnosis: Diagnosis) -> list[str]:
    """List the sentences after the tables: how to read them, discrepancy model, next drive, remaining error, plan."""
    lines = [words.SMALLEST_VISIBLE]
    if any(one.status == LIKELY for one in diagnosis.findings):
        lines.append(words.explain_likely_verdict())
    discrepancy = diagnosis.tractor.discrepancy_model
    if discrepancy is not None:
        lines.append(
            f"Discrepancy model: {'; '.join(words.list_discrepancy_terms(discrepancy))}. "
            f"{words.describe_trusted_range(discrepancy)}"
        )
    lines += words.describe_confusable_effects(diagnosis)
    lines += [
        line for line in (words.describe_next_drive(diagnosis), words.end_sentence(diagnosis.interval_note)) if line
    ]
    lines += [*words.describe_remaining_error(diagnosis), *words.describe_plan_change(diagnosis)]
    return lines + [replace_effect_ids(note) for note in diagnosis.notes]


def build_error_table(diagnosis: Diagnosis) -> FittedTable:
    """Build the errors before, after and of noise by length of the pieces."""
    errors = (diagnosis.before, diagnosis.after, diagnosis.noise_floor)
    return FittedTable(_ERROR_COLUMNS, tuple(words.list_error_rows(*errors)))


def build_effect_table(findings: Sequence[Finding], without: Sequence[str] = ()) -> FittedTable:
    """A row per effect, those of the verdict in bold; `without` names headings that are left out."""
    figures = [(column, write) for column, write in _EFFECT_FIGURES if column.heading not in without]
    return build_table(findings, figures, lambda one: one.status in (NAMED, EQUIVALENT))


def list_found(findings: Sequence[Finding]) -> list[Finding]:
    """The effects that have a value or are of the verdict."""
    return [one for one in findings if one.value is not None or one.status in (NAMED, EQUIVALENT)]


def build_diagnosis_screen(diagnosis: Diagnosis) -> Group:
    """Build the verdict, the errors by length of the pieces, the effects that were found, and what remains."""
    parts: list[RenderableType] = list(build_verdict_lines(diagnosis))
    if diagnosis.undiagnosed_reason:
        return Group(*parts, format_sentence(MORE_HINT, style="dim"))
    if diagnosis.holdout is None or not diagnosis.holdout.is_requested:
        data = words.name_held_out_data(diagnosis)
        title = f"Error on {data} not used for fitting, by length of the pieces (cm, cm, degrees)"
        parts += [Text(""), format_sentence(title, style="italic"), build_error_table(diagnosis)]
    else:
        parts += build_holdout_parts(diagnosis, by_run=False)
    findings = words.sort_findings(diagnosis.findings)
    found = list_found(findings)
    counts = [f"{len(found) - MOST_EFFECTS} more found"] if len(found) > MOST_EFFECTS else []
    for status in (REFUTED, NOT_VISIBLE):
        count = sum(one.status == status and one not in found for one in findings)
        counts += [f"{count} {status}"] if count else []
    table = build_effect_table(found[:MOST_EFFECTS], ("Id in files", "Smallest visible"))
    parts += [Text(""), *([table] if found else [])]
    if counts:
        others = "Other effects" if found else "Effects"
        parts.append(format_sentence(f"{others}: {', '.join(counts)}."))
    parts += [format_sentence(line) for line in _list_last_sentences(diagnosis)]
    parts.append(format_sentence(MORE_HINT, style="dim"))
    return Group(*parts)


def _list_last_sentences(diagnosis: Diagnosis) -> list[str]:
    """The worst runs, what remains, the next drive, what is saved, and how many notes there are."""
    runs, worst_runs = words.sort_runs(diagnosis), ""
    if len(runs) > 1:
        parts = [
            f"{run.name} {format_number(run.error_before_cm, 1)} to {format_number(run.error_after_cm, 1)}"
            for run in runs[:MOST_NAMED]
        ]
        parts += [f"{len(runs) - MOST_NAMED} more"] if len(runs) > MOST_NAMED else []
        worst_runs = f"By run over {words.SHOWN_HORIZON_S:g} s, cm, worst first: {'; '.join(parts)}."
    lines = [worst_runs, words.describe_remaining_error(diagnosis)[0], words.describe_next_drive(diagnosis)]
    if diagnosis.holdout is not None and not diagnosis.holdout.is_requested:
        lines.append(diagnosis.holdout.words)
    lines.append(
        words.describe_saved_effects(diagnosis) if diagnosis.is_savable else words.describe_unsaved_finds(diagnosis)
    )
    if diagnosis.notes:
        lines.append(f"{words.format_count(len(diagnosis.notes), 'note')} on the logs and the tractor file: --explain.")
    return [line for line in lines if line]
