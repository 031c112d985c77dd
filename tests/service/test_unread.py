"""A tractor that tells of an obstacle which nobody can read stands, and nobody else does."""

import json
import math
import random
from datetime import UTC, datetime, timedelta
from typing import Any

import pytest

from planner.fleet.manager.obstacle_reports import CLEARED_RADIUS_M, LOOK_DELAY_S, SETTLED_S, UNREADABLE_CODE
from planner.fleet.manager.progress_snapshot import capture_progress, restore_progress
from planner.fleet.model.rules import ControlLeaseError, FleetManagerError
from planner.fleet.model.tractor_state import Hold, TractorReport
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.inbound_frames import LARGEST_FRAME, AcknowledgeFrame, is_about_obstacle
from planner.fleet.session.state_recorder import MOST_SEQUENCES_AHEAD
from planner.service.fleets.fleet_socket import _handle_frame
from tests.benchmarks.links import spoil_frame
from tests.service.fleets import SimulatedFleet, fleet_plan, start_fleet, state
from tests.service.test_safety import live, remote, waiting

SQUARE = [[1000.0, 2100.0], [1001.0, 2100.0], [1001.0, 2101.0], [1000.0, 2101.0]]
NAMED: dict[str, Any] = {"kind": "obstacle", "polygon_m": SQUARE}
CIRCLE = [[1000.0 + math.cos(k / 50), 2100.0 + math.sin(k / 50)] for k in range(300)]
BAD_FRAMES = {
    "many corners": json.dumps({"kind": "obstacle", "polygon_m": CIRCLE}),
    "two corners": json.dumps({"kind": "obstacle", "polygon_m": SQUARE[:2]}),
    "a corner of words": json.dumps({"kind": "obstacle", "polygon_m": [["a", 0.0], *SQUARE]}),
    "a bow": json.dumps({"kind": "obstacle", "polygon_m": [SQUARE[k] for k in (0, 2, 1, 3)]}),
    "no corners": '{"kind" : "obstacle"}',
    "no kind": json.dumps({"polygon_m": SQUARE}),
    "more than it has": json.dumps({"kind": "obstacle", "polygon_m": SQUARE, "height_m": 2.0}),
    "cut off": json.dumps({"kind": "obstacle", "polygon_m": SQUARE})[:50],
    "endless": json.dumps({"kind": "obstacle", "polygon_m": SQUARE * 2000}),
}
AWAY = ((50.0, 50.0), (51.0, 50.0), (51.0, 51.0))


def started() -> tuple[FleetSession, FleetClient, FleetClient, FleetClient]:
    """A fleet that drives: both tractors and an operator, whose outboxes nobody empties."""
    fleet, first, operator = live()
    second = FleetClient(TRACTOR, "tractor 2", 1)
    fleet.add_client(second, 0.0)
    fleet.manager.operators.start_fleet_work("anna", 0.0)
    fleet.send_pending_outputs()
    for client in (first, second, operator):
        waiting(client)
    return fleet, first, second, operator


@pytest.mark.parametrize("what", BAD_FRAMES)
def test_who_tells_of_an_obstacle_that_cannot_be_read_stands_and_nobody_else(what: str) -> None:
    fleet, first, second, _ = started()
    _handle_frame(fleet, first, BAD_FRAMES[what])
    told = waiting(first)
    refused = next(frame for frame in told if frame["kind"] == "refused")
    assert [frame["kind"] for frame in told if frame["kind"] == "stop"] and not waiting(second)
    assert [state.holds for state in fleet.manager.states] == [{Hold.UNREADABLE}, set()]
    (alarm,) = fleet.manager.alarms.list_alarms()
    assert (alarm.level, alarm.tractor) == ("critical", 0) and refused["sentence"] in alarm.sentence
    assert not fleet.manager.obstacles.items


def test_what_does_not_name_itself_an_obstacle_or_comes_of_an_operator_holds_nobody() -> None:
    assert is_about_obstacle('{"kind":"obstacle"') and is_about_obstacle('{"polygon_m" : 3}')
    assert not is_about_obstacle('{"kind":"state","name":"obstacle"}')
    fleet, first, _, operator = started()
    said = json.dumps(state(5, errors=['"kind":"obstacle"']) | {"leg": -1})
    for text in (said, "{", "[]", '"obstacle"', None, "x" * (LARGEST_FRAME + 1)):
        _handle_frame(fleet, first, text)
    for text in BAD_FRAMES.values():
        _handle_frame(fleet, operator, text)
    assert not any(state.holds for state in fleet.manager.states)


def test_ten_thousand_hold_one_tractor_once_and_its_states_are_taken_on() -> None:
    fleet, first, second, _ = started()
    chance, taken = random.Random(2), 0
    good = json.dumps({"kind": "obstacle", "polygon_m": SQUARE, "name": "s"} | state(MOST_SEQUENCES_AHEAD * 2))
    for number in range(10_000):
        text = spoil_frame(chance, good)
        _handle_frame(fleet, first, text if isinstance(text, str) else None)
        if number % 100 == 0:
            _handle_frame(fleet, first, json.dumps(state(taken)))
            _handle_frame(fleet, second, json.dumps(state(taken, easting_m=1020.0)))
            taken += 1
    assert fleet.recorder.received[:2] == [taken - 1] * 2
    assert not fleet.manager.obstacles.items and [s.holds for s in fleet.manager.states] == [{Hold.UNREADABLE}, set()]
    assert len(fleet.manager.alarms.list_alarms()) == 1
    assert sum(event.what == UNREADABLE_CODE for _, event in fleet.events) == 1


def facing() -> SimulatedFleet:
    """The first of two tractors has told of what cannot be read, and stands 5 m along its leg."""
    fleet = start_fleet(fleet_plan(2, 3))
    fleet.run(5)
    fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
    fleet.run(4)
    assert fleet.at_m == [pytest.approx(5.0, abs=0.2), pytest.approx(9.0, abs=0.2)]
    return fleet


def held(fleet: SimulatedFleet) -> bool:
    return Hold.UNREADABLE in fleet.manager.states[0].holds


def acknowledge(fleet: SimulatedFleet) -> None:
    alarm = next(each for each in fleet.manager.alarms.list_alarms() if each.code == UNREADABLE_CODE)
    fleet.manager.obstacle_reports.acknowledge_alarm("anna", alarm.id, fleet.now)


def test_an_operator_who_has_looked_lets_it_pass_that_place_and_no_farther() -> None:
    fleet = facing()
    fleet.manager.alarms.raise_alarm("other", 0, "warning", "Something else.", fleet.now)
    other = fleet.manager.alarms.list_alarms()[-1]
    fleet.manager.obstacle_reports.acknowledge_alarm("anna", other.id, fleet.now)
    assert held(fleet), "the alarm of something else says nothing of what it sees"
    acknowledge(fleet)
    assert [alarm.code for alarm in fleet.manager.alarms.list_alarms()] == ["other"]
    begun_m = fleet.at_m[0]
    while not held(fleet):
        fleet.run(0.5)
        fleet.manager.obstacle_reports.add_unreadable(0, "It has 301 corners.", fleet.now)
        assert fleet.at_m[0] < begun_m + CLEARED_RADIUS_M + 2.0
    assert fleet.at_m[0] > begun_m + CLEARED_RADIUS_M
    assert ("anna", "looked") in [(event.who, event.what) for event in fleet.events]


def test_one_that_can_be_read_lets_it_go_on_once_no_other_has_come_for_a_while() -> None:
    fleet = facing()
    for _ in range(10):  # by turns
        fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
        fleet.run(0.5)
        fleet.manager.obstacle_reports.add("tractor 1", AWAY, "stone", fleet.now, 0)
        assert held(fleet)
    fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
    fleet.run(5)
    assert held(fleet), "silence of it is no sign that nothing is there"
    fleet.manager.obstacle_reports.add("tractor 2", AWAY, "stone", fleet.now, 1)
    fleet.run(1)
    assert held(fleet), "what another sees is not what it sees"
    fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
    fleet.run(0.5)
    fleet.manager.obstacle_reports.add("tractor 1", AWAY, "stone", fleet.now, 0)
    fleet.run(SETTLED_S)
    assert not held(fleet) and not fleet.standing[0]
    fleet = facing()
    fleet.manager.obstacle_reports.add("tractor 1", ((-1.0, 12.0), (1.0, 12.0), (1.0, 13.0)), "stone", fleet.now, 0)
    fleet.run(SETTLED_S + 1.0)
    assert fleet.standing[0] and fleet.manager.states[0].holds == {Hold.OBSTACLE}, "what is read holds it instead"


def test_remote_control_stands_too_until_somebody_has_looked() -> None:
    fleet = remote(0.0, 5.0)
    fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
    fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
    fleet.now += LOOK_DELAY_S
    fleet.manager.take_report(0, TractorReport(0.0, 5.0, math.pi / 2, 0.0, mode="remote", leg_m=5.0), fleet.now)
    assert fleet.manager.states[0].remote_command[1] == 0.0
    with pytest.raises(FleetManagerError, match="an obstacle that cannot be read") as refused:
        fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
    assert not isinstance(refused.value, ControlLeaseError)
    acknowledge(fleet)
    fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)


def test_it_is_held_after_a_restart_too_and_can_be_let_go() -> None:
    fleet = facing()
    kept: dict[str, Any] = json.loads(json.dumps(capture_progress(fleet.manager, fleet.now, 1e9)))
    again = start_fleet(fleet.manager.plan)
    restore_progress(again.manager, kept, again.now, 1e9)
    assert held(again)
    again.manager.obstacle_reports.add("tractor 1", AWAY, "stone", again.now, 0)
    assert held(again), "what could not be read may have been told of just before"
    again.now += SETTLED_S
    acknowledge(again)
    assert not held(again)


def test_nobody_can_have_looked_at_what_was_told_of_just_now() -> None:
    """An alarm that was over is on again when somebody acknowledges it, or lets the tractor go on."""
    fleet = facing()
    fleet.manager.obstacle_reports.add("tractor 1", AWAY, "stone", fleet.now, 0)
    fleet.run(0.5)
    assert not held(fleet)
    fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
    fleet.run(0.5)
    fleet.manager.states[0].holds.add("paused")
    for order in (lambda: acknowledge(fleet), lambda: fleet.manager.operators.resume_tractors("anna", 0, fleet.now)):
        with pytest.raises(FleetManagerError, match="just reported an obstacle"):
            order()
    assert fleet.manager.states[0].holds == {Hold.UNREADABLE, "paused"}
    assert all(each.acknowledged is None for each in fleet.manager.alarms.list_alarms() if each.code == UNREADABLE_CODE)
    fleet.manager.obstacle_reports.add_unreadable(0, "It has 300 corners.", fleet.now)
    fleet.run(LOOK_DELAY_S)
    acknowledge(fleet)
    assert not held(fleet)


def test_an_acknowledgement_that_was_held_up_lets_nobody_go_on() -> None:
    fleet, first, _, operator = started()
    fleet.manager.alarms.raise_alarm("other", 0, "warning", "Something else.", 0.0)
    _handle_frame(fleet, first, BAD_FRAMES["two corners"])
    fleet.manager.states[0].faced_since_s = -math.inf  # long ago
    other, unread = (alarm.id for alarm in fleet.manager.alarms.list_alarms())
    old = datetime.now(UTC) - timedelta(seconds=2.5)
    fleet.carry_out(operator, AcknowledgeFrame(kind="acknowledge", alarm=other, time=old), 10.0)
    with pytest.raises(FleetManagerError, match=r"2\.5 s old and was ignored"):
        fleet.carry_out(operator, AcknowledgeFrame(kind="acknowledge", alarm=unread, time=old), 10.0)
    assert fleet.manager.states[0].holds == {Hold.UNREADABLE}
    fleet.carry_out(operator, AcknowledgeFrame(kind="acknowledge", alarm=unread, time=datetime.now(UTC)), 10.0)
    assert not fleet.manager.states[0].holds


@pytest.mark.parametrize(
    ("frame", "sentence"),
    [
        ({"kind": "obstacle", "polygon_m": CIRCLE}, "polygon_m has 300 entries; give at most 200."),
        ({"kind": "obstacle", "polygon_m": SQUARE[:2]}, "polygon_m has 2 entries; give at least 3."),
        ({"kind": "obstacle", "polygon_m": [["a", 0.0], *SQUARE]}, 'polygon_m.0.0 is "a"; give a number.'),
        ({"kind": "obstacle"}, "polygon_m is missing; give it."),
        ({"polygon_m": SQUARE}, "kind is missing; give the kind of this object."),
        ({"kind": "stone", "polygon_m": SQUARE}, "kind is \"stone\"; use 'state', 'obstacle' or 'disconnect'."),
        (NAMED | {"name": "a\x00b"}, 'name is "a\\u0000b", with characters that are not allowed; leave them out.'),
        (NAMED | {"a\x00b": 1}, "a\\u0000b is unknown; the API is documented at /api/v1/docs."),
        (NAMED | {"k" * 500: 1}, f"{'k' * 40} is unknown; the API is documented at /api/v1/docs."),
        (state(0, speed_mps=-1.0), "speed_mps is -1.0; use at least 0."),
        (state(0, time="now"), 'time is "now"; give a time with its zone, such as 2026-05-04T08:00:00Z.'),
        (state(0, shuttle=7), "shuttle is 7; use -1, 0 or 1."),
        (state(0, done="yes"), 'done is "yes"; give true or false.'),
    ],
)
def test_what_is_wrong_with_a_frame_is_one_sentence_with_value_rule_and_fix(
    frame: dict[str, Any], sentence: str
) -> None:
    fleet, first, _, _ = started()
    _handle_frame(fleet, first, json.dumps(frame))
    (refused,) = [told for told in waiting(first) if told["kind"] == "refused"]
    assert refused["sentence"] == f"The frame cannot be used: {sentence}"
    for alarm in fleet.manager.alarms.list_alarms():
        assert sentence in alarm.sentence and "\x00" not in alarm.sentence
