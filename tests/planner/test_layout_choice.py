"""Which layout a field is planned with: what is asked for stays, and what is open is what one tractor does soonest."""

import math
from typing import Any

import pytest
import shapely

from fields import Field, lay_swaths
from planner.evaluation.candidates.evaluate import Candidate, run_candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.layout_choice import MIN_GAIN, build_effort_rates, estimate_finish_s, list_layouts
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from strategies.rules.driving_rules import DrivingRules
from vehicle.missions.plan import SWATH

L = Field("L", shapely.Polygon([(0, 0), (120, 0), (120, 55), (50, 55), (50, 140), (0, 140)]))
RECTANGLE = Field("r", shapely.box(0, 0, 200, 60))


LONG_L = Field("long L", shapely.Polygon([(0, 0), (260, 0), (260, 60), (60, 60), (60, 240), (0, 240)]))


def site_on(field: Field, **asked: Any) -> PlanningContext:
    return prepare_context(WorkOrder(PlanRequest(field="f", **{"no_headland": False, **asked}), field))


@pytest.fixture(scope="module")
def in_cells() -> PlanningContext:
    return site_on(LONG_L)


@pytest.fixture(scope="module")
def one_bearing(in_cells: PlanningContext) -> PlanningContext:
    """The plain layout beside it: the best single bearing in as many rounds as turns need."""
    return site_on(LONG_L, bearing_deg=list_layouts(in_cells.request, LONG_L, 9.0)[0].bearing_deg, headland_m=9.0)


def test_an_l_of_long_arms_is_worked_in_cells(in_cells: PlanningContext, one_bearing: PlanningContext) -> None:
    assert len(in_cells.layout.cells) > 1 == len(one_bearing.layout.cells)
    assert estimate_finish_s(in_cells) < (1.0 - MIN_GAIN) * estimate_finish_s(one_bearing)


@pytest.mark.slow
def test_the_choice_holds_when_it_is_driven(in_cells: PlanningContext, one_bearing: PlanningContext) -> None:
    with_cells, without = (
        simulate_candidate(site, Candidate("split-field", 1)).result for site in (in_cells, one_bearing)
    )
    assert with_cells.feasible and without.feasible
    assert with_cells.finished_s < without.finished_s
    assert with_cells.worked_pct > 98.0  # the tips of round corners stay


def test_headings_are_those_of_the_cells(in_cells: PlanningContext) -> None:
    for track, heading in headings(in_cells):
        bearing = in_cells.layout.cells[track.cell_number - 1].bearing_rad
        assert abs((heading - bearing + 1.0) % math.pi - 1.0) < 1e-9


def headings(site: PlanningContext) -> list[tuple[Any, float]]:
    """Every track with the angles of the legs that work it."""
    by_line = {track.line: track for track in site.layout.swaths}
    told = []
    for leg in run_candidate(site, Candidate("split-field", 1)).run.plan.missions[0].legs:
        if leg.task.kind == SWATH:
            (x0, y0), (x, y) = leg.points[0], leg.points[-1]
            told.append((by_line[leg.task.number or 0], math.atan2(y - y0, x - x0)))
    assert {track for track, _ in told} == set(by_line.values())
    return told


class TestAskedFor:
    @pytest.mark.slow
    def test_a_bearing_is_that_of_the_only_cell(self) -> None:
        site = site_on(L, bearing_deg=30.0)
        assert len(site.layout.cells) == 1 and site.layout.bearing_deg == pytest.approx(30.0)

    def test_a_headland_is_as_many_rounds(self) -> None:
        assert {
            layout.headland_passes for layout in list_layouts(PlanRequest(no_headland=False, headland_m=6.0), L, 6.0)
        } == {2}

    @pytest.mark.parametrize(("height", "asked", "laid"), [(14.0, 2, 1), (30.0, 2, 2), (30.0, 5, 2), (30.0, 1, 1)])
    def test_there_are_as_many_rounds_as_have_room(self, height: float, asked: int, laid: int) -> None:
        request = PlanRequest(width_m=9.0, headland_passes=asked)
        layouts = list_layouts(request, Field("strip", shapely.box(0, 0, 397, height)), 9.0 * asked)
        assert {(one.headland_passes, bool(one.swaths)) for one in layouts} == {(laid, laid < height / 18.0)}

    def test_one_round_more_is_compared_where_nothing_is_asked_for(self) -> None:
        assert {layout.headland_passes for layout in list_layouts(PlanRequest(no_headland=False), RECTANGLE, 8.5)} == {
            3,
            4,
        }

    def test_tracks_alone_are_as_they_are_laid(self) -> None:
        (only,) = list_layouts(PlanRequest(no_headland=True), L, 9.0)
        assert only.swaths == lay_swaths(L, 3.0, 9.0).swaths

    def test_what_is_sown_is_not_turned_on(self) -> None:
        assert all(len(one.cells) == 1 for one in list_layouts(PlanRequest(no_headland=False, operation="sow"), L, 9.0))

    def test_both_asked_for_leave_one_layout(self) -> None:
        assert len(list_layouts(PlanRequest(no_headland=False, headland_m=9.0, bearing_deg=0.0), L, 9.0)) == 1


def test_turns_cost_the_work_that_could_be_done_meanwhile() -> None:
    """At 4 m/s a turn of 20 s costs 80 m; one that does not fit is not taken. A metre off at 1 m/s costs four."""
    rules = DrivingRules(4.0, 1.0, 1.0, radius_m=4.0, tool_m=1.0, turn_s=(0.0, 50.0))
    rates = build_effort_rates(rules, (0.0, None, 20.0))
    assert rates.turns_m == (math.inf, 80.0) and rates.turn_m == 80.0 and rates.offset == 4.0
    assert build_effort_rates(rules, (0.0, None)).turn_m == 200.0


def test_few_swaths_are_compared_in_more_ways() -> None:
    """At 24 m a headland of one pass is enough; two and three are compared as well."""
    field = Field("wide", shapely.Polygon([(0, 0), (420, 0), (380, 260), (40, 230)]))
    layouts = list_layouts(PlanRequest(width_m=24.0), field, 22.0)
    assert {layout.headland_passes for layout in layouts} == {1, 2, 3}
    assert len({round(layout.bearing_deg, 3) for layout in layouts if layout.headland_passes == 1}) >= 3


@pytest.mark.slow
@pytest.mark.parametrize(("width_m", "radius_m", "step_deg"), [
    pytest.param(3.0, None, 15, marks=pytest.mark.matrix), (12.0, 6.0, 30),
])  # fmt: skip
def test_no_bearing_by_hand_is_quicker(width_m: float, radius_m: float | None, step_deg: int) -> None:
    field = Field("f", shapely.Polygon([(0, 0), (230, 15), (205, 120), (120, 105), (95, 230), (20, 210)]))
    chosen, *by_hand = (
        estimate_finish_s(site_on(field, width_m=width_m, radius_m=radius_m, bearing_deg=bearing))
        for bearing in (None, *range(0, 180, step_deg))
    )
    assert chosen <= 1.005 * min(by_hand)


def test_many_tracks_are_laid_by_estimate() -> None:
    """Nothing is searched, and no other number of rounds is tried."""
    (only,) = list_layouts(PlanRequest(no_headland=False), Field("big", shapely.box(0, 0, 500, 900)), 9.0)
    assert only.headland_passes == 3 and len(only.swaths) > 125
