"""What no order of tracks can undercut: the bound of Held and Karp, by subgradient steps on 1-trees.

Held and Karp, "The traveling-salesman problem and minimum spanning trees", Operations Research 18 (1970). The open
path through all tracks becomes a tour by one node that stands for start and end. Directions are left free, so the
seconds between two tracks are the least over their directions and over both ways round: the bound holds for every
table. Prices per track end go farther: a tour comes to each end of a track once, a 1-tree may come to one of them
twice and never to the other.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]

STEPS = 600
FIRST_STEP = 0.5  # of the least turn: moves of prices below it change no tree
SHRINK = 0.99


def least_between(turns: Floats, first: Floats, last: Floats) -> Floats:
    """Least seconds between any two of n tracks and the node of start and end, symmetric (n + 1, n + 1)."""
    n = len(first) // 2
    blocks = turns.reshape(n, 2, n, 2).min(axis=(1, 3))
    out = np.full((n + 1, n + 1), np.inf)
    out[:n, :n] = np.minimum(blocks, blocks.T)
    ends = np.minimum(first, last).reshape(n, 2).min(axis=1)
    out[n, :n] = out[:n, n] = ends
    np.fill_diagonal(out, np.inf)
    return out


def held_karp(between: Floats, enough: float) -> float:
    """A lower bound (s) on every order through all n tracks; `between` (n + 1, n + 1) is from `least_between`.

    Stops early at `enough`, seconds an order is known to take.
    """
    return ascended(between, enough)[0]


def ascended(between: Floats, enough: float) -> tuple[float, Floats]:
    """As `held_karp`, with the prices (n + 1,) of the tracks and the node of start and end it was found with."""
    bound, prices = _ascended(between, enough)
    return float(bound), prices


@compiled
def _ascended(between, enough):  # type: ignore[no-untyped-def]
    n = len(between) - 1
    price, degree = np.zeros(n + 1), np.zeros(n + 1)
    reach, parent, outside = np.empty(n), np.zeros(n, dtype=np.int64), np.empty(n, dtype=np.int64)
    step = FIRST_STEP * between[:n, :n].min()
    best, kept = -np.inf, price.copy()
    for _ in range(STEPS):
        total, degree[:], near = 0.0, 0.0, 1
        for j in range(1, n):
            reach[j], parent[j], outside[j - 1] = between[0, j] + price[0] + price[j], 0, j
            if reach[j] < reach[near]:
                near = j
        for left in range(n - 1, 0, -1):
            total += reach[near]
            degree[near] += 1.0
            degree[parent[near]] += 1.0
            kept_out, last = 0, near
            for k in range(left):  # tracks keep their order: of equally near ones the first is taken
                j = outside[k]
                if j == last:
                    continue
                cost = between[last, j] + price[last] + price[j]
                if cost < reach[j]:
                    reach[j], parent[j] = cost, last
                if not kept_out or reach[j] < reach[near]:
                    near = j
                outside[kept_out] = j
                kept_out += 1
        one = two = -1
        for j in range(n):
            cost = between[n, j] + price[j]
            if one < 0 or cost < between[n, one] + price[one]:
                one, two = j, one
            elif two < 0 or cost < between[n, two] + price[two]:
                two = j
        total += between[n, one] + price[one] + between[n, two] + price[two] + 2.0 * price[n]
        degree[one] += 1.0
        degree[two] += 1.0
        bound = total - 2.0 * price.sum()
        if bound > best:
            best, kept[:] = bound, price
        settled = True
        for j in range(n):
            if degree[j] != 2.0:
                settled = False
        if settled or best >= enough:
            break
        for j in range(n):
            price[j] += step * (degree[j] - 2.0)
        step *= SHRINK
    return best, kept


def between_ends(turns: Floats, first: Floats, last: Floats) -> Floats:
    """Least seconds between ends of n tracks and the node of start and end, either way round (2 n + 1, 2 n + 1).

    End 2 i + d is where pass 2 i + d of track i leaves it; infinite between both ends of a track.
    """
    n = len(first) // 2
    enter = np.arange(2 * n) ^ 1
    out = np.full((2 * n + 1, 2 * n + 1), np.inf)
    out[:-1, :-1] = np.minimum(turns[:, enter], turns[:, enter].T)
    out[-1, :-1] = out[:-1, -1] = np.minimum(first[enter], last)
    for track in range(n):
        out[2 * track : 2 * track + 2, 2 * track : 2 * track + 2] = np.inf
    return out


def bound_by_ends(
    turns: Floats, first: Floats, last: Floats, enough: float, prices: Floats | None = None
) -> float:  # fmt: skip
    """A lower bound (s) on every order, by prices per track end; never below that of `held_karp`.

    Stops early at `enough`, seconds an order is known to take. `prices` are those of `ascended` where they are known
    already; the bound that came with them is left to the caller then.
    """
    bound = -np.inf
    if prices is None:
        bound, prices = ascended(least_between(turns, first, last), enough)
        if bound >= enough or len(first) < 4:
            return bound
    return max(bound, float(_by_ends(between_ends(turns, first, last), np.repeat(prices[:-1], 2), enough)))


@compiled
def _nearest_ends(ends, price, i, j):  # type: ignore[no-untyped-def]
    """The least seconds with prices between an end of track i and one of track j, and these two ends."""
    best, p, q = np.inf, 2 * i, 2 * j
    for one in range(2 * i, 2 * i + 2):
        for two in range(2 * j, 2 * j + 2):
            cost = ends[one, two] + price[one] + price[two]
            if cost < best:
                best, p, q = cost, one, two
    return best, p, q


@compiled
def _by_ends(ends, price, enough):  # type: ignore[no-untyped-def]
    """The best bound of an ascent from prices (2 n,) of the ends; `ends` is from `between_ends`."""
    n = len(price) // 2
    degree, outside = np.zeros(2 * n), np.empty(n, dtype=np.int64)
    reach, own, other = np.empty(n), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
    step, best = FIRST_STEP * ends[: 2 * n, : 2 * n].min(), -np.inf
    for _ in range(STEPS):
        total, degree[:], near = 0.0, 0.0, 1
        for j in range(1, n):
            reach[j], other[j], own[j] = _nearest_ends(ends, price, 0, j)
            outside[j - 1] = j
            if reach[j] < reach[near]:
                near = j
        for left in range(n - 1, 0, -1):
            total += reach[near]
            degree[own[near]] += 1.0
            degree[other[near]] += 1.0
            kept_out, last = 0, near
            for k in range(left):
                j = outside[k]
                if j == last:
                    continue
                cost, p, q = _nearest_ends(ends, price, last, j)
                if cost < reach[j]:
                    reach[j], other[j], own[j] = cost, p, q
                if not kept_out or reach[j] < reach[near]:
                    near = j
                outside[kept_out] = j
                kept_out += 1
        for j in range(n):
            one = ends[2 * n, 2 * j] + price[2 * j] > ends[2 * n, 2 * j + 1] + price[2 * j + 1]
            own[j] = 2 * j + one
            reach[j] = ends[2 * n, own[j]] + price[own[j]]
        for _ in range(2):
            near = int(reach.argmin())
            total += reach[near]
            degree[own[near]] += 1.0
            reach[near] = np.inf
        best = max(best, total - price.sum())
        settled = True
        for j in range(2 * n):
            settled = settled and degree[j] == 1.0
            price[j] += step * (degree[j] - 1.0)
        if settled or best >= enough:
            break
        step *= SHRINK
    return best
