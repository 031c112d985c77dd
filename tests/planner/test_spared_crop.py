"""Moves go round a crop that stands, on the headland that is cut, where that is better than through it."""

import math

import pytest
import shapely

from fields.geometry.field import Field
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.path_planning.paths import build_path_from_rows

pytestmark = pytest.mark.usefixtures("first_layout")


@pytest.mark.parametrize(("operation", "goes_round"), [("harvest", True), ("till", False)])
def test_a_search_leads_round_the_crop(operation: str, goes_round: bool) -> None:
    """From the middle of the west side to that of the east side, 194 m apart, with 2 m/s of charge on a crop."""
    request = PlanRequest(field="box", width_m=6.0, operation=operation, tractors=(1,))
    context = prepare_context(WorkOrder(request, Field("box", shapely.box(0, 0, 200, 120))))
    moves = get_site_moves(context)
    west, east = (4.0, 60.0, 0.5 * math.pi), (196.0, 60.0, -0.5 * math.pi)
    through, found = moves.finder.list_moves(west, east)[0], moves.finder.search(west, east)
    assert found is not None
    driven = shapely.MultiLineString([points for _, points in build_path_from_rows(west, found.rows, "route").sample()])
    crop = shapely.buffer(context.layout.inner_region, -moves.site.body.reach_m)
    assert driven.intersects(crop) != goes_round
    assert (found.cost_s < through.cost_s - 100.0) == goes_round
