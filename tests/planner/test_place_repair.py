"""Repairs where a plan touches something: slower there and only there, then a wider margin there and only there."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from fields import Field
from fields.geometry.obstacles import Obstacle
from planner.evaluation.context import PlanningContext, prepare_context
from planner.evaluation.ground.contact_places import ContactPlace, find_contact_places
from planner.evaluation.layout_repairs import LayoutRepairs
from planner.evaluation.repair.place_repair import (
    SlowedPlace,
    describe_slowed_places,
    replace_legs_by_parts,
    slow_down_plan,
)
from planner.request.plan_request import PlanRequest
from reports.common.plan_results import FENCE, NO_PATH, OBSTACLE, OUTLINE, PlanFault
from vehicle.missions.plan import SWATH, FollowOrder, Leg, LegGate, LegTask, Mission, Plan, check_plan
from vehicle.missions.run import SimulationRun
from vehicle.sim.compile import compute_contact_boxes
from vehicle.sim.world import simulate

BOX = shapely.box(0.0, 0.0, 120.0, 60.0)
POLE = Obstacle("pole", shapely.Point(60.0, 31.8), 0.25, "P7")


@pytest.fixture(scope="module")
def site() -> PlanningContext:
    request = PlanRequest(no_headland=True, tractors=(1,), bearing_deg=90.0)
    return prepare_context(request, Field("poled", BOX, obstacles=(POLE,)))


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


class TestSlowing:
    def test_only_the_part_around_the_place_is_slower(self, site: PlanningContext) -> None:
        """6 m before the place and 3 m behind it at 0.6 times the speed, with room to brake before."""
        run = drive_past(site, get_touching_y_m(site, 0.15))
        plan, (slowed,) = slow_down_plan(run, find_contact_places(run, site), site, 0.6)
        check_plan(plan)
        first, slow, last = plan.missions[0].legs
        assert first.speed_mps == last.speed_mps == 3.0
        assert slow.speed_mps == slowed.speed_mps == pytest.approx(1.8, rel=0.03)
        assert math.fsum(leg.length_m for leg in plan.missions[0].legs) == pytest.approx(100.0)
        braking_m = (3.0**2 - 1.8**2) / 0.7
        touching_x_m = run.get_poses(0)[slowed.place.first_row, 0]
        assert slow.points[0, 0] == pytest.approx(touching_x_m - 6.0 - braking_m, abs=1.5)
        assert 60.0 < slow.points[-1, 0] < 70.0

    def test_what_is_slow_already_is_left_as_it_is(self, site: PlanningContext) -> None:
        run = drive_past(site, get_touching_y_m(site, 0.15), speed_mps=0.4)
        plan, slowed = slow_down_plan(run, find_contact_places(run, site), site, 0.6)
        assert plan is run.plan and not slowed

    def test_gates_and_followers_of_cut_legs_move_along(self) -> None:
        def leg(start: float, end: float, **more: object) -> Leg:
            return Leg(np.array([[start, 0.0], [end, 0.0]]), 2.0, **more)  # type: ignore[arg-type]

        gates = tuple(LegGate(0, 1, after_m) for after_m in (5.0, 15.0, 30.0))
        waiting = replace(leg(0, 9), gates=gates, follow=FollowOrder(0, 2, 10.0))
        plan = Plan(
            (Mission((leg(0, 10), leg(10, 40), leg(40, 50))), Mission((waiting,))),
            {"refills": [{"tractor": 1, "leg": 2}, {"tractor": 2, "leg": 0}]},
        )
        cut = replace_legs_by_parts(plan, 0, [[leg(0, 10)], [leg(10, 20), leg(20, 40)], [leg(40, 50)]])
        check_plan(cut)
        (moved,) = cut.missions[1].legs
        assert [(gate.leg, gate.after_m) for gate in moved.gates] == [(1, 5.0), (2, 5.0), (2, 20.0)]
        assert moved.follow is not None and moved.follow.leg == 3
        assert [stop["leg"] for stop in cut.notes["refills"]] == [3, 0]

    def test_one_remark_names_speed_and_places(self) -> None:
        places = [
            SlowedPlace(ContactPlace(OBSTACLE, number, name, 0, 0, 0, 0.0, 0.0, 0.1), speed)
            for number, (name, speed) in enumerate([("the pond", 2.0), ("the pole", 1.5), ("the pond", 2.5)])
        ]
        assert describe_slowed_places(places) == "drives 5.4 km/h beside the pond and the pole"
        assert describe_slowed_places([]) is None


class TestLayoutRepairs:
    def test_margins_grow_step_by_step_for_what_is_touched(self) -> None:
        repairs = LayoutRepairs().extend([PlanFault(OBSTACLE, 2, 0.0, 0.0)], 0.3)
        assert repairs.margins_m == {2: 0.5}
        repairs = repairs.extend([PlanFault(OBSTACLE, 2, 0.0, 0.0), PlanFault(FENCE, 4, 0.0, 0.0)], 0.3)
        assert repairs.margins_m == {2: 0.7, 4: 0.5}

    def test_no_way_gets_room_first_and_is_then_left_out(self) -> None:
        fault = PlanFault(NO_PATH, None, 0.0, 0.0)
        once = LayoutRepairs().extend([fault], 0.3)
        assert (once.extra_passes, once.skips_unreachable) == (1, False)
        twice = once.extend([fault], 0.3)
        assert (twice.extra_passes, twice.skips_unreachable) == (1, True)
        assert twice.extend([fault], 0.3) == twice

    def test_remarks_name_margin_and_obstacle(self) -> None:
        field = Field("poled", BOX, obstacles=(POLE,))
        assert LayoutRepairs({0: 0.7}).describe(field) == ["keeps 0.7 m from obstacle 'P7' (pole)"]

    def test_the_margin_holds_in_the_layout(self) -> None:
        field = Field("poled", BOX, obstacles=(POLE,))
        request = PlanRequest(no_headland=True, tractors=(1,), bearing_deg=90.0)
        wide = prepare_context(request, field, layout_repairs=LayoutRepairs({0: 2.0})).layout.field
        assert wide.small_obstacles[0].area == pytest.approx(math.pi * 2.25**2, rel=0.02)
