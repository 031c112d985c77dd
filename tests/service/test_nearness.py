"""Tractors that are too near stand until they are clear: nobody goes on and is stopped again and again."""

import math
from collections import Counter

import numpy as np
import pytest

from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import Hold, TractorReport
from tests.examples import seldom
from tests.service.fleets import EG105, SimulatedFleet, fleet_plan, restart_manager, start_fleet

NORTH = math.pi / 2
RULES = FleetRules()


def shaken(fleet: SimulatedFleet, noise_m: float) -> None:
    """Places that the tractors of a fleet report scatter from now on."""
    take, random = fleet.manager.take_report, np.random.default_rng(1)

    def reported(number: int, report: TractorReport, now: float, age_s: float = 0.0) -> None:
        dx, dy = noise_m * random.standard_normal(2)
        take(number, report._replace(x_m=report.x_m + dx, y_m=report.y_m + dy), now, age_s)

    fleet.manager.take_report = reported  # type: ignore[method-assign]


def told(fleet: SimulatedFleet) -> Counter[str]:
    """How often something happened."""
    return Counter(event.what for event in fleet.events)


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
@pytest.mark.parametrize("apart_m", [0.5, *seldom(2.0, 2.1, 2.3), 2.4])
def test_two_that_overlap_or_are_at_the_limit_are_stopped_once_and_stand(apart_m: float, noise_m: float) -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=apart_m))
    shaken(fleet, noise_m)
    fleet.run(60)
    manager = fleet.manager
    if noise_m == 0.0 and apart_m == 2.4:  # 0.36 m by the plan, 0.35 m are enough for two that drive by it
        assert not told(fleet)[Hold.TOO_NEAR] and fleet.at_m == [pytest.approx(60.0)] * 2
        return
    assert told(fleet)[Hold.TOO_NEAR] == 2 and not told(fleet)["goes on"]
    assert max(fleet.at_m) < 10.0
    (alarm,) = manager.alarms.list_alarms()
    assert "cannot resume by themselves" in alarm.sentence and not alarm.over
    manager.obstacle_reports.acknowledge_alarm("anna", alarm.id, fleet.now)
    fleet.run(30)
    assert [each.acknowledged for each in manager.alarms.list_alarms()] == ["anna"], "what was seen is not told anew"


def behind(gap_m: float) -> SimulatedFleet:
    """A tractor that stands so near behind another on the same legs that both were stopped for it."""
    fleet = start_fleet(fleet_plan(2, 3, apart_m=0.0))
    manager = fleet.manager
    fleet.at_m = [20.0 - 0.1, 5.0]  # leg 0 each
    for number in (0, 1):
        fleet.report(number, 0.0)
        manager.states[number].holds.add(Hold.TOO_NEAR)
    now_m = next(iter(pairs(fleet, far_m=50.0)))
    fleet.at_m[1] += now_m - gap_m
    fleet.report(1, 0.0)
    manager.send_stop_or_resume()
    fleet.obey()
    return fleet


def pairs(fleet: SimulatedFleet, far_m: float = 0.0) -> list[float]:
    """Metres between two that are close, or nearer than `far_m`."""
    guard = fleet.manager.guard
    before, guard.release_clearances_m = guard.release_clearances_m, (max(guard.release_clearances_m[0], far_m),) * 2
    found = guard.find_close_pairs(fleet.manager.states)
    guard.release_clearances_m = before
    return list(found.values())


@pytest.mark.parametrize("noise_m", [0.0, 0.02])
def test_who_is_nearer_than_it_may_be_parts_and_the_other_follows_when_there_is_room(noise_m: float) -> None:
    fleet = behind(0.3)
    assert pairs(fleet) == [pytest.approx(0.3)]
    shaken(fleet, noise_m)
    fleet.run(RULES.release_s - 0.3)
    assert not told(fleet)["goes on"], "a way must have been clear for a while"
    fleet.run(1.0)
    assert [event.data["tractor"] for event in fleet.events if event.what == "goes on"] == [1]
    fleet.run(25)
    goes = [event.data["tractor"] for event in fleet.events if event.what == "goes on"]
    assert goes == [1, 2] and not told(fleet)[Hold.TOO_NEAR] and min(fleet.at_m) > 25.0


def test_who_touches_another_does_not_go_on_by_itself() -> None:
    fleet = behind(0.02)
    fleet.run(20)
    assert not told(fleet)["goes on"] and all(Hold.TOO_NEAR in state.holds for state in fleet.manager.states)
    assert "cannot resume by themselves" in fleet.manager.alarms.list_alarms()[-1].sentence


def beside(gap_m: float) -> SimulatedFleet:
    """A tractor that stands because somebody else has parked another beside its way."""
    fleet = start_fleet(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(5)
    fleet.silent = {1}
    width_m = max(EG105.width_m, 2.0)
    for state in fleet.manager.states:
        state.holds.add(Hold.TOO_NEAR)
    fleet.manager.take_report(1, TractorReport(width_m + gap_m + 0.04, 12.0, NORTH, 0.0, mode="manual"), fleet.now)
    fleet.manager.send_stop_or_resume()
    fleet.obey()
    return fleet


@pytest.mark.parametrize(("gap_m", "goes"), [(0.45, False), (0.58, False), (0.8, True)])
def test_what_lets_go_on_is_farther_than_what_stops(gap_m: float, goes: bool) -> None:
    fleet = beside(gap_m)
    fleet.run(RULES.release_s + 1.0)
    assert (Hold.TOO_NEAR not in fleet.manager.states[0].holds) == goes
    fleet.run(1)
    assert (fleet.at_m[0] > 5.5) == goes


def test_an_alarm_is_over_when_two_have_been_apart_for_a_while() -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(1)
    fleet.silent = {1}
    begun, over = fleet.now, None
    for step in range(110):
        x = 2.3 if step % 10 < 5 and step < 40 else 8.0  # it comes and goes
        speed = 0.2 if step < 40 else 0.0
        fleet.manager.take_report(1, TractorReport(x, 2.0, NORTH, speed, speed, mode="manual"), fleet.now)
        fleet.run(0.1)
        near = [alarm for alarm in fleet.manager.alarms.list_alarms() if alarm.code == "near 2"]
        if near and near[0].over and over is None:
            over = fleet.now - begun
    sentences = [event.data["sentence"] for event in fleet.events if event.what == "alarm"]
    assert len(near) == 1 and sum(each.startswith("Tractors 1 and 2") for each in sentences) == 1
    assert over is not None and over >= 3.5 + RULES.release_s


def test_who_stands_clear_of_one_it_would_drive_into_is_told_of_as_long_as_it_stands() -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(2)
    fleet.silent = {1}
    for _ in range(300):  # parked across the way of the first
        fleet.manager.take_report(1, TractorReport(0.0, 14.0, 0.0, 0.0, mode="manual"), fleet.now)
        fleet.run(0.1)
    (alarm,) = [each for each in fleet.manager.alarms.list_alarms() if each.code == "near 2"]
    manager, (first, second) = fleet.manager, fleet.manager.states[:2]
    assert first.holds == {Hold.TOO_NEAR} and not alarm.over and "cannot resume by themselves" in alarm.sentence
    assert manager.guard.measure_distance_m(first, second) > manager.guard.release_clearances_m[0]
    for _ in range(60):
        fleet.manager.take_report(1, TractorReport(30.0, 14.0, 0.0, 0.0, mode="manual"), fleet.now)
        fleet.run(0.1)
    assert not fleet.manager.states[0].holds and fleet.manager.alarms.list_alarms()[0].over


def test_an_operator_leads_one_out_of_an_overlap_and_not_deeper_into_it() -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(5)
    fleet.silent = {0}
    fleet.manager.take_report(0, TractorReport(18.5, 5.0, NORTH, 0.0, mode="stopped", leg_m=5.0), fleet.now)
    fleet.run(0.5)
    fleet.manager.operators.take_lease("anna", 0, False, fleet.now)
    fleet.manager.take_report(0, TractorReport(17.5, 5.0, 0.0, 0.0, mode="remote", leg_m=5.0), fleet.now)
    with pytest.raises(FleetManagerError, match="too near another tractor"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
    fleet.manager.operators.send_command("anna", 0, 0.0, -0.5, fleet.now)
    assert Hold.REMOTE_CONTROL in fleet.manager.states[0].holds


def restarted(fleet: SimulatedFleet) -> None:
    """The service ends and begins anew; the tractors of the fleet are linked again, and let go on."""
    fleet.manager = restart_manager(fleet.manager, fleet.now, fleet.now)
    for number in range(fleet.manager.plan.tractor_count):
        fleet.manager.connect_tractor(number, fleet.now)
    fleet.manager.operators.resume_tractors("anna", None, fleet.now)


def test_two_that_touch_stand_after_a_restart_too_and_who_was_stopped_for_another_goes_on_once_it_is_clear() -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=0.5))
    fleet.run(30)
    stood_m = list(fleet.at_m)
    for _ in range(3):
        restarted(fleet)
        fleet.run(20)
    assert fleet.at_m == stood_m and all(Hold.TOO_NEAR in state.holds for state in fleet.manager.states)
    assert "cannot resume by themselves" in fleet.manager.alarms.list_alarms()[0].sentence
    fleet = behind(0.3)
    restarted(fleet)
    fleet.run(25)
    assert min(fleet.at_m) > 20.0 and not any(state.holds for state in fleet.manager.states)


def test_who_is_found_too_near_before_its_link_is_back_is_told_to_stand_with_the_link() -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=2.9))
    fleet.run(5)
    manager = fleet.manager
    for number, (x, heading) in enumerate(((0.0, NORTH - 0.4), (2.9, NORTH + 0.4))):  # towards each other
        manager.take_report(number, TractorReport(x, 5.0, heading, 1.0, 1.0, leg_m=5.0), fleet.now)
    again = restart_manager(manager, fleet.now, fleet.now)
    assert all(Hold.SERVICE_RESTARTED in state.holds for state in again.states)
    for state in again.states:  # by what the first tick sees
        state.holds.add(Hold.TOO_NEAR)
    again.update_fleet(fleet.now)
    again.take_outputs()
    again.connect_tractor(0, fleet.now)
    assert [order.kind for order in again.take_outputs()[0] if order.tractor == 0][-1] == "stop"


def test_who_was_let_part_is_stopped_again_once_it_was_apart() -> None:
    """Also from one beside which it stood without an alarm: that they came apart is seen all the same."""
    fleet = start_fleet(fleet_plan(3, 3, apart_m=20.0))
    fleet.manager.dangers.separation.start_parting(0, {(0, 2): 0.1})
    fleet.run(2)
    fleet.silent = {2}
    for step in range(30):  # a driver comes by, 0.2 m beside the way of the first
        fleet.manager.take_report(2, TractorReport(2.25, 14.0 - 0.1 * step, -NORTH, 1.0, 1.0, mode="manual"), fleet.now)
        fleet.run(0.1)
    assert Hold.TOO_NEAR in fleet.manager.states[0].holds and told(fleet)["alarm"]


def test_who_is_driven_by_hand_keeps_nobody_else_standing() -> None:
    """A driver takes the wheel of one that was stopped and drives it away: the other goes on meanwhile."""
    fleet = behind(0.3)
    fleet.silent = {0}
    for step in range(80):
        x = 0.1 * step
        fleet.manager.take_report(0, TractorReport(x, 20.0, 0.0, 1.0, 1.0, mode="manual", leg_m=20.0), fleet.now)
        fleet.run(0.1)
    assert fleet.manager.states[0].report is not None and Hold.TOO_NEAR not in fleet.manager.states[1].holds


@pytest.mark.parametrize("closed", [True, False])
def test_a_link_that_breaks_while_its_tractor_brakes_is_told_of_within_a_fleet_too(closed: bool) -> None:
    fleet = behind(0.3)
    report = fleet.manager.states[0].report
    assert report is not None
    fleet.manager.take_report(0, report._replace(speed_mps=0.4, mode="stopped"), fleet.now)
    fleet.silent = {0}
    if closed:
        fleet.manager.disconnect_tractor(0, fleet.now, False)
    fleet.run(25)
    assert all(Hold.TOO_NEAR in state.holds for state in fleet.manager.states) and not told(fleet)["goes on"]
    assert any("cannot resume by themselves" in alarm.sentence for alarm in fleet.manager.alarms.list_alarms())
