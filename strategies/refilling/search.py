"""Orders of tracks searched with their loads: every order is judged by its best split into loads (`loads`).

The moves are those of `strategies.orders.tours`, over the borders of loads: a run of tracks is turned round (2-opt),
two neighbouring runs change places, either way round (or-opt and longer), and two tracks change places. Only the part
of the split that a move touches is worked out anew. When no move helps, two runs are exchanged at random and the
search goes on, until a number of judged moves is used up: it depends on no clock.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from strategies.orders.tours import FAR_S, GAIN_S, NOWHERE, PLACE_0
from strategies.refilling.loads import Ints, Loads, Task, backwards, forwards, joined, split
from vehicle.gnss import mixed
from vehicle.jit import compiled

EFFORT = 40_000_000  # steps of the split in one search, about half a second
FARTHEST = 40  # places that a move may reach over
TURNED = 80  # places in a run that is turned round
SHORTER = 4  # tracks in the shorter of two runs that change places
MOST_STARTS = 4


@compiled
def _put(order, scratch, i, j, m, kind):  # type: ignore[no-untyped-def]
    """Write a move of places i to m into `scratch`: what of the order lies there, in its new succession."""
    if kind == 0:  # turned round
        for k in range(i, m + 1):
            scratch[k] = order[i + m - k]
        return
    if kind == 5:  # the two at the ends change places
        for k in range(i, m + 1):
            scratch[k] = order[k]
        scratch[i], scratch[m] = order[m], order[i]
        return
    one, two = (kind - 1) % 2 == 1, (kind - 1) >= 2
    b = m - j
    for k in range(b):
        scratch[i + k] = order[m - k] if two else order[j + 1 + k]
    for k in range(j + 1 - i):
        scratch[i + b + k] = order[j - k] if one else order[i + k]


@compiled
def _total(order, last, begun, rest, turns, detours, first, need, room, capacity) -> float:  # type: ignore[no-untyped-def]
    """Tables of an order, and its least seconds."""
    forwards(order, 0, turns, detours, first, need, room, capacity, begun)
    backwards(order, turns, detours, last, need, capacity, rest)
    n = len(order)
    spare = np.empty((n, 2))
    return float(joined(order, 0, n - 1, n, turns, detours, last, need, room, capacity, begun, rest, spare))


@compiled
def descend(order, turns, detours, first, last, need, room, capacity, longest, effort):  # type: ignore[no-untyped-def]
    """Move after move until none helps or the effort is used up; the seconds of `order` then, and the effort left."""
    n = len(order)
    begun, rest, spare = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2))
    scratch, kept = order.copy(), np.empty(2)
    now = _total(order, last, begun, rest, turns, detours, first, need, room, capacity)
    quiet = i = PLACE_0
    while quiet < n and effort > 0:
        best, bj, bm, bk = now - GAIN_S, NOWHERE, NOWHERE, NOWHERE
        for m in range(i + 1, min(i + TURNED, n)):
            for j in range(i, m):
                short = min(j - i + 1, m - j) <= SHORTER and m - i < FARTHEST
                if j > i and not short:
                    continue
                for kind in range(6):
                    if kind == 0 and j > i:
                        continue
                    if kind == 5 and (j > i or m - i >= FARTHEST):
                        continue
                    if 0 < kind < 5 and not short:
                        continue
                    if (kind - 1) % 2 == 1 and 0 < kind < 5 and j == i:
                        continue  # a single track has no other way round
                    if (kind == 3 or kind == 4) and m == j + 1:
                        continue
                    _put(order, scratch, i, j, m, kind)
                    kept[:] = begun[0]
                    if i == 0:
                        begun[0, 0], begun[0, 1] = first[2 * scratch[0]], first[2 * scratch[0] + 1]
                    cost = joined(
                        scratch, i, m, longest, turns, detours, last, need, room, capacity, begun, rest, spare
                    )
                    begun[0] = kept
                    effort -= (m - i + 1 + longest) * longest
                    if cost < best:
                        best, bj, bm, bk = cost, j, m, kind
            scratch[i : m + 1] = order[i : m + 1]
        if bk >= 0:
            _put(order, scratch, i, bj, bm, bk)
            order[i : bm + 1] = scratch[i : bm + 1]
            now = _total(order, last, begun, rest, turns, detours, first, need, room, capacity)
            quiet = 0
        else:
            quiet += 1
            i = (i + 1) % n
    return now, effort


@compiled
def kicked(start, turns, detours, first, last, need, room, capacity, longest, effort, seed):  # type: ignore[no-untyped-def]
    """The best order found from `start` with so much effort, and its seconds."""
    n = len(start)
    order, kept = start.copy(), start.copy()
    least, kick = np.inf, 0
    while True:
        cost, effort = descend(order, turns, detours, first, last, need, room, capacity, longest, effort)
        if cost < least - GAIN_S:
            least = cost
            kept[:] = order
        else:
            order[:] = kept
        if n < 4 or effort <= 0:
            return kept, least
        for _ in range(1 + kick % 2):
            i = int(mixed(seed, 4 * kick) * (n - 2))
            j = i + int(mixed(seed, 4 * kick + 1) * min(FARTHEST, n - 2 - i))
            m = j + 1 + int(mixed(seed, 4 * kick + 2) * min(FARTHEST, n - 1 - j))
            a, b = order[i : j + 1].copy(), order[j + 1 : m + 1].copy()
            order[i : i + len(b)] = b
            order[i + len(b) : m + 1] = a
            kick += 1


def longest_load(task: Task) -> int:
    """The greatest number of tracks that one load lasts for, and one more."""
    return int(np.searchsorted(np.cumsum(np.sort(task.need)), max(task.room, task.capacity) * (1.0 + 1e-9))) + 1


def in_loads(task: Task, starts: Sequence[Sequence[int]], seed: int = 1, effort: int = EFFORT) -> Loads:
    """The best order found from several to start with, in loads; the same for the same input and seed."""
    arrays = task.turns, task.detours, task.first, task.last, task.need, task.room, task.capacity
    own = [np.array(start, dtype=np.int64) for start in starts]
    promising = sorted(own, key=lambda order: round(split(order, task).seconds, 6))[:MOST_STARTS]
    longest, found = longest_load(task), list[tuple[float, Ints]]()
    for order in promising:
        best, seconds = kicked(order, *arrays, longest, effort // len(promising), seed)
        found.append((float(seconds), best))
    order = min(found, key=lambda one: round(one[0], 6))[1]
    return split(order, task) if found else Loads(own[0], (), FAR_S)
