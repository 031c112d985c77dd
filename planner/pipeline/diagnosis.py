"""A diagnosis from files to results, with the change of a plan by the extended tractor; and the replay of one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import reports.diagnosis.page  # noqa: F401  # how a diagnosis is shown
from planner.errors import HeadlandError, RequestError, attach_parameter, mark_parameter
from planner.pipeline.diagnosis_evidence import align_path, build_evidence
from planner.pipeline.held_out_runs import HeldOut, split_held_out_runs
from planner.pipeline.log_ground import HeightFile, add_known_ground, describe_known_ground
from planner.pipeline.next_drive_plan import build_next_drive_plan
from planner.risk.assessment import TIMEOUT_FACTOR
from reports.common.rendering import ResultView, ShownResult
from reports.diagnosis.replay import build_replay_view
from vehicle.identification.diagnosis.demo_logs import HiddenEffect, draw_hidden_effect, simulate_demo_logs
from vehicle.identification.diagnosis.diagnose import ReportProgress, diagnose_logs
from vehicle.identification.diagnosis.results import Diagnosis, PlanGain, ReplayedSegment, ReplayResult
from vehicle.identification.diagnosis.saving import measure_holdout
from vehicle.identification.logs.reader import list_remarks, read_log, read_logs
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.table import MappingSource
from vehicle.identification.logs.vehicle_size import refuse_other_vehicle, scale_to_logs
from vehicle.identification.replay.drive_segments import (
    DriveSegment,
    ReplayRig,
    build_dataset,
    build_rig_and_corrections,
)
from vehicle.identification.replay.horizon_errors import (
    ERROR_PIECE_S,
    compute_horizon_errors,
    compute_piece_errors,
    find_piece_bounds,
    measure_dataset,
)
from vehicle.identification.replay.simulation import simulate_instruments
from vehicle.model.tractor import Settings, Tractor, resolve_tractor
from vehicle.records import WORKING

if TYPE_CHECKING:
    from planner.evaluation.context import PlanningContext
    from vehicle.missions.run import SimulationRun


PLAN_FIELD = "iwamizawa"
PLAN_WIDTH_M = 3.0
MIN_TRACTOR_LENGTH_M = 1.0

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


@dataclass(frozen=True, eq=False, repr=False)
class Replay(ShownResult):
    """A replayed run with its errors, and the remarks on the log's columns and rows.

    `to_pandas()` has a row per length of the pieces compared; `plot()` draws the measured and the simulated path;
    `save()` writes .json, .html or .png.
    """

    replayed: ReplayResult
    remarks: tuple[str, ...]

    def get_view(self) -> ResultView:
        """Paths, errors and remarks."""
        return build_replay_view(self.replayed, self.remarks)


def replay(
    log: Log | str | Path,
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    fixes: Sequence[str] = (),
    mapping: MappingSource = None,
    heights: HeightFile | str | Path | None = None,
) -> Replay:
    """Replay a log (an object, or a file read with `fixes` and `mapping`) with the effects of a tractor (object, name
    or file).

    Example:

        run = headland.replay("run.csv", tractor="eg105")
        run.replayed.errors[5.0].cross_cm  # error across over pieces of 5 s, cm
        run.to_pandas()                    # a row per length of the pieces: cross_cm, along_cm, heading_deg
        run.plot()                         # the measured and the simulated path

    Returns a Replay: `replayed` (the run with its errors and simulated paths) and `remarks` on the log. `heights` are
    as in `diagnose`: what the tractor file says per slope is then that of the ground under every row.

    Raises LogError, VehicleError and, for heights, ElevationError.
    """
    with attach_parameter("tractor"):
        machine = resolve_tractor(tractor)
    with attach_parameter("log"):
        run = log if isinstance(log, Log) else read_log(log, fixes, machine.wheelbase_m, mapping=mapping)
        (run,) = add_known_ground([run], heights)
        course = build_dataset([run], (machine.antenna_forward_m, machine.antenna_right_m))
    with attach_parameter("ground"):
        rig, settings = build_rig_and_corrections(machine, ground, course.origin)
    errors = compute_horizon_errors(measure_dataset(course, rig, settings))
    segments = tuple(_replay_segment(rig, segment, settings) for segment in course.segments)
    left_out = course.rows_read - course.rows
    replayed = ReplayResult(run.name, machine.name, tuple(settings), errors, segments, left_out)
    of_ground = course.remarks if run.ground_fall is not None else ()
    return Replay(replayed, (*list_remarks(run), *run.set_remarks, *of_ground))


def _replay_segment(rig: ReplayRig, segment: DriveSegment, settings: Settings) -> ReplayedSegment:
    antenna, heading, wheel, speed = simulate_instruments(rig, segment, settings)
    bounds = find_piece_bounds(segment.time, ERROR_PIECE_S)
    errors = compute_piece_errors(segment, antenna, heading, bounds)
    parts = tuple((rows, errors[rows]) for rows in (slice(int(i), int(j)) for i, j in zip(*bounds, strict=True)))
    return ReplayedSegment(segment, align_path(segment, antenna, heading), wheel, speed, parts)
