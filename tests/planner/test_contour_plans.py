"""Plans on swaths along contours: they are driven on their curves; erosion shares; what cannot be asked for."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely

from fields import Field
from fields.terrain.elevation_grid import ElevationGrid
from fields.terrain.slopes import measure_cross_slope, measure_fall_line_share
from planner.errors import FieldError, RequestError
from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.figures import CandidateRun
from planner.evaluation.context import PlanningContext
from planner.evaluation.field_physics import FieldPhysics
from planner.evaluation.ground.coverage import compute_guided_path
from planner.evaluation.layout_choice import lay_contours
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.many_fields import list_bearing_requests
from planner.request.plan_request import CONTOUR, PlanRequest
from reports.plan.bearing_report import describe_bearings
from reports.plan.comparison import ComparedWay, Comparison, ComparisonRow
from strategies.path_planning.errors import StrategyError
from vehicle.model.terrain import Terrain
from vehicle.records import WORKING

TOP = np.array([35.0, -90.0])
FIELD = Field("cone", shapely.box(0.0, 0.0, 70.0, 60.0))
PLACES = np.arange(-20.0, 101.0, 4.0)
EASTINGS, NORTHINGS = np.meshgrid(PLACES, PLACES)


@cache
def drive() -> tuple[PlanningContext, CandidateRun]:
    """A cone whose contours are arcs of 90 m to 150 m, worked by one tractor."""
    heights = -0.04 * np.hypot(EASTINGS - TOP[0], NORTHINGS - TOP[1])
    physics = FieldPhysics(terrain=Terrain(-20.0, -20.0, 4.0, heights))
    context = prepare_context(WorkOrder(PlanRequest(field="cone", swaths=CONTOUR), FIELD), physics=physics)
    return context, run_candidate(context, Candidate("split-field", 1))


@pytest.mark.slow
def test_curved_swaths_are_driven_on_their_curves() -> None:
    context, driven = drive()
    assert driven.reason is None
    assert all(swath.via_m for swath in context.layout.swaths)
    path = compute_guided_path(driven.run, context, 0)
    lines = shapely.union_all([shapely.LineString(swath.points_m) for swath in context.layout.swaths])
    inside = shapely.contains_xy(context.layout.inner_region.buffer(-6.0), *path.T)
    working = inside & (driven.run.get_statuses(0) == WORKING)
    away = shapely.distance(lines, shapely.points(path[working]))
    assert len(away) > 100 and float(np.quantile(away, 0.95)) < 0.1
    radius = np.hypot(*(path[working] - TOP).T)
    assert np.ptp(radius) > 25.0, "from the outermost ring to the innermost"


@pytest.mark.slow
def test_formations_say_that_they_need_straight_swaths() -> None:
    with pytest.raises(StrategyError, match="needs straight tracks side by side, and those here are curved"):
        run_candidate(drive()[0], Candidate("row-by-row", 2))


def test_erosion_shares_of_a_plane() -> None:
    grid = ElevationGrid(-20.0, -20.0, 4.0, 0.06 * NORTHINGS)
    gentle = ElevationGrid(-20.0, -20.0, 4.0, 0.04 * NORTHINGS)

    def turn(degrees: float) -> np.ndarray:
        return 40.0 * np.array([[0.0, 0.0], [math.sin(math.radians(degrees)), math.cos(math.radians(degrees))]])

    shares = [measure_fall_line_share([turn(degrees)], grid) for degrees in (0.0, 9.5, 10.5, 90.0, 175.0)]
    assert shares == [1.0, 1.0, 0.0, 0.0, 1.0]
    assert measure_fall_line_share([turn(0.0)], gentle) == 0.0
    assert measure_fall_line_share([turn(0.0), turn(90.0)], grid) == pytest.approx(0.5)


def test_contours_need_heights() -> None:
    with pytest.raises(RequestError, match=r"follows contours, and no heights are known; give .*elevation"):
        prepare_context(WorkOrder(PlanRequest(field="cone", swaths=CONTOUR), FIELD))


def test_passes_that_are_asked_for_have_room_or_are_refused() -> None:
    """Inside 5 passes of 6 m nothing is left of 60 m; where planning chooses their number it lays fewer."""
    terrain = Terrain(-20.0, -20.0, 4.0, 0.06 * NORTHINGS)
    request = PlanRequest(field="cone", swaths=CONTOUR, width_m=6.0)
    assert lay_contours(request, FIELD, 30.0, 0.0, terrain, 6.0).headland_passes < 5
    with pytest.raises(FieldError, match=r"No contour leads through field 'cone' inside a headland of 30 m.*swaths"):
        lay_contours(replace(request, headland_passes=5), FIELD, 30.0, 0.0, terrain, 6.0)


@pytest.mark.parametrize("other", [{"bearing_deg": 30.0}, {"no_headland": True}, {"guidance_line": "A"}])
def test_contours_take_no_direction_besides(other: dict[str, object]) -> None:
    with pytest.raises(RequestError, match="takes its direction from the ground"):
        PlanRequest(field="cone", swaths=CONTOUR, **other)  # type: ignore[arg-type]


def test_bearings_compared_end_with_the_chosen_one_and_contours() -> None:
    requests = list_bearing_requests(PlanRequest(field="cone"), (0.0, 45.0))
    assert [(one.bearing_deg, one.swaths) for one in requests] == [
        (0.0, "straight"), (45.0, "straight"), (None, "straight"), (None, CONTOUR)
    ]  # fmt: skip
    with pytest.raises(RequestError, match="A bearing of 400 degrees is none"):
        list_bearing_requests(PlanRequest(field="cone"), (400.0,))


def test_no_bearing_that_works_is_said() -> None:
    row = ComparisonRow("cone", ComparedWay("auto", None, None, 3.0, 0.0), refusal="too steep")
    comparison = Comparison((row,))
    assert describe_bearings(comparison) == ["No bearing works; the reasons are below."]


def test_cross_slope_of_lines_on_a_plane() -> None:
    grid = ElevationGrid(-20.0, -20.0, 4.0, 0.06 * NORTHINGS)
    east, north = np.array([[0.0, 10.0], [40.0, 10.0]]), np.array([[10.0, 0.0], [10.0, 40.0]])
    assert measure_cross_slope([north], grid) == pytest.approx(0.0, abs=1e-12)
    assert measure_cross_slope([north, east], grid) == pytest.approx(0.06)
