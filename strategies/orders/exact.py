"""Few tracks in the best order, by dynamic programming over the sets of tracks that are done.

Bellman, "Dynamic programming treatment of the travelling salesman problem", Journal of the ACM 9 (1962); Held and
Karp, "A dynamic programming approach to sequencing problems", SIAM Journal 10 (1962). A state is a set of tracks and
the pass that was driven last; with n tracks there are n 2^n of them and about n^2 2^n steps: 16 tracks take some tens
of milliseconds, the same whatever their turns are.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from vehicle.jit import compiled

Ints = npt.NDArray[np.int64]


@compiled
def _least(turns, first, last, limit_s):  # type: ignore[no-untyped-def]
    """Least seconds from every state to the end, at most `limit_s` for the whole: (2^n, 2 n) by tracks left and pass.

    A state with nothing left ends the order. What takes `limit_s` or more is infinite.
    """
    n = len(first) // 2
    left = np.full((1 << n, 2 * n), np.inf)
    for p in range(2 * n):
        left[0, p] = last[p]
    for rest in range(1, 1 << n):
        for p in range(2 * n):
            if rest >> (p // 2) & 1:
                continue
            best = limit_s
            for track in range(n):
                if rest >> track & 1:
                    after = rest ^ (1 << track)
                    for q in range(2 * track, 2 * track + 2):
                        seconds = turns[p, q] + left[after, q]
                        if seconds < best:
                            best = seconds
            if best < limit_s:
                left[rest, p] = best
    return left


@compiled
def best_order(turns, first, last, limit_s):  # type: ignore[no-untyped-def]
    """The quickest order of passes (n,) of n tracks, proven; empty where all take `limit_s` seconds or more.

    `turns` (2 n, 2 n), `first` and `last` (2 n,) are as in `orders.tours`. Of equal orders the first pass is the
    lowest, then the second, and so on.
    """
    n = len(first) // 2
    left = _least(turns, first, last, limit_s)
    rest, here, best = (1 << n) - 1, -1, limit_s
    passes = np.empty(n, np.int64)
    for place in range(n):
        best, then = np.inf if place else limit_s, -1
        for q in range(2 * n):
            if rest >> (q // 2) & 1:
                seconds = (first[q] if place == 0 else turns[here, q]) + left[rest ^ (1 << (q // 2)), q]
                if seconds < best:
                    best, then = seconds, q
        if then < 0:
            return passes[:0]
        passes[place] = here = then
        rest ^= 1 << (then // 2)
    return passes
