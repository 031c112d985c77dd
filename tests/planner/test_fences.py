"""Fences: what is kept off them, and plans whose outlines are held against them."""

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import affinity

from fields import Field, FieldError
from planner.candidates.evaluate import Candidate, _fault, evaluate, simulated
from planner.candidates.steady import OUTSIDE_M, slips
from planner.ground.touched import ObstacleCheck, fence_crossed_m, obstacle_touched
from planner.ground.unworked import unworked
from planner.scenario import Scenario
from planner.site import Site, body_of, prepare
from strategies.ways.fence import STEP_M, Body, Fence
from strategies.ways.paths import Path, Segment, make_path, straight
from vehicle.compile import outline
from vehicle.missions import TRACK, TURN, Leg, Mission, Plan, Task
from vehicle.run import DONE, Run

BOX = shapely.box(0, 0, 120, 60)
ALL_ROUND = shapely.LineString(BOX.exterior.coords)
SOUTH = shapely.LineString([(0, 0), (120, 0)])
EAST = shapely.LineString([(120, 0), (120, 60)])


def fenced(*lines: shapely.LineString, entrance: tuple[float, float] | None = (60.0, 0.0), **options: Any) -> Site:
    options = {"tracks_only": True, "tractors": (1,), "bearing_deg": 90.0, **options}
    return prepare(Scenario(**options), Field("fenced", BOX, fences=lines, entrance=entrance))


def standing(site: Site, *poses: tuple[float, float, float]) -> Run:
    """A run that shows the centre of mass in poses."""
    rows = np.zeros((2 * len(poses), 1, 7))
    rows[:, 0, :3] = np.repeat(np.array(poses), 2, axis=0)
    plan = Plan((Mission((Leg(np.array([[0.0, 0.0], [1.0, 0.0]]), 1.0),)),))
    return Run(plan, DONE, 0.1 * np.arange(len(rows)), rows, np.array([1.0]), (), math.inf)


class TestMeasured:
    def test_how_far_by_hand(self) -> None:
        """With its nose 2.42 m ahead of the centre of mass a tractor 2 m before a fence is 0.42 m over it."""
        site = fenced(SOUTH, EAST)
        nose = outline(site.tractor, site.implement)["nose"]
        assert fence_crossed_m(standing(site, (118.0, 30.0, 0.0)), site) == pytest.approx(nose - 2.0)
        assert fence_crossed_m(standing(site, (120.0 - nose - 0.01, 30.0, 0.0)), site) == 0.0

    def test_an_open_side_and_the_gate_are_no_fence(self) -> None:
        site = fenced(SOUTH)
        assert fence_crossed_m(standing(site, (119.0, 30.0, 0.0)), site) == 0.0
        assert fence_crossed_m(standing(site, (60.0, 0.0, math.pi / 2)), site) == 0.0
        assert fence_crossed_m(standing(site, (80.0, 0.0, math.pi / 2)), site) > 1.0

    def test_a_plan_across_a_fence_is_not_feasible(self) -> None:
        """Planned as if there were none, turns reach over the edge; held against a fence there, that is the reason."""
        site = fenced()
        edge = replace(site.layout.field, fences=(ALL_ROUND,), outline=BOX)
        result = simulated(replace(site, layout=replace(site.layout, field=edge)), Candidate("split-field", 1)).result
        assert not result.feasible and result.reason is not None
        assert "crosses the fence by 0." in result.reason and result.reason.endswith("keep a wider margin")


class TestPlanned:
    @pytest.mark.parametrize("tracks_only", [True, False])
    @pytest.mark.parametrize("lines", [(ALL_ROUND,), (EAST,)], ids=["all round", "one end"])
    def test_nothing_crosses(self, tracks_only: bool, lines: Any) -> None:
        site = fenced(*lines, tracks_only=tracks_only)
        driven = simulated(site, Candidate("split-field", 1))
        assert driven.run is not None and driven.result.feasible
        assert fence_crossed_m(driven.run, site) == 0.0
        least = 80.0 if tracks_only else 95.0
        assert driven.result.worked_pct is not None and driven.result.worked_pct > least

    def test_the_margin_is_ground_that_nobody_works_and_the_swing_is_missed(self) -> None:
        """At 4.3 m radius a nose 3.52 m ahead of the rear axle is 1.96 m outside it, 0.46 m over half the width."""
        site = fenced(SOUTH)
        field, swing = site.layout.field, body_of(site.tractor, site.implement).swing_m(site.manner.radius_m)
        axle = math.sqrt(site.manner.radius_m**2 - 1.1**2)
        assert swing == pytest.approx(math.hypot(axle + 1.02, 2.42 + 1.1) - site.manner.radius_m)
        assert field.ground.bounds[1] == pytest.approx(0.3, abs=0.01)
        assert field.boundary.bounds[1] == pytest.approx(0.3 + swing + 0.1 - 1.5, abs=0.01)
        assert min(track.start[1] for track in site.layout.tracks) == pytest.approx(0.3 + swing + 0.1, abs=0.02)

    def test_mirrored_it_takes_as_long(self) -> None:
        def time_s(flip: float) -> float | None:
            line, box = (affinity.scale(shape, flip, 1, origin=(0, 0)) for shape in (EAST, BOX))
            site = prepare(Scenario(tracks_only=True, bearing_deg=90.0), Field("f", box, fences=(line,)))
            return evaluate(site, Candidate("split-field", 2)).time_s

        assert time_s(-1.0) == pytest.approx(time_s(1.0), rel=0.005)

    @pytest.mark.parametrize(("entrance", "lines", "refused"), [
        (None, (ALL_ROUND,), True), ((60.0, 0.0), (ALL_ROUND,), False), (None, (SOUTH, EAST), False),
        (None, (shapely.LineString([(0, 2), (0, 60), (120, 60), (120, 0), (0, 0)]),), True),
        (None, (shapely.LineString([(0, 4), (0, 60), (120, 60), (120, 0), (0, 0)]),), False),
        (None, (shapely.LineString([(2, 0), (120, 0), (120, 60), (0, 60), (0, 2)]),), False),
    ])  # fmt: skip
    def test_a_fence_needs_a_way_in(self, entrance: Any, lines: Any, refused: bool) -> None:
        """An entrance, or an opening of 3 m: two metres are none, unless the corner adds two more."""
        field = Field("pen", BOX, fences=lines, entrance=entrance)
        if not refused:
            assert field.clear_of_obstacles(0.3).fences == lines
            return
        with pytest.raises(FieldError, match="The fence round field 'pen' has no way in; add a Point with role 'ent"):
            field.clear_of_obstacles(0.3)


class TestWays:
    BODY = Body(((-0.7, 3.5, 1.0), (-1.5, -0.9, 1.4)), 1.1)

    def fence(self, y: float) -> Fence:
        return Fence(shapely.LineString([(-50, y), (50, y)]), shapely.LineString(), self.BODY, 0.0)

    def test_straight_on_to_the_fence_by_hand(self) -> None:
        """The nose is 3.5 - 1.1 = 2.4 m ahead of the guided point."""
        ahead = straight((0.0, 0.0, math.pi / 2), 10.0)
        assert self.fence(12.39).crosses(ahead) and not self.fence(12.41).crosses(ahead)
        assert self.fence(2.39).hits((0.0, 0.0, math.pi / 2)) and not self.fence(2.41).hits((0.0, 0.0, math.pi / 2))

    def test_in_reverse_the_implement_comes_first(self) -> None:
        """It ends 1.5 + 1.1 = 2.6 m behind the guided point."""
        back = straight((0.0, 0.0, -math.pi / 2), -10.0)
        assert self.fence(12.59).crosses(back) and not self.fence(12.61).crosses(back)

    def test_round_a_circle_it_swings_out_as_far_as_the_closed_form_says(self) -> None:
        """Half a circle of 5 m: its apex is 5 m on, and the outer front corner reaches farther."""
        radius = 5.0
        half = Path((0.0, 0.0, 0.0), (Segment(1.5 * math.pi * radius, 1.0 / radius, 1),), "u")
        reach = 2.0 * radius + self.BODY.swing_m(radius)
        assert self.BODY.swing_m(radius) == pytest.approx(math.hypot(math.sqrt(25 - 1.21) + 1.0, 3.5) - 5.0)
        assert self.fence(reach - 0.1).crosses(half) and not self.fence(reach + 0.1).crosses(half)

    def test_a_soft_line_is_told_from_a_fence(self) -> None:
        one = Fence(shapely.LineString(), shapely.LineString([(-50, 5), (50, 5)]), self.BODY, 0.0)
        ahead = straight((0.0, 0.0, math.pi / 2), 10.0)
        assert one.crosses(ahead) and not one.crosses(ahead, fences_only=True)


def test_what_is_touched_is_named() -> None:
    from fields.obstacles import Obstacle

    pole = Obstacle("pole", shapely.Point(60, 30), 0.25, "P7")
    site = prepare(Scenario(tracks_only=True), Field("f", BOX, obstacles=(pole,)))
    assert obstacle_touched(standing(site, (58.0, 30.0, 0.0)), site) == "obstacle 'P7' (pole)"
    assert obstacle_touched(standing(site, (57.0, 30.0, 0.0)), site) is None


def with_pond() -> Site:
    """A site with a pond of 20 m by 20 m, 60 m from the left."""
    holed = shapely.Polygon(BOX.exterior, [shapely.box(60, 20, 80, 40).exterior])
    return prepare(Scenario(tracks_only=True), Field("pond", holed))


def test_how_far_over_a_pond_by_hand_and_no_plan_is_feasible_that_touches_it() -> None:
    site = with_pond()
    nose, check = outline(site.tractor, site.implement)["nose"], ObstacleCheck(site)
    over, clear = standing(site, (59.0, 30.0, 0.0)), standing(site, (59.99 - nose, 30.0, 0.0))
    assert check.depth_m(over.poses(0)) == pytest.approx(nose - 1.0) and check.depth_m(clear.poses(0)) == 0.0
    # The corner of the pond is inside the box: 0.3 m from its side, farther from its nose.
    half = outline(site.tractor, site.implement)["half_width"]
    beside = np.array([[59.0, 20.0 - half + 0.3, 0.0]])
    assert check.depth_m(beside) == pytest.approx(0.3)
    assert "touches a hole of the field" in (_fault(site, over, None) or "") and _fault(site, clear, None) is None


def test_a_turn_in_which_a_pond_is_touched_is_one_to_be_cured() -> None:
    """As much of one as if the field were left by more than is borne."""
    site = with_pond()
    tasks = (Task(TRACK, 1), Task(TURN, 2), Task(TRACK, 2))
    lines = [[(57.0, 10.0 + 10.0 * k), (57.0, 20.0 + 10.0 * k)] for k in range(3)]
    legs = [Leg(np.array(line), 1.0, implement=task.works, task=task) for line, task in zip(lines, tasks, strict=True)]
    for east, touches in ((57.0, False), (59.5, True)):
        run = standing(site, (57.0, 15.0, math.pi / 2), (east, 25.0, 0.0), (57.0, 30.0, math.pi / 2))
        run.record[:, 0, 5] = [0, 0, 1, 1, 2, 2]
        (turn,) = slips(replace(run, plan=Plan((Mission(tuple(legs)),))), site)
        assert turn.outside == touches and (turn.metres > OUTSIDE_M) == touches


MACHINE = Body(((-1.0, 3.5, 1.0), (-2.5, -1.0, 1.6)), 1.2)
HEDGE = shapely.LineString([(10.0, -40.0), (12.0, 0.0), (9.0, 40.0)])
POND = shapely.LinearRing([(-12.0, -3.0), (-9.0, 0.0), (-12.0, 3.0)])


def slow_axle(way: Path) -> np.ndarray:
    """The rear axle's poses, step by step: it points at the guided point, or in reverse follows the way itself."""
    x, y, heading = way.start
    axle = np.array([x, y]) - MACHINE.guide_m * np.array([math.cos(heading), math.sin(heading)])
    poses = [(*axle, heading)]
    for gear, points in way.sample(STEP_M):
        for before, point in pairwise(points):
            ahead = point - axle if gear > 0 else before - point
            ahead = ahead / np.hypot(*ahead)
            axle = point - MACHINE.guide_m * ahead
            poses.append((*axle, math.atan2(ahead[1], ahead[0])))
    return np.array(poses)


pieces = st.builds(Segment, st.floats(0.1, 12.0), st.sampled_from([-0.2, 0.0, 0.2]), st.sampled_from([1, 1, -1]))


@given(st.tuples(*[st.floats(-14.0, 14.0)] * 2, st.floats(-3.0, 3.0)), st.lists(pieces, min_size=1, max_size=4))
def test_what_comes_to_a_fence_is_told_as_by_every_box_of_the_machine(
    start: tuple[float, float, float], driven: list[Segment]
) -> None:
    fence, way = Fence(HEDGE, POND, MACHINE, 0.2), make_path(start, driven, "route")
    boxes = MACHINE.placed(slow_axle(way))
    nearest = [shapely.distance(boxes, lines).min() for lines in (shapely.union(HEDGE, POND), HEDGE)]
    for away, only in zip(nearest, (False, True), strict=True):
        assert fence.crosses(way, fences_only=only) == (away <= 0.2) or abs(away - 0.2) < 1e-6
@pytest.mark.parametrize("margin_m", [0.0, 0.1])
def test_without_a_margin_guidance_still_keeps_off_a_fence(margin_m: float) -> None:
    site = fenced(ALL_ROUND, tracks_only=False, margin_m=margin_m)
    result = evaluate(site, Candidate("split-field", 1))
    assert result.feasible, result.reason
    assert site.layout.field.beyond is not None
    assert SOUTH.distance(site.layout.field.beyond) == pytest.approx(0.2, abs=2e-3)


def test_the_room_to_swing_out_beside_a_fence_is_named() -> None:
    """A band between the margin and what is worked: the machine's nose needs it in turns."""
    site = fenced(ALL_ROUND, tracks_only=False)
    field = site.layout.field
    assert field.beyond is not None
    why = {one.why: one.m2 for one in unworked(site)}
    band = next(m2 for words, m2 in why.items() if "swing out" in words)
    assert band == pytest.approx(field.beyond.area - field.boundary.area, rel=0.01)
    assert not any("tips and bays" in words for words in why)
