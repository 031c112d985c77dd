"""From a state to the tick that shows it: `python -m tests.benchmarks.state_to_tick [--fleets 2] [--robots 25]`.

A real service with so many fleets, whose robots drive and report ten times a second, and one viewer of each fleet in a
process of its own. Told are the times from the sending of a state to the viewer's having the tick with it, and by how
much a sleep of 50 ms ends late in that process, which no service on this machine could be quicker than.
"""

import argparse
import asyncio
import contextlib
import os
import shlex
import time
from typing import Any

import numpy as np

from tests.benchmarks.attack.__main__ import COMMAND
from tests.benchmarks.attack.flooding import run_flood
from tests.benchmarks.attack.service import HOST, run_service
from tests.benchmarks.attack.squad import run_squad
from tests.benchmarks.attack.web import API
from tests.benchmarks.links import probe, watch

GATHERED_S, LENGTH_M = 3.0, 2000.0


def watch_fleets(port: int, fleets: list[str], token: str, seconds: float) -> dict[str, Any]:
    """Ages of states in ticks and how late sleeps ended, seconds."""
    late, asleep, until_s = list[float](), list[float](), time.monotonic() + seconds

    async def watch_all() -> None:
        links = [f"ws://{HOST}:{port}{API}/fleets/{fleet}/link" for fleet in fleets]
        await asyncio.gather(probe(asleep, until_s), *(watch(link, token, late, until_s) for link in links))

    asyncio.run(watch_all())
    return {"late": late, "asleep": asleep}


def format_percentiles(seconds: list[float]) -> str:
    """Median, 99th percentile and greatest in ms."""
    p50, p99 = (1e3 * float(np.percentile(seconds, each)) for each in (50, 99))
    return f"p50 {p50:.0f} ms, p99 {p99:.0f} ms, most {1e3 * max(seconds):.0f} ms"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.state_to_tick")
    for name, usual in (("fleets", 2), ("robots", 25), ("seconds", 60.0)):
        parser.add_argument(f"--{name}", type=type(usual), default=usual)
    parser.add_argument("--command", default=COMMAND, help="what starts the service; ends in serve")
    given = parser.parse_args()
    with run_service(shlex.split(given.command)) as service, contextlib.ExitStack() as stack:
        squads = [stack.enter_context(run_squad(service, given.robots, LENGTH_M)) for _ in range(given.fleets)]
        for squad in squads:
            squad.go()
        time.sleep(GATHERED_S)
        arguments = (service.port, [squad.fleet for squad in squads], service.token("read"), given.seconds)
        with run_flood(watch_fleets, *arguments) as watching:
            found = watching.collect(given.seconds + 60.0)
    print(f"{given.fleets} x {given.robots} robots at 10 Hz for {given.seconds:g} s, {len(found['late'])} states seen")
    print(f"state to tick: {format_percentiles(found['late'])}")
    load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    print(f"this machine: {load}; a sleep of 50 ms ends late by {format_percentiles(found['asleep'])}")


if __name__ == "__main__":
    main()
