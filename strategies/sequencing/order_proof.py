"""Orders that are kept, improved and proven to a percent: a circuit model (OR-Tools CP-SAT) on the turns that matter.

What a local search leaves open is closed in three steps: a better bound (directed_bounds), more kicks of the search,
and where more than PROVEN_GAP is left, for up to 60 swaths, a circuit through one pass of every swath, over the turns
that their reduced costs do not rule out. Effort is limited by kicks and by the solver's deterministic time, never by
the clock, so that the same input gives the same order.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from strategies.sequencing.directed_bounds import bound_by_pass_prices
from strategies.sequencing.tour_search import (
    BOUND_TOLERANCE,
    MIN_GAIN_S,
    UNREACHABLE_S,
    Tour,
    TurnSeconds,
    search_tour_again,
)

Bools = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]

PROVEN_GAP = 0.009  # of the seconds between swaths: what is left is some seconds of a field
MAX_PROVEN_BY_CIRCUIT = 60  # swaths; with more the solver's bound is no better than the one it begins with
PROOF_EFFORT = 4.0  # deterministic seconds, about 6 s of CPU; 33 swaths take a tenth of that, 44 from half up to all
TICKS_PER_S = 1000


def prove_tour(tour: Tour, effort: float = PROOF_EFFORT) -> Tour:
    """A tour at least as good, with a better bound; unchanged if nothing is known to be left.

    `effort` limits the solver (deterministic seconds).
    """
    times = tour.times
    if times is None or _is_within(tour, BOUND_TOLERANCE):
        return tour
    tour = _raise_bound(tour, times)
    if not _is_within(tour, BOUND_TOLERANCE):
        tour = _raise_bound(search_tour_again(tour), times)
    if _is_within(tour, PROVEN_GAP) or len(tour.passes) > MAX_PROVEN_BY_CIRCUIT:
        return tour
    bound = bound_by_pass_prices(*times, tour.seconds)
    solved = solve_circuit(times, tour.passes, bound.reduced_s < tour.seconds - bound.bound_s, effort)
    return tour if solved is None else _choose_better(tour, solved, times)


def _is_within(tour: Tour, gap: float) -> bool:
    """Whether no order is quicker than a tour by more than this share."""
    return tour.seconds <= max(tour.bound_s * (1.0 + gap), MIN_GAIN_S)


def _raise_bound(tour: Tour, times: TurnSeconds) -> Tour:
    bound_s = bound_by_pass_prices(*times, tour.seconds - MIN_GAIN_S).bound_s
    return tour.copy_with_bound(bound_s)


def _choose_better(tour: Tour, solved: tuple[Ints, float], times: TurnSeconds) -> Tour:
    """The quicker of a tour and a solved order; no turn left out is in an order quicker than the tour."""
    passes, bound_s = solved
    seconds = times.sum_order(passes)
    best = Tour(passes, seconds, tour.bound_s, times) if seconds < tour.seconds - MIN_GAIN_S else tour
    return best.copy_with_bound(min(bound_s, tour.seconds))


def solve_circuit(times: TurnSeconds, hint: Ints, is_kept: Bools, effort: float) -> tuple[Ints, float] | None:
    """The best order of passes (n,) and a bound (s) of all orders over the turns kept; None if the effort brings none.

    A node is a pass, one of the two of every swath is visited, and one more node for start and end closes the circuit.
    `is_kept` (2 n + 1, 2 n + 1) has the start as its last row and the end as its last column. `hint` is an order to
    begin with; its turns are kept.
    """
    from ortools.sat.python import cp_model

    model = cp_model.CpModel()
    count = len(times.first)
    cost_s = np.full((count + 1, count + 1), np.inf)
    cost_s[:-1, :-1], cost_s[-1, :-1], cost_s[:-1, -1] = times.turns, times.first, times.last
    hinted = list(zip([count, *hint.tolist()], [*hint.tolist(), count], strict=True))
    possible = is_kept & (cost_s < UNREACHABLE_S)
    possible[tuple(zip(*hinted, strict=True))] = True
    possible &= np.arange(count + 1)[:, None] // 2 != np.arange(count + 1) // 2
    turns = [(int(p), int(q)) for p, q in np.argwhere(possible)]
    taken = {turn: model.new_bool_var("") for turn in turns}
    left_out = [model.new_bool_var("") for _ in range(count)]
    model.add_circuit([(*turn, var) for turn, var in taken.items()] + [(p, p, var) for p, var in enumerate(left_out)])
    for swath in range(count // 2):
        model.add_exactly_one(left_out[2 * swath], left_out[2 * swath + 1])
    ticks = np.floor(np.where(possible, cost_s, 0.0) * TICKS_PER_S + 1e-6).astype(np.int64)
    model.minimize(cp_model.LinearExpr.weighted_sum(list(taken.values()), [int(ticks[turn]) for turn in turns]))
    for turn, var in taken.items():
        model.add_hint(var, turn in hinted)
    solver = _build_solver(cp_model, effort)
    if solver.solve(model) not in (cp_model.OPTIMAL, cp_model.FEASIBLE):
        return None
    after = {p: q for (p, q), var in taken.items() if solver.value(var)}
    return _follow_circuit(after, count), solver.best_objective_bound / TICKS_PER_S


def _build_solver(cp_model: Any, effort: float) -> Any:
    solver = cp_model.CpSolver()
    solver.parameters.num_workers = 1
    solver.parameters.catch_sigint_signal = False  # the solver would consume the signal and end its own search only
    solver.parameters.random_seed = 1
    solver.parameters.linearization_level = 2  # with cuts of the whole circuit: most of what the search leaves open
    solver.parameters.relative_gap_limit = PROVEN_GAP
    solver.parameters.max_deterministic_time = effort
    return solver


def _follow_circuit(after: dict[int, int], count: int) -> Ints:
    """The passes of a circuit in order, from the node of start and end."""
    order, current = [], after[count]
    while current != count:
        order.append(current)
        current = after[current]
    return np.array(order, dtype=np.int64)
