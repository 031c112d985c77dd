"""Worked headlands: rounds as legs of every plan, by the rules of the planner, with little ground left."""

import math
from collections.abc import Callable
from functools import cache
from itertools import groupby
from typing import Any

import numpy as np
import pytest
import shapely
from shapely.ops import substring

from fields import Field
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.outputs.pictures import describe_field
from planner.pipeline.planning import plan
from planner.request.plan_request import PlanRequest
from strategies.registry import STRATEGIES
from tests.planner.excursions import measure_excursion_m
from vehicle.missions.plan import HEADLAND_PASS, SWATH, check_plan
from vehicle.missions.plan_file import format_plan, parse_plan
from vehicle.missions.run import DONE, SimulationRun

pytestmark = pytest.mark.usefixtures("first_layout")

NO_TRACK = "No track fits inside the headland passes, so that the bearing asked for changes nothing."


def planned_strips(site: PlanningContext, run: SimulationRun) -> shapely.Geometry:
    """Ground that the bar passes over if every leg is driven as planned; it is `tool_m` behind the guided point."""
    tool, half = site.driving_rules.tool_m, 0.5 * site.layout.width_m
    strips = []
    for mission in run.plan.missions:
        for down, group in groupby(mission.legs, key=lambda leg: leg.implement):
            points = np.concatenate([leg.points for leg in group])
            if down:
                ahead = (points[1] - points[0]) / np.hypot(*(points[1] - points[0]))
                line = substring(shapely.LineString([points[0] - tool * ahead, *points]), 0.0, -tool)
                strips.append(line.buffer(half, cap_style="flat"))
    return shapely.union_all(strips, grid_size=1e-6)


@pytest.fixture(scope="module")
def rectangle(place: Callable[..., PlanningContext]) -> Callable[..., PlanningContext]:
    """The field of 120 m by 60 m, its headland worked."""
    return cache(lambda **options: place(shapely.box(0, 0, 120, 60), no_headland=False, **options))


def of(site: PlanningContext, name: str, tractors: int) -> Outcome:
    return simulate_candidate(site, Candidate(name, tractors))


def test_square_corners_leave_next_to_nothing(rectangle: Any) -> None:
    site = rectangle(corners="square", overhang_m=5.0)
    evaluation = of(site, "split-field", 1)
    assert evaluation.result.feasible and evaluation.run is not None
    assert planned_strips(site, evaluation.run).intersection(site.layout.field.boundary).area >= 0.995 * 7200
    assert (evaluation.result.worked_pct or 0.0) > 99.0
    assert evaluation.result.headland_passes == site.layout.headland_passes == 3


def test_round_corners_leave_what_lies_outside_their_arc(rectangle: Any) -> None:
    """Three corners of the outermost round are driven round; where it begins, it ends, and that one is whole."""
    outermost = shapely.box(0, 0, 120, 60).difference(shapely.box(3, 3, 117, 57))
    site = rectangle(corners="round", overhang_m=5.0)
    evaluation = of(site, "split-field", 1)
    assert evaluation.result.feasible and evaluation.run is not None
    swept = planned_strips(site, evaluation.run)
    left = outermost.difference(swept)
    missed = [shapely.box(x, y, x + 9, y + 9).intersection(left).area for x in (0, 111) for y in (0, 51)]
    # What lies outside the arc of the outer end of the bar.
    said = (1.0 - math.pi / 4.0) * (site.driving_rules.radius_m + 1.5) ** 2
    assert sorted(missed)[0] < 0.3 * said
    assert sorted(missed)[1:] == pytest.approx([said] * 3, rel=0.1)


@pytest.mark.parametrize("name", sorted(STRATEGIES))
@pytest.mark.parametrize("tractors", [2, pytest.param(3, marks=pytest.mark.matrix)])
def test_every_strategy_works_the_headland(rectangle: Any, name: str, tractors: int) -> None:
    site = rectangle(corners="square", overhang_m=5.0)
    result, run = (evaluation := of(site, name, tractors)).result, evaluation.run
    assert result.feasible, result.reason
    assert run.outcome == DONE and run.contacts == ()
    check_plan(run.plan)
    assert format_plan(parse_plan(format_plan(run.plan))) == format_plan(run.plan)
    numbers = {
        leg.task.number for mission in run.plan.missions for leg in mission.legs if leg.task.kind == HEADLAND_PASS
    }
    assert numbers == {1, 2, 3}
    worked = sum(leg.length_m for mission in run.plan.missions for leg in mission.legs if leg.task.kind == SWATH)
    assert worked == pytest.approx(site.layout.total_length_m, abs=0.01)
    assert (result.worked_pct or 0.0) > 98.5
    assert measure_excursion_m(run, site) < 0.5
    assert 0.0 < result.headland_s < (result.time_s or 0.0)


@pytest.mark.parametrize("order", ["first", "last"])
def test_the_headland_comes_before_all_tracks_or_after(rectangle: Any, order: str) -> None:
    """Whatever order its sides are quickest in."""
    run = of(rectangle(headland_order=order), "split-field", 1).run
    tasks = [leg.task for leg in run.plan.missions[0].legs if leg.implement]
    kinds = [task.kind for task in tasks]
    assert {task.number for task in tasks if task.kind == HEADLAND_PASS} == {1, 2, 3}
    assert kinds == sorted(
        kinds, key=(HEADLAND_PASS, SWATH).index if order == "first" else (SWATH, HEADLAND_PASS).index
    )


@pytest.mark.parametrize(
    ("operation", "orders"), [("mow", ("first",)), ("sow", ("last",)), ("till", ("first", "last"))]
)
def test_operations_allow_their_orders(operation: str, orders: tuple[str, ...]) -> None:
    assert PlanRequest(operation=operation, no_headland=False).headland_orders == orders
    assert PlanRequest(operation=operation, headland_order="first", no_headland=False).headland_orders == ("first",)
    assert PlanRequest(operation=operation, no_headland=True).headland_orders == ()


def test_tracks_only_leaves_the_headland(place: Any) -> None:
    site = place(shapely.box(0, 0, 120, 60), no_headland=True)
    result = of(site, "split-field", 1).result
    assert site.headland_passes == () and result.headland_passes == 0 and result.headland_s is None


@pytest.mark.slow
@pytest.mark.parametrize(("name", "tractors"), [
    ("netherlands", 2),
    *(pytest.param(name, tractors, marks=pytest.mark.matrix)
      for name, tractors in (("netherlands", 1), ("netherlands", 3), ("sweden", 1), ("sweden", 2), ("sweden", 3))),
])  # fmt: skip
def test_samples_are_worked_whole(name: str, tractors: int) -> None:
    site = prepare_context(WorkOrder(PlanRequest(field=name, no_headland=False, corners="square", overhang_m=5.0)))
    evaluation = of(site, "split-field", tractors)
    assert evaluation.result.feasible and evaluation.run is not None, evaluation.result.reason
    assert (evaluation.result.worked_pct or 0.0) > 99.0 and measure_excursion_m(evaluation.run, site) < 0.5


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"operation": "hoe"}, "operation 'hoe' is unknown; use"),
        ({"operation": "Ploughing"}, "operation 'Ploughing' is unknown \\(did you mean 'till'"),
        ({"corners": "sharp"}, "corners 'sharp' is unknown"),
        ({"headland_order": "never"}, "headland_order 'never' is unknown"),
        ({"no_headland": True, "headland_order": "first"}, "no_headland leaves the headland"),
        ({"no_headland": True, "entrance": (4.6, 52.1)}, "no_headland plans work on tracks alone"),
        ({"headland_passes": 0}, "is 0; use 1 to 50"),
        ({"headland_passes": 51}, "is 51; use 1 to 50"),
        ({"headland_passes": 2, "no_headland": True}, "no_headland leaves the headland"),
        ({"headland_passes": 2, "headland_m": 6.0}, "headland_m is its depth"),
    ],
)
def test_refusals(options: dict[str, Any], words: str) -> None:
    with pytest.raises(RequestError, match=words):
        PlanRequest(**options)


class TestNumberOfPasses:
    """A rectangle of 100 m by 60 m and an implement of 3 m; turns need 8.5 m, which three passes have."""

    FIELD = Field("rectangle", shapely.box(0, 0, 100, 60))

    def prepare(self, **options: Any) -> PlanningContext:
        return prepare_context(WorkOrder(PlanRequest(field="f", bearing_deg=90.0, **options), self.FIELD))

    @pytest.mark.parametrize("passes", [2, 3, 4])
    def test_depth_and_lengths_are_those_of_a_rectangle(self, passes: int) -> None:
        """A pass k runs 1.5 + 3 (k - 1) m inside the outline; inside all of them lie (60 - 6 n) / 3 tracks."""
        context = self.prepare(headland_passes=passes)
        assert (context.layout.headland_m, context.layout.headland_passes) == (3.0 * passes, passes)
        rings_m = [2 * (100 - 2 * inside_m) + 2 * (60 - 2 * inside_m) for inside_m in (1.5, 4.5, 7.5, 10.5)[:passes]]
        assert [one.length_m for one in context.headland_passes] == pytest.approx(rings_m, abs=0.1)
        assert len(context.layout.swaths) == (60 - 6 * passes) / 3
        assert context.layout.total_length_m == pytest.approx(len(context.layout.swaths) * (100 - 6 * passes), rel=0.01)

    def test_too_few_for_turns_are_said(self) -> None:
        (remark,) = self.prepare(headland_passes=2).layout.field.remarks
        assert remark.startswith(
            "2 headland passes are 6 m deep, and turns need 8.5 m (3 passes): where they do not fit"
        )
        assert self.prepare(headland_passes=3).layout.field.remarks == ()

    @pytest.mark.parametrize(
        ("options", "told"),
        [
            ({}, ()),
            ({"headland_passes": 1}, ()),
            ({"headland_m": 30.0}, ("The field has no room for more headland passes than 1.",)),
            ({"bearing_deg": 30.0}, (NO_TRACK,)),
            ({"cell_bearings": ((1, 30.0),)}, (NO_TRACK,)),
        ],
    )
    def test_wishes_that_a_strip_has_no_room_for_are_said(self, options: dict[str, Any], told: tuple[str, ...]) -> None:
        strip = Field("strip", shapely.box(0, 0, 397, 14))
        context = prepare_context(WorkOrder(PlanRequest(field="strip", width_m=9.0, **options), strip))
        assert context.layout.field.remarks == told and context.layout.headland_passes == 1
        assert describe_field(context)["turns"]["turn_s_by_swaths"] == {}

    def test_a_headland_that_is_not_worked_lacks_no_room(self) -> None:
        assert self.prepare(headland_m=12.0, no_headland=True).layout.field.remarks == ()

    @pytest.mark.slow
    def test_one_pass_is_worked_line_by_line(self) -> None:
        """Its corners have no path by passes and turns; no pass is added unasked."""
        small = Field("small", shapely.box(0, 0, 45, 24))
        request = PlanRequest(
            field="f", headland_passes=1, tractors=(1,), strategies=("split-field",), bearing_deg=90.0
        )
        ranking = plan(request, field=small, executor=SerialExecutor()).ranking
        assert ranking.best.headland_passes == 1
        assert ranking.best.worked_pct > 85.0
