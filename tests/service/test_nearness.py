"""Tractors that are too near stand until they are clear: nobody goes on and is stopped again and again."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from planner.service.centre.centre import Centre
from planner.service.centre.errors import CentreError
from planner.service.centre.progress import progress_of, restore
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import DRIVEN, NEAR, Report
from tests.service.fleets import EG105, Driven, driven, fleet_plan

NORTH = math.pi / 2
RULES = Rules()


def shaken(fleet: Driven, noise_m: float) -> None:
    """Places that the tractors of a fleet report scatter from now on."""
    take, random = fleet.centre.reported, np.random.default_rng(1)

    def reported(number: int, report: Report, now: float, age_s: float = 0.0) -> None:
        dx, dy = noise_m * random.standard_normal(2)
        take(number, replace(report, x_m=report.x_m + dx, y_m=report.y_m + dy), now, age_s)

    fleet.centre.reported = reported  # type: ignore[method-assign]


def told(fleet: Driven) -> Counter[str]:
    """How often something happened."""
    return Counter(event.what for event in fleet.events)


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
@pytest.mark.parametrize("apart_m", [0.5, 2.0, 2.1, 2.3, 2.4])
def test_two_that_overlap_or_are_at_the_limit_are_stopped_once_and_stand(apart_m: float, noise_m: float) -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=apart_m))
    shaken(fleet, noise_m)
    fleet.run(60)
    centre = fleet.centre
    if noise_m == 0.0 and apart_m == 2.4:  # 0.36 m by the plan, 0.35 m are enough for two that drive by it
        assert not told(fleet)[NEAR] and fleet.at_m == [pytest.approx(60.0)] * 2
        return
    assert told(fleet)[NEAR] == 2 and not told(fleet)["goes on"]
    assert max(fleet.at_m) < 10.0
    (alarm,) = centre.alarms.items()
    assert "no way on is clear" in alarm.sentence and not alarm.over
    centre.acknowledge("anna", alarm.id, fleet.now)
    fleet.run(30)
    assert [each.acknowledged for each in centre.alarms.items()] == ["anna"], "what was seen is not told anew"


def behind(gap_m: float) -> Driven:
    """A tractor that stands so near behind another on the same legs that both were stopped for it."""
    fleet = driven(fleet_plan(2, 3, apart_m=0.0))
    centre = fleet.centre
    fleet.at_m = [20.0 - 0.1, 5.0]  # leg 0 each
    for number in (0, 1):
        fleet.report(number, 0.0)
        centre.states[number].holds.add(NEAR)
    now_m = next(iter(pairs(fleet, far_m=50.0)))
    fleet.at_m[1] += now_m - gap_m
    fleet.report(1, 0.0)
    centre._settle()
    fleet.obey()
    return fleet


def pairs(fleet: Driven, far_m: float = 0.0) -> list[float]:
    """Metres between two that are close, or nearer than `far_m`."""
    guard = fleet.centre.guard
    before, guard.release = guard.release, (max(guard.release[0], far_m),) * 2
    found = guard.close(fleet.centre.states, fleet.centre.courses)
    guard.release = before
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
    assert goes == [1, 2] and not told(fleet)[NEAR] and min(fleet.at_m) > 25.0


def test_who_touches_another_does_not_go_on_by_itself() -> None:
    fleet = behind(0.02)
    fleet.run(20)
    assert not told(fleet)["goes on"] and all(NEAR in state.holds for state in fleet.centre.states)
    assert "no way on is clear" in fleet.centre.alarms.items()[-1].sentence


def beside(gap_m: float) -> Driven:
    """A tractor that stands because somebody else has parked another beside its way."""
    fleet = driven(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(5)
    fleet.silent = {1}
    width_m = max(EG105.width_m, 2.0)
    for state in fleet.centre.states:
        state.holds.add(NEAR)
    fleet.centre.reported(1, Report(width_m + gap_m + 0.04, 12.0, NORTH, 0.0, mode="manual"), fleet.now)
    fleet.centre._settle()
    fleet.obey()
    return fleet


@pytest.mark.parametrize(("gap_m", "goes"), [(0.45, False), (0.58, False), (0.8, True)])
def test_what_lets_go_on_is_farther_than_what_stops(gap_m: float, goes: bool) -> None:
    fleet = beside(gap_m)
    fleet.run(RULES.release_s + 1.0)
    assert (NEAR not in fleet.centre.states[0].holds) == goes
    fleet.run(1)
    assert (fleet.at_m[0] > 5.5) == goes


def test_an_alarm_is_over_when_two_have_been_apart_for_a_while() -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(1)
    fleet.silent = {1}
    begun, over = fleet.now, None
    for step in range(110):
        x = 2.3 if step % 10 < 5 and step < 40 else 8.0  # it comes and goes
        speed = 0.2 if step < 40 else 0.0
        fleet.centre.reported(1, Report(x, 2.0, NORTH, speed, speed, mode="manual"), fleet.now)
        fleet.run(0.1)
        near = [alarm for alarm in fleet.centre.alarms.items() if alarm.code == "near 2"]
        if near and near[0].over and over is None:
            over = fleet.now - begun
    sentences = [event.data["sentence"] for event in fleet.events if event.what == "alarm"]
    assert len(near) == 1 and sum(each.startswith("Tractors 1 and 2") for each in sentences) == 1
    assert over is not None and over >= 3.5 + RULES.release_s


def test_who_stands_clear_of_one_it_would_drive_into_is_told_of_as_long_as_it_stands() -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(2)
    fleet.silent = {1}
    for _ in range(300):  # parked across the way of the first
        fleet.centre.reported(1, Report(0.0, 14.0, 0.0, 0.0, mode="manual"), fleet.now)
        fleet.run(0.1)
    (alarm,) = [each for each in fleet.centre.alarms.items() if each.code == "near 2"]
    assert fleet.centre.states[0].holds == {NEAR} and not alarm.over and "no way on is clear" in alarm.sentence
    assert fleet.centre.guard.apart_m(0, 1, fleet.centre.states) > fleet.centre.guard.release[0]
    for _ in range(60):
        fleet.centre.reported(1, Report(30.0, 14.0, 0.0, 0.0, mode="manual"), fleet.now)
        fleet.run(0.1)
    assert not fleet.centre.states[0].holds and fleet.centre.alarms.items()[0].over


def test_an_operator_leads_one_out_of_an_overlap_and_not_deeper_into_it() -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(5)
    fleet.silent = {0}
    fleet.centre.reported(0, Report(18.5, 5.0, NORTH, 0.0, mode="stopped", leg_m=5.0), fleet.now)
    fleet.run(0.5)
    fleet.centre.lease("anna", 0, False, fleet.now)
    fleet.centre.reported(0, Report(17.5, 5.0, 0.0, 0.0, mode="remote", leg_m=5.0), fleet.now)
    with pytest.raises(CentreError, match="too near another tractor"):
        fleet.centre.command("anna", 0, 0.0, 0.5, fleet.now)
    fleet.centre.command("anna", 0, 0.0, -0.5, fleet.now)
    assert DRIVEN in fleet.centre.states[0].holds


def restarted(fleet: Driven) -> None:
    """The service ends and begins anew; the tractors of the fleet are linked again."""
    kept = json.loads(json.dumps(progress_of(fleet.centre, fleet.now, 1e9 + fleet.now)))
    fleet.centre = Centre(fleet.centre.plan, fleet.centre.rules)
    restore(fleet.centre, kept, fleet.now, 1e9 + fleet.now)
    for number in range(fleet.centre.plan.tractors):
        fleet.centre.joined(number, fleet.now)


def test_two_that_touch_stand_after_a_restart_too() -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=0.5))
    fleet.run(30)
    stood_m = list(fleet.at_m)
    for _ in range(3):
        restarted(fleet)
        fleet.run(20)
    assert fleet.at_m == stood_m and all(NEAR in state.holds for state in fleet.centre.states)
    assert "no way on is clear" in fleet.centre.alarms.items()[0].sentence


def test_who_was_stopped_for_another_goes_on_after_a_restart_once_its_way_is_clear() -> None:
    fleet = behind(0.3)
    restarted(fleet)
    fleet.run(25)
    assert min(fleet.at_m) > 20.0 and not any(state.holds for state in fleet.centre.states)


def test_who_is_found_too_near_before_its_link_is_back_is_told_to_stand_with_the_link() -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=2.9))
    fleet.run(5)
    centre = fleet.centre
    east, west = Report(0.0, 5.0, NORTH - 0.4, 1.0, 1.0, leg_m=5.0), Report(2.9, 5.0, NORTH + 0.4, 1.0, 1.0, leg_m=5.0)
    for number, report in enumerate((east, west)):
        centre.reported(number, report, fleet.now)
    kept = json.loads(json.dumps(progress_of(centre, fleet.now, 1e9)))
    again = Centre(centre.plan, centre.rules)
    restore(again, kept, fleet.now, 1e9)
    assert all(state.doubtful for state in again.states)
    for state in again.states:  # by what the first tick sees
        state.holds.add(NEAR)
    again.tick(fleet.now)
    again.taken()
    again.joined(0, fleet.now)
    assert [order.kind for order in again.taken()[0] if order.tractor == 0][-1] == "stop"


def test_who_was_let_part_is_stopped_again_once_it_was_apart() -> None:
    """Also from one beside which it stood without an alarm: that they came apart is seen all the same."""
    fleet = driven(fleet_plan(3, 3, apart_m=20.0))
    fleet.centre.near.goes(0, {(0, 2): 0.1})
    fleet.run(2)
    fleet.silent = {2}
    for step in range(30):  # a driver comes by, 0.2 m beside the way of the first
        fleet.centre.reported(2, Report(2.25, 14.0 - 0.1 * step, -NORTH, 1.0, 1.0, mode="manual"), fleet.now)
        fleet.run(0.1)
    assert NEAR in fleet.centre.states[0].holds and told(fleet)["alarm"]


def test_who_is_driven_by_hand_keeps_nobody_else_standing() -> None:
    """A driver takes the wheel of one that was stopped and drives it away: the other goes on meanwhile."""
    fleet = behind(0.3)
    fleet.silent = {0}
    for step in range(80):
        x = 0.1 * step
        fleet.centre.reported(0, Report(x, 20.0, 0.0, 1.0, 1.0, mode="manual", leg_m=20.0), fleet.now)
        fleet.run(0.1)
    assert fleet.centre.states[0].report is not None and NEAR not in fleet.centre.states[1].holds
