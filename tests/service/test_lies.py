"""Robots that lie, written for the test: what is noticed of them, how soon, and who keeps away; and honest ones."""

import itertools
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import planner.guide
from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.alarms import CRITICAL
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import (
    AUTOMATIC,
    POSITIONS,
    PROGRESS,
    SPEED,
    STOPPED,
    Hold,
    MotionDoubt,
    TractorReport,
)
from planner.fleet.safety.compliance import note_standing
from planner.fleet.safety.credible_motion import FIX_M, UNCORRECTED_M, CredibleMotion, compute_doubt_m, compute_limit_m
from planner.fleet.safety.motion_prediction import PossibleArea
from tests.benchmarks import lies
from tests.benchmarks.clean_motion import drive
from tests.service.fleets import SimulatedFleet, fleet_plan, restart_manager, start_fleet
from tests.service.liars import (
    FIELDS,
    HIDDEN,
    LIES_S,
    LONG,
    SPEED_MPS,
    STATED,
    Scene,
    freeze,
    lose_operator,
    meet,
    stop,
)
from tests.service.test_neighbours import NORTH, SOUTH, Ground, alarms, lane

FROZEN = [freeze("easting_m"), freeze("northing_m")]
FLOATING = (
    (-1.0, -64.332, 2.794), (-0.8, -64.309, 2.792), (-0.5, -64.304, 2.759), (-0.2, -64.353, 2.747),
    (0.0, -64.408, 2.689), (0.2, -64.344, 2.661), (0.5, -64.062, 2.627), (0.7, -63.888, 2.592),
    (0.9, -63.744, 2.553), (1.1, -63.639, 2.537), (1.3, -63.513, 2.484), (1.5, -63.366, 2.474),
)  # fmt: skip
"""Seconds and metres of a fix that goes away by a leap, smoothed, and 0.3 s later back as corrections return."""
NORTH_RAD = 0.5 * math.pi


def test_who_says_it_stands_while_its_positions_go_on_drives_on_and_its_area_grows() -> None:
    scene = stop(list(STATED.values()), seconds=10.0)
    assert scene.seen["contradiction (warning)"] <= 1.2 and scene.seen["drives on"] <= 2.0
    (alarm,) = [alarm for alarm in scene.fleets[0].manager.alarms.list_alarms() if alarm.code == "drives on"]
    assert alarm.level == CRITICAL and not alarm.over
    doubt = scene.state.doubt
    assert doubt.speed_mps == pytest.approx(SPEED_MPS, abs=0.05)
    assert doubt.radius_m == pytest.approx(10.0 * SPEED_MPS, abs=0.5)  # since it began to lie
    scene.run(3.0)
    assert doubt.radius_m == pytest.approx(13.0 * SPEED_MPS, abs=0.5)
    assert math.dist(scene.robots[0].place[:2], doubt.pose[:2]) <= doubt.radius_m + 0.3, "it is where it may be"


@pytest.mark.parametrize("name", HIDDEN)
def test_a_clock_that_leaps_and_rare_reports_hide_nothing(name: str) -> None:
    scene = stop(HIDDEN[name], seconds=12.0)
    assert scene.seen["contradiction (warning)"] < 8.0 and scene.seen["drives on"] < 10.0
    still = stop(HIDDEN[name][1:], obeys=True)
    assert "contradiction (warning)" not in still.seen and still.state.doubt is None


def test_the_time_of_states_that_waited_counts_and_that_of_a_clock_that_was_set_does_not() -> None:
    """2 m/s for a minute: 5 s without a link and all states after it, and a clock set forward and back."""
    motion = CredibleMotion(1.1, 3.0)
    for number in range(600):
        now = 0.1 * number
        arrived_s = 25.0 if 20.0 <= now < 25.0 else now
        told_s = now + (3600.0 if 30.0 <= now < 40.0 else 0.0)
        report = TractorReport(0.0, 2.0 * now, math.pi / 2, 2.0, mode=AUTOMATIC)
        motion.add_report(report, np.array([0.0, 2.0 * now, math.pi / 2]), told_s, arrived_s)
    assert motion.doubt is None
    rare = CredibleMotion(1.1, 3.0)  # states that waited for the first link
    for number in range(8):
        report = TractorReport(0.0, 3.0 * number, math.pi / 2, 2.0, mode=AUTOMATIC)
        rare.add_report(report, np.array([0.0, 3.0 * number, math.pi / 2]), 1.5 * number, 15.0, 15.0 - 1.5 * number)
    assert rare.doubt is None


def test_one_that_obeys_and_tells_the_truth_is_neither_doubted_nor_told_of() -> None:
    for watched in (stop([], obeys=True), lose_operator([], obeys=True)):
        assert watched.seen == {} and watched.state.doubt is None
    scene = Scene(lane(*LONG), obeys=True)
    scene.start()
    scene.run(100.0)
    assert scene.seen == {} and scene.robots[0].at_m > 90.0


def test_a_receiver_that_froze_is_doubted_within_two_seconds_and_its_robot_held_until_an_operator_looked() -> None:
    scene = Scene(lane(*LONG), lies=FROZEN, obeys=True)
    scene.start()
    scene.run(LIES_S + 5.0)
    manager, doubt = scene.fleets[0].manager, scene.state.doubt
    again = restart_manager(manager, scene.now, 0.0, away_s=60.0)
    again.update_fleet(0.0)
    kept = again.states[0].doubt
    assert Hold.DOUBTED in again.states[0].holds and kept is not None, "a doubt outlives a restart of the service"
    assert kept.radius_m == pytest.approx(65.0 * SPEED_MPS, abs=0.5)
    assert (kept.pose, kept.speed_mps) == (doubt.pose, doubt.speed_mps)
    scene.run(15.0)
    assert scene.seen["contradiction (warning)"] <= 2.0 and "drives on" not in scene.seen
    assert Hold.DOUBTED in scene.state.holds and doubt.suspect == POSITIONS
    assert scene.robots[0].speed_mps == 0.0, "it was held"
    assert scene.robots[0].at_m == pytest.approx(LIES_S * SPEED_MPS, abs=3.5)
    assert doubt.radius_m == pytest.approx(20.0 * SPEED_MPS, abs=1.0)
    manager.operators.resume_tractors("anna", None, scene.now)
    scene.run(0.2)
    assert Hold.DOUBTED in scene.state.holds, "who resumes all has not looked at one"
    with pytest.raises(FleetManagerError, match="contradict each other"):
        manager.operators.take_lease("anna", 0, False, scene.now)
        manager.operators.send_command("anna", 0, 0.0, 1.0, scene.now)
    manager.operators.return_lease("anna", 0, scene.now)
    scene.robots[0].lies = ()
    manager.operators.resume_tractors("anna", 0, scene.now)
    scene.run(10.0)
    assert scene.state.doubt is None and scene.robots[0].speed_mps == SPEED_MPS
    assert all(alarm.over for alarm in manager.alarms.list_alarms())
    assert ("anna", "looked") in [(event.who, event.what) for _, event in scene.fleets[0].events]


def test_one_that_stands_as_its_fix_leaps_away_and_back_is_not_doubted() -> None:
    """The receiver goes over to each fix with a time constant of 2.5 s; both leaps together look like a steady way."""
    motion, (_, x_m, y_m) = CredibleMotion(0.0, 3.0), FLOATING[0]
    before = [(0.2 * number - 9.0, x_m, y_m) for number in range(40)]
    for at_s, east_m, north_m in (*before, *FLOATING):
        report = TractorReport(east_m, north_m, -math.pi / 2, 0.0, mode=AUTOMATIC)
        motion.add_report(report, None, at_s, at_s)
    assert motion.doubt is None


@pytest.mark.parametrize("gain_mps2", [0.5, 1.0])
def test_one_that_says_that_it_stands_from_where_it_turns_back_is_doubted(gain_mps2: float) -> None:
    """It drives 6 m to and fro at 1 m/s, and gains speed and brakes as tractors do."""
    motion, rng = CredibleMotion(0.0, 3.0), np.random.default_rng(1)
    now_s, at_m, speed_mps, way, lied_s = 0.0, 0.0, 0.0, 1.0, 0.0
    while motion.doubt is None and lied_s < 30.0:
        ahead_m = 6.0 - at_m if way > 0.0 else at_m
        brakes = ahead_m <= 0.5 * speed_mps**2 / gain_mps2 + 0.05
        goal_mps = 0.0 if brakes else way
        speed_mps += float(np.clip(goal_mps - speed_mps, -0.1 * gain_mps2, 0.1 * gain_mps2))
        way = -way if brakes and abs(speed_mps) < 1e-9 else way
        at_m += 0.1 * speed_mps
        lied_s += 0.1 * (lied_s > 0.0 or way < 0.0)
        east_m, north_m = rng.normal(0.0, 0.012, 2)
        told_mps = 0.0 if lied_s > 0.0 else speed_mps
        now_s += 0.1
        report = TractorReport(east_m, north_m + at_m, math.pi / 2, told_mps, mode=AUTOMATIC)
        motion.add_report(report, None, now_s, now_s)
    assert 1.0 < lied_s <= 4.0


@pytest.mark.parametrize("order", ["fail", "leave out"])
def test_one_in_doubt_that_fails_or_is_left_out_stays_in_doubt_until_an_operator_looked(order: str) -> None:
    fleet = start_doubt()
    manager = fleet.manager
    fleet.run(30.0)
    if order == "fail":
        manager.operators.mark_failed("anna", 0, fleet.now)
    else:
        manager.operators.adopt_plan("anna", manager.plan, fleet.now, [0])
    fleet.run(1.0)
    doubt = manager.states[0].doubt
    assert doubt is not None and doubt.radius_m == pytest.approx(31.0)
    assert Hold.TOO_NEAR in manager.states[1].holds and "looked" not in fleet.events
    (alarm,) = [alarm for alarm in manager.alarms.list_alarms() if alarm.code == "contradiction"]
    manager.obstacle_reports.acknowledge_alarm("anna", alarm.id, fleet.now)
    fleet.run(10.0)
    assert manager.states[0].doubt is None and fleet.standing == [True, False]


def start_doubt(radius_m: float = 0.0) -> SimulatedFleet:
    """A fleet of two that drive side by side, and the place of the first is in doubt from now on."""
    fleet = start_fleet(fleet_plan(2, 10))
    fleet.run(5.0)
    pose = 0.0, fleet.at_m[0], math.pi / 2
    fleet.manager._start_doubt(0, MotionDoubt(POSITIONS, radius_m, {}, pose, 1.0), fleet.now)
    return fleet


def test_who_says_it_looked_by_the_alarm_does_not_let_the_tractor_drive() -> None:
    fleet = start_doubt()
    fleet.run(1.0)
    (alarm,) = fleet.manager.alarms.list_alarms()
    fleet.manager.obstacle_reports.acknowledge_alarm("anna", alarm.id, fleet.now)
    fleet.run(2.0)
    assert fleet.manager.states[0].doubt is None and fleet.standing == [True, False]
    fleet.manager.operators.resume_tractors("anna", 0, fleet.now)
    fleet.run(2.0)
    assert fleet.standing == [False, False]


def test_the_area_grows_with_the_greatest_credible_speed_since_the_doubt_began() -> None:
    motion, moved_m = CredibleMotion(1.1, 3.0), 0.0
    for number in range(400):
        now, speed_mps = 0.1 * number, 0.3 if number < 200 else 3.0
        moved_m += 0.1 * speed_mps
        report = TractorReport(0.0, moved_m, math.pi / 2, 0.0, mode=AUTOMATIC)  # it says that it stands
        motion.add_report(report, None, now, now)
        if number == 199:
            assert motion.doubt is not None and motion.measure_speed_mps() == pytest.approx(0.3)
    assert motion.measure_speed_mps() == pytest.approx(3.0)


@pytest.mark.parametrize("name", ["speed_mps", "positions", "leg", "all it says of standing"])
def test_who_is_met_head_on_stands_as_far_from_a_liar_as_from_one_that_only_does_not_stop(name: str) -> None:
    lie = {"positions": FROZEN, "all it says of standing": list(STATED.values())}.get(name) or [FIELDS[name]]
    _, plain_m = meet([])
    scene, apart_m = meet(lie)
    assert apart_m >= plain_m
    assert Hold.TOO_NEAR in scene.fleets[1].manager.states[0].holds
    assert scene.fleets[1].manager.find_remote_command_harm(0, 1.0, 0.0) is not None


def test_the_distance_from_an_area_is_that_of_the_outline_from_its_circle() -> None:
    area = PossibleArea(0, np.array([0.0, 0.0]), np.array([2.0, 3.0, 4.0]), 0.5, 0.65)
    boxes = np.array([[-1.0, 3.0, 1.0], [-2.0, -1.0, 2.0]])  # tail, nose, half width
    ahead = np.array([[-10.0, 0.0, 0.0]] * 3)  # it looks at the area: 7 m from its nose
    beside = np.array([[1.0, 6.0, 0.0]] * 3)  # 5 m from its side, 4 m from that of its implement, which is 2 m behind
    assert area.measure_distances_m(ahead, boxes) == pytest.approx([5.0, 4.0, 3.0])
    assert area.measure_distances_m(beside, boxes) == pytest.approx([2.0, 1.0, 0.0])
    assert area.measure_distances_m(np.array([[-2.0, 0.0, 0.0]]), boxes) == pytest.approx([-2.0])


def test_others_of_its_fleet_stand_before_its_area_reaches_them_and_go_on_after_it() -> None:
    fleet = start_doubt()
    manager, pose = fleet.manager, (0.0, fleet.at_m[0], math.pi / 2)
    fleet.run(1.0)
    assert fleet.standing == [True, False], "it is held at once, the other not before it must be"
    fleet.run(29.0)
    assert fleet.standing == [True, True] and Hold.TOO_NEAR in manager.states[1].holds
    apart_m = math.dist(pose[:2], (20.0, fleet.at_m[1])) - manager.guard.reach_m
    stood_s = fleet.at_m[1] - pose[1]  # at 1 m/s
    assert stood_s < apart_m, "as it came to stand the other could not have been there yet"
    manager.operators.resume_tractors("anna", 0, fleet.now)
    fleet.run(10.0)
    assert fleet.standing == [False, False] and manager.states[0].doubt is None


def test_an_area_that_is_reached_already_has_no_distance_in_its_alarm() -> None:
    fleet = start_doubt(30.0)
    fleet.run(1.0)
    (alarm,) = [alarm for alarm in fleet.manager.alarms.list_alarms() if alarm.code == "near 2"]
    assert alarm.sentence.endswith("may be too near in 0.0 s: the place of one is in doubt.")


@pytest.mark.parametrize("speed_mps", [0.3, 1.0, 3.0])
def test_the_time_to_a_doubt_is_that_in_which_the_difference_exceeds_the_noise(speed_mps: float) -> None:
    motion, froze_s = CredibleMotion(1.1, 3.0), 10.0
    for number in range(1000):
        now = 0.1 * number
        shown_m = speed_mps * min(now, froze_s)
        report = TractorReport(0.0, shown_m, math.pi / 2, speed_mps, mode=AUTOMATIC)
        motion.add_report(report, np.array([0.0, speed_mps * now, math.pi / 2]), now, now)
        if motion.doubt is not None:
            break
    waited_s = now - froze_s
    assert motion.doubt is not None and motion.doubt.suspect == POSITIONS
    assert motion.doubt.speed_mps == pytest.approx(speed_mps, rel=0.01)
    exceeds_s = next(
        t
        for t in np.arange(0.05, 60.0, 0.05)
        if speed_mps * t > compute_doubt_m(float(t), speed_mps * float(t), speed_mps)
    )
    assert exceeds_s - 0.2 <= waited_s <= 1.3 * exceeds_s + 0.4


def test_the_suspect_is_whom_the_others_contradict() -> None:
    for suspect, moved in ((POSITIONS, (0.0, 1.0, 1.0)), (SPEED, (1.0, 0.0, 1.0)), (PROGRESS, (1.0, 1.0, 0.0))):
        motion, now = CredibleMotion(1.1, 3.0), 0.0
        while motion.doubt is None and now < 60.0:
            now += 0.1
            position_m, speed_mps, leg_m = moved[0] * now, moved[1], moved[2] * now
            report = TractorReport(0.0, position_m, math.pi / 2, speed_mps, mode=AUTOMATIC)
            motion.add_report(report, np.array([0.0, leg_m, math.pi / 2]), now, now)
        assert motion.doubt is not None and motion.doubt.suspect == suspect


def test_the_credible_speed_of_one_that_leaps_and_boasts_is_one_that_tractors_have() -> None:
    motion, moved_m = CredibleMotion(1.1, 3.0), 0.0
    for number in range(60):
        speed_mps = 1.0 if number < 50 else 49.0
        moved_m += 0.1 * speed_mps * (1.0 if number < 50 else 4.0)
        report = TractorReport(0.0, moved_m, math.pi / 2, speed_mps, mode=AUTOMATIC)
        motion.add_report(report, np.array([0.0, moved_m, math.pi / 2]), 0.1 * number, 0.1 * number)
    assert motion.doubt is not None and 1.0 <= motion.doubt.speed_mps <= 50.0 / 3.6


def test_an_error_that_leaps_as_corrections_are_lost_is_no_doubt_and_one_that_no_receiver_has_is() -> None:
    for leap_m, is_doubted in ((3.0 * UNCORRECTED_M, False), (20.0 * UNCORRECTED_M, True)):
        motion = CredibleMotion(1.1, 3.0)
        for number in range(200):
            now = 0.1 * number
            report = TractorReport(leap_m if now > 5.0 else 0.0, now, math.pi / 2, 1.0, mode=AUTOMATIC)
            motion.add_report(report, np.array([0.0, now, math.pi / 2]), now, now)
        assert (motion.doubt is not None) == is_doubted


@pytest.mark.parametrize("turned_deg", [0.0, 25.0])
def test_two_leaps_that_a_receiver_smooths_are_no_doubt_of_one_that_stands(turned_deg: float) -> None:
    """1 m and 0.7 m, 0.9 s apart, each smoothed over 1 s: the one takes over as the other fades."""
    motion, way_rad = CredibleMotion(1.1, 3.0), np.radians([20.0, 20.0 + turned_deg])
    for number in range(200):
        now = 0.1 * number
        shares = -np.expm1(-np.maximum(now - np.array([10.0, 10.9]), 0.0))
        x_m, y_m = np.array([1.0, 0.7]) * shares @ np.column_stack([np.cos(way_rad), np.sin(way_rad)])
        motion.add_report(TractorReport(float(x_m), float(y_m), math.pi / 2, 0.0), None, now, now)
    assert motion.doubt is None


def test_a_receiver_that_freezes_in_a_turn_is_doubted_as_soon_as_on_a_straight_way() -> None:
    doubted_s = []
    for radius_m in (5.0, 1e6):
        motion, speed_mps = CredibleMotion(0.0, 3.0), 1.2
        for number in range(200):
            angle = speed_mps * 0.1 * number / radius_m
            shown = speed_mps * min(0.1 * number, 10.0) / radius_m
            x_m, y_m = radius_m * math.sin(shown), radius_m * (1.0 - math.cos(shown))
            motion.add_report(TractorReport(x_m, y_m, angle, speed_mps), None, 0.1 * number, 0.1 * number)
            if motion.doubt is not None:
                break
        doubted_s.append(0.1 * number - 10.0)
    assert doubted_s[0] <= doubted_s[1] + 0.15 < 2.0


def test_the_limit_is_that_of_the_stated_noise() -> None:
    """At once it is the noise of two fixes, after long that of two unrelated errors; by hand, for one false doubt in
    10,000 h: sqrt(2 ln(1e4 * 3600 * 10 * 9 * 3)) = 6.782."""
    assert compute_limit_m(0.0, 0.0) == pytest.approx(6.782 * math.sqrt(2.0) * FIX_M, rel=1e-3)
    assert compute_limit_m(1e9, 0.0) == pytest.approx(6.782 * math.sqrt(2.0 * (FIX_M**2 + UNCORRECTED_M**2)), rel=1e-3)
    assert compute_limit_m(0.0, 10.0) - compute_limit_m(0.0, 0.0) == pytest.approx(1.5)


@pytest.mark.slow
def test_honest_tractors_with_bad_receivers_are_not_doubted() -> None:
    """An hour of each of three; `python -m tests.benchmarks.clean_motion` drives a hundred hours of fifty."""
    assert [drive(seed, 36_000, -1)[0] for seed in range(3)] == [0] * 3
    doubts, first = drive(1, 6000, 3000)  # the same truth, and a speed that says it stands
    assert doubts > 0 and 3000 <= first <= 3100


def test_a_fleet_in_local_metres_beside_one_with_coordinates_stands_until_an_operator_answers() -> None:
    ground = Ground(lane(*NORTH), lane(*SOUTH, crs="EPSG:32632"))
    one, other = ground.fleets

    def run(seconds: float) -> None:
        for _ in range(round(10 * seconds)):
            ground.now += 0.1
            for fleet in ground.fleets:
                fleet.step(ground.now)

    ground.start()
    run(10.0)
    assert one.at_m == 0.0 and Hold.UNPLACED in one.manager.states[0].holds
    assert other.at_m > 5.0, "it can be placed"
    assert "does not move until an operator answers" in alarms(one)[0] and "No distance is kept" in alarms(other)[0]
    one.manager.operators.resume_tractors("anna", None, ground.now)
    one.manager.operators.resume_tractors("anna", 0, ground.now)
    run(1.0)
    assert one.at_m == 0.0, "an order to drive says nothing of the distance"
    (alarm,) = one.manager.alarms.list_alarms()
    one.manager.obstacle_reports.acknowledge_alarm("anna", alarm.id, ground.now)
    run(5.0)
    assert one.at_m > 2.0
    assert one.events.count("answered for the distance") == 1
    third = lane(*NORTH, crs="EPSG:32633")
    ground.hood.add("c", "c", FleetManager(third, FleetRules()), lambda: None, ground.now)
    run(3.0)
    assert Hold.UNPLACED in one.manager.states[0].holds, "nobody has answered for this one yet"


def test_where_it_stood_before_it_could_hear_the_order_is_not_held_against_it() -> None:
    """It stood of its own accord as its link went away and the order came, drove on for 6 m, heard it and stood."""
    report = TractorReport(0.0, 0.0, math.pi / 2, 0.0, mode=AUTOMATIC)
    order = {"standing_ordered": True, "ordered_since_s": None, "stood_at": None, "holds": set()}
    state: Any = SimpleNamespace(report=report, last_contact_s=99.0, delay_s=0.0, **order)
    for now in (100.0, 101.0, 104.0):
        note_standing(state, now, FleetRules())
    assert state.stood_at is None, "nothing was heard since the order"
    state.report, state.last_contact_s = report._replace(y_m=6.0, mode=STOPPED), 104.5
    note_standing(state, 104.5, FleetRules())
    assert state.stood_at == (0.0, 6.0)
    state.report = report._replace(y_m=7.0, speed_mps=0.0)
    note_standing(state, 105.0, FleetRules())
    assert state.stood_at == (0.0, 6.0), "however slowly it goes from there"
    state.standing_ordered = False
    note_standing(state, 106.0, FleetRules())
    assert state.stood_at is None and state.ordered_since_s is None


@pytest.mark.slow
@pytest.mark.parametrize("rows", [lies.ROWS[::4], pytest.param(lies.ROWS, marks=pytest.mark.matrix)])
def test_the_table_of_the_threat_model_is_what_is_noticed(rows: list[tuple[str, ...]]) -> None:
    guide = (Path(planner.guide.__file__).parent / "threat-model.md").read_text("utf-8")
    assert set(lies.format_table(rows).splitlines()) <= set(guide.splitlines())


@pytest.mark.matrix
@pytest.mark.parametrize("scene", list(lies.SCENES))
def test_every_pair_of_lies_raises_a_critical_alarm(scene: str) -> None:
    missed = []
    for names in itertools.combinations(FIELDS, 2):
        seen, _ = lies.watch(scene, names)
        if not any(lies.is_critical(code) and code != "refused" for code in seen):
            missed.append(names)
    assert missed == []


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
