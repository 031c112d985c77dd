"""Item 9: kill -9 of the service while the project's own robot drives, and what it does once there is a new one."""

from __future__ import annotations

import math
import os
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from tests.benchmarks.attack.plans import lay_lines, make_fleet, write_plan
from tests.benchmarks.attack.relay import Relay, States, run_relay
from tests.benchmarks.attack.rows import Row
from tests.benchmarks.attack.service import HOST, Service, run_service
from tests.benchmarks.attack.squad import wait_for
from tests.benchmarks.attack.web import API, ask

SPEED_MPS, LENGTH_M = 2.5, 575.0
DRIVES_MPS, STANDS_MPS, MOVED_M = 2.0, 0.03, 0.2
STARTS_S, HORIZON_S, BRAKES_S, LOOKS_S = 120.0, 20.0, 5.0, 5.0


@dataclass(frozen=True)
class Seen:
    """Where a robot was: seconds since 1970, easting and northing (m), speed (m/s)."""

    time_s: float
    place: tuple[float, float]
    speed_mps: float


def attack_with_kill(command: Sequence[str], short: bool) -> list[Row]:
    """Kill the service, look how far the robot drives on, start a new service and look whether it moves.

    In the long form another one is left alone until it has come to the end of its leg.
    """
    rows = _kill_once(command, HORIZON_S + BRAKES_S + 1.0)
    return rows if short else [_kill_once(command, LENGTH_M / SPEED_MPS + 10.0)[0], rows[1]]


def _kill_once(command: Sequence[str], waits_s: float) -> list[Row]:
    with run_service(command) as service:
        states = States()
        with run_relay((HOST, service.port), states.watch) as relay, _run_robot(service, relay) as fleet:
            _start_driving(service, fleet, states)
            killed_s = time.time()
            service.kill()
            time.sleep(waits_s)  # what it does now it says once it is linked again
            service.start()
            begun_s = time.time()
            time.sleep(LOOKS_S)
            seen = _list_seen(states)
            ordered = _order(service, fleet, "start")
            time.sleep(LOOKS_S)
            last = _list_seen(states)[-1]
    return [_judge_kill(seen, killed_s, begun_s), _judge_restart(seen, begun_s, last, ordered)]


@contextmanager
def _run_robot(service: Service, relay: Relay) -> Iterator[str]:
    """A robot of the project on a straight leg, linked through a relay; the id of its fleet."""
    lines = lay_lines(1, LENGTH_M)
    fleet = make_fleet(service, "killed", lines, SPEED_MPS)
    token = service.new_token(["robot"], fleet, 1)
    with tempfile.TemporaryDirectory(prefix="headland-robot-") as folder:
        plan = Path(folder) / "plan.json"
        plan.write_text(write_plan(lines, SPEED_MPS))
        words = [*service.command[:-1], "robot", "--plan", str(plan), "--tractor", "1", "--noise-m", "0",
                 "--url", f"http://{HOST}:{relay.port}", "--fleet", fleet]  # fmt: skip
        with (Path(folder) / "log").open("wb") as log:
            robot = subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                     env=os.environ | {"HEADLAND_TOKEN": token})  # fmt: skip
        try:
            yield fleet
        finally:
            robot.kill()
            robot.wait(10.0)


def _start_driving(service: Service, fleet: str, states: States) -> None:
    """Wait until the robot reports, let it go, and wait until it drives; raises RuntimeError where it does not."""
    if not wait_for(lambda: len(states.states) > 5, STARTS_S):
        raise RuntimeError("The robot reports nothing.")
    _order(service, fleet, "start")
    if not wait_for(lambda: states.states[max(states.states)]["speed_mps"] > DRIVES_MPS, 20.0):
        raise RuntimeError("The robot does not drive.")


def _order(service: Service, fleet: str, what: str) -> int:
    return ask(service.port, "POST", f"{API}/fleets/{fleet}/{what}", token=service.token("operator", "planner"),
               body=b"", timeout_s=20.0).status  # fmt: skip


def _list_seen(states: States) -> list[Seen]:
    """What the robot has reported, by time."""
    return [_see(states.states[sequence]) for sequence in sorted(states.states)]


def _see(state: dict[str, Any]) -> Seen:
    when = datetime.fromisoformat(state["time"]).timestamp()
    return Seen(when, (state["easting_m"], state["northing_m"]), state["speed_mps"])


def _judge_kill(seen: Sequence[Seen], killed_s: float, begun_s: float) -> Row:
    """How long and how far it drove on, by what it reports afterwards."""
    alone = [one for one in seen if killed_s <= one.time_s <= begun_s]
    moving = [one for one in alone if one.speed_mps > STANDS_MPS]
    seconds = moving[-1].time_s - killed_s if moving else 0.0
    metres = math.dist(alone[0].place, alone[-1].place) if alone else math.nan
    known = bool(alone) and alone[-1].time_s > begun_s - 5.0
    stood = known and (not moving or moving[-1].time_s < alone[-1].time_s - 0.5)
    words = f"{seconds:.1f} s, {metres:.1f} m" + ("" if stood else ", and still driving" if known else ", then unknown")
    values = {"seconds": round(seconds, 2), "metres": round(metres, 2), "stood": stood, "speed_mps": SPEED_MPS}
    limit_s = HORIZON_S + BRAKES_S
    return Row("9a", f"kill -9 while a robot drives at {SPEED_MPS:g} m/s", words,
               f"stands within {limit_s:.0f} s, {limit_s * SPEED_MPS:.0f} m",
               stood and seconds <= limit_s and metres <= limit_s * SPEED_MPS, values)  # fmt: skip


def _judge_restart(seen: Sequence[Seen], begun_s: float, last: Seen, ordered: int) -> Row:
    """How far it moved while a new service was there and had given no order, and whether it goes on by one."""
    after = [one for one in seen if one.time_s >= begun_s]
    metres = math.dist(after[0].place, after[-1].place) if after else math.nan
    on_m = math.dist(after[-1].place, last.place) if after else 0.0
    words = f"{metres:.2f} m without an order, {on_m:.1f} m after one (status {ordered})"
    values = {"metres": round(metres, 3) if after else None, "after_order_m": round(on_m, 2), "states": len(after)}
    return Row("9b", "a new service after kill -9", words, "0 m until somebody orders it",
               bool(after) and metres <= MOVED_M, values)  # fmt: skip
