"""What comes late: orders, beats, states and acceptances that were held up on their way, and clocks that are set."""

import asyncio
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.fleet_state import RUNNING, STOPPED
from planner.fleet.manager.obstacle_reports import LOOK_DELAY_S
from planner.fleet.manager.remaining_work import RemainingWork, check_proposal_still_fits
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import TractorReport
from planner.fleet.session.fleet_twins import LEAP_DELAY_S, FleetTwins
from planner.fleet.session.inbound_frames import ResumeFrame, StartFrame, StateFrame, StopAllFrame, TakeLeaseFrame
from planner.fleet.simulated_robot import RobotDriver
from tests.service.fleets import fleet_plan, start_fleet, state
from tests.service.test_robot import let, release, robot
from tests.service.test_safety import drive, live, waiting


def test_nobody_lets_go_on_what_somebody_else_has_just_stopped() -> None:
    fleet = start_fleet()
    fleet.manager.operators.stop_all("anna", 10.0)
    for order in (
        fleet.manager.operators.start_fleet_work,
        lambda who, now: fleet.manager.operators.resume_tractors(who, None, now),
    ):
        with pytest.raises(FleetManagerError, match="just stopped by anna"):
            order("bert", 10.0 + 0.9 * LOOK_DELAY_S)
    assert fleet.manager.state == STOPPED
    fleet.manager.operators.resume_tractors("bert", None, 10.0 + LOOK_DELAY_S)
    assert fleet.manager.state == RUNNING
    fleet.manager.operators.pause_tractors("anna", 1, 20.0)
    fleet.manager.operators.resume_tractors("bert", 0, 20.1)  # another tractor
    with pytest.raises(FleetManagerError, match="Tractor 2 was just stopped by anna"):
        fleet.manager.operators.resume_tractors("bert", 1, 20.1)
    fleet.manager.operators.resume_tractors("anna", 1, 20.1)  # who stopped it knows


@pytest.mark.parametrize(
    "order", [StartFrame(kind="start"), ResumeFrame(kind="resume"), ResumeFrame(kind="resume", tractor=1)]
)
def test_an_order_to_go_on_that_was_held_up_is_not_carried_out(order: StartFrame | ResumeFrame) -> None:
    fleet, _, operator = live()
    fleet.carry_out(operator, StopAllFrame(kind="stop_all"), 0.0)
    old = datetime.now(UTC) - timedelta(seconds=2.5)
    with pytest.raises(FleetManagerError, match=r"2\.5 s old and was ignored"):
        fleet.carry_out(operator, order.model_copy(update={"time": old}), 10.0)
    assert all(state.holds for state in fleet.manager.states)
    fleet.carry_out(operator, order.model_copy(update={"time": datetime.now(UTC)}), 10.0)
    assert not fleet.manager.states[0].holds


def test_whose_fleet_is_deleted_is_told_to_stand_and_nothing_else() -> None:
    fleet, tractor, operator = live()
    fleet.carry_out(operator, StartFrame(kind="start"), 0.0)
    fleet.close("This fleet was deleted.", 1.0)
    assert tractor.outbox.ended and not fleet.clients and not fleet.tractors
    assert json.loads(asyncio.run(tractor.outbox.take_next_frame()) or "")["kind"] == "stop"
    assert asyncio.run(tractor.outbox.take_next_frame()) is None


def test_who_creeps_stands_and_nobody_is_driven_of_whom_nobody_knows_where_it_is() -> None:
    fleet, tractor, operator = live()
    fleet.carry_out(operator, TakeLeaseFrame(kind="lease", tractor=1), 0.0)
    with pytest.raises(FleetManagerError, match="its present place is unknown"):
        fleet.carry_out(operator, drive(1), 0.5)  # it is linked, and has not reported
    fleet.manager.take_report(0, TractorReport(0.0, 10.0, math.pi / 2, 0.0, mode="remote"), 0.5)
    waiting(tractor)
    fleet.carry_out(operator, drive(2, speed=0.049), 0.5)
    assert waiting(tractor)[-1]["speed_command_mps"] == 0.0, "the guard does not look at one that creeps"


def test_states_that_waited_for_a_link_are_no_sign_of_where_a_tractor_is_now() -> None:
    fleet = start_fleet()
    fleet.run(5)
    report = fleet.manager.states[0].report
    assert report is not None
    fleet.manager.connect_tractor(0, 100.0)
    fleet.manager.take_report(0, report._replace(mode="remote"), 100.2, age_s=60.0)
    state = fleet.manager.states[0]
    assert state.last_fix_s == pytest.approx(40.2) and state.get_connection(101.1, 1.0) == "broken"
    assert fleet.manager.alarms.is_alarm_on("late", 0)
    fleet.manager.operators.take_lease("anna", 0, False, 100.3)
    with pytest.raises(FleetManagerError, match="its present place is unknown"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, 100.4)
    fleet.manager.take_report(0, report._replace(mode="remote"), 100.5)
    fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, 100.5)
    assert not fleet.manager.alarms.is_alarm_on("late", 0) and state.get_connection(101.1, 1.0) == "online"


def beats(driver: RobotDriver, begin: float, seconds: float, late_s: float) -> float:
    """Time passes with beats that come so late; the speed at its end."""
    speed = 0.0
    for tenth in range(round(10 * seconds)):
        now = begin + 0.1 * tenth
        driver.handle_frame({"kind": "heartbeat", "time": "", "clock_s": now + 5000.0 - late_s}, now)
        speed = float(str(driver.step(now)["speed_mps"]))
    return speed


def test_beats_that_are_held_up_are_silence_and_late_commands_move_nobody() -> None:
    driver, still = robot(), pytest.approx(0.0, abs=0.02)
    command = {"kind": "command", "steering_command_deg": 0.0, "speed_command_mps": 1.0}
    driver.handle_frame(command, 0.0)
    assert beats(driver, 0.0, 5.0, 0.1) > 0.9
    assert beats(driver, 5.0, 5.0, 1.5) == still
    driver.handle_frame(command, 10.0)
    assert beats(driver, 10.0, 3.0, 1.5) == still
    assert beats(driver, 13.0, 3.0, 0.1) == still  # it is told anew, or it stands
    driver.handle_frame(command, 16.0)
    assert beats(driver, 16.0, 5.0, 0.1) > 0.9


def test_an_order_to_go_on_that_comes_late_waits_for_a_link_that_is_in_time() -> None:
    driver = robot()
    assert beats(driver, 0.0, 2.0, 0.1) == 0.0
    assert beats(driver, 2.0, 2.0, 3.0) == 0.0
    release(driver, 3, 4.0)
    assert beats(driver, 4.0, 3.0, 3.0) == pytest.approx(0.0, abs=0.02)
    assert beats(driver, 7.0, 5.0, 0.1) > 0.5
    assert beats(driver, 12.0, 2.0, 3.0) > 0.5  # it ends its released legs
    driver.handle_frame({"kind": "stop", "reason": "late or not"}, 14.0)
    assert beats(driver, 14.0, 4.0, 3.0) == pytest.approx(0.0, abs=0.02)
    assert beats(driver, 18.0, 3.0, 0.1) == pytest.approx(0.0, abs=0.02)


def test_clocks_that_run_a_little_unlike_are_no_silence_and_states_are_dated_by_one_that_was_set() -> None:
    driver = robot()
    release(driver, 3, 0.0)
    for second in range(0, 20000, 20):  # of a clock that loses half a millisecond a second: ten seconds in all
        now = float(second)
        driver.handle_frame({"kind": "heartbeat", "time": "", "clock_s": now * (1.0 - 5e-4)}, now)
        assert driver._late_s < 0.1
    driver = robot()
    at = datetime.fromisoformat(str(let(driver, 0.0, 0.2)["time"])).timestamp()
    for now, set_s, told_s in ((0.3, 0.2, 0.2), (0.4, 3600.0, 3600.0)):
        driver.set_clock(at + set_s, now)
        assert datetime.fromisoformat(str(driver.step(now)["time"])).timestamp() == pytest.approx(at + told_s, abs=0.01)


@pytest.fixture
def twins() -> Iterator[tuple[FleetTwins, FleetManager]]:
    plan = fleet_plan(2)
    yield FleetTwins(plan, "predict", 1.0, 1.9e9), FleetManager(plan, FleetRules())


@pytest.mark.parametrize("jump_s", [-3600.0, -20.0, 30.0, 30 * 86400.0])
def test_a_clock_of_the_service_that_is_set_neither_stops_twins_nor_lets_them_race(
    twins: tuple[FleetTwins, FleetManager], jump_s: float
) -> None:
    made, manager = twins

    def reported(clock_s: float, sequence: int) -> None:
        at = datetime.fromtimestamp(clock_s, UTC).isoformat()
        made.take_state(0, StateFrame.model_validate_json(json.dumps(state(sequence, time=at))), clock_s, clock_s)

    clock_s = 1.9e9 + 7200.0
    for tenth in range(20):
        reported(clock_s + 0.1 * tenth, tenth)
        made.advance(0.1 * tenth, clock_s + 0.1 * tenth, manager)
    assert made.items[0] is not None
    clock_s += jump_s
    made.advance(2.0, clock_s + 2.0, manager)
    assert made.items[0] is None  # what it says would be of another time
    reported(clock_s + 2.1, 21)
    made.advance(2.2, clock_s + 2.2, manager)
    assert made.items[0].state.time_s == pytest.approx(made.compute_time_s(clock_s + 2.2), abs=0.02)


def test_a_position_that_leaps_is_told_as_that_and_the_twin_is_not_doubted(
    twins: tuple[FleetTwins, FleetManager],
) -> None:
    made, manager = twins
    sentences, on = [], []
    for tenth in range(900):
        clock_s = 1.9e9 + 0.1 * tenth
        at = datetime.fromtimestamp(clock_s, UTC).isoformat()
        east = 1000.0 if tenth < 100 else 1000.4
        frame = StateFrame.model_validate_json(json.dumps(state(tenth, time=at, easting_m=east)))
        made.take_state(0, frame, clock_s, clock_s)
        made.advance(0.1 * tenth, clock_s, manager)
        alarms = manager.alarms.list_alarms()
        sentences += [alarm.sentence for alarm in alarms if alarm.sentence not in sentences]
        on.append(manager.alarms.is_alarm_on("leap", 0))
    assert len(sentences) == 1 and "position of tractor 1 jumped by 0.40 m" in sentences[0]
    assert on.index(True) == pytest.approx(100 + 10 * LEAP_DELAY_S, abs=11) and not on[-1]
    assert made.items[0] is not None and made.items[0].find_mismatch() is None


def test_a_plan_of_the_rest_is_driven_only_while_what_it_was_made_of_holds() -> None:
    fleet = start_fleet(fleet_plan(3))
    fleet.run(5)

    def remaining(*without: int) -> RemainingWork:
        states = tuple(replace(state) for state in fleet.manager.states)
        return RemainingWork(fleet.manager.plan, states, without, (), 0.0, 1.0)

    fleet.manager.operators.mark_failed("anna", 1, fleet.now)
    asked = remaining(1)
    fleet.run(3)
    check_proposal_still_fits(asked, fleet.manager)
    fleet.manager.operators.mark_failed("anna", 2, fleet.now)
    with pytest.raises(FleetManagerError, match="Tractor 3 has failed since"):
        check_proposal_still_fits(asked, fleet.manager)
    asked = remaining(1, 2)
    there = fleet.manager.states[1].report
    assert there is not None
    fleet.manager.take_report(1, there._replace(y_m=there.y_m + 6.0, speed_mps=0.0), fleet.now)  # it was towed away
    with pytest.raises(FleetManagerError, match=r"Tractor 2 has moved 6\.0 m"):
        check_proposal_still_fits(asked, fleet.manager)
    asked = remaining(1, 2)
    fleet.manager.operators.adopt_plan("anna", replace(fleet.manager.plan), fleet.now)
    with pytest.raises(FleetManagerError, match="Another plan was accepted"):
        check_proposal_still_fits(asked, fleet.manager)


def test_an_alarm_that_comes_and_goes_unseen_is_one_and_an_obstacle_seen_again_is_none() -> None:
    fleet = start_fleet()
    for _ in range(20):
        fleet.manager.disconnect_tractor(0, fleet.now, False)
        fleet.manager.connect_tractor(0, fleet.now)
    assert [alarm.code for alarm in fleet.manager.alarms.list_alarms()] == ["broken"]
    fleet.manager.obstacle_reports.acknowledge_alarm("anna", 1, fleet.now)
    fleet.manager.disconnect_tractor(0, fleet.now, False)
    assert [alarm.acknowledged for alarm in fleet.manager.alarms.list_alarms()] == [None]
    for k in range(200):
        x = 0.002 * k
        fleet.manager.obstacle_reports.add("tractor 1", ((x, 50.0), (x + 1, 50.0), (x + 1, 51.0)), "stone", fleet.now)
    assert len(fleet.manager.obstacles.items) == 1
    fleet.manager.obstacle_reports.add("tractor 2", ((0.0, 50.0), (1.0, 50.0), (1.0, 51.0)), "stone", fleet.now)
    assert len(fleet.manager.obstacles.items) == 2
