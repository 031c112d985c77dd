"""Plans as data: refusals, derived values, tasks."""

import math
from typing import Any

import numpy as np
import pytest

from tests.vehicle.bits import change_leg
from vehicle.errors import MissionError, VehicleError
from vehicle.missions.plan import MAX_JOINT_GAP_M, FollowOrder, Leg, LegGate, LegTask, Mission, Plan, check_plan
from vehicle.missions.run import DONE
from vehicle.sim.compile import compile_plan
from vehicle.sim.world import World


@pytest.fixture
def plan(build: Any) -> Plan:
    two = [build.leg((0, 0), (0, 10)), build.leg((0, 10), (0, 20))]
    plan: Plan = build.plan(two, [build.leg((5, 0), (5, 10))])
    return plan


@pytest.mark.parametrize(("points", "expected"), [
    ([(0, 0), (3, 4)], 5.0),
    ([(0, 0), (3, 4), (3, 4), (3, 0)], 9.0),
    ([(-1, 0), (1, 0), (-1, 0)], 4.0),
])  # fmt: skip
def test_length_by_hand(build: Any, points: list[tuple[float, float]], expected: float) -> None:
    assert build.leg(*points).length_m == pytest.approx(expected)


def test_a_cut_leg_begins_with_its_stops() -> None:
    points = np.array([[0.0, 0.0], [3.0, 4.0], [3.0, 10.0]])
    leg = Leg(points, 1.0, gates=(LegGate(1, 0, 1.0),), may_wait=True, stand_s=9.0, fold_s=4.0, folded=True)
    first, second = leg.cut(-1.0, 4.0), leg.cut(4.0, 99.0)
    assert first.points == pytest.approx(np.array([[0.0, 0.0], [2.4, 3.2]]))
    assert second.points == pytest.approx(np.array([[2.4, 3.2], [3.0, 4.0], [3.0, 10.0]]))
    assert (first.gates, first.may_wait, first.standing_s) == (leg.gates, True, 13.0)
    assert (second.gates, second.may_wait, second.standing_s, second.folded) == ((), False, 0.0, True)
    assert leg.cut(0.0, leg.length_m) is leg, "nothing is cut"
    assert leg.cut(5.04, 11.0).points == pytest.approx(np.array([[3.0, 4.04], [3.0, 10.0]]))


def test_a_copied_leg_has_the_same_length(build: Any) -> None:
    leg = build.leg((0, 0), (3, 4), (3, 0))
    early, measured = leg.copy_with(may_wait=True), (leg.length_m, leg.ends)
    late = leg.copy_with(gates=(LegGate(0, 0, 1.0),)).copy_with_gates([LegGate(0, 1, 2.0)])
    assert measured == (early.length_m, early.ends) == (late.length_m, late.ends)
    assert early.points is late.points is leg.points and early.may_wait and not leg.may_wait
    assert late.gates == (LegGate(0, 0, 1.0), LegGate(0, 1, 2.0)) and late.speed_mps == leg.speed_mps
    with pytest.raises(TypeError):
        leg.copy_with(points=2.0 * leg.points)


@pytest.mark.parametrize(("gear", "heading_deg"), [(1, 45.0), (-1, -135.0)])
def test_a_mission_starts_facing_its_path_or_away_from_it(build: Any, gear: int, heading_deg: float) -> None:
    x, y, heading = Mission((build.leg((2, 3), (5, 6), gear=gear),)).start
    assert (x, y, math.degrees(heading)) == (2.0, 3.0, pytest.approx(heading_deg))


@pytest.mark.parametrize("gear", [1, -1])
def test_the_antenna_stands_where_a_mission_starts_in_either_gear(build: Any, eg105: Any, gear: int) -> None:
    plan = build.plan([build.leg((2, 3), (2 + 10 * gear, 3), gear=gear)])  # it looks east
    (state,) = compile_plan(plan, eg105).states
    assert state["x"] + eg105.antenna_forward_m - eg105.rear_axle_m == pytest.approx(2.0)
    assert (state["y"], state["angle"]) == (pytest.approx(3.0), pytest.approx(0.0))


@pytest.mark.parametrize(("values", "sentence"), [
    ({"points": np.zeros((1, 2))}, r"points have shape \(1, 2\); a leg needs two or more"),
    ({"points": np.zeros((4, 3))}, r"points have shape \(4, 3\)"),
    ({"points": np.zeros(4)}, r"points have shape \(4,\)"),
    ({"points": np.array([[0.0, 10.0], [np.nan, 20.0]])}, "a coordinate is not a number"),
    ({"points": np.array([[0.0, 10.0], [np.inf, 20.0]])}, "a coordinate is not a number"),
    ({"points": np.array([[0.0, 10.0], [0.0, 10.0005]])}, "0.0005 m long; it must be at least 1 mm"),
    ({"points": np.array([[0.0, 10.4], [0.0, 20.0]])}, r"starts 0\.40 m from where the leg before ends"),
    ({"gear": 0}, "gear 0 is unknown; use 1"),
    ({"gear": 2}, "gear 2 is unknown"),
    ({"speed_mps": 0.0}, r"speed 0\.0 m/s is not above 0; gear -1 drives backwards"),
    ({"speed_mps": -1.4}, r"speed -1\.4 m/s is not above 0"),
    ({"speed_mps": math.nan}, "speed nan m/s"),
    ({"speed_mps": math.inf}, "speed inf m/s"),
    ({"task": LegTask("plough")}, "task 'plough' is unknown; use one of: track, round, turn, way, drive-in, drive"),
    ({"task": LegTask("track", -1)}, "task 'track' has number -1 and piece 0; both count from 0"),
    ({"task": LegTask("track", 3, -2)}, "task 'track' has number 3 and piece -2; both count from 0"),
    ({"gates": (LegGate(0, 0),)}, "refers to tractor 0; name another tractor"),
    ({"gates": (LegGate(2, 0),)}, "refers to tractor 2; name another tractor"),
    ({"gates": (LegGate(-1, 0),)}, "refers to tractor -1"),
    ({"gates": (LegGate(1, 1),)}, "refers to leg 1 of tractor 1, which has no such leg"),
    ({"gates": (LegGate(1, -1),)}, "refers to leg -1 of tractor 1"),
    ({"gates": (LegGate(1, 0, 10.5),)}, r"waits for 10\.5 m of leg 0 of tractor 1, which is 10\.00 m long"),
    ({"gates": (LegGate(1, 0, -0.1),)}, r"waits for -0\.1 m of leg 0"),
    ({"gates": (LegGate(1, 0, math.nan),)}, "waits for nan m"),
    ({"follow": FollowOrder(0, 0)}, "refers to tractor 0; name another"),
    ({"follow": FollowOrder(7, 0)}, "refers to tractor 7"),
    ({"follow": FollowOrder(1, 4)}, "refers to leg 4 of tractor 1"),
])  # fmt: skip
def test_legs_no_world_can_execute_are_refused(plan: Plan, values: dict[str, Any], sentence: str) -> None:
    broken = change_leg(plan, 0, 1, **values)
    with pytest.raises(MissionError, match=f"^Tractor 0, leg 1: .*{sentence}"):
        check_plan(broken)


def test_empty_plans_are_refused(plan: Plan) -> None:
    with pytest.raises(MissionError, match="The plan has no tractor; it needs at least one"):
        check_plan(Plan(()))
    with pytest.raises(MissionError, match="Tractor 1 has no legs"):
        check_plan(Plan((plan.missions[0], Mission(()))))


def test_legs_may_meet_within_the_joint(plan: Plan) -> None:
    check_plan(change_leg(plan, 0, 1, points=np.array([[0.0, 10.0 + 0.99 * MAX_JOINT_GAP_M], [0.0, 20.0]])))
    with pytest.raises(MissionError, match="must meet within"):
        check_plan(change_leg(plan, 0, 1, points=np.array([[0.0, 10.0 + 1.01 * MAX_JOINT_GAP_M], [0.0, 20.0]])))


@pytest.mark.parametrize("last", [[(0.0, 9.98), (0.0, 10.0)], [(0.0, 9.98), (0.0, 10.0), (0.0, 10.02)]])
def test_a_leg_that_ends_where_the_one_before_does_is_driven(
    build: Any, eg105: Any, implement: Any, last: list[tuple[float, float]]
) -> None:
    """Nothing of it is left once it is joined: its path has no length of its own to look ahead on."""
    legs = [build.leg((0, 0), (0, 10)), build.leg(*last), build.leg((0, 10), (0, 2), gear=-1)]
    run = World(build.plan(legs), eg105, implement).run(max_time_s=60.0)
    assert run.outcome == DONE and np.isfinite(run.record).all()
    assert run.get_poses(0)[:, 1].max() == pytest.approx(
        World(build.plan([legs[0], legs[2]]), eg105, implement).run(max_time_s=60.0).get_poses(0)[:, 1].max(), abs=0.05
    )


def test_a_world_refuses_plans_that_cannot_be_executed(plan: Plan, eg105: Any, implement: Any) -> None:
    with pytest.raises(MissionError, match="gear 3"):
        World(change_leg(plan, 0, 0, gear=3), eg105, implement)
    with pytest.raises(VehicleError, match="ground 'ice' is unknown; use one of: asphalt, soil"):
        World(change_leg(plan, 0, 0, ground="ice"), eg105, implement)


@pytest.mark.parametrize(("kind", "works"), [
    ("track", True), ("round", True), ("turn", False), ("way", False), ("drive-in", False), ("drive", False),
])  # fmt: skip
def test_only_swaths_and_headland_passes_are_work(kind: str, works: bool) -> None:
    assert LegTask(kind).is_work is works


def test_a_goal_is_a_number_and_a_piece(build: Any) -> None:
    track = LegTask("track", 7, 1)
    assert LegTask("turn", 7, 1).has_same_goal(track) and LegTask("drive-in", 7, 1).has_same_goal(track)
    assert not LegTask("turn", 7, 0).has_same_goal(track) and not LegTask("turn", 6, 1).has_same_goal(track)


@pytest.mark.parametrize(
    ("kind", "lookahead"),
    [("track", "lookahead_m"), ("round", "lookahead_m"), ("turn", "turn_lookahead_m"), ("drive", "turn_lookahead_m")],
)
def test_guidance_looks_ahead_by_task(build: Any, eg105: Any, implement: Any, kind: str, lookahead: str) -> None:
    world = World(build.plan([build.leg((0, 0), (0, 10), task=LegTask(kind))]), eg105, implement)
    assert world.program.legs["lookahead"].tolist() == [getattr(eg105.guidance, lookahead)]
