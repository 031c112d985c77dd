"""Small fields and sites that the tests of the planner share; metres, x = east and y = north."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, cast

import pytest
import shapely

from fields import Field
from planner.candidates.evaluate import CandidateRun
from planner.scenario import Scenario
from planner.site import Site, prepare
from reports.results import PlanResult
from vehicle.missions import Plan
from vehicle.run import Run


def moved(field: Field, move: Callable[[Any], Any]) -> Field:
    """The field with everything in it moved by a function of shapely geometries."""
    entrance = field.entrance
    if entrance is not None:
        point = move(shapely.Point(entrance))
        entrance = (point.x, point.y)
    grounds = tuple(replace(zone, polygon=move(zone.polygon)) for zone in field.grounds)
    return replace(field, boundary=move(field.boundary), entrance=entrance, grounds=grounds)


def site_on(polygon: shapely.Polygon, entrance: tuple[float, float] | None = None, **options: Any) -> Site:
    """A site on a polygon in local metres, its headland left for turning unless `tracks_only` is False."""
    scenario = Scenario(field="drawn", **{"tracks_only": True, **options})
    return prepare(scenario, Field("drawn", polygon, entrance=entrance))


@pytest.fixture(scope="session")
def place() -> Callable[..., Site]:
    """`site_on` for tests that draw their own polygon."""
    return site_on


@pytest.fixture(scope="session")
def move() -> Callable[[Field, Callable[[Any], Any]], Field]:
    """`moved` for tests that rotate, shift and mirror."""
    return moved


@pytest.fixture(scope="session")
def small_site() -> Site:
    """36 m by 80 m with an entrance: 12 tracks."""
    return site_on(shapely.box(0, 0, 36, 80), (0.0, 0.0))


@pytest.fixture(scope="session")
def wide_site() -> Site:
    """The field of the thesis shortened to 130 m: long enough for a queue of five."""
    return site_on(shapely.box(0, 0, 130, 70), (0.0, 0.0))


@pytest.fixture(scope="session")
def evaluate_once() -> Callable[..., PlanResult]:
    """Evaluate a candidate on a site, once per session."""
    from planner.candidates.evaluate import Candidate, evaluate

    sites: dict[int, Site] = {}

    @cache
    def cached(key: int, strategy: str, tractors: int) -> PlanResult:
        return evaluate(sites[key], Candidate(strategy, tractors))

    def result(site: Site, strategy: str, tractors: int) -> PlanResult:
        sites[id(site)] = site
        return cached(id(site), strategy, tractors)

    return result


@pytest.fixture
def meeting(monkeypatch: pytest.MonkeyPatch) -> list[Plan]:
    """Plans that would have been driven: in all of them tractors meet, and there is one order of tracks."""
    driven: list[Plan] = []

    def meets(*given: Any) -> CandidateRun:
        driven.append(given[3].plan)
        return CandidateRun(cast(Run, None), "tractors meet", "none", None)

    monkeypatch.setattr("planner.candidates.evaluate._run_plan", meets)
    monkeypatch.setattr("planner.candidates.evaluate.other_orders", lambda *_: ())
    return driven
