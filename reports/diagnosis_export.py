"""A diagnosis as JSON: a contract."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

from reports.diagnosis_words import is_calibration
from reports.plain import finite
from vehicle.measured.answer.verdict import Diagnosis, Errors, Finding

if TYPE_CHECKING:
    from vehicle.measured.answer.demo import Hidden


def diagnosis_json(diagnosis: Diagnosis, hidden: Hidden | None = None) -> str:
    """The diagnosis as a JSON object; numbers that JSON cannot hold are null.

    `hidden` is what a demonstration had hidden.
    """
    return json.dumps(finite(diagnosis_dict(diagnosis, hidden)), indent=2, allow_nan=False) + "\n"


def diagnosis_dict(diagnosis: Diagnosis, hidden: Hidden | None = None) -> dict[str, Any]:
    """The diagnosis as plain values."""
    drive, plan = diagnosis.next_drive, diagnosis.plan
    return {
        "runs": len(diagnosis.names),
        "rows_used": diagnosis.rows_used,
        "rows_gated": diagnosis.rows_gated,
        "verdict": diagnosis.headline,
        "grounds": [{"id": one.id, "value": one.value, "runs": list(one.runs)} for one in diagnosis.grounds],
        "error_before": _errors(diagnosis.before),
        "error_after": _errors(diagnosis.after),
        "noise_floor": _errors(diagnosis.floor),
        "guilty_block": diagnosis.guilty_block,
        "effects": [_effect(one) for one in diagnosis.findings],
        "named": list(diagnosis.named),
        "unexplained_share": diagnosis.unexplained_share,
        "left": _left(diagnosis),
        "unexplained_depends_on": list(diagnosis.depends_on),
        "next_drive": None if drive is None else {
            "id": drive.id, "words": drive.words, "seconds": drive.seconds, "separates": list(drive.separates),
            "score": drive.score, "decides": drive.decides,
        },
        "calibration": diagnosis.calibration,
        "plan": None if plan is None else plan.__dict__,
        "notes": list(diagnosis.notes),
        "tractor": diagnosis.tractor.model_dump(mode="python"),
        "hidden": None if hidden is None else {"id": hidden.id, "value": hidden.values, "words": hidden.words},
    }  # fmt: skip


def _errors(errors: Errors) -> dict[str, dict[str, float]]:
    return {f"{horizon:g}": dict(error.__dict__) for horizon, error in errors.items()}


def _left(diagnosis: Diagnosis) -> dict[str, Any]:
    """What all effects together leave: whether that is noise, and what it comes to above the noise.

    `late_s` is null where the way along is not judged.
    """
    left = diagnosis.left
    told = {} if left is None else dict(left.__dict__)
    if told and not diagnosis.along_judged:
        told["late_s"] = None
    above = list(diagnosis.above_noise_s)
    return {"as_good_as_noise": diagnosis.as_good_as_noise, "above_noise_s": above, **told}


def _effect(one: Finding) -> dict[str, Any]:
    return {
        "id": one.id, "status": one.status, "calibrated": is_calibration(one), "value": one.value,
        "interval": None if one.interval is None else {key: list(pair) for key, pair in one.interval.items()},
        "gain_pct": one.gain_pct, "gain_interval": one.gain_interval, "smallest_visible": one.smallest_visible,
        "unit": one.unit, "block": one.block, "equivalent_to": list(one.equivalent_to), "exchange": one.exchange,
    }  # fmt: skip
