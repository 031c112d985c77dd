"""What a service that was killed knows when it is started again: orders, plans made anew, mended twins."""

import asyncio
import json
import math
import os
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.model.alarms import FleetAlarm
from planner.fleet.model.fleet_plan import FleetPlan, describe_timing, prepare_fleet_plan
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import Hold, TractorReport
from planner.fleet.session import fleet_session as lives
from planner.fleet.session import state_recorder
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.service.errors import DatabaseError
from planner.service.fleets import fleet_sessions as hubs
from planner.service.fleets.fleet_sessions import FleetSessions
from planner.service.settings import ServiceSettings
from planner.service.store.service_store import Store
from tests.service.fleets import EG105, SimulatedFleet, fleet_plan, restart_manager, start_fleet
from tests.service.one_process import SessionsHere
from vehicle.missions.plan import ENTER, Leg, LegTask, Mission, Plan
from vehicle.missions.plan_file import format_plan
from vehicle.model.tractor_writer import format_tractor_toml

RING = ((90.0, 0.0), (91.0, 0.0), (91.0, 1.0))
ORDERS: dict[str, Callable[[FleetSession], object]] = {
    "stop-all": lambda fleet: fleet.manager.operators.stop_all("anna", 0.0),
    "pause": lambda fleet: fleet.manager.operators.pause_tractors("anna", 0, 0.0),
    "lease": lambda fleet: fleet.manager.operators.take_lease("anna", 0, False, 0.0),
    "failure": lambda fleet: fleet.manager.operators.mark_failed("anna", 0, 0.0),
    "obstacle": lambda fleet: fleet.manager.obstacle_reports.add("tractor 1", RING, "stone", 0.0),
}


SCENARIO = {"field": "iwamizawa", "width_m": 2.0, "tractor": "eg105"}


def save_small(store: Store, text: str, plan: FleetPlan | None = None) -> FleetSession:
    """A fleet of a store, which has the text as its plan."""
    fleet = FleetSession("f1", "small", plan or fleet_plan(), FleetRules(), begin_s=time.time())
    store.save_fleet(fleet.id, "small", text, {"begin_s": fleet.begin_s, "times": 1.0, "way": "predict"})
    return fleet


async def restore_all(store: Store) -> FleetSessions:
    """The fleets of a store after a restart, in a service that has ended again."""
    hub = SessionsHere(store)
    await hub.restore_sessions()
    await hub.stop()
    return hub


@pytest.mark.parametrize("order", ORDERS)
def test_what_was_ordered_is_kept_at_once_as_the_service_may_be_killed(
    order: str, plain: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hubs, "SAVE_PERIOD_S", 3600.0)
    fleet = save_small(plain, "{}")

    async def ordered() -> None:
        hub = FleetSessions(plain)
        hub.add(fleet)
        keeping = asyncio.create_task(hub._save_periodically())
        fleet.manager.operators.start_fleet_work("anna", 0.0)
        fleet.send_pending_outputs()
        await asyncio.sleep(0.3)
        ORDERS[order](fleet)
        fleet.send_pending_outputs()
        wanted = json.loads(json.dumps(fleet.capture_progress(time.monotonic(), time.time())["centre"]["tractors"]))
        obstacles = len(fleet.manager.obstacles.items)
        async with asyncio.timeout(60.0):  # far less than the period of keeping
            while True:
                kept = plain.get_fleet("f1").progress.get("centre", {"tractors": [], "obstacles": []})
                same = [each["holds"] for each in kept["tractors"]] == [each["holds"] for each in wanted]
                if same and len(kept["obstacles"]) == obstacles:
                    break
                await asyncio.sleep(0.01)
        keeping.cancel()

    asyncio.run(ordered())


def crossing() -> FleetPlan:
    """Two that cross each other's way and have no gates any more, as after a plan of the rest was accepted."""

    def mission(points: list[list[float]]) -> Mission:
        onward = [points[-1], [metres + 20.0 for metres in points[-1]]]
        return Mission((Leg(np.array(points), 1.0, task=LegTask(ENTER)), Leg(np.array(onward), 1.0)))

    plan = fleet_plan(2, 2)
    missions = (mission([[0.0, 0.0], [40.0, 0.0]]), mission([[20.0, -20.0], [20.0, 20.0]]))
    courses = tuple(replace(course, mission=one) for course, one in zip(plan.timed_missions, missions, strict=True))
    return replace(plan, saved=replace(plan.saved, plan=Plan(missions)), timed_missions=courses, min_clearance_m=0.6)


def test_a_plan_made_anew_is_taken_up_by_its_times_and_the_guard_keeps_its_distance() -> None:
    made = crossing()
    text = format_plan(made.plan, origin_m=made.saved.origin_m, scenario=SCENARIO | dict(made.saved.scenario))
    timing = json.loads(json.dumps(describe_timing(made)))
    try:
        assert prepare_fleet_plan(text).min_clearance_m < 0.1, "driven from its beginning they meet"
    except FleetManagerError as refusal:
        assert "does not reach the end of the plan" in str(refusal)
    again = prepare_fleet_plan(text, timing=timing)
    assert again.min_clearance_m == 0.6 and again.clearance_m == pytest.approx(0.48)
    assert again.finish_s == made.finish_s
    assert [course.leg_seconds for course in again.timed_missions] == [
        course.leg_seconds for course in made.timed_missions
    ]
    alone = replace(fleet_plan(1), min_clearance_m=math.inf)
    assert describe_timing(alone)["near_m"] is None, "JSON of databases has no infinity"
    timing["seconds"][0].append(1.0)
    with pytest.raises(FleetManagerError, match="saved times belong to another plan"):
        prepare_fleet_plan(text, timing=timing)


@pytest.mark.slow
def test_a_plan_made_anew_outlives_two_restarts(plain: Store) -> None:
    made = crossing()
    text = format_plan(made.plan, origin_m=made.saved.origin_m, scenario=SCENARIO)
    fleet = save_small(plain, "no plan at all", made)
    fleet.plan_text = text

    async def again() -> FleetSession:
        hub = FleetSessions(plain)
        await hub.restore_sessions()
        assert not any(label.fault for label in hub.labels.values())
        await hub.save(hub.by_id["f1"])
        await hub.stop()
        return hub.by_id["f1"]

    async def first() -> None:
        hub = FleetSessions(plain)
        hub.add(fleet)
        await hub.save(fleet)

    asyncio.run(first())
    for _ in range(2):
        live = asyncio.run(again())
        assert live.plan_text == text and live.manager.plan.min_clearance_m == 0.6


@pytest.mark.slow
def test_a_twin_that_was_mended_is_one_of_its_file_after_a_restart_while_that_is_there(plain: Store) -> None:
    mended = EG105.model_copy(update={"name": "slips", "wheel_slip": 0.1})
    plain.add_file("tractor", "mine", format_tractor_toml(mended).encode())
    fleet = save_small(plain, format_plan(fleet_plan().plan, scenario=SCENARIO))
    fleet.twin_files = {1: "mine", 0: "deleted meanwhile"}

    async def again() -> FleetSession:
        first = FleetSessions(plain)
        first.add(fleet)
        await first.save(fleet)
        return (await restore_all(plain)).by_id["f1"]

    live = asyncio.run(again())
    assert [tractor.name for tractor in live.twins.tractors] == [EG105.name, "slips"] and live.twin_files == {1: "mine"}


@pytest.mark.parametrize("mode", ["automatic", "stopped"])
def test_after_a_restart_nobody_moves_until_somebody_orders_it(mode: str) -> None:
    first = start_fleet()
    first.run(5)
    again = restart_manager(first.manager, first.now, 100.0, 3.0)
    report = first.manager.states[0].report
    assert report is not None
    for tenth in range(50):  # the link takes its time
        again.update_fleet(95.0 + 0.1 * tenth)
    assert not again.take_outputs()[0]
    again.connect_tractor(0, 100.0)
    told = [(order.kind, order.data.get("reason")) for order in again.take_outputs()[0] if order.tractor == 0]
    assert told[-1] == ("stop", Hold.SERVICE_RESTARTED), "one that drives stops as soon as it is linked"
    for tenth in range(30):
        again.take_report(0, report._replace(mode=mode, speed_mps=0.0), 100.2 + 0.1 * tenth)
        again.update_fleet(100.2 + 0.1 * tenth)
    assert "resume" not in [order.kind for order in again.take_outputs()[0]]
    (alarm,) = (each for each in again.alarms.list_alarms() if not each.over and each.tractor is None)
    assert alarm.code == "restarted" and "resume all" in alarm.sentence
    again.operators.resume_tractors("anna", 0, 110.0)
    assert again.states[1].holds and again.alarms.is_alarm_on("restarted", None)
    assert [order.kind for order in again.take_outputs()[0]] == ["resume"]
    again.operators.resume_tractors("anna", 1, 110.0)
    assert not again.alarms.is_alarm_on("restarted", None)


@pytest.mark.parametrize("order", ["start", "resume", "lease"])
def test_what_an_operator_orders_after_a_restart_is_carried_out(order: str) -> None:
    first = start_fleet()
    first.run(5)
    again = restart_manager(first.manager, first.now, 100.0, 3.0)
    again.connect_tractor(0, 100.0)
    if order == "lease":
        again.operators.take_lease("anna", 0, False, 100.0)
        again.take_report(0, TractorReport(0.0, 10.0, math.pi / 2, 0.0, mode="remote"), 100.1)
        again.operators.send_command("anna", 0, 0.0, 0.5, 100.1)
        assert again.take_outputs()[0][-1].data["speed_mps"] == 0.5 and again.alarms.is_alarm_on("restarted", None)
    elif order == "start":
        again.operators.start_fleet_work("anna", 100.0)
    else:
        again.operators.resume_tractors("anna", None, 100.0)
    assert order == "lease" or not any(state.holds or state.standing_ordered for state in again.states)


@pytest.mark.parametrize(("began", "held"), [(False, False), (True, True)])
def test_a_fleet_that_was_not_driven_is_not_held_for_a_restart(began: bool, held: bool) -> None:
    first = SimulatedFleet(FleetManager(fleet_plan(), FleetRules()))
    if began:
        first.manager.operators.start_fleet_work("anna", 0.0)
        first.manager.operators.stop_all("anna", 1.0)
    again = restart_manager(first.manager, first.now, 100.0, 3.0)
    assert any(Hold.SERVICE_RESTARTED in state.holds for state in again.states) == held
    assert again.alarms.is_alarm_on("restarted", None) == held


@pytest.mark.slow
def test_the_horizon_of_a_fleet_outlives_a_restart_and_older_fleets_have_the_default(plain: Store) -> None:
    text = format_plan(fleet_plan().plan, scenario=SCENARIO)
    kept = {"begin_s": time.time(), "times": 1.0, "way": "predict"}
    plain.save_fleet("f1", "old", text, kept)
    plain.save_fleet("f2", "new", text, kept | {"horizon_s": 5.0})

    hub = asyncio.run(restore_all(plain))
    assert [hub.by_id[id].manager.rules.horizon_s for id in ("f1", "f2")] == [20.0, 5.0]
    assert [(label.name, label.created[:2]) for label in hub.labels.values()] == [("old", "20"), ("new", "20")]
    assert [member.name for member in hub.neighbourhood.list_neighbours("f1")] == ["new"], (
        "they are driven on one ground"
    )


class BrokenStore:
    """A store whose database is gone while `is_gone`, and what it was given when it was not."""

    def __init__(self) -> None:
        self.is_gone, self.events, self.rows, self.settings = True, [], 0, ServiceSettings()

    def _reach(self) -> None:
        if self.is_gone:
            raise DatabaseError("The database cannot be reached.")

    def add_recording(self, fleet: str, number: int, rows: list[list[object]]) -> None:
        self._reach()
        self.rows += len(rows)

    def add_event(self, fleet: str, who: str, what: str, data: object) -> None:
        self._reach()
        self.events.append(what)

    def save_progress(self, id: str, progress: object) -> None:
        self._reach()


def test_a_database_that_is_gone_holds_up_nothing_and_is_told_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(lives, "UNSAVED_ALARM_S", 0.4)
    monkeypatch.setattr(hubs, "SAVE_PERIOD_S", 0.05)
    monkeypatch.setattr(state_recorder, "MOST_WAITING_STATES", 50)
    monkeypatch.setattr(lives, "MOST_WAITING_STATES", 50)
    store = BrokenStore()
    fleet = FleetSession("f1", "small", fleet_plan(), FleetRules(), begin_s=time.time())
    tractor = FleetClient(TRACTOR, "tractor 1", 0)

    def list_unrecorded() -> list[FleetAlarm]:
        return [each for each in fleet.manager.alarms.list_alarms() if each.code == "unrecorded"]

    async def start_fleet() -> None:
        hub = FleetSessions(store)  # type: ignore[arg-type]
        hub.add(fleet)
        tasks = [asyncio.create_task(each) for each in (hub._step_sessions_forever(), hub._save_periodically())]
        fleet.add_client(tractor, time.monotonic())
        for sequence in range(80):
            fleet.recorder.add(0, [sequence])
            await asyncio.sleep(0.01)
        async with asyncio.timeout(60.0):
            while not list_unrecorded():
                await asyncio.sleep(0.01)
        fleet.manager.operators.stop_all("anna", time.monotonic())
        fleet.send_pending_outputs()
        assert "stop" in [kind for _, kind in tractor.outbox._waiting]
        (alarm,) = list_unrecorded()
        assert re.match(
            r"The database has been unreachable since 2\S+Z; nothing is recorded\. Only the last 50", alarm.sentence
        )
        assert len(fleet.recorder.waiting[0]) == 50 and fleet.recorder.saved[0] == -1
        assert "ack" not in [kind for _, kind in tractor.outbox._waiting]
        store.is_gone = False
        async with asyncio.timeout(60.0):
            while fleet.recorder.saved[0] < 79 or "recorded again" not in store.events:
                await asyncio.sleep(0.01)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    asyncio.run(start_fleet())
    assert store.rows == 50 and fleet.recorder.saved[0] == 79
    assert "stop_all" in store.events and "recorded again" in store.events
    assert [each.over for each in list_unrecorded()] == [True]


def ended_the_first_time(mark: str) -> int:
    """What a process does that is killed once."""
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(9)
    return 7


@pytest.mark.slow
def test_a_process_that_is_killed_at_its_work_is_replaced(plain: Store, tmp_path: Path) -> None:

    async def worked() -> int:
        hub = FleetSessions(plain)
        done: int = await hub.run_in_process(ended_the_first_time, str(tmp_path / "mark"))
        await hub.stop()
        return done

    assert asyncio.run(worked()) == 7
