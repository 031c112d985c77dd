"""A simulated robot: what it does with what it hears, and when it hears nothing."""

from __future__ import annotations

import asyncio
import json
import math
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.server import ServerConnection, serve

from planner.service.errors import ServiceError
from planner.service.links.converting import mission_told
from planner.service.links.frames import OF_ROLE
from planner.service.links.link import REPLACED
from planner.service.robot import client
from planner.service.robot.client import Robot
from planner.service.robot.driver import Driver
from planner.service.robot.sending import Unacknowledged
from tests.service.fleets import BAR, EG105, LENGTH, fleet_plan
from vehicle.twin.twin import UNTOLD_S

PLAN = fleet_plan(1, 3)


def robot() -> Driver:
    driver = Driver(PLAN.plan.missions[0], EG105, BAR, PLAN.saved.origin_m, name="robot 1")
    driver.heard({"kind": "welcome", "settings": {"times": 1.0}, "last_sequence": 6,
                  "plan": mission_told(PLAN, 0)}, 0.0)  # fmt: skip
    return driver


def let(driver: Driver, begin: float, seconds: float, *, beats: bool = True) -> dict[str, object]:
    """Time passes; the last state."""
    state: dict[str, object] = {}
    for now in np.arange(begin, begin + seconds, 0.1):
        if beats:
            driver.heard({"kind": "beat", "time": ""}, float(now))
        state = driver.step(float(now))
    return state


def release(driver: Driver, legs: int, now: float, limit: float | None = None) -> None:
    driver.heard({"kind": "release", "update": legs, "released": legs, "announced": 3, "limit_mps": limit}, now)
    driver.heard({"kind": "resume"}, now)


def test_it_stands_until_it_is_told_and_goes_on_from_the_known_sequence() -> None:
    driver = robot()
    state = let(driver, 0.0, 1.0)
    assert state["mode"] == "stopped" and state["speed_mps"] == 0.0
    assert state["sequence"] == 16
    OF_ROLE["tractor"].validate_json(json.dumps(state))


def test_it_ends_its_released_leg_and_stands_there_also_when_the_centre_is_silent() -> None:
    driver = robot()
    release(driver, 1, 0.0)
    state = let(driver, 0.0, 10.0)
    assert float(str(state["leg_m"])) > 5.0
    state = let(driver, 10.0, 40.0, beats=False)
    assert state["leg"] == 0 and state["leg_m"] == pytest.approx(LENGTH, abs=0.2)
    assert state["speed_mps"] == pytest.approx(0.0, abs=0.02) and state["done"] is False


def test_silence_for_a_second_stops_one_that_is_driven_by_remote_control_or_follows() -> None:
    for limit in (None, 0.8):
        driver = robot()
        release(driver, 3, 0.0, limit)
        if limit is None:
            driver.heard({"kind": "command", "steering_command_deg": 5.0, "speed_command_mps": 0.8}, 0.0)
        state = let(driver, 0.0, 5.0)
        assert float(str(state["speed_mps"])) == pytest.approx(0.8, abs=0.1)
        state = let(driver, 5.0, 0.8, beats=False)
        assert state["mode"] != "stopped"
        state = let(driver, 5.8, 3.0, beats=False)
        assert state["mode"] == "stopped" and state["speed_mps"] == pytest.approx(0.0, abs=0.02)


def test_a_stop_is_obeyed_at_once_and_a_resume_after_it() -> None:
    driver = robot()
    release(driver, 3, 0.0)
    let(driver, 0.0, 8.0)
    driver.heard({"kind": "stop", "reason": "test"}, 8.0)
    state = let(driver, 8.0, 3.0)
    assert state["mode"] == "stopped" and state["speed_mps"] == pytest.approx(0.0, abs=0.02)
    driver.heard({"kind": "resume"}, 11.0)
    assert float(str(let(driver, 11.0, 5.0)["speed_mps"])) > 0.5


def test_it_drives_as_it_is_commanded_to_the_right() -> None:
    driver = robot()
    driver.heard({"kind": "command", "steering_command_deg": 20.0, "speed_command_mps": 1.0}, 0.0)
    state = let(driver, 0.0, 6.0)
    assert state["mode"] == "remote"
    assert 5.0 < float(str(state["heading_deg"])) < 180.0  # from north to the right
    east, north = PLAN.saved.origin_m
    assert float(str(state["easting_m"])) > east and math.isfinite(float(str(state["northing_m"])) - north)


def test_a_robot_that_forgets_all_stands_where_its_last_state_said() -> None:
    driver = robot()
    welcome = {"kind": "welcome", "settings": {"times": 1.0}, "last_sequence": 70, "plan": mission_told(PLAN, 0),
               "leg": 1, "leg_m": 3.0, "easting_m": 1002.5, "northing_m": 2021.0, "heading_deg": 300.0}  # fmt: skip
    again = Driver(PLAN.plan.missions[0], EG105, BAR, PLAN.saved.origin_m, name="robot 1")
    for each in (driver, again):  # the first of them remembers
        each.heard(welcome, 0.0)
    state = again.step(0.0)
    assert (state["easting_m"], state["northing_m"], state["heading_deg"]) == pytest.approx((1002.5, 2021.0, 300.0))
    assert (state["leg"], state["leg_m"], state["mode"]) == (1, pytest.approx(3.0), "stopped")
    assert driver.step(0.0)["leg"] == 0


@pytest.mark.parametrize("times, period_s", [(0.5, 0.1), (3.0, 0.1), (6.0, 0.05), (10.0, 0.03), (100.0, 0.03)])
def test_one_that_lives_faster_reports_oftener_so_its_twin_sees_its_commands(times: float, period_s: float) -> None:
    assert client.period_s(times) == pytest.approx(period_s)
    assert times > 13.0 or times * client.period_s(times) <= UNTOLD_S


def test_states_wait_until_they_are_acknowledged_and_the_oldest_are_lost_first() -> None:
    waiting = Unacknowledged(most=3)
    for sequence in range(5):
        waiting.add({"sequence": sequence})
    assert waiting.lost == 2 and len(waiting) == 3
    waiting.acknowledged(3)
    assert waiting.after(2) == [(4, '{"sequence":4}')] and waiting.after(4) == []


@pytest.mark.parametrize(("said", "goes_on"), [("beat", True), ("stop", False), ("welcome", False)])
def test_one_that_follows_goes_on_when_it_hears_the_centre_again_and_never_against_a_stop(
    said: str, goes_on: bool
) -> None:
    driver = robot()
    release(driver, 3, 0.0, 0.8)
    let(driver, 0.0, 4.0)
    assert let(driver, 4.0, 3.0, beats=False)["mode"] == "stopped"
    driver.heard({"kind": said, "reason": "test", "settings": {"times": 1.0}, "last_sequence": 6,
                  "plan": mission_told(PLAN, 0)}, 7.0)  # fmt: skip
    state = let(driver, 7.0, 3.0)
    assert (float(str(state["speed_mps"])) > 0.5) == goes_on == (state["mode"] == "automatic")


def test_a_stop_before_the_silence_stays_one() -> None:
    driver = robot()
    release(driver, 3, 0.0, 0.8)
    let(driver, 0.0, 2.0)
    driver.heard({"kind": "stop", "reason": "test"}, 2.0)
    driver.step(4.0)  # the process itself stood still that long
    assert let(driver, 4.1, 2.0)["mode"] == "stopped"


class Counter:
    """Makes numbered states of some size instead of driving."""

    welcomed, times = True, 1.0

    def __init__(self) -> None:
        self.sequence, self.kinds = -1, []

    def heard(self, frame: dict[str, Any], now: float) -> None:
        self.kinds.append(frame["kind"])

    def warm(self) -> None:
        pass

    def dated(self, clock_s: float, now: float) -> None:
        pass

    def step(self, now: float) -> dict[str, Any]:
        self.sequence += 1
        return {"sequence": self.sequence, "filling": 20_000 * "x"}


@pytest.fixture
def counting(monkeypatch: pytest.MonkeyPatch) -> Counter:
    monkeypatch.setattr(client, "PERIOD_S", 0.005)
    monkeypatch.setattr(client, "AGAIN_S", 0.01)
    return Counter()


def linked(counting: Counter, server: Any) -> Robot:
    return Robot(counting, f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}", "f", 1, None)  # type: ignore[arg-type]


def welcome(last: int) -> str:
    return json.dumps({"kind": "welcome", "last_sequence": last})


def test_every_state_arrives_once_and_orders_are_heard_while_old_ones_are_sent_again(counting: Counter) -> None:
    async def whole() -> list[int]:
        sequences: list[int] = []
        last: asyncio.Future[None] = asyncio.get_running_loop().create_future()

        async def centre(link: ServerConnection) -> None:
            await link.recv()
            await link.send(welcome(99))
            await link.send('{"kind":"stop"}')
            while "stop" not in counting.kinds or counting.sequence < 620:
                await asyncio.sleep(0.01)
            async for text in link:
                sequences.append(json.loads(text).get("sequence"))
                if sequences[-1] == 640:
                    last.set_result(None)

        async with serve(centre, "127.0.0.1", 0) as server:
            robot = linked(counting, server)
            for _ in range(600):
                robot.waiting.add(counting.step(0.0))
            driving = asyncio.create_task(robot.run())
            await asyncio.wait_for(last, 20.0)
            driving.cancel()
            await asyncio.gather(driving, return_exceptions=True)
        return sequences

    assert asyncio.run(whole())[:541] == list(range(100, 641))


def test_a_robot_says_goodbye_after_its_last_state(counting: Counter) -> None:
    heard: list[Any] = []

    async def centre(link: ServerConnection) -> None:
        await link.recv()
        await link.send(welcome(-1))
        async for text in link:
            heard.append(json.loads(text))

    async def whole() -> None:
        async with serve(centre, "127.0.0.1", 0) as server:
            await linked(counting, server).run(0.2)

    asyncio.run(whole())
    assert heard[-1] == {"kind": "goodbye"} and heard[-2]["sequence"] == counting.sequence


def test_a_robot_comes_again_when_the_service_goes_in_the_midst_of_a_greeting(counting: Counter) -> None:
    async def whole() -> None:
        thrice, come = asyncio.Event(), []

        async def going(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            await reader.readline()
            writer.close()
            come.append(1)
            if len(come) == 3:
                thrice.set()

        async with await asyncio.start_server(going, "127.0.0.1", 0) as server:
            driving = asyncio.create_task(linked(counting, server).run())
            await asyncio.wait_for(thrice.wait(), 20.0)
            assert not driving.done()
            driving.cancel()
            await asyncio.gather(driving, return_exceptions=True)

    asyncio.run(whole())


def test_a_robot_whose_place_was_taken_ends(counting: Counter) -> None:
    async def centre(link: ServerConnection) -> None:
        await link.recv()
        await link.send(welcome(-1))
        await link.close(REPLACED)

    async def whole() -> None:
        async with serve(centre, "127.0.0.1", 0) as server:
            await asyncio.wait_for(linked(counting, server).run(), 20.0)

    with pytest.raises(ServiceError, match="taken the place of tractor 1"):
        asyncio.run(whole())


def test_one_that_starts_again_goes_on_where_it_was_and_one_that_is_linked_again_stays() -> None:
    driver = Driver(PLAN.plan.missions[0], EG105, BAR, PLAN.saved.origin_m, name="robot 1")
    welcome = {"kind": "welcome", "settings": {"times": 1.0}, "last_sequence": 6, "plan": mission_told(PLAN, 0),
               "leg": 1, "leg_m": 5.0}  # fmt: skip
    driver.heard(welcome, 0.0)
    state = driver.step(0.0)
    assert (state["leg"], state["leg_m"], state["done"]) == (1, pytest.approx(5.0), False)
    assert state["northing_m"] == pytest.approx(PLAN.saved.origin_m[1] + LENGTH + 5.0)
    release(driver, 3, 0.0)
    assert float(str(let(driver, 0.0, 10.0)["leg_m"])) > 12.0
    before = float(str(driver.step(10.0)["leg_m"]))
    driver.heard(welcome, 10.0)
    assert float(str(driver.step(10.1)["leg_m"])) >= before


def test_a_robot_has_compiled_what_drives_before_it_is_linked(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    monkeypatch.setattr(Driver, "warm", lambda self: done.append("warm"))

    async def linked(self: Robot) -> None:
        done.append("linked")

    monkeypatch.setattr(Robot, "_stay_linked", linked)
    plan = fleet_plan()
    driver = Driver(plan.plan.missions[0], EG105, BAR, (0.0, 0.0), name="robot 1")
    asyncio.run(Robot(driver, "http://127.0.0.1:9", "f", 1, None).run())
    assert done == ["warm", "linked"]


def test_warming_up_leaves_the_tractor_where_it_is() -> None:
    plan = fleet_plan()
    driver, other = (
        Driver(plan.plan.missions[0], EG105, BAR, (0.0, 0.0), name="r", noise_m=0.02, seed=3) for _ in "ab"
    )
    driver.warm()
    for one in (driver, other):
        one.dated(1000.0, 0.0)
    keep = {"time"}
    first, second = ({k: v for k, v in one.step(0.0).items() if k not in keep} for one in (driver, other))
    assert first == second
