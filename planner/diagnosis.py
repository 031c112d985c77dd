"""A diagnosis from files to figures: reading, diagnosing, and what the extended tractor changes in a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from planner.errors import HeadlandError, ScenarioError, about, named
from vehicle.layout import WORKING
from vehicle.measured.answer.demo import Hidden, demo_logs, draw_hidden
from vehicle.measured.answer.diagnose import Progress
from vehicle.measured.answer.diagnose import diagnose as find_causes
from vehicle.measured.answer.verdict import Diagnosis, PlanGain
from vehicle.measured.logs.reading import read_logs
from vehicle.measured.logs.record import Log
from vehicle.measured.logs.size import as_driven as driven_size
from vehicle.measured.logs.size import refuse_other
from vehicle.tractor import Tractor, as_tractor

if TYPE_CHECKING:
    from planner.site import Site
    from vehicle.run import Run

PLAN_FIELD = "iwamizawa"
PLAN_WIDTH_M = 3.0
SMALLEST_M = 1.0
PATIENCE = 3.0  # times as long as the plan takes by the file: whoever is not done by then never will be


Logs = Sequence[Log | str | Path] | Log | str | Path
"""Logs, or one of them."""


def diagnose(
    logs: Logs,
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    fixes: Sequence[str] = (),
    as_driven: bool = False,
    progress: Progress | None = None,
) -> Diagnosis:
    """What the simulation of a tractor gets wrong in measured logs, why, and what mending it gains.

    `logs` are one or more Log objects, or files and glob patterns, which are read with `fixes`; `tractor` is an
    object, a name or a file. Logs that cannot be of this tractor are refused with the size that they suggest, or
    diagnosed with a tractor of that size where `as_driven` says so. `progress` is called with (done, an estimate of
    all). Raises LogError and VehicleError.
    """
    with about("tractor"):
        machine = as_tractor(tractor)
    with about("logs"):
        read = logs_of(logs, fixes, machine)
    if as_driven:
        machine = driven_size(read, machine, ground)
    refuse_other(read, machine, ground)
    return _with_gain(find_causes(read, machine, ground, progress), machine)


def demonstrate(
    *,
    tractor: Tractor | str | Path = "eg105",
    ground: str = "soil",
    seed: int = 1,
    hide: str | None = None,
    progress: Progress | None = None,
) -> tuple[Diagnosis, Hidden]:
    """The diagnosis of made logs with an effect hidden in them, drawn from `seed` or named by `hide`; and the effect.

    Raises ScenarioError for a seed below 0 and VehicleError for an effect that cannot be hidden.
    """
    if seed < 0:
        raise ScenarioError(f"{named('seed')} {seed} is negative; use 0 or more.")
    with about("tractor"):
        machine = as_tractor(tractor)
    with about("hide"):
        hidden = draw_hidden(seed, machine, hide)
    return _with_gain(find_causes(demo_logs(hidden, machine, ground, seed), machine, ground, progress), machine), hidden


def logs_of(logs: Logs, fixes: Sequence[str], machine: Tractor) -> list[Log]:
    """Logs as objects: those that are, then those read from files, together, as they share an origin."""
    if isinstance(logs, str | Path | Log):
        logs = [logs]
    if not logs:
        raise ScenarioError(f"No log is given; name one file or more in {named('logs')}.")
    made = [log for log in logs if isinstance(log, Log)]
    files = [Path(log) if Path(log).exists() else log for log in logs if not isinstance(log, Log)]
    return [*made, *(read_logs(files, fixes, machine.wheelbase_m) if files else ())]


def _with_gain(answer: Diagnosis, machine: Tractor) -> Diagnosis:
    """The answer with what the extended tractor makes of a small plan, or the reason why there is none."""
    gain, why_not = plan_gain(machine, answer.tractor)
    return replace(answer, plan=gain, notes=(*answer.notes, *([why_not] if why_not else [])))


def plan_gain(before: Tractor, after: Tractor) -> tuple[PlanGain | None, str]:
    """A small plan made for a tractor, driven by it and by the extended one.

    Turning radius, headland and legs are those of the tractor as it was; the extended one drives the same plan as
    the logs say the real one would. Without a plan the second value says why, in a sentence, if there is more to say
    than that nothing was added.
    """
    if (after.effects, after.rest) == (before.effects, before.rest):
        kept = after.effects or after.rest
        return None, "The tractor stays as its file has it, so no plan was driven to compare." if kept else ""
    if before.length_m < SMALLEST_M:
        return None, (
            f"No plan was driven to compare: {before.name} is {before.length_m:g} m long, and plans are for tractors "
            f"of {SMALLEST_M:g} m or more."
        )
    # What plans fields is loaded for logs that have come so far.
    from planner.candidates.evaluate import Candidate, run_candidate
    from planner.scenario import Scenario
    from planner.site import prepare
    from vehicle.run import DONE
    from vehicle.world import World

    try:
        site = prepare(Scenario(field=PLAN_FIELD, width_m=PLAN_WIDTH_M, tracks_only=True), tractor=before)
        first = run_candidate(site, Candidate("row-by-row", 1)).run
    except HeadlandError as refusal:
        return None, f"No plan was driven to compare: {str(refusal).rstrip('.')}."
    world = World(first.plan, after, site.implement, seed=site.scenario.seed)
    second = world.run(max_time_s=PATIENCE * float(first.time_s[-1]))
    runs = [first, second]
    if after.rest is not None:
        world = World(first.plan, after.model_copy(update={"rest": None}), site.implement, seed=site.scenario.seed)
        runs.append(world.run(max_time_s=PATIENCE * float(first.time_s[-1])))
    times = [float(run.duration_s) if run.outcome == DONE else None for run in runs]
    lateral = [_lateral_cm(site, run) for run in runs]
    gain = PlanGain(PLAN_FIELD, times[0], times[1], lateral[0], lateral[1])
    if len(runs) > 2:
        slower = times[1] - times[2] if times[1] is not None and times[2] is not None else None
        gain = replace(gain, left_s=slower, left_cm=lateral[1] - lateral[2])
    return gain, ""


def _lateral_cm(site: Site, run: Run) -> float:
    """Root mean square distance (cm) of the guided point from the track nearest to it, while working."""
    from planner.ground.measure import guided_point

    points = guided_point(run, site, 0)[run.status(0) == WORKING]
    starts = np.array([track.start for track in site.layout.tracks])
    ends = np.array([track.end for track in site.layout.tracks])
    along = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    off = points[:, None, :] - starts[None]
    cross = np.abs(off[:, :, 0] * along[None, :, 1] - off[:, :, 1] * along[None, :, 0]).min(axis=1)
    return 100.0 * float(np.sqrt(np.mean(cross**2)))
