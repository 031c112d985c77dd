"""From a state to the tick that shows it: `python -m tests.benchmarks.state_to_tick [--fleets 2] [--robots 25]`.

A real service with so many fleets, whose robots drive and report ten times a second, and one viewer of each fleet in a
process of its own. Told are the times from the sending of a state to the viewer's having the tick with it, and by how
much a sleep of 50 ms ends late in that process, which no service on this machine could be quicker than.
"""

import argparse
import asyncio
import contextlib
import multiprocessing
import os
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from tests.benchmarks.link_robots import HOST
from tests.benchmarks.links import probe, watch
from tests.benchmarks.squad import run_squad
from tests.service.running import run_service

GATHERED_S, LENGTH_M = 3.0, 2000.0


def watch_fleets(port: int, fleets: dict[str, str], seconds: float) -> tuple[list[float], list[float]]:
    """Ages of states in ticks and how late sleeps ended, seconds; fleets by id with a token for each."""
    late, asleep, until_s = list[float](), list[float](), time.monotonic() + seconds

    async def watch_all() -> None:
        links = {f"ws://{HOST}:{port}/api/v1/fleets/{fleet}/link": token for fleet, token in fleets.items()}
        await asyncio.gather(probe(asleep, until_s), *(watch(*link, late, until_s) for link in links.items()))

    asyncio.run(watch_all())
    return late, asleep


def format_percentiles(seconds: list[float]) -> str:
    """Median, 99th percentile and greatest in ms."""
    p50, p99 = (1e3 * float(np.percentile(seconds, each)) for each in (50, 99))
    return f"p50 {p50:.0f} ms, p99 {p99:.0f} ms, most {1e3 * max(seconds):.0f} ms"


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks.state_to_tick")
    for name, usual in (("fleets", 2), ("robots", 25), ("seconds", 60.0)):
        parser.add_argument(f"--{name}", type=type(usual), default=usual)
    given = parser.parse_args()
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="headland-ticks-")))
        service = stack.enter_context(run_service(folder / "data"))
        watching = stack.enter_context(ProcessPoolExecutor(1, multiprocessing.get_context("spawn")))
        squads = [stack.enter_context(run_squad(service, given.robots, LENGTH_M)) for _ in range(given.fleets)]
        for squad in squads:
            squad.go()
        time.sleep(GATHERED_S)
        fleets = {squad.fleet: squad.orders for squad in squads}
        late, asleep = watching.submit(watch_fleets, service.port, fleets, given.seconds).result()
    print(f"{given.fleets} x {given.robots} robots at 10 Hz for {given.seconds:g} s, {len(late)} states seen")
    print(f"state to tick: {format_percentiles(late)}")
    load = f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores"
    print(f"this machine: {load}; a sleep of 50 ms ends late by {format_percentiles(asleep)}")


if __name__ == "__main__":
    main()
