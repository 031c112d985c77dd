"""Days of more than a few fields proven: every route that may be part of a better day, and the best choice of them.

Routes grow field by field. Of two that work the same fields and end at the same one, the one that is neither sooner nor
cheaper is dropped; so is what cannot be part of a day cheaper than the one that is known, with all other fields at
their least. What is left is chosen from by integer programming (HiGHS): at most one route for a fleet, every field
once or left. Efforts are counted in routes and nodes, never by the clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from planner.day.insertion import Routes
from planner.day.problem import Problem, Route

MOST_LABELS = 150_000  # of all fleets together, at some 10 microseconds each
ROUND_UP = 1e-6  # of money: what sums may be off by
MOST_ROUTES, MOST_NODES = 40_000, 200


@dataclass(frozen=True)
class Choice:
    """The best day out of all routes (None: no better one than known), and what no day costs less than."""

    routes: Routes | None
    bound: float


@dataclass(order=True, frozen=True)
class _Label:
    """A route that goes on: when its last field is done, what it has cost, its fields."""

    done_s: int
    cost: float
    route: Route


@dataclass
class _Growth:
    """What is known while routes grow: least cost per field, the cost to stay under, how many more may be made."""

    problem: Problem
    least: Sequence[float]
    below: float
    left: int
    best: dict[int, tuple[float, Route]] = field(default_factory=dict)


def chosen(problem: Problem, known: float, least: Sequence[float]) -> Choice | None:
    """The proof, None where there are too many routes. `known` is the cost of a day, `least[f]` that of field f."""
    tables: dict[Any, dict[int, tuple[float, Route]]] = {}
    kinds, left = [], MOST_LABELS
    for fleet in range(problem.fleets):
        kind = problem.kind(fleet)
        if kind not in tables:
            growth = _Growth(problem, least, known + ROUND_UP, left)
            if not _grow(growth, fleet):
                return None
            tables[kind], left = growth.best, growth.left
        kinds.append(kind)
    return _choose(problem, [tables[kind] for kind in kinds])


def _grow(growth: _Growth, fleet: int) -> bool:
    """All routes of a fleet worth having, by their fields; whether their number is within limits."""
    problem, rest = growth.problem, sum(growth.least)
    layer: dict[tuple[int, int], list[_Label]] = {}
    for last, label, spare in _onward(growth, fleet, _Label(problem.begin_s, 0.0, ()), problem.fields, rest):
        if label.cost + spare <= growth.below:
            layer[1 << last, last] = [label]
    while layer:
        after: dict[tuple[int, int], list[_Label]] = {}
        for (mask, last), labels in layer.items():
            growth.left -= len(labels)
            if growth.left < 0:
                return False
            spare = rest - sum(growth.least[number] for number in labels[0].route)
            for label in labels:
                _finish(growth, fleet, mask, label, spare)
                for number, longer, other in _onward(growth, fleet, label, last, spare):
                    if longer.cost + other <= growth.below:
                        _keep(after.setdefault((mask | 1 << number, number), []), longer)
        layer = after
    return True


def _onward(
    growth: _Growth, fleet: int, label: _Label, at: int, spare: float
) -> Iterator[tuple[int, _Label, float]]:
    """A route with one more field, and the least cost of all fields that are still outside."""
    problem = growth.problem
    for number in range(problem.fields):
        work = problem.work_s[fleet][number]
        if work is None or number in label.route:
            continue
        start = problem.earliest(number, label.done_s + problem.move_s[fleet][at][number], work)
        if start is not None and start + work <= problem.home_by_s:
            cost = label.cost + problem.move_cost[fleet][at][number] + problem.job_cost(fleet, number, start)
            longer = _Label(start + work, cost, (*label.route, number))
            yield number, longer, spare - growth.least[number]


def _finish(growth: _Growth, fleet: int, mask: int, label: _Label, spare: float) -> None:
    """The route with its way home, where that is the best one for its fields."""
    problem, last = growth.problem, label.route[-1]
    cost = label.cost + problem.move_cost[fleet][last][problem.fields]
    if label.done_s + problem.move_s[fleet][last][problem.fields] > problem.home_by_s or cost + spare > growth.below:
        return
    if mask not in growth.best or (cost, label.route) < growth.best[mask]:
        growth.best[mask] = cost, label.route


def _keep(labels: list[_Label], new: _Label) -> None:
    """Add a route where none of those with the same fields and end is as soon and as cheap."""
    if any(old.done_s <= new.done_s and old.cost <= new.cost for old in labels):
        return
    labels[:] = [old for old in labels if not (new.done_s <= old.done_s and new.cost <= old.cost)]
    labels.append(new)


def _choose(problem: Problem, tables: Sequence[dict[int, tuple[float, Route]]]) -> Choice | None:
    """The choice of routes: a column per field that is left, then one per fleet and route."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csc_matrix

    columns = [(fleet, *one) for fleet, table in enumerate(tables) for one in table.values()]
    if len(columns) > MOST_ROUTES:
        return None
    count = problem.fields
    covered = [(number, number) for number in range(count)]
    for place, (fleet, _, route) in enumerate(columns, start=count):
        covered += [(number, place) for number in (*route, count + fleet)]
    rows, places = np.array(covered).T
    shape = count + problem.fleets, count + len(columns)
    uses = csc_matrix((np.ones(len(rows)), (rows, places)), shape=shape)
    least = np.concatenate((np.ones(count), np.zeros(problem.fleets)))
    prices = np.array([*problem.put_off, *(cost for _, cost, _ in columns)])
    found = milp(
        prices, constraints=LinearConstraint(uses, least, np.ones(len(least))), integrality=np.ones(len(prices)),
        bounds=Bounds(0.0, 1.0), options={"node_limit": MOST_NODES, "mip_rel_gap": 0.0},
    )  # fmt: skip
    bound = found.mip_dual_bound
    if bound is None or not math.isfinite(bound):
        return None
    routes = None if found.x is None else tuple(_taken(columns, found.x[count:] > 0.5, problem.fleets))
    return Choice(routes, float(bound))


def _taken(
    columns: Sequence[tuple[int, float, Route]], picked: npt.NDArray[np.bool_], fleets: int
) -> list[Route]:
    """The route of every fleet."""
    routes: list[Route] = [()] * fleets
    for place in np.flatnonzero(picked).tolist():
        fleet, _, route = columns[place]
        routes[fleet] = route
    return routes
