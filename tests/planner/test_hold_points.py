"""Tasks and hold points of real plans agree with what the implement alone shows."""

from typing import Any

import pytest

from planner.evaluation.candidates.evaluate import Candidate, run_candidate
from planner.evaluation.candidates.line_programme import sketch_plans
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.registry import STRATEGIES
from tests.planner.shapes import SHAPES
from vehicle.missions.plan import Plan


@pytest.fixture(scope="module")
def plans(wide_site: Any) -> list[Plan]:
    """Plans of every strategy, and some on a field with a notch."""
    notched = prepare_context(WorkOrder(PlanRequest(field="U", no_headland=True), SHAPES["U"]))
    return [
        *(sketch_plans(wide_site, one, count)[0].compose().plan for one in STRATEGIES.values() for count in (1, 4)),
        *(sketch_plans(notched, STRATEGIES[name], 3)[0].compose().plan for name in ("split-field", "interleaved")),
    ]


def test_tractors_may_wait_where_the_implement_shows_it(plans: list[Plan]) -> None:
    """At the start and inside passes; in a formation not everywhere there."""
    for plan in plans:
        is_formation = plan.notes.strategy not in ("split-field", "interleaved") and plan.notes.tractors > 1
        for legs in (mission.legs for mission in plan.missions):
            down = [leg.implement for leg in legs]
            for number, leg in enumerate(legs[1:], start=1):
                is_inside = down[number - 1] and down[number]
                assert leg.may_wait == is_inside or (is_formation and is_inside)


def test_tractors_give_way_at_hold_points_only(wide_site: Any) -> None:
    for name, tractors in (("interleaved", 5), ("split-field", 4)):
        written = sketch_plans(wide_site, STRATEGIES[name], tractors)[0].compose().plan
        driven = run_candidate(wide_site, Candidate(name, tractors)).run.plan
        for before, after in zip(written.missions, driven.missions, strict=True):
            for a, b in zip(before.legs, after.legs, strict=True):
                assert len(b.gates) == len(a.gates) or b.may_wait
