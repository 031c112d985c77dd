"""Tractors that drive again, obstacles that were passed or cannot be kept, and who stands where no plan has it."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import pytest

from planner.service.centre.core import DONE
from planner.service.centre.errors import CentreError
from planner.service.centre.obstacles import MOST
from planner.service.centre.remaining import check_still, rest_of
from planner.service.centre.seeing import UNREAD_CODE
from planner.service.centre.tractors import DRIVEN, FAILED, GIVEN, OBSTACLE, UNREAD, Report
from planner.service.errors import ServiceError
from planner.service.links.frames import State
from planner.service.links.recording import MOST_AHEAD, Recorder
from tests.service.fleets import Driven, driven

NORTH = math.pi / 2


def ring(x: float, y: float, half_m: float = 0.5) -> tuple[tuple[float, float], ...]:
    """A square."""
    return tuple((x + a * half_m, y + b * half_m) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)))


def led(fleet: Driven, x: float, y: float, heading: float = NORTH, leg: int = 0, leg_m: float = 0.0) -> None:
    """The first tractor is reported where its operator has led it, standing there."""
    fleet.silent = {0}
    report = Report(x, y, heading, 0.0, mode="stopped", leg=leg, leg_m=leg_m)
    for _ in range(6):
        fleet.now += 0.1
        fleet.centre.reported(0, report, fleet.now)
        fleet.centre.tick(fleet.now)
        fleet.obey()


def test_a_tractor_that_has_failed_is_taken_back_and_goes_on_when_it_is_told_to() -> None:
    fleet = driven()
    fleet.run(4)
    fleet.centre.fail("anna", 0, fleet.now)
    fleet.run(4)
    centre, state = fleet.centre, fleet.centre.states[0]
    before = fleet.at_m[0]
    assert state.holds == {FAILED} and any(a.code == "failed" and not a.over for a in centre.alarms.items())
    centre.repaired("bert", 0, fleet.now)
    fleet.run(3)
    assert state.holds == {DRIVEN} and not state.failed and fleet.at_m[0] == before, "it stands until it is resumed"
    assert not any(a.code == "failed" and not a.over for a in centre.alarms.items())
    assert ("bert", "repaired") in [(event.who, event.what) for event in fleet.events]
    centre.resume("bert", 0, fleet.now)
    fleet.run(60)
    assert state.done and centre.state == DONE
    with pytest.raises(CentreError, match="has not failed"):
        centre.repaired("bert", 0, fleet.now)


def test_one_that_was_towed_away_goes_on_only_from_its_leg() -> None:
    fleet = driven()
    fleet.run(4)
    fleet.centre.fail("anna", 0, fleet.now)
    led(fleet, 8.0, 5.0, leg_m=4.0)
    fleet.centre.repaired("anna", 0, fleet.now)
    with pytest.raises(CentreError, match=r"8\.0 m off its leg"):
        fleet.centre.resume("anna", 0, fleet.now)


def test_one_whose_tracks_were_given_away_is_driven_by_remote_control_alone() -> None:
    fleet = driven()
    fleet.run(4)
    centre, state = fleet.centre, fleet.centre.states[0]
    centre.adopt("anna", centre.plan, fleet.now, (0,))
    centre.repaired("anna", 0, fleet.now)
    assert state.holds == {GIVEN, DRIVEN}
    with pytest.raises(CentreError, match="were given to others"):
        centre.resume("anna", 0, fleet.now)
    at_m, released = fleet.at_m[0], state.released
    centre.resume("anna", None, fleet.now)
    fleet.run(60)
    assert fleet.at_m[0] == at_m and state.released == released and GIVEN in state.holds
    assert centre.state == DONE, "the others are done, and it has nothing to do"
    centre.lease("anna", 0, False, fleet.now)
    centre.command("anna", 0, 0.0, 0.5, fleet.now)
    assert state.remote_command == (0.0, 0.5)


def test_who_was_led_past_an_obstacle_does_not_stand_for_it() -> None:
    fleet = driven()
    fleet.run(5)
    centre, state = fleet.centre, fleet.centre.states[0]
    centre.obstacle("anna", ring(0.0, 10.0), "stone", fleet.now)
    fleet.run(1)
    at_m = fleet.at_m[0]
    assert state.holds == {OBSTACLE}
    centre.lease("anna", 0, False, fleet.now)
    centre.leave("anna", 0, fleet.now)
    led(fleet, 0.0, 7.0, leg_m=at_m)
    assert OBSTACLE in state.holds, "it stands before it still"
    led(fleet, 5.0, 14.0, leg_m=at_m)
    assert OBSTACLE in state.holds, "beside its leg nobody knows where it goes on"
    led(fleet, 0.5, 14.0, leg_m=at_m)
    assert state.holds == {DRIVEN}
    centre.resume("anna", 0, fleet.now)
    fleet.obey()
    assert not fleet.standing[0]


def test_a_tractor_that_sees_what_cannot_be_kept_stands() -> None:
    fleet = driven()
    for number in range(MOST):
        fleet.centre.obstacle("anna", ring(500.0 + 3.0 * number, 500.0), "stone", fleet.now)
    fleet.run(1)
    with pytest.raises(CentreError, match="100 obstacles already"):
        fleet.centre.obstacle("anna", ring(400.0, 500.0), "one more", fleet.now)
    fleet.obey()
    assert fleet.standing == [False, False], "what an operator draws is theirs to see to"
    with pytest.raises(CentreError, match="100 obstacles already"):
        fleet.centre.obstacle("tractor 1", ring(0.0, 10.0), "deer", fleet.now, 0)
    fleet.obey()
    assert fleet.standing == [True, False] and fleet.centre.states[0].holds == {UNREAD}
    assert "sees an obstacle that could not be taken" in fleet.centre.alarms.items()[-1].sentence
    fleet.run(1)
    fleet.centre.resume("anna", None, fleet.now)
    fleet.obey()
    assert fleet.standing == [True, False], "who lets all go on has not looked"
    fleet.centre.resume("anna", 0, fleet.now)
    fleet.obey()
    assert fleet.standing == [False, False]
    assert all(a.over for a in fleet.centre.alarms.items() if a.code == UNREAD_CODE)


def test_no_plan_is_made_or_accepted_of_who_was_led_off_its_leg() -> None:
    fleet = driven()
    fleet.run(4)
    centre = fleet.centre
    centre.plan = replace(centre.plan, field=object())  # type: ignore[arg-type]
    rest = rest_of(centre, [1], fleet.now)
    centre.lease("anna", 0, False, fleet.now)
    led(fleet, 6.0, 5.0, leg_m=4.0)
    with pytest.raises(CentreError, match=r"Tractor 1 stands 6\.0 m off its leg"):
        check_still(rest, centre)
    with pytest.raises(CentreError, match="plan without it"):
        rest_of(centre, [1], fleet.now)
    led(fleet, 1.0, 5.0, leg_m=4.0)
    check_still(rest, centre)
    assert rest_of(centre, [1], fleet.now).without == (1,)


def test_a_sequence_far_beyond_all_others_is_refused() -> None:
    recorder = Recorder("f", 1)
    recorder.add(0, [7])

    def state(sequence: int) -> Any:
        return State.model_construct(sequence=sequence)

    recorder.check(0, state(7 + MOST_AHEAD))
    with pytest.raises(ServiceError, match="too far ahead of the last, 7") as refused:
        recorder.check(0, state(8 + MOST_AHEAD))
    assert refused.value.parameter == "sequence" and recorder.seen == [7]
