"""A plan: the ranking, its page, the map of the best, and every feasible plan as it can be driven."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from planner.planning import Planned
from planner.planning import plan as simulate_all
from planner.pool import local_pool
from planner.rank import candidates
from planner.saving import saved_plan
from planner.service.jobs.asking import asked_of
from planner.service.jobs.kinds import Work
from planner.service.jobs.made import csv_of, html_of, json_of, png_of
from planner.service.store.jobs import Made
from planner.warmup import run_once
from reports.export import ranking_csv, ranking_json
from reports.figures import map_figure, png_bytes
from reports.page import plan_page
from reports.results import Drive, Points

MAP_STEP_S = 2.0


def run_plan(work: Work) -> list[Made]:
    """Simulate and rank; raises HeadlandError for what cannot be planned at all."""
    asked = asked_of(work.request)
    work.progress(0, 0, "Loading the simulator")
    run_once()
    scenario = asked.scenario
    with local_pool(len(candidates(scenario)), work.processes) as executor:
        planned = simulate_all(
            scenario, tractor=asked.tractor, implement=asked.implement, chances=asked.chances, terms=asked.terms,
            supply=asked.supply, times=asked.times, yard=asked.yard, executor=executor, pictures=True,
            progress=lambda done, all: work.progress(done, all, "Simulating plans"), every=bool(work.request.get("all")),
        )  # fmt: skip
    work.progress(1, 1, "Writing the results")
    return list(_results(planned))


def _results(planned: Planned) -> Iterator[Made]:
    ranking, best = planned.ranking, planned.ranking.best
    drive = None if best is None else planned.drives[best.strategy, best.tractors]
    yield json_of("result.json", ranking_json(ranking))
    yield csv_of("result.csv", ranking_csv(ranking))
    yield html_of("page.html", plan_page(ranking, drive, planned.drives))
    yield json_of("maps.json", json.dumps(maps_of(planned.drives), separators=(",", ":")) + "\n")
    if drive is not None:
        yield png_of("map.png", png_bytes(map_figure(drive, ranking.field_name)))
    if best is not None and planned.run is not None:
        yield json_of("plan.json", saved_plan(planned.site, planned.run.plan))
    for (strategy, tractors), legs in planned.plans.items():
        yield json_of(f"plan-{strategy}-{tractors}.json", saved_plan(planned.site, legs))


def maps_of(drives: Mapping[tuple[str, int], Drive]) -> dict[str, Any]:
    """What a page draws of every plan: rings and lines in metres of the field, and where tractors are over time."""
    first = next(iter(drives.values()), None)
    if first is None:
        return {"field": None, "plans": []}
    field = {
        "boundary_m": _points(first.boundary),
        "holes_m": [_points(ring) for ring in first.holes],
        "obstacles_m": [_points(ring) for ring in first.obstacles],
        "fences_m": [_points(line) for line in first.fences],
        "tracks_m": [_points(track) for track in first.tracks],
        "entrance_m": None if first.entrance is None else [round(value, 2) for value in first.entrance],
        "width_m": first.width_m,
    }
    return {"field": field, "plans": [_plan(key, drive) for key, drive in drives.items()]}


def _plan(key: tuple[str, int], drive: Drive) -> dict[str, Any]:
    """Where the tractors of a plan are every so many seconds, and what they do there (as of reports.results.Drive)."""
    every = max(1, round(MAP_STEP_S / drive.step_s))
    return {
        "strategy": key[0],
        "tractors": key[1],
        "step_s": every * drive.step_s,
        "finish_s": [round(value, 2) for value in drive.finish_s],
        "missed_m": [_points(ring) for ring in drive.missed],
        "paths": [
            {"points_m": _points(xy[::every]), "status": np.asarray(status)[::every].tolist()}
            for xy, status in zip(drive.xy, drive.status, strict=True)
        ],
    }


def _points(points: Points) -> list[list[float]]:
    """Points to the centimetre."""
    rounded: list[list[float]] = np.round(np.asarray(points, dtype=float), 2).tolist()
    return rounded
