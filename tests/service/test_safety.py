"""What must make a tractor stand, and keep it standing, by a clock that the tests turn."""

import asyncio
import json
import math
import re
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, get_args

import pytest

import planner.fleet
from planner.fleet.manager.danger_watch import NEAR_FLEET, UNKNOWN_GROUND
from planner.fleet.manager.fleet_state import DOUBT_CODE
from planner.fleet.manager.obstacle_reports import UNREADABLE_CODE
from planner.fleet.manager.operator_orders import NEIGHBOUR_STOPPED, RESTARTED
from planner.fleet.model.alarms import CRITICAL, WARNING, AlarmRegister
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import Hold, TractorOrder, TractorReport
from planner.fleet.session.clients import CONTROL, TRACTOR, FleetClient
from planner.fleet.session.fleet_session import UNRECORDED, FleetSession
from planner.fleet.session.inbound_frames import CommandFrame, TakeLeaseFrame
from planner.fleet.session.outbound_messages import AlarmCode
from planner.service.fleets.fleet_routes import build_asyncapi_document
from planner.service.fleets.twin_routes import FINDING
from tests.service.fleets import EG105, SimulatedFleet, fleet_plan, start_fleet
from vehicle.missions.plan import FollowOrder, LegGate, Mission

BALE = ((-1.0, 15.0), (1.0, 15.0), (1.0, 16.0), (-1.0, 16.0))


def live() -> tuple[FleetSession, FleetClient, FleetClient]:
    """A fleet with one tractor linked and one operator, whose outboxes nobody empties."""
    fleet = FleetSession("f", "small", fleet_plan(), FleetRules(), begin_s=0.0)
    tractor, operator = FleetClient(TRACTOR, "tractor 1", 0), FleetClient(CONTROL, "anna")
    fleet.add_client(tractor, 0.0)
    fleet.add_client(operator, 0.0)
    return fleet, tractor, operator


def remote(x: float = 0.0, y: float = 10.0, heading: float = math.pi / 2) -> SimulatedFleet:
    """A fleet whose first tractor is driven by an operator, and stands there."""
    fleet = start_fleet()
    fleet.run(1)
    fleet.manager.operators.take_lease("anna", 0, False, fleet.now)
    fleet.obey()
    fleet.silent = {0}
    fleet.manager.take_report(0, TractorReport(x, y, heading, 0.0, mode="remote"), fleet.now)
    return fleet


def waiting(client: FleetClient) -> list[dict[str, Any]]:
    """All that waits to be sent to a client, which takes it."""
    return [json.loads(asyncio.run(client.outbox.take_next_frame()) or "") for _ in range(len(client.outbox))]


def test_nothing_older_that_moves_a_tractor_arrives_after_a_stop_and_dropped_frames_are_told_once_more() -> None:
    fleet, tractor, _ = live()
    waiting(tractor)
    fleet.manager.operators.start_fleet_work("anna", 0.0)
    fleet.send_pending_outputs()
    fleet._send_order(TractorOrder(0, "command", {"steering_rad": 0.0, "speed_mps": 1.0}), False)
    fleet.manager.operators.stop_all("anna", 0.0)
    fleet.send_pending_outputs()
    fleet.manager.operators.resume_tractors("anna", None, 0.0)
    fleet.send_pending_outputs()
    assert [frame["kind"] for frame in waiting(tractor)] == ["stop", "resume"]
    fleet.manager.operators.stop_all("anna", 0.0)
    fleet.send_pending_outputs()
    for _ in range(600):
        tractor.send({"kind": "heartbeat"})
    fleet.step(1.0)
    kinds = [frame["kind"] for frame in waiting(tractor)]
    assert kinds[-3:-1] == ["release", "stop"] and "stop" not in kinds[:-3]


def test_a_lease_taken_over_or_again_stops_what_the_last_command_set_in_motion() -> None:
    for who in ("bert", "anna"):
        fleet = remote()
        fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
        fleet.manager.take_outputs()
        fleet.manager.operators.take_lease(who, 0, True, fleet.now)
        assert [(order.tractor, order.kind) for order in fleet.manager.take_outputs()[0]] == [(0, "stop")]


def driving_on(mode: str, speed: float, command: float, seconds: float) -> tuple[list[float], list[str]]:
    """When a tractor is told to stand that was stopped and reports this; the sentences of critical alarms."""
    tractor, told = Stopped(), list[float]()
    fleet = tractor.fleet
    fleet.obey()
    for _ in range(round(10 * seconds)):
        fleet.now += 0.1
        tractor.say(speed, mode, command)
        tractor.tick(0.0)
        orders = fleet.manager.take_outputs()[0]
        told += [fleet.now - tractor.begun_s for o in orders if o.tractor == 0 and o.kind == "stop"]
    items = fleet.manager.alarms.list_alarms()
    return told, [alarm.sentence for alarm in items if alarm.tractor == 0 and alarm.level == CRITICAL]


@pytest.mark.parametrize("mode", ["automatic", "remote", "manual"])
def test_one_that_drives_on_is_told_to_stand_every_second_and_everybody_is_told(mode: str) -> None:
    told, alarms = driving_on(mode, 1.0, 1.0, 3.0)
    assert told[0] <= 0.7 and len(told) == 3
    assert alarms == ["Tractor 1 was ordered to stop and drives on."]


def test_one_that_brakes_or_stands_is_not_told_again_and_one_that_never_stands_is() -> None:
    assert driving_on("stopped", 1.0, 0.0, 1.4) == ([], [])
    assert driving_on("automatic", 0.0, 0.0, 3.0) == ([], [])
    assert driving_on("stopped", 1.0, 0.0, 6.0)[0]


class Stopped:
    """A tractor at 1 m/s that is told to stand, and what it says after that, by a clock that the tests turn."""

    def __init__(self) -> None:
        self.fleet = start_fleet()
        self.fleet.run(5)
        self.fleet.silent = {0}
        self.say(1.0, "automatic", 1.0)
        self.fleet.manager.operators.stop_all("anna", self.fleet.now)
        self.begun_s = self.fleet.now

    def say(self, speed: float, mode: str, command: float, delay_s: float = 0.0) -> None:
        """It reports."""
        report = TractorReport(0.0, 5.0, math.pi / 2, speed, command, mode=mode, leg_m=5.0)
        self.fleet.manager.take_report(0, report, self.fleet.now, delay_s=delay_s)

    def tick(self, seconds: float = 0.1) -> None:
        """Time passes, and the centre looks."""
        self.fleet.now += seconds
        self.fleet.manager.update_fleet(self.fleet.now)

    @property
    def alarmed(self) -> bool:
        """Whether everybody is told that it drives on."""
        return self.fleet.manager.alarms.is_alarm_on("drives on", 0)


@pytest.mark.parametrize(("delay_s", "at_s"), [(0.0, 0.5), (0.3, 1.1), (0.8, 2.1), (9.0, 2.5)])
def test_how_long_one_may_drive_on_follows_from_how_long_its_reports_are_on_their_way(
    delay_s: float, at_s: float
) -> None:
    tractor = Stopped()
    while not tractor.alarmed:
        tractor.say(1.0, "automatic", 1.0, delay_s)
        tractor.tick()
        assert tractor.fleet.now < tractor.begun_s + 4.0
    assert tractor.fleet.now - tractor.begun_s == pytest.approx(at_s + 0.2, abs=0.15)  # by tenths of a second


@pytest.mark.parametrize("is_linked_slowly", [True, False])
def test_who_brakes_over_a_slow_link_or_by_a_mode_of_its_own_does_not_drive_on(is_linked_slowly: bool) -> None:
    tractor = Stopped()
    for step in range(50):
        tractor.tick()
        if is_linked_slowly:
            speed = max(1.0 - 0.5 * max(0.1 * step - 1.4, 0.0), 0.0)  # 0.7 s there and back
            told = ("automatic", 1.0) if step < 14 else ("stopped", 0.0)
            tractor.say(speed, *told, delay_s=0.7)
        else:
            speed = max(1.0 - 0.4 * 0.1 * step, 0.0)
            tractor.say(speed, "automatic", speed)
        assert not tractor.alarmed, step


def test_what_was_held_up_in_the_service_or_the_tractor_is_no_driving_on() -> None:
    tractor = Stopped()
    tractor.tick()
    tractor.fleet.now += 2.0  # nothing was sent and nothing taken
    for _ in range(20):
        tractor.say(1.0, "automatic", 1.0)
    tractor.tick(0.05)
    tractor.say(1.0, "automatic", 1.0)
    tractor.tick(0.05)
    assert not tractor.alarmed
    for _ in range(4):
        tractor.say(1.0, "automatic", 1.0)
        tractor.tick()
    assert tractor.alarmed, "it goes on driving all the same"


def test_an_operator_drives_without_being_told_to_stand_until_somebody_pauses_it() -> None:
    fleet = remote()
    for _ in range(20):
        fleet.now += 0.1
        fleet.manager.operators.send_command("anna", 0, 0.0, 0.5, fleet.now)
        report = TractorReport(0.0, 10.0, math.pi / 2, 0.5, 0.5, mode="remote", leg_m=10.0)
        fleet.manager.take_report(0, report, fleet.now)
        fleet.manager.update_fleet(fleet.now)
        assert "stop" not in [order.kind for order in fleet.manager.take_outputs()[0]]
    fleet.manager.operators.pause_tractors("bert", 0, fleet.now)
    with pytest.raises(FleetManagerError, match="paused"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
    fleet.manager.operators.take_lease("anna", 0, False, fleet.now)
    fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)


@pytest.mark.parametrize("order", ["pause_tractors", "mark_failed", "obstacle"])
def test_pause_failure_and_obstacle_stop_one_that_is_driven_by_hand_at_once(order: str) -> None:
    fleet = remote()
    fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
    fleet.manager.take_outputs()
    if order == "obstacle":
        fleet.manager.obstacle_reports.add("bert", BALE, "bale", fleet.now)
    else:
        getattr(fleet.manager.operators, order)("bert", 0, fleet.now)
    assert (0, "stop") in [(each.tractor, each.kind) for each in fleet.manager.take_outputs()[0]]
    assert fleet.manager.states[0].remote_command[1] == 0.0


def test_no_remote_command_leads_to_an_obstacle_and_one_leads_away() -> None:
    fleet = remote(10.0, 10.0)  # off its leg
    fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
    nose = 10.0 + EG105.length_m - EG105.rear_overhang_m - EG105.antenna_forward_m
    fleet.manager.take_outputs()
    fleet.manager.obstacle_reports.add("bert", tuple((x + 10.0, y + nose - 12.0) for x, y in BALE), "bale", fleet.now)
    assert "stop" not in [order.kind for order in fleet.manager.take_outputs()[0]]  # it stands within 2 m
    fleet.manager.obstacle_reports.add("bert", tuple((x + 10.0, y + nose - 13.0) for x, y in BALE), "stone", fleet.now)
    assert "stop" in [order.kind for order in fleet.manager.take_outputs()[0]]
    with pytest.raises(FleetManagerError, match="near an obstacle"):
        fleet.manager.operators.send_command("anna", 0, 0.0, 1.0, fleet.now)
    fleet.manager.operators.send_command("anna", 0, 0.0, -1.0, fleet.now)


@pytest.mark.parametrize(("leg", "leg_m"), [(9, 0.0), (9, 1e6), (2, 5.0), (1, 1e6), (0, 3.0)])
def test_a_place_where_a_tractor_cannot_be_is_no_progress_and_it_stands(leg: int, leg_m: float) -> None:
    fleet = start_fleet(fleet_plan(legs=10, gates={(1, 3): (LegGate(0, 8, 0.0),)}))
    fleet.run(25)
    before = fleet.manager.states[0]
    assert (before.leg, before.base_end) == (1, 2)
    known = before.leg, before.leg_m
    said = TractorReport(0.0, 25.0, math.pi / 2, 1.0, 1.0, leg=leg, leg_m=leg_m, done=leg == 9)
    fleet.manager.take_report(0, said, fleet.now)
    assert (before.leg, before.leg_m, before.done) == (*known, False)
    assert Hold.ASTRAY in before.holds
    assert [(order.tractor, order.kind) for order in fleet.manager.take_outputs()[0]] == [(0, "stop")]
    assert [alarm.level for alarm in fleet.manager.alarms.list_alarms()] == [CRITICAL]
    fleet.run(1)  # it says where it is again
    assert not before.holds and fleet.at_m[0] > 25.0


@pytest.mark.parametrize("lost", ["failed", "silent", "gone", "unheard"])
def test_who_follows_one_that_is_lost_stands(lost: str) -> None:
    plan = fleet_plan(length_m=100.0)
    second = plan.timed_missions[1]
    legs = tuple(replace(leg, follow=FollowOrder(0, leg_number)) for leg_number, leg in enumerate(second.legs))
    fleet = start_fleet(replace(plan, timed_missions=(plan.timed_missions[0], replace(second, mission=Mission(legs)))))
    told = []
    for step in range(30):
        fleet.now += 0.1
        for number in (0, 1) if step < 10 or lost != "silent" else (1,):
            report = TractorReport(20.0 * number, 15.0 - 15.0 * number, math.pi / 2, 1.0, 1.0)
            fleet.manager.take_report(number, report, fleet.now)
        if step == 10 and lost == "failed":
            fleet.manager.operators.mark_failed("anna", 0, fleet.now)
        if step == 10 and lost == "gone":
            fleet.manager.disconnect_tractor(0, fleet.now, is_orderly=True)
        if step == 10 and lost == "unheard":
            fleet.manager.states[0].report = None
            fleet.manager.connect_tractor(1, fleet.now)
        fleet.manager.update_fleet(fleet.now)
        orders = [o for o in fleet.manager.take_outputs()[0] if o.tractor == 1 and o.kind == "release"]
        told += [order.data["limit_mps"] for order in orders]
    assert 1.0 in told and 0.0 in told and None not in told


def test_an_alarm_that_rises_or_says_something_else_has_to_be_seen_anew_and_is_told_by_kind_with_whom_else() -> None:
    alarms = AlarmRegister()
    first = alarms.raise_alarm("near 2", 0, WARNING, "Within 2.30 m in 4.0 s.", 0.0)
    assert first is not None
    alarms.acknowledge(first.id, "anna")
    version = alarms.version
    assert alarms.raise_alarm("near 2", 0, WARNING, "Within 2.30 m in 4.0 s.", 1.0) is None
    assert alarms.version == version
    assert alarms.raise_alarm("near 2", 0, WARNING, "Within 2.10 m in 3.5 s.", 1.0) is None
    (alarm,) = alarms.list_alarms()
    assert alarms.version > version and (alarm.acknowledged, alarm.sentence) == ("anna", "Within 2.10 m in 3.5 s.")
    risen = alarms.raise_alarm("near 2", 0, CRITICAL, "Within 0.40 m in 1.0 s.", 2.0)
    assert risen is not None and (risen.id, risen.level, risen.acknowledged) == (first.id, CRITICAL, None)
    assert alarms.raise_alarm("near 2", 0, WARNING, "Within 0.50 m in 1.5 s.", 3.0) is None
    assert alarms.list_alarms()[0].level == CRITICAL
    alarms.acknowledge(first.id, "anna")
    assert alarms.raise_alarm("near 2", 0, CRITICAL, "They touch.", 4.0) is not None
    assert [alarm.acknowledged for alarm in alarms.list_alarms()] == [None]
    for code, tractor in (("obstacle 11", None), ("drives on", 1), ("near fleet/f1 3", 1)):
        alarms.raise_alarm(code, tractor, WARNING, "A sentence.", 5.0)
    told = {(each["code"], each["related_number"], each["tractor"]) for each in alarms.describe_alarms()}
    assert told == {("near", 2, 1), ("obstacle", 11, None), ("drives on", None, 2), ("near fleet", 3, 2)}


@pytest.mark.parametrize(
    ("gear", "heading", "goes"),
    [(1, 60, True), (1, 130, True), (1, 200, False), (1, 270, False), (-1, 270, True), (-1, 90, False)],
)
def test_one_that_was_driven_by_hand_goes_on_only_when_it_heads_along_its_leg(
    gear: int, heading: int, goes: bool
) -> None:
    fleet = remote(heading=math.radians(heading))
    state = fleet.manager.states[0]
    legs = tuple(replace(leg, gear=gear) for leg in state.mission.legs)  # they lead north
    state.mission = replace(state.mission, mission=Mission(legs))
    fleet.manager.operators.return_lease("anna", 0, fleet.now)
    if not goes:
        with pytest.raises(FleetManagerError, match="degrees away from its leg"):
            fleet.manager.operators.resume_tractors("bert", 0, fleet.now)
        fleet.manager.operators.resume_tractors("bert", None, fleet.now)
    else:
        fleet.manager.operators.resume_tractors("bert", 0, fleet.now)
    assert (Hold.REMOTE_CONTROL not in fleet.manager.states[0].holds) == goes


def drive(sequence: int, age_s: float = 0.0, speed: float = 1.0) -> CommandFrame:
    """A remote command to tractor 1 of the operator."""
    at = datetime.now(UTC) - timedelta(seconds=age_s)
    return CommandFrame(
        kind="command", sequence=sequence, time=at, tractor=1, steering_command_deg=0.0, speed_command_mps=speed
    )


def test_a_command_that_comes_late_or_again_is_not_driven_and_one_to_stand_always_is() -> None:
    fleet, tractor, operator = live()
    fleet.manager.take_report(0, TractorReport(0.0, 10.0, math.pi / 2, 0.0, mode="remote"), 0.0)
    fleet.carry_out(operator, TakeLeaseFrame(kind="lease", tractor=1), 0.0)
    fleet.carry_out(operator, drive(5), 0.0)
    for late in (drive(6, age_s=0.8), drive(6, age_s=-2.0), drive(5), drive(4)):
        with pytest.raises(FleetManagerError, match="was ignored"):
            fleet.carry_out(operator, late, 0.0)
    fleet.carry_out(operator, drive(2, age_s=60.0, speed=0.0), 0.0)
    fleet.carry_out(operator, drive(6), 0.0)
    fleet.carry_out(operator, drive(9, speed=0.0), 0.0)
    with pytest.raises(FleetManagerError, match="after command 9"):
        fleet.carry_out(operator, drive(8), 0.0)
    fleet.carry_out(operator, TakeLeaseFrame(kind="lease", tractor=1), 0.0)
    fleet.carry_out(operator, drive(0), 0.0)
    commands = [frame["speed_command_mps"] for frame in waiting(tractor) if frame["kind"] == "command"]
    assert commands == [1.0]  # those before the lease was taken anew are withdrawn
    assert fleet.manager.states[0].remote_command[1] == 1.0


def test_every_kind_of_alarm_is_in_the_document_of_frames() -> None:
    root = Path(planner.fleet.__file__).parent
    source = "\n".join(path.read_text("utf-8") for path in root.rglob("*.py"))
    raised = set(re.findall(r'\braise_alarm\(\s*f?"([a-z ]+?) ?[{"]', source))
    by_name = {"near", UNREADABLE_CODE, FINDING, "fence", RESTARTED, NEIGHBOUR_STOPPED, NEAR_FLEET, UNKNOWN_GROUND}
    by_name |= {UNRECORDED, DOUBT_CODE}
    assert raised | by_name == set(get_args(AlarmCode)) and len(raised) > 8
    assert "unread obstacle" in json.dumps(build_asyncapi_document()["components"]["schemas"]["AlarmItem"])
