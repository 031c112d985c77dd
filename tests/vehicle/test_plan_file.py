"""Saved plans: they are read back exactly, and anything else is refused in one sentence."""

import json
import math
from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.errors import MissionError
from vehicle.missions.plan import (
    TASKS,
    FollowOrder,
    Leg,
    LegGate,
    LegTask,
    Mission,
    NotedStop,
    Plan,
    PlanNotes,
    check_plan,
)
from vehicle.missions.plan_file import FORMAT_VERSION, SavedPlan, format_plan, parse_plan, parse_saved_plan

NUMBERS = st.floats(-1e6, 1e6)
POINT = st.tuples(NUMBERS, NUMBERS)
TASK = st.builds(LegTask, st.sampled_from(TASKS), st.none() | st.integers(0, 500), st.integers(0, 3))
METRES = st.floats(allow_nan=False, allow_infinity=False)
PLACES = st.floats(-1e8, 1e8)
PLAIN = st.recursive(
    st.none() | st.booleans() | st.integers() | METRES | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
STOP = st.builds(
    NotedStop, st.integers(0, 1), st.integers(0, 9), NUMBERS, NUMBERS, NUMBERS, st.none() | NUMBERS, st.none() | NUMBERS
)
NOTES = st.builds(
    PlanNotes, st.text(max_size=5), st.sampled_from(["", "first", "last"]), st.none() | st.integers(1, 9),
    st.none() | st.lists(STOP, max_size=3).map(tuple), st.booleans(), st.sampled_from(["refill", "charge", "change"]),
    st.none() | NUMBERS, st.lists(st.integers(0, 8), max_size=3).map(tuple), st.integers(0, 9),
    st.dictionaries(st.text(max_size=3), st.integers() | st.text(max_size=5)),
)  # fmt: skip


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
                draw(st.booleans()), draw(st.sampled_from(["soil", "asphalt"])), draw(TASK), draw(st.booleans()),
            ))  # fmt: skip
        missions.append(Mission(tuple(legs)))
    plan = Plan(tuple(missions), draw(NOTES))
    for tractor, other in ((0, 1), (1, 0)):
        leg = draw(st.integers(0, len(plan.missions[other].legs) - 1))
        length = plan.missions[other].legs[leg].length_m
        plan = plan.copy_with_gate(tractor, 0, LegGate(other, leg, draw(st.floats(0.0, 1.0)) * length))
        if draw(st.booleans()):
            first, *rest = plan.missions[tractor].legs
            led = Mission((replace(first, follow=FollowOrder(other, leg, draw(st.floats(1.0, 30.0)))), *rest))
            plan = replace(plan, missions=(led, plan.missions[1]) if tractor == 0 else (plan.missions[0], led))
    return plan


@given(
    plans(), st.none() | st.just("EPSG:32654"), st.tuples(PLACES, PLACES), st.dictionaries(st.text(max_size=5), PLAIN)
)
def test_json_gives_everything_back(
    plan: Plan, crs: str | None, origin_m: tuple[float, float], scenario: dict[str, Any]
) -> None:
    check_plan(plan)
    text = format_plan(plan, crs=crs, origin_m=origin_m, scenario=scenario)
    saved = parse_saved_plan(text)
    assert (saved.crs, saved.origin_m, saved.scenario) == (crs, origin_m, scenario)
    again = saved.plan
    assert again.notes == plan.notes and again.tractors == plan.tractors
    for mission, other in zip(plan.missions, again.missions, strict=True):
        for a, b in zip(mission.legs, other.legs, strict=True):
            assert a.points.tobytes() == b.points.tobytes()
            same = replace(a, points=b.points)
            assert all(getattr(same, one.name) == getattr(b, one.name) for one in fields(b) if one.name != "points")
    assert format_plan(again, crs=saved.crs, origin_m=saved.origin_m, scenario=saved.scenario) == text


@pytest.fixture
def data(build: Any) -> dict[str, Any]:
    """A saved plan of two tractors as an object."""
    two = [build.leg((0, 0), (0, 10)), build.leg((0, 10), (0, 20))]
    saved: dict[str, Any] = json.loads(format_plan(build.plan(two, [build.leg((5, 0), (5, 10))])))
    return saved


def test_a_plan_without_a_place_is_in_local_metres(data: dict[str, Any]) -> None:
    saved = parse_saved_plan(json.dumps(data))
    assert replace(saved, plan=Plan(())) == SavedPlan(Plan(()), None, (0.0, 0.0), {})


@pytest.mark.parametrize(("version", "sentence"), [
    (FORMAT_VERSION + 1,
     f"has format version {FORMAT_VERSION + 1}, and this Headland reads versions up to {FORMAT_VERSION}; use"),
    (None, "has no 'format_version', so it is not a saved plan; save it again"),
    (0, "format_version 0; it must be a whole number from 1"),
    ("1", "format_version '1'; it must be"),
    (True, "format_version True; it must be"),
    (1.0, r"format_version 1\.0; it must be"),
])  # fmt: skip
def test_another_version_is_refused(data: dict[str, Any], version: Any, sentence: str) -> None:
    with pytest.raises(MissionError, match=sentence) as refusal:
        parse_plan(json.dumps(data | {"format_version": version}))
    assert str(refusal.value).endswith(".") and "\n" not in str(refusal.value)


@pytest.mark.parametrize(("text", "sentence"), [
    ("", "is no saved plan, as it is not JSON"),
    ("{", "is no saved plan, as it is not JSON"),
    ("[]", "plan is \\[\\], not an object"),
    ("3", "plan is 3, not an object"),
    ("1" * 5000, "thousands of digits"),
    ("[" * 100_000, "nested 100000 levels deep"),
])  # fmt: skip
def test_text_that_is_no_plan_is_refused(text: str, sentence: str) -> None:
    with pytest.raises(MissionError, match=sentence):
        parse_plan(text)


@pytest.mark.parametrize(("values", "sentence"), [
    ({"tractors": 3}, "The plan: tractors is 3, not a list"),
    ({"tractors": []}, "needs at least one"),
    ({"tractors": [[]]}, "Tractor 0 has no legs"),
    ({"tractors": [[{"points_m": [[0, 0], [1, 2]]}]]}, "Tractor 0, leg 0 has no 'task'"),
    ({"tractors": [3]}, "tractor 0 is 3, not a list of legs"),
    ({"crs": 32654}, "crs is 32654, not a text"),
    ({"origin_m": [1.0]}, "origin_m is .*; it must be two numbers of metres"),
    ({"origin_m": [1, 2, 3]}, "origin_m is .*; it must be two numbers of metres"),
    ({"origin_m": [1.0, math.nan]}, "origin_m is .*; it must be two numbers of metres"),
    ({"scenario": ["plan"]}, "scenario is .*, not an object"),
    ({"notes": {"strategy": ["u"]}}, r"The notes of the plan: strategy is \['u'\], not a text"),
    ({"notes": {"tractors": 2.5}}, "The notes of the plan: tractors is 2.5, not a whole number"),
    ({"notes": {"apart": ["1"]}}, r"The notes of the plan: apart is \['1'\], not a list of numbers of tractors"),
    ({"notes": {"refills": [{"tractor": 1}]}}, "The notes of the plan, stop 0 has no 'leg'"),
    ({"notes": {"stated": 3}}, "The notes of the plan: stated is 3, not an object"),
])  # fmt: skip
def test_garbled_entries_are_refused(data: dict[str, Any], values: dict[str, Any], sentence: str) -> None:
    with pytest.raises(MissionError, match=sentence):
        parse_plan(json.dumps(data | values))


def test_notes_of_a_file_count_tractors_from_1_and_keep_what_is_not_known(data: dict[str, Any]) -> None:
    stop = {"tractor": 2, "leg": 0, "amount": 5.0, "x_m": 1.0, "y_m": 2.0}
    data["notes"] = {
        "strategy": "interleaved", "headland": None, "tractors": 2, "refills": [stop], "collects": True, "apart": [2],
        "order_gap_pct": 1.5, "stated": {"end_s": 60.0},
    }  # fmt: skip
    saved = parse_saved_plan(json.dumps(data))
    assert saved.plan.notes == PlanNotes(
        "interleaved", tractors=2, stops=(NotedStop(1, 0, 5.0, 1.0, 2.0),), collects=True, apart=(1,),
        others={"order_gap_pct": 1.5},
    )  # fmt: skip
    assert saved.stated == {"end_s": 60.0}
    again = json.loads(format_plan(saved.plan, stated=saved.stated))["notes"]
    assert again == {key: value for key, value in data["notes"].items() if value is not None}


@pytest.mark.parametrize("key", ["crs", "origin_m", "scenario", "notes", "tractors"])
def test_a_missing_entry_is_named(data: dict[str, Any], key: str) -> None:
    del data[key]
    with pytest.raises(MissionError, match=f"The plan has no '{key}'"):
        parse_plan(json.dumps(data))


@pytest.mark.parametrize("key", ["points_m", "speed_mps", "gear", "implement", "ground", "task", "may_wait", "gates"])
def test_a_missing_entry_of_a_leg_is_named(data: dict[str, Any], key: str) -> None:
    del data["tractors"][1][0][key]
    with pytest.raises(MissionError, match=f"Tractor 1, leg 0 has no '{key}'"):
        parse_plan(json.dumps(data))


@pytest.mark.parametrize(("values", "sentence"), [
    ({"task": {"kind": "turn", "number": 1.5, "piece": 0}}, "leg 1, task: number is 1.5, not a whole number."),
    ({"task": {"kind": "turn", "number": 1}}, "leg 1, task has no 'piece'; save the plan again."),
    ({"task": "turn"}, "leg 1: task is 'turn', not an object."),
    ({"points_m": [[0, 0], [1, "a"]]}, "leg 1: points_m is [[0, 0], [1, 'a']], not a list of pairs of metres."),
    ({"points_m": [[0, 0], [1]]}, "leg 1: points_m is [[0, 0], [1]], not a list of pairs of metres."),
    ({"gates": [[1, 2]]}, "leg 1, gate 0 is [1, 2], not an object with 'tractor'."),
    ({"follow": {"tractor": 0, "leg": 0}}, "leg 1, follow has no 'gap_m'; save the plan again."),
    ({"speed_mps": "fast"}, "leg 1: speed_mps is 'fast', not a number."),
    ({"ground": ["soil"] * 99}, "leg 1: ground is ['soil', 'soil', 'soil', 'soil', 'soil',..., not a text."),
])  # fmt: skip
def test_a_garbled_entry_of_a_leg_is_named(data: dict[str, Any], values: dict[str, Any], sentence: str) -> None:
    data["tractors"][0][1] |= values
    with pytest.raises(MissionError) as refusal:
        parse_plan(json.dumps(data))
    assert str(refusal.value) == f"Tractor 0, {sentence}"


def test_lines_of_older_plans_have_the_pieces_that_are_worked() -> None:
    """Plans said nothing of pieces: a line has several where one beyond the first is worked."""
    points = np.array([[0.0, 0.0], [10.0, 0.0]])
    tasks = [LegTask("track", 3), LegTask("track", 3, 1, True), LegTask("track", 4), LegTask("round", 3)]
    legs = tuple(Leg(points + np.array([0.0, 3.0 * k]), 1.0, implement=True, task=task) for k, task in enumerate(tasks))
    content = json.loads(format_plan(Plan(tuple(Mission((leg,)) for leg in legs))))
    for tractor in content["tractors"]:
        tractor[0]["task"].pop("is_piece", None)
    read = parse_plan(json.dumps(content))
    assert [mission.legs[0].task.is_piece for mission in read.missions] == [True, True, False, False]
