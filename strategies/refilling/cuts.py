"""Where a tractor whose work is given in order goes for its next load: the cheapest stops, exactly.

The work is in pieces, each with its need; between two a tractor may go, at a cost that need not be known for every gap:
one that is not is bounded from below, and worked out when the cheapest stops would use it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

SLACK = 1e-9  # of a load: rounding of sums
SAME_S = 1e-6


def cheapest(needs: Sequence[float], costs: Sequence[float], capacity: float) -> tuple[float, tuple[int, ...]] | None:
    """The least sum of costs and the pieces before which the tank is made good; None where no stops are enough.

    `costs[k]` is for going before piece k; the first load is whole. Of equal sums the one with later stops is taken.
    """
    most, count = capacity * (1.0 + SLACK), len(needs)
    best: list[tuple[float, int]] = [(0.0, 0)] + [(math.inf, 0)] * count
    for end in range(1, count + 1):
        load = 0.0
        for start in range(end - 1, -1, -1):
            load += needs[start]
            if load > most:
                break
            before = best[start][0] + (costs[start] if start else 0.0)
            if before < best[end][0] - SAME_S:
                best[end] = before, start
    if math.isinf(best[count][0]):
        return None
    cuts, here = [], count
    while best[here][1]:
        here = best[here][1]
        cuts.append(here)
    return best[count][0], tuple(reversed(cuts))


def cheapest_known(
    needs: Sequence[float], least: Sequence[float], cost: Callable[[int], float], capacity: float
) -> tuple[int, ...] | None:
    """As `cheapest`, with costs worked out only where their lower bounds `least` do not rule a stop out."""
    costs, known = list(least), [False] * len(needs)
    while True:
        found = cheapest(needs, costs, capacity)
        if found is None:
            return None
        unknown = [cut for cut in found[1] if not known[cut]]
        if not unknown:
            return found[1]
        for cut in unknown:
            costs[cut], known[cut] = cost(cut), True
