"""A day: who works which field when, its page, and its pictures."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from planner.day import load_day, plan_day, prepare_day
from planner.day.cache import Cache
from planner.pool import local_pool
from planner.service.jobs.made import csv_of, html_of, json_of, png_of
from planner.service.jobs.requests import DayRequest
from planner.service.jobs.work import Work
from planner.service.store.jobs import Made
from planner.warmup import run_once
from reports.day_export import day_csv, day_json
from reports.day_figures import gantt_figure, map_figure
from reports.day_page import day_page
from reports.day_results import DayResult
from reports.figures import png_bytes


def run_day(work: Work) -> list[Made]:
    """Plan a day; raises HeadlandError for one that cannot be planned."""
    request = DayRequest.model_validate(work.request)
    asked, own = load_day(request.day, farm=request.farm, rain=request.rain)
    ready = prepare_day(asked, own)
    cache = Cache(Path(work.cache))
    todo = ready.unknown(cache)
    work.progress(0, max(todo, 1), "Simulating fields")
    if todo:
        run_once()
    with local_pool(max(todo, 1), work.processes) as executor:
        result = plan_day(
            ready, cache=cache, executor=executor, draws=request.draws, seed=request.seed,
            progress=lambda done, all: work.progress(done, all, "Simulating fields"),
        )  # fmt: skip
    work.progress(1, 1, "Writing the results")
    made = list(_results(result))
    work.progress(1, 1, "Done" if result.jobs else f"No field can be done; the closest is {result.closest}.")
    return made


def _results(result: DayResult) -> Iterator[Made]:
    yield json_of("result.json", day_json(result))
    yield csv_of("result.csv", day_csv(result))
    yield html_of("page.html", day_page(result))
    yield png_of("gantt.png", png_bytes(gantt_figure(result)))
    figure = map_figure(result)
    if figure is not None:
        yield png_of("map.png", png_bytes(figure))
