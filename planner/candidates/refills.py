"""Refills in the plans of a candidate, and whether they went as planned in its run."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import pairwise, product

import numpy as np

from strategies.errors import StrategyError
from strategies.job import Job
from strategies.record import Refined, Strategy
from strategies.refilling.plan import no_leave, with_refills
from vehicle.layout import STANDING
from vehicle.run import Run

SAME_S = 1.0


@dataclass(frozen=True)
class Served:
    """A refill in a run: the tractor (from 0), and from when to when it stood (s)."""

    tractor: int
    from_s: float
    to_s: float


def check_leave(job: Job, strategy: Strategy) -> None:
    """Refuse a formation that cannot do without refills, before it is driven; raises StrategyError."""
    supply = job.supply
    if supply is None or not strategy.abreast or job.tractors == 1 or not supply.alone:
        return
    length_m = job.layout.total_m + math.fsum(lap.length_m for lap in job.rounds)
    if supply.need(length_m, job.layout.width_m) > job.tractors * supply.capacity:
        raise StrategyError(no_leave(job, supply))


def refilled(job: Job, strategy: Strategy, choices: Iterable[Refined]) -> list[Refined]:
    """The plans with their refills; those that cannot have them are left out, and raised where none is left.

    Where one is served at a time, there is one with tractors that heed each other's turns and one without.
    """
    if job.supply is None:
        return list(choices)
    plans: list[Refined] = []
    refusal: StrategyError | None = None
    manners = (True, False) if job.supply.alone and job.tractors > 1 else (True,)
    for choice, staggered in product(choices, manners):
        try:
            plan = with_refills(job, choice.plan, abreast=strategy.abreast, staggered=staggered)
        except StrategyError as error:
            refusal = refusal or error
            continue
        if staggered or not plans or plan.notes["refills"] != plans[-1].plan.notes["refills"]:
            plans.append(replace(choice, plan=plan, run=None if plan.notes["refills"] else choice.run))
    if refusal is not None and not plans:
        raise refusal
    return plans


def served_of(run: Run) -> list[Served]:
    """Every stop for a refill in a run, in the order of time."""
    step_s = float(run.time_s[1] - run.time_s[0]) if len(run.time_s) > 1 else 0.0
    found = []
    for tractor in range(run.plan.tractors):
        stands = (run.status(tractor) == STANDING).astype(np.int8)
        edges = np.flatnonzero(np.diff(np.concatenate(([0], stands, [0])))).tolist()
        spans = zip(edges[::2], edges[1::2], strict=True)
        found += [Served(tractor, first * step_s, last * step_s) for first, last in spans]
    return sorted(found, key=lambda one: (one.from_s, one.tractor))


def crowded(run: Run, job: Job) -> str | None:
    """Why a run is not feasible though nobody met: two were served at once where only one can be; else None."""
    if job.supply is None or not job.supply.alone:
        return None
    for before, after in pairwise(served_of(run)):
        if after.from_s < before.to_s - SAME_S:
            return (
                f"tractors {before.tractor + 1} and {after.tractor + 1} refill at once after {after.from_s:.0f} s, "
                "where one is served at a time; fewer tractors may help"
            )
    return None
