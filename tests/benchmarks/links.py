"""How the links of a fleet hold: `python -m tests.benchmarks.links [--seconds 60] [--tractors 50] [--viewers 5]`.

A service in a process of its own with one fleet; robots report ten times a second, viewers read every tick in another
process. Told are states lost (sent and neither kept nor, at the end, waiting), the time from a robot's sending to a
viewer's having it, the share of a core and the memory that the server takes, how long a stop-all needs to the last
robot, whether clients that drop and come back lose what was acknowledged, and whether malformed frames pass or end a
stream.
"""

import argparse
import asyncio
import json
import multiprocessing
import os
import random
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import ClientConnection, connect

from tests.benchmarks.link_robots import HOST, MOST_FRAME, Robot, say_hello
from tests.benchmarks.squad import Squad, run_squad
from tests.service.running import run_service

DROPPED = 10  # robots that drop their links
SETTLE_S = 3.0  # for what is on its way


@dataclass
class CarefulRobot(Robot):
    """A robot that sends each state again over the next link until it is acknowledged.

    `rejoined` is, of every link, what had been acknowledged and the last that the service says it has.
    """

    waiting: dict[int, str] = field(default_factory=dict)
    rejoined: list[tuple[int, int]] = field(default_factory=list)
    latest: str = "{}"

    def state(self) -> str:
        """The next state as a frame, which waits until it is acknowledged."""
        text = super().state()
        self.waiting[self.sequence] = self.latest = text
        return text

    def hear(self, frame: dict[str, Any]) -> None:
        """Obey a frame, and forget what the service has."""
        if frame["kind"] == "welcome":
            self.rejoined.append((self.acknowledged, frame["last_sequence"]))
        super().hear(frame)
        kept = {"welcome": "last_sequence", "ack": "sequence"}.get(frame["kind"])
        for each in [one for one in self.waiting if kept and one <= frame[kept]]:
            del self.waiting[each]

    async def _drive(self, link: ClientConnection) -> None:
        for text in list(self.waiting.values()):
            await link.send(text)
        await super()._drive(link)


async def watch(address: str, token: str, late: list[float], until_s: float) -> None:
    """A viewer: how old every new state is when it is there."""
    seen: dict[int, str] = {}
    async with connect(address, proxy=None, compression=None, max_size=MOST_FRAME) as link:
        await link.send(say_hello("viewer", token))
        while time.monotonic() < until_s:
            frame = json.loads(await link.recv())
            now = time.time()
            for tractor in frame["tractors"] if frame["kind"] == "tick" else ():
                at = tractor["time"]
                if at is not None and seen.get(tractor["tractor"]) != at:
                    if tractor["tractor"] in seen:
                        late.append(now - datetime.fromisoformat(at).timestamp())
                    seen[tractor["tractor"]] = at


def watch_fleet(address: str, token: str, viewers: int, seconds: float) -> tuple[list[float], list[float]]:
    """What a process of viewers sees: ages of states in ticks, and how late its sleeps end (s)."""
    late, asleep, until_s = list[float](), list[float](), time.monotonic() + seconds

    async def look_on() -> None:
        viewing = (watch(address, token, late, until_s) for _ in range(viewers))
        await asyncio.gather(probe(asleep, until_s), *viewing)

    asyncio.run(look_on())
    return late, asleep


async def probe(late: list[float], until_s: float) -> None:
    """How late this machine wakes somebody who sleeps for 50 ms: what no service on it could be quicker than."""
    while time.monotonic() < until_s:
        due = time.monotonic() + 0.05
        await asyncio.sleep(0.05)
        late.append(time.monotonic() - due)


def count_lost(robots: Sequence[CarefulRobot]) -> int:
    """States sent by now that the service does not have after a while; robots go on reporting."""
    sent = [robot.sequence for robot in robots]
    time.sleep(SETTLE_S)
    return sum(each <= last for robot, last in zip(robots, sent, strict=True) for each in robot.waiting)


def measure_usage(pid: int) -> tuple[float, float]:
    """CPU seconds and resident megabytes of a process."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    cpu = (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return cpu, pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def measure(squad: Squad, robots: list[CarefulRobot], viewers: int, seconds: float) -> None:
    """Everybody drives and is watched for some time, then stands."""
    pid, address = squad.service.process.pid, f"ws://{HOST}:{squad.service.port}/api/v1/fleets/{squad.fleet}/link"
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as watching:
        watching.submit(abs, 0).result()  # it has started
        squad.go()
        (cpu, memory), begin = measure_usage(pid), time.monotonic()
        late, asleep = watching.submit(watch_fleet, address, squad.orders, viewers, seconds).result()
    (cpu_end, memory_end), wall = measure_usage(pid), time.monotonic() - begin
    stop_s = squad.stop_by_link()
    sent, lost = sum(robot.sequence + 1 for robot in robots), count_lost(robots)
    p50, p99 = (1e3 * float(np.percentile(late, each)) for each in (50, 99))
    print(f"{len(robots)} robots at 10 Hz, {viewers} viewers, {seconds:g} s: {sent} states sent, {lost} not kept")
    print(f"robot to viewer: p50 {p50:.0f} ms, p99 {p99:.0f} ms, most {1e3 * max(late):.0f} ms ({len(late)} seen)")
    load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    print(f"this machine: {load}, a sleep of 50 ms ends p99 {1e3 * float(np.percentile(asleep, 99)):.0f} ms late")
    share = 100 * (cpu_end - cpu) / wall
    print(f"server: {share:.0f} % of a core, {memory:.0f} MB after the start, {memory_end:.0f} MB at the end")
    print(f"stop-all: {1e3 * stop_s:.0f} ms to the last robot")


def drop_links(squad: Squad, robots: list[CarefulRobot], times: int) -> None:
    """Clients that are cut off without a word and come back."""
    some = robots[:DROPPED]
    for robot in some:
        robot.rejoined.clear()

    async def cut() -> None:
        for robot in some:
            if robot.link is not None:
                robot.link.transport.abort()

    for _ in range(-(-times // len(some))):
        squad.call(cut())
        time.sleep(random.uniform(0.7, 2.0))
    waiting, returns = count_lost(some), sum(len(robot.rejoined) for robot in some)
    forgotten = sum(kept < acknowledged for robot in some for acknowledged, kept in robot.rejoined)
    print(f"{returns} drops and returns: {forgotten} times something acknowledged was lost, {waiting} states not kept")


def spoil_frame(chance: random.Random, good: str) -> str | bytes:
    """A frame that no model takes."""
    kind = chance.randrange(7)
    if kind == 0:
        return bytes(chance.randrange(256) for _ in range(chance.randrange(60)))
    if kind == 1:
        return "".join(chr(chance.randrange(32, 0xD000)) for _ in range(30))
    if kind == 2:
        return good[: chance.randrange(len(good) - 1)]
    frame = json.loads(good)
    key = chance.choice([each for each in frame if each not in ("steering_deg",)])
    if kind == 3:
        del frame[chance.choice(["kind", "sequence", "time", "easting_m", "speed_mps", "shuttle", "mode", "leg"])]
    elif kind == 4:
        frame[key] = chance.choice([None, [], {}, "x" * 300, [1], {"a": 1}])
    elif kind == 5:
        frame[chance.choice(["easting_m", "speed_mps", "heading_deg"])] = chance.choice([1e300, -1e12, "NaN", True])
    else:
        frame[f"extra{chance.randrange(10)}"] = 1
    return json.dumps(frame)


def send_malformed(squad: Squad, robot: CarefulRobot, count: int) -> None:
    """Malformed frames among the good ones of a robot."""
    chance, before, refused = random.Random(1), robot.sequence, robot.heard.get("refused", 0)
    example = json.loads(robot.latest)

    async def send() -> None:
        for number in range(count):
            assert robot.link is not None
            await robot.link.send(spoil_frame(chance, json.dumps(example | {"sequence": 10**12 + number})))
            await asyncio.sleep(0.001)

    squad.call(send(), 0.1 * count + 60.0)
    lost, passed = count_lost([robot]), count - (robot.heard.get("refused", 0) - refused)
    print(f"{count} malformed frames among {robot.sequence - before} good ones: {passed} not refused; "
          f"{'the stream is BROKEN' if lost else 'every good one is kept'}")  # fmt: skip


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser()
    for name, usual in (("tractors", 50), ("viewers", 5), ("seconds", 60.0), ("drops", 200), ("malformed", 10_000)):
        parser.add_argument(f"--{name}", type=type(usual), default=usual)
    given = parser.parse_args()
    with (
        tempfile.TemporaryDirectory(prefix="headland-links-") as folder,
        run_service(Path(folder) / "data") as service,
        run_squad(service, given.tractors, robot=CarefulRobot) as squad,
    ):
        robots = [robot for robot in squad.robots if isinstance(robot, CarefulRobot)]
        measure(squad, robots, given.viewers, given.seconds)
        drop_links(squad, robots, given.drops)
        send_malformed(squad, robots[-1], given.malformed)


if __name__ == "__main__":
    main()
