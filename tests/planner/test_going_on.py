"""Plans gone on with: what a saved plan, a file of ground or logs say is done is neither charged nor driven again."""

import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from fields.documents.reader import read_field, read_polygons
from fields.errors import FieldError
from fields.geometry.field import Field
from fields.geometry.overlays import unite_areas
from planner.errors import HeadlandError
from planner.evaluation.candidates.evaluate import Candidate
from planner.evaluation.context import DoneWork, Stand
from planner.evaluation.ground.coverage import measure_coverage
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.ground.unworked_area import find_unworked_areas, measure_requested_share
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.settings import FarmTimes
from planner.pipeline import going_on
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.farm_inputs import GivenOptions
from planner.pipeline.going_on import continue_order, cut_run, keep_continuing, read_continued_order, sum_used
from planner.pipeline.outputs.driving_steps import list_steps
from planner.pipeline.outputs.saved_plans import simulate_saved_plan
from planner.pipeline.planning import PlanningResult, plan, plan_order
from planner.request.plan_request import PlanRequest
from reports.common.wording import format_duration
from reports.plan.answer import write_answer
from reports.plan.leg_list import describe_leg
from strategies.lines.done_lines import START_OVERLAP_M
from strategies.lines.work_line import STRAIGHT_RAD
from strategies.rules.supply import Supply
from tests.drawn_fields import feature, write_features
from vehicle.missions.plan import Leg

pytestmark = pytest.mark.usefixtures("first_layout")

WIDTH_M, CUT_S = 4.0, 300.0
OUTLINE: list[list[float]] = [[0, 0], [90, 0], [90, 60], [0, 60], [0, 0]]


def write_field(path: Path, outline: list[list[float]]) -> str:
    return str(write_features(path, feature({"type": "Polygon", "coordinates": [outline]})))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("going-on")


@pytest.fixture(scope="module")
def whole(folder: Path) -> PlanningResult:
    """A plan of two tractors, saved as plan.json."""
    field = write_field(folder / "field.geojson", OUTLINE)
    request = PlanRequest(field=field, local=True, width_m=WIDTH_M, tractors=(2,), strategies=("split-field",))
    answer = plan(request, executor=SerialExecutor())
    answer.save(folder / "plan.json")
    return answer


def go_on(folder: Path, source: str, without: tuple[int, ...] = (), **changes: Any) -> PlanningResult:
    continued = read_continued_order([source], without)
    request = replace(continued.request, **changes)
    return plan(request, done=source, without=without, executor=SerialExecutor())


def lay_out_rest(source: str) -> Field:
    """The field with what is left of it where a saved plan is left, without a plan for it."""
    order = continue_order(WorkOrder(read_continued_order([source]).request, done=(source,)))
    return going_on.go_on(prepare_context(order), order).layout.field


@pytest.fixture(scope="module")
def rests(folder: Path, whole: PlanningResult) -> dict[tuple[int, ...], PlanningResult]:
    """The rest of the plan after five minutes, by both tractors and without one."""
    return {without: go_on(folder, f"{folder}/plan.json@0:05", without) for without in ((), (1,))}


@pytest.mark.slow
@pytest.mark.parametrize("without", [(), (1,)])
def test_the_rest_takes_what_the_plan_would_have_taken_and_leaves_no_more(
    whole: PlanningResult, rests: dict[tuple[int, ...], PlanningResult], without: tuple[int, ...]
) -> None:
    rest = rests[without]
    left_s = whole.run.finish_s - CUT_S
    # Within a few percent on real fields (tests/benchmarks/going_on.py); here half a dozen long lines are left.
    assert rest.run.duration_s <= 1.15 * (left_s.sum() if without else left_s.max())
    begun = compute_swept_area(cut_run(whole.run, CUT_S), whole.context).ground
    later = compute_swept_area(rest.run, rest.context).ground
    field = whole.context.layout.field.boundary
    worked_m2 = shapely.intersection(unite_areas(np.concatenate([begun, later])), field).area
    corners_pct = 100.0 * 2.0 * 10.0 / field.area  # a corner may be worked the other way round, and 10 m2 stay at it
    assert 100.0 * worked_m2 / field.area >= measure_coverage(whole.run, whole.context).worked_pct - corners_pct


@pytest.mark.slow
def test_tractors_that_would_be_in_one_anothers_way_go_on_in_the_order_of_before(tmp_path: Path) -> None:
    """Three abreast, each on its track: tracks in any other order lead them across one another's ends."""
    request = PlanRequest(field="iwamizawa", width_m=3.0, tractors=(3,), strategies=("row-by-row",))
    before, cut_s = plan(request, executor=SerialExecutor()), 1358
    before.save(tmp_path / "plan.json")
    rest = go_on(tmp_path, f"{tmp_path}/plan.json@0:{cut_s // 60}:{cut_s % 60}", strategies=("split-field",))
    assert rest.run.duration_s <= 1.1 * (before.run.duration_s - cut_s)


@pytest.mark.slow
def test_done_work_is_not_charged_and_driven_again_only_where_lines_join(
    whole: PlanningResult, rests: dict[tuple[int, ...], PlanningResult]
) -> None:
    rest = rests[()]
    assert whole.run is not None and rest.run is not None
    begun = unite_areas(compute_swept_area(cut_run(whole.run, CUT_S), whole.context).ground)
    done_m2 = shapely.intersection(begun, whole.context.layout.field.boundary).area
    assert rest.ranking.area_ha == pytest.approx(whole.ranking.area_ha - 1e-4 * done_m2, rel=0.01)
    again = shapely.intersection(compute_swept_area(rest.run, rest.context).ground, begun.buffer(-0.3))
    # Each of the lines that is left ends at done work twice at most; headland corners are worked twice in any plan.
    joins = 2 * len(again)
    assert shapely.area(again).sum() <= joins * WIDTH_M * (START_OVERLAP_M + WIDTH_M)
    assert rest.ranking.best.cost < whole.ranking.best.cost


@pytest.mark.slow
def test_tractors_begin_where_they_stand(whole: PlanningResult, rests: dict[tuple[int, ...], PlanningResult]) -> None:
    assert whole.run is not None
    begun = cut_run(whole.run, CUT_S)
    for without, tractors in (((), (0, 1)), ((1,), (1,))):
        run = rests[without].run
        assert run.plan.tractors == len(tractors)
        for number, before in enumerate(tractors):
            x, y, heading = run.get_poses(number)[0]
            x0, y0, heading0 = begun.get_poses(before)[-1]
            assert math.hypot(x - x0, y - y0) < 0.2
            # Beside a line and astray of it a tractor goes on as if it headed back to it already.
            assert abs(math.remainder(heading - heading0, 2.0 * math.pi)) < 2.0 * STRAIGHT_RAD


@pytest.mark.slow
@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi])
def test_who_has_no_work_is_counted_as_resting_and_drives_out_of_the_way(heading: float) -> None:
    """One track is left; a tractor stands at its begin, and another in the middle of it."""
    field = Field("plot", shapely.box(0, 0, 90, 60))
    stands = Stand((4.0, 30.0, 0.0)), Stand((50.0, 30.0, heading))
    done = DoneWork(field.boundary - shapely.box(0, 28, 90, 32), 0.1, stands, numbers=(1, 3))
    values: dict[str, Any] = {"width_m": WIDTH_M, "no_headland": True, "price_per_tractor": 100.0}
    request = PlanRequest(tractors=(2,), strategies=("split-field",), **values)
    rest = plan_order(WorkOrder(request, field=field, done=(done,)), executor=SerialExecutor())
    best, run = rest.ranking.best, rest.run
    assert best.resting == (2,)
    assert "1 tractor (tractor 2 rests), split-field" in write_answer(rest.ranking).decision
    assert "no work that is left is worth the drive for tractor 2" in best.remarks
    assert "tractor 2 is tractor 3 of the plan before" in best.remarks
    _, y, _ = run.plan.missions[1].end
    assert abs(y - 30.0) > 5.0 and run.min_clearance_m >= request.clearance_m
    assert best.cost == pytest.approx(run.duration_s / 3600.0 * 40.0), "who rests is not paid"
    step = list_steps(run, WIDTH_M)[1][0]
    assert describe_leg(step) == "drive aside and rest"


@pytest.mark.slow
def test_lists_and_the_time_at_which_a_plan_is_left_know_the_breaks_of_the_day(folder: Path, tmp_path: Path) -> None:
    field = write_field(tmp_path / "field.geojson", OUTLINE)
    values = {"field": field, "local": True, "width_m": WIDTH_M, "strategies": ("split-field",), "start_s": 6 * 3600}
    times = FarmTimes(unfold_s=100.0, fold_s=0.0, breaks=("06:05-06:35",))
    whole = plan_order(WorkOrder(PlanRequest(tractors=(2,), **values), times=times), executor=SerialExecutor())
    saved = Path(whole.save(tmp_path / "plan.json"))
    steps, best, run = simulate_saved_plan(saved).steps, whole.ranking.best, whole.run
    assert run is not None
    for own in steps:
        assert own[0].clock_s == 100.0
        assert all(not 300.0 < step.clock_s < 2100.0 for step in own)
        assert math.fsum(step.pause_s for step in own) == pytest.approx(1800.0, abs=0.1)
        (paused,) = [step for step in own if step.pause_s]
        assert f"with a break of {format_duration(paused.pause_s)}" in describe_leg(paused)
    ends = [step.clock_s + step.seconds + step.pause_s for own in steps for step in own if step.kind != "leave"]
    assert max(ends) == pytest.approx(best.stated_end_s, abs=1.0)

    due = [lay_out_rest(f"{saved}@{clock}").area_ha for clock in ("6:05", "6:20", "6:35", "6:36")]
    assert due[0] == due[1] == due[2] > due[3]
    done_m2 = unite_areas(compute_swept_area(cut_run(run, 200.0), whole.context).ground).area
    assert due[0] == pytest.approx(whole.ranking.area_ha - 1e-4 * done_m2, rel=0.02)
    content = json.loads(saved.read_text(encoding="utf-8"))
    content["notes"]["stated"]["workday"] = {"before_s": 100.0, "breaks_s": [], "shift_s": [6 * 3600, 6 * 3600 + 180]}
    saved.write_text(json.dumps(content), encoding="utf-8")
    first, second, past_first = (lay_out_rest(f"{saved}@{clock}") for clock in ("6:02", "30:01", "6:07"))
    assert first.area_ha > past_first.area_ha > second.area_ha, "hours go on past 24 on the next day"
    told = r"is in the field from 06:01 to 06:0\d,? .*day.*, and 6:02 is taken as the first one; 30:02 is a day later"
    assert any(re.search(told, one) for one in first.remarks)
    assert not any("a day later" in one for one in second.remarks)
    del content["notes"]["stated"]["workday"]
    saved.write_text(json.dumps(content), encoding="utf-8")  # as an earlier Headland saved it
    assert simulate_saved_plan(saved).steps[0][0].clock_s == 100.0
    with pytest.raises(HeadlandError, match="is not within that"):
        go_on(tmp_path, f"{saved}@6:36")


@pytest.mark.slow
def test_a_plan_of_the_rest_goes_on_in_turn(
    folder: Path, whole: PlanningResult, rests: dict[tuple[int, ...], PlanningResult]
) -> None:
    rests[()].save(folder / "rest.json")
    last = go_on(folder, f"{folder}/rest.json@0:02")
    assert last.ranking.area_ha < rests[()].ranking.area_ha < whole.ranking.area_ha
    # A corner that the plan before has left may now be worked.
    assert last.run.duration_s == pytest.approx(rests[()].run.duration_s - 120.0, rel=0.05, abs=30.0)


@pytest.mark.slow
def test_what_does_not_belong_together_is_refused_with_what_helps(folder: Path, whole: PlanningResult) -> None:
    source, request = f"{folder}/plan.json@0:05", whole.context.request
    wider = write_field(folder / "wider.geojson", [[0, 0], [95, 0], [95, 60], [0, 60], [0, 0]])
    away = DoneWork(shapely.box(500.0, 0.0, 600.0, 60.0), 0.1)
    cases: list[tuple[PlanRequest, Any, str]] = [
        (replace(request, width_m=5.0), source, "is for a working width of 4 m, and 5 m are asked for; give width_m 4"),
        (replace(request, field=wider), source, r"was made for: they differ by 5\.0 m\. Give the field as it was then"),
        (replace(request, field="denmark", local=False), source, "is for another field than 'denmark'"),
        (
            request,
            f"{folder}/plan.json@9:00",
            r"from 0:00 h to 0:\d\d h, as simulated .*, and 9:00 is not within that; give a time within it",
        ),
        (request, f"{folder}/plan.json", r"say up to when it was driven, such as plan.json@13:20"),
        (request, f"{folder}/plan.json@0:75", "is left at 0:75, which is no time, as minutes and seconds go to 59"),
        (request, f"{folder}/nothing.gpkg", "There is no file"),
        (request, 5, "done holds 5, which is no source of done work"),
        (request, away, "Nothing of what is given as done lies in field"),
        (request, DoneWork(shapely.box(-1.0, -1.0, 91.0, 61.0), 0.1), "is done; there is nothing left to plan"),
        (replace(request, tractors=(1,)), source, "2 tractors stand on the field .* plan with 2 tractors or more"),
        (replace(request, strategies=("row-by-row",)), source, "each for itself"),
    ]
    for asked, done, words in cases:
        with pytest.raises(HeadlandError, match=words):
            plan(asked, done=done, executor=SerialExecutor())
    with pytest.raises(HeadlandError, match="names machine 3, and the plan has 2"):
        read_continued_order([source], (3,))
    with pytest.raises(HeadlandError, match="leaves no machine"):
        read_continued_order([source], (1, 2))
    with pytest.raises(HeadlandError, match="without leaves machines out of a saved plan, and there is none in done"):
        plan(request, without=1, executor=SerialExecutor())
    (folder / "garbled.json").write_text("{", encoding="utf-8")
    with pytest.raises(HeadlandError, match=r"garbled.json' cannot be gone on with\. This is no saved plan"):
        read_continued_order([f"{folder}/garbled.json@0:05"])


def write_changed_plan(folder: Path, name: str, change: Callable[[dict[str, Any]], None]) -> str:
    """The path of plan.json with a change, under another name."""
    saved = json.loads((folder / "plan.json").read_text(encoding="utf-8"))
    change(saved)
    (folder / name).write_text(json.dumps(saved), encoding="utf-8")
    return f"{folder}/{name}"


@pytest.mark.slow
def test_a_deadline_that_has_passed_is_not_that_of_the_next_day(folder: Path, whole: PlanningResult) -> None:
    late = write_changed_plan(
        folder, "late.json", lambda saved: saved["scenario"].update(start_s=46800, deadline_s=46800 + 240)
    )
    assert whole.run.duration_s > 300.0
    with pytest.raises(HeadlandError, match=r"late.json', 13:04, has passed at 13:05; give another deadline_s"):
        go_on(folder, f"{late}@13:05")
    with pytest.raises(HeadlandError, match=r"from 13:00 to 13:\d\d, as .*, and 12:59 is not within that"):
        go_on(folder, f"{late}@12:59")
    assert go_on(folder, f"{late}@13:05", deadline_s=46800 + 1200).ranking.best is not None


@pytest.mark.slow
def test_a_deadline_counts_from_when_the_plan_is_left(folder: Path, whole: PlanningResult) -> None:
    started = write_changed_plan(folder, "started.json", lambda saved: saved["scenario"].update(start_s=46800))
    values = {"field": whole.context.request.field, "local": True, "deadline": "15:00"}
    request = GivenOptions(values, ["deadline"], (f"{started}@13:05",)).build_request()
    assert (request.start_s, request.deadline_s) == (47100, 54000)
    with pytest.raises(HeadlandError, match="The deadline deadline_s needs a start"):
        GivenOptions(values, ["deadline"], (f"{folder}/plan.json@0:05",)).build_request()


@pytest.mark.slow
def test_a_plan_that_refills_goes_on_with_its_farm_only(folder: Path, whole: PlanningResult) -> None:
    source = (
        write_changed_plan(folder, "tank.json", lambda saved: saved["scenario"].update(refill="headland")) + "@0:05"
    )
    given = GivenOptions({"field": "iwamizawa", "width": 3.0}, [], (source,))
    with pytest.raises(HeadlandError, match=r"tank.json' has a tank, .* add farm and implement by which it was made"):
        given.build_order(given.build_request())
    with pytest.raises(HeadlandError, match="add farm and implement"):
        plan(whole.context.request, done=source, executor=SerialExecutor())


@pytest.mark.slow
def test_python_takes_the_values_of_the_plan_for_those_that_are_defaults(folder: Path, whole: PlanningResult) -> None:
    bare = PlanRequest(field=whole.context.request.field, local=True)
    answer = plan(bare, done=[Path(f"{folder}/plan.json@0:05")], without=1, executor=SerialExecutor())
    assert replace(answer.context.request, tractor="eg105") == replace(whole.context.request, tractors=(1,))
    assert [one.strategy for one in answer.ranking.plans] == ["split-field"]


@pytest.mark.slow
def test_of_several_plans_the_last_has_the_machines(folder: Path, whole: PlanningResult) -> None:
    sources = [f"{folder}/plan.json@0:01", f"{folder}/plan.json@0:05"]
    answer = plan(whole.context.request, done=sources, without=(2,), executor=SerialExecutor())
    assert len(answer.context.going_on.stands) == 1
    assert any("plan.json@0:05, the last of 2 plans" in one for one in answer.context.layout.field.remarks)


@pytest.mark.slow
def test_a_plan_given_twice_goes_on_like_one(folder: Path, whole: PlanningResult) -> None:
    source = f"{folder}/plan.json@0:05"
    going_on = plan(whole.context.request, done=[source, source], executor=SerialExecutor()).context.going_on
    assert going_on is not None and len(going_on.stands) == 2 and going_on.numbers == (1, 2)


@pytest.mark.slow
def test_options_that_are_given_win_over_the_plan(folder: Path, whole: PlanningResult) -> None:
    values = {"field": "iwamizawa", "width": 3.0, "turn": "u"}
    given = GivenOptions(values, ["turn"], (f"{folder}/plan.json@0:05",), (2,))
    request = given.build_request()
    assert request == replace(whole.context.request, tractors=(1,), turn="u")
    order = given.build_order(request)
    assert order.done == given.done and order.without == (2,)
    assert order.layout is not None and order.layout.fits(whole.context.layout), "tracks stay as they are"


@pytest.mark.slow
def test_ground_of_a_file_is_done_by_whoever_worked_it(folder: Path, whole: PlanningResult) -> None:
    (folder / "May #2").mkdir()
    half = write_field(folder / "May #2" / "worked.geojson", [[0, 0], [45, 0], [45, 60], [0, 60], [0, 0]])
    answer = plan(whole.context.request, done=half, executor=SerialExecutor())
    assert answer.ranking.area_ha == pytest.approx(0.27)
    swept = unite_areas(compute_swept_area(answer.run, answer.context).ground)
    assert shapely.intersection(swept, shapely.box(45.0, 0.0, 90.0, 60.0)).area >= 0.96 * 2700.0
    west_m = min(float(leg.points[:, 0].min()) for m in answer.run.plan.missions for leg in m.legs if leg.implement)
    assert west_m > 45.0 - WIDTH_M - START_OVERLAP_M - 3.0  # the guided point is up to a tool's length ahead of the bar


@pytest.mark.slow
def test_a_headland_that_is_done_is_no_ground_to_be_left(folder: Path, whole: PlanningResult) -> None:
    """A rest without headland, most of which was worked before: shares are those of what is left."""
    ring = shapely.box(-1.0, -1.0, 91.0, 61.0) - shapely.box(2.0 * WIDTH_M, 2.0 * WIDTH_M, 80.0, 52.0)
    request = replace(whole.context.request, no_headland=True)
    answer = plan(request, done=DoneWork(ring, 0.1), executor=SerialExecutor())
    assert 0.0 < measure_requested_share(answer.context) <= 1.0
    due_m2 = answer.context.layout.field.due_region.area
    assert sum(one.area_m2 for one in find_unworked_areas(answer.context)) <= due_m2
    assert not any("-" in one.split(" %")[0][-5:] for one in write_answer(answer.ranking).list_sentences())


@pytest.mark.slow
def test_who_stands_without_work_rests_and_is_named(folder: Path, whole: PlanningResult) -> None:
    """Numbers are those of before, whoever rests."""
    for corner in (shapely.box(0.0, 0.0, 20.0, 4.0), shapely.box(70.0, 56.0, 90.0, 60.0)):
        nearly_all = DoneWork(shapely.box(-1.0, -1.0, 91.0, 61.0) - corner, 0.1)
        rest = plan(whole.context.request, done=(f"{folder}/plan.json@0:05", nearly_all), executor=SerialExecutor())
        best, run, going_on = rest.ranking.best, rest.run, rest.context.going_on
        assert best is not None and best.works_enough, "what was done before counts"
        (idle,) = best.resting
        assert f"no work that is left is worth the drive for tractor {idle}" in (best.remark or "")
        assert "of the plan before" not in (best.remark or "")
        assert run.plan.tractors == 2
        assert run.min_clearance_m >= rest.context.request.clearance_m
        begin, other = run.plan.missions[2 - idle].legs[0].points[0], going_on.stands[2 - idle].pose
        assert begin == pytest.approx(other[:2], abs=0.01), "the other drives"


@pytest.mark.slow
def test_the_last_seconds_of_a_plan_are_driven_or_said_to_be_done(folder: Path, whole: PlanningResult) -> None:
    for before_end_s in (2, 10, 30):
        at_s = round(whole.run.duration_s) - before_end_s
        source = f"{folder}/plan.json@0:{at_s // 60:02d}:{at_s % 60:02d}"
        try:
            ranking = go_on(folder, source).ranking
        except HeadlandError as error:
            assert "is done; there is nothing left to plan" in str(error)
            continue
        best = ranking.best
        assert best.works_enough if best else re.match("Everything is done|Nothing more can be done", ranking.refusal)


def test_a_load_is_counted_from_the_last_stop() -> None:
    supply = Supply(100.0, 0.1, 60.0)
    legs = [
        Leg(np.array([[0.0, 0.0], [50.0, 0.0]]), 1.0, implement=True),
        Leg(np.array([[50.0, 0.0], [60.0, 0.0]]), 1.0, stand_s=60.0),
        Leg(np.array([[60.0, 0.0], [90.0, 0.0]]), 1.0, implement=True),
    ]
    assert sum_used(legs, supply, 4.0) == pytest.approx(0.1 * 30.0 * 4.0)
    assert sum_used(legs[:1], supply, 4.0) == pytest.approx(0.1 * 50.0 * 4.0)
    assert sum_used([], supply, 4.0) == 0.0
    assert [sum_used(some, supply, 4.0, 7.0) for some in (legs, legs[:1], [])] == pytest.approx([12.0, 27.0, 7.0])


def test_of_strategies_that_deal_alike_one_goes_on_that_keeps_the_clearance() -> None:
    context: Any = SimpleNamespace(going_on=DoneWork(shapely.Polygon(), 0.1))
    candidates = [Candidate(name, tractors) for tractors in (1, 2) for name in ("interleaved", "split-field")]
    assert keep_continuing(context, candidates) == [Candidate("split-field", 1), Candidate("split-field", 2)]
    assert keep_continuing(context, candidates[::2]) == candidates[::2]


def test_polygons_are_read_in_metres_of_a_field(folder: Path) -> None:
    field = read_field("denmark")
    degrees = field.to_wgs84([(0.0, 0.0), (50.0, 0.0), (50.0, 20.0), (0.0, 20.0)]).tolist()
    (polygon,) = read_polygons(write_field(folder / "degrees.geojson", [*degrees, degrees[0]]), field)
    assert polygon.symmetric_difference(shapely.box(0.0, 0.0, 50.0, 20.0)).area < 1e-3


@pytest.mark.slow
def test_a_rest_without_swaths_is_planned_and_one_without_lines_is_said_to_be_nothing(
    folder: Path, whole: PlanningResult
) -> None:
    request, inner = whole.context.request, DoneWork(shapely.box(8.0, 8.0, 82.0, 52.0), 0.1)
    for tractors in (1, 2):
        answer = plan(replace(request, tractors=(tractors,)), done=inner, executor=SerialExecutor())
        assert answer.ranking.best.worked_pct > 90.0
    formation = replace(request, strategies=("row-by-row",))
    (refused,) = plan(formation, done=inner, executor=SerialExecutor()).ranking.plans
    assert "need 2 tracks, and there is work on 0; use split-field" in str(refused.reason)
    rest = shapely.box(-1.0, -1.0, 91.0, 61.0) - shapely.box(0.0, 0.0, 0.3, 60.0)  # 18 m2 along an edge
    (refused,) = plan(
        replace(request, tractors=(1,)), done=DoneWork(rest, 0.1), executor=SerialExecutor()
    ).ranking.plans
    assert "no piece that is worth a drive" in str(refused.reason)


def test_polygons_for_a_field_in_metres_are_no_degrees_and_a_key_chooses_one(folder: Path) -> None:
    field = read_field(write_field(folder / "metres.geojson", OUTLINE), local=True)
    degrees = write_field(folder / "lonlat.geojson", [[9.0, 56.0], [9.01, 56.0], [9.01, 56.01], [9.0, 56.0]])
    with pytest.raises(FieldError, match=r"is in longitude and latitude, and field .* is not; give it in"):
        read_polygons(degrees, field)
    boxes = {"west": shapely.box(0.0, 0.0, 30.0, 60.0), "east": shapely.box(60.0, 0.0, 90.0, 60.0)}
    features = [feature(shapely.geometry.mapping(one), name=name) for name, one in boxes.items()]
    path = write_features(folder / "two.geojson", *features)
    assert len(read_polygons(path, field)) == 2
    for name, one in boxes.items():
        (polygon,) = read_polygons(f"{path}#{name}", field)
        assert polygon.equals(one)
    with pytest.raises(FieldError, match="has no field 'north'"):
        read_polygons(f"{path}#north", field)
