"""Plans cut at random moments and gone on with, against what they would have taken: time, and share of ground worked.

    python -m tests.benchmarks.going_on [--cuts 20] [--seed 1] [--maps FOLDER]

A row is a plan cut at a moment, in every second one with a machine lost. `uncut` is what the plan would have taken for
the rest: to its end, or with a machine lost what was left of each line, with the move to it, dealt so that the machines
that go on are done soonest. They end the line that they are on, and nobody drives farther than before.
"""

import argparse
import math
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from scipy import optimize

from fields.geometry.overlays import unite_areas
from planner.evaluation.ground.coverage import measure_coverage
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.going_on import cut_run, read_continued_plan
from planner.pipeline.planning import PlanningResult, plan
from planner.request.plan_request import PlanRequest
from vehicle.missions.run import SimulationRun

JOBS = (
    PlanRequest(field="denmark", width_m=6.0, tractors=(2,), strategies=("split-field",)),
    PlanRequest(field="iwamizawa", width_m=3.0, tractors=(2,), strategies=("split-field",)),
    PlanRequest(field="netherlands", width_m=6.0, tractors=(3,), strategies=("split-field",)),
    PlanRequest(field="sweden", width_m=9.0, tractors=(2,), strategies=("interleaved",), operation="sow"),
    PlanRequest(field="iwamizawa", width_m=3.0, tractors=(3,), strategies=("row-by-row",)),
)


def measure_rest_s(run: SimulationRun, cut_s: float, without: Sequence[int]) -> float:
    """What a plan takes after a moment, with all machines or without some (numbers from 1)."""
    kept_s, free_s = [], list[float]()
    for number in range(run.plan.tractors):
        *lines_s, home_s = list_left_s(run, number, cut_s)
        if number + 1 in without:
            free_s += lines_s
        else:
            kept_s.append(home_s + sum(lines_s[: None if not without else 1]))
            free_s += lines_s[1:] if without else []
    return deal_soonest_s(kept_s, free_s)


def list_left_s(run: SimulationRun, number: int, cut_s: float) -> list[float]:
    """Seconds after a moment that a tractor takes for each line, with the move to it, and for its way out at last."""
    legs, at = run.plan.missions[number].legs, run.get_leg_numbers(number)
    begun_s = [run.time_s[np.searchsorted(at, leg)] if leg <= at[-1] else math.inf for leg in range(len(legs))]
    ends_s = np.minimum([*begun_s, math.inf], run.finish_s[number])
    left_s, before = [0.0], None
    for leg, seconds in zip(legs, np.diff(np.maximum(ends_s, cut_s)).tolist(), strict=True):
        task = leg.task if leg.implement else None
        if before is not None and task != before:
            left_s.append(0.0)
        left_s[-1] += seconds
        before = task
    if before is not None:
        left_s.append(0.0)  # it ends where its last line does
    *lines_s, home_s = left_s
    return [*(seconds for seconds in lines_s if seconds > 0.0), home_s]


def deal_soonest_s(own_s: Sequence[float], free_s: Sequence[float]) -> float:
    """When machines are done that have so much of their own, and share what is free but cannot be parted."""
    own, free = len(own_s), len(free_s)
    shares = np.kron(np.array(free_s)[None], np.eye(own))
    each_once = np.kron(np.eye(free), np.ones(own))
    rows = np.block([[shares, -np.ones((own, 1))], [each_once, np.zeros((free, 1))]])
    least = np.concatenate([np.full(own, -math.inf), np.ones(free)])
    most = np.concatenate([-np.asarray(own_s), np.ones(free)])
    found = optimize.milp(
        np.eye(1, free * own + 1, free * own)[0],
        integrality=np.append(np.ones(free * own), 0.0),
        bounds=optimize.Bounds(0.0, np.append(np.ones(free * own), math.inf)),
        constraints=optimize.LinearConstraint(rows, least, most),
        options={"mip_rel_gap": 0.001},
    )
    return float(found.fun)


def measure_worked_pct(whole: PlanningResult, cut_s: float, rest: PlanningResult) -> float:
    """The share of the field worked by a plan up to a moment and by what followed (percent)."""
    assert whole.run is not None and rest.run is not None
    begun = compute_swept_area(cut_run(whole.run, cut_s), whole.context).ground
    later = compute_swept_area(rest.run, rest.context).ground
    field = whole.context.layout.field.region_without_obstacles
    worked = unite_areas(np.concatenate([begun, later]))
    return 100.0 * float(shapely.intersection(worked, field).area) / float(field.area)


def main() -> None:
    """Print a row per cut, and the worst."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cuts", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--maps", type=Path)
    given = parser.parse_args()
    random, rows, wholes = np.random.default_rng(given.seed), [], {}
    print("field        machines  cut s  lost  uncut s  rest s  more %  worked %  uncut %  less", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        for number in range(given.cuts):
            job = JOBS[number % len(JOBS)]
            if job not in wholes:
                wholes[job] = plan(job, executor=SerialExecutor())
                wholes[job].save(f"{folder}/{len(wholes) - 1}.json")
            whole, file = wholes[job], f"{folder}/{list(wholes).index(job)}.json"
            assert whole.run is not None
            cut_s = float(round(random.uniform(0.05, 0.9) * whole.run.duration_s))
            count = whole.run.plan.tractors
            lost = number % 2 == 1
            without = (int(random.integers(count)) + 1,) if lost else ()
            source = f"{file}@{int(cut_s) // 3600}:{int(cut_s) % 3600 // 60:02d}:{int(cut_s) % 60:02d}"
            continued = read_continued_plan([source], without)
            assert continued is not None
            request = replace(continued.request, strategies=("split-field",))
            uncut_s = measure_rest_s(whole.run, cut_s, without)
            start = f"{job.field:12s} {count:8d} {cut_s:6.0f} {without or '-'!s:>5s} {uncut_s:8.0f}"
            try:
                rest = plan(request, done=source, without=without, executor=SerialExecutor())
            except Exception as refusal:
                print(start, refusal, flush=True)
                continue
            if rest.run is None:
                print(start, [one.reason for one in rest.ranking.plans], flush=True)
                continue
            worked_pct = measure_worked_pct(whole, cut_s, rest)
            whole_pct = measure_coverage(whole.run, whole.context).worked_pct
            rows.append((100.0 * (rest.run.duration_s / uncut_s - 1.0), whole_pct - worked_pct))
            print(
                f"{start} {rest.run.duration_s:7.0f} {rows[-1][0]:7.1f} {worked_pct:9.2f} {whole_pct:8.2f} "
                f"{rows[-1][1]:5.2f}",
                flush=True,
            )
            if given.maps is not None:
                rest.save(str(given.maps / f"{number:02d}-{job.field}.png"))
    more_pct, less = np.array(rows).T
    print(f"{len(rows)} of {given.cuts}: {more_pct.max():.1f} % more at worst, {less.max():.2f} points less at worst")


if __name__ == "__main__":
    main()
