"""Fences: what is kept off them, and plans whose outlines are held against them."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import affinity

from fields import Field, FieldError
from planner.evaluation.candidates.evaluate import Candidate, _check_run, _find_fault, run_candidate, simulate_candidate
from planner.evaluation.context import PlanningContext
from planner.evaluation.ground.contact_places import ObstacleIntrusionCheck, find_contact_places, measure_overhang
from planner.evaluation.ground.unworked_area import find_unworked_areas
from planner.evaluation.machine_outlines import build_body
from planner.evaluation.preparation import prepare_context
from planner.evaluation.work_order import WorkOrder
from planner.request.plan_request import PlanRequest
from reports.common.plan_records import FENCE, OBSTACLE
from strategies.path_planning.machine_body import MachineBody
from vehicle.missions.plan import Leg, Mission, Plan
from vehicle.missions.run import DONE, SimulationRun
from vehicle.sim.compile import compute_contact_boxes

pytestmark = pytest.mark.usefixtures("first_layout")

BOX = shapely.box(0, 0, 120, 60)
ALL_ROUND = shapely.LineString(BOX.exterior.coords)
SOUTH = shapely.LineString([(0, 0), (120, 0)])
EAST = shapely.LineString([(120, 0), (120, 60)])
POND = shapely.LinearRing([(-12.0, -3.0), (-9.0, 0.0), (-12.0, 3.0)])


def fenced(
    *lines: shapely.LineString, entrance: tuple[float, float] | None = (60.0, 0.0), **options: Any
) -> PlanningContext:
    options = {"no_headland": True, "tractors": (1,), "bearing_deg": 90.0, **options}
    return prepare_context(WorkOrder(PlanRequest(**options), Field("fenced", BOX, fences=lines, entrance=entrance)))


def standing(site: PlanningContext, *poses: tuple[float, float, float]) -> SimulationRun:
    """A run that shows the centre of mass in poses."""
    rows = np.zeros((2 * len(poses), 1, 7))
    rows[:, 0, :3] = np.repeat(np.array(poses), 2, axis=0)
    plan = Plan((Mission((Leg(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0),)),))
    return SimulationRun(plan, DONE, 0.1 * np.arange(len(rows)), rows, np.array([1.0]), (), math.inf)


def find_deepest_m(run: SimulationRun, site: PlanningContext) -> float:
    """How far a run reaches over fences."""
    return max((place.depth_m for place in find_contact_places(run, site) if place.kind == FENCE), default=0.0)


def name_touched(run: SimulationRun, site: PlanningContext) -> list[str]:
    """The obstacles that a run touches."""
    return [place.name for place in find_contact_places(run, site) if place.kind == OBSTACLE]


class TestMeasured:
    def test_how_far_by_hand(self) -> None:
        """With its nose 2.42 m ahead of the centre of mass a tractor 2 m before a fence is 0.42 m over it."""
        site = fenced(SOUTH, EAST)
        nose = compute_contact_boxes(site.tractor, site.implement)["nose"]
        assert find_deepest_m(standing(site, (118.0, 30.0, 0.0)), site) == pytest.approx(nose - 2.0)
        assert find_deepest_m(standing(site, (120.0 - nose - 0.01, 30.0, 0.0)), site) == 0.0

    def test_an_open_side_and_the_gate_are_no_fence(self) -> None:
        site = fenced(SOUTH)
        assert find_deepest_m(standing(site, (119.0, 30.0, 0.0)), site) == 0.0
        assert find_deepest_m(standing(site, (60.0, 0.0, math.pi / 2)), site) == 0.0
        assert find_deepest_m(standing(site, (80.0, 0.0, math.pi / 2)), site) > 1.0

    def test_a_run_across_a_fence_is_not_feasible(self) -> None:
        """Planned with open edges, a body reaches over them at turns; held against a fence there, that is told."""
        site = prepare_context(WorkOrder(PlanRequest(no_headland=True, overhang_m=6.0), Field("open", BOX)))
        driven = run_candidate(site, Candidate("split-field", 1))
        assert driven.reason is None and find_deepest_m(driven.run, fenced(ALL_ROUND)) > 0.5
        edge = replace(site.layout.field, fences=(ALL_ROUND,), original_boundary=BOX)
        checked = _check_run(replace(site, layout=replace(site.layout, field=edge)), driven)
        assert checked.reason is not None and "crosses the fence by " in checked.reason


class TestPlanned:
    @pytest.mark.parametrize("no_headland", [True, False])
    @pytest.mark.parametrize("lines", [(ALL_ROUND,), (EAST,)], ids=["all round", "one end"])
    def test_nothing_crosses(self, no_headland: bool, lines: Any) -> None:
        site = fenced(*lines, no_headland=no_headland, corners="square")
        driven = simulate_candidate(site, Candidate("split-field", 1))
        assert driven.run is not None and driven.result.feasible
        assert find_deepest_m(driven.run, site) == 0.0
        least = 80.0 if no_headland else 95.0
        assert driven.result.worked_pct > least

    def test_the_margin_is_ground_that_nobody_works_and_the_swing_is_missed(self) -> None:
        """At 4.3 m radius a nose 3.52 m ahead of the rear axle is 1.96 m outside it, 0.46 m over half the width."""
        site = fenced(SOUTH)
        field, swing = (
            site.layout.field,
            build_body(site.tractor, site.implement).compute_swing_m(site.driving_rules.radius_m),
        )
        axle = math.sqrt(site.driving_rules.radius_m**2 - 1.1**2)
        assert swing == pytest.approx(math.hypot(axle + 1.02, 2.42 + 1.1) - site.driving_rules.radius_m)
        assert field.workable_region.bounds[1] == pytest.approx(0.3, abs=0.01)
        assert field.boundary.bounds[1] == pytest.approx(0.3 + swing + 0.1 - 1.5, abs=0.01)
        assert min(swath.start_m[1] for swath in site.layout.swaths) == pytest.approx(0.3 + swing + 0.1, abs=0.02)

    def test_mirrored_it_takes_as_long(self) -> None:
        def time_s(flip: float) -> float | None:
            line, box = (affinity.scale(shape, flip, 1, origin=(0, 0)) for shape in (EAST, BOX))
            site = prepare_context(
                WorkOrder(PlanRequest(no_headland=True, bearing_deg=90.0), Field("f", box, fences=(line,)))
            )
            return simulate_candidate(site, Candidate("split-field", 2)).result.time_s

        assert time_s(-1.0) == pytest.approx(time_s(1.0), rel=0.025)  # another order of lines

    @pytest.mark.parametrize(
        ("entrance", "lines", "refused"),
        [
            (None, (ALL_ROUND,), True),
            ((60.0, 0.0), (ALL_ROUND,), False),
            (None, (SOUTH, EAST), False),
            (None, (shapely.LineString([(0, 2), (0, 60), (120, 60), (120, 0), (0, 0)]),), True),
            (None, (shapely.LineString([(0, 4), (0, 60), (120, 60), (120, 0), (0, 0)]),), False),
            (None, (shapely.LineString([(2, 0), (120, 0), (120, 60), (0, 60), (0, 2)]),), False),
        ],
    )
    def test_a_fence_needs_a_way_in(self, entrance: Any, lines: Any, refused: bool) -> None:
        """An entrance, or an opening of 3 m: two metres are none, unless the corner adds two more."""
        field = Field("pen", BOX, fences=lines, entrance=entrance)
        if not refused:
            assert field.compute_ground_with_margin(0.3).fences == lines
            return
        with pytest.raises(FieldError, match="The fence round field 'pen' has no opening; add a Point with role 'ent"):
            field.compute_ground_with_margin(0.3)


def test_round_a_circle_the_machine_swings_out_as_far_as_the_closed_form_says() -> None:
    """Of a circle of 5 m, by hand: the rear axle is on a smaller one, the outer front corner reaches farther."""
    body = MachineBody(((-0.7, 3.5, 1.0), (-1.5, -0.9, 1.4)), 1.1)
    assert body.compute_swing_m(5.0) == pytest.approx(math.hypot(math.sqrt(25 - 1.21) + 1.0, 3.5) - 5.0)


def test_what_is_touched_is_named() -> None:
    from fields.geometry.obstacles import Obstacle

    pole = Obstacle("pole", shapely.Point(60, 30), 0.25, "P7")
    site = prepare_context(WorkOrder(PlanRequest(no_headland=True), Field("f", BOX, obstacles=(pole,))))
    assert name_touched(standing(site, (58.0, 30.0, 0.0)), site) == ["obstacle 'P7' (pole)"]
    assert name_touched(standing(site, (57.0, 30.0, 0.0)), site) == []


def test_how_far_over_a_pond_by_hand_and_no_plan_is_feasible_that_touches_it() -> None:
    holed = shapely.Polygon(BOX.exterior, [shapely.box(60, 20, 80, 40).exterior])
    site = prepare_context(WorkOrder(PlanRequest(no_headland=True), Field("pond", holed)))
    nose, check = compute_contact_boxes(site.tractor, site.implement)["nose"], ObstacleIntrusionCheck(site)
    over, clear = standing(site, (59.0, 30.0, 0.0)), standing(site, (59.99 - nose, 30.0, 0.0))
    assert (
        check.measure_intrusion_m(over.get_poses(0)) == pytest.approx(nose - 1.0)
        and check.measure_intrusion_m(clear.get_poses(0)) == 0.0
    )
    # The corner of the pond is inside the box: 0.3 m from its side, farther from its nose.
    half = compute_contact_boxes(site.tractor, site.implement)["half_width"]
    beside = np.array([[59.0, 20.0 - half + 0.3, 0.0]])
    assert check.measure_intrusion_m(beside) == pytest.approx(0.3)
    assert (
        "touches a hole of the field" in (_find_fault(site, over, find_contact_places(over, site)) or "")
        and _find_fault(site, clear, find_contact_places(clear, site)) is None
    )


def test_an_implement_is_outside_though_the_outline_runs_between_it_and_its_tractor() -> None:
    site = prepare_context(WorkOrder(PlanRequest(no_headland=True), Field("f", BOX)))
    (rear_m, _, _), (tail_m, front_m, _) = build_body(site.tractor, site.implement).boxes
    assert front_m < rear_m
    axle_m = -0.5 * (front_m + rear_m)  # east of the edge, and the middle of the gap on it
    run = standing(site, (site.tractor.rear_axle_m + axle_m, 30.0, 0.0))
    assert measure_overhang(run, site).farthest_m == pytest.approx(-axle_m - tail_m)


@pytest.mark.parametrize("margin_m", [0.0, 0.1])
def test_without_a_margin_guidance_still_keeps_off_a_fence(margin_m: float) -> None:
    site = fenced(ALL_ROUND, no_headland=False, margin_m=margin_m)
    result = simulate_candidate(site, Candidate("split-field", 1)).result
    assert result.feasible, result.reason
    assert site.layout.field.margin_boundary is not None
    assert SOUTH.distance(site.layout.field.margin_boundary) == pytest.approx(0.2, abs=2e-3)


def test_the_room_to_swing_out_beside_a_fence_is_named() -> None:
    """A band between the margin and what is worked: the machine's nose needs it in turns."""
    site = fenced(ALL_ROUND, no_headland=False)
    field = site.layout.field
    why = {one.reason: one.area_m2 for one in find_unworked_areas(site)}
    band = next(m2 for reason, m2 in why.items() if "swinging out" in reason)
    assert band == pytest.approx(field.margin_boundary.area - field.boundary.area, rel=0.01)
    assert not any("tips and bays" in reason for reason in why)
