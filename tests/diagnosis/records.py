"""What a diagnosis made of a set of logs, as a record for JSON.

A record has what was hidden, all that was said, errors on runs that the same truth drives with another seed (by the
tractor of the file, and by the one that the diagnosis would save), seconds of CPU of the diagnosis and the largest
memory of the process.
"""

import dataclasses
import math
import resource
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from tests.diagnosis.log_sets import (
    LogSet,
    list_clock_fields,
    load_set_tractor,
    make_frames,
    make_right_frames,
    make_unseen_frames,
)
from tests.diagnosis.mixups import MIXUPS, REMARKED, RIGHT, SILENT, WRONG, judge_reading, read_as_told
from tests.diagnosis.rerecording import VARIATIONS, Record, is_as_recorded, vary_logs
from tests.diagnosis.tally import is_column_found
from tests.truth.cases import TruthCase
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis, ErrorsByHorizon
from vehicle.identification.diagnosis.saving import measure_holdout
from vehicle.identification.logs.reader import build_log
from vehicle.identification.logs.schema import Log
from vehicle.model.tractor import Tractor


def build_record(one: LogSet) -> Record:
    """What was hidden and said in a set; `error` in the place of an answer that never came."""
    head = describe_set(one)
    try:
        return head | (answer_mixup(one) if one.reference == "mixups" else answer_set(one))
    except Exception as error:  # a set that breaks the diagnosis is a result, and must not end a run of hours
        return head | {"error": f"{type(error).__name__}: {error}"}


def answer_set(one: LogSet) -> Record:
    """All that is counted of a set."""
    frames, tractor = make_frames(one), load_set_tractor(one)
    begun = time.process_time()
    found = diagnose_frames(frames, tractor, one.ground)
    record: Record = {"cpu_s": round(time.process_time() - begun, 2), "memory_mb": measure_memory_mb()}
    out = []
    for fault in one.case.faults:
        frame = frames[fault.run]
        start = float(frame["time_s"].iloc[0])
        to_s = None if fault.to_s is None else start + fault.to_s
        out.append({"id": fault.id, "run": frame.attrs["name"], "from_s": start + fault.from_s, "to_s": to_s})
    record |= {
        "faults": out,
        "minutes": round(found.minutes, 2),
        **describe_diagnosis(found),
    }
    held = measure_holdout(build_logs(make_unseen_frames(one), tractor), tractor, found.tractor, one.ground)
    record["unseen"] = {"before": list_errors(held.before), "after": list_errors(held.after)}
    if one.is_varied:
        record["varied"] = {how: describe_variation(frames, how, tractor, one.ground)
                            for how in VARIATIONS if not is_as_recorded(frames, how)}  # fmt: skip
    return record


def measure_memory_mb() -> int:
    """The largest memory of this process so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024


def answer_mixup(one: LogSet) -> Record:
    """What reading makes of spoiled logs, and where that says nothing, what a diagnosis does."""
    tractor, mixup = load_set_tractor(one), MIXUPS[one.label]
    reading = read_as_told(make_frames(one), tractor)
    right = read_as_told(make_right_frames(one.case.seed), tractor).logs
    assert right is not None, "right logs are refused"
    outcome = judge_reading(mixup, reading, right)
    record: Record = {"outcome": outcome, "fixes": list(reading.fixes), "words": reading.words}
    if outcome is None and reading.logs is not None:
        record |= describe_diagnosis(diagnose_logs(reading.logs, tractor, one.ground))
        record["outcome"] = judge_diagnosis(one, record)
    return record


def judge_diagnosis(one: LogSet, record: Record) -> str:
    """The outcome of a mix-up that reading does not tell, by what a diagnosis says."""
    mixup = MIXUPS[one.label]
    if set(record["named"]) - one.case.allowed:
        return WRONG
    clocks = describe_clocks(one.case)
    if clocks and all(is_column_found(record, column, clock) for column, clock in clocks.items()):
        return RIGHT
    told = " ".join(
        [*record["notes"], *(str(hint) for hint in record["hints"]), *(str(each) for each in record["columns"])]
    )
    words = [*mixup.columns, *(f"'{name}'" for name in mixup.clocks)]
    return REMARKED if record["named"] or any(word in told for word in words) else SILENT


def describe_set(one: LogSet) -> Record:
    """What a set hides, as JSON has it."""
    case = one.case
    return {
        "key": one.key, "reference": one.column, "seed": case.seed, "tractor": one.tractor,
        "kind": one.reference if one.reference in ("real", "mixups") else case.kind,
        "hidden": replace_infinite(case.effects), "clocks": describe_clocks(case),
        "laws": [dataclasses.asdict(law) for law in case.laws], "outside": dict(case.outside),
        "allowed": sorted(case.allowed), "wanted": sorted(case.wanted), "hint_words": list(case.hint_words),
        "faults": [], "named": [], "said": [],
    }  # fmt: skip


def describe_clocks(case: TruthCase) -> dict[str, dict[str, float]]:
    """What is wrong with the clocks of columns."""
    return {
        name: {key: getattr(clock, key) for key in list_clock_fields(clock)} for name, clock in case.columns.items()
    }


def build_logs(frames: Sequence[pd.DataFrame], tractor: Tractor) -> list[Log]:
    """Logs of tables."""
    return [build_log(frame, frame.attrs["name"], wheelbase_m=tractor.wheelbase_m) for frame in frames]


def diagnose_frames(frames: Sequence[pd.DataFrame], tractor: Tractor, ground: str = "soil") -> Diagnosis:
    """The diagnosis of logs as they are."""
    return diagnose_logs(build_logs(frames, tractor), tractor, ground)


def describe_diagnosis(found: Diagnosis) -> Record:
    """All of a diagnosis that is counted."""
    said = []
    for one in found.findings:
        said.append({
            "id": one.id, "status": one.status, "value": one.value, "interval": one.interval,
            "visible": one.smallest_visible, "equivalent_to": list(one.equivalent_to),
            "law": None if one.law is None else {"kind": one.law.kind, "values": dict(one.law.values)},
        })  # fmt: skip
    out: Record = replace_infinite({
        "named": list(found.named), "said": said, "unexplained": found.unexplained_share,
        "depends_on": list(found.depends_on), "next_drive": found.next_drive.id if found.next_drive else None,
        "columns": [dataclasses.asdict(one) for one in found.columns],
        "faults_said": [dataclasses.asdict(one) for one in found.faults],
        "hints": [dataclasses.asdict(one) for one in found.hints],
        "savable": found.is_savable, "notes": list(found.notes), "headline": found.headline,
    })  # fmt: skip
    return out


def list_errors(errors: ErrorsByHorizon) -> dict[str, dict[str, float | None]]:
    """By horizon the error over the ground (cm; across the path only where no speed is measured) and of the heading."""
    out = {}
    for horizon, one in errors.items():
        distance = math.hypot(one.cross_cm, one.along_cm if math.isfinite(one.along_cm) else 0.0)
        out[f"{horizon:g}"] = replace_infinite({"cm": distance, "deg": one.heading_deg})
    return out


def describe_variation(frames: Sequence[pd.DataFrame], how: str, tractor: Tractor, ground: str) -> Record:
    """What is said of the same logs written down another way."""
    try:
        found = describe_diagnosis(diagnose_frames(vary_logs(frames, how), tractor, ground))
    except Exception as error:  # as in build_record
        return {"error": f"{type(error).__name__}: {error}", "named": [], "said": []}
    return {"named": found["named"], "said": found["said"]}


def replace_infinite(value: Any) -> Any:
    """The same with None for numbers that JSON does not have."""
    if isinstance(value, Mapping):
        return {key: replace_infinite(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [replace_infinite(one) for one in value]
    if isinstance(value, float | np.floating):
        return float(value) if math.isfinite(value) else None
    return value
