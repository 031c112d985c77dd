"""Parts of a divided field are planned on their own; a field without a plan is drawn with the places."""

import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.context import DoneWork, PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.outputs.pictures import build_refused_picture
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import OBSTACLE, PlanFault
from reports.common.plan_results import PlanRanking, PlanResult
from reports.plan.answer import write_answer
from reports.plan.map_figure import draw_plan_map, render_png
from reports.plan.ranking_page import render_plan_page

pytestmark = pytest.mark.usefixtures("first_layout")

TOUCHED = PlanFault(OBSTACLE, 0, 10.0, 20.0)


DITCH = Obstacle("ditch", shapely.LineString([(-1, 40), (101, 40)]), 0.75)
DIVIDED = Field("divided", shapely.box(0, 0, 100, 90), obstacles=(DITCH,))


def plan_divided(request: PlanRequest | None = None, *done: DoneWork) -> PlanRanking:
    usual = PlanRequest(width_m=6.0, tractors=(1,), strategies=("row-by-row",))
    return plan(request or usual, field=DIVIDED, done=done, executor=SerialExecutor()).ranking


@pytest.fixture(scope="module")
def divided_ranking() -> PlanRanking:
    return plan_divided()


class TestDivided:
    @pytest.mark.slow
    def test_the_other_half_has_a_plan_of_its_own(self, divided_ranking: PlanRanking) -> None:
        """South of the ditch remain 40 - 0.75 - 0.3 m of 100 m."""
        (part,) = divided_ranking.parts
        assert part.ground.m2 == pytest.approx(3895.0) and part.neck_width_m == 0.0
        assert part.plan.worked_pct > 90.0

    def test_the_answer_tells_it(self, divided_ranking: PlanRanking) -> None:
        (sentence,) = [each for each in write_answer(divided_ranking).details if each.startswith("0.39 ha")]
        assert sentence.startswith("0.39 ha at x 50 m, y ") and "no way leads there within the field" in sentence
        assert "Planned on its own (part 2) it takes 0:" in sentence

    @pytest.mark.slow
    def test_what_is_done_of_the_other_half_is_not_planned(self) -> None:
        west, whole = (DoneWork(shapely.box(-1, -1, east, 40), 0.1) for east in (50, 101))
        rest = plan_divided(None, whole)
        assert rest.parts == () and rest.cut_off_m2 == 0.0
        assert not [each for each in (*write_answer(rest).list_sentences(), *rest.field_remarks) if "cut off" in each]
        (part,) = plan_divided(None, west).parts
        assert part.ground.m2 == pytest.approx(0.5 * 3895.0, rel=0.01) and part.ground.x_m > 50.0
        assert part.plan.worked_pct > 90.0

    @pytest.mark.slow
    def test_tracks_are_left_out_where_they_have_that_number(self, divided_ranking: PlanRanking) -> None:
        request = PlanRequest(width_m=6.0, tractors=(1,), strategies=("split-field",), leave_out="1-3")
        ranking = plan_divided(request)
        (part,), (usual,) = ranking.parts, divided_ranking.parts
        assert ranking.best.left_out_m2 > 500.0
        assert part.plan.left_out_m2 is None and part.plan.worked_pct == pytest.approx(usual.plan.worked_pct, abs=0.5)


def test_without_a_plan_the_field_is_drawn_with_the_places() -> None:
    context: PlanningContext = prepare_context(
        WorkOrder(PlanRequest(tractors=(1,)), Field("bare", shapely.box(0, 0, 60, 50)))
    )
    refused = PlanResult("row-by-row", 1, "auto", False, "it touches the pond", faults=(TOUCHED,))
    ranking = PlanRanking("bare", 0.3, 1, (refused,))
    picture = build_refused_picture(context, ranking)
    assert picture.fault_places == ((10.0, 20.0),)
    assert render_png(draw_plan_map(picture, "bare")).startswith(b"\x89PNG")
    page = render_plan_page(ranking, None, {}, picture)
    assert "<svg" in page and "cannot be driven" in page
    (sentence,) = write_answer(ranking).list_sentences()
    assert "it touches the pond" in sentence
