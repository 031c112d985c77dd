"""What learning from one's own logs gains: jobs planned with a farm file as it is, and as other jobs taught it.

    python -m tests.benchmarks.learnt_jobs FOLDER FARM

FOLDER holds ISO 11783-10 task data with time logs and their fields, FARM is a farm file with the machine. Jobs are
parted in two halves by turns; each is planned with what the other half taught, values of the file replaced. Compared is
the logged time without stops. Fields with several logs are left out; east-west is stretched until outlines have the
areas that the task data say.
"""

from __future__ import annotations

import argparse
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np
import shapely

from fields.geometry.field import Field
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.preparation import prepare_context
from planner.farm.inventory import FarmFile, load_farm, parse_farm
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.request.plan_request import PlanRequest
from planner.task_logs.farm_learning import learn_farm_values
from planner.task_logs.log_import import import_runs
from planner.task_logs.runs.phases import summarise_run
from planner.task_logs.runs.run_files import load_imported_run
from planner.task_logs.runs.run_records import ProjectedRun
from tests.benchmarks.driven_jobs import scale_run_east_west


def planned_s(run: ProjectedRun, farm: FarmFile) -> float:
    """What one tractor of the farm takes for the field of a run by the plan."""
    assert run.outline is not None and run.outline_m2
    outline = scale_run_east_west(run, run.outline_m2 / run.outline.area).outline
    west, south, _, _ = outline.bounds
    field = Field(name=run.name, boundary=shapely.transform(outline, lambda points: points - np.array([west, south])))
    question = complete_request_by_farm(
        PlanRequest(field=run.name, tractors=(1,), strategies=("split-field",), samples=0), farm, ("tractors",)
    )
    site = prepare_context(question.request, field, tractor=question.tractor, implement=question.implement)
    time_s = simulate_candidate(site, Candidate("split-field", 1)).result.time_s
    return float("nan") if time_s is None else time_s


def main() -> None:
    """Import, learn, plan, compare, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("farm", type=Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        files = import_runs([str(options.folder)]).files
        for file, text in files.items():
            (Path(name) / file).write_text(text, encoding="utf-8")
        logs = [Path(name) / file for file in files if file.endswith(".csv")]
        runs = {path: load_imported_run(path) for path in logs}
        several = {one for one, count in Counter(run.field for run in runs.values()).items() if count > 1}
        jobs = [path for path in logs if runs[path].field not in several and runs[path].outline is not None]
        plain = load_farm(options.farm)
        errors = []
        print("job                                net min   as the file is       learnt")
        for half in (0, 1):
            lesson = learn_farm_values(jobs[1 - half :: 2], options.farm, replace_given=True)
            taught = parse_farm(lesson.text, "learnt", options.farm.parent)
            for path in jobs[half::2]:
                net = summarise_run(runs[path]).without_stops_s
                pair = [planned_s(runs[path], farm) / net - 1.0 for farm in (plain, taught)]
                errors.append(pair)
                cells = "".join(f"{net * (1.0 + off) / 60:10.1f} {100 * off:+4.0f} %" for off in pair)
                print(f"{path.stem:32s}{net / 60:10.1f}{cells}")
        off = 100.0 * np.abs(np.array(errors))
        print(f"mean error of net time: {off[:, 0].mean():.1f} % as the file is, {off[:, 1].mean():.1f} % learnt")


if __name__ == "__main__":
    main()
