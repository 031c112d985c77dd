"""The control centre with simulated tractors, by a clock that the tests turn."""

from __future__ import annotations

import json
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.service.centre.centre import Centre
from planner.service.centre.errors import CentreError, LeaseError
from planner.service.centre.progress import progress_of, restore
from planner.service.centre.rules import Rules
from planner.service.centre.tractors import BROKEN, FENCE, HALTED, NEAR, OFFLINE, ONLINE, Report
from tests.service.fleets import LENGTH, Driven, driven, fleet_plan
from vehicle.missions import Gate

WAITS = {(1, 1): (Gate(0, 1, 5.0),)}  # tractor 2 begins its second leg when tractor 1 is 5 m into its own


def whole(fleet: Driven, number: int) -> bool:
    return fleet.centre.states[number].done


def test_everybody_drives_to_the_end_and_the_fleet_is_done() -> None:
    fleet = driven()
    fleet.run(64)
    assert whole(fleet, 0) and whole(fleet, 1)
    assert fleet.centre.state == "done"
    assert fleet.centre.done_m() == pytest.approx(fleet.centre.plan.worked_m)


def test_nothing_is_released_before_the_start_and_little_ahead_after_it() -> None:
    fleet = Driven(Centre(fleet_plan(legs=10), Rules()))
    fleet.run(2)
    assert [state.released for state in fleet.centre.states] == [0, 0]
    assert all(fleet.standing)
    fleet.centre.start("anna", fleet.now)
    fleet.run(1)
    assert fleet.centre.states[0].released == 1  # the next leg begins 19 m ahead, more than the base reaches


def test_released_legs_only_grow_and_each_growth_has_a_higher_update() -> None:
    fleet = driven(fleet_plan(gates=WAITS, legs=4))
    fleet.run(90)
    for number in (0, 1):
        told = [(o.data["update"], o.data["released"]) for o in fleet.orders
                if o.kind == "release" and o.tractor == number]  # fmt: skip
        assert told == sorted(told)
        assert told[-1][1] == 4


def test_a_gate_opens_by_what_was_really_driven() -> None:
    fleet = driven(fleet_plan(gates=WAITS), pace={0: 0.5})
    fleet.run(49)
    assert fleet.at_m[0] == pytest.approx(24.4, abs=0.2) and fleet.at_m[1] == pytest.approx(LENGTH)
    assert fleet.centre.waits_for(1) == [(0, 1)]
    fleet.run(3)
    assert fleet.at_m[1] > LENGTH and fleet.centre.waits_for(1) == []


def test_whom_one_waits_for_is_told_once_however_many_places_it_waits_for() -> None:
    twice = (Gate(0, 1, 5.0), Gate(0, 1, 12.0), Gate(2, 0, 30.0))
    fleet = driven(fleet_plan(3, gates={(1, 1): twice}), pace={0: 0.2, 2: 0.2})
    fleet.run(30)
    assert fleet.centre.waits_for(1) == [(0, 1), (2, 0)]


@settings(max_examples=12)
@given(pace=st.floats(0.2, 0.9), late=st.integers(0, 2))
def test_a_late_tractor_delays_those_that_must_wait_and_nobody_else(pace: float, late: int) -> None:
    waits = {(1, 1): (Gate(0, 0, 10.0),)}
    plan = fleet_plan(3, 2, waits)
    alone, delayed = driven(plan), driven(plan, pace={late: pace})
    alone.run(44)
    delayed.run(44)
    assert all(state.done for state in alone.centre.states)
    assert delayed.at_m[late] < alone.at_m[late] or pace > 0.95
    for other in {0, 1, 2} - {late, 1 if late == 0 else late}:
        assert delayed.at_m[other] == alone.at_m[other]
    # Who passes half of its first leg in t lets the other begin its second one then.
    if late == 0:
        assert delayed.at_m[1] == pytest.approx(LENGTH + max(0.0, min(LENGTH, 44 - max(20, 10 / pace))), abs=0.6)


def test_the_forecast_of_a_plan_that_is_driven_as_planned_is_the_plan() -> None:
    fleet = driven(fleet_plan(gates=WAITS))
    fleet.run(10)
    assert fleet.now + fleet.centre.finish_in_s[0] == pytest.approx(60, abs=1.5)
    assert fleet.now + fleet.centre.finish_in_s[1] == pytest.approx(65, abs=1.5)  # waits 5 s at its gate
    assert fleet.centre.late_s(0, fleet.now) == pytest.approx(0.0, abs=1.5)


def test_the_forecast_is_scaled_by_what_was_driven() -> None:
    fleet = driven(fleet_plan(1, 30), pace={0: 0.5})
    fleet.run(400)
    left_m = 600 - fleet.at_m[0]
    # 400 s for 200 s of plan, believed against 120 s as planned: (120 + 400) / (120 + 200)
    assert fleet.centre.finish_in_s[0] == pytest.approx(left_m * 520 / 320, rel=0.01)
    assert fleet.centre.late_s(0, fleet.now) == pytest.approx(400 + left_m * 520 / 320 - 600, rel=0.02)


def test_who_waits_for_one_that_is_held_has_no_eta_and_others_have() -> None:
    fleet = driven(fleet_plan(3, 3, WAITS))
    fleet.run(2)
    fleet.centre.pause("anna", 0, fleet.now)
    fleet.run(1)
    assert [math.isfinite(s) for s in fleet.centre.finish_in_s] == [False, False, True]


def test_connection_is_online_then_broken_or_offline() -> None:
    fleet = driven()
    fleet.run(1)
    state = fleet.centre.states[0]
    assert state.connection(fleet.now, 1.0) == ONLINE
    fleet.silent = {0}
    fleet.run(1.5)
    assert state.connection(fleet.now, 1.0) == BROKEN
    assert [a.code for a in fleet.centre.alarms.items()] == ["broken"]
    fleet.silent = set()
    fleet.run(0.3)
    assert state.connection(fleet.now, 1.0) == ONLINE
    assert fleet.centre.alarms.items()[0].over
    fleet.centre.left(0, fleet.now, goodbye=True)
    assert state.connection(fleet.now, 1.0) == OFFLINE


def test_pause_and_resume_of_one_leave_the_others_alone() -> None:
    fleet = driven()
    fleet.run(5)
    fleet.centre.pause("anna", 0, fleet.now)
    fleet.run(5)
    assert fleet.at_m == [pytest.approx(5.0, abs=0.2), pytest.approx(10.0, abs=0.2)]
    fleet.centre.resume("anna", 0, fleet.now)
    fleet.run(5)
    assert fleet.at_m[0] == pytest.approx(10.0, abs=0.3)


def test_stop_all_stops_everybody_also_who_is_paused_and_lasts() -> None:
    fleet = driven()
    fleet.run(3)
    fleet.centre.pause("anna", 1, fleet.now)
    fleet.centre.stop_all("bert", fleet.now)
    orders, events = fleet.centre.taken()
    assert [(o.tractor, o.kind) for o in orders if o.data.get("reason") == HALTED] == [(0, "stop"), (1, "stop")]
    assert ("bert", "stop_all") in [(e.who, e.what) for e in events]
    fleet.standing = [True, True]
    fleet.run(3)
    assert fleet.at_m[0] == pytest.approx(3.0, abs=0.2)
    fleet.centre.joined(0, fleet.now)  # one that comes back is told again
    assert [o.kind for o in fleet.centre.taken()[0]] == ["release", "stop"]
    fleet.centre.resume("anna", None, fleet.now)
    fleet.run(2)
    assert fleet.at_m[0] > 4.0 and fleet.at_m[1] > 4.0


def remote(fleet: Driven, number: int = 0, who: str = "anna") -> None:
    """Somebody drives a tractor, which says so."""
    fleet.centre.lease(who, number, False, fleet.now)
    fleet.obey()
    fleet.silent = {number}


def says(fleet: Driven, number: int, x: float, y: float, heading: float, speed: float = 0.0) -> None:
    fleet.centre.reported(number, Report(x, y, heading, speed, speed, mode="remote"), fleet.now)


def test_one_operator_at_a_time_and_a_takeover_is_told_to_both() -> None:
    fleet = driven()
    remote(fleet)
    with pytest.raises(LeaseError, match="Tractor 1 is driven by anna"):
        fleet.centre.lease("bert", 0, False, fleet.now)
    with pytest.raises(LeaseError, match="not yours"):
        fleet.centre.command("bert", 0, 0.0, 0.5, fleet.now)
    assert fleet.centre.lease("bert", 0, True, fleet.now) == "anna"
    with pytest.raises(LeaseError, match="bert drives it"):
        fleet.centre.command("anna", 0, 0.0, 0.5, fleet.now)


def test_remote_commands_are_kept_within_speed_and_lock() -> None:
    fleet = driven()
    remote(fleet)
    says(fleet, 0, 0.0, 10.0, math.pi / 2)
    fleet.centre.command("anna", 0, 3.0, 9.0, fleet.now)
    order = fleet.centre.taken()[0][-1]
    assert order.kind == "command"
    assert order.data["speed_mps"] == Rules().remote_mps
    assert order.data["steering_rad"] == math.radians(fleet.centre.plan.tractor.max_steering_deg)


def test_dead_man_stops_within_half_a_second() -> None:
    fleet = driven()
    remote(fleet)
    says(fleet, 0, 0.0, 10.0, math.pi / 2)
    fleet.centre.command("anna", 0, 0.0, 1.0, fleet.now)
    fleet.obey()
    fleet.run(0.4)
    assert not [o for o in fleet.orders if o.kind == "command" and o.data["speed_mps"] == 0.0]
    fleet.run(0.2)
    assert [o for o in fleet.orders if o.kind == "command" and o.data["speed_mps"] == 0.0]


def test_an_operator_who_is_gone_leaves_tractors_standing() -> None:
    fleet = driven()
    remote(fleet)
    says(fleet, 0, 0.0, 10.0, math.pi / 2)
    assert fleet.centre.gone("anna", fleet.now) == [0]
    assert fleet.centre.taken()[0][-1].kind == "stop"
    assert fleet.centre.leases.holder(0) is None
    fleet.centre.resume("bert", 0, fleet.now)
    assert not fleet.centre.states[0].holds


def test_one_driven_far_off_its_leg_does_not_go_on_by_itself() -> None:
    fleet = driven()
    remote(fleet)
    says(fleet, 0, 4.5, 10.0, math.pi / 2)
    fleet.centre.leave("anna", 0, fleet.now)
    with pytest.raises(CentreError, match=r"4\.5 m off its leg"):
        fleet.centre.resume("bert", 0, fleet.now)


def test_no_remote_command_leads_out_of_the_fence_and_one_leads_back() -> None:
    fleet = driven()
    remote(fleet)
    says(fleet, 0, 0.0, -6.0, -math.pi / 2, 0.0)  # heading south, a metre inside the fence
    with pytest.raises(CentreError, match="leave the fence"):
        fleet.centre.command("anna", 0, 0.0, 1.0, fleet.now)
    assert fleet.centre.taken()[0][-1].data["speed_mps"] == 0.0
    says(fleet, 0, 0.0, -8.0, -math.pi / 2, 0.0)  # outside
    fleet.run(0.5)
    assert FENCE in fleet.centre.states[0].holds
    fleet.centre.command("anna", 0, 0.0, -1.0, fleet.now)
    assert [o for o in fleet.centre.taken()[0] if o.kind == "command"][-1].data["speed_mps"] == -1.0
    with pytest.raises(CentreError, match="leave the fence"):
        fleet.centre.command("anna", 0, 0.0, 1.0, fleet.now)


@settings(max_examples=8)
@given(speed=st.floats(0.6, 1.38), from_m=st.floats(8.0, 14.0))
def test_two_that_would_meet_stand_before_clearance_is_lost(speed: float, from_m: float) -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=60.0))
    fleet.run(1)
    fleet.silent = {0, 1}
    fleet.standing = [False, False]
    x = [30.0 - from_m, 30.0 + from_m]  # far from their legs, to which they would go on by themselves
    going = [speed, speed]
    fleet.orders.clear()
    for _ in range(300):
        fleet.now += 0.1
        for n, heading in ((0, 0.0), (1, math.pi)):
            going[n] = max(0.0, going[n] - 0.07) if fleet.standing[n] else speed
            x[n] += 0.1 * going[n] * (1 - 2 * n)
            fleet.centre.reported(n, Report(x[n], 10.0, heading, going[n], going[n], mode="manual"), fleet.now)
        fleet.centre.tick(fleet.now)
        fleet.obey()
    assert all(NEAR in state.holds for state in fleet.centre.states)
    # Nose to nose: the antenna stands 1.1 m ahead of the rear axle, the rest of the tractor is ahead of it.
    tractor = fleet.centre.plan.tractor
    nose = tractor.length_m - tractor.rear_overhang_m - tractor.antenna_forward_m
    assert x[1] - x[0] - 2.0 * nose >= 0.5
    assert going == [0.0, 0.0]


def test_of_two_that_stand_near_one_goes_on_when_its_way_is_clear() -> None:
    fleet = driven(fleet_plan(2, 3, apart_m=20.0))
    fleet.run(2)
    for state in fleet.centre.states:
        state.holds.add(NEAR)
    fleet.run(2 * Rules().release_s + 1)
    assert not any(NEAR in state.holds for state in fleet.centre.states)
    assert [e.data["tractor"] for e in fleet.events if e.what == "goes on"] == [1, 2]


def test_an_obstacle_blocks_the_legs_it_touches_and_the_rest_goes_on() -> None:
    fleet = driven()
    fleet.run(2)
    block = fleet.centre.obstacle("anna", ((-1.0, 45.0), (1.0, 45.0), (1.0, 47.0), (-1.0, 47.0)), "bale", fleet.now)
    fleet.run(62)
    assert fleet.at_m[0] == pytest.approx(2 * LENGTH) and whole(fleet, 1)
    assert fleet.centre.blocked == [{2: "bale"}, {}]
    assert math.isinf(fleet.centre.finish_in_s[0])
    fleet.centre.clear("anna", block.id, fleet.now)
    fleet.run(22)
    assert whole(fleet, 0)


def test_an_obstacle_on_a_released_leg_stops_who_drives_at_it_but_not_who_has_passed() -> None:
    fleet = driven()
    fleet.run(10)
    ahead = ((-1.0, 15.0), (1.0, 15.0), (1.0, 16.0), (-1.0, 16.0))
    behind = ((19.0, 1.0), (21.0, 1.0), (21.0, 2.0), (19.0, 2.0))
    first = fleet.centre.obstacle("anna", ahead, "stone", fleet.now)
    fleet.centre.obstacle("anna", behind, "bag", fleet.now)
    fleet.run(5)
    assert fleet.at_m[0] == pytest.approx(10.0, abs=0.3) and fleet.at_m[1] == pytest.approx(15.0, abs=0.3)
    fleet.centre.clear("anna", first.id, fleet.now)
    fleet.run(5)
    assert fleet.at_m[0] == pytest.approx(15.0, abs=0.4)


def test_what_is_no_outline_is_refused() -> None:
    fleet = driven()
    with pytest.raises(CentreError, match="not a polygon"):
        fleet.centre.obstacle("anna", ((0.0, 0.0), (1.0, 1.0), (1.0, 0.0), (0.0, 1.0)), "bow", fleet.now)


def test_alarms_stay_until_they_are_over_and_acknowledged() -> None:
    fleet = driven()
    fleet.centre.fail("anna", 0, fleet.now)
    alarm = fleet.centre.alarms.items()[0]
    fleet.centre.acknowledge("bert", alarm.id, fleet.now)
    assert fleet.centre.alarms.items()[0].acknowledged == "bert"  # it is still failed
    fleet.centre.alarms.ended("failed", 0)
    assert not fleet.centre.alarms.items()
    with pytest.raises(CentreError, match="no alarm"):
        fleet.centre.acknowledge("bert", alarm.id, fleet.now)


def test_every_order_is_in_the_log_of_who_did_what() -> None:
    fleet = driven()
    fleet.centre.pause("anna", None, fleet.now)
    fleet.run(1.1)
    fleet.centre.resume("bert", None, fleet.now)
    remote(fleet)
    says(fleet, 0, 0.0, 10.0, math.pi / 2)
    fleet.centre.command("anna", 0, 0.0, 0.5, fleet.now)
    fleet.obey()
    log = [(event.who, event.what) for event in fleet.events]
    for each in (("anna", "started"), ("anna", "paused"), ("bert", "resumed"), ("anna", "lease"), ("anna", "command")):
        assert each in log


def test_a_fleet_goes_on_from_stored_progress() -> None:
    plan = fleet_plan(gates=WAITS)
    first, other = driven(plan), driven(plan)
    first.run(27)
    other.run(27)
    kept = json.loads(json.dumps(progress_of(first.centre, first.now, 1e9)))
    again = Centre(plan, Rules())
    restore(again, kept, first.now + 100.0, 1e9)
    assert again.state == "running" and again.started_s == pytest.approx(100.0)
    assert [(s.leg, s.released, s.update) for s in again.states] == [
        (s.leg, s.released, s.update) for s in first.centre.states
    ]
    first.centre = again
    first.now += 100.0
    for number in (0, 1):
        again.joined(number, first.now)
    first.run(40)
    other.run(40)
    assert all(state.done for state in again.states)
    assert first.at_m == other.at_m


def test_last_places_and_what_was_seen_of_alarms_outlive_a_restart() -> None:
    first = driven()
    first.run(5)
    for who in ("bert", "anna"):
        block = first.centre.obstacle(who, ((90.0, 0.0), (91.0, 0.0), (91.0, 1.0)), "bale", first.now)
    first.centre.clear("anna", 1, first.now)
    first.centre.fail("anna", 0, first.now)
    failed = first.centre.alarms.items()[-1]
    first.centre.acknowledge("bert", failed.id, first.now)
    kept = json.loads(json.dumps(progress_of(first.centre, first.now, 1e9)))
    again = Centre(first.centre.plan, Rules())
    restore(again, kept, 3.0, 1e9 + 60.0)
    assert [s.report for s in again.states] == [s.report for s in first.centre.states]
    assert again.states[1].heard_s == pytest.approx(3.0 - 60.0) and again.states[1].connection(3.0, 1.0) == "broken"
    before = {alarm.id: alarm for alarm in first.centre.alarms.items()}
    assert {alarm.id: alarm.acknowledged for alarm in again.alarms.items()} == {
        id: alarm.acknowledged for id, alarm in before.items()
    }
    assert again.alarms.on("failed", 0)
    assert again.alarms.items()[-1].since_s == pytest.approx(failed.since_s - first.now + 3.0 - 60.0)
    assert block.id == 2 and list(again.obstacles.items) == [1]
    again.clear("anna", 1, 3.0)
    assert all(alarm.over for alarm in again.alarms.items() if alarm.code.startswith("obstacle"))


def test_the_pace_is_that_of_the_tractor_also_when_its_reports_come_all_at_once() -> None:
    fleet = driven(fleet_plan(1))
    fleet.run(1)
    state = fleet.centre.states[0]
    begun_s, begun_plan_s = state.driving_s, state.driven_plan_s
    clock, at = 1e9, fleet.at_m[0]
    for step in range(101):  # ten seconds at half the speed of the plan
        y = at + 0.05 * step
        fleet.centre.reported(0, Report(0.0, y, math.pi / 2, 0.5, leg=0, leg_m=y, time_s=clock + 0.1 * step), fleet.now)
    assert state.driving_s - begun_s == pytest.approx(10.0, abs=0.15)
    assert state.driven_plan_s - begun_plan_s == pytest.approx(5.0, abs=0.15)
    gone = Report(0.0, at + 9.0, math.pi / 2, 0.5, leg=0, leg_m=at + 9.0, time_s=clock + 100.0)
    fleet.centre.reported(0, gone, fleet.now)  # nobody knows how long it drove in between
    assert state.driven_plan_s - begun_plan_s == pytest.approx(5.0, abs=0.15)


def test_progress_of_a_tractor_never_goes_back() -> None:
    fleet = driven()
    fleet.run(25)
    fleet.centre.reported(0, Report(0.0, 0.0, math.pi / 2, 0.0, leg=0, leg_m=0.0), fleet.now)
    assert fleet.centre.states[0].leg == 1
    with pytest.raises(CentreError, match="leg 7 of 3"):
        fleet.centre.reported(0, Report(0.0, 0.0, 0.0, 0.0, leg=7), fleet.now)


def test_rules_that_cannot_be_are_refused() -> None:
    with pytest.raises(CentreError, match="silence_s is 0"):
        Rules(silence_s=0.0)
    with pytest.raises(CentreError, match="at most 100 times"):
        Rules(times=1000.0)
