"""A simulated robot: what it does with what it hears, and when it hears nothing."""

import asyncio
import json
import math
import time
from collections import deque
from functools import partial
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.server import ServerConnection, serve

from planner.fleet.session.frame_content import describe_mission
from planner.fleet.session.inbound_frames import FRAMES_OF_ROLE
from planner.fleet.simulated_robot import HORIZON_S, RobotDriver
from planner.service.errors import ServiceError
from planner.service.fleets import robot_client
from planner.service.fleets.fleet_socket import REPLACED_CODE
from planner.service.fleets.robot_client import RobotClient
from tests.service.fleets import BAR, EG105, LENGTH, fleet_plan
from vehicle.twin.twin import MAX_COMMAND_GAP_S

PLAN = fleet_plan(1, 3)


WELCOME = {"kind": "welcome", "settings": {"times": 1.0}, "last_sequence": 6, "plan": describe_mission(PLAN, 0)}


def unlinked() -> RobotDriver:
    return RobotDriver(PLAN.plan.missions[0], EG105, BAR, PLAN.saved.origin_m, name="robot 1")


def robot() -> RobotDriver:
    driver = unlinked()
    driver.handle_frame(WELCOME, 0.0)
    return driver


def let(driver: RobotDriver, begin: float, seconds: float, *, beats: bool = True) -> dict[str, object]:
    """Time passes; the last state."""
    state: dict[str, object] = {}
    for now in np.arange(begin, begin + seconds, 0.1):
        if beats:
            driver.handle_frame({"kind": "heartbeat", "time": ""}, float(now))
        state = driver.step(float(now))
    return state


def release(driver: RobotDriver, legs: int, now: float, limit: float | None = None) -> None:
    driver.handle_frame(
        {"kind": "release", "update": legs, "base_end": legs, "horizon_end": 3, "limit_mps": limit}, now
    )
    driver.handle_frame({"kind": "resume"}, now)


def test_it_stands_until_it_is_told_and_goes_on_from_the_known_sequence() -> None:
    driver = robot()
    state = let(driver, 0.0, 1.0)
    assert state["mode"] == "stopped" and state["speed_mps"] == 0.0
    assert state["sequence"] == 16
    FRAMES_OF_ROLE["tractor"].validate_json(json.dumps(state))


def test_it_ends_its_released_leg_and_stands_there_when_the_centre_is_silent_before_its_horizon_ends() -> None:
    driver = robot()
    release(driver, 1, 0.0)
    state = let(driver, 0.0, 10.0)
    assert float(str(state["leg_m"])) > 5.0
    state = let(driver, 10.0, 19.0, beats=False)
    assert state["leg"] == 0 and state["leg_m"] == pytest.approx(LENGTH, abs=0.2)
    assert state["speed_mps"] == pytest.approx(0.0, abs=0.02) and state["done"] is False


def way_m(state: dict[str, object]) -> float:
    """Metres that a robot has driven of its legs."""
    return LENGTH * float(str(state["leg"])) + float(str(state["leg_m"]))


@pytest.mark.parametrize(("horizon_s", "times"), [(None, 1.0), (20.0, 1.0), (5.0, 1.0), (5.0, 3.0), (2.0, 1.0)])
def test_it_stops_on_its_released_legs_once_it_has_not_heard_the_centre_for_its_horizon(
    horizon_s: float | None, times: float
) -> None:
    driver = robot()
    driver.times = times
    release(driver, 3, 0.0)
    if horizon_s is not None:
        driver.handle_frame(
            {"kind": "release", "update": 4, "base_end": 3, "limit_mps": None, "horizon_s": horizon_s}, 0.0
        )
    state = let(driver, 0.0, 5.0)  # heard last at 4.9 s
    speed, begun_m = float(str(state["speed_mps"])), way_m(state)
    assert speed == pytest.approx(1.0, abs=0.1)
    seconds = HORIZON_S if horizon_s is None else horizon_s
    assert let(driver, 5.0, seconds - 0.2, beats=False)["mode"] == "automatic"
    state = let(driver, 4.8 + seconds, 8.0, beats=False)
    assert state["mode"] == "stopped" and driver.reason == "no contact with the control centre"
    # Seconds on the wall, in which it lives `times` as fast, then v^2 / 2a with a brake of at least 0.7 m/s2.
    least_m = speed * seconds * times
    assert least_m - 0.3 * times <= way_m(state) - begun_m <= 1.02 * least_m + 0.2 * times + speed**2 / (2.0 * 0.7)
    assert way_m(state) < 60.0 - 1.0, "not because its legs were at their end"


@pytest.mark.parametrize("limit_mps", [None, 0.8], ids=["by its horizon", "as it follows"])
@pytest.mark.parametrize(("said", "mode"), [("heartbeat", "automatic"), ("stop", "stopped"), ("welcome", "stopped")])
def test_it_goes_on_with_the_next_word_of_the_same_link_and_not_against_a_stop_or_over_a_new_one(
    said: str, mode: str, limit_mps: float | None
) -> None:
    driver = robot()
    release(driver, 3, 0.0, limit_mps)
    driver._horizon_s = 2.0
    let(driver, 0.0, 4.0)
    assert let(driver, 4.0, 4.0, beats=False)["mode"] == "stopped"
    driver.handle_frame(WELCOME | {"kind": said, "reason": "test"}, 8.0)
    state = let(driver, 8.0, 3.0)
    assert state["mode"] == mode and (float(str(state["speed_mps"])) > 0.5) == (mode == "automatic")


def test_beats_renew_the_horizon_and_late_ones_do_not() -> None:
    driver = robot()
    release(driver, 3, 0.0)
    driver._horizon_s = 2.0
    for tenth in range(100):
        now = 0.1 * tenth
        if tenth % 15 == 0:  # every one and a half seconds
            driver.handle_frame({"kind": "heartbeat", "clock_s": now}, now)
        assert driver.step(now)["mode"] == "automatic"
    for tenth in range(100, 160):
        now = 0.1 * tenth
        driver.handle_frame({"kind": "heartbeat", "clock_s": now - 3.0}, now)  # held up for three seconds
        state = driver.step(now)
    assert state["mode"] == "stopped"


def test_states_echo_the_clock_of_the_last_beat_of_their_link() -> None:
    driver = robot()
    assert "heartbeat_s" not in driver.step(0.0)
    driver.handle_frame({"kind": "heartbeat", "clock_s": 77.25}, 0.1)
    state = driver.step(0.2)
    assert state["heartbeat_s"] == 77.25
    FRAMES_OF_ROLE["tractor"].validate_json(json.dumps(state))
    driver.handle_frame(WELCOME | {"clock_s": 80.0}, 0.3)
    assert driver.step(0.4)["heartbeat_s"] == 80.0


def test_silence_for_a_second_stops_one_that_is_driven_by_remote_control_or_follows() -> None:
    for limit in (None, 0.8):
        driver = robot()
        release(driver, 3, 0.0, limit)
        if limit is None:
            driver.handle_frame({"kind": "command", "steering_command_deg": 5.0, "speed_command_mps": 0.8}, 0.0)
        state = let(driver, 0.0, 5.0)
        assert float(str(state["speed_mps"])) == pytest.approx(0.8, abs=0.1)
        state = let(driver, 5.0, 0.8, beats=False)
        assert state["mode"] != "stopped"
        state = let(driver, 5.8, 3.0, beats=False)
        assert state["mode"] == "stopped" and state["speed_mps"] == pytest.approx(0.0, abs=0.02)


def test_a_stop_is_obeyed_at_once_and_a_resume_after_it_and_one_before_the_silence_stays() -> None:
    driver = robot()
    release(driver, 3, 0.0)
    let(driver, 0.0, 8.0)
    driver.handle_frame({"kind": "stop", "reason": "test"}, 8.0)
    state = let(driver, 8.0, 3.0)
    assert state["mode"] == "stopped" and state["speed_mps"] == pytest.approx(0.0, abs=0.02)
    driver.handle_frame({"kind": "resume"}, 11.0)
    assert float(str(let(driver, 11.0, 5.0)["speed_mps"])) > 0.5
    driver = robot()
    release(driver, 3, 0.0, 0.8)
    let(driver, 0.0, 2.0)
    driver.handle_frame({"kind": "stop", "reason": "test"}, 2.0)
    driver.step(4.0)  # the process itself stood still that long
    assert let(driver, 4.1, 2.0)["mode"] == "stopped"


def test_it_drives_as_it_is_commanded_to_the_right() -> None:
    driver = robot()
    driver.handle_frame({"kind": "command", "steering_command_deg": 20.0, "speed_command_mps": 1.0}, 0.0)
    state = let(driver, 0.0, 6.0)
    assert state["mode"] == "remote"
    assert 5.0 < float(str(state["heading_deg"])) < 180.0  # from north to the right
    east, north = PLAN.saved.origin_m
    assert float(str(state["easting_m"])) > east and math.isfinite(float(str(state["northing_m"])) - north)


def test_one_that_forgets_all_goes_on_where_its_last_state_said_and_one_that_is_linked_again_stays() -> None:
    driver, again = robot(), unlinked()
    place = {"leg": 1, "leg_m": 3.0, "easting_m": 1002.5, "northing_m": 2021.0, "heading_deg": 300.0}
    for each in (driver, again):  # the first of them remembers
        each.handle_frame(WELCOME | {"last_sequence": 70} | place, 0.0)
    state = again.step(0.0)
    assert (state["easting_m"], state["northing_m"], state["heading_deg"]) == pytest.approx((1002.5, 2021.0, 300.0))
    assert (state["leg"], state["leg_m"], state["mode"]) == (1, pytest.approx(3.0), "stopped")
    assert driver.step(0.0)["leg"] == 0
    driver, welcome = unlinked(), WELCOME | {"leg": 1, "leg_m": 5.0}
    driver.handle_frame(welcome, 0.0)
    state = driver.step(0.0)
    assert (state["leg"], state["leg_m"], state["done"]) == (1, pytest.approx(5.0), False)
    assert state["northing_m"] == pytest.approx(PLAN.saved.origin_m[1] + LENGTH + 5.0)
    release(driver, 3, 0.0)
    assert float(str(let(driver, 0.0, 10.0)["leg_m"])) > 12.0
    before = float(str(driver.step(10.0)["leg_m"]))
    driver.handle_frame(welcome, 10.0)
    assert float(str(driver.step(10.1)["leg_m"])) >= before


@pytest.mark.parametrize("times, period_s", [(0.5, 0.1), (3.0, 0.1), (6.0, 0.05), (10.0, 0.03), (100.0, 0.03)])
def test_one_that_lives_faster_reports_oftener_so_its_twin_sees_its_commands(times: float, period_s: float) -> None:
    assert robot_client.compute_period_s(times) == pytest.approx(period_s)
    assert times > 13.0 or times * robot_client.compute_period_s(times) <= MAX_COMMAND_GAP_S


def test_states_wait_until_they_are_acknowledged_and_the_oldest_are_lost_first() -> None:
    driver: Any = Counter()
    robot = RobotClient(driver, "http://here", "f", 1, None)
    robot.waiting = deque(maxlen=3)
    for sequence in range(5):
        robot.add_state({"sequence": sequence})
    assert [sequence for sequence, _ in robot.waiting] == [2, 3, 4]
    robot._handle_frame({"kind": "ack", "sequence": 3})
    assert list(robot.waiting) == [(4, '{"sequence":4}')]


class Counter:
    """Makes numbered states of some size instead of driving."""

    is_welcomed, times = True, 1.0

    def __init__(self) -> None:
        self.sequence, self.kinds = -1, []

    def handle_frame(self, frame: dict[str, Any], now: float) -> None:
        self.kinds.append(frame["kind"])

    def warm_up(self) -> None:
        pass

    def set_clock(self, clock_s: float, now: float) -> None:
        pass

    def step(self, now: float) -> dict[str, Any]:
        self.sequence += 1
        return {"sequence": self.sequence, "filling": 20_000 * "x"}


@pytest.fixture
def counting(monkeypatch: pytest.MonkeyPatch) -> Counter:
    monkeypatch.setattr(robot_client, "STATE_PERIOD_S", 0.005)
    monkeypatch.setattr(robot_client, "RETRY_S", 0.01)
    return Counter()


def linked(driver: Counter | RobotDriver, server: Any) -> RobotClient:
    return RobotClient(driver, f"http://127.0.0.1:{server.sockets[0].getsockname()[1]}", "f", 1, None)  # type: ignore[arg-type]


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
                robot.add_state(counting.step(0.0))
            driving = asyncio.create_task(robot.run())
            await asyncio.wait_for(last, 60.0)
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
            for seconds in (0.2, 2.0, 20.0):  # a busy machine takes longer to link
                await linked(counting, server).run(seconds)
                if heard:
                    break

    asyncio.run(whole())
    assert heard[-1] == {"kind": "disconnect"} and heard[-2]["sequence"] == counting.sequence


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
            await asyncio.wait_for(thrice.wait(), 60.0)
            assert not driving.done()
            driving.cancel()
            await asyncio.gather(driving, return_exceptions=True)

    asyncio.run(whole())


@pytest.mark.slow
def test_a_robot_whose_service_is_gone_brakes_at_the_end_of_its_horizon() -> None:
    driver = unlinked()
    last: list[float] = []

    async def centre(link: ServerConnection) -> None:
        await link.recv()
        ends = {"base_end": 3, "horizon_end": 3, "limit_mps": None, "horizon_s": 2.0}
        released = {"kind": "release", "update": 1} | ends
        for frame in (WELCOME | {"last_sequence": -1}, released, {"kind": "resume"}):
            await link.send(json.dumps(frame))
        for _ in range(20):
            last.append(time.monotonic())
            await link.send(json.dumps({"kind": "heartbeat", "time": "", "clock_s": last[-1]}))
            await asyncio.sleep(0.2)
        link.transport.abort()

    async def whole() -> tuple[float, float]:
        async with serve(centre, "127.0.0.1", 0) as server:
            driving = asyncio.create_task(linked(driver, server).run())
            while len(last) < 20:
                await asyncio.sleep(0.02)
            server.close()
            begun_m = driver.stepper.state.leg_m
            while driver.stepper.state.mode != "stopped":
                await asyncio.sleep(0.02)
            stopped_s = time.monotonic() - last[-1]
            await asyncio.sleep(2.0)
            driving.cancel()
            await asyncio.gather(driving, return_exceptions=True)
        return stopped_s, driver.stepper.state.leg_m - begun_m

    stopped_s, driven_m = asyncio.run(asyncio.wait_for(whole(), 60.0))
    assert 2.0 <= stopped_s < 4.0
    # A step that comes late on a busy machine counts as driven after the last word: a second's way is allowed for it.
    assert driven_m <= (stopped_s + 1.0) * 1.05 + 1.0 / (2.0 * 0.7) and abs(driver.stepper.state.speed_mps) < 0.02


def test_a_robot_whose_place_was_taken_ends(counting: Counter) -> None:
    async def centre(link: ServerConnection) -> None:
        await link.recv()
        await link.send(welcome(-1))
        await link.close(REPLACED_CODE)

    async def whole() -> None:
        async with serve(centre, "127.0.0.1", 0) as server:
            await asyncio.wait_for(linked(counting, server).run(), 20.0)

    with pytest.raises(ServiceError, match="taken the place of tractor 1"):
        asyncio.run(whole())


def test_a_robot_has_compiled_what_drives_before_it_is_linked_which_leaves_the_tractor_where_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = partial(RobotDriver, PLAN.plan.missions[0], EG105, BAR, (0.0, 0.0), name="r", noise_m=0.02, seed=3)
    driver, other = made(), made()
    driver.warm_up()
    for one in (driver, other):
        one.set_clock(1000.0, 0.0)
    first, second = ({k: v for k, v in one.step(0.0).items() if k != "time"} for one in (driver, other))
    assert first == second
    done: list[str] = []
    monkeypatch.setattr(RobotDriver, "warm_up", lambda self: done.append("warm"))

    async def linked(self: RobotClient) -> None:
        done.append("linked")

    monkeypatch.setattr(RobotClient, "_stay_linked", linked)
    asyncio.run(RobotClient(driver, "http://127.0.0.1:9", "f", 1, None).run())
    assert done == ["warm", "linked"]
