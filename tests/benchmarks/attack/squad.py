"""Many robots and an operator in a thread of their own, and how long an order to stand needs to the last robot."""

import asyncio
import contextlib
import json
import math
import threading
import time
from collections.abc import Coroutine, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed

from tests.benchmarks.attack.plans import Line, lay_lines, make_fleet
from tests.benchmarks.attack.robots import Robot, open_link, say_hello
from tests.benchmarks.attack.service import Service
from tests.benchmarks.attack.web import API, ask

STANDING_MPS, DRIVES_ON_S = 0.02, 3.0
SEEN_S = 1.3  # after an order to stand the service refuses an order to go on of others for a second
STOP_LIMIT_S = 0.5


@dataclass(frozen=True)
class Stop:
    """An order to stand: seconds to the last robot (inf where one never heard it), metres the farthest drove on.

    `status` is the answer by HTTP, None by link.
    """

    how: str
    seconds: float
    metres: float
    status: int | None = None


class Squad:
    """Robots of one fleet, and a link for control."""

    def __init__(
        self, service: Service, fleet: str, lines: Sequence[Line], speed_mps: float, robot: type[Robot] = Robot
    ) -> None:
        token = service.token("admin")
        self.service, self.fleet, self.orders = service, fleet, service.token("operator", "planner")
        self.robots = [robot(service.port, fleet, number, token, line, speed_mps)
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

    def stop_by_link(self, timeout_s: float = 60.0) -> Stop:
        """Order everybody to stand over the link, and wait until all do."""
        before, begin = self._places(), time.monotonic()
        self.order("stop_all")
        return self._measure("link", before, begin, timeout_s, None)

    def stop_by_http(self, timeout_s: float = 60.0) -> Stop:
        """Order everybody to stand by a request, and wait until all do."""
        status: list[int] = []
        path = f"{API}/fleets/{self.fleet}/stop"
        asking = threading.Thread(target=lambda: status.append(
            ask(self.service.port, "POST", path, token=self.orders, body=b"", timeout_s=timeout_s).status))  # fmt: skip
        before, begin = self._places(), time.monotonic()
        asking.start()
        found = self._measure("HTTP", before, begin, timeout_s, status)
        asking.join(timeout_s)
        return Stop(found.how, found.seconds, found.metres, status[0] if status else 0)

    def _measure(self, how: str, before: list[float], begin: float, timeout_s: float, status: list[int] | None) -> Stop:
        """Wait for the last robot; not any longer where a request has been refused."""

        def is_over() -> bool:
            refused = bool(status) and status is not None and status[0] != 200
            return refused or all(robot.stop_heard_s >= begin for robot in self.robots)

        wait_for(is_over, timeout_s)
        if status and status[0] != 200:
            time.sleep(DRIVES_ON_S)  # they drive on: the metres are those of this time
        reached = [robot.stop_heard_s - begin for robot in self.robots]
        if all(each >= 0.0 for each in reached):
            wait_for(lambda: all(robot.now_mps < STANDING_MPS for robot in self.robots), 5.0)
        seconds = max(reached) if all(each >= 0.0 for each in reached) else math.inf
        metres = max(robot.at_m - at for robot, at in zip(self.robots, before, strict=True))
        return Stop(how, seconds, metres)

    def _places(self) -> list[float]:
        return [robot.at_m for robot in self.robots]

    def measure_stops(self, order: Sequence[str], timeout_s: float = 60.0) -> list[Stop]:
        """Stop all, who drive now, in each of these ways ("HTTP", "link"); in between they drive again."""
        stops: list[Stop] = []
        for how in order:
            if stops:
                self.go(timeout_s)
            stops.append(self.stop_by_http(timeout_s) if how == "HTTP" else self.stop_by_link(timeout_s))
            time.sleep(SEEN_S)
        return stops

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


@contextlib.contextmanager
def run_squad(service: Service, tractors: int, length_m: float = 2000.0, robot: type[Robot] = Robot) -> Iterator[Squad]:
    """A fleet of tractors side by side, linked and standing."""
    lines = lay_lines(tractors, length_m)
    fleet = make_fleet(service, f"squad {time.monotonic_ns() % 10**9}", lines)
    squad = Squad(service, fleet, lines, 1.0, robot)
    try:
        squad.open()
        yield squad
    finally:
        squad.close()


def wait_for(is_true: Any, timeout_s: float) -> bool:
    """Wait until something is true; whether it became so in time."""
    until = time.monotonic() + timeout_s
    while not is_true():
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def describe_stops(stops: Sequence[Stop]) -> tuple[str, bool, dict[str, Any]]:
    """The slowest stops in words, whether all reached the last robot in time, and as numbers."""
    words, values = [], {}
    for how in ("HTTP", "link"):
        of_how = [stop for stop in stops if stop.how == how]
        worst = max(of_how, key=lambda stop: stop.seconds)
        refused = "" if worst.status in (None, 200) else f" (status {worst.status})"
        seconds = f"{worst.seconds:.2f} s" if math.isfinite(worst.seconds) else "never"
        words.append(f"{how} {seconds}{refused}, {worst.metres:.1f} m")
        values[how.lower()] = {"seconds": _finite(worst.seconds), "metres": round(worst.metres, 2),
                               "status": worst.status, "tried": len(of_how)}  # fmt: skip
    held = all(stop.seconds <= STOP_LIMIT_S and stop.status in (None, 200) for stop in stops)
    return "; ".join(words), held, values


def _finite(seconds: float) -> float | None:
    return round(seconds, 3) if math.isfinite(seconds) else None
