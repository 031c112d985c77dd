"""The best day: proven for few fields, searched for many, and how far from the best it can be."""

from __future__ import annotations

from dataclasses import dataclass

from planner.day.exact import proven
from planner.day.insertion import Routes
from planner.day.problem import EVEN, Problem
from planner.day.search import searched

FEW = 8  # fields whose order is proven
EFFORT_FEW, EFFORT_MANY = 20.0, 4.0  # deterministic seconds of the constraint model
ROUNDING_PCT = 1e-3
SEARCH_FEW = 20_000  # routes priced before the constraint model takes over


@dataclass(frozen=True)
class Day:
    """Fields of every fleet in their order, what that costs, and by how much less any other day could, in percent.

    `gap_pct` is of the cost; 0 is proven to be the best.
    """

    routes: Routes
    cost: float
    gap_pct: float


def solved(problem: Problem, *, seed: int = 1, few: int = FEW) -> Day:
    """The best day that is found; the same for the same problem and seed."""
    if problem.fields <= few:
        found = searched(problem, seed=seed, effort=SEARCH_FEW)
        proof = proven(problem, found, EFFORT_FEW)
    else:
        found = searched(problem, seed=seed)
        proof = proven(problem, found, EFFORT_MANY)
    cost = problem.cost(found)
    other = None if proof.routes is None else problem.cost(proof.routes)
    if proof.routes is not None and other is not None and (cost is None or other < cost - EVEN):
        found, cost = proof.routes, other
    whole = 0.0 if cost is None else cost
    bound = max(proof.bound, simple_bound(problem))
    return Day(found, whole, _gap_pct(whole, bound))


def simple_bound(problem: Problem) -> float:
    """What no day costs less than: every field by itself, left or done at its soonest by the fleet that suits it."""
    total = 0.0
    for field in range(problem.fields):
        options = [problem.put_off[field]]
        for fleet in range(problem.fleets):
            work = problem.work_s[fleet][field]
            start = None if work is None else problem.earliest(field, _soonest(problem, field), work)
            if start is not None:
                prices = [row[field] for row in problem.move_cost[fleet]]
                way = min(price for place, price in enumerate(prices) if place != field)
                options.append(problem.job_cost(fleet, field, start) + way)
        total += min(options)
    return total


def _soonest(problem: Problem, field: int) -> int:
    """When somebody can be there at the earliest."""
    return problem.begin_s + min(row[field] for place, row in enumerate(problem.move_s) if place != field)


def _gap_pct(cost: float, bound: float) -> float:
    """The gap in percent of the cost; what rounding to whole units leaves is none."""
    gap = 100.0 * (cost - bound) / cost if cost > 0.0 else 0.0
    return gap if gap > ROUNDING_PCT else 0.0
