"""The best day: proven by a constraint model for few fields, searched for many, and how far from the best it can be."""

from __future__ import annotations

import math
from dataclasses import dataclass

from planner.day.exact import proven
from planner.day.insertion import Routes
from planner.day.problem import EVEN, Problem
from planner.day.relaxed import bound
from planner.day.search import EFFORT, searched
from planner.day.sets import Choice, chosen

FEW = 8  # fields whose order is proven
EFFORT_FEW = 3.0  # deterministic seconds of the constraint model
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
    """The best day that is found; the same for the same problem and seed.

    Few fields are proven by the constraint model. Where that leaves a gap, and for many, routes are counted; where
    these are too many, prices on fields tell how near to the best the day is.
    """
    is_few = problem.fields <= few
    found = searched(problem, seed=seed, effort=SEARCH_FEW if is_few else SEARCH_MANY)
    least = least_each(problem)
    best = Day(found, _cost(problem, found), _gap_pct(_cost(problem, found), sum(least)))
    if is_few and best.gap_pct > 0.0:
        proof = proven(problem, best.routes, EFFORT_FEW)
        best = _better(problem, best, Choice(proof.routes, proof.bound))
    if best.gap_pct > 0.0 and (choice := chosen(problem, best.cost, least)) is not None:
        best = _better(problem, best, choice)
    if best.gap_pct > 0.0:
        best = _better(problem, best, Choice(None, bound(problem, best.cost, least)))
    return best


def _better(problem: Problem, day: Day, choice: Choice) -> Day:
    """A day with what a proof has found: other routes that cost less, a smaller gap."""
    routes, cost = day.routes, day.cost
    if choice.routes is not None and _cost(problem, choice.routes) < cost - EVEN:
        routes, cost = choice.routes, _cost(problem, choice.routes)
    known = day.cost * (1.0 - 0.01 * day.gap_pct)
    return Day(routes, cost, _gap_pct(cost, max(choice.bound, known)))


def _cost(problem: Problem, routes: Routes) -> float:
    cost = problem.cost(routes)
    return math.inf if cost is None else cost


def least_each(problem: Problem) -> list[float]:
    """What each field costs at least: left, or done at its soonest by the fleet that suits it."""
    least = []
    for field in range(problem.fields):
        options = [problem.put_off[field]]
        for fleet in range(problem.fleets):
            work = problem.work_s[fleet][field]
            start = None if work is None else problem.earliest(field, _soonest(problem, fleet, field), work)
            if start is not None:
                prices = [row[field] for row in problem.move_cost[fleet]]
                way = min(price for place, price in enumerate(prices) if place != field)
                options.append(problem.job_cost(fleet, field, start) + way)
        least.append(min(options))
    return least


def _soonest(problem: Problem, fleet: int, field: int) -> int:
    """When a fleet can be there at the earliest."""
    return problem.begin_s + min(row[field] for place, row in enumerate(problem.move_s[fleet]) if place != field)


def _gap_pct(cost: float, bound: float) -> float:
    """The gap in percent of the cost; what rounding to whole units leaves is none."""
    gap = 100.0 * (cost - bound) / cost if cost > 0.0 else 0.0
    return gap if gap > ROUNDING_PCT else 0.0
