"""`python -m tests.benchmarks.doubts`: from a slip hidden in a robot to its name and into the tractor file.

A fleet of one drives rows of 80 m. Told are when its twin doubted, what the diagnosis that began of itself named and
the CPU seconds that took, and whether the twin of the amended file has anything to doubt on the rest of the way.
"""

from __future__ import annotations

import argparse
import asyncio
import tempfile
import time
from pathlib import Path

from planner.service.fleets.fleet_sessions import prepare_with_files
from planner.service.jobs.workers import run_and_store_job
from tests.benchmarks.twins import rows
from tests.service.doubting import DoubtedFleet
from vehicle.missions.plan import Plan
from vehicle.missions.plan_file import format_plan
from vehicle.twin.step_motion import TractorNoise

NOISE_M, ROWS, STEP_S = TractorNoise().position_m, 6, 5.0
SCENARIO = {"field": "mine", "tractor": "eg105", "width_m": 3.0}


def main() -> None:
    """Print what became of the doubt."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effect", default="wheel_slip")
    parser.add_argument("--amount", type=float, default=0.1)
    arguments = parser.parse_args()
    text = format_plan(Plan((rows(ROWS),)), crs=None, origin_m=(1000.0, 2000.0), scenario=SCENARIO)
    with tempfile.TemporaryDirectory() as folder:
        found = DoubtedFleet(Path(folder), prepare_with_files(text, {}), {arguments.effect: arguments.amount}, NOISE_M)
        try:
            watch(found)
        finally:
            found.close()


def watch(fleet: DoubtedFleet) -> None:
    """Drive until a diagnosis is asked for, do that, take it into the file, and drive on."""
    while 0 not in fleet.live.diagnoses and not fleet.robot.stepper.state.done:
        fleet.drive(STEP_S)
    print(
        f"doubted at {fleet.live.diagnosed_doubts.get(0, float('nan')):.1f} s, diagnosis asked for by {fleet.now:.0f} s"
    )
    job = fleet.store.claim_job("bench")
    if job is None:
        return
    begun = time.process_time()
    run_and_store_job(fleet.store, "bench", job)
    print(f"diagnosed in {time.process_time() - begun:.1f} s of CPU")
    asyncio.run(fleet.look())
    print(f"named {fleet.live.findings[0]['named']}: {fleet.live.findings[0]['words']}")
    fleet.client.post("/api/v1/twins/f1/1/mend", json={"name": "mended"})
    fleet.drive(1000.0)
    twin = fleet.live.twins.items[0]
    print(f"at {fleet.now:.0f} s the mended twin doubts: {None if twin is None else twin.find_mismatch()}")


if __name__ == "__main__":
    main()
