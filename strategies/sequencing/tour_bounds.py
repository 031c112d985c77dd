"""Lower bounds on every order of swaths, and the best order of few swaths.

The bound is that of Held and Karp by subgradient steps on 1-trees ("The traveling-salesman problem and minimum spanning
trees", Operations Research 18, 1970). One node that stands for start and end closes the open path through all swaths to
a tour. Between two swaths the least seconds over directions and both ways round count, so the bound holds for every
table. Prices per swath end are stronger: a tour visits each end of a swath once, a 1-tree may visit one of them twice
and the other never.

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


def bound_by_swath_prices(between: Floats, enough: float) -> tuple[float, Floats]:
    """A lower bound (s) on every order through n swaths, and its prices (n + 1,) of the swaths and of start and end.

    `between` is from `compute_least_between_s`. Stops early at `enough`, seconds an order is known to take.
    """
    bound, prices = _ascend_swath_prices(between, enough)
    return float(bound), prices


@compile_function
def _ascend_swath_prices(between, enough):  # type: ignore[no-untyped-def]
    n = len(between) - 1
    price, degree = np.zeros(n + 1), np.zeros(n + 1)
    reach, parent, outside = np.empty(n), np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    step = FIRST_STEP_SHARE * between[:n, :n].min()
    best, best_prices = -np.inf, price.copy()
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
        bound = total - 2.0 * price.sum()
        if bound > best:
            best, best_prices[:] = bound, price
        settled = True
        for j in range(n):
            if degree[j] != 2.0:
                settled = False
        if settled or best >= enough:
            break
        for j in range(n):
            price[j] += step * (degree[j] - 2.0)
        step *= STEP_SHRINK
    return best, best_prices


def compute_between_ends_s(turns: Floats, first: Floats, last: Floats) -> Floats:
    """Least seconds between ends of n swaths and the node of start and end, either way round (2 n + 1, 2 n + 1).

    End 2 i + d is where pass 2 i + d of swath i leaves it; infinite between both ends of a swath.
    """
    n = len(first) // 2
    enter = np.arange(2 * n) ^ 1
    least_s = np.full((2 * n + 1, 2 * n + 1), np.inf)
    least_s[:-1, :-1] = np.minimum(turns[:, enter], turns[:, enter].T)
    least_s[-1, :-1] = least_s[:-1, -1] = np.minimum(first[enter], last)
    for swath in range(n):
        least_s[2 * swath : 2 * swath + 2, 2 * swath : 2 * swath + 2] = np.inf
    return least_s


def bound_by_end_prices(
    turns: Floats, first: Floats, last: Floats, enough: float, prices: Floats | None = None
) -> float:
    """A lower bound (s) on every order, by prices per swath end; never below that of `bound_by_swath_prices`.

    Stops early at `enough`, seconds an order is known to take. `prices` are those of `bound_by_swath_prices` if
    already known;
    the caller then has the bound that came with them.
    """
    bound = -np.inf
    if prices is None:
        bound, prices = bound_by_swath_prices(compute_least_between_s(turns, first, last), enough)
        if bound >= enough or len(first) < 4:
            return bound
    return max(
        bound, float(_ascend_end_prices(compute_between_ends_s(turns, first, last), np.repeat(prices[:-1], 2), enough))
    )


@compile_function
def _find_nearest_ends(ends, price, i, j):  # type: ignore[no-untyped-def]
    """The least seconds with prices between an end of swath i and one of swath j, and these two ends."""
    best, p, q = np.inf, 2 * i, 2 * j
    for end_i in range(2 * i, 2 * i + 2):
        for end_j in range(2 * j, 2 * j + 2):
            cost = ends[end_i, end_j] + price[end_i] + price[end_j]
            if cost < best:
                best, p, q = cost, end_i, end_j
    return best, p, q


@compile_function
def _ascend_end_prices(ends, price, enough):  # type: ignore[no-untyped-def]
    """The best bound of an ascent from prices (2 n,) of the ends; `ends` is from `compute_between_ends_s`."""
    n = len(price) // 2
    degree, outside = np.zeros(2 * n), np.empty(n, dtype=np.int64)
    reach, near_end, far_end = np.empty(n), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    step, best = FIRST_STEP_SHARE * ends[: 2 * n, : 2 * n].min(), -np.inf
    for _ in range(MAX_ASCENT_STEPS):
        total, degree[:], near = 0.0, 0.0, 1
        for j in range(1, n):
            reach[j], far_end[j], near_end[j] = _find_nearest_ends(ends, price, 0, j)
            outside[j - 1] = j
            if reach[j] < reach[near]:
                near = j
        for remaining in range(n - 1, 0, -1):
            total += reach[near]
            degree[near_end[near]] += 1.0
            degree[far_end[near]] += 1.0
            outside_count, last = 0, near
            for k in range(remaining):
                j = outside[k]
                if j == last:
                    continue
                cost, p, q = _find_nearest_ends(ends, price, last, j)
                if cost < reach[j]:
                    reach[j], far_end[j], near_end[j] = cost, p, q
                if not outside_count or reach[j] < reach[near]:
                    near = j
                outside[outside_count] = j
                outside_count += 1
        for j in range(n):
            uses_second_end = ends[2 * n, 2 * j] + price[2 * j] > ends[2 * n, 2 * j + 1] + price[2 * j + 1]
            near_end[j] = 2 * j + uses_second_end
            reach[j] = ends[2 * n, near_end[j]] + price[near_end[j]]
        for _ in range(2):
            near = int(reach.argmin())
            total += reach[near]
            degree[near_end[near]] += 1.0
            reach[near] = np.inf
        best = max(best, total - price.sum())
        settled = True
        for j in range(2 * n):
            settled = settled and degree[j] == 1.0
            price[j] += step * (degree[j] - 1.0)
        if settled or best >= enough:
            break
        step *= STEP_SHRINK
    return best


Ints = npt.NDArray[np.int64]


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
