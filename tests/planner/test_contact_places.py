"""Places where a run touches something or leaves the field."""

import numpy as np
import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import find_contact_places
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import OBSTACLE, OUTLINE
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.compile import compute_contact_boxes
from vehicle.sim.world import simulate

BOX = shapely.box(0.0, 0.0, 120.0, 60.0)
POLE = Obstacle("pole", shapely.Point(60.0, 31.8), 0.25, "P7")


@pytest.fixture(scope="module")
def site() -> PlanningContext:
    request = PlanRequest(no_headland=True, tractors=(1,), bearing_deg=90.0)
    return prepare_context(WorkOrder(request, Field("poled", BOX, obstacles=(POLE,))))


def get_touching_y_m(site: PlanningContext, depth_m: float) -> float:
    """Where a tractor reaches so deep into the pole, whose southern edge is at 31.55 m."""
    boxes = compute_contact_boxes(site.tractor, site.implement)
    return 31.55 - max(boxes["half_width"], boxes["tool_half_width"]) + depth_m


def drive_past(site: PlanningContext, y_m: float, speed_mps: float = 3.0) -> SimulationRun:
    """A run along a swath from west to east."""
    leg = Leg(np.array([[10.0, y_m], [110.0, y_m]]), speed_mps, implement=True, task=LegTask(SWATH, 0))
    return simulate(Plan((Mission((leg,)),)), site.tractor, site.implement)


class TestPlaces:
    def test_the_pole_is_found_where_it_stands(self, site: PlanningContext) -> None:
        assert find_contact_places(drive_past(site, get_touching_y_m(site, -0.05)), site) == ()
        (place,) = find_contact_places(drive_past(site, get_touching_y_m(site, 0.15)), site)
        assert (place.kind, place.number, place.name) == (OBSTACLE, 0, "obstacle 'P7' (pole)")
        assert place.x_m == pytest.approx(60.0, abs=4.0) and place.depth_m == pytest.approx(0.15, abs=0.05)

    def test_leaving_the_field_is_found_from_half_a_metre_on(self, site: PlanningContext) -> None:
        assert find_contact_places(drive_past(site, -0.4), site) == ()
        (place,) = find_contact_places(drive_past(site, -0.7), site)
        assert place.kind == OUTLINE and place.depth_m == pytest.approx(0.7, abs=0.05)
        assert "leaves the field by 0.7" in place.sentence
