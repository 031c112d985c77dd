"""Stops of a plan that goes on otherwise than it was made: those there are stay, work that is taken over gets its own.

What a tractor carries is not told by a plan. What it has done with a load is: nobody is asked for more work with one
than some tractor of the plan does.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

from strategies.job import Job
from strategies.refilling.plan import queue
from strategies.refilling.stops import Gaps, Piece, Stop, filled_between, hold_of, pieces_of
from strategies.supply import HEADLAND, PLACE, Supply
from strategies.ways.paths import Pose
from vehicle.missions import REFILL, Leg, Mission, Plan

ROUNDING = 1e-9  # of sums of the same legs in another order


def supply_of(missions: Sequence[Sequence[Leg]], width_m: float, where: str) -> Supply | None:
    """What tractors with these legs carry, in square metres worked; None where none of them stops.

    A load is the most that one works between two stops. `where` counts where no leg leads to a place.
    """
    stops_s = [leg.stand_s for legs in missions for leg in legs if leg.stand_s > 0.0]
    if not stops_s:
        return None
    most_m = max(metres for legs in missions for metres in _loads_m(legs))
    return Supply(most_m * (1.0 + ROUNDING) * width_m, 1.0, max(stops_s), where=PLACE if berths_of(missions) else where)


def _loads_m(legs: Sequence[Leg]) -> Iterator[float]:
    """Metres worked between stops."""
    metres = 0.0
    for leg in legs:
        if leg.stand_s > 0.0:
            yield metres
            metres = 0.0
        metres += leg.length_m * leg.implement
    yield metres


@dataclass
class Going(Gaps):
    """Gaps of a tractor that is served where tractors of its plan have been served before."""

    known: tuple[Pose, ...] = ()

    @cached_property
    def berths(self) -> tuple[Pose, ...]:
        """Where tractors stand at a fixed place."""
        return self.known


def taken_up(job: Job, supply: Supply, legs: Sequence[Leg], own: int, known: tuple[Pose, ...] = ()) -> list[Leg]:
    """Legs of which the first `own` stay as they are, with stops in the others where the load that is left asks for it.

    At a place a tractor stands in one of the `known` poses. Raises StrategyError where a load is not enough for a piece
    of work, or no way leads to the place and back.
    """
    since = max((number for number in range(own) if legs[number].stand_s > 0.0), default=0)
    tail, kept = Mission(tuple(legs[since:])), own - since
    pieces = pieces_of(job, supply, tail)
    begun, later = [p for p in pieces if p.first < kept], [p for p in pieces if p.first >= kept]
    if not later:
        return list(legs)
    kept = max([kept, *(piece.last for piece in begun)])  # a track that is worked on straight is not left half-way
    used = math.fsum(piece.need for piece in begun)
    gaps = Going(job, supply, tail, [Piece(0, kept, min(used, supply.capacity)), *later], known=known)
    return [*legs[:since], *filled_between(gaps).legs]


def berths_of(missions: Sequence[Sequence[Leg]]) -> tuple[Pose, ...]:
    """The poses in which tractors of these legs stand at a place, each once."""
    found: dict[Pose, None] = {}
    for legs in missions:
        for before, leg in pairwise(legs):
            if leg.stand_s > 0.0 and before.task.kind == REFILL:
                (x, y), (x1, y1) = leg.points[:2].tolist()
                found.setdefault((x, y, math.atan2(leg.gear * (y1 - y), leg.gear * (x1 - x))))
    return tuple(found)


def served_in_turn(plan: Plan, supply: Supply) -> Plan:
    """The plan with gates by which its tractors are served one at a time, where only one can be."""
    if supply.where == HEADLAND or plan.tractors == 1:
        return plan
    legs = [list(mission.legs) for mission in plan.missions]
    queue(legs, [_stops(each) for each in legs], supply)
    return Plan(tuple(Mission(tuple(each)) for each in legs), plan.notes)


def _stops(legs: Sequence[Leg]) -> list[Stop]:
    """The stops of legs, and where a tractor may wait for its turn before each."""
    found: list[Stop] = []
    for number, leg in enumerate(legs):
        if leg.stand_s <= 0.0:
            continue
        to = number
        while to > 0 and legs[to - 1].task.kind == REFILL:
            to -= 1
        found.append(Stop(number, hold_of(legs[:to], found[-1].leg + 1 if found else 0), 0.0))
    return found
