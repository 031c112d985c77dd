"""Awkward fields on which fleets of every strategy must find a plan."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest
from shapely import box

from fields.errors import HeadlandError
from fields.geometry.field import Field
from planner import farm as farm_room
from planner.evaluation.candidates.evaluate import Candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.farm.inventory import load_farm
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.farm_inputs import complete_request_by_farm
from planner.pipeline.outputs.pictures import build_outline_picture, describe_field
from planner.pipeline.planning import plan_order
from planner.request.plan_request import PlanRequest
from planner.sweeps.estimates import GroundEstimates
from strategies.registry import STRATEGIES
from tests.examples import seldom
from tests.planner.excursions import measure_excursion_m
from tests.planner.shapes import SHAPES
from vehicle.model.tractor import BatteryParameters, load_tractor


@cache
def site_of(name: str) -> PlanningContext:
    return prepare_context(WorkOrder(PlanRequest(field=name, no_headland=False), SHAPES[name]))


@pytest.mark.slow
@pytest.mark.parametrize("strategy", seldom(*sorted(set(STRATEGIES) - {"split-field"})))
def test_a_strip_of_few_lines_is_worked_by_two(strategy: str) -> None:
    """Evenly shared out its lines would be nearer to each other than machines are wide: nobody could pass.

    A golden map is that of split-field.
    """
    result = simulate_candidate(site_of("thin strip"), Candidate(strategy, 2)).result
    assert result.feasible, result.reason
    assert result.worked_pct > 99.0


@pytest.mark.slow
def test_a_strip_no_wider_than_two_passes_is_worked_along_its_sides() -> None:
    """The headland pass round it leaves no ground for a track, and needs none."""
    site = prepare_context(WorkOrder(PlanRequest(field="strip", width_m=9.0), Field("strip", box(0, 0, 397, 14))))
    assert not site.layout.swaths
    result = simulate_candidate(site, Candidate("row-by-row", 1)).result
    assert result.feasible, result.reason
    assert result.worked_pct > 99.0
    assert result.time_s is not None and result.time_s < 2.0 * 397.0 / site.driving_rules.work_speed_mps + 180.0


def test_where_no_track_is_the_headland_passes_tell_slopes_and_what_a_battery_is_worth(tmp_path: Path) -> None:
    """A fall of 6 % along a strip: one side is driven up, one down, and 5 m at each end across."""
    heights = tmp_path / "heights.csv"
    places = [(x, y) for x in range(-20, 421, 10) for y in range(-20, 41, 10)]
    heights.write_text("x,y,z\n" + "".join(f"{x},{y},{0.06 * x:.2f}\n" for x, y in places))
    strip = Field("strip", box(0, 0, 397, 14))
    electric = load_tractor("eg105").model_copy(
        update={"drive": "electric", "battery": BatteryParameters(capacity_kwh=200.0)}
    )
    request = PlanRequest(field="strip", width_m=9.0, tractors=(1,), operation="spray", elevation=str(heights))
    order = WorkOrder(request, strip, electric)
    planned = plan_order(order, executor=SerialExecutor())
    ranking = planned.ranking
    assert not planned.context.layout.swaths and planned.context.supply is None
    assert describe_field(planned.context)["cells"] == []
    assert build_outline_picture(planned.context).title == "strip: headland passes"
    assert ranking.best is not None and ranking.best.headland_order is None
    assert ranking.cross_slope_pct == pytest.approx(6.0, abs=0.3)
    assert ranking.erosion_share == pytest.approx(0.98, abs=0.02)
    assert GroundEstimates(planned.context, drives=False).estimate(order).headland_order is None
    with pytest.raises(HeadlandError, match=r"which has R1\."):
        plan_order(replace(order, request=replace(request, leave_out="3")), executor=SerialExecutor())


def test_a_field_without_any_line_is_refused_on_slopes_too(tmp_path: Path) -> None:
    heights = tmp_path / "heights.csv"
    heights.write_text(
        "x,y,z\n" + "".join(f"{x},{y},{0.02 * x}\n" for x in range(-20, 41, 5) for y in range(-20, 41, 5))
    )
    request = PlanRequest(field="tiny", width_m=9.0, tractors=(1,), elevation=str(heights))
    ranking = plan_order(WorkOrder(request, Field("tiny", box(0, 0, 10, 10))), executor=SerialExecutor()).ranking
    assert ranking.best is None and ranking.cross_slope_pct is None


@pytest.mark.slow
def test_turns_too_tight_to_follow_are_driven_another_way() -> None:
    """Arcs as tight as the tractor drives, to and fro: it comes out of them aside, and once outside the field."""
    farm = load_farm(str(Path(farm_room.__file__).parent / "example.toml"))
    wanted = PlanRequest(field="netherlands", tractors=(2,), strategies=("split-field",))
    found = complete_request_by_farm(wanted, farm, ("field", "tractors", "strategies"), implement_name="drill")
    site = prepare_context(WorkOrder(found.request, tractor=found.tractor, implement=found.implement))
    evaluation = simulate_candidate(site, Candidate("split-field", 2))
    assert evaluation.result.feasible and evaluation.run is not None, evaluation.result.reason
    assert measure_excursion_m(evaluation.run, site) < 0.5
