"""Fleets that come in and go out by one entrance: machines that wait there are in the way of others."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.neighbourhood import Neighbourhood
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.timed_mission import TimedMission
from planner.fleet.model.tractor_state import Hold, TractorReport
from tests.examples import seldom
from tests.service.fleets import SPEED, SimulatedFleet
from tests.service.test_neighbours import NORTH, RULES, Ground, alarms, lane
from vehicle.missions.plan import ENTER, LEAVE, SWATH, Leg, LegGate, LegTask, Mission, Plan

IN_AND_OUT = ((0.0, 30.0), (0.0, 60.0), (20.0, 60.0))


def through_entrance(plan: FleetPlan, *, first: str = ENTER, last: str = LEAVE) -> FleetPlan:
    """A plan whose first and last legs lead in and out."""
    legs = list(plan.timed_missions[0].legs)
    legs[-1] = replace(legs[-1], task=LegTask(last, len(legs) - 1))
    legs[0] = replace(legs[0], task=LegTask(first, 0))
    mission = Mission(tuple(legs))
    course = TimedMission(mission, plan.timed_missions[0].leg_seconds)
    return replace(plan, saved=replace(plan.saved, plan=Plan((mission,))), timed_missions=(course,))


def test_one_that_waits_at_its_entrance_is_a_machine_in_the_way_of_another_fleet() -> None:
    ground = Ground(through_entrance(lane(*IN_AND_OUT)), lane(*NORTH))
    waits, drives = ground.fleets
    drives.manager.operators.start_fleet_work("bert", 0.0)
    assert ground.run(60) >= RULES.clearance_m
    assert drives.speed == 0.0 and 15.0 < drives.at_m < 30.0
    assert "tractor 1 of fleet 'a' stand" in alarms(drives)[0] and "fleet 'b'" in alarms(waits)[0]
    waits.manager.operators.start_fleet_work("anna", ground.now)
    assert ground.run(90) >= RULES.clearance_m
    assert waits.at_m == pytest.approx(50.0), "who drives away from it does so at once"
    assert drives.at_m == pytest.approx(60.0) or drives.speed == 0.0


def test_one_that_has_gone_out_stands_where_it_went() -> None:
    ground = Ground(through_entrance(lane((-20.0, 0.0), (-20.0, 30.0), (0.0, 30.0))), lane(*NORTH))
    gone, drives = ground.fleets
    gone.manager.operators.start_fleet_work("anna", 0.0)
    ground.run(60)
    assert gone.manager.states[0].done
    gone.manager.disconnect_tractor(0, ground.now, True)
    gone.is_linked = False
    drives.manager.operators.start_fleet_work("bert", ground.now)
    assert ground.run(60) >= RULES.clearance_m
    assert drives.speed == 0.0 and "delete fleet 'a' if it is no longer there" in alarms(drives)[-1]


def test_one_steered_by_hand_before_it_comes_in_is_kept_clear_of_where_it_is() -> None:
    ground = Ground(through_entrance(lane((100.0, 0.0), (100.0, 60.0))), lane((60.0, 0.0), (0.0, 0.0)))
    steered, drives = ground.fleets
    steered.is_linked = False  # it says itself where it is
    drives.manager.operators.start_fleet_work("bert", 0.0)
    for _ in range(600):
        steered.manager.take_report(0, TractorReport(30.0, 0.0, math.pi, 0.0, mode="manual"), ground.now)
        ground.run(0.1)
    assert drives.speed == 0.0 and 15.0 < drives.at_m < 30.0 - RULES.clearance_m
    assert Hold.TOO_NEAR in drives.manager.states[0].holds


@pytest.mark.parametrize("both_at_once", [True, False])
@pytest.mark.parametrize("turn", [*seldom(0.0), 40.0])
def test_two_fleets_that_begin_at_one_entrance_go_one_after_the_other(both_at_once: bool, turn: float) -> None:
    plans = [through_entrance(lane((0.0, 0.0), (0.0, 20.0), (side, 50.0))) for side in (-turn, turn)]
    ground = Ground(*plans)
    one, other = ground.fleets
    one.manager.operators.start_fleet_work("anna", 0.0)
    if both_at_once:
        other.manager.operators.start_fleet_work("bert", 0.0)
    ground.run(10)
    assert one.at_m > 4.0 and other.at_m < 0.5
    assert not alarms(one) + alarms(other), "to drive away from one that stands is no danger"
    if not both_at_once:
        other.manager.operators.start_fleet_work("bert", ground.now)
    apart = []
    for _ in range(1000):
        ground.run(0.1)
        apart.append(ground.apart_m())
    assert min(apart[next(k for k, metres in enumerate(apart) if metres >= RULES.clearance_m) :]) >= RULES.clearance_m
    assert one.at_m == pytest.approx(one.manager.plan.timed_missions[0].leg_starts_m[-1])
    if turn:
        assert other.at_m == pytest.approx(other.manager.plan.timed_missions[0].leg_starts_m[-1])
        assert not alarms(one) + alarms(other)


def two_from_one_entrance(side: float) -> FleetPlan:
    """Two tractors of a fleet wait at one place; the second comes in once the first is round the corner."""
    missions = []
    for number, end in enumerate(((side, 40.0), (2.0 * side, 20.0))):
        ends = ((0.0, 0.0), (0.0, 20.0), (side, 20.0), end)
        legs = [
            Leg(np.array(pair), SPEED, implement=True, task=LegTask(SWATH if k else ENTER, number))
            for k, pair in enumerate(pairwise(ends))
        ]
        legs[0] = replace(legs[0], gates=(LegGate(0, 1, 5.0),) if number else ())
        missions.append(Mission(tuple(legs)))
    courses = tuple(TimedMission(mission, (20.0 / SPEED,) * 3) for mission in missions)
    plan = lane((0.0, 0.0), (0.0, 20.0))
    saved, finish_s = replace(plan.saved, plan=Plan(tuple(missions))), (60.0, 60.0)
    return replace(plan, saved=saved, timed_missions=courses, min_clearance_m=0.0, finish_s=finish_s)


@pytest.mark.parametrize("first_started", ["a", *seldom("b"), "both"])
def test_two_queues_at_one_entrance_come_in_one_after_the_other(first_started: str) -> None:
    hood, fleets = Neighbourhood(), {}
    for name, side in (("a", -20.0), ("b", 20.0)):
        fleet = fleets[name] = SimulatedFleet(FleetManager(two_from_one_entrance(side), RULES))
        hood.add(name, name, fleet.manager, lambda: None, 0.0)
    begins: dict[tuple[str, int], float] = {}
    for step in range(2000):
        for name, fleet in fleets.items():
            if step == (0 if first_started in (name, "both") else 200):
                fleet.manager.operators.start_fleet_work("anna", fleet.now)
            fleet.run(0.1)
            begins |= {(name, n): fleet.now for n in (0, 1) if fleet.at_m[n] > 0.0 and (name, n) not in begins}
    order = sorted(begins, key=lambda each: begins[each])
    assert order[0] == ("b" if first_started == "b" else "a", 0) and len(order) == 4
    times = sorted(begins.values())
    assert min(later - before for before, later in pairwise(times)) > 5.0, "the one before has driven its own length"
    for fleet in fleets.values():
        assert fleet.at_m == [pytest.approx(60.0)] * 2
        assert all(alarm.over for alarm in fleet.manager.alarms.list_alarms())


def test_two_that_begin_to_drive_from_one_entrance_at_once_stand_and_then_go_one_after_the_other() -> None:
    """As when both are let go on at the same time by their operators."""
    plans = [through_entrance(lane((0.0, 0.0), (0.0, 20.0), (side, 50.0))) for side in (-20.0, 20.0)]
    ground = Ground(*plans)
    for fleet in ground.fleets:
        fleet.manager.operators.pause_tractors("anna", None, 0.0)
    ground.start()
    for fleet in ground.fleets:
        fleet.manager.states[0].base_end = 1
        fleet.manager.operators.resume_tractors("anna", None, 0.0)
    ground.run(2)
    assert all(Hold.TOO_NEAR in fleet.manager.states[0].holds for fleet in ground.fleets)
    ground.run(100)
    for fleet in ground.fleets:
        assert fleet.at_m == pytest.approx(fleet.manager.plan.timed_missions[0].leg_starts_m[-1])
        assert all(alarm.over for alarm in fleet.manager.alarms.list_alarms())


def test_the_fleet_added_later_drives_away_from_one_that_is_not_started() -> None:
    ground = Ground(*(through_entrance(lane((0.0, 0.0), (0.0, 20.0), (side, 50.0))) for side in (-20.0, 20.0)))
    waits, goes = ground.fleets
    goes.manager.operators.start_fleet_work("bert", 0.0)
    ground.run(80)
    assert waits.at_m == 0.0 and goes.at_m == pytest.approx(goes.manager.plan.timed_missions[0].leg_starts_m[-1])
    assert not alarms(waits) + alarms(goes)


def test_nobody_drives_into_one_that_stands_at_its_entrance_out_of_an_overlap() -> None:
    """The machines overlap by what they report, and the way of the second leads on over the first."""
    ground = Ground(through_entrance(lane((0.0, 2.0), (0.0, 60.0))), through_entrance(lane((0.0, 0.0), (0.0, 60.0))))
    other = ground.fleets[1]
    other.manager.operators.start_fleet_work("bert", 0.0)
    ground.run(40)
    assert other.at_m < 1.0 and Hold.TOO_NEAR in other.manager.states[0].holds
    assert "cannot resume by themselves" in alarms(other)[0]
