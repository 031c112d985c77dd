"""Sets of logs by the third to the sixth reference: what a diagnosis made of each case, as a record for JSON.

A record has what was hidden, all that was said, and errors on runs that the same truth drives with another seed: by the
tractor of the file, and by the one that the diagnosis would save.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

from tests.diagnosis.rerecording import VARIATIONS, Record, vary_logs
from tests.truth.cases import TruthCase
from tests.truth.fourth import MACHINES, MASS_POINT_M, make_unseen_case
from vehicle.identification.diagnosis.diagnose import diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis
from vehicle.identification.logs.reader import build_log
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.identification.replay.horizon_errors import compute_horizon_errors, sum_squared_errors_by_run
from vehicle.identification.replay.rig import build_rig_and_corrections
from vehicle.model.tractor import Tractor, load_tractor

REFERENCES = {"third": "third_draw", "fourth": "fourth_cases", "fifth": "fifth_cases", "sixth": "sixth_cases"}
"""References and the modules that draw their cases."""
HORIZONS_S, UNSEEN_SEED, UNSEEN_RUNS = (5.0, 20.0), 500_000, 5
Errors = dict[str, dict[str, float]]


def draw_cases(reference: str, seed: int, kinds: Collection[str] | None = None) -> list[TruthCase]:
    """The cases of a seed by one of REFERENCES."""
    module = importlib.import_module(f"tests.truth.{REFERENCES[reference]}")
    cases: list[TruthCase] = getattr(module, f"draw_{reference}_cases")(seed, kinds)
    return cases


def make_logs(reference: str, case: TruthCase) -> list[pd.DataFrame]:
    """The logs of a case."""
    make: Callable[[TruthCase], list[pd.DataFrame]] = getattr(
        importlib.import_module(f"tests.truth.{reference}"), f"make_{reference}_logs"
    )
    return make(case)


def name_case(reference: str, case: TruthCase) -> str:
    """What tells a case from all others of its reference."""
    parts = [*case.effects, *(f"{law.effect}:{law.kind}" for law in case.laws), *(fault.id for fault in case.faults)]
    parts += [f"{name}:{','.join(list_clock_fields(clock))}" for name, clock in case.columns.items()]
    parts += list(case.outside)
    return f"{reference} {case.kind} {'+'.join(parts) or 'nothing'} {case.programme} {case.rate_hz:g} Hz {case.seed}"


def list_clock_fields(clock: object) -> list[str]:
    """Fields of a column's clock that are not neutral."""
    return [field.name for field in dataclasses.fields(clock) if getattr(clock, field.name) != field.default]  # type: ignore[arg-type]


def load_case_tractor(reference: str, case: TruthCase) -> Tractor:
    """The tractor file that a case is diagnosed with: the measured tractor, or a lawn tractor of its own geometry."""
    tractor = load_tractor("eg105")
    if reference != "fourth" or case.programme != "lawn":
        return tractor
    m, ahead = MACHINES["lawn"], MASS_POINT_M["lawn"]
    radius = {"right": [m.right_c, m.right_p], "left": [m.left_c, m.left_p]}
    sizes = {"name": "lawn tractor", "mass_kg": m.mass + m.axle_mass, "front_axle_m": m.base - ahead,
             "rear_axle_m": ahead, "track_m": m.track, "length_m": 1.8, "width_m": 1.0, "rear_overhang_m": 0.3,
             "antenna_forward_m": ahead, "radius": {"soil": radius}, "source": {}}  # fmt: skip
    return Tractor.model_validate({**tractor.model_dump(), **sizes})


def diagnose_frames(frames: Sequence[pd.DataFrame], tractor: Tractor) -> Diagnosis:
    """The diagnosis of logs as they are, on soil."""
    return diagnose_logs([build_log(frame, frame.attrs["name"]) for frame in frames], tractor, "soil")


def build_record(reference: str, case: TruthCase, vary: bool = False) -> Record:
    """What was hidden and said in a case; `error` in the place of an answer that never came."""
    head = describe_case(reference, case)
    begun = time.process_time()
    try:
        frames, tractor = make_logs(reference, case), load_case_tractor(reference, case)
        head["faults"] = describe_faults(case, frames)
        found = diagnose_frames(frames, tractor)
        head |= describe_diagnosis(found)
        head["unseen"] = measure_unseen(reference, case, tractor, found)
        if vary:
            head["varied"] = {how: describe_variation(frames, how, tractor) for how in VARIATIONS}
    except Exception as error:  # a set that breaks the diagnosis is a result, and must not end a run of hours
        head["error"] = f"{type(error).__name__}: {error}"
    return {**head, "cpu_s": round(time.process_time() - begun, 2)}


def describe_case(reference: str, case: TruthCase) -> Record:
    """What a case hides, as JSON has it."""
    columns = {
        name: {key: getattr(clock, key) for key in list_clock_fields(clock)} for name, clock in case.columns.items()
    }
    return {
        "key": name_case(reference, case), "reference": reference, "kind": case.kind, "seed": case.seed,
        "programme": case.programme, "rate_hz": case.rate_hz, "hidden": replace_infinite(case.effects),
        "clocks": columns, "laws": [dataclasses.asdict(law) for law in case.laws], "outside": dict(case.outside),
        "allowed": sorted(case.allowed), "wanted": sorted(case.wanted), "hint_words": list(case.hint_words),
        "faults": [], "named": [], "said": [],
    }  # fmt: skip


def describe_faults(case: TruthCase, frames: Sequence[pd.DataFrame]) -> list[Record]:
    """Faults with the name of their run and their onset in the time of its log."""
    out = []
    for fault in case.faults:
        frame = frames[fault.run]
        start = float(frame["time_s"].iloc[0])
        to_s = None if fault.to_s is None else start + fault.to_s
        out.append({"id": fault.id, "run": frame.attrs["name"], "from_s": start + fault.from_s, "to_s": to_s})
    return out


def describe_diagnosis(found: Diagnosis) -> Record:
    """All of a diagnosis that is counted; what a diagnosis lacks is empty."""
    said = []
    for finding in found.findings:
        law = getattr(finding, "law", None)
        said.append({
            "id": finding.id, "status": finding.status, "value": finding.value, "interval": finding.interval,
            "visible": finding.smallest_visible, "equivalent_to": list(finding.equivalent_to),
            "law": None if law is None else {"kind": law.kind, "values": dict(law.values)},
        })  # fmt: skip
    out: Record = replace_infinite({
        "named": list(found.named), "said": said, "unexplained": found.unexplained_share,
        "depends_on": list(found.depends_on), "next_drive": found.next_drive.id if found.next_drive else None,
        "before": list_errors(found.before), "after": list_errors(found.after),
        "columns": [dataclasses.asdict(one) for one in getattr(found, "columns", ())],
        "faults_said": [dataclasses.asdict(one) for one in getattr(found, "faults", ())],
        "unlike": [one.name for one in getattr(found, "runs", ()) if one.unlike],
        "hints": [dataclasses.asdict(one) for one in getattr(found, "hints", ())],
        "holdout": describe_holdout(getattr(found, "holdout", None)), "savable": getattr(found, "is_savable", True),
        "notes": list(found.notes), "headline": found.headline,
    })  # fmt: skip
    return out


def describe_holdout(holdout: Any) -> Record | None:
    """Errors before and after on runs that the diagnosis held out itself."""
    if holdout is None:
        return None
    return {"runs": list(holdout.runs), "before": list_errors(holdout.before), "after": list_errors(holdout.after),
            "helps": holdout.helps}  # fmt: skip


def list_errors(errors: Mapping[float, Any]) -> Errors:
    """Errors (cm) at HORIZONS_S: across, along and both together."""
    return {
        f"{horizon:g}": {"cross": errors[horizon].cross_cm, "along": errors[horizon].along_cm,
                         "both": math.hypot(errors[horizon].cross_cm, errors[horizon].along_cm)}
        for horizon in HORIZONS_S if horizon in errors
    }  # fmt: skip


def measure_unseen(reference: str, case: TruthCase, tractor: Tractor, found: Diagnosis) -> Record:
    """Errors on runs that the diagnosis never saw, by the tractor of the file and by the one it made."""
    unseen = make_unseen_case(case, case.seed + UNSEEN_SEED)
    frames = make_logs(reference, unseen)[:UNSEEN_RUNS]
    return {"before": measure_replay(frames, tractor), "after": measure_replay(frames, found.tractor)}


def measure_replay(frames: Sequence[pd.DataFrame], tractor: Tractor) -> Errors:
    """Open-loop errors of a tractor on logs, by the commands."""
    logs = [build_log(frame, frame.attrs["name"]) for frame in frames]
    dataset = build_dataset(logs, (tractor.antenna_forward_m, tractor.antenna_right_m))
    rig, settings = build_rig_and_corrections(tractor, "soil", dataset.origin)
    squares = sum_squared_errors_by_run(dataset, rig, settings)
    return list_errors(compute_horizon_errors(squares))


def describe_variation(frames: Sequence[pd.DataFrame], how: str, tractor: Tractor) -> Record:
    """What is said of the same logs written down another way."""
    try:
        found = describe_diagnosis(diagnose_frames(vary_logs(frames, how), tractor))
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
