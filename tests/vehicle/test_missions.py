"""Plans as data: refusals, derived values, JSON round trip."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.errors import MissionError, VehicleError
from vehicle.missions import (
    JOINT_M,
    KINDS,
    Follow,
    Gate,
    Leg,
    Mission,
    Plan,
    check_plan,
    plan_from_json,
    plan_to_json,
)
from vehicle.world import World

NUMBERS = st.floats(-1e6, 1e6)
POINT = st.tuples(NUMBERS, NUMBERS)


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Executable plans: each leg starts where the one before ends; gates and follows name the other tractor."""
    missions = []
    for _ in range(2):
        legs: list[Leg] = []
        for _ in range(draw(st.integers(1, 3))):
            start = tuple(legs[-1].points[-1]) if legs else draw(POINT)
            first = (start[0] + draw(st.floats(0.5, 50.0)), start[1])
            rest = draw(st.lists(POINT, max_size=3))
            legs.append(Leg(
                np.array([start, first, *rest]), draw(st.floats(0.1, 5.0)), draw(st.sampled_from([1, -1])),
                draw(st.booleans()), draw(st.sampled_from(["soil", "asphalt"])), draw(st.sampled_from(KINDS)),
            ))  # fmt: skip
        missions.append(Mission(tuple(legs)))
    plan = Plan(tuple(missions), draw(st.dictionaries(st.text(max_size=5), st.integers() | st.text(max_size=5))))
    for tractor, other in ((0, 1), (1, 0)):
        leg = draw(st.integers(0, len(plan.missions[other].legs) - 1))
        length = plan.missions[other].legs[leg].length_m
        plan = plan.with_gate(tractor, 0, Gate(other, leg, draw(st.floats(0.0, 1.0)) * length))
        if draw(st.booleans()):
            plan = changed(plan, tractor, 0, follow=Follow(other, leg, draw(st.floats(1.0, 30.0))))
    return plan


def changed(plan: Plan, tractor: int, leg: int, **values: Any) -> Plan:
    """The plan with other values in one leg."""
    legs = list(plan.missions[tractor].legs)
    legs[leg] = replace(legs[leg], **values)
    missions = list(plan.missions)
    missions[tractor] = Mission(tuple(legs))
    return replace(plan, missions=tuple(missions))


@pytest.fixture
def plan(build: Any) -> Plan:
    two = [build.leg((0, 0), (0, 10)), build.leg((0, 10), (0, 20))]
    plan: Plan = build.plan(two, [build.leg((5, 0), (5, 10))])
    return plan


@given(plans())
def test_json_gives_every_plan_back(plan: Plan) -> None:
    check_plan(plan)
    again = plan_from_json(plan_to_json(plan))
    assert again.notes == plan.notes and again.tractors == plan.tractors
    for mission, other in zip(plan.missions, again.missions, strict=True):
        for a, b in zip(mission.legs, other.legs, strict=True):
            assert a.points.tobytes() == b.points.tobytes()
            assert replace(a, points=b.points).__dict__ == b.__dict__
    assert plan_to_json(again) == plan_to_json(plan)


@pytest.mark.parametrize(("points", "expected"), [
    ([(0, 0), (3, 4)], 5.0),
    ([(0, 0), (3, 4), (3, 4), (3, 0)], 9.0),
    ([(-1, 0), (1, 0), (-1, 0)], 4.0),
])  # fmt: skip
def test_length_by_hand(build: Any, points: list[tuple[float, float]], expected: float) -> None:
    assert build.leg(*points).length_m == pytest.approx(expected)


@pytest.mark.parametrize(("gear", "heading_deg"), [(1, 45.0), (-1, -135.0)])
def test_a_mission_starts_facing_its_path_or_away_from_it(build: Any, gear: int, heading_deg: float) -> None:
    x, y, heading = Mission((build.leg((2, 3), (5, 6), gear=gear),)).start
    assert (x, y, math.degrees(heading)) == (2.0, 3.0, pytest.approx(heading_deg))


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
    ({"kind": "plough"}, "kind 'plough' is unknown; use one of: work, turn, drive"),
    ({"gates": (Gate(0, 0),)}, "refers to tractor 0; name another tractor"),
    ({"gates": (Gate(2, 0),)}, "refers to tractor 2; name another tractor"),
    ({"gates": (Gate(-1, 0),)}, "refers to tractor -1"),
    ({"gates": (Gate(1, 1),)}, "refers to leg 1 of tractor 1, which has no such leg"),
    ({"gates": (Gate(1, -1),)}, "refers to leg -1 of tractor 1"),
    ({"gates": (Gate(1, 0, 10.5),)}, r"waits for 10\.5 m of leg 0 of tractor 1, which is 10\.00 m long"),
    ({"gates": (Gate(1, 0, -0.1),)}, r"waits for -0\.1 m of leg 0"),
    ({"gates": (Gate(1, 0, math.nan),)}, "waits for nan m"),
    ({"follow": Follow(0, 0)}, "refers to tractor 0; name another"),
    ({"follow": Follow(7, 0)}, "refers to tractor 7"),
    ({"follow": Follow(1, 4)}, "refers to leg 4 of tractor 1"),
])  # fmt: skip
def test_legs_no_world_can_execute_are_refused(plan: Plan, values: dict[str, Any], sentence: str) -> None:
    broken = changed(plan, 0, 1, **values)
    with pytest.raises(MissionError, match=f"^Tractor 0, leg 1: .*{sentence}"):
        check_plan(broken)


def test_empty_plans_are_refused(plan: Plan) -> None:
    with pytest.raises(MissionError, match="at least one tractor; it has none"):
        check_plan(Plan(()))
    with pytest.raises(MissionError, match="Tractor 1 has no legs"):
        check_plan(Plan((plan.missions[0], Mission(()))))


def test_legs_may_meet_within_the_joint(plan: Plan) -> None:
    check_plan(changed(plan, 0, 1, points=np.array([[0.0, 10.0 + 0.99 * JOINT_M], [0.0, 20.0]])))
    with pytest.raises(MissionError, match="must meet within"):
        check_plan(changed(plan, 0, 1, points=np.array([[0.0, 10.0 + 1.01 * JOINT_M], [0.0, 20.0]])))


def test_a_world_refuses_what_cannot_be_executed(plan: Plan, eg105: Any, implement: Any) -> None:
    with pytest.raises(MissionError, match="gear 3"):
        World(changed(plan, 0, 0, gear=3), eg105, implement)
    with pytest.raises(VehicleError, match="ground 'ice' is unknown; use one of: asphalt, soil"):
        World(changed(plan, 0, 0, ground="ice"), eg105, implement)


@pytest.mark.parametrize(("text", "sentence"), [
    ("", "The plan is not JSON"),
    ("{", "The plan is not JSON"),
    ("[]", "lacks or garbles an entry"),
    ("{}", "lacks or garbles an entry: KeyError"),
    ('{"tractors": 3}', "lacks or garbles an entry"),
    ('{"tractors": []}', "at least one tractor"),
    ('{"tractors": [[]]}', "Tractor 0 has no legs"),
    ('{"tractors": [[{"points_m": [[0, 0], [1, "a"]]}]]}', "lacks or garbles an entry"),
])  # fmt: skip
def test_text_that_is_no_plan_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(MissionError, match=sentence):
        plan_from_json(text)


@pytest.mark.parametrize("key", ["points_m", "speed_mps", "gear", "implement", "ground", "kind", "gates"])
def test_a_missing_entry_is_named(plan: Plan, key: str) -> None:
    data = json.loads(plan_to_json(plan))
    del data["tractors"][1][0][key]
    with pytest.raises(MissionError, match=f"lacks or garbles an entry: KeyError\\('{key}'\\)"):
        plan_from_json(json.dumps(data))
