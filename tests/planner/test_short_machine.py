"""A mower of one metre on a sixth of a hectare: its order is quick, and it keeps the distances of a short machine.

Four planned radii are as wide as eight swaths, and one swath after another takes half as long to turn as to work.
"""

from pathlib import Path
from typing import Any

import pytest
import shapely

from fields.geometry.field import Field
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest

pytestmark = pytest.mark.usefixtures("first_layout")


def prepare(*corners: tuple[float, float], **options: Any) -> PlanningContext:
    """The mower, with swaths of 0.965 m and a planned radius of 1.9 m, on a field of four corners."""
    request = PlanRequest(
        field="yard", tractor=str(Path(__file__).with_name("mower.toml")), tractors=(1,), width_m=0.965, radius_m=1.9,
        speed_mps=0.75, turn_speed_mps=0.5, **options,
    )  # fmt: skip
    return prepare_context(WorkOrder(request, Field("yard", shapely.Polygon(corners))))


@pytest.mark.slow
def test_a_mower_skips_swaths_and_comes_back() -> None:
    # Round corners, as backing into the corners of the headland says nothing about the order of swaths.
    contexts = [
        prepare((0, 0), (30, 0), (30, 20), (0, 28), corners="round", **turn) for turn in ({}, {"turn": "omega"})
    ]
    planned, by_omega = (simulate_candidate(context, Candidate("split-field", 1)).result for context in contexts)
    assert planned.feasible
    assert not by_omega.feasible or (by_omega.finished_s is not None and planned.finished_s <= by_omega.finished_s)


def test_tractors_of_a_short_machine_keep_shorter_distances() -> None:
    rules = prepare((0, 0), (42.5, 0), (42.5, 39.5), (0, 39.5), turn="u").driving_rules
    assert 3.0 < rules.length_m < 3.6
    assert rules.gap_m == 2.0 * rules.length_m and rules.hold_back_m == 1.6 * rules.length_m
