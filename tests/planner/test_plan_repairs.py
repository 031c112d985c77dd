"""Plans that cannot be driven as asked: what is tried, what is found to work, and parts planned on their own."""

from concurrent.futures import Executor
from typing import Any, cast

import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.context import PlanningContext, prepare_context
from planner.evaluation.layout_repairs import NO_REPAIRS, LayoutRepairs
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.outputs.pictures import build_refused_picture
from planner.pipeline.plan_repairs import CandidateEvaluations, repair_refused
from planner.pipeline.planning import plan
from planner.pipeline.worker_tasks import TaskOutcome
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import NO_PATH, OBSTACLE, PlanFault, PlanRanking, PlanResult
from reports.plan.map_figure import draw_plan_map, render_png
from reports.plan.plan_wording import describe_ranking
from reports.plan.ranking_page import render_plan_page

CANDIDATES = [Candidate("row-by-row", 1), Candidate("split-field", 2)]
TOUCHED = PlanFault(OBSTACLE, 0, 10.0, 20.0)


class StubEvaluations(CandidateEvaluations):
    """Evaluations in which a plan works from a margin on; contexts are the repairs themselves."""

    def __init__(self, works_from_m: float, fault: PlanFault = TOUCHED) -> None:
        request = PlanRequest(tractors=(1, 2), margin_m=0.3)
        super().__init__(request, CANDIDATES, cast(Executor, None))
        self.works_from_m, self.fault = works_from_m, fault
        self.tried: list[tuple[float, list[int]]] = []

    def evaluate_wave(self, context: Any, packed_context: bytes, wave: Any) -> list[TaskOutcome]:
        margin_m = context.margins_m.get(0, 0.3)
        self.tried.append((margin_m, list(wave)))
        works = margin_m >= self.works_from_m
        outcomes = []
        for index in wave:
            candidate = self.candidates[index]
            faults = () if works else (self.fault,)
            result = PlanResult(candidate.strategy, candidate.tractors, "auto", works, faults=faults)
            outcomes.append(TaskOutcome(result))
            self.results[index] = result
        return outcomes


@pytest.fixture
def without_packing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("planner.pipeline.plan_repairs.pack_context", lambda context: b"")


def repair(stub: StubEvaluations) -> LayoutRepairs:
    stub.evaluate_wave(NO_REPAIRS, b"", [0, 1])
    stub.tried.clear()
    return repair_refused(stub, lambda request, layout_repairs: layout_repairs)


@pytest.mark.usefixtures("without_packing")
def test_the_smallest_margin_of_the_steps_is_found_with_one_candidate_and_serves_the_others() -> None:
    stub = StubEvaluations(0.7)
    assert repair(stub).margins_m == {0: 0.7}
    assert stub.tried == [(0.5, [0]), (0.7, [0]), (0.7, [1])]


@pytest.mark.usefixtures("without_packing")
def test_a_plan_that_works_is_left_alone() -> None:
    stub = StubEvaluations(0.2)
    assert repair(stub) == NO_REPAIRS and not stub.tried


@pytest.mark.usefixtures("without_packing")
def test_what_no_step_helps_ends() -> None:
    stub = StubEvaluations(50.0)
    assert repair(stub).margins_m == {0: 3.0}
    assert len(stub.tried) <= 8


@pytest.mark.usefixtures("without_packing")
def test_where_no_path_leads_there_is_first_more_headland_and_then_less_work() -> None:
    stub = StubEvaluations(50.0, PlanFault(NO_PATH, None, 0.0, 0.0))
    repairs = repair(stub)
    assert (repairs.extra_passes, repairs.skips_unreachable) == (1, True)


@pytest.fixture(scope="module")
def divided_ranking() -> PlanRanking:
    ditch = Obstacle("ditch", shapely.LineString([(-1, 40), (101, 40)]), 0.75)
    field = Field("divided", shapely.box(0, 0, 100, 90), obstacles=(ditch,))
    request = PlanRequest(width_m=6.0, tractors=(1,), strategies=("row-by-row",))
    return plan(request, field=field, executor=SerialExecutor()).ranking


class TestDivided:
    @pytest.mark.slow
    def test_the_other_half_has_a_plan_of_its_own(self, divided_ranking: PlanRanking) -> None:
        """South of the ditch remain 40 - 0.75 - 0.3 m of 100 m."""
        (part,) = divided_ranking.parts
        assert part.ground.m2 == pytest.approx(3895.0) and part.neck_width_m == 0.0
        assert part.plan is not None and part.plan.worked_pct is not None and part.plan.worked_pct > 90.0

    def test_the_answer_tells_it(self, divided_ranking: PlanRanking) -> None:
        (sentence,) = [each for each in describe_ranking(divided_ranking) if each.startswith("0.39 ha")]
        assert sentence.startswith("0.39 ha at x 50 m, y ") and "no way leads there within the field" in sentence
        assert "Planned on its own (part 2) it takes 0:" in sentence


def test_without_a_plan_the_field_is_drawn_with_the_places() -> None:
    context: PlanningContext = prepare_context(PlanRequest(tractors=(1,)), Field("bare", shapely.box(0, 0, 60, 50)))
    refused = PlanResult("row-by-row", 1, "auto", False, "it touches the pond", faults=(TOUCHED,))
    ranking = PlanRanking("bare", 0.3, 1, (refused,), changes=("drive 8 km/h",))
    picture = build_refused_picture(context, ranking)
    assert picture.fault_places == ((10.0, 20.0),)
    assert render_png(draw_plan_map(picture, "bare")).startswith(b"\x89PNG")
    page = render_plan_page(ranking, None, {}, picture)
    assert "<svg" in page and "cannot be driven" in page
    (sentence,) = describe_ranking(ranking)
    assert "it touches the pond" in sentence and sentence.endswith("Found to work: drive 8 km/h.")
