"""Simple robots on plans of straight lines: points that obey what the link says and report ten times a second."""

import asyncio
import contextlib
import itertools
import json
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, WebSocketException

HOST = "127.0.0.1"
ORIGIN_M, CRS = (500_000.0, 5_000_000.0), "EPSG:32632"
APART_M, FAR_M = 20.0, 3000.0
PERIOD_S, AGAIN_S, OPEN_S = 0.1, 0.5, 20.0
ACCELERATION_MPS2, DECELERATION_MPS2 = 0.7, 0.7
MOST_FRAME = 2**24
Point = tuple[float, float]
Line = tuple[Point, Point]
GROUNDS = itertools.count(1)


def lay_lines(tractors: int, length_m: float) -> list[Line]:
    """Lines to the north side by side, on ground of their own: 3 km away from that of all others."""
    y = FAR_M * next(GROUNDS)
    return [((APART_M * number, y), (APART_M * number, y + length_m)) for number in range(tractors)]


def write_plan(lines: Sequence[Line], speed_mps: float) -> str:
    """One leg for each tractor, between two points in metres from ORIGIN_M, as `headland plan --save` writes it."""
    return json.dumps({
        "format_version": 1, "crs": CRS, "origin_m": list(ORIGIN_M), "notes": {},
        "scenario": {"field": "mine", "tractor": "eg105", "width_m": 2.0},
        "tractors": [[_write_leg(number, line, speed_mps)] for number, line in enumerate(lines)],
    })  # fmt: skip


def _write_leg(number: int, line: Line, speed_mps: float) -> dict[str, Any]:
    return {
        "task": {"kind": "track", "number": number, "piece": 0}, "may_wait": False, "gear": 1, "implement": True,
        "speed_mps": speed_mps, "ground": "soil", "points_m": [list(point) for point in line], "gates": [],
    }  # fmt: skip


@dataclass
class Robot:
    """A tractor on one straight leg. Times are of the monotonic clock.

    `heard` counts frames by kind, `sentences` are what it was refused with.
    """

    port: int
    fleet: str
    number: int
    token: str
    line: Line
    speed_mps: float = 1.0
    at_m: float = 0.0
    now_mps: float = 0.0
    released: int = 0
    limit_mps: float = math.inf
    horizon_s: float = math.inf
    standing: bool = True
    sequence: int = -1
    acknowledged: int = -1
    stop_heard_s: float = -math.inf
    resume_heard_s: float = -math.inf
    heard_s: float = -math.inf
    welcomed: bool = False
    link: ClientConnection | None = None
    heard: dict[str, int] = field(default_factory=dict)
    sentences: list[str] = field(default_factory=list)
    _stepped_s: float = 0.0

    @property
    def length_m(self) -> float:
        """The length of its leg."""
        return math.dist(*self.line)

    @property
    def place(self) -> Point:
        """Where it is, metres from the origin of the plan."""
        (x, y), (x1, y1) = self.line
        share = self.at_m / self.length_m
        return x + share * (x1 - x), y + share * (y1 - y)

    def advance(self, now: float) -> None:
        """Drive on until now."""
        passed_s, self._stepped_s = min(now - self._stepped_s, 0.5), now
        wanted = self._find_speed(now)
        change = wanted - self.now_mps
        self.now_mps += min(max(change, -DECELERATION_MPS2 * passed_s), ACCELERATION_MPS2 * passed_s)
        self.at_m = min(self.at_m + self.now_mps * passed_s, self.length_m)

    def _find_speed(self, now: float) -> float:
        """The speed it should have: none when told to stand, at its end, or in silence beyond the horizon."""
        if self.standing or self.released < 1 or now - self.heard_s > self.horizon_s:
            return 0.0
        left_m = self.length_m - self.at_m
        return min(self.speed_mps, self.limit_mps, math.sqrt(2.0 * DECELERATION_MPS2 * left_m))

    def state(self) -> str:
        """The next state as a frame."""
        self.sequence += 1
        (x, y), (x1, y1) = self.line
        east, north = self.place
        return json.dumps({
            "kind": "state", "id": f"t{self.number}", "sequence": self.sequence,
            "time": datetime.now(UTC).isoformat(timespec="milliseconds"), "easting_m": ORIGIN_M[0] + east,
            "northing_m": ORIGIN_M[1] + north, "heading_deg": math.degrees(math.atan2(x1 - x, y1 - y)) % 360.0,
            "speed_mps": round(self.now_mps, 4), "speed_command_mps": round(self._find_speed(time.monotonic()), 4),
            "steering_command_deg": 0.0, "steering_deg": 0.0, "shuttle": 1, "start": 1,
            "mode": "stopped" if self.standing else "automatic", "leg": 0, "leg_m": round(self.at_m, 3), "implement": 1,
            "done": self.at_m >= self.length_m - 0.01,
        })  # fmt: skip

    def hear(self, frame: dict[str, Any]) -> None:
        """Obey a frame."""
        kind, now = str(frame.get("kind")), time.monotonic()
        self.heard[kind] = self.heard.get(kind, 0) + 1
        self.heard_s = now
        if kind == "welcome":
            self.welcomed = True
            self.sequence = max(self.sequence, int(frame["last_sequence"]))
            self.released, self.standing = 0, True
        elif kind == "ack":
            self.acknowledged = int(frame["sequence"])
        elif kind == "release":
            self._take_release(frame)
        elif kind == "stop":
            self.standing, self.stop_heard_s = True, now
        elif kind == "resume":
            self.standing, self.resume_heard_s = False, now
        elif kind == "refused":
            self.sentences.append(str(frame.get("sentence")))

    def _take_release(self, frame: dict[str, Any]) -> None:
        limit, horizon = frame.get("limit_mps"), frame.get("horizon_s")
        self.released = int(frame["base_end"])
        self.limit_mps = math.inf if limit is None else float(limit)
        self.horizon_s = math.inf if horizon is None else float(horizon)

    async def run(self) -> None:
        """Stay linked, drive and report until cancelled."""
        self._stepped_s = time.monotonic()
        while True:
            with contextlib.suppress(OSError, TimeoutError, WebSocketException):
                await self._link_once()
            await asyncio.sleep(AGAIN_S)

    async def _link_once(self) -> None:
        async with open_link(self.port, self.fleet) as link:
            self.link = link
            await link.send(say_hello("tractor", self.token, self.number))
            driving = asyncio.create_task(self._drive(link))
            try:
                async for message in link:
                    self.hear(json.loads(message))
            except ConnectionClosed:
                pass
            finally:
                driving.cancel()

    async def _drive(self, link: ClientConnection) -> None:
        due = time.monotonic()
        with contextlib.suppress(ConnectionClosed):
            while True:
                self.advance(time.monotonic())
                if self.welcomed:
                    await link.send(self.state())
                due = max(due + PERIOD_S, time.monotonic())
                await asyncio.sleep(due - time.monotonic())


def open_link(port: int, fleet: str) -> connect:
    """A link to a fleet that is still to be greeted."""
    return connect(f"ws://{HOST}:{port}/api/v1/fleets/{fleet}/link", proxy=None, compression=None, max_size=MOST_FRAME,
                   open_timeout=OPEN_S, ping_interval=None, close_timeout=1.0)  # fmt: skip


def say_hello(role: str, token: str, tractor: int | None = None) -> str:
    """The first frame of a link."""
    hello = {"kind": "connect", "role": role, "version": 1, "token": token, "tractor": tractor}
    return json.dumps({key: value for key, value in hello.items() if value is not None})
