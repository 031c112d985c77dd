"""One small plan whose outcome is written down: any change in how tractors drive shows here first.

The figures are those of this program, not of the thesis. When a change of the model is meant, print
`summary(run)` and write down what it says, with the reason in the commit.
"""

from typing import Any

import numpy as np
import pytest

from vehicle.missions.plan import FollowOrder, LegGate, Plan
from vehicle.missions.run import SimulationRun
from vehicle.model.tractor import Implement, Tractor
from vehicle.sim.world import simulate

EXPECTED: dict[str, Any] = {
    "outcome": "done",
    "finish_s": [55.2, 63.4, 54.4, 12.8],
    "waiting_s": [0.0, 8.2, 0.0, 1.3],
    "contacts": [],
    "min_clearance_m": 0.299,
    "poses": [[8.990, -0.048, -1.571], [5.990, -0.048, -1.571], [33.016, -0.048, -1.572], [24.000, 5.047, 1.571]],
}


def summary(run: SimulationRun) -> dict[str, Any]:
    """What is compared: times exactly to the tenth, places to the millimetre."""
    return {
        "outcome": run.outcome,
        "finish_s": [round(float(time), 1) for time in run.finish_s],
        "waiting_s": [round(float(time), 1) for time in run.sum_seconds_by_status()["waiting"]],
        "contacts": [(round(time, 3), first, second) for time, first, second in run.contacts],
        "min_clearance_m": round(run.min_clearance_m, 3),
        "poses": [[round(float(value), 3) for value in row[:3]] for row in run.record[-1]],
    }


def test_the_golden_run(build: Any, eg105: Tractor) -> None:
    # Two tractors with a U-turn behind gates, a third in a switch-back, a fourth in formation with it.
    second = build.two_passes(-3.0)
    second[0] = second[0].copy_with_gates([LegGate(0, 0, 10.0)])
    second[1] = second[1].copy_with_gates([LegGate(0, 1, 9.0)])
    apart = [
        build.leg(*(leg.points + np.array([30.0, 0.0])), gear=leg.gear, speed_mps=leg.speed_mps, task=leg.task)
        for leg in build.switch_back()
    ]
    behind = [build.leg((24, -8), (24, 5), follow=FollowOrder(2, 0), ground="asphalt")]
    plan: Plan = build.plan(build.two_passes(), second, apart, behind)
    run = simulate(plan, eg105, Implement(width_m=3.0, hitch_m=1.5, length_m=1.0))
    found = summary(run)
    for key, expected in EXPECTED.items():
        if key == "poses":
            for row, place in zip(found[key], expected, strict=True):
                assert row == pytest.approx(place, abs=0.0011)
        elif key == "min_clearance_m":
            assert found[key] == pytest.approx(expected, abs=0.0011)
        else:
            assert found[key] == expected, key
    assert found.keys() == EXPECTED.keys()
