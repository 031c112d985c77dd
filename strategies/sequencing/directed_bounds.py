"""Lower bounds on orders of swaths whose turns take longer one way round than the other.

Between swaths with slanted ends a turn ahead costs more than the turn back, so a bound that takes the quicker of the
two (tour_bounds) is far too low. Here every swath is reached by one turn: the cheapest turns that reach all swaths from
the start are an arborescence (Edmonds, Journal of Research of the NBS 71B, 1967; in n^2 steps by growing a path:
Tarjan, Networks 7, 1977). Prices per pass, which is left as often as it is reached, raise the bound to that of Held and
Karp for directed tours (Fischetti and Toth, Mathematical Programming 53, 1992).

The reduced costs say by how much any single turn raises the bound: a turn that lifts it above the seconds of a known
order is in no better one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from vehicle.copying import copy_row
from vehicle.jit import compile_function

Floats = npt.NDArray[np.float64]

MAX_DIRECTED_STEPS = 1500
FIRST_STEP_SHARE = 1.0  # of the step that would reach the known order if the bound were linear (Polyak 1969)
LEAST_STEP_SHARE = 1e-3
STEPS_WITHOUT_GAIN = 20  # then the step is halved
MEMORY = 0.6  # share of the last direction kept in the next: prices zigzag less (Camerini, Fratta, Maffioli 1975)


class DirectedBound(NamedTuple):
    """A lower bound (s), and what each turn costs beyond it: (2 n + 1, 2 n + 1), the last row first, column last."""

    bound_s: float
    reduced_s: Floats


def bound_by_pass_prices(turns: Floats, first: Floats, last: Floats, enough: float) -> DirectedBound:
    """A lower bound on every order of n swaths, by prices per pass.

    `turns` (2 n, 2 n), `first` and `last` (2 n,) are as in tour_search. `enough` are seconds an order is known to take:
    the ascent stops there, and its steps are measured by what is left to it.
    """
    bound, reduced_s = _ascend_pass_prices(turns, first, last, enough)
    return DirectedBound(float(bound), reduced_s)


@compile_function
def _fill_swath_costs(turns, first, price, start_price, cost, pass_from, pass_to):  # type: ignore[no-untyped-def]
    """Least seconds with prices from swath to swath (n + 1, n), the last row from the start, and the passes used."""
    n = cost.shape[1]
    for j in range(n):
        for i in range(n):
            best, p_best, q_best = np.inf, 2 * i, 2 * j
            if i != j:
                for p in range(2 * i, 2 * i + 2):
                    for q in range(2 * j, 2 * j + 2):
                        seconds = turns[p, q] + price[p] - price[q]
                        if seconds < best:
                            best, p_best, q_best = seconds, p, q
            cost[i, j], pass_from[i, j], pass_to[i, j] = best, p_best, q_best
        forward_s, backward_s = first[2 * j] - price[2 * j], first[2 * j + 1] - price[2 * j + 1]
        cost[n, j] = start_price + min(forward_s, backward_s)
        pass_to[n, j] = 2 * j if forward_s <= backward_s else 2 * j + 1


@compile_function
def _find_arborescence(cost, parent, dual, above):  # type: ignore[no-untyped-def]
    """The cheapest arborescence from the start, node n, by `cost` (n + 1, n); returns its cost.

    Fills `parent` (n,). Cycles are contracted to groups numbered from n on: `above` (2 n,) is the group that contains a
    swath or group, -1 if none, `dual` (2 n,) what each pays for being entered.
    """
    n = cost.shape[1]
    into, head = np.empty((2 * n, n + 1)), np.empty((2 * n, n + 1), dtype=np.int64)
    group, state = np.arange(n + 1), np.zeros(2 * n, dtype=np.int64)  # state: 0 not visited, 1 on the path, 2 reached
    entered_from, entered_at = np.empty(2 * n, dtype=np.int64), np.empty(2 * n, dtype=np.int64)
    group[n] = 2 * n
    path, groups, total = np.empty(2 * n, dtype=np.int64), n, 0.0
    above[:] = -1
    for j in range(n):
        copy_row(cost[:, j], into[j])
        head[j] = j
    for begin in range(n):
        if state[group[begin]] == 2:
            continue
        path[0], length = group[begin], 1
        state[path[0]] = 1
        while True:
            this = path[length - 1]
            near = -1
            for i in range(n + 1):
                if group[i] != this and (near < 0 or into[this, i] < into[this, near]):
                    near = i
            dual[this], entered_from[this], entered_at[this] = into[this, near], near, head[this, near]
            total += dual[this]
            before = group[near]
            if near == n or state[before] == 2:
                for k in range(length):
                    state[path[k]] = 2
                break
            if state[before] == 0:
                path[length] = before
                state[before] = 1
                length += 1
                continue
            into[groups] = np.inf
            while True:
                length -= 1
                member = path[length]
                above[member] = groups
                for i in range(n + 1):
                    seconds = into[member, i] - dual[member]
                    if seconds < into[groups, i]:
                        into[groups, i], head[groups, i] = seconds, head[member, i]
                    if group[i] == member:
                        group[i] = groups
                if member == before:
                    break
            path[length], state[groups] = groups, 1
            length += 1
            groups += 1
    settled = np.zeros(2 * n, dtype=np.bool_)
    for this in range(groups - 1, -1, -1):
        if not settled[this]:
            parent[entered_at[this]] = entered_from[this]
            member = entered_at[this]
            while member != this:
                settled[member] = True
                member = above[member]
    return total


@compile_function
def _sum_duals_between(i, j, dual, above, holds):  # type: ignore[no-untyped-def]
    """What a turn from node i to swath j pays to the groups it enters; `holds` (2 n,) is scratch space."""
    n = len(dual) // 2
    holds[:] = False
    this = i if i < n else -1
    while this >= 0:
        holds[this] = True
        this = above[this]
    total, this = 0.0, j
    while this >= 0 and not holds[this]:
        total += dual[this]
        this = above[this]
    return total


@compile_function
def _compute_reduced_costs(turns, first, last, price, start_price, dual, above):  # type: ignore[no-untyped-def]
    """What every turn costs beyond the arborescence (2 n + 1, 2 n + 1); infinite within a swath."""
    count = len(first)
    n = count // 2
    reduced, holds = np.full((count + 1, count + 1), np.inf), np.empty(count, dtype=np.bool_)
    for j in range(n):
        for i in range(n + 1):
            if i == j:
                continue
            paid = _sum_duals_between(i, j, dual, above, holds)
            for q in range(2 * j, 2 * j + 2):
                if i == n:
                    reduced[count, q] = first[q] + start_price - price[q] - paid
                else:
                    for p in range(2 * i, 2 * i + 2):
                        reduced[p, q] = turns[p, q] + price[p] - price[q] - paid
    copy_row(last + price - (last + price).min(), reduced[:count, count])
    return reduced


@compile_function
def _ascend_pass_prices(turns, first, last, enough):  # type: ignore[no-untyped-def]
    """The best bound of an ascent, and the reduced costs there."""
    count = len(first)
    n = count // 2
    cost = np.empty((n + 1, n))
    pass_from, pass_to = np.empty((n + 1, n), dtype=np.int64), np.empty((n + 1, n), dtype=np.int64)
    parent, dual, above = np.empty(n, dtype=np.int64), np.empty(count), np.empty(count, dtype=np.int64)
    price, slope, direction = np.zeros(count), np.empty(count + 1), np.zeros(count + 1)  # the last is that of the start
    start_price, best, share, idle = 0.0, -np.inf, FIRST_STEP_SHARE, 0
    best_price, best_start_price = price.copy(), 0.0
    for _ in range(MAX_DIRECTED_STEPS):
        _fill_swath_costs(turns, first, price, start_price, cost, pass_from, pass_to)
        bound = _find_arborescence(cost, parent, dual, above) - start_price
        end = int((last + price).argmin())
        bound += last[end] + price[end]
        slope[:] = 0.0
        slope[end], slope[count] = 1.0, -1.0
        for j in range(n):
            i = parent[j]
            slope[pass_to[i, j]] -= 1.0
            if i == n:
                slope[count] += 1.0
            else:
                slope[pass_from[i, j]] += 1.0
        idle += 1
        if bound > best:
            if bound > best + 1e-4 * (enough - best):
                idle = 0
            best, best_start_price = bound, start_price
            copy_row(price, best_price)
        squared = (slope * slope).sum()
        if best >= enough or squared == 0.0:
            break
        if idle >= STEPS_WITHOUT_GAIN:
            share, idle = 0.5 * share, 0
            copy_row(best_price, price)
            start_price = best_start_price
            direction[:] = 0.0
            if share < LEAST_STEP_SHARE:
                break
            continue
        copy_row(slope + MEMORY * direction, direction)
        step = share * (enough - bound) / (direction * direction).sum()
        price += step * direction[:count]
        start_price += step * direction[count]
    _fill_swath_costs(turns, first, best_price, best_start_price, cost, pass_from, pass_to)
    _find_arborescence(cost, parent, dual, above)
    return best, _compute_reduced_costs(turns, first, last, best_price, best_start_price, dual, above)
