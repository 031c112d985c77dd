"""Estimates of a sweep against plans: at the speed that was driven they are the same."""

import pytest

from planner.evaluation.work_order import WorkOrder
from planner.pipeline.planning import plan_order
from planner.request.plan_request import PlanRequest
from planner.sweeps.sweep import estimate_task, lay_out_ground

pytestmark = pytest.mark.slow


@pytest.mark.parametrize("tractors", [2, 6])
def test_at_the_driven_speed_an_estimate_is_the_plan_to_take(tractors: int) -> None:
    """Six tractors leave a quarter of this field as split-field deals it; the plan to take is another strategy's."""
    order = WorkOrder(PlanRequest("netherlands", width_m=6.0, speed_mps=2.5, tractors=(tractors,)))
    (estimate,) = estimate_task([order], lay_out_ground(order))
    driven = plan_order(order).ranking.best
    assert driven is not None and (driven.strategy == "split-field") is (tractors == 2)
    assert estimate.worked_pct == pytest.approx(driven.worked_pct, abs=0.01)
    assert estimate.time_s == pytest.approx(driven.time_s, rel=0.001)
