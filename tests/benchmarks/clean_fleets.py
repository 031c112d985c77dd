"""Honest fleets with bad receivers, links and clocks in the whole fleet manager: each alarm that nothing has caused.

python -m tests.benchmarks.clean_fleets --hours 100        # of a fleet of 50; it says how far it is, and may be ended

Frames go in as text and alarms come out, as in the service, but by a clock of its own, without twins or database. A
shift is one fleet over a drawn plan, an hour at most; see honest_robots for what ails each robot. Links: frames are
lost, wait for tenths of a second, and are away for 5 s, after which all of them come, or the newest, or none; some
links break and are made again. Operators stop and resume single robots and all, acknowledge alarms, and resume who was
doubted.

`broken` and `late` are right while a link is away or silent and as it comes back. Every other alarm is false, and is
printed.
"""

import argparse
import gc
import json
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from unittest.mock import patch

import numpy as np

from planner.fleet.model.alarms import CRITICAL, FleetAlarm
from planner.fleet.model.rules import FleetManagerError, FleetRules
from planner.fleet.model.tractor_state import Hold
from planner.fleet.session.clients import TRACTOR, FleetClient
from planner.fleet.session.fleet_session import FleetSession
from planner.fleet.session.inbound_frames import StateFrame
from tests.benchmarks.honest_robots import EPOCH_S, STEP_S, HonestRobots
from tests.benchmarks.honest_rows import lay_blocks

LONGEST_SHIFT_S, WHO = 3600.0, "anna"
SHIFTS_PER_SEED = 1000  # so that seeds next to one another drive other shifts
LOST_SHARE, HICCUPS_PER_H, HICCUP_S = 0.01, 20.0, (0.2, 0.7)
AWAY_PER_H, AWAY_S, BACK_S, SILENT_S = 3.0, 5.0, 3.0, 1.0
PAUSES_PER_H, PAUSE_S, STOPS_PER_H, STOP_S, LOOK_S = 3.0, 25.0, 4.0, 15.0, 10.0
ALL, NEWEST, NONE, BREAKS = range(4)
"""What becomes of the frames of a link that is away; one that breaks is made again, and then brings all."""


@dataclass
class Link:
    """The link of one robot: frames that wait until the time it is away is over."""

    client: FleetClient
    waiting: list[str] = field(default_factory=list)
    until_s: float = 0.0
    kind: int = ALL
    is_away: bool = False
    away_s: float = -1e9
    heard_s: float = 0.0


@dataclass
class Shift:
    """One plan driven by one fleet."""

    seed: int
    tractors: int
    now: float = 0.0
    frames: int = 0
    found: Counter[str] = field(default_factory=Counter)
    driven_s: float = 0.0

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)
        blocks = lay_blocks(self.tractors, self.rng)
        self.robots = HonestRobots(blocks, self.rng)
        self.fleet = FleetSession("f", "f", blocks.plan, FleetRules(), begin_s=EPOCH_S)
        self.fleet.twins.take_state = lambda *_: None  # type: ignore[method-assign]
        self.manager = self.fleet.manager
        self.base_ends_m = [mission.leg_starts_m for mission in blocks.plan.timed_missions]
        self.links = [Link(FleetClient(TRACTOR, f"tractor {n + 1}", n)) for n in range(self.tractors)]
        self.told: set[tuple[int, str]] = set()
        self.resumes: list[tuple[float, int | None]] = []

    def run(self, seconds: float, tell: Callable[[str], None] = print) -> None:
        """Drive until all are done, or for so long."""
        with patch("time.time", lambda: EPOCH_S + self.now):
            for link in self.links:
                self.fleet.add_client(link.client, self.now)
            self.manager.operators.start_fleet_work(WHO, self.now)
            while self.now < seconds and not self.robots.done.all():
                self.now = round(self.now + STEP_S, 6)
                self.robots.step()
                for number, text in enumerate(self.robots.report_all(self.now)):
                    self._carry(number, text)
                self._operate()
                self.fleet.step(self.now)
                self.fleet.recorder.take_waiting_rows()
                self._look(tell)
                self.driven_s += STEP_S * self.tractors

    def _carry(self, number: int, text: str) -> None:
        """A frame goes over the link of its robot, and what the robot was sent comes back."""
        link, rng = self.links[number], self.rng
        if self.now >= link.until_s:
            if rng.random() < AWAY_PER_H * STEP_S / 3600.0:
                link.until_s, link.kind, link.is_away = self.now + AWAY_S, int(rng.integers(4)), True
                if link.kind == BREAKS:
                    self.fleet.remove_client(link.client, self.now)
            elif rng.random() < HICCUPS_PER_H * STEP_S / 3600.0:
                link.until_s = self.now + rng.uniform(*HICCUP_S)
        if rng.random() >= LOST_SHARE:
            link.waiting.append(text)
        if self.now < link.until_s:
            link.away_s = self.now if link.is_away else link.away_s
            return
        if link.kind == BREAKS and link.client not in self.fleet.clients:
            link.client = FleetClient(TRACTOR, link.client.who, number)
            self.fleet.add_client(link.client, self.now)
        self._hear(number, link)
        kept = {NEWEST: link.waiting[-1:], NONE: []}.get(link.kind, link.waiting)
        link.waiting, link.kind, link.is_away = [], ALL, False
        for each in kept:
            link.heard_s = self.now
            self.frames += 1
            self.fleet.take_state(link.client, StateFrame.model_validate_json(each), self.now)

    def _hear(self, number: int, link: Link) -> None:
        for text, _ in link.client.outbox._waiting:
            frame = json.loads(text)
            match frame["kind"]:
                case "heartbeat" | "welcome":
                    self.robots.heartbeats_s[number] = frame["clock_s"] if frame["kind"] == "heartbeat" else None
                case "stop" | "resume":
                    self.robots.is_standing[number] = frame["kind"] == "stop"
                case "release":
                    self.robots.base_end_m[number] = self.base_ends_m[number][frame["base_end"]]
        link.client.outbox._waiting.clear()

    def _operate(self) -> None:
        """What operators do: pause, stop and resume, and answer for what is over or doubted."""
        rng, operators = self.rng, self.manager.operators
        if rng.random() < PAUSES_PER_H * self.tractors * STEP_S / 3600.0:
            number = int(rng.integers(self.tractors))
            operators.pause_tractors(WHO, number, self.now)
            self.resumes.append((self.now + rng.exponential(PAUSE_S), number))
        if rng.random() < STOPS_PER_H * STEP_S / 3600.0:
            operators.stop_all(WHO, self.now)
            self.resumes.append((self.now + STOP_S, None))
        for due_s, number in [each for each in self.resumes if each[0] <= self.now]:
            self.resumes.remove((due_s, number))
            try:
                operators.resume_tractors(WHO, number, self.now)
            except FleetManagerError:
                continue
        if round(self.now / STEP_S) % round(LOOK_S / STEP_S) == 0:
            for number, state in enumerate(self.manager.states):
                if Hold.DOUBTED in state.holds:
                    operators.resume_tractors(WHO, number, self.now)
            for alarm in self.manager.alarms.list_alarms():
                self.manager.obstacle_reports.acknowledge_alarm(WHO, alarm.id, self.now)
            self.told = {(alarm.id, alarm.level) for alarm in self.manager.alarms.list_alarms()}

    def _look(self, tell: Callable[[str], None]) -> None:
        for alarm in self.manager.alarms.list_alarms():
            if (alarm.id, alarm.level) in self.told or alarm.over:
                continue
            self.told.add((alarm.id, alarm.level))
            if not self._is_right(alarm):
                kind = alarm.code.partition(" ")[0] if alarm.code.startswith("near") else alarm.code
                self.found[f"{alarm.level} {kind}"] += 1
                tell(f"  shift {self.seed}, {self.now:.1f} s: {alarm.level} {alarm.code}: {alarm.sentence}")

    def _is_right(self, alarm: FleetAlarm) -> bool:
        """Whether its link has been away, or is silent for more than a second as short gaps follow one another."""
        if alarm.tractor is None or alarm.code not in ("broken", "late"):
            return False
        link = self.links[alarm.tractor]
        return self.now - link.away_s <= BACK_S or self.now - link.heard_s > SILENT_S


def describe(found: Counter[str], driven_h: float, tractors: int, frames: int) -> str:
    """How far it is, and what was false so far."""
    cpu_min = time.process_time() / 60.0
    kinds = ", ".join(f"{count} {kind}" for kind, count in sorted(found.items())) or "none"
    driven = f"{driven_h / tractors:.1f} h of a fleet of {tractors} ({driven_h:.0f} tractor hours"
    false = sum(count for kind, count in found.items() if kind.startswith(CRITICAL))
    return (
        f"{driven}, {frames / 1e6:.1f} million frames): {false} false critical alarms; all false ones: {kinds}. "
        f"{driven_h / cpu_min:.0f} tractor hours a minute of CPU"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--hours", type=float, default=100.0)
    parser.add_argument("--tractors", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    choice = parser.parse_args()
    found, driven_h, frames, seed = Counter[str](), 0.0, 0, SHIFTS_PER_SEED * choice.seed
    gc.disable()  # a fleet leaves no circles behind while it drives, and looking for them takes a tenth of the time
    while driven_h < choice.hours * choice.tractors:
        shift = Shift(seed, choice.tractors)
        shift.run(LONGEST_SHIFT_S, lambda text: print(text, flush=True))
        gc.collect()
        found, driven_h, frames, seed = (
            found + shift.found,
            driven_h + shift.driven_s / 3600.0,
            frames + shift.frames,
            seed + 1,
        )
        print(describe(found, driven_h, choice.tractors, frames), flush=True)


if __name__ == "__main__":
    main()
