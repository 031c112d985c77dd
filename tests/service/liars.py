"""Robots written for the test that lie in chosen fields of their states and drive on; nothing of the simulated robot.

A robot drives a straight lane to the north east, so that eastings and northings count alike. It lies from `LIES_S` on.
A lie is a function that changes a frame; `FIELDS` has one for each field of a state, the one that would help a robot
most that does not stop.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any
from unittest.mock import patch

import numpy as np

from planner.fleet.manager.neighbourhood import Neighbourhood
from planner.fleet.model.fleet_plan import FleetPlan
from planner.fleet.model.rules import FleetRules
from planner.fleet.session.clients import CONTROL, TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.inbound_frames import CommandFrame, StateFrame, TakeLeaseFrame
from tests.service.test_neighbours import lane

EPOCH_S, FRAME_S, LIES_S = 1_700_000_000.0, 0.1, 5.0
BRAKES_MPS2, GAINS_MPS2, SPEED_MPS = 0.7, 1.0, 1.0
SILENCE_S = 1.0
Frame = dict[str, Any]
Lie = Callable[[Frame, Frame], None]
"""Changes a frame; the second one is what it said when it began to lie."""

LONG = ((0.0, 0.0), (40.0, 40.0), (80.0, 80.0))


def freeze(name: str) -> Lie:
    """A field keeps the value of the first lie."""

    def lie(frame: Frame, first: Frame) -> None:
        frame[name] = first[name]

    return lie


def say(name: str, value: object) -> Lie:
    """A field has always this value."""

    def lie(frame: Frame, first: Frame) -> None:
        frame[name] = value

    return lie


def turn_heading(frame: Frame, first: Frame) -> None:
    frame["heading_deg"] = (frame["heading_deg"] + 90.0) % 360.0


def leap_in_time(frame: Frame, first: Frame) -> None:
    """Its clock leaps to and fro by more than reports are apart that are compared by their speed."""
    if frame["sequence"] % 2:
        frame["time"] = format_time(datetime.fromisoformat(frame["time"]).timestamp() + 1.2)


def report_rarely(frame: Frame, first: Frame) -> None:
    """It reports every 1.1 s."""
    if (frame["sequence"] - first["sequence"]) % 11:
        frame.clear()


FIELDS: dict[str, Lie] = {
    "id": say("id", "another"),
    "sequence": freeze("sequence"),
    "time": freeze("time"),
    "easting_m": freeze("easting_m"),
    "northing_m": freeze("northing_m"),
    "heading_deg": turn_heading,
    "speed_mps": say("speed_mps", 0.0),
    "speed_command_mps": say("speed_command_mps", 0.0),
    "steering_command_deg": say("steering_command_deg", 30.0),
    "steering_deg": say("steering_deg", 30.0),
    "shuttle": say("shuttle", -1),
    "start": say("start", 0),
    "mode": say("mode", "stopped"),
    "leg": say("leg", 1),
    "leg_m": freeze("leg_m"),
    "implement": say("implement", 0),
    "update": say("update", 999),
    "done": say("done", True),
    "heartbeat_s": say("heartbeat_s", 0.0),
    "errors": say("errors", ["none at all"]),
}
STATED = {"speed_mps": FIELDS["speed_mps"], "mode": FIELDS["mode"], "speed_command_mps": FIELDS["speed_command_mps"]}
"""What a robot says that claims to stand."""
HIDDEN: dict[str, list[Lie]] = {
    "`speed_mps`, and `time` leaps to and fro": [FIELDS["speed_mps"], leap_in_time],
    "`speed_mps`, and a report every 1.1 s": [FIELDS["speed_mps"], report_rarely],
}
"""Lies that hide behind gaps of time."""


def format_time(clock_s: float) -> str:
    return datetime.fromtimestamp(clock_s, UTC).isoformat(timespec="milliseconds")


@dataclass
class LyingRobot:
    """A robot on the first lane of a plan; without `obeys` it drives on whatever it hears once it lies."""

    plan: FleetPlan
    client: FleetClient
    lies: Sequence[Lie] = ()
    obeys: bool = True
    at_m: float = 0.0
    guided_m: float = 0.0
    speed_mps: float = 0.0
    mode: str = "stopped"
    base_end: int = 0
    sequence: int = -1
    command_mps: float = 0.0
    heartbeat_s: float | None = None
    heard_s: float = -math.inf
    first: Frame | None = None
    frames: list[Frame] = field(default_factory=list)

    def hear(self, now: float) -> None:
        """Take what waits in the outbox."""
        for text, _ in list(self.client.outbox._waiting):
            frame = json.loads(text)
            self.heard_s = now
            match frame["kind"]:
                case "welcome" | "heartbeat":
                    self.heartbeat_s = frame["clock_s"]
                case "release":
                    self.base_end = frame["base_end"]
                case "stop":
                    self.mode = "stopped"
                case "resume":
                    self.mode = "automatic"
                case "command":
                    self.mode, self.command_mps = "remote", frame["speed_command_mps"]
        self.client.outbox._waiting.clear()

    def drive(self, now: float) -> None:
        """Move on by a frame, as ordered or not."""
        goes = self.mode == "automatic" or (self.mode == "remote" and self.command_mps > 0.0)
        goes = goes and now - self.heard_s <= SILENCE_S
        if not self.obeys and now >= LIES_S:
            goes = True
        change = GAINS_MPS2 if goes else -BRAKES_MPS2
        self.speed_mps = min(max(self.speed_mps + FRAME_S * change, 0.0), SPEED_MPS)
        mission = self.plan.timed_missions[0]
        end_m = mission.leg_starts_m[-1 if not self.obeys and now >= LIES_S else self.base_end]
        step_m = min(FRAME_S * self.speed_mps, max(end_m - self.at_m, 0.0))
        self.speed_mps, self.at_m = step_m / FRAME_S, self.at_m + step_m
        self.guided_m = self.guided_m if self.mode == "remote" else self.at_m  # its own guidance counts along its legs

    @property
    def place(self) -> tuple[float, float, float]:
        """Where its guided point truly is: metres of the plan, mathematical heading."""
        mission = self.plan.timed_missions[0]
        (x, y), (x1, y1) = mission.legs[0].points[0], mission.legs[-1].points[-1]
        share = self.at_m / mission.leg_starts_m[-1]
        return x + share * (x1 - x), y + share * (y1 - y), math.atan2(y1 - y, x1 - x)

    def report(self, now: float) -> Frame:
        """Its next frame: the truth, and then its lies."""
        x, y, heading_rad = self.place
        mission = self.plan.timed_missions[0]
        leg = min(
            int(np.searchsorted(mission.leg_starts_m[1:], self.guided_m + 1e-9, side="right")), len(mission.legs) - 1
        )
        aside_m, (east, north) = self.plan.tractor.antenna_right_m, self.plan.saved.origin_m
        goes, self.sequence = self.speed_mps > 0.0, self.sequence + 1
        frame: Frame = {
            "kind": "state",
            "id": "r",
            "sequence": self.sequence,
            "time": format_time(EPOCH_S + now),
            "easting_m": east + x + aside_m * math.sin(heading_rad),
            "northing_m": north + y - aside_m * math.cos(heading_rad),
            "heading_deg": (90.0 - math.degrees(heading_rad)) % 360.0,
            "speed_mps": self.speed_mps,
            "speed_command_mps": SPEED_MPS if goes else 0.0,
            "steering_command_deg": 0.0,
            "steering_deg": 0.0,
            "shuttle": 1,
            "start": int(goes),
            "mode": self.mode if self.obeys or self.mode == "remote" else "automatic",
            "leg": leg,
            "leg_m": self.guided_m - mission.leg_starts_m[leg],
            "implement": 1,
            "update": 0,
            "done": False,
            "heartbeat_s": self.heartbeat_s,
            "errors": [],
        }
        if now >= LIES_S:
            self.first = dict(frame) if self.first is None else self.first
            for lie in self.lies:
                lie(frame, self.first)
        return frame


class Scene:
    """Fleets of one robot each in one service, by a clock that the tests turn; the first robot lies."""

    def __init__(self, *plans: FleetPlan, lies: Sequence[Lie] = (), obeys: bool = False, twins: bool = False) -> None:
        self.now, self.hood = 0.0, Neighbourhood()
        self.fleets: list[FleetSession] = []
        self.robots: list[LyingRobot] = []
        self.seen: dict[str, float] = {}
        for number, plan in enumerate(plans):
            name = "abcdefgh"[number]
            fleet = FleetSession(name, name, plan, FleetRules(), begin_s=EPOCH_S)
            client = FleetClient(TRACTOR, "tractor 1", 0)
            with patch("time.time", lambda: EPOCH_S):
                fleet.add_client(client, 0.0)
            if not twins:
                fleet.twins.take_state = lambda *_: None  # type: ignore[method-assign]
            self.fleets.append(fleet)
            is_liar = number == 0
            self.robots.append(LyingRobot(plan, client, lies if is_liar else (), obeys or not is_liar))
            self.hood.add(name, name, fleet.manager, fleet.send_pending_outputs, 0.0)
        self.anna = FleetClient(CONTROL, "anna")
        self.fleets[0].add_client(self.anna, 0.0)

    def start(self) -> None:
        for fleet in self.fleets:
            fleet.manager.operators.start_fleet_work("anna", self.now)

    def run(self, seconds: float, each: Callable[[], None] = lambda: None) -> None:
        """Time passes; `seen` gets the seconds from the lie to each alarm of the liar's fleet."""
        for _ in range(round(seconds / FRAME_S)):
            self.now = round(self.now + FRAME_S, 6)
            with patch("time.time", lambda: EPOCH_S + self.now):
                each()
                for fleet, robot in zip(self.fleets, self.robots, strict=True):
                    robot.hear(self.now)
                    robot.drive(self.now)
                    self._send(fleet, robot)
                for fleet in self.fleets:
                    fleet.step(self.now)
            self.anna.outbox._waiting.clear()
            for alarm in self.fleets[0].manager.alarms.list_alarms():
                level = "" if alarm.level == "critical" else " (warning)"
                self.seen.setdefault(alarm.code.partition("/")[0] + level, round(self.now - LIES_S, 1))

    def _send(self, fleet: FleetSession, robot: LyingRobot) -> None:
        frame = robot.report(self.now)
        if not frame:
            return
        try:
            fleet.take_state(robot.client, StateFrame.model_validate_json(json.dumps(frame)), self.now)
        except ValueError:
            self.seen.setdefault("refused", round(self.now - LIES_S, 1))

    def stop_all(self) -> None:
        self.fleets[0].manager.operators.stop_all("anna", self.now)

    @property
    def state(self) -> Any:
        return self.fleets[0].manager.states[0]

    def apart_m(self) -> float:
        """Metres between the antennas of the first two, truly."""
        return math.dist(self.robots[0].place[:2], self.robots[1].place[:2])


def stop(lies: Sequence[Lie], seconds: float = 20.0, **options: Any) -> Scene:
    """All are stopped as the robot begins to lie, and it drives on."""
    scene = Scene(lane(*LONG), lies=lies, **options)
    scene.start()
    scene.run(LIES_S - FRAME_S)
    scene.stop_all()
    scene.run(seconds)
    return scene


def lose_operator(lies: Sequence[Lie], seconds: float = 20.0, **options: Any) -> Scene:
    """The operator that drives it by remote control goes silent as it begins to lie, and it drives on."""
    scene = Scene(lane(*LONG), lies=lies, **options)
    scene.start()
    scene.run(1.0)
    fleet, sequence = scene.fleets[0], iter(range(10_000))
    fleet.carry_out(scene.anna, TakeLeaseFrame(kind="lease", tractor=1), scene.now)

    def command() -> None:
        at = datetime.fromtimestamp(EPOCH_S + scene.now, UTC)
        fleet.carry_out(
            scene.anna,
            CommandFrame(
                kind="command", sequence=next(sequence), time=at, tractor=1,
                steering_command_deg=0.0, speed_command_mps=SPEED_MPS,
            ),
            scene.now,
        )  # fmt: skip

    scene.run(LIES_S - FRAME_S - scene.now, command)
    scene.run(seconds)
    return scene


def meet(lies: Sequence[Lie], seconds: float = 40.0, **options: Any) -> tuple[Scene, float]:
    """It drives at a robot of another fleet and does not stop; how far apart the antennas are as the other stands."""
    scene = Scene(lane(*LONG), lane((50.0, 50.0), (0.0, 0.0)), lies=lies, **options)
    scene.start()
    while scene.now < seconds:
        scene.run(FRAME_S)
        if scene.now > LIES_S and scene.robots[1].speed_mps == 0.0:
            return scene, scene.apart_m()
    return scene, scene.apart_m()
