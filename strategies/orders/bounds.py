"""What no order of tracks can undercut: the bound of Held and Karp, by subgradient steps on 1-trees.

Held and Karp, "The traveling-salesman problem and minimum spanning trees", Operations Research 18 (1970). The open
path through all tracks becomes a tour by one node that stands for start and end. Directions are left free, so the
seconds between two tracks are the least over their directions and over both ways round: the bound holds for every
table.
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


@compiled
def held_karp(between, enough):  # type: ignore[no-untyped-def]
    """A lower bound (s) on every order through all n tracks; `between` (n + 1, n + 1) is from `least_between`.

    Stops early at `enough`, seconds an order is known to take.
    """
    n = len(between) - 1
    price, degree = np.zeros(n + 1), np.zeros(n + 1)
    reach, parent, inside = np.empty(n), np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.bool_)
    step = FIRST_STEP * between[:n, :n].min()
    best = -np.inf
    for _ in range(STEPS):
        total, degree[:], inside[:], inside[0] = 0.0, 0.0, False, True
        for j in range(1, n):
            reach[j], parent[j] = between[0, j] + price[0] + price[j], 0
        for _ in range(n - 1):
            near = -1
            for j in range(n):
                if not inside[j] and (near < 0 or reach[j] < reach[near]):
                    near = j
            inside[near] = True
            total += reach[near]
            degree[near] += 1.0
            degree[parent[near]] += 1.0
            for j in range(n):
                cost = between[near, j] + price[near] + price[j]
                if not inside[j] and cost < reach[j]:
                    reach[j], parent[j] = cost, near
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
        best = max(best, total - 2.0 * price.sum())
        settled = True
        for j in range(n):
            if degree[j] != 2.0:
                settled = False
        if settled or best >= enough:
            break
        for j in range(n):
            price[j] += step * (degree[j] - 2.0)
        step *= SHRINK
    return best
