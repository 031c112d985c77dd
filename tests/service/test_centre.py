"""The control centre with simulated tractors, by a clock that the tests turn."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.rules import ControlLeaseError, FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import BROKEN, OFFLINE, ONLINE, Hold, TractorReport
from tests.examples import count_examples
from tests.service.fleets import LENGTH, SimulatedFleet, fleet_plan, restart_manager, start_fleet
from tests.service.test_safety import remote
from vehicle.missions.plan import LegGate

WAITS = {(1, 1): (LegGate(0, 1, 5.0),)}  # tractor 2 begins its second leg when tractor 1 is 5 m into its own


def test_everybody_drives_to_the_end_by_released_legs_that_only_grow_and_the_fleet_is_done() -> None:
    fleet = start_fleet(fleet_plan(gates=WAITS, legs=4))
    fleet.run(90)
    assert all(state.done for state in fleet.manager.states) and fleet.manager.state == "done"
    assert fleet.manager.compute_total_worked_m() == pytest.approx(fleet.manager.plan.worked_m)
    for number in (0, 1):
        releases = [order.data for order in fleet.orders if order.kind == "release" and order.tractor == number]
        told = [(data["update"], data["base_end"]) for data in releases]
        assert told == sorted(told) and told[-1][1] == 4


def test_nothing_is_released_before_the_start_and_little_ahead_after_it() -> None:
    fleet = SimulatedFleet(FleetManager(fleet_plan(legs=10), FleetRules()))
    fleet.run(2)
    assert [state.base_end for state in fleet.manager.states] == [0, 0]
    assert all(fleet.standing)
    fleet.manager.operators.start_fleet_work("anna", fleet.now)
    fleet.run(1)
    assert fleet.manager.states[0].base_end == 1  # the next leg begins 19 m ahead, more than the base reaches


def test_a_gate_opens_by_what_was_really_driven_and_each_who_is_awaited_is_told_once() -> None:
    fleet = start_fleet(fleet_plan(gates=WAITS), pace={0: 0.5})
    fleet.run(49)
    assert fleet.at_m[0] == pytest.approx(24.4, abs=0.2) and fleet.at_m[1] == pytest.approx(LENGTH)
    assert fleet.manager.find_awaited_legs(1) == [(0, 1)]
    fleet.run(3)
    assert fleet.at_m[1] > LENGTH and fleet.manager.find_awaited_legs(1) == []
    twice = (LegGate(0, 1, 5.0), LegGate(0, 1, 12.0), LegGate(2, 0, 30.0))
    fleet = start_fleet(fleet_plan(3, gates={(1, 1): twice}), pace={0: 0.2, 2: 0.2})
    fleet.run(30)
    assert fleet.manager.find_awaited_legs(1) == [(0, 1), (2, 0)]


@pytest.mark.slow
@settings(max_examples=count_examples(12))
@given(pace=st.floats(0.2, 0.9), late=st.integers(0, 2))
def test_a_late_tractor_delays_those_that_must_wait_and_nobody_else(pace: float, late: int) -> None:
    waits = {(1, 1): (LegGate(0, 0, 10.0),)}
    plan = fleet_plan(3, 2, waits)
    alone, delayed = start_fleet(plan), start_fleet(plan, pace={late: pace})
    alone.run(44)
    delayed.run(44)
    assert all(state.done for state in alone.manager.states)
    assert delayed.at_m[late] < alone.at_m[late] or pace > 0.95
    for other in {0, 1, 2} - {late, 1 if late == 0 else late}:
        assert delayed.at_m[other] == alone.at_m[other]
    # Who passes half of its first leg in t lets the other begin its second one then.
    if late == 0:
        assert delayed.at_m[1] == pytest.approx(LENGTH + max(0.0, min(LENGTH, 44 - max(20, 10 / pace))), abs=0.6)


def test_the_forecast_of_a_plan_that_is_driven_as_planned_is_the_plan() -> None:
    fleet = start_fleet(fleet_plan(gates=WAITS))
    fleet.run(10)
    assert fleet.now + fleet.manager.finish_in_s[0] == pytest.approx(60, abs=1.5)
    assert fleet.now + fleet.manager.finish_in_s[1] == pytest.approx(65, abs=1.5)  # waits 5 s at its gate
    assert fleet.manager.estimate_delay_s(0, fleet.now) == pytest.approx(0.0, abs=1.5)


def test_the_forecast_is_scaled_by_what_was_driven() -> None:
    fleet = start_fleet(fleet_plan(1, 30), pace={0: 0.5})
    fleet.run(400)
    left_m = 600 - fleet.at_m[0]
    # 400 s for 200 s of plan, believed against 120 s as planned: (120 + 400) / (120 + 200)
    assert fleet.manager.finish_in_s[0] == pytest.approx(left_m * 520 / 320, rel=0.01)
    assert fleet.manager.estimate_delay_s(0, fleet.now) == pytest.approx(400 + left_m * 520 / 320 - 600, rel=0.02)


def test_who_waits_for_one_that_is_held_has_no_eta_and_others_have() -> None:
    fleet = start_fleet(fleet_plan(3, 3, WAITS))
    fleet.run(2)
    fleet.manager.operators.pause_tractors("anna", 0, fleet.now)
    fleet.run(1)
    assert [math.isfinite(s) for s in fleet.manager.finish_in_s] == [False, False, True]


def test_connection_is_online_then_broken_or_offline() -> None:
    fleet = start_fleet()
    fleet.run(1)
    state = fleet.manager.states[0]
    assert state.get_connection(fleet.now, 1.0) == ONLINE
    fleet.silent = {0}
    fleet.run(1.5)
    assert state.get_connection(fleet.now, 1.0) == BROKEN
    assert [a.code for a in fleet.manager.alarms.list_alarms()] == ["broken"]
    fleet.silent = set()
    fleet.run(0.3)
    assert state.get_connection(fleet.now, 1.0) == ONLINE
    assert fleet.manager.alarms.list_alarms()[0].over
    fleet.manager.disconnect_tractor(0, fleet.now, is_orderly=True)
    assert state.get_connection(fleet.now, 1.0) == OFFLINE


def test_pause_and_resume_of_one_leave_the_others_alone_and_stop_all_stops_everybody_and_lasts() -> None:
    fleet = start_fleet()
    operators = fleet.manager.operators
    fleet.run(5)
    operators.pause_tractors("anna", 0, fleet.now)
    fleet.run(5)
    assert fleet.at_m == [pytest.approx(5.0, abs=0.2), pytest.approx(10.0, abs=0.2)]
    operators.resume_tractors("anna", 0, fleet.now)
    fleet.run(5)
    assert fleet.at_m[0] == pytest.approx(10.0, abs=0.3)
    operators.pause_tractors("anna", 1, fleet.now)
    operators.stop_all("bert", fleet.now)
    orders, events = fleet.manager.take_outputs()
    assert [(o.tractor, o.kind) for o in orders if o.data.get("reason") == Hold.HALTED] == [(0, "stop"), (1, "stop")]
    assert ("bert", "stop_all") in [(e.who, e.what) for e in events]
    fleet.standing = [True, True]
    fleet.run(3)
    assert fleet.at_m[0] == pytest.approx(10.0, abs=0.3)
    fleet.manager.connect_tractor(0, fleet.now)  # one that comes back is told again
    assert [o.kind for o in fleet.manager.take_outputs()[0]] == ["release", "stop"]
    operators.resume_tractors("anna", None, fleet.now)
    fleet.run(2)
    assert fleet.at_m[0] > 11.0 and fleet.at_m[1] > 16.0


def test_one_operator_at_a_time_drives_within_speed_and_lock_and_who_goes_leaves_it_standing() -> None:
    fleet = remote()
    operators = fleet.manager.operators
    operators.send_command("anna", 0, 3.0, 9.0, fleet.now)
    order = fleet.manager.take_outputs()[0][-1]
    assert (order.kind, order.data["speed_mps"]) == ("command", FleetRules().remote_mps)
    assert order.data["steering_rad"] == math.radians(fleet.manager.plan.tractor.max_steering_deg)
    with pytest.raises(ControlLeaseError, match="Tractor 1 is driven by anna"):
        operators.take_lease("bert", 0, False, fleet.now)
    with pytest.raises(ControlLeaseError, match="not yours"):
        operators.send_command("bert", 0, 0.0, 0.5, fleet.now)
    assert operators.take_lease("bert", 0, True, fleet.now) == "anna"
    with pytest.raises(ControlLeaseError, match="bert drives it"):
        operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
    assert operators.disconnect_operator("bert", fleet.now) == [0]
    assert fleet.manager.take_outputs()[0][-1].kind == "stop"
    assert fleet.manager.lease_holders.get(0) is None
    operators.resume_tractors("bert", 0, fleet.now)
    assert not fleet.manager.states[0].holds


def test_dead_man_stops_within_half_a_second() -> None:
    fleet = remote()
    fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
    fleet.obey()
    for seconds, is_stopped in ((0.4, False), (0.2, True)):
        fleet.run(seconds)
        assert any(o.kind == "command" and o.data["speed_mps"] == 0.0 for o in fleet.orders) == is_stopped


def test_one_driven_far_off_its_leg_does_not_go_on_by_itself() -> None:
    fleet = remote(4.5)
    fleet.manager.operators.return_lease("anna", 0, fleet.now)
    with pytest.raises(FleetManagerError, match=r"4\.5 m off its leg"):
        fleet.manager.operators.resume_tractors("bert", 0, fleet.now)


def test_no_remote_command_leads_out_of_the_fence_and_one_leads_back() -> None:
    fleet = remote(0.0, -6.0, -math.pi / 2)  # heading south, a metre inside the fence
    with pytest.raises(FleetManagerError, match="leave the fence"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
    assert fleet.manager.take_outputs()[0][-1].data["speed_mps"] == 0.0
    fleet.manager.take_report(0, TractorReport(0.0, -8.0, -math.pi / 2, 0.0, mode="remote"), fleet.now)  # outside
    fleet.run(0.5)
    assert Hold.FENCE in fleet.manager.states[0].holds
    fleet.manager.operators.send_command("anna", 0, 0.0, -1.0, fleet.now)
    assert [o for o in fleet.manager.take_outputs()[0] if o.kind == "command"][-1].data["speed_mps"] == -1.0
    with pytest.raises(FleetManagerError, match="leave the fence"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)


@settings(max_examples=count_examples(8))
@given(speed=st.floats(0.6, 1.38), from_m=st.floats(8.0, 14.0))
def test_two_that_would_meet_stand_before_clearance_is_lost(speed: float, from_m: float) -> None:
    fleet = start_fleet(fleet_plan(2, 3, apart_m=60.0))
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
            fleet.manager.take_report(
                n, TractorReport(x[n], 10.0, heading, going[n], going[n], mode="manual"), fleet.now
            )
        fleet.manager.update_fleet(fleet.now)
        fleet.obey()
    assert all(Hold.TOO_NEAR in state.holds for state in fleet.manager.states)
    # Nose to nose: the antenna stands 1.1 m ahead of the rear axle, the rest of the tractor is ahead of it.
    tractor = fleet.manager.plan.tractor
    nose = tractor.length_m - tractor.rear_overhang_m - tractor.antenna_forward_m
    assert x[1] - x[0] - 2.0 * nose >= 0.5
    assert going == [0.0, 0.0]


def test_an_obstacle_blocks_the_legs_it_touches_and_the_rest_goes_on() -> None:
    fleet = start_fleet()
    fleet.run(2)
    block = fleet.manager.obstacle_reports.add(
        "anna", ((-1.0, 45.0), (1.0, 45.0), (1.0, 47.0), (-1.0, 47.0)), "bale", fleet.now
    )
    fleet.run(62)
    assert fleet.at_m[0] == pytest.approx(2 * LENGTH) and fleet.manager.states[1].done
    assert fleet.manager.blocked_legs == [{2: "bale"}, {}]
    assert math.isinf(fleet.manager.finish_in_s[0])
    fleet.manager.obstacle_reports.clear("anna", block.id, fleet.now)
    fleet.run(22)
    assert fleet.manager.states[0].done


def test_an_obstacle_on_a_released_leg_stops_who_drives_at_it_but_not_who_has_passed() -> None:
    fleet = start_fleet()
    fleet.run(10)
    ahead = ((-1.0, 15.0), (1.0, 15.0), (1.0, 16.0), (-1.0, 16.0))
    behind = ((19.0, 1.0), (21.0, 1.0), (21.0, 2.0), (19.0, 2.0))
    first = fleet.manager.obstacle_reports.add("anna", ahead, "stone", fleet.now)
    fleet.manager.obstacle_reports.add("anna", behind, "bag", fleet.now)
    fleet.run(5)
    assert fleet.at_m[0] == pytest.approx(10.0, abs=0.3) and fleet.at_m[1] == pytest.approx(15.0, abs=0.3)
    fleet.manager.obstacle_reports.clear("anna", first.id, fleet.now)
    fleet.run(5)
    assert fleet.at_m[0] == pytest.approx(15.0, abs=0.4)


def test_alarms_stay_until_they_are_over_and_acknowledged() -> None:
    fleet = start_fleet()
    fleet.manager.operators.mark_failed("anna", 0, fleet.now)
    alarm = fleet.manager.alarms.list_alarms()[0]
    fleet.manager.obstacle_reports.acknowledge_alarm("bert", alarm.id, fleet.now)
    assert fleet.manager.alarms.list_alarms()[0].acknowledged == "bert"  # it is still failed
    fleet.manager.alarms.end_alarm("failed", 0)
    assert not fleet.manager.alarms.list_alarms()
    with pytest.raises(FleetManagerError, match="no alarm"):
        fleet.manager.obstacle_reports.acknowledge_alarm("bert", alarm.id, fleet.now)


def test_every_order_is_in_the_log_of_who_did_what() -> None:
    fleet = remote()
    fleet.manager.operators.pause_tractors("anna", None, fleet.now)
    fleet.run(1.1)
    fleet.manager.operators.resume_tractors("bert", None, fleet.now)
    fleet.manager.operators.take_lease("anna", 0, False, fleet.now)
    fleet.manager.take_report(0, TractorReport(0.0, 10.0, math.pi / 2, 0.0, mode="remote"), fleet.now)
    fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
    fleet.obey()
    log = [(event.who, event.what) for event in fleet.events]
    for each in (("anna", "started"), ("anna", "paused"), ("bert", "resumed"), ("anna", "lease"), ("anna", "command")):
        assert each in log


def test_a_fleet_goes_on_from_stored_progress_once_somebody_orders_it() -> None:
    plan = fleet_plan(gates=WAITS)
    first, other = start_fleet(plan), start_fleet(plan)
    first.run(27)
    other.run(27)
    again = restart_manager(first.manager, first.now, first.now + 100.0)
    assert again.state == "running" and again.started_s == pytest.approx(100.0)
    assert [(s.leg, s.base_end, s.update) for s in again.states] == [
        (s.leg, s.base_end, s.update) for s in first.manager.states
    ]
    first.manager = again
    first.now += 100.0
    for number in (0, 1):
        again.connect_tractor(number, first.now)
    stood_m = list(first.at_m)
    first.run(5)
    assert first.at_m == stood_m and all(state.holds == {Hold.SERVICE_RESTARTED} for state in again.states)
    again.operators.start_fleet_work("anna", first.now)
    first.run(40)
    other.run(40)
    assert all(state.done for state in again.states)
    assert first.at_m == other.at_m


def test_last_places_and_what_was_seen_of_alarms_outlive_a_restart() -> None:
    first = start_fleet()
    first.run(5)
    for who in ("bert", "anna"):
        block = first.manager.obstacle_reports.add(who, ((90.0, 0.0), (91.0, 0.0), (91.0, 1.0)), "bale", first.now)
    first.manager.obstacle_reports.clear("anna", 1, first.now)
    first.manager.operators.mark_failed("anna", 0, first.now)
    failed = first.manager.alarms.list_alarms()[-1]
    first.manager.obstacle_reports.acknowledge_alarm("bert", failed.id, first.now)
    again = restart_manager(first.manager, first.now, 3.0, 60.0)
    assert [s.report for s in again.states] == [s.report for s in first.manager.states]
    second = again.states[1]
    assert second.last_contact_s == pytest.approx(3.0 - 60.0) and second.get_connection(3.0, 1.0) == "broken"
    before = {alarm.id: alarm.acknowledged for alarm in first.manager.alarms.list_alarms()}
    assert again.alarms.list_alarms()[-1].code == "restarted"
    assert {alarm.id: alarm.acknowledged for alarm in again.alarms.list_alarms()[:-1]} == before
    assert again.alarms.is_alarm_on("failed", 0)
    assert again.alarms.list_alarms()[-2].since_s == pytest.approx(failed.since_s - first.now + 3.0 - 60.0)
    assert block.id == 2 and list(again.obstacles.items) == [1]
    again.obstacle_reports.clear("anna", 1, 3.0)
    assert all(alarm.over for alarm in again.alarms.list_alarms() if alarm.code.startswith("obstacle"))


def test_the_pace_is_that_of_the_tractor_also_when_its_reports_come_all_at_once() -> None:
    fleet = start_fleet(fleet_plan(1))
    fleet.run(1)
    state = fleet.manager.states[0]
    begun_s, begun_plan_s = state.driving_s, state.planned_driving_s
    clock, at = 1e9, fleet.at_m[0]
    for step in range(101):  # ten seconds at half the speed of the plan
        y = at + 0.05 * step
        fleet.manager.take_report(
            0, TractorReport(0.0, y, math.pi / 2, 0.5, leg=0, leg_m=y, time_s=clock + 0.1 * step), fleet.now
        )
    assert state.driving_s - begun_s == pytest.approx(10.0, abs=0.15)
    assert state.planned_driving_s - begun_plan_s == pytest.approx(5.0, abs=0.15)
    gone = TractorReport(0.0, at + 9.0, math.pi / 2, 0.5, leg=0, leg_m=at + 9.0, time_s=clock + 100.0)
    fleet.manager.take_report(0, gone, fleet.now)  # nobody knows how long it drove in between
    assert state.planned_driving_s - begun_plan_s == pytest.approx(5.0, abs=0.15)


def test_progress_of_a_tractor_never_goes_back() -> None:
    fleet = start_fleet()
    fleet.run(25)
    fleet.manager.take_report(0, TractorReport(0.0, 0.0, math.pi / 2, 0.0, leg=0, leg_m=0.0), fleet.now)
    assert fleet.manager.states[0].leg == 1
    with pytest.raises(FleetManagerError, match="leg 7, but its plan has 3 legs"):
        fleet.manager.take_report(0, TractorReport(0.0, 0.0, 0.0, 0.0, leg=7), fleet.now)


@pytest.mark.parametrize(
    ("rule", "words"),
    [
        ({"silence_s": 0.0}, "silence_s is 0"), ({"times": 1000.0}, "at most 100 times"),
        ({"horizon_s": 1.9}, "use 2 to 600 seconds"), ({"horizon_s": 601.0}, "use 2 to 600 seconds"),
    ],
)  # fmt: skip
def test_rules_that_cannot_be_are_refused(rule: dict[str, float], words: str) -> None:
    with pytest.raises(FleetManagerError, match=words):
        FleetRules(**rule)  # type: ignore[arg-type]


def test_the_alarm_of_a_broken_link_says_what_the_tractor_does_now() -> None:
    fleet = start_fleet(rules=FleetRules(horizon_s=8.0))
    fleet.run(5)

    def told() -> str:
        fleet.manager.disconnect_tractor(0, fleet.now, False)
        return fleet.manager.alarms.list_alarms()[0].sentence

    metres = fleet.manager.plan.timed_missions[0].leg_starts_m[fleet.manager.states[0].base_end] - fleet.at_m[0]
    assert told() == (
        f"The link to tractor 1 is broken: it drives on for 8.0 s, or {metres:.1f} m to the end of its base, and stops."
    )
    fleet.manager.take_report(0, TractorReport(0.0, 5.0, math.pi / 2, 0.5, 0.5, mode="remote", leg_m=5.0), fleet.now)
    assert told().endswith("it stops after 1.0 s.")
    fleet.manager.take_report(0, TractorReport(0.0, 5.0, math.pi / 2, 0.5, 0.5, mode="manual", leg_m=5.0), fleet.now)
    assert told().endswith("its driver drives it by hand.")
    fleet.manager.take_report(0, TractorReport(0.0, 5.0, math.pi / 2, 0.0, 0.0, mode="stopped", leg_m=5.0), fleet.now)
    fleet.manager.operators.stop_all("anna", fleet.now)
    assert told().endswith("it was ordered to stop, and stands.")
