"""Orders of tracks by local search: good in milliseconds, the same for the same input.

Passes are numbered: pass 2 i is track i driven along the layout's bearing, pass 2 i + 1 against it. `turns[p, q]` (2
n, 2 n) are the seconds from the end of pass p to the beginning of pass q, FAR_S where no way leads; `first` and
`last` (2 n,) the seconds before a pass that comes first and after one that comes last. An order visits every track
once; in which direction each is driven is settled along the way by dynamic programming over the two directions, so
that moves change the order of tracks alone.

The moves are those of Or (1976) and Lin (1965): a run of tracks is turned round, or taken out and put in elsewhere,
either way round, with what lies between turned round or not. Every move is judged in constant time from tables of
least seconds between any two places of the order. When no move helps, two runs are exchanged at random and the search
goes on (iterated local search, Lourenco, Martin and Stutzle 2003).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vehicle.gnss import mixed
from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

FAR_S = 1e7
LONGEST_RUN = 10  # tracks in the shorter of two runs that change places; any number may be turned round
FARTHEST = 40  # tracks in both together
GAIN_S = 1e-7


@compiled
def _through(v0, v1, p, q, turns):  # type: ignore[no-untyped-def]
    """Seconds at both directions of track q, from seconds (v0, v1) at those of track p."""
    return (
        min(v0 + turns[2 * p, 2 * q], v1 + turns[2 * p + 1, 2 * q]),
        min(v0 + turns[2 * p, 2 * q + 1], v1 + turns[2 * p + 1, 2 * q + 1]),
    )


@compiled
def _along(v0, v1, run):  # type: ignore[no-untyped-def]
    """Seconds at the far end of a run, from those at its beginning; `run` (2, 2) is from a table of `_tables`."""
    return min(v0 + run[0, 0], v1 + run[1, 0]), min(v0 + run[0, 1], v1 + run[1, 1])


@compiled
def _tables(order, turns, first, last, onward, backward, head, tail):  # type: ignore[no-untyped-def]
    """Least seconds between places i <= j of an order, forwards (`onward[i, j]`) and backwards (`backward[i, j]`,
    from j to i), each (2, 2) by direction; from the start to a place (`head`) and from a place to the end (`tail`)."""
    n = len(order)
    for i in range(n):
        for d in range(2):
            for e in range(2):
                onward[i, i, d, e] = backward[i, i, d, e] = 0.0 if d == e else 2.0 * FAR_S
    for i in range(n):
        for j in range(i + 1, n):
            p, q = order[j - 1], order[j]
            for d in range(2):
                a, b = onward[i, j - 1, d, 0], onward[i, j - 1, d, 1]
                onward[i, j, d, 0], onward[i, j, d, 1] = _through(a, b, p, q, turns)
    for j in range(n):
        for i in range(j - 1, -1, -1):
            p, q = order[i + 1], order[i]
            for d in range(2):
                a, b = backward[i + 1, j, d, 0], backward[i + 1, j, d, 1]
                backward[i, j, d, 0], backward[i, j, d, 1] = _through(a, b, p, q, turns)
    for k in range(n):
        head[k, 0], head[k, 1] = _along(first[2 * order[0]], first[2 * order[0] + 1], onward[0, k])
        for d in range(2):
            run = onward[k, n - 1]
            z = order[n - 1]
            tail[k, d] = min(run[d, 0] + last[2 * z], run[d, 1] + last[2 * z + 1])


@compiled
def _entered(order, k, q, turns, first, head):  # type: ignore[no-untyped-def]
    """Seconds at track q when it follows place k of the order, or comes first (k = -1)."""
    if k < 0:
        return first[2 * q], first[2 * q + 1]
    return _through(head[k, 0], head[k, 1], order[k], q, turns)


@compiled
def _left(v0, v1, order, p, k, turns, last, tail):  # type: ignore[no-untyped-def]
    """Seconds of the whole order when track p, reached at (v0, v1), is followed by place k, or is the last (k = n)."""
    if k >= len(order):
        return min(v0 + last[2 * p], v1 + last[2 * p + 1])
    w0, w1 = _through(v0, v1, p, order[k], turns)
    return min(w0 + tail[k, 0], w1 + tail[k, 1])


@compiled
def _swapped(order, i, j, m, one, two, turns, first, last, onward, backward, head, tail):  # type: ignore[no-untyped-def]
    """Seconds when the neighbouring runs i..j and j+1..m change places, each turned round where `one`, `two` say."""
    run, back = onward[j + 1, m], j + 1
    end = m
    if two:
        run, back, end = backward[j + 1, m], m, j + 1
    v0, v1 = _entered(order, i - 1, order[back], turns, first, head)
    v0, v1 = _along(v0, v1, run)
    begin, stop, other = i, j, onward[i, j]
    if one:
        begin, stop, other = j, i, backward[i, j]
    v0, v1 = _through(v0, v1, order[end], order[begin], turns)
    v0, v1 = _along(v0, v1, other)
    return _left(v0, v1, order, order[stop], m + 1, turns, last, tail)


@compiled
def _swap(order, i, j, m, one, two):  # type: ignore[no-untyped-def]
    """Carry out what `_swapped` has judged."""
    a, b = order[i : j + 1].copy(), order[j + 1 : m + 1].copy()
    order[i : i + len(b)] = b[::-1] if two else b
    order[i + len(b) : m + 1] = a[::-1] if one else a


@compiled
def _improve(i, order, turns, first, last, onward, backward, head, tail):  # type: ignore[no-untyped-def]
    """The best move of runs that begin at place i, carried out; the seconds gained, 0 when none helps.

    The tables must be those of `order`.
    """
    n = len(order)
    z = order[n - 1]
    now = min(head[n - 1, 0] + last[2 * z], head[n - 1, 1] + last[2 * z + 1])
    best, bj, bm, b1, b2 = now - GAIN_S, -1, -1, False, False
    for m in range(i + 1, n):
        v0, v1 = _entered(order, i - 1, order[m], turns, first, head)
        v0, v1 = _along(v0, v1, backward[i, m])
        turned = _left(v0, v1, order, order[i], m + 1, turns, last, tail)
        if turned < best:
            best, bj, bm, b1, b2 = turned, i - 1, m, False, True
    for m in range(i + 1, min(i + FARTHEST, n)):
        for j in range(i, m):
            if j - i >= LONGEST_RUN and m - j > LONGEST_RUN:
                continue
            for way in range(4):
                one, two = way % 2 == 1, way >= 2
                cost = _swapped(order, i, j, m, one, two, turns, first, last, onward, backward, head, tail)
                if cost < best:
                    best, bj, bm, b1, b2 = cost, j, m, one, two
    if bm < 0:
        return 0.0
    _swap(order, i, bj, bm, b1, b2)
    return now - best


@compiled
def _descend(order, turns, first, last, onward, backward, head, tail):  # type: ignore[no-untyped-def]
    """Move after move until none helps; the seconds of the order then."""
    n = len(order)
    quiet = i = 0
    _tables(order, turns, first, last, onward, backward, head, tail)
    while quiet < n:
        if _improve(i, order, turns, first, last, onward, backward, head, tail) > 0.0:
            _tables(order, turns, first, last, onward, backward, head, tail)
            quiet = 0
        else:
            quiet += 1
            i = (i + 1) % n
    z = order[n - 1]
    return min(head[n - 1, 0] + last[2 * z], head[n - 1, 1] + last[2 * z + 1])


@compiled
def searched(start, turns, first, last, kicks, seed):  # type: ignore[no-untyped-def]
    """The best order (n,) of tracks found from `start` with so many kicks, and its seconds."""
    n = len(start)
    onward, backward = np.empty((n, n, 2, 2)), np.empty((n, n, 2, 2))
    head, tail = np.empty((n, 2)), np.empty((n, 2))
    order, kept = start.copy(), start.copy()
    least = np.inf
    for kick in range(kicks + 1):
        cost = _descend(order, turns, first, last, onward, backward, head, tail)
        if cost < least - GAIN_S:
            least = cost
            kept[:] = order
        else:
            order[:] = kept
        if n < 4:
            break
        # Two neighbouring runs of a random place are exchanged.
        i = int(mixed(seed, 3 * kick) * (n - 2))
        j = i + int(mixed(seed, 3 * kick + 1) * min(LONGEST_RUN, n - 2 - i))
        m = j + 1 + int(mixed(seed, 3 * kick + 2) * min(LONGEST_RUN, n - 1 - j))
        _swap(order, i, j, m, False, False)
    return kept, least
