"""The best day: proven by a constraint model for few fields, searched for many, and how far from the best it can be."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.day.exact import proven
from planner.day.insertion import Routes
from planner.day.problem import EVEN, Problem
from planner.day.search import EFFORT, searched
from planner.day.sets import Choice, chosen

FEW = 8  # fields whose order is proven
EFFORT_FEW, EFFORT_MANY = 20.0, 4.0  # deterministic seconds of the constraint model
ROUNDING_PCT = 1e-3
SEARCH_FEW, SEARCH_MANY = 20_000, EFFORT  # routes priced by the search


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
    is_few = problem.fields <= few
    found = searched(problem, seed=seed, effort=SEARCH_FEW if is_few else SEARCH_MANY)
    cost, least = _cost(problem, found), least_each(problem)
    choice = None if is_few else chosen(problem, cost, least)
    if choice is None:
        proof = proven(problem, found, EFFORT_FEW if is_few else EFFORT_MANY)
        choice = Choice(proof.routes, proof.bound)
    other = choice.routes
    if other is not None and _cost(problem, other) < cost - EVEN:
        found, cost = other, _cost(problem, other)
    return Day(found, cost, _gap_pct(cost, max(choice.bound, sum(least))))


def _cost(problem: Problem, routes: Routes) -> float:
    cost = problem.cost(routes)
    return math.inf if cost is None else cost


def simple_bound(problem: Problem) -> float:
    """What no day costs less than: all fields at their least."""
    return sum(least_each(problem))


def least_each(problem: Problem) -> list[float]:
    """What each field costs at least: left, or done at its soonest by the fleet that suits it."""
    least = []
    for field in range(problem.fields):
        options = [problem.put_off[field]]
        for fleet in range(problem.fleets):
            work = problem.work_s[fleet][field]
            start = None if work is None else problem.earliest(field, _soonest(problem, field), work)
            if start is not None:
                prices = [row[field] for row in problem.move_cost[fleet]]
                way = min(price for place, price in enumerate(prices) if place != field)
                options.append(problem.job_cost(fleet, field, start) + way)
        least.append(min(options))
    return least


def _soonest(problem: Problem, field: int) -> int:
    """When somebody can be there at the earliest."""
    return problem.begin_s + min(row[field] for place, row in enumerate(problem.move_s) if place != field)


def _gap_pct(cost: float, bound: float) -> float:
    """The gap in percent of the cost; what rounding to whole units leaves is none."""
    gap = 100.0 * (cost - bound) / cost if cost > 0.0 else 0.0
    return gap if gap > ROUNDING_PCT else 0.0
