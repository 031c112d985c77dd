"""Tractors that drive again, obstacles that were passed or cannot be kept, and who stands where no plan has it."""

import math
from dataclasses import replace
from typing import Any

import pytest

from planner.fleet.manager.fleet_state import DONE, MOST_OBSTACLES, MOST_PER_REPORTER
from planner.fleet.manager.obstacle_reports import UNREADABLE_CODE
from planner.fleet.manager.remaining_work import check_proposal_still_fits, extract_remaining_work
from planner.fleet.model.rules import FleetManagerError
from planner.fleet.model.tractor_state import Hold, TractorReport
from planner.fleet.session.inbound_frames import StateFrame
from planner.fleet.session.state_recorder import MOST_SEQUENCES_AHEAD, StateRecorder
from tests.service.fleets import SimulatedFleet, start_fleet

NORTH = math.pi / 2


def ring(x: float, y: float, half_m: float = 0.5) -> tuple[tuple[float, float], ...]:
    """A square."""
    return tuple((x + a * half_m, y + b * half_m) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)))


def led(fleet: SimulatedFleet, x: float, y: float, heading: float = NORTH, leg: int = 0, leg_m: float = 0.0) -> None:
    """The first tractor is reported where its operator has led it, standing there."""
    fleet.silent = {0}
    report = TractorReport(x, y, heading, 0.0, mode="stopped", leg=leg, leg_m=leg_m)
    for _ in range(6):
        fleet.now += 0.1
        fleet.manager.take_report(0, report, fleet.now)
        fleet.manager.update_fleet(fleet.now)
        fleet.obey()


def test_a_tractor_that_has_failed_is_taken_back_and_goes_on_when_it_is_told_to() -> None:
    fleet = start_fleet()
    fleet.run(4)
    fleet.manager.operators.mark_failed("anna", 0, fleet.now)
    fleet.run(4)
    manager, state = fleet.manager, fleet.manager.states[0]
    before = fleet.at_m[0]
    assert state.holds == {Hold.FAILED} and any(a.code == "failed" and not a.over for a in manager.alarms.list_alarms())
    manager.operators.mark_repaired("bert", 0, fleet.now)
    fleet.run(3)
    assert state.holds == {Hold.REMOTE_CONTROL} and not state.failed and fleet.at_m[0] == before, (
        "it stands until it is resumed"
    )
    assert not any(a.code == "failed" and not a.over for a in manager.alarms.list_alarms())
    assert ("bert", "recover") in [(event.who, event.what) for event in fleet.events]
    led(fleet, 8.0, before, leg_m=before)
    with pytest.raises(FleetManagerError, match=r"8\.0 m off its leg"):
        manager.operators.resume_tractors("bert", 0, fleet.now)
    led(fleet, 0.0, before, leg_m=before)
    fleet.silent.clear()
    manager.operators.resume_tractors("bert", 0, fleet.now)
    fleet.run(60)
    assert state.done and manager.state == DONE
    with pytest.raises(FleetManagerError, match="has not failed"):
        manager.operators.mark_repaired("bert", 0, fleet.now)


def test_one_whose_tracks_were_given_away_is_driven_by_remote_control_alone_and_has_not_failed() -> None:
    fleet = start_fleet()
    fleet.run(4)
    manager, state = fleet.manager, fleet.manager.states[0]
    manager.operators.adopt_plan("anna", manager.plan, fleet.now, (0,))
    assert not state.failed and state.has_no_more_legs and state.standing_ordered and state.holds == {Hold.REASSIGNED}
    assert not [alarm for alarm in manager.alarms.list_alarms() if alarm.code == "failed"]
    manager.operators.mark_failed("anna", 0, fleet.now)
    manager.operators.mark_repaired("anna", 0, fleet.now)
    assert state.holds == {Hold.REASSIGNED, Hold.REMOTE_CONTROL}
    with pytest.raises(FleetManagerError, match="were given to others"):
        manager.operators.resume_tractors("anna", 0, fleet.now)
    at_m, released = fleet.at_m[0], state.base_end
    manager.operators.resume_tractors("anna", None, fleet.now)
    fleet.run(60)
    assert fleet.at_m[0] == at_m and state.base_end == released and Hold.REASSIGNED in state.holds
    assert manager.state == DONE, "the others are done, and it has nothing to do"
    manager.operators.take_lease("anna", 0, False, fleet.now)
    manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
    assert state.remote_command == (0.0, 0.5)


def test_who_was_led_past_an_obstacle_does_not_stand_for_it() -> None:
    fleet = start_fleet()
    fleet.run(5)
    manager, state = fleet.manager, fleet.manager.states[0]
    manager.obstacle_reports.add("anna", ring(0.0, 10.0), "stone", fleet.now)
    fleet.run(1)
    at_m = fleet.at_m[0]
    assert state.holds == {Hold.OBSTACLE}
    manager.operators.take_lease("anna", 0, False, fleet.now)
    manager.operators.return_lease("anna", 0, fleet.now)
    led(fleet, 0.0, 7.0, leg_m=at_m)
    assert Hold.OBSTACLE in state.holds, "it stands before it still"
    led(fleet, 5.0, 14.0, leg_m=at_m)
    assert Hold.OBSTACLE in state.holds, "beside its leg nobody knows where it goes on"
    led(fleet, 0.5, 14.0, leg_m=at_m)
    assert state.holds == {Hold.REMOTE_CONTROL}
    manager.operators.resume_tractors("anna", 0, fleet.now)
    fleet.obey()
    assert not fleet.standing[0]


def test_one_that_tells_of_very_many_obstacles_leaves_room_for_those_of_others() -> None:
    fleet = start_fleet()
    for number in range(MOST_PER_REPORTER):
        fleet.manager.obstacle_reports.add("tractor 1", ring(500.0 + 3.0 * number, 500.0), "stone", fleet.now, 0)
    with pytest.raises(FleetManagerError, match="Tractor 1 has reported 20 obstacles"):
        fleet.manager.obstacle_reports.add("tractor 1", ring(400.0, 500.0), "one more", fleet.now, 0)
    fleet.obey()
    assert fleet.standing == [True, False]
    assert fleet.manager.obstacle_reports.add("tractor 2", ring(20.0, 30.0), "deer", fleet.now, 1).name == "deer"


def test_a_tractor_that_sees_what_cannot_be_kept_stands() -> None:
    fleet = start_fleet()
    for number in range(MOST_OBSTACLES):
        who = f"anna {number % 10}"
        fleet.manager.obstacle_reports.add(who, ring(500.0 + 3.0 * number, 500.0), "stone", fleet.now)
    fleet.run(1)
    with pytest.raises(FleetManagerError, match="100 obstacles already"):
        fleet.manager.obstacle_reports.add("anna", ring(400.0, 500.0), "one more", fleet.now)
    fleet.obey()
    assert fleet.standing == [False, False], "what an operator draws is theirs to see to"
    with pytest.raises(FleetManagerError, match="100 obstacles already"):
        fleet.manager.obstacle_reports.add("tractor 1", ring(0.0, 10.0), "deer", fleet.now, 0)
    fleet.obey()
    assert fleet.standing == [True, False] and fleet.manager.states[0].holds == {Hold.UNREADABLE}
    assert "sees an obstacle that could not be read" in fleet.manager.alarms.list_alarms()[-1].sentence
    fleet.run(1)
    fleet.manager.operators.resume_tractors("anna", None, fleet.now)
    fleet.obey()
    assert fleet.standing == [True, False], "who lets all go on has not looked"
    fleet.manager.operators.resume_tractors("anna", 0, fleet.now)
    fleet.obey()
    assert fleet.standing == [False, False]
    assert all(a.over for a in fleet.manager.alarms.list_alarms() if a.code == UNREADABLE_CODE)


def test_no_plan_is_made_or_accepted_of_who_was_led_off_its_leg() -> None:
    fleet = start_fleet()
    fleet.run(4)
    manager = fleet.manager
    manager.plan = replace(manager.plan, field=object())  # type: ignore[arg-type]
    manager.take_report(1, manager.states[1].report._replace(speed_mps=0.0), fleet.now)
    rest = extract_remaining_work(manager, [1], fleet.now)
    manager.operators.take_lease("anna", 0, False, fleet.now)
    led(fleet, 6.0, 5.0, leg_m=4.0)
    with pytest.raises(FleetManagerError, match=r"Tractor 1 stands 6\.0 m off its leg"):
        check_proposal_still_fits(rest, manager)
    with pytest.raises(FleetManagerError, match="plan without it"):
        extract_remaining_work(manager, [1], fleet.now)
    led(fleet, 1.0, 5.0, leg_m=4.0)
    check_proposal_still_fits(rest, manager)
    assert extract_remaining_work(manager, [1], fleet.now).excluded == (1,)


def test_a_sequence_far_beyond_all_others_is_refused() -> None:
    recorder = StateRecorder("f", 1)
    recorder.add(0, [7])

    def state(sequence: int) -> Any:
        return StateFrame.model_construct(sequence=sequence)

    recorder.check_state_sequence(0, state(7 + MOST_SEQUENCES_AHEAD))
    with pytest.raises(FleetManagerError, match="too far ahead of the last, 7") as refused:
        recorder.check_state_sequence(0, state(8 + MOST_SEQUENCES_AHEAD))
    assert refused.value.parameter == "sequence" and recorder.received == [7]
