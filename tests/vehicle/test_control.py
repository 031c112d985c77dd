"""What tractors do with a plan: gates, formation, gear changes, stops, stalls, and what the record says about it."""

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from vehicle.missions.plan import FollowOrder, LegGate, Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.records import FINISHED, REVERSING, STANDING, TURNING, WAITING, WORKING
from vehicle.sim.world import simulate

SPEED = 5.0 / 3.6
Y, STEERING, VELOCITY, LEG, STATUS = 1, 3, 4, 5, 6


@pytest.fixture
def drive(eg105: Tractor, implement: Implement) -> Any:
    """Simulate a plan with the EG105."""
    return lambda plan, **options: simulate(plan, eg105, implement, **options)


def first(condition: Any) -> int:
    assert condition.any()
    return int(np.argmax(condition))


@pytest.mark.parametrize("metre", [0.5, 7.0, 19.0])
def test_a_start_gate_opens_at_its_metre(build: Any, drive: Any, metre: float) -> None:
    plan = build.plan([build.leg((0, 0), (0, 20))], [build.leg((9, 0), (9, 10), gates=(LegGate(0, 0, metre),))])
    run: SimulationRun = drive(plan)
    opened = first(run.record[:, 1, STATUS] != WAITING)
    assert metre <= run.record[opened, 0, Y] <= metre + SPEED * 0.1 + 1e-6
    assert (run.record[:opened, 1, Y] == 0.0).all() and (run.record[:opened, 1, VELOCITY] == 0.0).all()
    assert run.outcome == "done"
    assert run.sum_seconds_by_status()["waiting"][1] == pytest.approx(0.1 * opened)


@pytest.mark.parametrize("metre", [2.0, 24.0])
def test_a_gate_between_legs_holds_at_the_joint_and_counts_on_its_leg(build: Any, drive: Any, metre: float) -> None:
    lead = [build.leg((0, 0), (0, 20), speed_mps=0.6), build.leg((0, 20), (0, 50), speed_mps=0.6)]
    held = [build.leg((9, 0), (9, 10)), build.leg((9, 10), (9, 20), gates=(LegGate(0, 1, metre),))]
    run: SimulationRun = drive(build.plan(lead, held))
    opened = first(run.record[:, 1, LEG] == 1)
    assert 20.0 + metre <= run.record[opened, 0, Y] <= 20.0 + metre + 0.6 * 0.1 + 1e-6
    waiting = run.record[:, 1, STATUS] == WAITING
    assert waiting[opened - 50 : opened].all() and not waiting[opened + 1 :].any()
    assert run.record[waiting, 1, Y] == pytest.approx(10.0, abs=0.15)
    assert np.ptp(run.record[opened - 50 : opened, 1, Y]) < 0.005, "the brake holds"
    assert run.outcome == "done"


def test_an_open_gate_is_passed_without_slowing_down(build: Any, drive: Any) -> None:
    lead = [build.leg((0, 0), (0, 5))]
    legs = [build.leg((9, 0), (9, 30)), build.leg((9, 30), (9, 60), gates=(LegGate(0, 0, 4.0),))]
    run: SimulationRun = drive(build.plan(lead, legs))
    middle = run.record[(run.record[:, 1, Y] > 20.0) & (run.record[:, 1, Y] < 50.0), 1]
    assert middle[:, VELOCITY] == pytest.approx(SPEED, rel=0.002)
    assert set(middle[:, LEG]) == {0.0, 1.0}


def test_a_tractor_that_is_done_holds_nobody(build: Any, drive: Any) -> None:
    """Its guided point may stop a little short of the last metre that a gate waits for."""
    plan = build.plan([build.leg((0, 0), (0, 8))], [build.leg((9, 0), (9, 8), gates=(LegGate(0, 0, 8.0),))])
    assert drive(plan).outcome == "done"


def test_tractors_that_wait_for_each_other_are_a_stall(build: Any, drive: Any) -> None:
    one = [build.leg((0, 0), (0, 10)), build.leg((0, 10), (0, 20), gates=(LegGate(1, 1, 5.0),))]
    two = [build.leg((9, 0), (9, 10)), build.leg((9, 10), (9, 20), gates=(LegGate(0, 1, 5.0),))]
    free = [build.leg((18, 0), (18, 30))]
    run: SimulationRun = drive(build.plan(one, two, free))
    assert run.outcome == "stall"
    assert np.isnan(run.finish_s[:2]).all() and run.finish_s[2] < 40.0
    # Two minutes after the last progress to speak of.
    assert run.finish_s[2] + 115.0 < run.time_s[-1] < run.finish_s[2] + 150.0
    assert (run.record[-1, :, STATUS] == [WAITING, WAITING, FINISHED]).all()


def test_a_long_wait_for_a_moving_tractor_is_no_stall(build: Any, drive: Any) -> None:
    plan = build.plan([build.leg((0, 0), (0, 260))], [build.leg((9, 0), (9, 8), gates=(LegGate(0, 0, 255.0),))])
    run: SimulationRun = drive(plan)
    assert run.outcome == "done" and run.sum_seconds_by_status()["waiting"][1] > 150.0


@pytest.mark.parametrize("start", [-4.0, -7.0, -8.5])
def test_a_follower_that_is_too_close_falls_back_to_ten_metres(build: Any, drive: Any, start: float) -> None:
    lead = [build.leg((0, 0), (0, 80), kind="track")]
    behind = [build.leg((3, start), (3, 70), follow=FollowOrder(0, 0), kind="track")]
    run: SimulationRun = drive(build.plan(lead, behind))
    gap = run.record[:, 0, Y] - run.record[:, 1, Y]
    assert (run.record[gap < 10.0 - 2 * SPEED, 1, VELOCITY] < 0.05).all(), "Eq. 6.1 says stand"
    steady = (run.record[:, 0, Y] > 60.0) & (run.record[:, 0, Y] < 78.0)
    assert gap[steady] == pytest.approx(10.0, abs=0.7)
    assert gap.min() == pytest.approx(-start, abs=0.02), "never closer than at the start"


def test_a_follower_with_room_drives_as_fast_as_its_leader(build: Any, drive: Any) -> None:
    lead = [build.leg((0, 0), (0, 60), speed_mps=0.8)]
    behind = [build.leg((3, -14), (3, 40), follow=FollowOrder(0, 0))]
    run: SimulationRun = drive(build.plan(lead, behind))
    steady = (run.record[:, 0, Y] > 10.0) & (run.record[:, 0, Y] < 50.0)
    assert run.record[steady, 1, VELOCITY] == pytest.approx(0.8, abs=0.01)


def test_a_follower_is_free_once_its_leader_has_left_the_leg(build: Any, drive: Any) -> None:
    slow = [build.leg((0, 0), (0, 20), speed_mps=0.5), build.leg((0, 20), (0, 40), speed_mps=0.5)]
    run: SimulationRun = drive(build.plan(slow, [build.leg((3, -12), (3, 60), follow=FollowOrder(0, 0))]))
    left = first(run.record[:, 0, LEG] == 1)
    assert run.record[left - 20 : left, 1, VELOCITY] == pytest.approx(0.5, abs=0.02)
    assert run.record[left + 40, 1, VELOCITY] == pytest.approx(SPEED, abs=0.1)


def test_a_switch_back_changes_gear_twice(build: Any, drive: Any) -> None:
    plan: Plan = build.plan(build.switch_back())
    run: SimulationRun = drive(plan)
    record = run.record[:, 0]
    assert run.outcome == "done"
    back = record[:, LEG] == 2
    assert (record[back, STATUS] == REVERSING).all()
    assert record[back, VELOCITY].min() == pytest.approx(-1.0, abs=0.05)
    # From forward standstill to reverse motion passes the time to shift.
    change = first(back)
    assert abs(record[change, VELOCITY]) < 0.05
    assert (np.abs(record[change : change + 14, VELOCITY]) < 0.05).all()
    assert record[~back, VELOCITY].min() > -0.05
    assert np.hypot(*(record[-1, :2] - [3.0, 0.0])) < 0.7


def test_speeds_of_legs_are_held_and_reached_in_time(build: Any, drive: Any) -> None:
    legs = [build.leg((0, 20 * i), (0, 20 * i + 20), speed_mps=speed) for i, speed in enumerate((1.2, 0.6, 1.8))]
    record = drive(build.plan(legs)).record[:, 0]
    for i, speed in enumerate((1.2, 0.6, 1.8)):
        steady = record[(record[:, Y] > 20 * i + 8.0) & (record[:, Y] < 20 * i + 16.0)]
        assert steady[:, VELOCITY] == pytest.approx(speed, abs=0.07)
    assert np.abs(np.diff(record[:, VELOCITY])).max() < 0.1 * 0.7 * 1.3, "never much above 0.7 m/s^2"


@pytest.mark.parametrize(("length", "speed"), [(0.5, SPEED), (6.0, SPEED), (40.0, SPEED), (40.0, 0.5), (40.0, 2.5)])
def test_tractors_stop_at_the_end_of_their_path(build: Any, drive: Any, length: float, speed: float) -> None:
    run: SimulationRun = drive(build.plan([build.leg((0, 0), (0, length), speed_mps=speed)]))
    assert -0.17 < run.record[-1, 0, Y] - length < 0.16
    assert abs(run.record[-1, 0, VELOCITY]) < 0.03
    assert run.finish_s[0] == run.duration_s == pytest.approx(run.time_s[-1])


def test_statuses_add_up_to_the_time(build: Any, drive: Any) -> None:
    gated = build.two_passes(3.0)
    gated[1] = gated[1].copy_with_gates([LegGate(0, 2, 10.0)])
    run: SimulationRun = drive(build.plan(build.two_passes(), gated))
    seconds = run.sum_seconds_by_status()
    total = sum(seconds.values()) + run.sum_seconds(FINISHED)
    assert total == pytest.approx(np.full(2, len(run.time_s) * 0.1))
    assert (seconds["reversing"] == 0.0).all()
    assert seconds["waiting"][0] == 0.0 and seconds["waiting"][1] > 10.0
    # Two passes of 30 m at 5 km/h are 43.2 s; starting and stopping cost some 1.5 s each, the gate as much again.
    assert (seconds["working"] > 43.2).all() and (seconds["working"] < 43.2 + 5.0).all()
    assert seconds["turning"][0] == pytest.approx(np.pi * 4.5 / SPEED, abs=3.0)
    legs = run.record[:, 0, LEG]
    assert (np.diff(legs) >= 0).all() and set(legs) == {0.0, 1.0, 2.0}
    assert set(run.record[:, 0, STATUS]) == {WORKING, TURNING, FINISHED}


def test_a_run_that_takes_too_long_is_a_timeout(build: Any, drive: Any) -> None:
    run: SimulationRun = drive(build.plan([build.leg((0, 0), (0, 2000))]), max_time_s=600.0)
    assert run.outcome == "timeout"
    assert run.time_s[-1] == pytest.approx(600.0, abs=0.2)
    assert np.isnan(run.finish_s).all()


@pytest.mark.parametrize("slow", [False, True])
def test_a_stop_lasts_as_long_as_planned_and_is_no_stall(build: Any, drive: Any, slow: bool) -> None:
    legs = [build.leg((0, 0), (0, 10)), build.leg((0, 10), (0, 20))]
    legs[1] = replace(legs[1], stand_s=150.0)
    run: SimulationRun = drive(build.plan(legs), slow=slow)
    stands = np.flatnonzero(run.record[:, 0, STATUS] == STANDING)
    assert run.outcome == "done", "whoever stands longer than a stall lasts is at work"
    assert run.standing_s == pytest.approx([150.0], abs=0.11)
    assert (np.diff(stands) == 1).all() and set(run.record[stands, 0, LEG]) == {1.0}
    assert run.record[stands, 0, Y] == pytest.approx(10.0, abs=0.2)
    free: SimulationRun = drive(build.plan([legs[0], replace(legs[1], stand_s=0.0)]), slow=slow)
    assert free.standing_s == pytest.approx([0.0])
    assert 150.0 < run.duration_s - free.duration_s < 150.0 + 8.0, "and the time to stop and move off again"


def test_a_stop_begins_when_the_gates_are_open(build: Any, drive: Any) -> None:
    lead = [build.leg((9, 0), (9, 40), speed_mps=0.5)]
    legs = [build.leg((0, 0), (0, 5)), replace(build.leg((0, 5), (0, 9), gates=(LegGate(0, 0, 30.0),)), stand_s=20.0)]
    run: SimulationRun = drive(build.plan(lead, legs))
    begun = first(run.record[:, 1, STATUS] == STANDING)
    assert run.record[begun, 0, Y] == pytest.approx(30.0, abs=0.2)
    assert run.standing_s == pytest.approx([0.0, 20.0], abs=0.11)


def test_a_stop_may_come_before_the_first_leg_and_at_a_change_of_gear(build: Any, drive: Any) -> None:
    ahead, back = build.leg((0, 0), (0, 12)), build.leg((0, 12), (0, 4), gear=-1)
    run: SimulationRun = drive(build.plan([replace(ahead, stand_s=7.0), replace(back, stand_s=5.0)]))
    assert run.outcome == "done"
    assert run.standing_s == pytest.approx([12.0], abs=0.21)
    assert (run.record[:69, 0, STATUS] == STANDING).all()


@pytest.mark.parametrize("slow", [False, True])
def test_a_stop_before_a_very_short_leg_is_completed(build: Any, drive: Any, slow: bool) -> None:
    ends = ((0, 0), (0, 10), (0, 10.06), (0, 30))
    legs = [build.leg(*pair) for pair in pairwise(ends)]
    legs[1] = replace(legs[1], stand_s=40.0)
    run: SimulationRun = drive(build.plan(legs), slow=slow)
    assert run.outcome == "done" and run.standing_s == pytest.approx([40.0], abs=0.11)
