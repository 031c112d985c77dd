"""Runs the jobs of the service: plans, days and diagnoses, with their results as named bytes of a media type."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from planner.day.input_file import load_day
from planner.day.planning import plan_day, prepare_day
from planner.pipeline.diagnosis import diagnose, diagnose_demo
from planner.pipeline.executors import create_executor
from planner.pipeline.kernels import COMPILING, compile_kernels, list_missing_kernels
from planner.pipeline.outputs.pictures import build_refused_picture
from planner.pipeline.outputs.saved_plans import write_saved_plan
from planner.pipeline.planning import PlanningResult, plan_order
from planner.pipeline.ranking import list_candidates
from planner.pipeline.result_cache import ResultCache
from planner.pipeline.worker_tasks import group_candidates, warm_up_simulation
from planner.service.jobs.input_files import DayJobRequest, DiagnosisJobRequest, JobContext, JobFunction, ResultContents
from planner.service.sandbox.readings import build_work_order
from reports.day.page import draw_gantt, draw_road_map, render_day_page
from reports.day.tables import format_day_csv, format_day_json
from reports.diagnosis.page import render_diagnosis_page
from reports.diagnosis.tables import format_diagnosis_json
from reports.plan.figures import format_ranking_csv, format_ranking_json
from reports.plan.map_data import format_maps_json
from reports.plan.map_figure import draw_plan_map, render_png
from reports.plan.ranking_page import render_plan_page
from reports.plan.shortfall_wording import list_shortfall_sentences
from vehicle.identification.diagnosis.demo_logs import HiddenEffect
from vehicle.model.tractor_writer import format_tractor_toml


def load_job_libraries() -> None:
    """Load what plans take beside this module: the compiled simulator, where it is on disk, and what draws maps."""
    import matplotlib.backends.backend_agg
    import matplotlib.figure  # noqa: F401

    if not list_missing_kernels():
        warm_up_simulation()


def _load_simulator(job: JobContext) -> None:
    """Load the compiled simulator, and compile what is missing of it on all cores that jobs may use."""
    job.report_progress(0, 0, "Loading the simulator")
    compile_kernels(
        list_missing_kernels(), job.processes, lambda done, all, _: job.report_progress(done, all, COMPILING)
    )
    warm_up_simulation()


def run_day_job(job: JobContext) -> ResultContents:
    """Plan a day; raises HeadlandError where it cannot be planned."""
    request = DayJobRequest.model_validate(job.request)
    day_request, day_farm = load_day(request.day, farm=request.farm, rain=request.rain, certainty_pct=request.certainty)
    prepared_day = prepare_day(day_request, day_farm)
    cache = ResultCache(Path(job.cache_folder))
    unknown_count = prepared_day.count_uncached_field_times(cache)
    job.report_progress(0, max(unknown_count, 1), "Simulating fields")
    if unknown_count:
        _load_simulator(job)
    with create_executor(max(unknown_count, 1), job.processes) as executor:
        result = plan_day(
            prepared_day,
            cache=cache,
            executor=executor,
            samples=request.samples,
            seed=request.seed,
            progress=lambda done, all: job.report_progress(done, all, "Simulating fields"),
        )
    job.report_progress(0, 0, "Writing the results")
    files: dict[str, str | bytes] = {
        "result.json": format_day_json(result),
        "result.csv": format_day_csv(result),
        "page.html": render_day_page(result),
        "gantt.png": render_png(draw_gantt(result)),
    }
    if (figure := draw_road_map(result)) is not None:
        files["map.png"] = render_png(figure)
    job.report_progress(
        1, 1, "Done" if result.jobs else f"No field can be done; the closest is {result.closest_field}."
    )
    return files


def run_diagnosis_job(job: JobContext) -> ResultContents:
    """Diagnose logs, or a demonstration; raises HeadlandError for logs that cannot be used."""
    request = DiagnosisJobRequest.model_validate(job.request)

    def report_progress(done: int, all: int) -> None:
        job.report_progress(done, all, "Diagnosing")

    report_progress(0, 0)
    hidden: HiddenEffect | None = None
    machine: dict[str, Any] = {"tractor": request.tractor, "ground": request.ground}
    machine |= {"holdout": request.holdout or None, "progress": report_progress}
    if request.demo:
        seed = 1 if request.seed is None else request.seed
        diagnosis, hidden = diagnose_demo(**machine, seed=seed, hidden_effect=request.hide)
    else:
        convert: dict[str, Any] = {"fixes": request.fix, "mapping": request.mapping}
        diagnosis = diagnose(request.logs, **machine, **convert, use_driven_size=request.as_driven)
    page = render_diagnosis_page(diagnosis, None if hidden is None else hidden.description)
    files: dict[str, str | bytes] = {
        "result.json": format_diagnosis_json(diagnosis, hidden),
        "page.html": page,
    }
    if diagnosis.is_savable:
        files["tractor.toml"] = format_tractor_toml(diagnosis.tractor)
    if diagnosis.next_drive_plan is not None:
        files["next-drive.json"] = diagnosis.next_drive_plan
    return files


def run_plan_job(job: JobContext) -> ResultContents:
    """Simulate and rank plans; raises HeadlandError where nothing can be planned."""
    order = build_work_order(job.request)
    _load_simulator(job)
    with create_executor(len(group_candidates(list_candidates(order.request))), job.processes) as executor:
        planned = plan_order(
            order,
            executor=executor,
            with_pictures=True,
            report_stage=lambda words, done, all: job.report_progress(done, all, words),
            cache=ResultCache(Path(job.cache_folder) / "plans"),
        )
    job.report_progress(0, 0, "Writing the results")
    files = dict(_write_plan_results(planned))
    outcome = "No plan is feasible."
    if planned.ranking.best is not None:
        outcome = " ".join(list_shortfall_sentences(planned.ranking)) or "Done"
    job.report_progress(1, 1, outcome)
    return files


def _write_plan_results(planned: PlanningResult) -> Iterator[tuple[str, str | bytes]]:
    ranking, best = planned.ranking, planned.ranking.best
    drive = None if best is None else planned.pictures[best.strategy, best.tractors]
    yield "result.json", format_ranking_json(ranking)
    yield "result.csv", format_ranking_csv(ranking)
    field_picture = None if drive is not None else build_refused_picture(planned.context, ranking)
    yield "page.html", render_plan_page(ranking, drive, planned.pictures, field_picture)
    yield "maps.json", format_maps_json(ranking, drive, planned.pictures)
    if (picture := drive or field_picture) is not None:
        yield "map.png", render_png(draw_plan_map(picture, ranking.field_name))
    if best is not None and planned.run is not None:
        yield "plan.json", write_saved_plan(planned.context, planned.run.plan, ranking)
    for (strategy, tractors), legs in planned.plans.items():
        yield f"plan-{strategy}-{tractors}.json", write_saved_plan(planned.context, legs, ranking)


JOB_FUNCTIONS: dict[str, JobFunction] = {"plan": run_plan_job, "day": run_day_job, "diagnosis": run_diagnosis_job}
"""What runs a job, by its kind."""
