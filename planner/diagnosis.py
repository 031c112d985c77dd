"""A diagnosis from files to figures: reading, diagnosing, and what the extended tractor changes in a plan."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from planner.errors import HeadlandError, ScenarioError
from planner.evaluate import Candidate, run_candidate
from planner.scenario import Scenario
from planner.site import Site, prepare
from vehicle.layout import WORKING
from vehicle.measured.answer.demo import Hidden, demo_logs, draw_hidden
from vehicle.measured.answer.diagnose import Progress, diagnose
from vehicle.measured.answer.verdict import Diagnosis, PlanGain
from vehicle.measured.logs.reading import read_logs
from vehicle.measured.logs.record import Log
from vehicle.run import DONE, Run
from vehicle.tractor import Tractor, load_tractor
from vehicle.world import World

PLAN_FIELD = "iwamizawa"
PLAN_WIDTH_M = 3.0
SMALLEST_M = 1.0
PATIENCE = 3.0  # times as long as the plan takes by the file: whoever is not done by then never will be


@dataclass(frozen=True)
class Order:
    """What to diagnose: log files or, with none, a demonstration drawn from `seed`."""

    files: tuple[str, ...]
    tractor: str = "eg105"
    ground: str = "soil"
    fixes: tuple[str, ...] = ()
    demo: bool = False
    seed: int = 1
    hide: str | None = None


def diagnosed(order: Order, progress: Progress | None = None) -> tuple[Diagnosis, Hidden | None]:
    """The diagnosis of an order, and what the demonstration had hidden.

    Raises ScenarioError for an order that asks for both or neither, LogError and VehicleError for its parts.
    """
    if order.demo == bool(order.files):
        raise ScenarioError("Give log files, or --demo for a demonstration; not both and not neither.")
    tractor = load_tractor(order.tractor)
    hidden = draw_hidden(order.seed, tractor, order.hide) if order.demo else None
    logs = _logs(order, tractor, hidden)
    found = diagnose(logs, tractor, order.ground, progress)
    gain, why_not = plan_gain(order.tractor, tractor, found.tractor)
    return replace(found, plan=gain, notes=(*found.notes, *([why_not] if why_not else []))), hidden


def _logs(order: Order, tractor: Tractor, hidden: Hidden | None) -> list[Log]:
    if order.demo:
        return demo_logs(hidden, tractor, order.ground, order.seed)
    return read_logs(
        [Path(name) if Path(name).exists() else name for name in order.files], order.fixes, tractor.wheelbase_m
    )


def plan_gain(where: str, before: Tractor, after: Tractor) -> tuple[PlanGain | None, str]:
    """A small plan made for a tractor (`where` is its name or file), driven by it and by the extended one.

    Turning radius, headland and legs are those of the tractor of the file; the extended one drives the same plan as
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
    try:
        site = prepare(Scenario(field=PLAN_FIELD, width_m=PLAN_WIDTH_M, tractor=where))
        first = run_candidate(site, Candidate("row-by-row", 1)).run
    except HeadlandError as refusal:
        return None, f"No plan was driven to compare: {str(refusal).rstrip('.')}."
    world = World(first.plan, after, site.implement, seed=site.scenario.seed)
    second = world.run(max_time_s=PATIENCE * float(first.time_s[-1]))
    times = [float(run.duration_s) if run.outcome == DONE else None for run in (first, second)]
    lateral = [_lateral_cm(site, run) for run in (first, second)]
    return PlanGain(PLAN_FIELD, times[0], times[1], lateral[0], lateral[1]), ""


def _lateral_cm(site: Site, run: Run) -> float:
    """Root mean square distance (cm) of the guided point from the track nearest to it, while working."""
    from planner.measure import guided_point

    points = guided_point(run, site, 0)[run.status(0) == WORKING]
    starts = np.array([track.start for track in site.layout.tracks])
    ends = np.array([track.end for track in site.layout.tracks])
    along = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    off = points[:, None, :] - starts[None]
    cross = np.abs(off[:, :, 0] * along[None, :, 1] - off[:, :, 1] * along[None, :, 0]).min(axis=1)
    return 100.0 * float(np.sqrt(np.mean(cross**2)))
