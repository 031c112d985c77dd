"""Robots that lie in ways that no single field holds: one that creeps, one that leaves, one that says it is done."""

import math

import numpy as np
import pytest

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.alarms import CRITICAL
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import AUTOMATIC, STOPPED, Hold, TractorReport
from tests.service.fleets import fleet_plan

NORTH_RAD = 0.5 * math.pi


def start_manager() -> FleetManager:
    """A fleet of one that drives."""
    manager = FleetManager(fleet_plan(1, 10), FleetRules())
    manager.connect_tractor(0, 0.0)
    manager.operators.start_fleet_work("anna", 0.0)
    return manager


def find_alarm(manager: FleetManager, code: str) -> str | None:
    """The level of an alarm that is on."""
    alarm = manager.alarms.find_alarm_on(code, 0)
    return None if alarm is None else alarm.level


def creep(manager: FleetManager, speed_mps: float, told_mps: float, seconds: float) -> float | None:
    """Stop all; the robot goes on so slowly, and says so or not: the metres after which it drives on.

    Every half a minute it tells a little more.
    """
    manager.operators.stop_all("anna", 0.0)
    for number in range(round(10.0 * seconds)):
        now = 0.1 * number
        told = told_mps + 0.02 * (number % 300 == 150)
        report = TractorReport(0.0, speed_mps * now, NORTH_RAD, told, mode=STOPPED, time_s=now)
        manager.take_report(0, report, now)
        manager.update_fleet(now)
        if find_alarm(manager, "drives on") == CRITICAL:
            return speed_mps * now
    return None


@pytest.mark.parametrize("told_mps", [0.04, 0.0])
def test_who_creeps_slower_than_a_speed_that_counts_is_noticed_by_how_far_it_is(told_mps: float) -> None:
    manager = start_manager()
    crept_m = creep(manager, 0.04, told_mps, 180.0)
    assert crept_m is not None and crept_m < 5.5
    assert Hold.DOUBTED in manager.states[0].holds


@pytest.mark.slow
def test_who_stands_with_a_poor_receiver_does_not_drive_on() -> None:
    manager, rng, error = start_manager(), np.random.default_rng(0), np.zeros(2)
    manager.operators.stop_all("anna", 0.0)
    for number in range(18_000):
        now = 0.1 * number
        error = 0.9983 * error + rng.normal(0.0, 0.5 * math.sqrt(1.0 - 0.9983**2), 2)  # half a metre per axis, a minute
        report = TractorReport(error[0], error[1], NORTH_RAD, abs(rng.normal(0.0, 0.01)), mode=STOPPED, time_s=now)
        manager.take_report(0, report, now)
        manager.update_fleet(now)
    assert manager.alarms.list_alarms() == []


def test_who_leaves_in_good_order_while_it_moves_is_no_better_than_one_whose_link_broke() -> None:
    report = TractorReport(0.0, 5.0, NORTH_RAD, 1.0, 1.0, mode=AUTOMATIC, leg=0, leg_m=5.0, time_s=0.0)
    for moving in (True, False):
        manager = start_manager()
        manager.take_report(0, report if moving else report._replace(speed_mps=0.0), 0.1)
        manager.disconnect_tractor(0, 0.2, is_orderly=True)
        assert find_alarm(manager, "broken") == (CRITICAL if moving else None)


def test_who_says_that_it_is_done_and_drives_is_expected_where_it_drives() -> None:
    manager = start_manager()
    state = manager.states[0]
    state.done = True
    state.report = TractorReport(0.0, 200.0, NORTH_RAD, 2.0, 2.0, mode=AUTOMATIC, leg=9, leg_m=20.0, done=True)
    (path,) = manager.guard.predict_paths(manager.states)
    assert path[-1, 1] - path[0, 1] == pytest.approx(10.0)
    state.report = state.report._replace(speed_mps=0.0)
    (path,) = manager.guard.predict_paths(manager.states)
    assert np.ptp(path[:, 1]) == 0.0
