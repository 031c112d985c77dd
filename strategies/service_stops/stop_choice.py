"""The stops of least time on a fixed tour, exactly, by dynamic programming over the gaps between its lines.

Gap k is before line k; gap 0 is the start and gap n the end of a tour of n lines. A load that begins in gap i and ends
in gap j takes what the way on from gap i takes, the lines i to j - 1 with the moves between them, and the way off in
gap j. Who comes sooner is never served later, so the least time to every gap is enough to know.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

LOAD_TOLERANCE = 1e-9  # relative rounding of sums
COST_TOLERANCE_S = 1e-6
WaitEstimate = Callable[[int, float], float]
"""Seconds that a tractor waits to be served in a gap, given the seconds taken by stops before it."""


@dataclass(frozen=True)
class TourNeeds:
    """What the parts of a tour of n lines take of a load.

    Attributes:
        lines: (n) of every line.
        moves: (n) of the move to every line that is driven without a stop; nothing for the first.
        ways_off: (n + 1) of the way to be served in each gap; in the last one out of the field.
        ways_on: (n + 1) of the way on from there to the line; in the first gap into the field.
    """

    lines: Sequence[float]
    moves: Sequence[float]
    ways_off: Sequence[float]
    ways_on: Sequence[float]

    def sum_load(self, first: int, last: int) -> float:
        """What a load from one gap to another takes."""
        parts = [*self.lines[first:last], *self.moves[first + 1 : last], self.ways_on[first], self.ways_off[last]]
        return math.fsum(parts)

    def list_loads(self, gaps: Sequence[int]) -> list[float]:
        """What the loads take if there is a stop in each of some gaps."""
        return [self.sum_load(first, last) for first, last in pairwise([0, *gaps, len(self.lines)])]


def choose_stops(
    needs: TourNeeds, costs_s: Sequence[float], capacity: float, estimate_wait_s: WaitEstimate
) -> tuple[int, ...] | None:
    """The gaps to stop in for the least sum of costs and waits; None if no stops are enough.

    `costs_s` (n) are the extra seconds of a stop in each gap; the first load is whole. Of equal sums the one with later
    stops is taken.
    """
    count, most = len(needs.lines), capacity * (1.0 + LOAD_TOLERANCE)
    longest = most - min(0.0, min(needs.ways_on) + min(needs.ways_off))  # a bend may cut the line before a stop
    begun_s = [0.0] + [math.inf] * count
    came_from = [0] * (count + 1)
    for end in range(1, count + 1):
        least_s, between = math.inf, 0.0
        for start in range(end - 1, -1, -1):
            between += needs.lines[start] + (needs.moves[start + 1] if start + 1 < end else 0.0)
            if between > longest:
                break
            load = between + needs.ways_on[start] + needs.ways_off[end]
            if load <= most and begun_s[start] < least_s - COST_TOLERANCE_S:
                least_s, came_from[end] = begun_s[start], start
        if math.isfinite(least_s) and end < count:
            least_s += costs_s[end] + estimate_wait_s(end, least_s)
        begun_s[end] = least_s
    if math.isinf(begun_s[count]):
        return None
    gaps, gap = list[int](), came_from[count]
    while gap:
        gaps.append(gap)
        gap = came_from[gap]
    return tuple(reversed(gaps))
