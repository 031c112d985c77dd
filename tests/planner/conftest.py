"""Small fields and sites that the tests of the planner share; metres, x = east and y = north."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import pytest
import shapely

from fields import Field
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult


def moved(field: Field, move: Callable[[Any], Any]) -> Field:
    """The field with everything in it moved by a function of shapely geometries."""
    entrance = field.entrance
    if entrance is not None:
        point = move(shapely.Point(entrance))
        entrance = (point.x, point.y)
    grounds = tuple(replace(zone, polygon=move(zone.polygon)) for zone in field.ground_zones)
    obstacles = tuple(replace(one, geometry=move(one.geometry)) for one in field.obstacles)
    return replace(field, boundary=move(field.boundary), entrance=entrance, obstacles=obstacles, ground_zones=grounds)


def site_on(polygon: shapely.Polygon, entrance: tuple[float, float] | None = None, **options: Any) -> PlanningContext:
    """A site on a polygon in local metres, its headland left for turning unless `no_headland` is False."""
    scenario = PlanRequest(field="drawn", **{"no_headland": True, **options})
    return prepare_context(WorkOrder(scenario, Field("drawn", polygon, entrance=entrance)))


@pytest.fixture(scope="session")
def place() -> Callable[..., PlanningContext]:
    """`site_on` for tests that draw their own polygon."""
    return site_on


@pytest.fixture(scope="session")
def move() -> Callable[[Field, Callable[[Any], Any]], Field]:
    """`moved` for tests that rotate, shift and mirror."""
    return moved


@pytest.fixture(scope="session")
def small_site() -> PlanningContext:
    """36 m by 80 m with an entrance: 12 tracks."""
    return site_on(shapely.box(0, 0, 36, 80), (0.0, 0.0))


@pytest.fixture(scope="session")
def round_site() -> PlanningContext:
    """60 m by 90 m with its headland worked."""
    return site_on(shapely.box(0, 0, 60, 90), no_headland=False)


@pytest.fixture(scope="session")
def wide_site() -> PlanningContext:
    """The field of the thesis shortened to 130 m: long enough for a queue of five."""
    return site_on(shapely.box(0, 0, 130, 70), (0.0, 0.0))


@pytest.fixture(scope="session")
def evaluate_once() -> Callable[..., PlanResult]:
    """Evaluate a candidate on a site, once per session."""
    from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate

    sites: dict[int, PlanningContext] = {}

    @cache
    def cached(key: int, strategy: str, tractors: int) -> PlanResult:
        return simulate_candidate(sites[key], Candidate(strategy, tractors)).result

    def result(site: PlanningContext, strategy: str, tractors: int) -> PlanResult:
        sites[id(site)] = site
        return cached(id(site), strategy, tractors)

    return result
