"""Places where a run touches something or leaves the field; what makes measuring quick changes no figure."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from fields import Field
from fields.geometry.obstacles import Obstacle
from fields.geometry.overlays import clip_area, drop_slivers, extract_polygons
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import (
    FenceIntrusionCheck,
    ObstacleIntrusionCheck,
    TouchTable,
    find_contact_places,
)
from planner.evaluation.ground.coverage import _find_wide_pieces
from planner.evaluation.ground.wheel_traffic import _match_marks_to_strips
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import OBSTACLE, OUTLINE
from tests.examples import count_examples
from vehicle.missions.plan import SWATH, Leg, LegTask, Mission, Plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.compile import compute_contact_boxes
from vehicle.sim.world import simulate

QUICK = settings(max_examples=count_examples(60))
boxes = st.lists(
    st.tuples(st.floats(0, 60), st.floats(0, 60), st.floats(0.01, 9.0), st.floats(0.01, 1.5), st.floats(0, 6.3)),
    min_size=1, max_size=8,
)  # fmt: skip

BOX = shapely.box(0.0, 0.0, 120.0, 60.0)
POLE = Obstacle("pole", shapely.Point(60.0, 31.8), 0.25, "P7")


def turned(x: float, y: float, long: float, wide: float, angle: float) -> shapely.Polygon:
    """A box of so many metres, turned by an angle about its corner."""
    return shapely.affinity.rotate(shapely.box(x, y, x + long, y + wide), angle, (x, y), use_radians=True)


@QUICK
@given(boxes, st.sampled_from([0.2, 0.75, 1.5]))
def test_wide_pieces_are_found_as_if_every_sliver_were_looked_at(drawn: list[Any], least_m: float) -> None:
    missed = extract_polygons(shapely.union_all([turned(*one) for one in drawn]))
    style = {"join_style": "mitre", "mitre_limit": 2.0}
    core = missed.buffer(-0.5 * least_m, **style)
    expected = clip_area(missed, core.buffer(0.5 * least_m, **style))
    found = _find_wide_pieces(missed, least_m)
    assert math.fsum(shapely.area(found)) == pytest.approx(expected.area, abs=1e-6)
    assert len(found) == len(shapely.get_parts(expected))


def test_slivers_are_told_by_their_width_however_they_lie() -> None:
    thin = [turned(0, 0, 80.0, 0.09, angle) for angle in (0.0, 0.3, 1.0, 2.5)]
    wide = [turned(0, 0, 80.0, 0.21, angle) for angle in (0.0, 0.3, 1.0, 2.5)]
    bent = shapely.LineString([(0, 0), (20, 0.0), (40, 3.0)]).buffer(0.02)  # thin, but it reaches aside
    with_hole = shapely.Polygon([(0, 0), (9, 0), (9, 9), (0, 9)], [[(1, 1), (8, 1), (8, 8), (1, 8)]])
    parts = np.array([*thin, *wide, bent, with_hole])
    assert drop_slivers(parts, 0.2).tolist() == [*wide, bent, with_hole]
    assert not len(drop_slivers(parts[:0], 0.2))


@QUICK
@given(boxes, boxes)
def test_strips_meet_what_lies_across_them(strips: list[Any], short: list[Any]) -> None:
    areas, others = (np.array([turned(*one) for one in each]) for each in (strips, short))
    number, strip = _match_marks_to_strips(areas, others)
    expected = [(n, s) for n, other in enumerate(others) for s, area in enumerate(areas) if area.intersects(other)]
    assert list(zip(number.tolist(), strip.tolist(), strict=True)) == expected


@pytest.fixture(scope="module")
def ponds() -> PlanningContext:
    """A fenced field with two ponds."""
    holes = [shapely.box(30, 30, 50, 50).exterior, shapely.box(90, 40, 100, 60).exterior]
    field = Field("ponds", shapely.Polygon(shapely.box(0, 0, 140, 100).exterior, holes))
    fence = shapely.LineString(field.boundary.exterior)
    return prepare_context(
        WorkOrder(PlanRequest(no_headland=True), replace(field, fences=(fence,), entrance=(70.0, 0.0)))
    )


poses_of_ponds = st.lists(
    st.tuples(st.floats(-5, 145), st.floats(-5, 105), st.floats(-3.2, 3.2)), min_size=1, max_size=40
)


@given(poses_of_ponds)
@QUICK
def test_nothing_is_touched_at_poses_that_are_not_found(ponds: PlanningContext, drawn: list[Any]) -> None:
    poses = np.array(drawn)
    for check in (FenceIntrusionCheck(ponds), ObstacleIntrusionCheck(ponds)):
        near = check.find(poses)
        assert check.measure_intrusion_m(poses) == check.measure_intrusion_m(poses[near])
        assert check.measure_intrusion_m(poses[~near]) == 0.0


@given(poses_of_ponds, boxes)
@QUICK
def test_a_shape_is_touched_where_a_box_of_the_machine_meets_it(
    ponds: PlanningContext, drawn: list[Any], areas: list[Any]
) -> None:
    outlines = [turned(*one) for one in areas]
    line = shapely.LineString([(100, 10), (130, 40), (130, 90)])
    for shape in (shapely.union_all(outlines), line, shapely.union_all([*outlines, line]), shapely.Polygon()):
        table, poses = TouchTable(ponds, shape), np.array(drawn)
        for some in (poses, poses[::2]):
            machines = table.place_boxes(some).reshape(len(some), -1)
            apart_m = shapely.distance(shape, machines).min(axis=1) if not shape.is_empty else np.full(len(some), 9.0)
            meets = shapely.intersects(shape, machines).any(axis=1)
            doubtful = (apart_m < 1e-9) & (shapely.area(shapely.intersection(shape, machines)).max(axis=1) < 1e-9)
            assert (table.find(some) == meets)[~doubtful].all()


def test_a_machine_that_lies_in_a_shape_or_round_it_touches_it(ponds: PlanningContext) -> None:
    pose, aside = np.array([[60.0, 30.0, 0.7]]), np.array([[140.0, 30.0, 0.7]])
    for shape in (shapely.Point(60, 30).buffer(50.0), shapely.Point(60, 30).buffer(0.1)):
        assert TouchTable(ponds, shape).find(pose).tolist() == [True]
        assert TouchTable(ponds, shape).find(aside).tolist() == [False]


@pytest.fixture(scope="module")
def site() -> PlanningContext:
    request = PlanRequest(no_headland=True, tractors=(1,), bearing_deg=90.0)
    return prepare_context(WorkOrder(request, Field("poled", BOX, obstacles=(POLE,))))


def get_touching_y_m(site: PlanningContext, depth_m: float) -> float:
    """Where a tractor reaches so deep into the pole, whose southern edge is at 31.55 m."""
    boxes = compute_contact_boxes(site.tractor, site.implement)
    return 31.55 - max(boxes["half_width"], boxes["tool_half_width"]) + depth_m


def drive_past(site: PlanningContext, y_m: float, speed_mps: float = 3.0) -> SimulationRun:
    """A run along a swath from west to east."""
    leg = Leg(np.array([[10.0, y_m], [110.0, y_m]]), speed_mps, implement=True, task=LegTask(SWATH, 0))
    return simulate(Plan((Mission((leg,)),)), site.tractor, site.implement)


class TestPlaces:
    def test_the_pole_is_found_where_it_stands(self, site: PlanningContext) -> None:
        assert find_contact_places(drive_past(site, get_touching_y_m(site, -0.05)), site) == ()
        (place,) = find_contact_places(drive_past(site, get_touching_y_m(site, 0.15)), site)
        assert (place.kind, place.number, place.name) == (OBSTACLE, 0, "obstacle 'P7' (pole)")
        assert place.x_m == pytest.approx(60.0, abs=4.0) and place.depth_m == pytest.approx(0.15, abs=0.05)

    def test_leaving_the_field_is_found_from_half_a_metre_on(self, site: PlanningContext) -> None:
        assert find_contact_places(drive_past(site, -0.4), site) == ()
        (place,) = find_contact_places(drive_past(site, -0.7), site)
        assert place.kind == OUTLINE and place.depth_m == pytest.approx(0.7, abs=0.05)
        assert "leaves the field by 0.7" in place.sentence
