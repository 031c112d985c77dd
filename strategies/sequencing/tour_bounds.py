"""Lower bounds on every order of swaths, and the best order of few swaths.

The bound is that of Held and Karp by subgradient steps on 1-trees ("The traveling-salesman problem and minimum spanning
trees", Operations Research 18, 1970). One node that stands for start and end closes the open path through all swaths to
a tour. Between two swaths the least seconds over directions and both ways round count, so the bound holds for every
table; where one way round takes longer it is far too low (directed_bounds).

The best order of few swaths comes from dynamic programming over the sets of swaths done (Bellman, Journal of the ACM 9,
1962; Held and Karp, SIAM Journal 10, 1962). A state is a set of swaths and the pass driven last; n swaths have n 2^n
states and about n^2 2^n steps: tens of milliseconds for 16 swaths, whatever their turns are.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vehicle.jit import compile_function

Floats = npt.NDArray[np.float64]

MAX_ASCENT_STEPS = 600
FIRST_STEP_SHARE = 0.5  # of the least turn: smaller steps of prices change no tree
STEP_SHRINK = 0.99


def compute_least_between_s(turns: Floats, first: Floats, last: Floats) -> Floats:
    """Least seconds between any two of n swaths and the node of start and end, symmetric (n + 1, n + 1)."""
    n = len(first) // 2
    blocks = turns.reshape(n, 2, n, 2).min(axis=(1, 3))
    least_s = np.full((n + 1, n + 1), np.inf)
    least_s[:n, :n] = np.minimum(blocks, blocks.T)
    end_times_s = np.minimum(first, last).reshape(n, 2).min(axis=1)
    least_s[n, :n] = least_s[:n, n] = end_times_s
    np.fill_diagonal(least_s, np.inf)
    return least_s


@compile_function
def bound_by_swath_prices(between, enough):  # type: ignore[no-untyped-def]
    """A lower bound (s) on every order through n swaths, by prices of the swaths and of start and end.

    `between` is from `compute_least_between_s`. Stops early at `enough`, seconds an order is known to take.
    """
    n = len(between) - 1
    price, degree = np.zeros(n + 1), np.zeros(n + 1)
    reach, parent, outside = np.empty(n), np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    step = FIRST_STEP_SHARE * between[:n, :n].min()
    best = -np.inf
    for _ in range(MAX_ASCENT_STEPS):
        total, degree[:], near = 0.0, 0.0, 1
        for j in range(1, n):
            reach[j], parent[j], outside[j - 1] = between[0, j] + price[0] + price[j], 0, j
            if reach[j] < reach[near]:
                near = j
        for remaining in range(n - 1, 0, -1):
            total += reach[near]
            degree[near] += 1.0
            degree[parent[near]] += 1.0
            outside_count, last = 0, near
            for k in range(remaining):  # swaths keep their order: of equally near ones the first is taken
                j = outside[k]
                if j == last:
                    continue
                cost = between[last, j] + price[last] + price[j]
                if cost < reach[j]:
                    reach[j], parent[j] = cost, last
                if not outside_count or reach[j] < reach[near]:
                    near = j
                outside[outside_count] = j
                outside_count += 1
        nearest = second_nearest = -1
        for j in range(n):
            cost = between[n, j] + price[j]
            if nearest < 0 or cost < between[n, nearest] + price[nearest]:
                nearest, second_nearest = j, nearest
            elif second_nearest < 0 or cost < between[n, second_nearest] + price[second_nearest]:
                second_nearest = j
        total += (
            between[n, nearest] + price[nearest] + between[n, second_nearest] + price[second_nearest] + 2.0 * price[n]
        )
        degree[nearest] += 1.0
        degree[second_nearest] += 1.0
        best = max(best, total - 2.0 * price.sum())
        settled = True
        for j in range(n):
            if degree[j] != 2.0:
                settled = False
        if settled or best >= enough:
            break
        for j in range(n):
            price[j] += step * (degree[j] - 2.0)
        step *= STEP_SHRINK
    return best


@compile_function
def _compute_least_seconds(turns, first, last, limit_s):  # type: ignore[no-untyped-def]
    """Least seconds from every state to the end, below `limit_s`: (2^n, 2 n) by swaths left and last pass.

    A state with no swaths left ends the order. What takes `limit_s` or more is infinite.
    """
    n = len(first) // 2
    least_s = np.full((1 << n, 2 * n), np.inf)
    for p in range(2 * n):
        least_s[0, p] = last[p]
    for open_swaths in range(1, 1 << n):
        for p in range(2 * n):
            if open_swaths >> (p // 2) & 1:
                continue
            best = limit_s
            for swath in range(n):
                if open_swaths >> swath & 1:
                    after = open_swaths ^ (1 << swath)
                    for q in range(2 * swath, 2 * swath + 2):
                        seconds = turns[p, q] + least_s[after, q]
                        if seconds < best:
                            best = seconds
            if best < limit_s:
                least_s[open_swaths, p] = best
    return least_s


@compile_function
def find_best_order(turns, first, last, limit_s):  # type: ignore[no-untyped-def]
    """The quickest order of passes (n,) of n swaths, proven; empty if all take `limit_s` seconds or more.

    `turns` (2 n, 2 n), `first` and `last` (2 n,) are as in tour_search. Of equal orders the one with the lowest first
    pass is taken, then the lowest second, and so on.
    """
    n = len(first) // 2
    least_s = _compute_least_seconds(turns, first, last, limit_s)
    open_swaths, current_pass, best = (1 << n) - 1, -1, limit_s
    passes = np.empty(n, np.int64)
    for place in range(n):
        best, next_pass = np.inf if place else limit_s, -1
        for q in range(2 * n):
            if open_swaths >> (q // 2) & 1:
                seconds = (first[q] if place == 0 else turns[current_pass, q]) + least_s[
                    open_swaths ^ (1 << (q // 2)), q
                ]
                if seconds < best:
                    best, next_pass = seconds, q
        if next_pass < 0:
            return passes[:0]
        passes[place] = current_pass = next_pass
        open_swaths ^= 1 << (next_pass // 2)
    return passes
