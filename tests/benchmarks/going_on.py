"""Plans cut at random moments and gone on with, against what they would have taken: time, and share of ground worked.

    python -m tests.benchmarks.going_on [--cuts 20] [--seed 1] [--maps FOLDER]

A row is a plan cut at a moment, in every second one with a machine lost. `uncut` is what the plan would have taken for
the rest: to its end, or with a machine lost the seconds that all machines had left, shared by those that go on.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from fields.geometry.overlays import unite_areas
from planner.evaluation.ground.coverage import measure_coverage
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.going_on import cut_run, read_continued_plan
from planner.pipeline.planning import PlanningResult, plan
from planner.request.plan_request import PlanRequest

JOBS = (
    PlanRequest(field="denmark", width_m=6.0, tractors=(2,), strategies=("split-field",)),
    PlanRequest(field="iwamizawa", width_m=3.0, tractors=(2,), strategies=("split-field",)),
    PlanRequest(field="netherlands", width_m=6.0, tractors=(3,), strategies=("split-field",)),
    PlanRequest(field="sweden", width_m=9.0, tractors=(2,), strategies=("interleaved",), operation="sow"),
    PlanRequest(field="iwamizawa", width_m=3.0, tractors=(3,), strategies=("row-by-row",)),
)


def measure_rest_s(finish_s: np.ndarray, cut_s: float, lost: bool) -> float:
    """What a plan takes after a moment, with all machines or shared by all but one."""
    left_s = np.maximum(finish_s - cut_s, 0.0)
    return float(left_s.sum() / (len(left_s) - 1)) if lost else float(left_s.max())


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
            lost = number // len(JOBS) % 2 == number % 2
            without = (int(random.integers(count)) + 1,) if lost else ()
            source = f"{file}@{int(cut_s) // 3600}:{int(cut_s) % 3600 // 60:02d}:{int(cut_s) % 60:02d}"
            continued = read_continued_plan([source], without)
            assert continued is not None
            request = replace(continued.request, strategies=("split-field",))
            uncut_s = measure_rest_s(whole.run.finish_s, cut_s, lost)
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
