"""The constraint model of a day (OR-Tools CP-SAT): a circuit per fleet, windows, and ground that the rain takes.

The same costs as in planner.day.problem, in whole units of money. Effort is the solver's deterministic time, with one
worker and a fixed seed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from planner.day.insertion import Routes
from planner.day.problem import HASTE, Problem

WHOLE = 10**14  # units that all money of a day comes to at most
FINEST = 10**8  # units of one money at most
SEED = 1


@dataclass(frozen=True)
class Proof:
    """The best day that was found, None without any, and what no day costs less than."""

    routes: Routes | None
    bound: float


@dataclass(eq=False)
class _Model:
    """Variables: `arcs[k, a, b]`, `present[k, f]`, `absent[f]`, `start[f]`, and the price of everything."""

    problem: Problem
    units: float
    cp: Any
    arcs: dict[tuple[int, int, int], Any] = field(default_factory=dict)
    present: dict[tuple[int, int], Any] = field(default_factory=dict)
    absent: list[Any] = field(default_factory=list)
    start: list[Any] = field(default_factory=list)
    price: list[Any] = field(default_factory=list)

    def money(self, value: float) -> int:
        """An amount in whole units."""
        return round(value * self.units)


def proven(problem: Problem, hint: Routes, effort: float) -> Proof:
    """The best day within an effort (deterministic seconds), beginning with a day that is known."""
    from ortools.sat.python import cp_model

    model = _Model(problem, _units(problem), cp_model.CpModel())
    _add_fields(model)
    for fleet in range(problem.fleets):
        _add_fleet(model, fleet)
    model.cp.minimize(sum(model.price))
    _add_hint(model, hint)
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.random_seed = SEED
    solver.parameters.catch_sigint_signal = False  # it would end the search alone, and nobody else would hear it
    solver.parameters.max_deterministic_time = effort
    found = solver.solve(model.cp)
    if found not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return Proof(None, 0.0)
    return Proof(_routes(model, solver), solver.best_objective_bound / model.units)


def _units(problem: Problem) -> float:
    """Units of money: as fine as whole numbers have room for."""
    ways = sum(max(max(row) for row in prices) for prices in problem.move_cost) * (problem.fields + 1)
    paid = sum(max(row, default=0.0) for row in problem.paid) * problem.fields
    return min(FINEST, WHOLE / max(sum(problem.put_off) + sum(problem.stake) + ways + paid, 1.0))


def _add_fields(model: _Model) -> None:
    """When each field begins, and what it costs to leave it. A field that is left begins with the day."""
    problem, cp = model.problem, model.cp
    for number in range(problem.fields):
        model.absent.append(cp.new_bool_var(""))
        model.start.append(cp.new_int_var(problem.begin_s, max(problem.home_by_s, problem.begin_s), ""))
        for fleet in range(problem.fleets):
            model.present[fleet, number] = cp.new_bool_var("")
        own = [model.present[fleet, number] for fleet in range(problem.fleets)]
        cp.add_exactly_one([model.absent[number], *own])
        cp.add(model.start[number] == problem.begin_s).only_enforce_if(model.absent[number])
        model.price.append(model.money(problem.put_off[number]) * model.absent[number])
        model.price.append(model.money(HASTE) * (model.start[number] - problem.begin_s))
        _add_windows(model, number)


def _add_windows(model: _Model, number: int) -> None:
    """Work is done in one of the windows. Ones that close too soon for any fleet are of no use."""
    problem, cp = model.problem, model.cp
    chosen = [cp.new_bool_var("") for _ in problem.windows[number]]
    cp.add_exactly_one([model.absent[number], *chosen])
    for (opens, closes), taken in zip(problem.windows[number], chosen, strict=True):
        cp.add(model.start[number] >= opens).only_enforce_if(taken)
        for fleet in range(problem.fleets):
            work = problem.work_s[fleet][number]
            if work is not None:
                on = [taken, model.present[fleet, number]]
                cp.add(model.start[number] + work <= closes).only_enforce_if(on)


def _add_fleet(model: _Model, fleet: int) -> None:
    """The circuit of a fleet and its times; nodes it leaves out are circuits of their own."""
    problem, cp, depot = model.problem, model.cp, model.problem.fields
    stays = cp.new_bool_var("")
    loops = [(depot, depot, stays)]
    for number in range(problem.fields):
        here = model.present[fleet, number]
        loops.append((number, number, here.negated()))
        if problem.work_s[fleet][number] is None:
            cp.add(here == 0)
            continue
        cp.add_implication(here, stays.negated())
        _add_job(model, fleet, number)
    able = [number for number in range(problem.fields) if problem.work_s[fleet][number] is not None]
    for a in (*able, depot):
        for b in (*able, depot):
            if a != b:
                model.arcs[fleet, a, b] = cp.new_bool_var("")
                _add_way(model, fleet, a, b)
    cp.add_circuit([*loops, *((a, b, arc) for (k, a, b), arc in model.arcs.items() if k == fleet)])


def _add_way(model: _Model, fleet: int, a: int, b: int) -> None:
    """One place after another: what the way costs, and how soon the second can begin."""
    problem, cp, depot = model.problem, model.cp, model.problem.fields
    arc, move = model.arcs[fleet, a, b], problem.move_s[fleet][a][b]
    model.price.append(model.money(problem.move_cost[fleet][a][b]) * arc)
    leaves = problem.begin_s if a == depot else model.start[a] + (problem.work_s[fleet][a] or 0)
    arrives = problem.home_by_s if b == depot else model.start[b]
    cp.add(leaves + move <= arrives).only_enforce_if(arc)


def _add_job(model: _Model, fleet: int, number: int) -> None:
    """What a field costs on this fleet: work, haste, and what each onset of rain takes of it.

    Of the ground that is not done either all is lost or what the end is late by, whichever is less.
    """
    problem, cp = model.problem, model.cp
    work, here, start = problem.work_s[fleet][number] or 1, model.present[fleet, number], model.start[number]
    model.price.append(model.money(problem.paid[fleet][number] + HASTE * work) * here)
    for at, share in problem.rain.onsets:
        rate = model.money(problem.stake[number] * share / work)
        last = max(closes for _, closes in problem.windows[number]) if problem.windows[number] else 0
        if not rate or last <= at:
            continue
        undone, lost = cp.new_int_var(0, work, ""), cp.new_bool_var("")
        cp.add(undone == work).only_enforce_if([here, lost])
        cp.add(undone >= start + (work - at)).only_enforce_if([here, lost.negated()])
        model.price.append(rate * undone)


def _add_hint(model: _Model, hint: Routes) -> None:
    problem = model.problem
    taken = {
        (fleet, a, b)
        for fleet, route in enumerate(hint)
        for a, b in zip((problem.fields, *route), (*route, problem.fields), strict=True)
        if route
    }
    for arc, variable in model.arcs.items():
        model.cp.add_hint(variable, arc in taken)
    for fleet, route in enumerate(hint):
        for number, start in zip(route, problem.starts(fleet, route) or (), strict=False):
            model.cp.add_hint(model.start[number], start)


def _routes(model: _Model, solver: Any) -> Routes:
    routes = []
    for fleet in range(model.problem.fleets):
        after = {a: b for (k, a, b), arc in model.arcs.items() if k == fleet and solver.boolean_value(arc)}
        route, place = [], after.get(model.problem.fields, model.problem.fields)
        while place != model.problem.fields:
            route.append(place)
            place = after[place]
        routes.append(tuple(route))
    return tuple(routes)
