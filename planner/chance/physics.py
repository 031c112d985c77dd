"""Some draws driven in full physics, beside what the graph says of them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from planner.chance.draws import draw, drive
from planner.chance.graph import PASS, Graph, graph_of
from planner.chance.settings import Chances
from vehicle.missions import Leg, Mission, Plan
from vehicle.run import DONE, Run
from vehicle.tractor import Implement, Tractor
from vehicle.world import World

DRIVES = 8
FASTEST = 3.0  # times the speed of the plan: turns that are drawn shorter than that are not driven so
PATIENCE = 3.0
SHORTEST_S = 0.1
ACCELERATION_MPS2 = 0.7
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
    wheels) stays as long as it was. Turns that are drawn quicker than the tractor can turn are driven as quickly as it
    can, and the graph is asked about those.
    """
    still = chances.without("stops").without("breakdowns").without("late start")
    graph = graph_of(run)
    sample = draw(graph, still, draws=drives, seed=seed, keep=True)
    assert sample.factor is not None
    driven, factor = np.full(drives, np.nan), sample.factor.copy()
    meetings = stalls = 0
    for number in range(drives):
        plan = scaled(run.plan, graph, factor[:, number], tractor.speed.max_acceleration_mps2)
        again = World(plan, tractor, implement).run(max_time_s=600.0 + PATIENCE * float(sample.finish_s[number]))
        meetings += bool(again.contacts)
        stalls += again.outcome != DONE
        if again.outcome == DONE and not again.contacts:
            driven[number] = again.duration_s
            factor[:, number] = _driven_factor(graph, graph_of(again), factor[:, number])
    return Check(driven, drive(graph, factor).finish_s, meetings, stalls)


def _driven_factor(graph: Graph, again: Graph, factor: Array) -> Array:
    """The factors, but for turns quicker than simulated those that were driven: gears and wheels take their time."""
    quick = (graph.kind != PASS) & (factor < 1.0)
    took = again.driven_s / np.maximum(graph.driven_s, SHORTEST_S)
    return np.where(quick & (graph.driven_s > SHORTEST_S), took, factor)


def scaled(plan: Plan, graph: Graph, factor: Array, acceleration_mps2: float = ACCELERATION_MPS2) -> Plan:
    """The plan with every leg at the speed at which it takes `factor` (legs,) times its driven seconds."""
    missions = []
    for tractor, mission in enumerate(plan.missions):
        nodes = graph.of(tractor)
        gears = [0, *(leg.gear for leg in mission.legs), 0]
        own = zip(mission.legs, graph.driven_s[nodes].tolist(), factor[nodes].tolist(), strict=True)
        legs = []
        for index, (leg, driven_s, share) in enumerate(own):
            halts = index + 1 < len(mission.legs) and mission.legs[index + 1].stand_s > 0.0
            standing = (gears[index] != leg.gear or leg.stand_s > 0.0) + (gears[index + 2] != leg.gear or halts)
            lag = 0.5 * standing / acceleration_mps2
            legs.append(replace(leg, speed_mps=_speed(leg, driven_s, share, lag)))
        missions.append(Mission(tuple(legs)))
    return replace(plan, missions=tuple(missions))


def _speed(leg: Leg, driven_s: float, factor: float, lag: float) -> float:
    """The speed v at which length / v + lag v and what does not depend on speed take the drawn time.

    `lag` v are the seconds lost by setting off and stopping where a leg begins or ends at a standstill.
    """
    length, speed = leg.length_m, leg.speed_mps
    fixed = max(driven_s - length / speed - lag * speed, 0.0)
    scale = driven_s / (length / speed + lag * speed + fixed)
    left = factor * (driven_s / scale) - fixed if scale > 0.0 else 0.0
    root = left * left - 4.0 * lag * length
    if left <= 0.0 or root < 0.0:
        return FASTEST * speed
    return min(2.0 * length / (left + math.sqrt(root)), FASTEST * speed)
