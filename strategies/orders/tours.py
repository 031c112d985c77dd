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

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from strategies.orders.bounds import ascended, bound_by_ends, least_between
from strategies.orders.exact import best_order
from vehicle.gnss import mixed
from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

FAR_S = 1e7
LONGEST_RUN = 10  # tracks in the shorter of two runs that change places; any number may be turned round
FARTHEST = 40  # tracks in both together
GAIN_S = 1e-7
MOST_STARTS = 3
MOST_PROVEN = 16  # tracks: four hundredths of a second, and twice as long for every track more
CLOSE = 2e-4  # an order this near its bound, relatively, is taken for the best
# Not Python's numbers: for every constant of these handed over, what it is handed to is compiled once more.
PLACE_0: Any = np.int64(0)
NOWHERE: Any = np.int64(-1)
PLAIN: Any = np.int64(0)  # how two runs change places: `_swap`
SECOND_TURNED: Any = np.int64(2)
KICKS, FEWEST_KICKS = 500, 3  # shared by the tracks: a kick of 20 tracks takes a millisecond, of 300 tracks fifty


@compiled
def _through(v0, v1, p, q, turns):  # type: ignore[no-untyped-def]
    """Seconds at both directions of track q, from seconds (v0, v1) at those of track p."""
    return (
        min(v0 + turns[2 * p, 2 * q], v1 + turns[2 * p + 1, 2 * q]),
        min(v0 + turns[2 * p, 2 * q + 1], v1 + turns[2 * p + 1, 2 * q + 1]),
    )


@compiled
def _along(v0, v1, run):  # type: ignore[no-untyped-def]
    """Seconds at the far end of a run, from those at its beginning; `run` (2, 2) is from a table of `run_tables`."""
    return min(v0 + run[0, 0], v1 + run[1, 0]), min(v0 + run[0, 1], v1 + run[1, 1])


@compiled
def run_tables(  # type: ignore[no-untyped-def]
    order, low, high, turns, first, last, onward, backward, shortest, head, tail
):  # fmt: skip
    """Bring the tables up to date with an order whose places low..high have changed.

    Least seconds from place i to place i + w (`onward[i, w]`) and from there back to i (`backward[i, w]`), each (2, 2)
    by direction, for w below FARTHEST; the least of either over directions (`shortest[i, w]`, (2,)); from the start to
    a place (`head`) and from a place to the end (`tail`).
    """
    n, most = len(order), onward.shape[1]
    for i in range(max(low - most + 1, 0), high + 1):
        for w in range(max(low - i, 0), min(most, n - i)):
            for d in range(2):
                if w == 0:
                    for e in range(2):
                        onward[i, 0, d, e] = backward[i, 0, d, e] = 0.0 if d == e else 2.0 * FAR_S
                    shortest[i, 0, 1] = 0.0
                    continue
                a, b = onward[i, w - 1, d, 0], onward[i, w - 1, d, 1]
                onward[i, w, d, 0], onward[i, w, d, 1] = _through(a, b, order[i + w - 1], order[i + w], turns)
            shortest[i, w, 0] = onward[i, w].min()
    for j in range(low, min(high + most, n)):
        for i in range(min(j - 1, high), max(j - most, -1), -1):
            for d in range(2):
                a, b = backward[i + 1, j - i - 1, d, 0], backward[i + 1, j - i - 1, d, 1]
                backward[i, j - i, d, 0], backward[i, j - i, d, 1] = _through(a, b, order[i + 1], order[i], turns)
            shortest[i, j - i, 1] = backward[i, j - i].min()
    for k in range(low, n):
        if k == 0:
            head[0, 0], head[0, 1] = first[2 * order[0]], first[2 * order[0] + 1]
        else:
            head[k, 0], head[k, 1] = _through(head[k - 1, 0], head[k - 1, 1], order[k - 1], order[k], turns)
    for k in range(high, -1, -1):
        for d in range(2):
            p = 2 * order[k] + d
            if k == n - 1:
                tail[k, d] = last[p]
            else:
                q = 2 * order[k + 1]
                tail[k, d] = min(turns[p, q] + tail[k + 1, 0], turns[p, q + 1] + tail[k + 1, 1])


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
def _swapped(order, i, j, m, way, turns, first, last, onward, backward, head, tail):  # type: ignore[no-untyped-def]
    """Seconds when the neighbouring runs i..j and j+1..m change places; `way` as in `_swap`."""
    run, back = onward[j + 1, m - j - 1], j + 1
    end = m
    if way >= 2:
        run, back, end = backward[j + 1, m - j - 1], m, j + 1
    v0, v1 = _entered(order, i - 1, order[back], turns, first, head)
    v0, v1 = _along(v0, v1, run)
    begin, stop, other = i, j, onward[i, j - i]
    if way % 2 == 1:
        begin, stop, other = j, i, backward[i, j - i]
    v0, v1 = _through(v0, v1, order[end], order[begin], turns)
    v0, v1 = _along(v0, v1, other)
    return _left(v0, v1, order, order[stop], m + 1, turns, last, tail)


@compiled
def _swap(order, i, j, m, way):  # type: ignore[no-untyped-def]
    """The runs i..j and j+1..m change places; the first is turned round with `way` 1 and 3, the other with 2 and 3."""
    a, b = order[i : j + 1].copy(), order[j + 1 : m + 1].copy()
    order[i : i + len(b)] = b[::-1] if way >= 2 else b
    order[i + len(b) : m + 1] = a[::-1] if way % 2 == 1 else a


@compiled
def _between(order, p, q, least) -> float:  # type: ignore[no-untyped-def]
    """What a step from place p to place q takes at least; p may be -1 and q n."""
    n = len(order)
    return least[order[p] if p >= 0 else n, order[q] if q < n else n]  # type: ignore[no-any-return]


@compiled
def _improve(i, order, turns, first, last, onward, backward, shortest, head, tail, least):  # type: ignore[no-untyped-def]
    """The best move of runs that begin at place i, carried out; the last place it changed, -1 when none helps.

    The tables must be those of `order`. A move is judged exactly only where the least of its runs and of its new steps,
    each over all directions, does not rule it out.
    """
    n = len(order)
    z = order[n - 1]
    best = min(head[n - 1, 0] + last[2 * z], head[n - 1, 1] + last[2 * z + 1])
    bj, bm, bway = NOWHERE, NOWHERE, PLAIN
    begun = min(head[i - 1, 0], head[i - 1, 1]) if i > 0 else 0.0
    back = np.array([[0.0, 2.0 * FAR_S], [2.0 * FAR_S, 0.0]])  # from place m back to i
    for m in range(i + 1, n):
        for e in range(2):
            p, q = 2 * order[m], 2 * order[m - 1]
            there, other = back[0, e], back[1, e]
            back[0, e] = min(turns[p, q] + there, turns[p, q + 1] + other)
            back[1, e] = min(turns[p + 1, q] + there, turns[p + 1, q + 1] + other)
        over = begun + (min(tail[m + 1, 0], tail[m + 1, 1]) if m + 1 < n else 0.0)
        over += _between(order, i - 1, m, least) + _between(order, i, m + 1, least)
        if over + min(min(back[0, 0], back[0, 1]), min(back[1, 0], back[1, 1])) >= best - GAIN_S:
            continue
        v0, v1 = _entered(order, i - 1, order[m], turns, first, head)
        v0, v1 = _along(v0, v1, back)
        turned = _left(v0, v1, order, order[i], m + 1, turns, last, tail)
        if turned < best - GAIN_S:
            best, bj, bm, bway = turned, i - 1, m, SECOND_TURNED
    for m in range(i + 1, min(i + FARTHEST, n)):
        over = begun + (min(tail[m + 1, 0], tail[m + 1, 1]) if m + 1 < n else 0.0)
        for j in range(i, m):
            if j - i >= LONGEST_RUN and m - j > LONGEST_RUN:
                continue
            for way in range(4):
                begin, end = (m, j + 1) if way >= 2 else (j + 1, m)
                start, stop = (j, i) if way % 2 == 1 else (i, j)
                new = _between(order, i - 1, begin, least) + _between(order, end, start, least)
                new += _between(order, stop, m + 1, least)
                if over + new + shortest[i, j - i, way % 2] + shortest[j + 1, m - j - 1, way // 2] >= best - GAIN_S:
                    continue
                cost = _swapped(order, i, j, m, way, turns, first, last, onward, backward, head, tail)
                if cost < best - GAIN_S:
                    best, bj, bm, bway = cost, j, m, way
    if bm >= 0:
        _swap(order, i, bj, bm, bway)
    return bm


@compiled
def _descend(order, turns, first, last, onward, backward, shortest, head, tail, due, least):  # type: ignore[no-untyped-def]
    """Move after move until none helps; the seconds of the order then.

    `due` (n,) marks the places whose moves are to be judged: after a move those that reach into what it changed.
    """
    n = len(order)
    quiet = i = PLACE_0
    run_tables(order, PLACE_0, n - 1, turns, first, last, onward, backward, shortest, head, tail)
    while quiet < n:
        changed = -1
        if due[i]:
            changed = _improve(i, order, turns, first, last, onward, backward, shortest, head, tail, least)
        if changed >= 0:
            run_tables(order, i, changed, turns, first, last, onward, backward, shortest, head, tail)
            due[max(i - FARTHEST, 0) : min(changed + 2, n)] = True
            quiet = 0
        else:
            due[i] = False
            quiet += 1
            i = (i + 1) % n
    z = order[n - 1]
    return min(head[n - 1, 0] + last[2 * z], head[n - 1, 1] + last[2 * z + 1])


@compiled
def searched(start, turns, first, last, kicks, enough, seed, between):  # type: ignore[no-untyped-def]
    """The best order (n,) of tracks found from `start` with at most so many kicks, and its seconds.

    Stops when an order takes no more than `enough` seconds. `between` (n + 1, n + 1) is from bounds.least_between.
    """
    n = len(start)
    onward, backward = np.empty((n, min(n, FARTHEST), 2, 2)), np.empty((n, min(n, FARTHEST), 2, 2))
    shortest, head, tail = np.empty((n, min(n, FARTHEST), 2)), np.empty((n, 2)), np.empty((n, 2))
    order, kept = start.copy(), start.copy()
    due = np.ones(n, dtype=np.bool_)
    least = np.inf
    for kick in range(kicks + 1):
        cost = _descend(order, turns, first, last, onward, backward, shortest, head, tail, due, between)
        if cost < least - GAIN_S:
            least = cost
            kept[:] = order
        else:
            order[:] = kept
        if n < 4 or least <= enough:
            break
        # Two neighbouring runs of a random place are exchanged.
        i = int(mixed(seed, 3 * kick) * (n - 2))
        j = i + int(mixed(seed, 3 * kick + 1) * min(LONGEST_RUN, n - 2 - i))
        m = j + 1 + int(mixed(seed, 3 * kick + 2) * min(LONGEST_RUN, n - 1 - j))
        _swap(order, i, j, m, PLAIN)
        due[max(i - FARTHEST, 0) : min(m + 2, n)] = True
    return kept, least


@compiled
def _directions(order, turns, first, last):  # type: ignore[no-untyped-def]
    """The passes (n,) that drive an order of tracks in the least seconds, by dynamic programming."""
    n = len(order)
    before = np.zeros((n, 2), dtype=np.int64)
    now = np.array([first[2 * order[0]], first[2 * order[0] + 1]])
    for k in range(1, n):
        then = np.empty(2)
        for d in range(2):
            q = 2 * order[k] + d
            one, two = now[0] + turns[2 * order[k - 1], q], now[1] + turns[2 * order[k - 1] + 1, q]
            before[k, d] = 0 if one <= two else 1
            then[d] = min(one, two)
        now = then
    z = 2 * order[n - 1]
    way = 0 if now[0] + last[z] <= now[1] + last[z + 1] else 1
    passes = np.empty(n, dtype=np.int64)
    for k in range(n - 1, -1, -1):
        passes[k] = 2 * order[k] + way
        way = before[k, way]
    return passes


def seconds_of(order: Ints, turns: Floats, first: Floats, last: Floats) -> float:
    """Least seconds of an order of tracks over all directions."""
    passes = _directions(order, turns, first, last)
    return float(first[passes[0]] + turns[passes[:-1], passes[1:]].sum() + last[passes[-1]])


@dataclass(frozen=True, eq=False)
class Ascent:
    """What an order and its bound were found with: a better bound begins there."""

    turns: Floats
    first: Floats
    last: Floats
    prices: Floats


@dataclass(frozen=True, eq=False)
class Tour:
    """Passes (n,) in order, the seconds of the ways between them, and what no order can undercut.

    `ascent` is there as long as `sharpened` may find a better bound.
    """

    passes: Ints
    seconds: float
    bound_s: float
    ascent: Ascent | None = None

    @property
    def gap_pct(self) -> float:
        """How much quicker another order could be at most, in percent of this one's seconds."""
        return 100.0 * max(0.0, 1.0 - self.bound_s / self.seconds) if self.seconds > GAIN_S else 0.0


def tour(
    turns: Floats, first: Floats, last: Floats, starts: list[list[int]], seed: int = 1, *, kicked: bool = True,
    proven: bool = True, bounded: bool = True,
) -> Tour:  # fmt: skip
    """The best order of tracks found from several to start with; the same for the same input and seed.

    Each start is improved until no move helps; the best is then kicked, more often for few tracks, until it is as good
    as its bound or the kicks are used up; without `kicked` it is left at that, and nothing is proven. Without `proven`
    the best of few tracks is not worked out, without `bounded` the bound is that of the search alone (`sharpened`).
    """
    # One kind of array, however it was cut: the search is compiled for every kind it is given.
    turns, first, last = (np.ascontiguousarray(given) for given in (turns, first, last))
    between = least_between(turns, first, last)
    promising = sorted((np.array(start) for start in starts), key=lambda start: seconds_of(start, turns, first, last))
    orders = [searched(start, turns, first, last, 0, -np.inf, seed, between) for start in promising[:MOST_STARTS]]
    order, seconds = min(orders, key=lambda one: one[1])
    if not kicked:
        return Tour(_directions(order, turns, first, last), float(seconds), 0.0)
    bound, ascent = seconds, None
    if len(order) > 1:
        bound, prices = ascended(between, seconds - GAIN_S)
        ascent = Ascent(turns, first, last, prices)
    enough = bound * (1.0 + CLOSE)
    if seconds > enough and len(order) > 3:
        kicks = max(FEWEST_KICKS, KICKS // len(order))
        order, seconds = searched(order, turns, first, last, kicks, enough, seed, between)
    passes = _directions(order, turns, first, last)
    if proven and seconds > enough and 3 < len(order) <= MOST_PROVEN:
        return _proven(turns, first, last, Tour(passes, float(seconds), float(bound)))
    best = Tour(passes, float(seconds), float(min(bound, seconds)), ascent)
    return sharpened(best) if bounded else best


def sharpened(best: Tour) -> Tour:
    """An order with a better bound where its own leaves much open; that takes longer than the search of many tracks."""
    if best.ascent is None or best.seconds <= best.bound_s * (1.0 + CLOSE):
        return best
    of = best.ascent
    bound = bound_by_ends(of.turns, of.first, of.last, best.seconds - GAIN_S, of.prices)
    return Tour(best.passes, best.seconds, min(max(best.bound_s, bound), best.seconds))


def _proven(turns: Floats, first: Floats, last: Floats, best: Tour) -> Tour:
    """The best of few tracks; what was found where nothing is quicker."""
    passes = best_order(turns, first, last, best.seconds - GAIN_S)
    if not len(passes):
        return Tour(best.passes, best.seconds, best.seconds)
    seconds = float(first[passes[0]] + turns[passes[:-1], passes[1:]].sum() + last[passes[-1]])
    return Tour(passes, seconds, seconds)
