"""The best day and its gap: large neighbourhood search, and a proof by set partitioning or by bounds.

The search removes fields from a day and inserts them again better (Shaw 1998; Ropke and Pisinger 2006).

Then all routes that may be part of a better day are enumerated. Routes grow field by field. Of two routes with the same
fields and the same last field, one that is neither earlier nor cheaper is dropped, as is one that cannot be part of a
cheaper day even with all other fields at their least cost. The rest is chosen from by integer programming (SCIP of
OR-Tools): at most one route per fleet, every field once or skipped.

Effort is counted in priced routes, or in routes and nodes, never by the clock, so that the same input gives the same
day.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from planner.day.optimization.lagrangian_bound import compute_lower_bound
from planner.day.optimization.problem import (
    COST_TOLERANCE,
    DayProblem,
    DayProof,
    Route,
    Routes,
    make_empty_routes,
    repair_routes,
)
from planner.risk.random_events import create_generator

MAX_LABELS = 150_000  # of all fleets, at about 10 microseconds each


@dataclass(frozen=True)
class SearchRules:
    """How much is tried for a day, and what counts as equal."""

    # the search
    effort: int = 1_600_000  # priced routes, most of them cached: a second or two
    min_iterations: int = 30
    max_iterations: int = 3000
    min_removed: int = 2  # fields removed at a time
    removed_share: float = 0.4
    max_removed: int = 12
    worsening_share: float = 0.01  # of the cost: accepted worsening in the beginning
    # set partitioning
    max_routes: int = 40_000
    max_nodes: int = 200
    # rounding errors
    cost_rounding: float = 1e-6  # money, of sums
    gap_rounding_pct: float = 1e-3


RULES = SearchRules()


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
    best_routes: dict[int, tuple[float, Route]] = dataclasses.field(default_factory=dict)


def choose_routes(problem: DayProblem, known_cost: float, least_costs: Sequence[float]) -> DayProof | None:
    """The best routes and the bound, None with too many routes; `least_costs[f]` is the least cost of field f."""
    tables: dict[Any, dict[int, tuple[float, Route]]] = {}
    kinds, remaining_labels = [], MAX_LABELS
    for fleet in range(problem.fleet_count):
        kind = problem.get_fleet_kind(fleet)
        if kind not in tables:
            growth = _RouteEnumeration(problem, least_costs, known_cost + RULES.cost_rounding, remaining_labels)
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
    """The best choice of routes: every field skipped or on one of them, and one per fleet at most."""
    from ortools.linear_solver import pywraplp

    columns = [(fleet, *cost_and_route) for fleet, table in enumerate(tables) for cost_and_route in table.values()]
    if len(columns) > RULES.max_routes:
        return None
    solver = pywraplp.Solver.CreateSolver("SCIP")
    covers_field = [solver.Constraint(1.0, 1.0) for _ in range(problem.field_count)]
    has_fleet = [solver.Constraint(0.0, 1.0) for _ in tables]
    objective = solver.Objective()
    objective.SetMinimization()
    for number, cost in enumerate(problem.skip_cost):
        is_skipped = solver.BoolVar("")
        objective.SetCoefficient(is_skipped, cost)
        covers_field[number].SetCoefficient(is_skipped, 1.0)
    is_driven = [solver.BoolVar("") for _ in columns]
    for variable, (fleet, cost, route) in zip(is_driven, columns, strict=True):
        objective.SetCoefficient(variable, cost)
        for constraint in (has_fleet[fleet], *(covers_field[number] for number in route)):
            constraint.SetCoefficient(variable, 1.0)
    # Ctrl-C would otherwise only end the search
    solver.SetSolverSpecificParametersAsString(f"limits/nodes = {RULES.max_nodes}\nmisc/catchctrlc = FALSE")
    exact = pywraplp.MPSolverParameters()
    exact.SetDoubleParam(exact.RELATIVE_MIP_GAP, 0.0)
    if solver.Solve(exact) not in (solver.OPTIMAL, solver.FEASIBLE):
        return None
    routes: list[Route] = [()] * problem.fleet_count
    for variable, (fleet, _, route) in zip(is_driven, columns, strict=True):
        if variable.solution_value() > 0.5:
            routes[fleet] = route
    return DayProof(tuple(routes), objective.BestBound())


def search_routes(problem: DayProblem, *, seed: int = 1, effort: int = RULES.effort) -> Routes:
    """Routes by large neighbourhood search, never worse than plain insertion."""
    all_fields = range(problem.field_count)
    options = [repair_routes(problem, make_empty_routes(problem), all_fields, regret) for regret in (True, False)]
    best = current = min(options, key=lambda routes: _compute_cost_or_inf(problem, routes))
    removed_count = _compute_max_removed(problem)
    priced = removed_count * (removed_count + 1) // 2 * (problem.field_count + problem.fleet_count)  # in an iteration
    iterations = max(RULES.min_iterations, min(RULES.max_iterations, effort // max(priced, 1)))
    random = create_generator(seed, "day")
    for iteration in range(iterations):
        removed = _choose_removed_fields(problem, current, random)
        partial_routes = tuple(tuple(field for field in route if field not in removed) for route in current)
        pending = problem.list_skipped_fields(partial_routes)
        candidate = repair_routes(problem, partial_routes, pending, use_regret=bool(random.random() < 0.5))
        cost = _compute_cost_or_inf(problem, candidate)
        allowance = RULES.worsening_share * abs(_compute_cost_or_inf(problem, best)) * (1.0 - iteration / iterations)
        if cost < _compute_cost_or_inf(problem, best) - COST_TOLERANCE:
            best = candidate
        if cost <= _compute_cost_or_inf(problem, best) + allowance:
            current = candidate
    return best


def _compute_cost_or_inf(problem: DayProblem, routes: Routes) -> float:
    """Cost of a day, infinite if it is not feasible."""
    cost = problem.compute_day_cost(routes)
    return math.inf if cost is None else cost


def _compute_max_removed(problem: DayProblem) -> int:
    return max(RULES.min_removed, min(RULES.max_removed, round(RULES.removed_share * problem.field_count)))


def _choose_removed_fields(problem: DayProblem, routes: Routes, random: np.random.Generator) -> set[int]:
    """Fields to remove: half of the time neighbours, otherwise random fields."""
    worked_fields = sorted(field for route in routes for field in route)
    if not worked_fields:
        return set()
    count = min(len(worked_fields), int(random.integers(RULES.min_removed, _compute_max_removed(problem) + 1)))
    if random.random() < 0.5:
        return set(np.asarray(worked_fields)[random.permutation(len(worked_fields))[:count]].tolist())
    seed_field = worked_fields[int(random.integers(len(worked_fields)))]
    nearest = sorted(
        worked_fields, key=lambda field: (problem.travel_s[0][seed_field][field] if field != seed_field else -1, field)
    )
    return set(nearest[:count])


@dataclass(frozen=True)
class DaySolution:
    """Fields of every fleet in order, the cost, and the gap to the lower bound in percent of it; 0 is optimal."""

    routes: Routes
    cost: float
    gap_pct: float


def solve_day(problem: DayProblem, *, seed: int = 1) -> DaySolution:
    """The best day found; the same for the same problem and seed.

    Routes are enumerated; with too many of them the Lagrangian bound gives the gap.
    """
    routes = search_routes(problem, seed=seed)
    least_costs = compute_least_costs(problem)
    cost = _compute_cost_or_inf(problem, routes)
    solution = DaySolution(routes, cost, _compute_optimality_gap_pct(cost, sum(least_costs)))
    if solution.gap_pct > 0.0 and (proof := choose_routes(problem, solution.cost, least_costs)) is not None:
        solution = _improve_solution(problem, solution, proof)
    if solution.gap_pct > 0.0:
        bound = compute_lower_bound(problem, solution.cost, least_costs)
        solution = _improve_solution(problem, solution, DayProof(None, bound))
    return solution


def _improve_solution(problem: DayProblem, solution: DaySolution, proof: DayProof) -> DaySolution:
    """The solution improved by a proof: cheaper routes, a smaller gap."""
    routes, cost = solution.routes, solution.cost
    if proof.routes is not None and _compute_cost_or_inf(problem, proof.routes) < cost - COST_TOLERANCE:
        routes, cost = proof.routes, _compute_cost_or_inf(problem, proof.routes)
    previous_bound = solution.cost * (1.0 - 0.01 * solution.gap_pct)
    return DaySolution(routes, cost, _compute_optimality_gap_pct(cost, max(proof.lower_bound, previous_bound)))


def compute_least_costs(problem: DayProblem) -> list[float]:
    """Least cost of every field: skipped, or done at the earliest by its best fleet."""
    least_costs = []
    for field in range(problem.field_count):
        options = [problem.skip_cost[field]]
        elsewhere = [place for place in range(problem.field_count + 1) if place != field]
        for fleet in range(problem.fleet_count):
            work_s = problem.work_s[fleet][field]
            if work_s is None:
                continue
            arrives_s = problem.begin_s + min(problem.travel_s[fleet][place][field] for place in elsewhere)
            start_s = problem.find_earliest_start(field, arrives_s, work_s)
            if start_s is not None:
                travel_cost = min(problem.travel_cost[fleet][place][field] for place in elsewhere)
                options.append(problem.compute_job_cost(fleet, field, start_s) + travel_cost)
        least_costs.append(min(options))
    return least_costs


def _compute_optimality_gap_pct(cost: float, lower_bound: float) -> float:
    """The gap in percent of the cost; 0 within rounding."""
    gap = 100.0 * (cost - lower_bound) / cost if cost > 0.0 else 0.0
    return gap if gap > RULES.gap_rounding_pct else 0.0
