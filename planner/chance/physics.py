"""Some draws driven in full physics, beside what the graph says of them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from planner.chance.draws import draw
from planner.chance.graph import Graph, graph_of
from planner.chance.settings import Chances
from vehicle.missions import Leg, Mission, Plan
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor
from vehicle.world import World

DRIVES = 8
FASTEST = 3.0  # times the speed of the plan: turns that are drawn shorter than that are not driven so
PATIENCE = 3.0
Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Check:
    """Times of the last tractor in seconds, (drives,) each: `driven_s` in physics (nan: not done), `graph_s`.

    `meetings` counts drives in which two tractors touch (in the field one would stop), `stalls` those that did not end.
    Neither can be compared with the graph.
    """

    driven_s: Array
    graph_s: Array
    meetings: int
    stalls: int

    @property
    def error(self) -> float:
        """Mean of the relative error of the graph, without sign; nan where no drive can be compared."""
        error = np.abs(self.graph_s / self.driven_s - 1.0)
        return float(np.nanmean(error)) if np.isfinite(error).any() else float("nan")


def check(
    run: Run, chances: Chances, tractor: Tractor, implement: Implement, *, drives: int = DRIVES, seed: int = 1
) -> Check:
    """Drive a run again with the drawn factors on the speeds of its legs, without stops, breakdowns and late starts.

    Legs are driven so fast that each takes its drawn time; what does not depend on speed (changing gear, moving the
    wheels) stays as long as it was.
    """
    still = chances.without("stops").without("breakdowns").without("late start")
    graph = graph_of(run)
    sample = draw(graph, still, draws=drives, seed=seed, keep=True)
    assert sample.factor is not None
    driven = np.full(drives, np.nan)
    meetings = stalls = 0
    for number in range(drives):
        world = World(scaled(run.plan, graph, sample.factor[:, number]), tractor, implement)
        again = world.run(max_time_s=600.0 + PATIENCE * float(sample.finish_s[number]))
        meetings += bool(again.contacts)
        stalls += again.outcome != DONE
        if again.outcome == DONE and not again.contacts:
            driven[number] = again.duration_s
    return Check(driven, sample.finish_s, meetings, stalls)


def scaled(plan: Plan, graph: Graph, factor: Array) -> Plan:
    """The plan with every leg at the speed at which it takes `factor` (legs,) times its driven seconds."""
    missions = []
    for tractor, mission in enumerate(plan.missions):
        nodes = graph.of(tractor)
        own = zip(mission.legs, graph.driven_s[nodes].tolist(), factor[nodes].tolist(), strict=True)
        missions.append(Mission(tuple(replace(leg, speed_mps=_speed(leg, *times)) for leg, *times in own)))
    return replace(plan, missions=tuple(missions))


def _speed(leg: Leg, driven_s: float, factor: float) -> float:
    at_speed = leg.length_m / leg.speed_mps
    fixed = max(driven_s - at_speed, 0.0)
    return leg.length_m / max(factor * (at_speed + fixed) - fixed, at_speed / FASTEST)
