"""What a corner driven in an arc with the implement down misses is charged, in closed form."""

import math

import numpy as np
import pytest
import shapely

from fields import Field
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.programmes.work_moves import list_work_moves
from strategies.site.site import MISSED_FACTOR


@pytest.mark.parametrize("width_m", [3.0, 4.0])
def test_a_right_angle_is_charged_what_its_arc_misses(width_m: float) -> None:
    """The outer end of the bar drives a circle of R + w/2 about the middle of the arc; the corner lies outside it."""
    field = Field("square", shapely.box(0.0, 0.0, 150.0, 120.0))
    context = prepare_context(WorkOrder(PlanRequest(width_m=width_m, tractors=(1,), headland_passes=1), field))
    moves = get_site_moves(context)
    site, first = moves.site, moves.lines[0].group
    outer = [line for line in moves.lines if line.group == first]
    arcs = [
        move
        for a in outer
        for b in outer
        for way in (0, 1)
        for next_way in (0, 1)
        for move in list_work_moves(site, moves.finder, a, way, b, next_way)
    ]
    single = [arc for arc in arcs if np.count_nonzero(arc.rows[:, 0] * arc.rows[:, 1]) == 1]
    assert len(single) >= 4
    for arc in single:
        radius_m = 1.0 / np.abs(arc.rows[:, 1]).max()
        missed_m2 = (1.0 - math.pi / 4.0) * (radius_m + 0.5 * width_m) ** 2
        assert arc.charge_s == pytest.approx(MISSED_FACTOR * missed_m2 * site.work_s_per_m2, rel=0.02)
