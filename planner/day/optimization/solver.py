"""The best day and its gap: large neighbourhood search, and proofs by constraint model, set partitioning or bounds.

The search removes fields from a day and inserts them again better (Shaw 1998; Ropke and Pisinger 2006).

The constraint model of a day with few fields (OR-Tools CP-SAT) has a circuit per fleet, windows, and losses by rain,
with the costs of planner.day.optimization.problem in integer units of money.

Of more fields, all routes that may be part of a better day are enumerated. Routes grow field by field. Of two routes
with the same fields and the same last field, one that is neither earlier nor cheaper is dropped, as is one that cannot
be part of a cheaper day even with all other fields at their least cost. The rest is chosen from by integer programming
(HiGHS): at most one route per fleet, every field once or skipped.

Effort is counted in priced routes, in routes and nodes, or in the deterministic time of the constraint solver with one
worker and a fixed seed, never by the clock, so that the same input gives the same day.
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
    HASTE_COST_PER_S,
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
    exact_effort: int = 20_000  # priced routes before the constraint model
    min_iterations: int = 30
    max_iterations: int = 3000
    min_removed: int = 2  # fields removed at a time
    removed_share: float = 0.4
    max_removed: int = 12
    worsening_share: float = 0.01  # of the cost: accepted worsening in the beginning
    # the constraint model
    exact_fields: int = 8  # up to this number of fields it is used
    exact_effort_s: float = 3.0  # its deterministic seconds
    max_total_units: int = 10**14  # for all costs of a day
    max_units_per_money: int = 10**8
    # set partitioning
    max_routes: int = 40_000
    max_nodes: int = 200
    # rounding errors
    cost_rounding: float = 1e-6  # money, of sums
    gap_rounding_pct: float = 1e-3


RULES = SearchRules()


@dataclass(eq=False)
class _ConstraintModel:
    """Variables: `arcs[k, a, b]`, `assigned[k, f]`, `skipped[f]`, `start[f]`, and the terms of the cost."""

    problem: DayProblem
    units_per_money: float
    cp: Any
    arcs: dict[tuple[int, int, int], Any] = dataclasses.field(default_factory=dict)
    assigned: dict[tuple[int, int], Any] = dataclasses.field(default_factory=dict)
    skipped: list[Any] = dataclasses.field(default_factory=list)
    start: list[Any] = dataclasses.field(default_factory=list)
    price: list[Any] = dataclasses.field(default_factory=list)

    def convert_to_integer_money(self, value: float) -> int:
        """An amount of money in integer units."""
        return round(value * self.units_per_money)


def solve_exactly(problem: DayProblem, hint: Routes, effort_s: float) -> DayProof:
    """The best day within an effort (deterministic seconds), starting from known routes."""
    from ortools.sat.python import cp_model

    model = _ConstraintModel(problem, _choose_units(problem), cp_model.CpModel())
    _add_field_variables(model)
    for fleet in range(problem.fleet_count):
        _add_fleet_circuit(model, fleet)
    model.cp.minimize(sum(model.price))
    _add_route_hints(model, hint)
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = 1
    solver.parameters.catch_sigint_signal = False  # otherwise Ctrl-C would only end the search
    solver.parameters.max_deterministic_time = effort_s
    status = solver.solve(model.cp)
    if status not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return DayProof(None, 0.0)
    return DayProof(_extract_routes(model, solver), solver.best_objective_bound / model.units_per_money)


def _choose_units(problem: DayProblem) -> float:
    """Units per money, as many as integers allow."""
    travel_cost = sum(max(max(row) for row in prices) for prices in problem.travel_cost) * (problem.field_count + 1)
    work_cost = sum(max(row, default=0.0) for row in problem.work_cost) * problem.field_count
    return min(
        RULES.max_units_per_money,
        RULES.max_total_units / max(sum(problem.skip_cost) + sum(problem.value_at_risk) + travel_cost + work_cost, 1.0),
    )


def _add_field_variables(model: _ConstraintModel) -> None:
    """Start and skip cost of every field. A skipped field starts with the day."""
    problem, cp = model.problem, model.cp
    for number in range(problem.field_count):
        model.skipped.append(cp.new_bool_var(""))
        model.start.append(cp.new_int_var(problem.begin_s, max(problem.home_by_s, problem.begin_s), ""))
        for fleet in range(problem.fleet_count):
            model.assigned[fleet, number] = cp.new_bool_var("")
        assignments = [model.assigned[fleet, number] for fleet in range(problem.fleet_count)]
        cp.add_exactly_one([model.skipped[number], *assignments])
        cp.add(model.start[number] == problem.begin_s).only_enforce_if(model.skipped[number])
        model.price.append(model.convert_to_integer_money(problem.skip_cost[number]) * model.skipped[number])
        model.price.append(model.convert_to_integer_money(HASTE_COST_PER_S) * (model.start[number] - problem.begin_s))
        _add_window_constraints(model, number)


def _add_window_constraints(model: _ConstraintModel, number: int) -> None:
    """Work is done within one of the windows."""
    problem, cp = model.problem, model.cp
    window_choices = [cp.new_bool_var("") for _ in problem.windows[number]]
    cp.add_exactly_one([model.skipped[number], *window_choices])
    for (opens, closes), is_chosen in zip(problem.windows[number], window_choices, strict=True):
        cp.add(model.start[number] >= opens).only_enforce_if(is_chosen)
        for fleet in range(problem.fleet_count):
            work = problem.work_s[fleet][number]
            if work is not None:
                conditions = [is_chosen, model.assigned[fleet, number]]
                cp.add(model.start[number] + work <= closes).only_enforce_if(conditions)


def _add_fleet_circuit(model: _ConstraintModel, fleet: int) -> None:
    """The circuit of a fleet and its times; skipped nodes are loops."""
    problem, cp, depot = model.problem, model.cp, model.problem.field_count
    stays = cp.new_bool_var("")
    loops = [(depot, depot, stays)]
    for number in range(problem.field_count):
        is_assigned = model.assigned[fleet, number]
        loops.append((number, number, is_assigned.negated()))
        if problem.work_s[fleet][number] is None:
            cp.add(is_assigned == 0)
            continue
        cp.add_implication(is_assigned, stays.negated())
        _add_job_costs(model, fleet, number)
    workable_fields = [number for number in range(problem.field_count) if problem.work_s[fleet][number] is not None]
    for start in (*workable_fields, depot):
        for end in (*workable_fields, depot):
            if start != end:
                model.arcs[fleet, start, end] = cp.new_bool_var("")
                _add_travel_constraint(model, fleet, start, end)
    cp.add_circuit([*loops, *((start, end, arc) for (k, start, end), arc in model.arcs.items() if k == fleet)])


def _add_travel_constraint(model: _ConstraintModel, fleet: int, start: int, end: int) -> None:
    """Travel from one place to the next: cost and earliest start there."""
    problem, cp, depot = model.problem, model.cp, model.problem.field_count
    arc, travel_s = model.arcs[fleet, start, end], problem.travel_s[fleet][start][end]
    model.price.append(model.convert_to_integer_money(problem.travel_cost[fleet][start][end]) * arc)
    leaves = problem.begin_s if start == depot else model.start[start] + (problem.work_s[fleet][start] or 0)
    arrives = problem.home_by_s if end == depot else model.start[end]
    cp.add(leaves + travel_s <= arrives).only_enforce_if(arc)


def _add_job_costs(model: _ConstraintModel, fleet: int, number: int) -> None:
    """The cost of a field with this fleet: work, haste, and the loss for every onset of rain.

    The lost work is all of it or the part after the onset, whichever is less.
    """
    problem, cp = model.problem, model.cp
    work_s, is_assigned, start = problem.work_s[fleet][number] or 1, model.assigned[fleet, number], model.start[number]
    model.price.append(
        model.convert_to_integer_money(problem.work_cost[fleet][number] + HASTE_COST_PER_S * work_s) * is_assigned
    )
    for onset_s, share in problem.rain.onsets:
        rate = model.convert_to_integer_money(problem.value_at_risk[number] * share / work_s)
        last_close_s = max(closes for _, closes in problem.windows[number]) if problem.windows[number] else 0
        if not rate or last_close_s <= onset_s:
            continue
        undone, lost = cp.new_int_var(0, work_s, ""), cp.new_bool_var("")
        cp.add(undone == work_s).only_enforce_if([is_assigned, lost])
        cp.add(undone >= start + (work_s - onset_s)).only_enforce_if([is_assigned, lost.negated()])
        model.price.append(rate * undone)


def _add_route_hints(model: _ConstraintModel, hint: Routes) -> None:
    problem = model.problem
    hinted_arcs = {
        (fleet, a, b)
        for fleet, route in enumerate(hint)
        for a, b in zip((problem.field_count, *route), (*route, problem.field_count), strict=True)
        if route
    }
    for arc, variable in model.arcs.items():
        model.cp.add_hint(variable, arc in hinted_arcs)
    for fleet, route in enumerate(hint):
        for number, start in zip(route, problem.schedule_starts(fleet, route) or (), strict=False):
            model.cp.add_hint(model.start[number], start)


def _extract_routes(model: _ConstraintModel, solver: Any) -> Routes:
    routes = []
    for fleet in range(model.problem.fleet_count):
        successors = {a: b for (k, a, b), arc in model.arcs.items() if k == fleet and solver.boolean_value(arc)}
        route, node = [], successors.get(model.problem.field_count, model.problem.field_count)
        while node != model.problem.field_count:
            route.append(node)
            node = successors[node]
        routes.append(tuple(route))
    return tuple(routes)


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
    """The best choice of routes: a column for skipping each field, then one per fleet and route."""
    from scipy.optimize import Bounds, LinearConstraint, milp
    from scipy.sparse import csc_matrix

    columns = [(fleet, *cost_and_route) for fleet, table in enumerate(tables) for cost_and_route in table.values()]
    if len(columns) > RULES.max_routes:
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
        options={"node_limit": RULES.max_nodes, "mip_rel_gap": 0.0},
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


def solve_day(problem: DayProblem, *, seed: int = 1, exact_fields: int = RULES.exact_fields) -> DaySolution:
    """The best day found; the same for the same problem and seed.

    For few fields the constraint model is solved. If it leaves a gap, and for many fields, routes are enumerated; with
    too many routes the Lagrangian bound gives the gap.
    """
    is_few = problem.field_count <= exact_fields
    routes = search_routes(problem, seed=seed, effort=RULES.exact_effort if is_few else RULES.effort)
    least_costs = compute_least_costs(problem)
    cost = _compute_cost_or_inf(problem, routes)
    solution = DaySolution(routes, cost, _compute_optimality_gap_pct(cost, sum(least_costs)))
    if is_few and solution.gap_pct > 0.0:
        solution = _improve_solution(problem, solution, solve_exactly(problem, solution.routes, RULES.exact_effort_s))
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
