"""A diagnosis as a terminal table and as JSON (a contract)."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from reports.common.effect_names import get_effect_label, replace_effect_ids
from reports.common.rendering import make_json_safe
from reports.common.text_tables import FittedTable, TableColumn, format_sentence
from reports.common.wording import format_number, join_list
from reports.diagnosis.evidence import build_residuals_dict, list_correlations
from reports.diagnosis.sentences import (
    SMALLEST_VISIBLE,
    describe_confusable_effects,
    describe_log_size,
    describe_plan_change,
    describe_remaining_error,
    describe_trusted_range,
    describe_two_level_effects,
    explain_likely_verdict,
    format_count,
    format_effect_estimate,
    format_gain_pct,
    format_smallest_visible,
    is_calibration_effect,
    list_discrepancy_terms,
    name_held_out_data,
    sort_findings,
)
from vehicle.identification.verdict.diagnosis_types import EQUIVALENT, NAMED, Diagnosis, ErrorsByHorizon, Finding

if TYPE_CHECKING:
    from rich.console import Group

    from vehicle.identification.verdict.demo_logs import HiddenEffect


def format_diagnosis_json(diagnosis: Diagnosis, hidden: HiddenEffect | None = None) -> str:
    """Return the diagnosis as a JSON object; numbers that JSON cannot hold are null.

    `hidden` is the hidden effect of a demonstration.
    """
    return json.dumps(make_json_safe(build_diagnosis_dict(diagnosis, hidden)), indent=2, allow_nan=False) + "\n"


def build_diagnosis_dict(diagnosis: Diagnosis, hidden: HiddenEffect | None = None) -> dict[str, Any]:
    """Return the diagnosis as plain values."""
    drive, plan = diagnosis.next_drive, diagnosis.plan
    return {
        "runs": len(diagnosis.names),
        "rows_used": diagnosis.rows_used,
        "rows_gated": diagnosis.rows_gated,
        "verdict": diagnosis.headline,
        "grounds": [{"id": one.id, "value": one.value, "runs": list(one.runs)} for one in diagnosis.grounds],
        "error_before": _convert_errors_to_dict(diagnosis.before),
        "error_after": _convert_errors_to_dict(diagnosis.after),
        "noise_floor": _convert_errors_to_dict(diagnosis.noise_floor),
        "guilty_block": diagnosis.guilty_block,
        "effects": [_convert_effect_to_dict(one) for one in diagnosis.findings],
        "named": list(diagnosis.named),
        "unexplained_share": diagnosis.unexplained_share,
        "residual_error": _convert_remaining_error_to_dict(diagnosis),
        "unexplained_depends_on": list(diagnosis.depends_on),
        "next_drive": None
        if drive is None
        else {
            "id": drive.id,
            "words": drive.description,
            "seconds": drive.seconds,
            "separates": list(drive.separates),
            "score": drive.score,
            "decides": drive.decides,
        },
        "calibration": diagnosis.calibration,
        "plan": None if plan is None else plan.__dict__,
        "residuals": None if diagnosis.evidence is None else build_residuals_dict(diagnosis.evidence),
        "correlations": list_correlations(diagnosis.correlations),
        "notes": list(diagnosis.notes),
        "tractor": diagnosis.tractor.model_dump(mode="python"),
        "hidden": None if hidden is None else {"id": hidden.id, "value": hidden.values, "words": hidden.description},
    }


def _convert_errors_to_dict(errors: ErrorsByHorizon) -> dict[str, dict[str, float]]:
    return {f"{horizon:g}": dict(error.__dict__) for horizon, error in errors.items()}


def _convert_remaining_error_to_dict(diagnosis: Diagnosis) -> dict[str, Any]:
    """Export the remaining error: whether it is only noise, and its size above the noise.

    `late_s` is null where the error along the path is not judged.
    """
    remaining = diagnosis.residual_error
    values = {} if remaining is None else dict(remaining.__dict__)
    if values and not diagnosis.along_judged:
        values["late_s"] = None
    above = list(diagnosis.above_noise_s)
    return {"as_good_as_noise": diagnosis.is_noise_only, "above_noise_s": above, **values}


def _convert_effect_to_dict(finding: Finding) -> dict[str, Any]:
    return {
        "id": finding.id,
        "status": finding.status,
        "calibrated": is_calibration_effect(finding),
        "value": finding.value,
        "interval": None if finding.interval is None else {key: list(pair) for key, pair in finding.interval.items()},
        "gain_pct": finding.gain_pct,
        "gain_interval": finding.gain_interval,
        "smallest_visible": finding.smallest_visible,
        "unit": finding.unit,
        "block": finding.block,
        "equivalent_to": list(finding.equivalent_to),
        "exchange": finding.exchange,
    }


_ERROR_COLUMNS = (
    TableColumn("Pieces"),
    *(
        TableColumn(f"{name} {who}", f"{name}\n{who}", drop_order=drop)
        for drop, who in enumerate(("before", "after", "noise"))
        for name in ("Across", "Along", "Heading")
    ),
)
_EFFECT_COLUMNS = (
    TableColumn("Effect", is_text=True),
    TableColumn("Id in files", is_text=True, drop_order=4, is_unbroken=True),
    TableColumn("Status", is_text=True, is_unbroken=True),
    TableColumn("Value (95 %)", is_text=True),
    TableColumn("Gain %", drop_order=2),
    TableColumn("Smallest visible", drop_order=3),
)


def build_diagnosis_table(diagnosis: Diagnosis) -> Group:
    """Build verdict, errors, effects and remarks, from top to bottom."""
    from rich.console import Group
    from rich.text import Text

    parts: list[object] = [format_sentence(replace_effect_ids(diagnosis.headline), style="bold")]
    parts += [format_sentence(line) for line in describe_two_level_effects(diagnosis)]
    parts.append(format_sentence(f"{describe_log_size(diagnosis)}."))
    if diagnosis.guilty_block:
        parts.append(format_sentence(f"Guilty block: {diagnosis.guilty_block}."))
    title = (
        f"Error of replayed commands on {name_held_out_data(diagnosis)} not used for fitting: root mean square over "
        "pieces "
        "of that length, each aligned with the measurement; across and along in cm, heading in degrees"
    )
    parts += [Text(""), format_sentence(title, style="italic"), _build_error_table(diagnosis)]
    parts += [Text(""), format_sentence("Effects", style="italic"), _build_effect_table(diagnosis), Text("")]
    parts += [format_sentence(line) for line in list_diagnosis_remarks(diagnosis)]
    return Group(*parts)  # type: ignore[arg-type]


def list_diagnosis_remarks(diagnosis: Diagnosis) -> list[str]:
    """List the sentences after the tables: how to read them, discrepancy model, next drive, remaining error, plan."""
    lines = [SMALLEST_VISIBLE]
    if any(is_calibration_effect(one) for one in diagnosis.findings):
        lines.append(explain_likely_verdict())
    discrepancy = diagnosis.tractor.discrepancy_model
    if discrepancy is not None:
        lines.append(
            f"Discrepancy model: {'; '.join(list_discrepancy_terms(discrepancy))}. "
            f"{describe_trusted_range(discrepancy)}"
        )
    lines += describe_confusable_effects(diagnosis)
    drive = diagnosis.next_drive
    if drive:
        length = format_count(round(drive.seconds), "second")
        doubt = "" if drive.decides else " No known drive separates them better, but it may not be enough."
        alternatives = join_list(map(get_effect_label, drive.separates))
        lines.append(f"To distinguish {alternatives}: {drive.description} That takes {length}.{doubt}")
    lines += [*describe_remaining_error(diagnosis), *describe_plan_change(diagnosis)]
    return lines + [replace_effect_ids(note) for note in diagnosis.notes]


def _build_error_table(diagnosis: Diagnosis) -> FittedTable:
    rows = []
    for horizon, before in diagnosis.before.items():
        trio = (before, diagnosis.after[horizon], diagnosis.noise_floor[horizon])
        cells = (
            (format_number(one.cross_cm, 1), format_number(one.along_cm, 1), format_number(one.heading_deg, 2))
            for one in trio
        )
        rows.append((f"{horizon:g} s", *(cell for three in cells for cell in three)))
    return FittedTable(_ERROR_COLUMNS, tuple(rows))


def _build_effect_table(diagnosis: Diagnosis) -> FittedTable:
    findings = sort_findings(diagnosis.findings)
    rows = tuple(
        (
            get_effect_label(one.id),
            one.id,
            one.status,
            format_effect_estimate(one),
            format_gain_pct(one),
            format_smallest_visible(one),
        )
        for one in findings
    )
    styles = tuple("bold" if one.status in (NAMED, EQUIVALENT) else "" for one in findings)
    return FittedTable(_EFFECT_COLUMNS, rows, styles)
