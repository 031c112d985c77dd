"""Notes of a diagnosis on its logs, its clocks, the data it rests on and what the tractor file already has."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vehicle.identification.logs.clock_drift import CLOCKS_FROM_S
from vehicle.identification.logs.reader import list_shared_remarks
from vehicle.identification.logs.schema import Log
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.identification.verdict.diagnosis_types import Diagnosis
from vehicle.model.tractor import Tractor

TIME_EFFECTS = ("steering_dead_time", "gnss_latency")  # what drifting clocks would look like
OWN_GROUND_NOTE = (
    "The errors after are for every run on its own ground, fitted to the other half of the run; the tractor file has "
    "one ground and is less accurate on the other."
)


def list_diagnosis_notes(
    logs: Sequence[Log], residual_model: ResidualModel, tractor: Tractor, diagnosis: Diagnosis
) -> tuple[str, ...]:
    """Return all notes, those on the logs first."""
    sentences = (
        *_describe_logs(logs, residual_model),
        *_describe_subset(residual_model, diagnosis),
        *_describe_clocks(logs, diagnosis),
        *_describe_file_corrections(tractor, diagnosis),
    )
    return (*sentences, OWN_GROUND_NOTE) if diagnosis.grounds else sentences


def _describe_logs(logs: Sequence[Log], residual_model: ResidualModel) -> tuple[str, ...]:
    """Return notes on rows and columns."""
    sentences = list_shared_remarks(logs) + list(residual_model.dataset.remarks)
    if not residual_model.has_measured_wheel_angle:
        sentences.append(
            "No wheel angle was logged, so faults of the steering and of the path are hard to distinguish."
        )
    if any(segment.target is None for segment in residual_model.dataset.segments):
        sentences.append("No commanded speed was logged, so the speed control was not checked.")
    if any(log.heading_deg is None for log in logs):  # of all logs, as the errors are; a subset may lack some of them
        sentences.append("Some logs have no heading; the course of the positions is used instead.")
    if len(logs) == 1:
        sentences.append("There is only one run, so its own 20 s windows replace runs not used for fitting.")
    return tuple(sentences)


def _describe_subset(residual_model: ResidualModel, diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return a note that the causes of long logs were searched in a subset."""
    minutes = residual_model.dataset.seconds / 60.0
    unlike = [run.name for run in diagnosis.runs if run.unlike]
    if unlike:
        return (
            f"Causes, values and intervals come from {minutes:.0f} of {diagnosis.minutes:.0f} minutes, without "
            f"{', '.join(unlike)}, unlike the other runs; the errors before and after are for all of the driving.",
        )
    if minutes >= diagnosis.minutes:
        return ()
    return (
        f"Causes, values and intervals come from {minutes:.0f} of {diagnosis.minutes:.0f} minutes, sampled from all "
        "logs; "
        "the errors before and after and the unexplained error are for all of the driving.",
    )


def _describe_clocks(logs: Sequence[Log], diagnosis: Diagnosis) -> list[str]:
    """Return a note where a delay was found in logs too short to check for drifting clocks."""
    late = [finding.id for finding in diagnosis.findings if finding.id in TIME_EFFECTS and finding.value is not None]
    short = sum(float(np.ptp(log.time_s[log.used])) < CLOCKS_FROM_S for log in logs)
    if not late or not short:
        return []
    subject = "The log is" if len(logs) == 1 else f"{short} of {len(logs)} logs are"
    return [
        f"{subject} too short (under {CLOCKS_FROM_S:.0f} s) to check whether the clocks of two instruments drift "
        f"apart; the result for {' and '.join(late)} assumes that they do not."
    ]


def _describe_file_corrections(tractor: Tractor, diagnosis: Diagnosis) -> tuple[str, ...]:
    """Return notes on the effects and the discrepancy model that the tractor file already had."""
    sentences = []
    if tractor.effects:
        unseen = [name for name, setting in tractor.effects.items() if diagnosis.tractor.effects.get(name) is setting]
        outcome = f" These logs do not show {', '.join(unseen)}; the value of the file was kept." if unseen else ""
        sentences.append(
            f"The tractor file already has {', '.join(tractor.effects)}; fitted again from scratch. The error before "
            "is with "
            f"the values of the file.{outcome}"
        )
    if tractor.discrepancy_model is not None:
        outcome = (
            "kept, as these logs do not contradict it"
            if diagnosis.tractor.discrepancy_model is tractor.discrepancy_model
            else "replaced"
        )
        outcome = "dropped, as these logs contradict it" if diagnosis.tractor.discrepancy_model is None else outcome
        sentences.append(f"The tractor file has a discrepancy model: {outcome}.")
    return tuple(sentences)
