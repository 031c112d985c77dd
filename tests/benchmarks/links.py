"""How the links of a fleet hold: `python -m tests.benchmarks.links [--seconds 60] [--tractors 50] [--viewers 5]`.

A service in a process of its own with one fleet; tractors report ten times a second, viewers read every tick. Told are
states lost (sent and neither kept nor, at the end, waiting), the time from a tractor's sending to a viewer's having it,
the share of a core and the memory that the server takes, how long a stop-all needs to the last tractor, whether clients
that drop and come back lose what was acknowledged, and whether malformed frames pass or end a stream.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

PERIOD_S = 0.1
APART_M, LENGTH_M, LEGS = 20.0, 400.0, 4


def serve(data: Path, tractors: int) -> None:
    """A service with one fleet of straight legs; prints its port and serves until it is ended."""
    import socket

    import uvicorn

    from planner.fleet.model.rules import FleetRules
    from planner.fleet.session.fleet_session import FleetSession
    from planner.service.api.apps import create_app
    from planner.service.settings import ServiceSettings
    from tests.service.fleets import fleet_plan

    app = create_app(ServiceSettings(data=data, workers=1), reads_inline=True)
    store, hub = app.state.store, app.state.hub
    begin = time.time()
    store.save_fleet("bench", "bench", "{}", {"begin_s": begin, "times": 1.0, "way": "predict"})
    fleet = FleetSession(
        "bench", "bench", fleet_plan(tractors, LEGS, apart_m=APART_M, length_m=LENGTH_M), FleetRules(), begin_s=begin
    )
    hub.add(fleet)
    token = store.create_token_text("bench", "admin")
    listening = socket.create_server(("127.0.0.1", 0))
    config = uvicorn.Config(app, log_level="warning", access_log=False, ws="websockets-sansio", ws_max_size=2**20)
    print(json.dumps({"port": listening.getsockname()[1], "token": token}), flush=True)
    threading.Thread(target=_end_with_input, daemon=True).start()
    uvicorn.Server(config).run(sockets=[listening])


def _end_with_input() -> None:
    sys.stdin.read()
    os._exit(0)


@contextmanager
def served(tractors: int) -> Iterator[tuple[subprocess.Popen[str], str, str]]:
    """The process of a service, the address of its link and a token."""
    with tempfile.TemporaryDirectory() as folder:
        words = (sys.executable, "-m", "tests.benchmarks.links", "--serve", folder, "--tractors", str(tractors))
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        try:
            assert process.stdout is not None
            told = json.loads(process.stdout.readline())
            yield process, f"ws://127.0.0.1:{told['port']}/api/v1/fleets/bench/link", told["token"]
        finally:
            process.terminate()
            process.wait(30)


@dataclass
class Sent:
    """What one tractor has sent and been told: when each sequence left, and the last acknowledged."""

    at: dict[int, float] = field(default_factory=dict)
    waiting: dict[int, str] = field(default_factory=dict)
    acknowledged: int = -1
    sequence: int = -1
    at_m: float = 0.0
    released: int = 0
    standing: bool = True
    stopped_at: float = 0.0
    refused: int = 0
    rejoined_with: list[tuple[int, int]] = field(default_factory=list)


class Tractor:
    """A tractor on straight legs, which obeys and reports."""

    def __init__(self, number: int, address: str, token: str) -> None:
        self.number, self.address, self.token, self.sent = number, address, token, Sent()
        self.link: ClientConnection | None = None

    def state(self) -> str:
        """The next state as a frame."""
        sent = self.sent
        end = min(sent.released, LEGS) * LENGTH_M
        speed = 1.0 if not sent.standing and sent.at_m < end else 0.0
        sent.at_m = min(sent.at_m + PERIOD_S * speed, max(end, sent.at_m))
        leg = min(int(sent.at_m // LENGTH_M), LEGS - 1)
        sent.sequence += 1
        now = datetime.now(UTC).isoformat(timespec="microseconds")
        text = json.dumps(
            {
                "kind": "state",
                "id": f"t{self.number}",
                "sequence": sent.sequence,
                "time": now,
                "easting_m": 1000.0 + APART_M * (self.number - 1),
                "northing_m": 2000.0 + sent.at_m,
                "heading_deg": 0.0,
                "speed_mps": speed,
                "speed_command_mps": speed,
                "steering_command_deg": 0.0,
                "steering_deg": 0.0,
                "shuttle": 1,
                "start": 1,
                "mode": "stopped" if sent.standing else "automatic",
                "leg": leg,
                "leg_m": sent.at_m - leg * LENGTH_M,
                "implement": 1 - leg % 2,
            }
        )
        sent.at[sent.sequence] = time.time()
        sent.waiting[sent.sequence] = text
        return text

    async def linked(self) -> None:
        """Open a link and send again what is not acknowledged."""
        self.link = await connect(self.address, proxy=None, compression=None, max_size=2**24)
        hello = {"kind": "connect", "role": "tractor", "tractor": self.number, "token": self.token, "version": 1}
        await self.link.send(json.dumps(hello))
        welcome = json.loads(await self.link.recv())
        self.sent.rejoined_with.append((self.sent.acknowledged, welcome["last_sequence"]))
        self._acknowledged(welcome["last_sequence"])
        for text in list(self.sent.waiting.values()):
            await self.link.send(text)

    def _acknowledged(self, sequence: int) -> None:
        self.sent.acknowledged = max(self.sent.acknowledged, sequence)
        for each in [one for one in self.sent.waiting if one <= sequence]:
            del self.sent.waiting[each]

    async def listen(self) -> None:
        """Take what the centre says until the link ends."""
        assert self.link is not None
        try:
            async for message in self.link:
                self._hear(json.loads(message))
        except ConnectionClosed:
            pass

    def _hear(self, frame: dict[str, Any]) -> None:
        kind = frame["kind"]
        if kind == "ack":
            self._acknowledged(frame["sequence"])
        elif kind == "release":
            self.sent.released = frame["base_end"]
        elif kind in ("stop", "resume"):
            self.sent.standing = kind == "stop"
            self.sent.stopped_at = time.time()
        elif kind == "refused":
            self.sent.refused += 1

    async def drive(self, until_s: float) -> None:
        """Report ten times a second until a time."""
        assert self.link is not None
        due = time.monotonic() + PERIOD_S * random.random()
        while time.monotonic() < until_s:
            await asyncio.sleep(max(0.0, due - time.monotonic()))
            due += PERIOD_S
            await self.link.send(self.state())


async def watch(address: str, token: str, late: list[float], until_s: float) -> None:
    """A viewer: how old every new state is when it is there."""
    seen: dict[int, str] = {}
    async with connect(address, proxy=None, compression=None, max_size=2**24) as link:
        await link.send(json.dumps({"kind": "connect", "role": "viewer", "token": token, "version": 1}))
        while time.monotonic() < until_s:
            frame = json.loads(await link.recv())
            now = time.time()
            for tractor in frame["tractors"] if frame["kind"] == "tick" else ():
                at = tractor["time"]
                if at is not None and seen.get(tractor["tractor"]) != at:
                    if tractor["tractor"] in seen:
                        late.append(now - datetime.fromisoformat(at).timestamp())
                    seen[tractor["tractor"]] = at


def usage(pid: int) -> tuple[float, float]:
    """CPU seconds and resident megabytes of a process."""
    ticks = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    cpu = (int(ticks[11]) + int(ticks[12])) / os.sysconf("SC_CLK_TCK")
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return cpu, pages * os.sysconf("SC_PAGE_SIZE") / 2**20


async def probe(late: list[float], until_s: float) -> None:
    """How late this machine wakes somebody who sleeps for 50 ms: what no service on it could be quicker than."""
    while time.monotonic() < until_s:
        due = time.monotonic() + 0.05
        await asyncio.sleep(0.05)
        late.append(time.monotonic() - due)


async def operator(address: str, token: str) -> ClientConnection:
    """A link for control."""
    link = await connect(address, proxy=None, compression=None, max_size=2**24)
    await link.send(json.dumps({"kind": "connect", "role": "control", "token": token, "version": 1}))
    return link


async def measure(pid: int, address: str, token: str, tractors: int, viewers: int, seconds: float) -> list[Tractor]:
    """Everybody drives and is watched for some time, then stands."""
    fleet = [Tractor(number, address, token) for number in range(1, tractors + 1)]
    for tractor in fleet:
        await tractor.linked()
    listening = [asyncio.create_task(tractor.listen()) for tractor in fleet]
    orders = await operator(address, token)
    reading = asyncio.create_task(_drained(orders))
    await orders.send('{"kind":"start"}')
    begin, late = time.monotonic(), list[float]()
    watching = [asyncio.create_task(watch(address, token, late, begin + seconds)) for _ in range(viewers)]
    asleep = list[float]()
    probing = asyncio.create_task(probe(asleep, begin + seconds))
    driving = [asyncio.create_task(tractor.drive(begin + seconds)) for tractor in fleet]
    await asyncio.sleep(min(5.0, 0.2 * seconds))
    (cpu, memory), measured = usage(pid), time.monotonic()
    await asyncio.gather(*driving)
    (cpu_end, memory_end), wall = usage(pid), time.monotonic() - measured
    await asyncio.gather(probing, *watching)
    before = time.time()
    await orders.send('{"kind":"stop_all"}')
    await asyncio.sleep(2.5)
    reached = [tractor.sent.stopped_at - before for tractor in fleet]
    lost = sum(len(tractor.sent.waiting) for tractor in fleet)
    sent = sum(tractor.sent.sequence + 1 for tractor in fleet)
    p50, p99 = (1e3 * float(np.percentile(late, each)) for each in (50, 99))
    print(f"{tractors} tractors at 10 Hz, {viewers} viewers, {seconds:g} s: {sent} states sent, {lost} not kept")
    print(f"tractor to viewer: p50 {p50:.0f} ms, p99 {p99:.0f} ms, most {1e3 * max(late):.0f} ms ({len(late)} seen)")
    p99 = 1e3 * float(np.percentile(asleep, 99))
    load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    print(f"this machine: {load}, a sleep of 50 ms ends p99 {p99:.0f} ms late")
    share = 100 * (cpu_end - cpu) / wall
    print(f"server: {share:.0f} % of a core, {memory:.0f} MB after the start, {memory_end:.0f} MB at the end")
    print(f"stop-all: {1e3 * max(reached):.0f} ms to the last of {sum(r > 0 for r in reached)} tractors")
    for task in (*listening, reading):
        task.cancel()
    return fleet


async def _drained(link: ClientConnection) -> None:
    async for _ in link:
        pass


async def drops(address: str, token: str, fleet: list[Tractor], times: int) -> None:
    """Clients that are cut off without a word and come back."""
    for tractor in fleet:
        if tractor.link is not None:
            await tractor.link.close()
        tractor.sent.rejoined_with.clear()
    some = fleet[: min(10, len(fleet))]
    for _ in range(-(-times // len(some))):
        await asyncio.gather(*(_dropped(tractor) for tractor in some))
    await asyncio.gather(*(_finished(tractor) for tractor in some))
    returns = sum(len(tractor.sent.rejoined_with) for tractor in some) - len(some)
    forgotten = sum(kept < acknowledged for t in some for acknowledged, kept in t.sent.rejoined_with)
    waiting = sum(len(tractor.sent.waiting) for tractor in some)
    print(f"{returns} drops and returns: {forgotten} times something acknowledged was lost, {waiting} states not kept")


async def _dropped(tractor: Tractor) -> None:
    await tractor.linked()
    assert tractor.link is not None
    listening = asyncio.create_task(tractor.listen())
    await tractor.drive(time.monotonic() + random.uniform(0.1, 1.5))
    tractor.link.transport.abort()
    await listening


async def _finished(tractor: Tractor) -> None:
    await tractor.linked()
    listening = asyncio.create_task(tractor.listen())
    await asyncio.sleep(3.0)
    listening.cancel()


def malformed(chance: random.Random, good: str) -> str | bytes:
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


async def fuzz(address: str, token: str, tractor: Tractor, count: int) -> None:
    """Malformed frames among good ones."""
    await tractor.linked()
    assert tractor.link is not None
    listening = asyncio.create_task(tractor.listen())
    chance, good_before = random.Random(1), tractor.sent.sequence
    tractor.sent.refused = 0
    for number in range(count):
        if number % 50 == 0:
            await tractor.link.send(tractor.state())
        example = json.loads(tractor.state())
        tractor.sent.waiting.pop(tractor.sent.sequence)
        tractor.sent.sequence -= 1
        await tractor.link.send(malformed(chance, json.dumps(example | {"sequence": 10**12 + number})))
        await asyncio.sleep(0.001)
    await asyncio.sleep(3.0)
    good = tractor.sent.sequence - good_before
    alive = tractor.sent.acknowledged == tractor.sent.sequence
    passed = count - tractor.sent.refused
    print(
        f"{count} malformed frames among {good} good ones: {passed} not refused; "
        f"{'every good one is kept' if alive else 'the stream is BROKEN'}"
    )
    listening.cancel()
    await tractor.link.close()


async def _all(pid: int, address: str, token: str, given: argparse.Namespace) -> None:
    fleet = await measure(pid, address, token, given.tractors, given.viewers, given.seconds)
    await drops(address, token, fleet, given.drops)
    await fuzz(address, token, fleet[-1], given.malformed)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser()
    for name, usual in (("tractors", 50), ("viewers", 5), ("seconds", 60.0), ("drops", 200), ("malformed", 10_000)):
        parser.add_argument(f"--{name}", type=type(usual), default=usual)
    parser.add_argument("--serve", type=Path)
    given = parser.parse_args()
    if given.serve:
        serve(given.serve, given.tractors)
        return
    with served(given.tractors) as (process, address, token):
        asyncio.run(_ready(address, token))
        asyncio.run(_all(process.pid, address, token, given))


async def _ready(address: str, token: str) -> None:
    """Wait until the service answers: the first time it compiles."""
    for _ in range(1200):
        try:
            async with connect(address, proxy=None) as link:
                await link.send(json.dumps({"kind": "connect", "role": "viewer", "token": token, "version": 1}))
                await link.recv()
                return
        except (OSError, ConnectionClosed, TimeoutError):
            await asyncio.sleep(0.5)
    raise SystemExit("The service does not answer.")


if __name__ == "__main__":
    main()
