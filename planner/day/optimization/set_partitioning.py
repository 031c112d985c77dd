"""Exact solution for more than a few fields: all routes that may be part of a better day, and the best choice of them.

Routes grow field by field. Of two routes with the same fields and the same last field, one that is neither earlier nor
cheaper is dropped, as is one that cannot be part of a cheaper day even with all other fields at their least cost. The
rest is chosen from by integer programming (HiGHS): at most one route per fleet, every field once or skipped. Effort is
counted in routes and nodes, never by the clock.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from planner.day.optimization.problem import DayProblem, DayProof, Route

MAX_LABELS = 150_000  # of all fleets, at about 10 microseconds each
COST_ROUNDING = 1e-6  # money, rounding error of sums
MAX_ROUTES, MAX_NODES = 40_000, 200


@dataclass(order=True, frozen=True)
class _PartialRoute:
    """A partial route: when its last field is done, its cost so far, its fields."""

    done_s: int
    cost: float
    route: Route


@dataclass
class _RouteEnumeration:
    """State of the growth of routes: least cost per field, cost limit, number of labels still allowed."""

    problem: DayProblem
    least_costs: Sequence[float]
    cost_limit: float
    remaining_labels: int
    best_routes: dict[int, tuple[float, Route]] = field(default_factory=dict)


def choose_routes(problem: DayProblem, known_cost: float, least_costs: Sequence[float]) -> DayProof | None:
    """The best routes and the bound, None with too many routes; `least_costs[f]` is the least cost of field f."""
    tables: dict[Any, dict[int, tuple[float, Route]]] = {}
    kinds, remaining_labels = [], MAX_LABELS
    for fleet in range(problem.fleet_count):
        kind = problem.get_fleet_kind(fleet)
        if kind not in tables:
            growth = _RouteEnumeration(problem, least_costs, known_cost + COST_ROUNDING, remaining_labels)
            if not _enumerate_routes(growth, fleet):
                return None
            tables[kind], remaining_labels = growth.best_routes, growth.remaining_labels
        kinds.append(kind)
    return _solve_set_partition(problem, [tables[kind] for kind in kinds])


def _enumerate_routes(growth: _RouteEnumeration, fleet: int) -> bool:
    """Find all useful routes of a fleet by their fields; returns whether their number is within limits."""
    problem, least_total = growth.problem, sum(growth.least_costs)
    layer: dict[tuple[int, int], list[_PartialRoute]] = {}
    empty = _PartialRoute(problem.begin_s, 0.0, ())
    for last, label, spare in _extend_label(growth, fleet, empty, problem.field_count, least_total):
        if label.cost + spare <= growth.cost_limit:
            layer[1 << last, last] = [label]
    while layer:
        next_layer: dict[tuple[int, int], list[_PartialRoute]] = {}
        for (mask, last), labels in layer.items():
            growth.remaining_labels -= len(labels)
            if growth.remaining_labels < 0:
                return False
            spare = least_total - sum(growth.least_costs[number] for number in labels[0].route)
            for label in labels:
                _store_complete_route(growth, fleet, mask, label, spare)
                for number, longer, longer_spare in _extend_label(growth, fleet, label, last, spare):
                    if longer.cost + longer_spare <= growth.cost_limit:
                        _add_undominated(next_layer.setdefault((mask | 1 << number, number), []), longer)
        layer = next_layer
    return True


def _extend_label(
    growth: _RouteEnumeration, fleet: int, label: _PartialRoute, place: int, spare: float
) -> Iterator[tuple[int, _PartialRoute, float]]:
    """Every route with one more field, and the least cost of all other fields."""
    problem = growth.problem
    for number in range(problem.field_count):
        work_s = problem.work_s[fleet][number]
        if work_s is None or number in label.route:
            continue
        start_s = problem.find_earliest_start(number, label.done_s + problem.travel_s[fleet][place][number], work_s)
        if start_s is not None and start_s + work_s <= problem.home_by_s:
            cost = label.cost + problem.travel_cost[fleet][place][number]
            cost += problem.compute_job_cost(fleet, number, start_s)
            longer = _PartialRoute(start_s + work_s, cost, (*label.route, number))
            yield number, longer, spare - growth.least_costs[number]


def _store_complete_route(growth: _RouteEnumeration, fleet: int, mask: int, label: _PartialRoute, spare: float) -> None:
    """Store the route with its return if it is the best one for its fields."""
    problem, last = growth.problem, label.route[-1]
    cost = label.cost + problem.travel_cost[fleet][last][problem.field_count]
    home_s = label.done_s + problem.travel_s[fleet][last][problem.field_count]
    if home_s > problem.home_by_s or cost + spare > growth.cost_limit:
        return
    if mask not in growth.best_routes or (cost, label.route) < growth.best_routes[mask]:
        growth.best_routes[mask] = cost, label.route


def _add_undominated(labels: list[_PartialRoute], candidate: _PartialRoute) -> None:
    """Add a route unless one with the same fields and last field is as early and as cheap."""
    if any(old.done_s <= candidate.done_s and old.cost <= candidate.cost for old in labels):
        return
    labels[:] = [old for old in labels if not (candidate.done_s <= old.done_s and candidate.cost <= old.cost)]
    labels.append(candidate)


def _solve_set_partition(problem: DayProblem, tables: Sequence[dict[int, tuple[float, Route]]]) -> DayProof | None:
    """The best choice of routes: a column for skipping each field, then one per fleet and route."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csc_matrix

    columns = [(fleet, *cost_and_route) for fleet, table in enumerate(tables) for cost_and_route in table.values()]
    if len(columns) > MAX_ROUTES:
        return None
    count = problem.field_count
    covered = [(number, number) for number in range(count)]
    for column, (fleet, _, route) in enumerate(columns, start=count):
        covered += [(number, column) for number in (*route, count + fleet)]
    rows, column_indexes = np.array(covered).T
    shape = count + problem.fleet_count, count + len(columns)
    uses = csc_matrix((np.ones(len(rows)), (rows, column_indexes)), shape=shape)
    least = np.concatenate((np.ones(count), np.zeros(problem.fleet_count)))
    prices = np.array([*problem.skip_cost, *(cost for _, cost, _ in columns)])
    solution = milp(
        prices,
        constraints=LinearConstraint(uses, least, np.ones(len(least))),
        integrality=np.ones(len(prices)),
        bounds=Bounds(0.0, 1.0),
        options={"node_limit": MAX_NODES, "mip_rel_gap": 0.0},
    )
    lower_bound = solution.mip_dual_bound
    if lower_bound is None or not math.isfinite(lower_bound):
        return None
    if solution.x is None:
        return DayProof(None, float(lower_bound))
    routes: list[Route] = [()] * problem.fleet_count
    for column in np.flatnonzero(solution.x[count:] > 0.5).tolist():
        fleet, _, route = columns[column]
        routes[fleet] = route
    return DayProof(tuple(routes), float(lower_bound))
