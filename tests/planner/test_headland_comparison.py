"""Headlands compared: the way of a request, plans of every way, sums, and finished ground under wheels."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from fields.arrays import Integers
from fields.geometry.field import Field
from planner.errors import RequestError
from planner.evaluation.candidates.evaluate import Candidate, Outcome, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.swept_area import compute_swept_area
from planner.evaluation.ground.wheel_traffic import TYRE_WIDTH_M, find_driven_over_ground
from planner.evaluation.work_order import WorkOrder
from planner.pipeline.executors import SerialExecutor
from planner.pipeline.many_fields import compare_ways, list_headland_requests
from planner.pipeline.ranking import locate_cut_off_ground
from planner.request.plan_request import PlanRequest
from reports.plan.comparison import Comparison, ComparisonTotals
from tests.drawn_fields import write_farm
from tests.examples import seldom
from vehicle.missions.run import SimulationRun

pytestmark = pytest.mark.usefixtures("first_layout")

WIDE_M, HIGH_M, CELL_M = 48.0, 36.0, 0.2


def drive_headland(place: Callable[..., PlanningContext], order: str) -> tuple[PlanningContext, Outcome]:
    site = place(shapely.box(0, 0, WIDE_M, HIGH_M), no_headland=False, headland_order=order, headland_passes=3)
    return site, simulate_candidate(site, Candidate("split-field", 1))


def mark_last_rows(run: SimulationRun, site: PlanningContext) -> tuple[Integers, Integers]:
    """The last row at which each cell of a grid was worked, and the last at which a wheel with the bar up was on it."""
    worked, driven = (np.full((round(HIGH_M / CELL_M), round(WIDE_M / CELL_M)), -1) for _ in range(2))
    tractor, implement = site.tractor, site.implement
    is_down = np.array([leg.implement for leg in run.plan.missions[0].legs])[run.get_leg_numbers(0)]
    wheels = [(x, y) for x in (tractor.front_axle_m, -tractor.rear_axle_m) for y in (-0.5, 0.5)]
    for row, (x, y, angle) in enumerate(run.get_poses(0)):
        ahead, left = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
        if is_down[row]:
            bar = np.array([x, y]) - (tractor.rear_axle_m + implement.hitch_m) * ahead
            mark_box(worked, row, bar, ahead, 0.1, 0.5 * implement.width_m)
        else:
            for forward, side in wheels:
                spot = np.array([x, y]) + forward * ahead + side * tractor.track_m * left
                mark_box(driven, row, spot, ahead, 0.1, 0.5 * TYRE_WIDTH_M)
    return worked, driven


def mark_box(grid: Integers, row: int, middle: Any, ahead: Any, half_length_m: float, half_width_m: float) -> None:
    """Write a row into the cells whose middle is in a box about a point, which faces ahead."""
    reach = half_length_m + half_width_m
    low = np.maximum(((middle - reach) / CELL_M).astype(int), 0)
    high = np.minimum(((middle + reach) / CELL_M).astype(int) + 1, (grid.shape[1], grid.shape[0]))
    if (high <= low).any():
        return
    east, north = np.meshgrid(*(CELL_M * (np.arange(low[k], high[k]) + 0.5) - middle[k] for k in (0, 1)))
    along, across = east * ahead[0] + north * ahead[1], north * ahead[0] - east * ahead[1]
    inside = (np.abs(along) <= half_length_m) & (np.abs(across) <= half_width_m)
    grid[low[1] : high[1], low[0] : high[0]][inside] = row


@pytest.mark.slow
@pytest.mark.parametrize("order", ["first", *seldom("last")])
def test_driven_over_ground_is_that_of_a_grid_headland_included(
    place: Callable[..., PlanningContext], order: str
) -> None:
    """A grid of 20 cm cells that knows only poses and when the bar is down."""
    site, evaluation = drive_headland(place, order)
    assert evaluation.run is not None
    worked, driven = mark_last_rows(evaluation.run, site)
    is_finished_first = (worked >= 0) & (driven > worked)
    expected_m2 = CELL_M**2 * is_finished_first.sum()
    found_m2 = evaluation.result.over_finished_m2 or 0.0
    assert found_m2 == pytest.approx(expected_m2, rel=0.06, abs=3.0)
    rim = round(9.0 / CELL_M)
    on_headland_m2 = expected_m2 - CELL_M**2 * is_finished_first[rim:-rim, rim:-rim].sum()
    pieces = find_driven_over_ground(evaluation.run, site, compute_swept_area(evaluation.run, site))
    inner = shapely.box(9.0, 9.0, WIDE_M - 9.0, HIGH_M - 9.0)
    found_on_headland_m2 = shapely.union_all(pieces).difference(inner).area
    assert found_on_headland_m2 == pytest.approx(on_headland_m2, rel=0.06, abs=3.0)
    if order == "first":  # turns are on worked ground, which is most of what is driven over
        assert on_headland_m2 > 100.0 and on_headland_m2 > 0.9 * expected_m2
    else:
        assert on_headland_m2 < 60.0


class TestChoices:
    def test_every_corner_with_every_order_and_number(self) -> None:
        asked = list_headland_requests(PlanRequest(), ("square", "round"), ("first", "last"), (2, 3))
        assert [(one.corners, one.headland_order, one.headland_passes, one.width_m) for one in asked] == [
            (corners, order, passes, 3.0)
            for corners in ("square", "round")
            for order in ("first", "last")
            for passes in (2, 3)
        ]

    @pytest.mark.parametrize(("operation", "count"), [("till", 6), ("sow", 3), ("mow", 3)])
    def test_default_is_what_the_work_allows(self, operation: str, count: int) -> None:
        asked = list_headland_requests(PlanRequest(operation=operation))
        assert len(asked) == count and all(one.headland_passes is None for one in asked)
        assert {one.corners for one in asked} == {"square", "round", "auto"}

    def test_headland_that_is_not_worked_is_refused(self) -> None:
        with pytest.raises(RequestError, match="leaves the headland"):
            list_headland_requests(PlanRequest(no_headland=True))


@pytest.fixture(scope="module")
def comparison(tmp_path_factory: pytest.TempPathFactory) -> Comparison:
    """A rectangle of 48 m by 30 m and one of 36 m by 30 m with two and with three passes of 3 m, headland last."""
    path = write_farm(tmp_path_factory.mktemp("farm") / "farm.geojson", long=(0, 48, 30), short=(200, 36, 30))
    request = PlanRequest(f"{path}#long", local=True, tractors=(1,), strategies=("split-field",), bearing_deg=90.0)
    inputs = [
        WorkOrder(one)
        for name in ("long", "short")
        for one in list_headland_requests(replace(request, field=f"{path}#{name}"), ("square",), ("last",), (2, 3))
    ]
    return compare_ways(inputs, SerialExecutor(), with_maps=True)


@pytest.mark.slow
def test_figures_are_those_of_the_rectangles(comparison: Comparison) -> None:
    """0.144 and 0.108 ha; 6 and 9 m of headland; 40 per hour; every square metre is worked or missed."""
    assert [each.area_ha for each in comparison.rows] == pytest.approx([0.144, 0.144, 0.108, 0.108])
    assert [each.get_planned("headland_m") for each in comparison.rows] == [6.0, 9.0, 6.0, 9.0]
    for each in comparison.rows:
        plan = each.best
        assert plan.headland_order == "last" and plan.headland_passes == each.way.headland_passes
        field_m2 = 1e4 * each.area_ha
        assert 0.01 * plan.worked_pct * field_m2 + plan.missed_m2 == pytest.approx(field_m2)
        assert plan.cost == pytest.approx(40.0 * (plan.time_s or 0.0) / 3600.0)
        worked_ha = each.area_ha - 1e-4 * plan.missed_m2
        assert plan.ranked_cost / each.area_ha == pytest.approx(plan.cost / worked_ha)
        assert each.map["driven_over"] and each.map["lanes"]
    rings_m = 2 * (48 + 30) - 8 * 1.5 + 2 * (48 + 30) - 8 * 4.5  # two rings, and (30 - 12) / 3 tracks of 36 m
    least_s = (rings_m + 6 * 36) / (5.0 / 3.6)
    assert least_s < (comparison.rows[0].best.time_s or 0.0) < 4.0 * least_s  # type: ignore[union-attr]


@pytest.mark.slow
def test_sums_add_up(comparison: Comparison) -> None:
    for totals in comparison.totals:
        plans = [each for each in comparison.rows if each.way == totals.way]
        results = [each.best for each in plans if each.best is not None]
        assert len(results) == 2 and totals.is_complete and totals.area_ha == pytest.approx(0.252)
        assert totals.missed_m2 == pytest.approx(sum(one.missed_m2 or 0.0 for one in results))
        assert totals.over_finished_m2 == pytest.approx(sum(one.over_finished_m2 or 0.0 for one in results))
        overlap_m2 = sum(
            (one.overlap_pct or 0.0) * 100.0 * each.area_ha for one, each in zip(results, plans, strict=True)
        )
        assert totals.overlap_m2 == pytest.approx(overlap_m2)
        assert totals.cost_per_ha == pytest.approx(sum(one.finished_cost or 0.0 for one in results) / 0.252)
    assert comparison.best.charged_cost == min(one.charged_cost for one in comparison.totals)


@pytest.mark.slow
def test_a_part_beyond_a_neck_is_cut_off_for_wide_machines(tmp_path: Path) -> None:
    """Rectangles of 60 m and 30 m by 40 m with a way of 4 m between, for machines of 6 m."""
    bell = shapely.union_all([shapely.box(0, 0, 60, 40), shapely.box(60, 18, 80, 22), shapely.box(80, 0, 110, 40)])
    path = tmp_path / "bell.geojson"
    path.write_text(shapely.to_geojson(bell), encoding="utf-8")
    request = PlanRequest(
        str(path), local=True, tractors=(1,), strategies=("split-field",), width_m=6.0, transport_width_m=6.0
    )
    orders = list(map(WorkOrder, list_headland_requests(request, ("round",), ("last",))))
    (each,) = compare_ways(orders, SerialExecutor()).rows
    assert each.way.width_m == 6.0 and ComparisonTotals(each.way, (each,)).cut_off_m2 == pytest.approx(30 * 40, abs=1.0)
    assert [part.neck_width_m for part in each.ranking.parts] == [pytest.approx(4.0, abs=0.1)]


def test_all_that_obstacles_cut_off_is_at_the_place_of_most() -> None:
    """Two pieces that are too small for plans, of 20 m2 and 90 m2: the place is in the larger."""
    pieces = (shapely.box(0, 0, 4, 5), shapely.box(20, 20, 30, 29))
    cut = replace(Field("f", shapely.box(0, 0, 50, 50)), cut_off_parts=pieces)
    piece = locate_cut_off_ground(cut)
    assert piece.m2 == pytest.approx(110.0)
    assert pieces[1].contains(shapely.Point(piece.x_m, piece.y_m)) and piece.lat is None
    assert locate_cut_off_ground(replace(cut, cut_off_parts=())) is None
