"""Single tracks left out, worked first or given to a tractor: names, rules, and plans that keep to them."""

import json
from time import process_time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st

from fields.errors import HeadlandError
from fields.geometry.field import Field
from planner.evaluation.ground.coverage import measure_left_out_m2
from planner.evaluation.preparation import prepare_context
from planner.evaluation.site import get_site_moves
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.many_fields import share_obstacles
from planner.pipeline.planning import plan_order
from planner.request.option_texts import parse_line_names
from planner.request.plan_request import PlanRequest
from planner.sweeps.estimates import GroundEstimates
from reports.plan.answer import write_answer
from reports.plan.figures import format_ranking_json
from reports.plan.ranking_table import build_ranking_table
from strategies.lines.line_wishes import LineName, LineWishes
from tests.printing import print_text
from vehicle.missions.plan import HEADLAND_PASS, SWATH, LegTask

pytestmark = pytest.mark.usefixtures("first_layout")

FIELD = Field("rectangle", shapely.box(0.0, 0.0, 150.0, 100.0))
BASE: dict[str, Any] = {"width_m": 6.0, "tractors": (2,), "headland_order": "last"}
WISHES: dict[str, Any] = {"leave_out": "3", "work_first": "7,R1.2", "give": ("2=5-6",)}

NAMES = st.one_of(
    st.builds(LineName, st.just(SWATH), st.integers(1, 9999), st.none() | st.integers(0, 700)),
    st.builds(LineName, st.just(HEADLAND_PASS), st.integers(1, 9999), st.none() | st.integers(0, 9998)),
)


@given(st.lists(NAMES, min_size=1, max_size=8, unique=True))
def test_names_are_read_as_they_are_written(names: list[LineName]) -> None:
    assert parse_line_names(",".join(map(str, names)), "leave_out") == tuple(names)


def test_ranges_and_their_ends() -> None:
    found = parse_line_names(" 3, 7-9,r2".replace("r", "R"), "leave_out")
    assert [str(name) for name in found] == ["3", "7", "8", "9", "R2"]
    assert [name.is_in_range for name in found] == [False, False, True, False, False]
    assert parse_line_names("R1-R3", "give") == parse_line_names("R1-3", "give")


@pytest.mark.parametrize(
    "text", ["", "x", "0", "5-3", "R", "3.2", "R2b", "R1.0", "1-99999", "1;2", "-1", "5bcd", "1-R3"]
)
def test_what_names_no_line_is_refused(text: str) -> None:
    with pytest.raises(HeadlandError, match="names no track; write tracks and headland passes as the map does"):
        parse_line_names(text, "leave_out")


@pytest.mark.parametrize("give", [("1=1-10000", "2=R1-R10000"), (",".join(["1=1-9999", *["1-9999"] * 10_000]),)])
def test_more_names_than_any_layout_has_are_refused_at_once(give: tuple[str, ...]) -> None:
    begun_s = process_time()
    with pytest.raises(HeadlandError, match="names more than 10,000 tracks"):
        PlanRequest(give=give)
    assert PlanRequest(leave_out="1-10000").line_wishes
    assert process_time() - begun_s < 5.0


@pytest.mark.parametrize(
    ("wishes", "sentence"),
    [
        ({"give": ("5",)}, "is not a tractor with its tracks"),
        ({"give": ("0=5",)}, "is not a tractor with its tracks"),
        ({"leave_out": "5", "give": ("1=4-6",)}, "5 is named twice"),
        ({"give": ("1=4", "2=4")}, "4 is named twice"),
        ({"leave_out": "4-6", "work_first": "5"}, "5 is left out and worked first"),
        ({"leave_out": "3", "work_first": "3a"}, "3a is left out and worked first"),
        ({"leave_out": "R1", "give": ("1=R1.2",)}, "R1.2 is named twice"),
        ({"give": ("1=3a", "2=3")}, "3a is named twice"),
        ({"work_first": "5", "operation": "mow"}, "has to work the headland first"),
        ({"work_first": "R1", "operation": "sow"}, "has to work the tracks first"),
    ],
)
def test_wishes_that_exclude_each_other_are_refused(wishes: dict[str, Any], sentence: str) -> None:
    with pytest.raises(HeadlandError, match=sentence):
        PlanRequest(**wishes)


def test_rules_for_the_search_by_hand() -> None:
    tracks = [LegTask(SWATH, 0), LegTask(SWATH, 1), LegTask(SWATH, 1, 1), LegTask(SWATH, 2)]
    lines: Any = [SimpleNamespace(task=task) for task in (*tracks[:3], LegTask(HEADLAND_PASS, 1, 0), tracks[3])]
    out, first, given = (parse_line_names(text, "give") for text in ("1", "3,2b", "R1"))
    wishes = LineWishes(out, first, ((2, given),))
    allowed = wishes.limit(lines, np.array([[1, 1, 1, 1, 0], [1, 0, 1, 0, 1]], bool))
    assert allowed.astype(int).tolist() == [[0, 1, 1, 0, 0], [0, 0, 1, 1, 1]]
    assert wishes.rank(lines, [0, 0, 0, 1, 0]) == [2, 2, 1, 3, 0]
    assert LineWishes().rank(lines, [0, 0, 0, 1, 0]) == [0, 0, 0, 1, 0] and not LineWishes()


@pytest.mark.slow
def test_a_plan_keeps_to_what_is_wanted_and_its_estimate_agrees() -> None:
    order = WorkOrder(PlanRequest(**BASE, **WISHES), field=FIELD)
    context = prepare_context(order)
    planned = plan_order(order)
    ranking, run, best = planned.ranking, planned.run, planned.ranking.best
    assert best.works_enough
    left_out_m2, field_m2 = measure_left_out_m2(context), context.layout.field.due_region.area
    assert best.left_out_m2 == pytest.approx(left_out_m2, rel=0.01)
    assert 0.01 * best.worked_pct * field_m2 + best.missed_m2 + left_out_m2 == pytest.approx(field_m2, rel=0.001)
    answer, (entry, *_) = write_answer(ranking), json.loads(format_ranking_json(ranking))["plans"]
    assert "m2 left out as asked" in answer.work and "left:" not in answer.work, "what was not asked for is no rest"
    assert entry["left_out_m2"] == pytest.approx(left_out_m2, rel=0.01)
    assert "Left out" in print_text(build_ranking_table(ranking), 160)
    worked = [[leg.task for leg in mission.legs if leg.implement] for mission in run.plan.missions]
    numbers = [[task.number for task in tasks if task.kind == SWATH] for tasks in worked]
    assert not {2} & {number for own in numbers for number in own}
    assert {4, 5} <= set(numbers[1]) and not {4, 5} & set(numbers[0])
    firsts = [tasks[0] for tasks in worked]
    assert any(task.kind == SWATH and task.number == 6 for task in firsts)
    sides = [task for task in next(own for own in worked if LegTask(HEADLAND_PASS, 1, 1) in own) if task.is_work]
    before = sides[: sides.index(LegTask(HEADLAND_PASS, 1, 1))]
    assert {task.number for task in before} <= {6}, "the side that is worked first comes before all but track 7"
    whole = plan_order(WorkOrder(PlanRequest(**BASE), field=FIELD)).ranking.best
    left_pct = 100.0 * left_out_m2 / field_m2
    assert best.worked_pct == pytest.approx(whole.worked_pct - left_pct, abs=0.3)
    assert best.finished_s - best.time_s == pytest.approx((whole.finished_s or 0.0) - (whole.time_s or 0.0), abs=20.0)
    estimate = GroundEstimates(prepare_context(WorkOrder(PlanRequest(**BASE), field=FIELD))).estimate(order)
    assert estimate.finished_s == pytest.approx(best.finished_s, rel=0.06)
    assert estimate.works_enough and estimate.worked_pct == pytest.approx(best.worked_pct, abs=0.6)


@pytest.mark.slow
def test_what_the_layout_has_not_is_refused_with_what_it_has() -> None:
    with pytest.raises(HeadlandError, match=r"99 names no work of this layout, which has 1-\d+, R1"):
        plan_order(WorkOrder(PlanRequest(**BASE, leave_out="99"), field=FIELD))
    with pytest.raises(HeadlandError, match="given to tractor 3, and there are only 2 tractors"):
        plan_order(WorkOrder(PlanRequest(**BASE, give=("3=5",)), field=FIELD))


@pytest.mark.slow
def test_plans_with_too_few_tractors_for_a_wish_are_refused_beside_those_with_enough() -> None:
    request = PlanRequest(**BASE | {"tractors": (1, 2)}, give=("2=5",))
    ranking = plan_order(WorkOrder(request, field=FIELD), executor=SerialExecutor()).ranking
    assert ranking.best is not None
    assert {plan.tractors for plan in ranking.plans if "only 1 tractor" in (plan.reason or "")} == {1}


@pytest.mark.slow
def test_formations_do_not_deal_out_single_lines() -> None:
    request = PlanRequest(**BASE, leave_out="3", strategies=("row-by-row",))
    ranking = plan_order(WorkOrder(request, field=FIELD)).ranking
    assert ranking.best is None and "use split-field or interleaved" in str(ranking.plans[0].reason)
    lines = get_site_moves(prepare_context(WorkOrder(PlanRequest(**BASE), field=FIELD))).lines
    assert LineWishes(parse_line_names("3", "leave_out")).find_left_out(lines)


def test_single_tracks_are_of_one_field() -> None:
    requests = [PlanRequest(field, leave_out="3") for field in ("denmark", "iwamizawa")]
    with pytest.raises(HeadlandError, match="Every field numbers its own tracks"):
        share_obstacles(requests)
    assert share_obstacles(requests[:1]) == requests[:1]
