"""Many robots and an operator in a thread of their own, and how long an order to stand needs to the last robot."""

import asyncio
import contextlib
import json
import math
import threading
import time
from collections.abc import Callable, Coroutine, Iterator
from typing import Any

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from tests.benchmarks.link_robots import Line, Robot, lay_lines, open_link, say_hello, write_plan
from tests.service.running import Running

SEEN_S = 1.3  # after an order to stand the service refuses an order to go on of others for a second


class Squad:
    """Robots of one fleet, and a link for control; `orders` is the token that may plan and order."""

    def __init__(self, service: Running, lines: list[Line], speed_mps: float, robot: type[Robot] = Robot) -> None:
        name = f"squad {time.monotonic_ns() % 10**9}"
        ordering = service.make_token("operator", "planner", name=f"operator of {name}")
        driving = service.make_token("admin", name=f"robots of {name}")
        self.service, self.orders = service, _find_token(ordering)
        plan = {"name": name, "plan": write_plan(lines, speed_mps)}
        status, answer = service.ask_json("POST", "/fleets", plan, ordering)
        if status != 201:
            raise RuntimeError(f"No fleet: {status} {answer}")
        self.fleet = str(answer["id"])
        self.robots = [robot(service.port, self.fleet, number, _find_token(driving), line, speed_mps)
                       for number, line in enumerate(lines, start=1)]  # fmt: skip
        self.loop = asyncio.new_event_loop()
        self.thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self.link: ClientConnection | None = None
        self.tasks: list[asyncio.Task[None]] = []

    def open(self, timeout_s: float = 60.0) -> None:
        """Link everybody; raises RuntimeError where a robot is not let in."""
        self.thread.start()
        self.call(self._open(), timeout_s)
        wait_for(lambda: all(robot.acknowledged >= 0 for robot in self.robots), timeout_s)
        if not all(robot.welcomed for robot in self.robots):
            raise RuntimeError(f"Robots are not let in: {[robot.sentences[:1] for robot in self.robots][:3]}")

    async def _open(self) -> None:
        self.tasks = [asyncio.create_task(robot.run()) for robot in self.robots]
        self.link = await open_link(self.service.port, self.fleet)
        await self.link.send(say_hello("control", self.orders))
        self.tasks.append(asyncio.create_task(self._listen(self.link)))

    async def _listen(self, link: ClientConnection) -> None:
        with contextlib.suppress(ConnectionClosed):
            async for _ in link:
                pass

    def call(self, what: Coroutine[Any, Any, Any], timeout_s: float = 30.0) -> Any:
        """Do something in the thread of the robots."""
        return asyncio.run_coroutine_threadsafe(what, self.loop).result(timeout_s)

    def order(self, kind: str) -> None:
        """Send an order over the link for control."""
        assert self.link is not None
        self.call(self.link.send(json.dumps({"kind": kind})))

    def go(self, timeout_s: float = 60.0) -> bool:
        """Everybody drives; whether everybody was told so in time, and has had a second to gather way."""
        begin = time.monotonic()
        self.order("start")
        gone = wait_for(lambda: all(robot.resume_heard_s >= begin for robot in self.robots), timeout_s)
        time.sleep(1.0)
        return gone

    def stop_by_link(self) -> float:
        """Order everybody to stand over the link; seconds until the last robot has heard it, inf where one does not."""
        return self._measure_stop(lambda: self.order("stop_all"))

    def stop_by_http(self) -> float:
        """Order everybody to stand by a request; as by the link."""
        header = {"authorization": f"Bearer {self.orders}"}
        return self._measure_stop(lambda: self.service.ask_json("POST", f"/fleets/{self.fleet}/stop", headers=header))

    def _measure_stop(self, order: Callable[[], object], timeout_s: float = 60.0) -> float:
        begin = time.monotonic()
        order()
        wait_for(lambda: all(robot.stop_heard_s >= begin for robot in self.robots), timeout_s)
        reached = [robot.stop_heard_s - begin for robot in self.robots]
        return max(reached) if min(reached) >= 0.0 else math.inf

    def close(self) -> None:
        """End all links."""

        async def cancel() -> None:
            for task in self.tasks:
                task.cancel()
            await asyncio.gather(*self.tasks, return_exceptions=True)
            if self.link is not None:
                await self.link.close()

        with contextlib.suppress(TimeoutError):
            self.call(cancel(), 10.0)
        self.loop.call_soon_threadsafe(self.loop.stop)
        self.thread.join(5.0)
        self.loop.close()


@contextlib.contextmanager
def run_squad(service: Running, tractors: int, length_m: float = 2000.0, robot: type[Robot] = Robot) -> Iterator[Squad]:
    """A fleet of tractors side by side, linked and standing."""
    squad = Squad(service, lay_lines(tractors, length_m), 1.0, robot)
    try:
        squad.open()
        yield squad
    finally:
        squad.close()


def wait_for(is_true: Callable[[], bool], timeout_s: float) -> bool:
    """Wait until something is true; whether it became so in time."""
    until = time.monotonic() + timeout_s
    while not is_true():
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def _find_token(header: dict[str, str]) -> str:
    return header["authorization"].removeprefix("Bearer ")
