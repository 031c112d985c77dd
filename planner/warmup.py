"""Bring every compiled function into memory by one small simulation, and by letting two tractors give way."""

from __future__ import annotations

import numpy as np

from planner.yielding.giving_way import Rules, giving_way
from vehicle.missions import Follow, Gate, Leg, Mission, Plan
from vehicle.run import Run
from vehicle.tractor import Implement, Tractor, load_tractor
from vehicle.world import simulate


def run_once() -> None:
    """Drive two tractors a few metres, with a gate, a follower and a reverse leg."""
    tractor, implement = load_tractor("eg105"), Implement()

    def leg(y: float, start: float, end: float, **more: object) -> Leg:
        return Leg(np.array([[start, y], [end, y]]), 1.4, **more)  # type: ignore[arg-type]

    first = Mission((leg(0, 0, 8), leg(0, 8, 6, gear=-1)))
    second = Mission((leg(9, 0, 4, gates=(Gate(0, 0, 2.0),), follow=Follow(0, 0, 10.0)),))
    simulate(Plan((first, second)), tractor, implement, stop_clearance_m=0.05)
    _give_way(tractor, implement)


def _give_way(tractor: Tractor, implement: Implement) -> None:
    """Schedule two tractors that cross each other's way."""

    def mission(ahead: tuple[float, float]) -> Mission:
        steps = [np.outer([begin, begin + 12.0], ahead) for begin in (-24.0, -12.0, 0.0)]
        return Mission(tuple(Leg(points, 1.4, may_wait=True) for points in steps))

    def alone(each: Mission) -> Run:
        return simulate(Plan((each,)), tractor, implement)

    giving_way(Plan((mission((1.0, 0.0)), mission((0.0, 1.0)))), Rules(tractor, implement, 0.5, 0.5, alone))
