"""The constraint model of a day (OR-Tools CP-SAT): a circuit per fleet, windows, and losses by rain.

Costs are those of planner.day.optimization.problem in integer units of money. The effort is the deterministic time of
the solver, with one worker and a fixed seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from planner.day.optimization.problem import HASTE_COST_PER_S, DayProblem, DayProof, Routes

MAX_TOTAL_UNITS = 10**14  # for all costs of a day
MAX_UNITS_PER_MONEY = 10**8
SOLVER_SEED = 1


@dataclass(eq=False)
class _ConstraintModel:
    """Variables: `arcs[k, a, b]`, `assigned[k, f]`, `skipped[f]`, `start[f]`, and the terms of the cost."""

    problem: DayProblem
    units_per_money: float
    cp: Any
    arcs: dict[tuple[int, int, int], Any] = field(default_factory=dict)
    assigned: dict[tuple[int, int], Any] = field(default_factory=dict)
    skipped: list[Any] = field(default_factory=list)
    start: list[Any] = field(default_factory=list)
    price: list[Any] = field(default_factory=list)

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
    solver.parameters.random_seed = SOLVER_SEED
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
        MAX_UNITS_PER_MONEY,
        MAX_TOTAL_UNITS / max(sum(problem.skip_cost) + sum(problem.value_at_risk) + travel_cost + work_cost, 1.0),
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
