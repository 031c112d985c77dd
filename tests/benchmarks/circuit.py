"""Tracks in the best order, proven: a circuit model solved by constraint programming (OR-Tools CP-SAT).

An oracle for `strategies.sequencing`. A node is a pass, one of the two of every track is visited, and a node for start
and end closes the circuit. The effort is limited in the solver's deterministic time, never by the clock, so that the
same input gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

TICKS_PER_S = 1000
EFFORT = 1.0  # deterministic seconds; 12 tracks take about a third of that


def circuit(turns: Floats, first: Floats, last: Floats, hint: Ints, limit_s: float) -> tuple[Ints, float] | None:
    """The best order of passes (n,) and its proven bound (s), or None when the effort brings no order.

    `turns` (2 n, 2 n), `first` and `last` (2 n,) are as in `sequencing.tour_search`; steps of `limit_s` or
    more are not used. `hint` is an order to begin with.
    """
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    count = len(first)
    follows: dict[tuple[int, int], cp_model.IntVar] = {}
    cost = []
    for p in range(count + 1):
        for q in range(count + 1):
            seconds = first[q] if p == count and q < count else last[p] if q == count and p < count else 0.0
            if p < count and q < count:
                seconds = turns[p, q]
            if p // 2 == q // 2 or seconds >= limit_s:
                continue
            follows[p, q] = model.new_bool_var("")
            cost.append(round(seconds * TICKS_PER_S) * follows[p, q])
    left_out = [model.new_bool_var("") for _ in range(count)]
    model.add_circuit(
        [(p, q, var) for (p, q), var in follows.items()] + [(p, p, var) for p, var in enumerate(left_out)]
    )
    for track in range(count // 2):
        model.add_exactly_one(left_out[2 * track], left_out[2 * track + 1])
    model.minimize(sum(cost))
    taken = set(zip([count, *hint.tolist()], [*hint.tolist(), count], strict=True))
    for step, var in follows.items():
        model.add_hint(var, step in taken)
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.catch_sigint_signal = False  # it would end the search alone, and nobody else would hear it
    solver.parameters.random_seed = 1
    solver.parameters.max_deterministic_time = EFFORT
    if solver.solve(model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    return _followed(follows, solver, count), solver.best_objective_bound / TICKS_PER_S


def _followed(follows: Mapping[tuple[int, int], Any], solver: Any, count: int) -> Ints:
    """The passes of a solution in order."""
    after = {p: q for (p, q), var in follows.items() if solver.value(var)}
    order, here = [], after[count]
    while here != count:
        order.append(here)
        here = after[here]
    return np.array(order)
