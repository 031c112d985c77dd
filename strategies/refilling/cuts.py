"""Where a tractor whose work is given in order goes for its next load: the cheapest stops, exactly.

The work is in pieces, each with its need; between two a tractor may go, at a cost that need not be known for every gap:
one that is not is bounded from below, and worked out when the cheapest stops would use it. Where others are served
before, it waits as well: who comes sooner is never served later, so that the least time to every gap is enough to know.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

SLACK = 1e-9  # of a load: rounding of sums
SAME_S = 1e-6
Wait = Callable[[int, float], float]
"""Seconds that a tractor waits in a gap to be served, when stops before it have taken so many seconds."""


def _no_wait(gap: int, later_s: float) -> float:
    return 0.0


def cheapest(
    needs: Sequence[float], costs: Sequence[float], capacity: float, wait: Wait = _no_wait
) -> tuple[float, tuple[int, ...]] | None:
    """The least sum of costs and waits, and the pieces before which the tank is made good; None where none are enough.

    `costs[k]` is for going before piece k; the first load is whole. Of equal sums the one with later stops is taken.
    """
    most, count = capacity * (1.0 + SLACK), len(needs)
    stop_s = list[float]()  # when going for a load before each piece, until that is begun
    best: list[tuple[float, int]] = [(0.0, 0)] + [(math.inf, 0)] * count
    for end in range(1, count + 1):
        begun = best[end - 1][0]
        stop_s.append(begun + costs[end - 1] + wait(end - 1, begun) if end > 1 and math.isfinite(begun) else begun)
        load = 0.0
        for start in range(end - 1, -1, -1):
            load += needs[start]
            if load > most:
                break
            if stop_s[start] < best[end][0] - SAME_S:
                best[end] = stop_s[start], start
    if math.isinf(best[count][0]):
        return None
    cuts, here = [], count
    while best[here][1]:
        here = best[here][1]
        cuts.append(here)
    return best[count][0], tuple(reversed(cuts))


def cheapest_known(
    needs: Sequence[float], least: Sequence[float], cost: Callable[[int], float], capacity: float,
    wait: Wait = _no_wait,
) -> tuple[int, ...] | None:  # fmt: skip
    """As `cheapest`, with costs worked out only where their lower bounds `least` do not rule a stop out."""
    costs, known = list(least), [False] * len(needs)
    while True:
        found = cheapest(needs, costs, capacity, wait)
        if found is None:
            return None
        unknown = [cut for cut in found[1] if not known[cut]]
        if not unknown:
            return found[1]
        for cut in unknown:
            costs[cut], known[cut] = cost(cut), True
