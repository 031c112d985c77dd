"""What a service that was killed knows when it is started again: orders, plans made anew, mended twins."""

from __future__ import annotations

import asyncio
import json
import math
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from planner.service.centre.centre import Centre
from planner.service.centre.errors import CentreError
from planner.service.centre.fleet_plan import FleetPlan, prepared, timing_of
from planner.service.centre.progress import progress_of, restore
from planner.service.centre.rules import Rules
from planner.service.links import hub as hubs
from planner.service.links.hub import Hub
from planner.service.links.live import LiveFleet
from planner.service.settings import Settings
from planner.service.store import Store
from tests.service.fleets import EG105, driven, fleet_plan
from vehicle.measured.answer.save import tractor_toml
from vehicle.missions import ENTER, Leg, Mission, Plan, Task
from vehicle.plan_file import plan_to_json

RING = ((90.0, 0.0), (91.0, 0.0), (91.0, 1.0))
ORDERS: dict[str, Callable[[LiveFleet], object]] = {
    "stop-all": lambda fleet: fleet.centre.stop_all("anna", 0.0),
    "pause": lambda fleet: fleet.centre.pause("anna", 0, 0.0),
    "lease": lambda fleet: fleet.centre.lease("anna", 0, False, 0.0),
    "failure": lambda fleet: fleet.centre.fail("anna", 0, 0.0),
    "obstacle": lambda fleet: fleet.centre.obstacle("tractor 1", RING, "stone", 0.0),
}


@pytest.mark.parametrize("order", ORDERS)
def test_what_was_ordered_is_kept_at_once_as_the_service_may_be_killed(
    order: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hubs, "KEEP_S", 3600.0)
    store = Store(Settings(data=tmp_path))
    fleet = LiveFleet("f1", "small", fleet_plan(), Rules(), begin_s=time.time())
    store.save_fleet("f1", "small", "{}", {"begin_s": fleet.begin_s, "times": 1.0, "way": "predict"})

    async def ordered() -> float:
        hub = Hub(store)
        hub.add(fleet)
        keeping = asyncio.create_task(hub._keep_on())
        fleet.centre.start("anna", 0.0)
        fleet.flush()
        await asyncio.sleep(0.3)
        ORDERS[order](fleet)
        fleet.flush()
        begin = time.monotonic()
        wanted = json.loads(json.dumps(fleet.progress(begin, time.time())["centre"]["tractors"]))
        obstacles = len(fleet.centre.obstacles.items)
        while time.monotonic() - begin < 10.0:
            kept = store.fleet("f1").progress.get("centre", {"tractors": [], "obstacles": []})
            same = [each["holds"] for each in kept["tractors"]] == [each["holds"] for each in wanted]
            if same and len(kept["obstacles"]) == obstacles:
                break
            await asyncio.sleep(0.01)
        keeping.cancel()
        return time.monotonic() - begin

    assert asyncio.run(ordered()) < 5.0
    store.close()


def crossing() -> FleetPlan:
    """Two that cross each other's way and have no gates any more, as after a plan of the rest was accepted."""

    def mission(points: list[list[float]]) -> Mission:
        onward = [points[-1], [metres + 20.0 for metres in points[-1]]]
        return Mission((Leg(np.array(points), 1.0, task=Task(ENTER)), Leg(np.array(onward), 1.0)))

    plan = fleet_plan(2, 2)
    missions = (mission([[0.0, 0.0], [40.0, 0.0]]), mission([[20.0, -20.0], [20.0, 20.0]]))
    courses = tuple(replace(course, mission=one) for course, one in zip(plan.courses, missions, strict=True))
    return replace(plan, saved=replace(plan.saved, plan=Plan(missions)), courses=courses, near_m=0.6)


def test_a_plan_made_anew_is_taken_up_by_its_times_and_the_guard_keeps_its_distance() -> None:
    made = crossing()
    scenario = {"field": "iwamizawa", "width_m": 2.0, "tractor": "eg105"}
    text = plan_to_json(made.plan, origin_m=made.saved.origin_m, scenario=scenario | dict(made.saved.scenario))
    timing = json.loads(json.dumps(timing_of(made)))
    try:
        alone = prepared(text).near_m
    except CentreError as refusal:
        alone, told = 0.0, str(refusal)
        assert "not driven to its end" in told
    assert alone < 0.1  # driven from its beginning they meet
    again = prepared(text, timing=timing)
    assert again.near_m == 0.6 and again.clearance_m == pytest.approx(0.48)
    assert again.finish_s == made.finish_s
    assert [course.seconds for course in again.courses] == [course.seconds for course in made.courses]
    timing["seconds"][0].append(1.0)
    with pytest.raises(CentreError, match="times that are kept are those of another plan"):
        prepared(text, timing=timing)


def test_one_tractor_alone_has_no_distance_to_keep_after_a_restart_either() -> None:
    alone = replace(fleet_plan(1), near_m=math.inf)
    assert timing_of(alone)["near_m"] is None  # as JSON of databases has no infinity


def test_a_plan_made_anew_outlives_two_restarts(tmp_path: Path) -> None:
    settings = Settings(data=tmp_path)
    store = Store(settings)
    made = crossing()
    scenario = {"field": "iwamizawa", "width_m": 2.0, "tractor": "eg105"}
    text = plan_to_json(made.plan, origin_m=made.saved.origin_m, scenario=scenario)
    fleet = LiveFleet("f1", "small", made, Rules(), begin_s=time.time())
    fleet.plan_text = text
    kept = {"begin_s": fleet.begin_s, "times": 1.0, "way": "predict"}
    store.save_fleet("f1", "small", "no plan at all", kept)

    async def again() -> LiveFleet:
        hub = Hub(store)
        await hub.take_up()
        assert hub.faults == {}
        await hub.keep(hub.fleets["f1"])
        await hub.stop()
        return hub.fleets["f1"]

    async def first() -> None:
        hub = Hub(store)
        hub.add(fleet)
        await hub.keep(fleet)

    asyncio.run(first())
    for _ in range(2):
        live = asyncio.run(again())
        assert live.plan_text == text and live.centre.plan.near_m == 0.6
    store.close()


def test_a_twin_that_was_mended_is_one_of_its_file_after_a_restart_while_that_is_there(tmp_path: Path) -> None:
    store = Store(Settings(data=tmp_path))
    mended = EG105.model_copy(update={"name": "slips", "wheel_slip": 0.1})
    store.add_file("tractor", "mine", tractor_toml(mended).encode())
    text = plan_to_json(fleet_plan().plan, scenario={"field": "iwamizawa", "width_m": 2.0, "tractor": "eg105"})
    fleet = LiveFleet("f1", "small", fleet_plan(), Rules(), begin_s=time.time())
    fleet.mended = {1: "mine", 0: "deleted meanwhile"}
    store.save_fleet("f1", "small", text, {"begin_s": fleet.begin_s, "times": 1.0, "way": "predict"})

    async def again() -> LiveFleet:
        first, second = Hub(store), Hub(store)
        first.add(fleet)
        await first.keep(fleet)
        await second.take_up()
        await second.stop()
        return second.fleets["f1"]

    live = asyncio.run(again())
    assert [tractor.name for tractor in live.twins.tractors] == [EG105.name, "slips"] and live.mended == {1: "mine"}
    store.close()


@pytest.mark.parametrize(("mode", "goes_on"), [("automatic", True), ("stopped", False)])
def test_one_that_was_stopped_after_the_last_that_is_known_is_not_set_in_motion_by_a_restart(
    mode: str, goes_on: bool
) -> None:
    first = driven()
    first.run(5)
    kept = json.loads(json.dumps(progress_of(first.centre, first.now, 1e9)))  # the service is killed, a stop not kept
    again = Centre(first.centre.plan, Rules())
    restore(again, kept, 100.0, 1e9 + 3.0)
    report = first.centre.states[0].report
    assert report is not None
    for tenth in range(50):  # the link takes its time
        again.tick(95.0 + 0.1 * tenth)
    assert not again.taken()[0]
    again.joined(0, 100.0)
    again.reported(0, report, 100.1)  # one that waited for the link
    kinds = []
    for tenth in range(30):
        again.reported(0, replace(report, mode=mode, speed_mps=0.0), 100.2 + 0.1 * tenth)
        again.tick(100.2 + 0.1 * tenth)
        kinds += [order.kind for order in again.taken()[0] if order.tractor == 0]
    assert ("resume" in kinds) == goes_on and again.alarms.on("stood", 0) == (not goes_on)
    again.resume("anna", 0, 110.0)
    assert not again.states[0].standing_ordered and not again.alarms.on("stood", 0)


def ended_the_first_time(mark: str) -> int:
    """What a process does that is killed once."""
    if not Path(mark).exists():
        Path(mark).touch()
        os._exit(9)
    return 7


def test_a_process_that_is_killed_at_its_work_is_replaced(tmp_path: Path) -> None:
    store = Store(Settings(data=tmp_path))

    async def worked() -> int:
        hub = Hub(store)
        done: int = await hub.work(ended_the_first_time, str(tmp_path / "mark"))
        await hub.stop()
        return done

    assert asyncio.run(worked()) == 7
    store.close()
