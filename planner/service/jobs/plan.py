"""A plan: the ranking, its page, the map of the best, and every feasible plan as it can be driven."""

from __future__ import annotations

from collections.abc import Iterator

from planner.planning import Planned
from planner.planning import plan as simulate_all
from planner.pool import local_pool
from planner.rank import candidates
from planner.saving import saved_plan
from planner.service.jobs.asking import asked_of
from planner.service.jobs.made import csv_of, html_of, json_of, png_of
from planner.service.jobs.work import Work
from planner.service.store.jobs import Made
from planner.warmup import run_once
from reports.export import ranking_csv, ranking_json
from reports.figures import map_figure, png_bytes
from reports.maps import maps_json
from reports.page import plan_page
from reports.results import Ranking
from reports.wording import closest, duration


def run_plan(work: Work) -> list[Made]:
    """Simulate and rank; raises HeadlandError for what cannot be planned at all."""
    asked = asked_of(work.request)
    work.progress(0, 0, "Loading the simulator")
    run_once()
    scenario = asked.scenario
    every = bool(work.request.get("all"))
    with local_pool(len(candidates(scenario)), work.processes) as executor:
        planned = simulate_all(
            scenario, tractor=asked.tractor, implement=asked.implement, chances=asked.chances, terms=asked.terms,
            supply=asked.supply, times=asked.times, yard=asked.yard, executor=executor, pictures=True,
            progress=lambda done, all: work.progress(done, all, "Simulating plans"), every=every,
        )  # fmt: skip
    work.progress(1, 1, "Writing the results")
    made = list(_results(planned))
    work.progress(1, 1, _told(planned.ranking))
    return made


def _told(ranking: Ranking) -> str:
    """Whether there is a plan that meets what was asked, in a sentence."""
    if ranking.best is None:
        return "No plan is feasible."
    if ranking.missed_by_s is not None:
        return f"No plan meets the deadline; the {closest(ranking)} misses it by {duration(ranking.missed_by_s)}."
    return ranking.unmet or "Done"


def _results(planned: Planned) -> Iterator[Made]:
    ranking, best = planned.ranking, planned.ranking.best
    drive = None if best is None else planned.drives[best.strategy, best.tractors]
    yield json_of("result.json", ranking_json(ranking))
    yield csv_of("result.csv", ranking_csv(ranking))
    yield html_of("page.html", plan_page(ranking, drive, planned.drives))
    yield json_of("maps.json", maps_json(ranking, drive, planned.drives))
    if drive is not None:
        yield png_of("map.png", png_bytes(map_figure(drive, ranking.field_name)))
    if best is not None and planned.run is not None:
        yield json_of("plan.json", saved_plan(planned.site, planned.run.plan))
    for (strategy, tractors), legs in planned.plans.items():
        yield json_of(f"plan-{strategy}-{tractors}.json", saved_plan(planned.site, legs))
