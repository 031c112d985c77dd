"""Tractors that were served in a run, and those that were served at once where only one can be."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from strategies.program.supply import Supply
from vehicle.arrays import find_true_spans
from vehicle.missions.run import SimulationRun
from vehicle.records import STANDING

OVERLAP_TOLERANCE_S = 1.0


@dataclass(frozen=True)
class CompletedServiceStop:
    """A service stop in a run: the tractor (from 0), and from when to when it stood (s)."""

    tractor: int
    from_s: float
    to_s: float


def find_service_stops(run: SimulationRun) -> list[CompletedServiceStop]:
    """All service stops of a run, in order of time."""
    step_s = float(run.time_s[1] - run.time_s[0]) if len(run.time_s) > 1 else 0.0
    stops = []
    for tractor in range(run.plan.tractors):
        spans = find_true_spans(run.get_statuses(tractor) == STANDING).tolist()
        stops += [CompletedServiceStop(tractor, first * step_s, last * step_s) for first, last in spans]
    return sorted(stops, key=lambda one: (one.from_s, one.tractor))


def find_service_conflict(run: SimulationRun, supply: Supply | None) -> str | None:
    """Why a run without contacts is not feasible: two tractors were served at once where only one can be; else None."""
    if supply is None or not supply.one_at_a_time:
        return None
    for before, after in pairwise(find_service_stops(run)):
        if after.from_s < before.to_s - OVERLAP_TOLERANCE_S:
            return (
                f"tractors {before.tractor + 1} and {after.tractor + 1} are served at the same time after "
                f"{after.from_s:.0f} s, but only one can be served at a time"
            )
    return None
