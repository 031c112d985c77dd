"""A diagnosis as one self-contained page, and in a notebook: in short, as a fragment, as a table and drawn."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from reports.common import palette
from reports.common.rendering import NOT_DRAWN, ResultView, build_view, encode_picture, render_template
from reports.common.text_tables import render_fragment
from reports.common.wording import format_number, get_effect_label, join_list, replace_effect_ids
from reports.diagnosis import sentences as words
from reports.diagnosis.evidence import build_correlation_table, build_curve_drawing, build_evidence_content
from reports.diagnosis.tables import build_diagnosis_dict, build_effect_table, format_diagnosis_json, list_found
from vehicle.identification.diagnosis.results import CONSTANT_LAW, EQUIVALENT, LIKELY, NOT_VISIBLE, Diagnosis, Finding
from vehicle.model.effects import get_effect

if TYPE_CHECKING:
    from matplotlib.axes import Axes

ERROR_COLOURS = {
    "before": palette.TRACTOR_COLOURS[1], "after": palette.STATE_COLOURS["working"], "noise": "#CFCFC6"
}  # fmt: skip


def render_diagnosis_page(diagnosis: Diagnosis, hidden: str | None = None) -> str:
    """Render the page as HTML; `hidden` describes the hidden effect of a demonstration."""
    discrepancy, drive, findings = diagnosis.tractor.discrepancy_model, diagnosis.next_drive, diagnosis.findings
    content = {
        "diagnosis": diagnosis,
        "say": words,
        "format_number": format_number,
        "headline": replace_effect_ids(diagnosis.causes_sentence),
        "hidden": hidden,
        "facts": _list_diagnosis_facts(diagnosis),
        "bars": [_build_bars_by_horizon(diagnosis, kind) for kind in _list_known_kinds(diagnosis)],
        "curve": None if diagnosis.curve is None else build_curve_drawing(diagnosis.curve),
        "shown_by": _describe_curve_cause(diagnosis),
        "evidence": build_evidence_content(diagnosis),
        "correlations": build_correlation_table(diagnosis.correlations),
        "effects": [_describe_effect(one) for one in words.sort_findings(findings)],
        "likely": words.explain_likely_verdict() if any(one.status == LIKELY for one in findings) else None,
        "discrepancy_model": discrepancy
        and {"terms": words.list_discrepancy_terms(discrepancy), "words": words.describe_trusted_range(discrepancy)},
        "drive_plan": diagnosis.next_drive_plan and quote(diagnosis.next_drive_plan),
        "alternatives": join_list(map(get_effect_label, drive.separates)) if drive else "",
        "notes": [replace_effect_ids(note) for note in diagnosis.notes],
        "before_colour": palette.TRACTOR_COLOURS[1],
        "after_colour": palette.TRACTOR_COLOURS[0],
    }
    return render_template("diagnosis.html.j2", content)


def _describe_curve_cause(diagnosis: Diagnosis) -> str:
    """Return whose curve is drawn, and what it depends on."""
    equivalents = [one.id for one in diagnosis.findings if one.status == EQUIVALENT and one.interval]
    names = list(diagnosis.named[:1]) or (equivalents if len(equivalents) == 1 else [])
    if names:
        return f"The error from {get_effect_label(names[0])} depends on: {get_effect(names[0]).regressor}."
    return "" if equivalents or not diagnosis.depends_on else f"No known cause: {diagnosis.depends_on[0]}."


def _get_errors_before_after_noise(diagnosis: Diagnosis, horizon: float, kind: words.ErrorKind) -> list[float]:
    """Error before, after and of noise alone."""
    errors = (diagnosis.before, diagnosis.after, diagnosis.noise_floor)
    return [float(getattr(each[horizon], kind.key)) for each in errors]


def _list_known_kinds(diagnosis: Diagnosis) -> list[words.ErrorKind]:
    """The kinds of error that are known over some horizon."""
    before = diagnosis.before.values()
    return [kind for kind in words.ERROR_KINDS if any(math.isfinite(getattr(error, kind.key)) for error in before)]


def _list_diagnosis_facts(diagnosis: Diagnosis) -> list[tuple[str, str]]:
    """The errors over one horizon, label and value."""
    if words.SHOWN_HORIZON_S not in diagnosis.before:
        return []
    facts = []
    for kind in _list_known_kinds(diagnosis):
        errors = _get_errors_before_after_noise(diagnosis, words.SHOWN_HORIZON_S, kind)
        before, after, noise = (format_number(value, 2) for value in errors)
        label = f"{kind.heading}, {kind.unit}, pieces of {words.SHOWN_HORIZON_S:g} s"
        facts.append((label, f"{before} → {after} (noise {noise})"))
    horizon = None if diagnosis.holdout is None else words.find_shown_horizon_s(diagnosis.holdout)
    if diagnosis.holdout is not None and horizon is not None:
        old, new = words.format_held_out_errors(diagnosis, diagnosis.holdout, horizon, 2)
        facts.append((f"On runs held out, cm, pieces of {horizon:g} s", f"{old} → {new}"))
    return facts


def _build_bars_by_horizon(diagnosis: Diagnosis, kind: words.ErrorKind) -> dict[str, Any]:
    """One kind of error by horizon as shares of the largest."""
    rows = {
        h: dict(zip(("before", "after", "noise"), _get_errors_before_after_noise(diagnosis, h, kind), strict=True))
        for h in diagnosis.before
    }
    values = [value for row in rows.values() for value in row.values() if math.isfinite(value)]
    largest = max(values, default=0.0) or 1.0
    return {
        "name": f"{kind.heading}, {kind.unit}",
        "rows": [
            {
                "horizon": f"{h:g} s",
                "bars": [
                    {
                        "name": who,
                        "share": 100.0 * value / largest if math.isfinite(value) else 0.0,
                        "text": kind.format(value),
                    }
                    for who, value in row.items()
                ],
            }
            for h, row in rows.items()
        ],
    }


def _describe_effect(finding: Finding) -> dict[str, Any]:
    gain = words.format_gain_pct(finding)
    if finding.gain_interval:
        low, high = (format_number(value, 0) for value in finding.gain_interval)
        gain += f" ({low} to {high})"
    is_unseen = finding.status == NOT_VISIBLE
    return {
        "id": finding.id,
        "label": get_effect_label(finding.id),
        "kind": finding.status,
        "status": words.describe_status(finding),
        "block": finding.block,
        "value": words.format_effect_estimate(finding),
        "gain": gain,
        "visible": words.format_smallest_visible(finding),
        "law": "" if finding.law is None or finding.law.kind == CONSTANT_LAW else words.end_sentence(finding.law.words),
        "same": ", ".join(map(get_effect_label, finding.equivalent_to)),
        "regressor": get_effect(finding.id).regressor,
        "drive": get_effect(finding.id).drive if is_unseen else None,
    }


@build_view.register
def build_diagnosis_view(diagnosis: Diagnosis) -> ResultView:
    """A diagnosis: verdict, errors before and after, and the effects."""
    is_requested = diagnosis.holdout is not None and diagnosis.holdout.is_requested
    return ResultView(
        summary=lambda: " ".join(
            [replace_effect_ids(diagnosis.headline), *(words.describe_holdout(diagnosis)[1:] if is_requested else [])]
        ),
        html=lambda: render_diagnosis_fragment(diagnosis),
        table=lambda: [_flatten_effect(entry) for entry in build_diagnosis_dict(diagnosis)["effects"]],
        draw=(lambda axes: draw_errors(axes, diagnosis)) if diagnosis.before else None,
        not_drawn=f"{NOT_DRAWN}: the logs are too short for errors.",
        files={".json": lambda: format_diagnosis_json(diagnosis), ".html": lambda: render_diagnosis_page(diagnosis)},
    )


def render_diagnosis_fragment(diagnosis: Diagnosis) -> str:
    """Verdict, how much was read, and the effects that were found, or all of them where none was."""
    findings = words.sort_findings(diagnosis.findings)
    shown = list_found(findings) or findings
    left_out = len(findings) - len(shown)
    notes = (f"{left_out} more effects were examined; to_pandas() has all.",) if left_out else ()
    tables = [replace(build_effect_table(shown, ("Id in files",)), styles=(), notes=notes)]
    picture = None
    if diagnosis.before:
        picture = encode_picture(lambda axes: draw_errors(axes, diagnosis), (6.0, 3.0))
    sentences = [
        *words.describe_columns(diagnosis),
        *words.describe_hints(diagnosis),
        *words.describe_unlike_runs(diagnosis),
        f"{words.describe_log_size(diagnosis)}.",
        *words.describe_holdout(diagnosis),
        *filter(None, [words.describe_unsaved_finds(diagnosis)]),
    ]
    return render_fragment(
        replace_effect_ids(diagnosis.headline), sentences, tables, picture, "Error across the path before and after"
    )


def _flatten_effect(entry: dict[str, Any]) -> dict[str, Any]:
    """An effect of the JSON with a key for each end of its intervals.

    `value`, `value_low` and `value_high` are of the first of its values, in `unit`; `values` holds all of them.
    """
    values, intervals = entry["value"] or {}, entry["interval"] or {}
    first = next(iter(values), None)
    low, high = intervals.get(first) or (None, None)
    gain_low, gain_high = entry["gain_interval"] or (None, None)
    return {
        "id": entry["id"],
        "effect": get_effect_label(entry["id"]),
        "status": entry["status"],
        "calibrated": entry["calibrated"],
        "value": values.get(first),
        "value_low": low,
        "value_high": high,
        "unit": entry["unit"],
        "gain_pct": entry["gain_pct"],
        "gain_low_pct": gain_low,
        "gain_high_pct": gain_high,
        "smallest_visible": entry["smallest_visible"],
        "block": entry["block"],
        "equivalent_to": ", ".join(entry["equivalent_to"]),
        "exchange": entry["exchange"],
        "law": None if entry["law"] is None else entry["law"]["kind"],
        "values": entry["value"],
    }


def draw_errors(axes: Axes, diagnosis: Diagnosis) -> None:
    """Error across the path over the length of the pieces: before, after, and the noise."""
    errors = {"before": diagnosis.before, "noise": diagnosis.noise_floor, "after": diagnosis.after}
    for name, by_horizon in errors.items():
        across = [error.cross_cm for error in by_horizon.values()]
        width = 6.0 if name == "noise" else 1.5  # what is left is often as small as the noise, and lies on it
        axes.plot(list(by_horizon), across, marker="o", color=ERROR_COLOURS[name], linewidth=width, label=name)
    axes.set_ylim(bottom=0.0)
    axes.set(xlabel="length of the pieces, s", ylabel="error across, cm")
    axes.legend(frameon=False, fontsize=8)
