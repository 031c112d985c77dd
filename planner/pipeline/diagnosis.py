"""A diagnosis from files to results, with runs that are held out and the change of a plan by the extended tractor.

A held-out run has no part in what is found; what was found is then measured on it (`verdict.holdout`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from fnmatch import fnmatchcase
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

import numpy as np

import reports.diagnosis.page  # noqa: F401  # how a diagnosis is shown
from fields.arrays import Flags
from planner.errors import HeadlandError, RequestError, attach_parameter, mark_parameter
from planner.pipeline.log_ground import HeightFile, add_known_ground, describe_known_ground
from planner.pipeline.next_drive_plan import build_next_drive_plan
from planner.pipeline.replays import build_evidence
from planner.risk.assessment import TIMEOUT_FACTOR
from reports.common.rendering import ShownResult
from vehicle.identification.diagnosis.demo_logs import HiddenEffect, draw_hidden_effect, simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import ReportProgress, diagnose_logs
from vehicle.identification.diagnosis.other_vehicles import refuse_other_vehicle, scale_to_logs
from vehicle.identification.diagnosis.results import Diagnosis, PlanGain
from vehicle.identification.diagnosis.saving import measure_holdout
from vehicle.identification.errors import LogError
from vehicle.identification.logs.reader import read_logs
from vehicle.identification.logs.schema import SHORTEST_SEGMENT_S, Log
from vehicle.identification.logs.table import MappingSource
from vehicle.model.tractor import Tractor, resolve_tractor
from vehicle.records import WORKING

if TYPE_CHECKING:
    from planner.evaluation.context import PlanningContext
    from vehicle.missions.run import SimulationRun


PLAN_FIELD = "iwamizawa"
PLAN_WIDTH_M = 3.0
MIN_TRACTOR_LENGTH_M = 1.0
AUTO = "auto"
LOG_SUFFIXES = (".csv", ".parquet", ".pq")
HELD_OUT_SHARE = 0.25  # of the runs: enough stay to find causes in
SHORTEST_PART_S = 4.0 * SHORTEST_SEGMENT_S  # one piece of the longest horizon
HeldOut = str | int | Sequence[str]
"""Names or patterns of runs, #1 for the first of them; or how many runs, or AUTO: they are then chosen here."""
HeldOutSplit = tuple[list[Log], list[Log], str]
"""Logs for the diagnosis, logs that are held out, and a sentence that says how they were chosen."""

Logs = Sequence[Log | str | Path] | Log | str | Path
"""One or more logs."""


@dataclass(frozen=True, eq=False, repr=False)
class TractorDiagnosis(ShownResult, Diagnosis):
    """A diagnosis that a notebook shows: verdict, errors before and after, effects.

    `to_pandas()` has a row per effect; `plot()` draws the error over the length of the pieces; `save()` writes .json as
    `headland diagnose --json` does, or the page, .html.
    """


def diagnose(
    logs: Logs,
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    fixes: Sequence[str] = (),
    mapping: MappingSource = None,
    use_driven_size: bool = False,
    holdout: HeldOut | None = None,
    heights: HeightFile | str | Path | None = None,
    progress: ReportProgress | None = None,
) -> TractorDiagnosis:
    """Return what the simulation of a tractor gets wrong in measured logs, why, and the gain of correcting it.

    Example:

        diagnosis = headland.diagnose(["run1.csv", "run2.csv"], tractor="eg105")
        diagnosis.headline                 # the verdict in one or two sentences
        diagnosis.to_pandas()              # a row per effect: status, value with interval, gain
        diagnosis.save("diagnosis.html")   # the page; .json is what headland diagnose --json prints

    Returns a TractorDiagnosis: `findings` (every effect), `before` and `after` (errors by length of the pieces),
    `tractor` (the extended one, to plan with), `next_drive` and more.

    `logs` are one or more Log objects, or files and glob patterns, which are read with `fixes` and `mapping`: the
    columns of the files by ours ({"speed_kmh": "v"}), or a file of them. `tractor` is an object, a name or a file. Logs
    that cannot be of this tractor are refused with the size that they suggest, or diagnosed with a tractor of that size
    with `use_driven_size`. Runs in `holdout` (names or patterns, "#2" for the second, how many,
    or "auto") have no part in anything; the result's `holdout` has their errors before and after, and `is_savable` says
    whether the extended tractor is worth saving. `heights` are those of the ground, a file as for plans; without it,
    `elevation_m` of the logs counts where they lack roll or pitch. `progress` is called with (done, an estimate of
    all). Raises LogError (for columns under other names a ColumnError, whose `mapping` they suggest), VehicleError and,
    for heights, ElevationError.
    """
    with attach_parameter("tractor"):
        machine = resolve_tractor(tractor)
    with attach_parameter("logs"):
        parsed_logs = collect_logs(logs, fixes, machine, mapping)
    parsed_logs = add_known_ground(parsed_logs, heights)
    with attach_parameter("holdout"):
        parsed_logs, unseen_logs, words = split_held_out_runs(parsed_logs, holdout)
    if use_driven_size:
        machine = scale_to_logs(parsed_logs, machine, ground)
    refuse_other_vehicle(parsed_logs, machine, ground)
    return _explain_logs(parsed_logs, machine, ground, progress, unseen_logs, words)


def diagnose_demo(
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    seed: int = 1,
    hidden_effect: str | None = None,
    holdout: HeldOut | None = None,
    progress: ReportProgress | None = None,
) -> tuple[TractorDiagnosis, HiddenEffect]:
    """Diagnose simulated logs with a hidden effect, drawn from `seed` or named by `hidden_effect`; returns both.

    `holdout` is that of `diagnose`. Raises RequestError for a seed below 0 and VehicleError for an effect that cannot
    be hidden.
    """
    if seed < 0:
        raise RequestError(f"{mark_parameter('seed')} {seed} is negative; use 0 or more.")
    with attach_parameter("tractor"):
        machine = resolve_tractor(tractor)
    with attach_parameter("hide"):
        hidden = draw_hidden_effect(seed, machine, hidden_effect)
    demo_logs = simulate_demo_logs(hidden, machine, ground, seed)
    with attach_parameter("holdout"):
        logs, unseen_logs, words = split_held_out_runs(demo_logs, holdout)
    return _explain_logs(logs, machine, ground, progress, unseen_logs, words), hidden


def split_held_out_runs(logs: Sequence[Log], held_out: HeldOut | None) -> HeldOutSplit:
    """Split logs into those to diagnose and those that are held out, none without being asked.

    With AUTO, a quarter of the runs, spread evenly over them; of a single run, its last quarter. Raises LogError for a
    name that is no run, a count that leaves none, and a single run that is too short.
    """
    if held_out is None:
        return list(logs), [], ""
    words = [str(held_out)] if isinstance(held_out, str | int) else [str(word) for word in held_out]
    parts = [part.strip() for word in words for part in word.split(",") if part.strip()]
    if not parts:
        raise LogError(f"No run is held out; give names of runs, how many, or {AUTO}.")
    names = [log.name for log in logs]
    count = _read_count(parts, names)
    if count is None:
        chosen = sorted({number for part in parts for number in _find_runs(part, names)})
        reason = "as asked"
    elif len(logs) == 1 and parts == [AUTO]:
        return _split_single_run(logs[0])
    else:
        chosen = _spread_evenly(round(HELD_OUT_SHARE * len(logs)) or 1 if count == 0 else count, len(logs))
        reason = "chosen evenly over all runs"
    if len(chosen) >= len(logs):
        runs = "1 run" if len(logs) == 1 else f"{len(logs)} runs"
        raise LogError(f"{len(chosen)} of {runs} held out leave no run to diagnose; hold out fewer or add logs.")
    return (
        [log for number, log in enumerate(logs) if number not in chosen],
        [logs[number] for number in chosen],
        f"Held out, {reason}: {', '.join(names[number] for number in chosen)}.",
    )


def _read_count(parts: Sequence[str], names: Sequence[str]) -> int | None:
    """Return how many runs to choose, 0 for AUTO, None for names; a run of that name comes first."""
    (part, *others) = parts
    if others or part in names:
        return None
    if part == AUTO:
        return 0
    if not part.isdecimal():
        return None
    if int(part) == 0:
        raise LogError("0 runs held out say nothing; give 1 or more.")
    return int(part)


def _find_runs(pattern: str, names: Sequence[str]) -> list[int]:
    """Return the runs that a name, a file or a pattern means; raises LogError where there is none."""
    if pattern.startswith("#") and pattern[1:].isdecimal() and 1 <= int(pattern[1:]) <= len(names):
        return [int(pattern[1:]) - 1]
    path = PurePath(pattern)
    wanted = (pattern, path.stem if path.suffix.lower() in LOG_SUFFIXES else path.name)
    found = [number for number, name in enumerate(names) if name in wanted]
    found = found or [number for number, name in enumerate(names) if any(fnmatchcase(name, one) for one in wanted)]
    if not found:
        known = f"#1 to #{len(names)}" if len(names) > 6 else ", ".join(names)
        raise LogError(f"{pattern!r} is none of the runs ({known}); hold out runs that are among the logs.")
    return found


def _spread_evenly(count: int, runs: int) -> list[int]:
    """Return the middle run of each of `count` equal parts."""
    if count >= runs:
        return list(range(runs))
    return [math.floor((number + 0.5) * runs / count) for number in range(count)]


def _split_single_run(log: Log) -> HeldOutSplit:
    """Hold out the last part of a run."""
    first_s, last_s = (float(log.time_s[log.used][end]) for end in (0, -1))
    from_s = last_s - HELD_OUT_SHARE * (last_s - first_s)
    if last_s - from_s < SHORTEST_PART_S:
        raise LogError(
            f"{log.name} lasts {last_s - first_s:.0f} s; a part of a single run can be held out from "
            f"{SHORTEST_PART_S / HELD_OUT_SHARE:.0f} s on; log a second run."
        )
    is_late = log.time_s >= from_s
    return (
        [_slice_log(log, ~is_late, log.name)],
        [replace(_slice_log(log, is_late, f"{log.name} (last quarter)"), gated=())],
        f"Held out, as there is one run only: the last {last_s - from_s:.0f} s of {log.name}.",
    )


def _slice_log(log: Log, rows: Flags, name: str) -> Log:
    """Return the log of some rows, its segments numbered from 0."""
    columns: dict[str, Any] = {
        each.name: column[rows]
        for each in fields(log)
        if isinstance(column := getattr(log, each.name), np.ndarray) and len(column) == len(rows)
    }
    part = replace(log, name=name, **columns)
    numbers = np.unique(part.segment[part.segment >= 0])
    segment = np.where(part.segment >= 0, np.searchsorted(numbers, part.segment), -1)
    return replace(part, segment=segment)


def _explain_logs(
    logs: Sequence[Log], machine: Tractor, ground: str, progress: ReportProgress | None, unseen_logs: Sequence[Log],
    words: str,
) -> TractorDiagnosis:  # fmt: skip
    """Diagnose logs; add what held-out runs, chosen as `words` say, show, what their replay shows, the plan of the next
    drive, and the change of a plan."""
    diagnosis = describe_known_ground(diagnose_logs(logs, machine, ground, progress), logs)
    values = {each.name: getattr(diagnosis, each.name) for each in fields(Diagnosis)}
    if diagnosis.undiagnosed_reason:
        return TractorDiagnosis(**values)
    if unseen_logs:
        with attach_parameter("holdout"):
            holdout = measure_holdout(unseen_logs, machine, diagnosis.tractor, ground)
        values["holdout"] = replace(holdout, words=words, is_requested=True)
    values["evidence"] = build_evidence(logs, machine, diagnosis.tractor, ground)
    if diagnosis.next_drive is not None:
        values["next_drive_plan"] = build_next_drive_plan(diagnosis.next_drive, logs, diagnosis.tractor, ground)
    values["plan"], why_not = measure_plan_gain(machine, diagnosis.tractor)
    values["notes"] = (*diagnosis.notes, *([why_not] if why_not else []))
    return TractorDiagnosis(**values)


def collect_logs(logs: Logs, fixes: Sequence[str], machine: Tractor, mapping: MappingSource = None) -> list[Log]:
    """Return given logs and those of files, read together where the first file stands, as they share an origin."""
    if isinstance(logs, str | Path | Log):
        logs = [logs]
    if not logs:
        raise RequestError(f"No log is given; name one file or more in {mark_parameter('logs')}.")
    collected = [log for log in logs if isinstance(log, Log)]
    files = [(place, log) for place, log in enumerate(logs) if not isinstance(log, Log)]
    if files:
        first, paths = files[0][0], [Path(log) if Path(log).exists() else log for _, log in files]
        collected[first:first] = read_logs(paths, fixes, machine.wheelbase_m, mapping)
    return collected


def measure_plan_gain(original: Tractor, extended: Tractor) -> tuple[PlanGain | None, str]:
    """Simulate a small plan made for a tractor with it and with the extended one.

    Turning radius, headland and legs are those of the original tractor; the extended one drives the same plan as the
    logs say the real one would. Without a plan the second value is a sentence with the reason, empty if nothing was
    added.
    """
    if (extended.effects, extended.discrepancy_model) == (original.effects, original.discrepancy_model):
        has_effects = extended.effects or extended.discrepancy_model
        return None, "The tractor stays as its file has it, so no plan was driven to compare." if has_effects else ""
    if original.length_m < MIN_TRACTOR_LENGTH_M:
        return None, (
            f"No plan was driven to compare: {original.name} is {original.length_m:g} m long, and plans are for "
            f"tractors of {MIN_TRACTOR_LENGTH_M:g} m or more."
        )
    # Planning is only loaded here, once the logs have been diagnosed.
    from planner.evaluation.candidates.evaluate import Candidate, run_candidate
    from planner.evaluation.preparation import prepare_context
    from planner.evaluation.work_order import WorkOrder
    from planner.request.plan_request import PlanRequest
    from vehicle.missions.run import DONE
    from vehicle.sim.world import World

    try:
        request = PlanRequest(field=PLAN_FIELD, width_m=PLAN_WIDTH_M, no_headland=True)
        context = prepare_context(WorkOrder(request, tractor=original))
        first = run_candidate(context, Candidate("row-by-row", 1)).run
    except HeadlandError as refusal:
        return None, f"No plan was driven to compare: {str(refusal).rstrip('.')}."
    machines = [extended]
    if extended.discrepancy_model is not None:
        machines.append(extended.model_copy(update={"discrepancy_model": None}))
    worlds = [World(first.plan, one, context.implement, seed=context.request.seed) for one in machines]
    runs = [first, *(world.run(max_time_s=TIMEOUT_FACTOR * float(first.time_s[-1])) for world in worlds)]
    times = [float(run.duration_s) if run.outcome == DONE else None for run in runs]
    lateral = [_measure_lateral_cm(context, run) for run in runs]
    gain = PlanGain(PLAN_FIELD, times[0], times[1], lateral[0], lateral[1])
    if len(runs) > 2:
        slower = times[1] - times[2] if times[1] is not None and times[2] is not None else None
        gain = replace(gain, discrepancy_s=slower, discrepancy_cm=lateral[1] - lateral[2])
    return gain, ""


def _measure_lateral_cm(context: PlanningContext, run: SimulationRun) -> float:
    """Return the root mean square distance (cm) of the guided point from the nearest track, while working."""
    from planner.evaluation.ground.coverage import compute_guided_path

    points = compute_guided_path(run, context, 0)[run.get_statuses(0) == WORKING]
    starts = np.array([swath.start_m for swath in context.layout.swaths])
    ends = np.array([swath.end_m for swath in context.layout.swaths])
    directions = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    offsets = points[:, None, :] - starts[None]
    cross = np.abs(offsets[:, :, 0] * directions[None, :, 1] - offsets[:, :, 1] * directions[None, :, 0]).min(axis=1)
    return 100.0 * float(np.sqrt(np.mean(cross**2)))
