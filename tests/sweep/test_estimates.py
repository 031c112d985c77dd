"""Estimates of a sweep against plans: at the speed that was driven they are the same."""

from dataclasses import replace

import pytest
import shapely

from fields.geometry.field import Field
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.planning import plan_order
from planner.pipeline.worker_tasks import pack_context
from planner.request.plan_request import PlanRequest
from planner.sweeps.sweep import estimate_task

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("first_layout")]

PLOT, SMALL = (Field("plot", shapely.box(0, 0, *size)) for size in ((110, 100), (80, 60)))


@pytest.mark.parametrize(
    ("tractors", "strategies"), [(1, PlanRequest().strategies), (8, ("split-field",)), (4, ("interleaved",))]
)
def test_at_the_driven_speed_an_estimate_is_the_plan_to_take(tractors: int, strategies: tuple[str, ...]) -> None:
    """Also of eight tractors that wait for each other, and by another strategy than that of sketches."""
    order = WorkOrder(PlanRequest(width_m=6.0, speed_mps=2.5, tractors=(tractors,), strategies=strategies), PLOT)
    (estimate,) = estimate_task([order], pack_context(prepare_context(order)))
    driven = plan_order(order).ranking.best
    assert driven is not None and driven.strategy in strategies
    assert estimate.worked_pct == pytest.approx(driven.worked_pct, abs=0.01)
    assert estimate.time_s == pytest.approx(driven.time_s, rel=0.001)
    assert estimate.uncertainty_pct == 0.0


def test_at_other_speeds_estimates_tell_what_they_may_be_off_by() -> None:
    """The more tractors there are, the more of a plan depends on who meets whom."""
    reference, found = WorkOrder(PlanRequest(width_m=6.0, speed_mps=2.5, tractors=(1,)), SMALL), list[float]()
    requests = [replace(reference.request, speed_mps=2.0, tractors=(tractors,)) for tractors in (1, 2, 3, 4)]
    orders = [WorkOrder(request, SMALL) for request in requests]
    for plan in estimate_task(orders, pack_context(prepare_context(reference))):
        assert plan.uncertainty_pct is not None
        found.append(plan.uncertainty_pct)
    assert 0.0 < found[0] < found[1] < found[2] == found[3]


@pytest.mark.parametrize("turn_mps", [1.25, 1.9])
def test_turns_take_the_time_of_their_own_speed(turn_mps: float) -> None:
    reference = WorkOrder(PlanRequest(width_m=6.0, speed_mps=2.5, tractors=(1,), strategies=("split-field",)), PLOT)
    slower = replace(reference, request=replace(reference.request, turn_speed_mps=turn_mps))
    estimate, usual = estimate_task([slower, reference], pack_context(prepare_context(reference)))
    driven = plan_order(slower).ranking.best
    assert driven is not None
    assert estimate.time_s == pytest.approx(driven.time_s, rel=0.03)
    assert estimate.time_s > usual.time_s
