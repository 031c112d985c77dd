"""The best day and its gap: large neighbourhood search, and proofs by constraint model, set partitioning or bounds.

The search removes fields from a day and inserts them again better (Shaw 1998; Ropke and Pisinger 2006). Effort is
counted in priced routes, never by the clock, so that the same input gives the same day.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.day.optimization.constraint_model import solve_exactly
from planner.day.optimization.lagrangian_bound import compute_lower_bound
from planner.day.optimization.problem import (
    COST_TOLERANCE,
    DayProblem,
    DayProof,
    Routes,
    make_empty_routes,
    repair_routes,
)
from planner.day.optimization.set_partitioning import choose_routes
from planner.risk.random_events import create_generator

DEFAULT_EFFORT = 1_600_000  # priced routes, most of them cached: a second or two
MIN_ITERATIONS, MAX_ITERATIONS = 30, 3000
MIN_REMOVED, REMOVED_SHARE, MAX_REMOVED = 2, 0.4, 12  # fields removed at a time
WORSENING_SHARE = 0.01  # of the cost: accepted worsening in the beginning
EXACT_FIELDS = 8  # up to this number of fields, the constraint model is used
EXACT_EFFORT_S = 3.0  # deterministic seconds of the constraint model
ROUNDING_PCT = 1e-3
EXACT_SEARCH_EFFORT, LARGE_SEARCH_EFFORT = 20_000, DEFAULT_EFFORT  # priced routes


def search_routes(
    problem: DayProblem, start: Routes | None = None, *, seed: int = 1, effort: int = DEFAULT_EFFORT
) -> Routes:
    """Routes by large neighbourhood search, never worse than `start` or than plain insertion."""
    all_fields = range(problem.field_count)
    options = [repair_routes(problem, make_empty_routes(problem), all_fields, regret) for regret in (True, False)]
    options += [] if start is None else [start]
    best = current = min(options, key=lambda routes: _compute_cost_or_inf(problem, routes))
    removed_count = _compute_max_removed(problem)
    priced = removed_count * (removed_count + 1) // 2 * (problem.field_count + problem.fleet_count)  # in an iteration
    iterations = max(MIN_ITERATIONS, min(MAX_ITERATIONS, effort // max(priced, 1)))
    random = create_generator(seed, "day")
    for iteration in range(iterations):
        removed = _choose_removed_fields(problem, current, random)
        partial_routes = tuple(tuple(field for field in route if field not in removed) for route in current)
        pending = {field for field in all_fields if not any(field in route for route in partial_routes)}
        candidate = repair_routes(problem, partial_routes, pending, use_regret=bool(random.random() < 0.5))
        cost = _compute_cost_or_inf(problem, candidate)
        allowance = WORSENING_SHARE * abs(_compute_cost_or_inf(problem, best)) * (1.0 - iteration / iterations)
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
    return max(MIN_REMOVED, min(MAX_REMOVED, round(REMOVED_SHARE * problem.field_count)))


def _choose_removed_fields(problem: DayProblem, routes: Routes, random: np.random.Generator) -> set[int]:
    """Fields to remove: half of the time neighbours, otherwise random fields."""
    worked_fields = sorted(field for route in routes for field in route)
    if not worked_fields:
        return set()
    count = min(len(worked_fields), int(random.integers(MIN_REMOVED, _compute_max_removed(problem) + 1)))
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


def solve_day(problem: DayProblem, *, seed: int = 1, exact_fields: int = EXACT_FIELDS) -> DaySolution:
    """The best day found; the same for the same problem and seed.

    For few fields the constraint model is solved. If it leaves a gap, and for many fields, routes are enumerated; with
    too many routes the Lagrangian bound gives the gap.
    """
    is_few = problem.field_count <= exact_fields
    routes = search_routes(problem, seed=seed, effort=EXACT_SEARCH_EFFORT if is_few else LARGE_SEARCH_EFFORT)
    least_costs = compute_least_costs(problem)
    cost = _compute_cost_or_inf(problem, routes)
    solution = DaySolution(routes, cost, _compute_optimality_gap_pct(cost, sum(least_costs)))
    if is_few and solution.gap_pct > 0.0:
        solution = _improve_solution(problem, solution, solve_exactly(problem, solution.routes, EXACT_EFFORT_S))
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
    return gap if gap > ROUNDING_PCT else 0.0
