"""Remarks on plans are good English and say what is so: pieces that are skipped, and what the rest of a field is."""

from __future__ import annotations

from typing import cast

import pytest
import shapely

from fields.geometry.field import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.candidates.variants import ReachableJob
from planner.evaluation.context import prepare_context
from planner.pipeline.ranking import add_coverage_remark
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import PlanResult
from strategies.program.field_job import FieldJob


@pytest.mark.parametrize(
    ("swaths", "swaths_m", "passes_m", "words"),
    [
        (1, 12.4, 0.0, "1 piece of track (12 m) cannot be reached and is skipped"),
        (2, 30.0, 0.0, "2 pieces of track (30 m) cannot be reached and are skipped"),
        (1, 12.4, 8.0, "1 piece of track (12 m) and 8 m of headland cannot be reached and are skipped"),
        (0, 0.0, 8.0, "8 m of headland cannot be reached and are skipped"),
        (1, 12.4, 0.3, "1 piece of track (12 m) cannot be reached and is skipped"),
    ],
)
def test_what_is_skipped_is_counted_in_good_english(swaths: int, swaths_m: float, passes_m: float, words: str) -> None:
    remark = ReachableJob(cast(FieldJob, None), swaths, swaths_m, passes_m).remark
    assert remark == f"{words}; a wider passage or headland may help"


def test_a_hand_of_headland_is_not_worth_a_word() -> None:
    assert ReachableJob(cast(FieldJob, None), left_out_passes_m=0.4).remark is None


@pytest.mark.parametrize(
    ("is_divided", "rest"), [(True, "mostly parts that are cut off"), (False, "headland or between tracks")]
)
def test_the_rest_of_a_divided_field_is_not_called_headland(is_divided: bool, rest: str) -> None:
    """A ditch across a field of 60 x 80 m leaves two parts of about half of it each."""
    ditch = Obstacle("ditch", shapely.LineString([(-5, 40), (65, 40)]), 0.75)
    field = Field("plot", shapely.box(0, 0, 60, 80), obstacles=(ditch,) if is_divided else ())
    context = prepare_context(PlanRequest(field="plot", no_headland=True), field)
    plan = add_coverage_remark(PlanResult("split-field", 1, "u", True, worked_pct=45.0), context)
    assert plan.remark == f"works only 45 % of the field; the rest is {rest}"
