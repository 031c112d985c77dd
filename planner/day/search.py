"""Large neighbourhood search: fields are taken out of a day and put back better (Shaw 1998; Ropke and Pisinger 2006).

The effort is counted in routes that are priced, never by the clock, so that the same input gives the same day.
"""

from __future__ import annotations

import numpy as np

from planner.chance.streams import stream
from planner.day.insertion import Routes, repaired
from planner.day.problem import EVEN, Problem, empty

EFFORT = 1_600_000  # routes priced, most of them known already: a second or two
LEAST_ROUNDS, MOST_ROUNDS = 30, 3000
FEWEST, SHARE, MOST_OUT = 2, 0.4, 12  # fields taken out at a time
WORSE = 0.01  # of the cost: what a day may be worse by and still be gone on with, at the beginning


def searched(problem: Problem, start: Routes | None = None, *, seed: int = 1, effort: int = EFFORT) -> Routes:
    """A day that is never worse than `start`, nor than putting one field after another where it costs least."""
    whole = range(problem.fields)
    options = [repaired(problem, empty(problem), whole, regret) for regret in (True, False)]
    options += [] if start is None else [start]
    best = now = min(options, key=lambda routes: _cost(problem, routes))
    random, rounds = stream(seed, "day"), _rounds(problem, effort)
    for number in range(rounds):
        out = _taken_out(problem, now, random)
        kept = tuple(tuple(field for field in route if field not in out) for route in now)
        left = {field for field in whole if not any(field in route for route in kept)}
        tried = repaired(problem, kept, left, regret=bool(random.random() < 0.5))
        cost = _cost(problem, tried)
        room = WORSE * abs(_cost(problem, best)) * (1.0 - number / rounds)
        if cost < _cost(problem, best) - EVEN:
            best = tried
        if cost <= _cost(problem, best) + room:
            now = tried
    return best


def _cost(problem: Problem, routes: Routes) -> float:
    cost = problem.cost(routes)
    return float("inf") if cost is None else cost


def _rounds(problem: Problem, effort: int) -> int:
    """How often fields are put back for about so many routes priced."""
    out = _most_out(problem)
    each = out * (out + 1) // 2 * (problem.fields + problem.fleets)
    return max(LEAST_ROUNDS, min(MOST_ROUNDS, effort // max(each, 1)))


def _most_out(problem: Problem) -> int:
    return max(FEWEST, min(MOST_OUT, round(SHARE * problem.fields)))


def _taken_out(problem: Problem, routes: Routes, random: np.random.Generator) -> set[int]:
    """Fields to take out: some that are near one another, some at random."""
    done = sorted(field for route in routes for field in route)
    if not done:
        return set()
    count = min(len(done), int(random.integers(FEWEST, _most_out(problem) + 1)))
    if random.random() < 0.5:
        return set(np.asarray(done)[random.permutation(len(done))[:count]].tolist())
    seed = done[int(random.integers(len(done)))]
    near = sorted(done, key=lambda field: (problem.move_s[0][seed][field] if field != seed else -1, field))
    return set(near[:count])
