"""Bring every compiled function into memory by one small simulation."""

from __future__ import annotations

import numpy as np

from vehicle.missions import Follow, Gate, Leg, Mission, Plan
from vehicle.tractor import Implement, load_tractor
from vehicle.world import simulate


def run_once() -> None:
    """Drive two tractors a few metres, with a gate, a follower and a reverse leg."""
    tractor, implement = load_tractor("eg105"), Implement()

    def leg(y: float, start: float, end: float, **more: object) -> Leg:
        return Leg(np.array([[start, y], [end, y]]), 1.4, **more)  # type: ignore[arg-type]

    first = Mission((leg(0, 0, 8), leg(0, 8, 6, gear=-1)))
    second = Mission((leg(9, 0, 4, gates=(Gate(0, 0, 2.0),), follow=Follow(0, 0, 10.0)),))
    simulate(Plan((first, second)), tractor, implement, stop_clearance_m=0.05)
