"""What it costs that fleets near by know each other: `python -m tests.benchmarks.neighbours [--seconds 20]`.

50 tractors in 1 to 20 fleets work neighbouring lines of one ground, each reporting ten times a second, and every fleet
takes twenty steps a second. Told are the mean and the longest time of one round of steps, of 50 ms that there are, with
and without the neighbourhood.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace

import numpy as np

from planner.fleet.manager.fleet_manager import FleetManager
from planner.fleet.manager.neighbourhood import Neighbourhood
from planner.fleet.model.rules import FleetRules
from planner.fleet.model.tractor_state import TractorReport
from planner.fleet.session.fleet_twins import warm_up
from tests.service.fleets import fleet_plan

TRACTORS, STEP_S, REPORT_S, APART_M, LENGTH_M = 50, 0.05, 0.1, 4.0, 400.0


def measure(fleets: int, seconds: float, together: bool) -> tuple[float, float, float]:
    """Mean and longest time of a round (ms), and the time that a fleet needs to be added (ms)."""
    hood, centres = Neighbourhood(), []
    each = [TRACTORS // fleets + (number < TRACTORS % fleets) for number in range(fleets)]
    added_s, before = 0.0, 0
    for number, count in enumerate(each):
        plan = fleet_plan(count, 4, apart_m=APART_M, length_m=LENGTH_M)
        plan = replace(plan, saved=replace(plan.saved, origin_m=(APART_M * before, 0.0)))
        centre = FleetManager(plan, FleetRules())
        for tractor in range(count):
            centre.connect_tractor(tractor, 0.0)
        begin = time.perf_counter()
        if together:
            hood.add(str(number), str(number), centre, lambda: None, 0.0)
        added_s = max(added_s, time.perf_counter() - begin)
        centre.operators.start_fleet_work("anna", 0.0)
        centres.append(centre)
        before += count
    rounds = []
    for step in range(round(seconds / STEP_S)):
        now = STEP_S * step
        if step % round(REPORT_S / STEP_S) == 0:
            for centre in centres:
                for tractor, state in enumerate(centre.states):
                    y = now % LENGTH_M
                    centre.take_report(
                        tractor,
                        TractorReport(APART_M * tractor, y, np.pi / 2, 1.0, 1.0, leg=min(0, state.leg), leg_m=y),
                        now,
                    )
        begin = time.perf_counter()
        for centre in centres:
            centre.update_fleet(now)
            centre.take_outputs()
        rounds.append(time.perf_counter() - begin)
    return 1e3 * float(np.mean(rounds)), 1e3 * max(rounds[1:]), 1e3 * added_s


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0)
    seconds = parser.parse_args().seconds
    warm_up()
    measure(2, 1.0, True)
    print("fleets  alone: mean longest  together: mean longest  added (ms)")
    for fleets in (1, 2, 5, 10, 20):
        alone, _, _ = measure(fleets, seconds, False), 0, 0
        mean, longest, added = measure(fleets, seconds, True)
        print(f"{fleets:6} {alone[0]:12.2f} {alone[1]:7.1f} {mean:15.2f} {longest:7.1f} {added:11.1f}")


if __name__ == "__main__":
    main()
