"""Orders of swaths by local search: good in milliseconds, and the same for the same input.

Passes are numbered: pass 2 i is swath i driven along the layout's bearing, pass 2 i + 1 against it. `turns[p, q]` (2 n,
2 n) are the seconds from the end of pass p to the beginning of pass q, UNREACHABLE_S where no path leads; `first` and
`last` (2 n,) the seconds before a pass that comes first and after one that comes last. An order visits every swath
once; dynamic programming over the two directions settles how each is driven, so that moves only change the order.

The moves are those of Or (1976) and Lin (1965): a run of swaths is reversed, or taken out and put in elsewhere in
either direction, with what lies between reversed or not. Tables of least seconds between any two places of the order
make every move cheap to evaluate. The search ends where no move helps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.copying import copy_row
from vehicle.jit import compile_function

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

UNREACHABLE_S = 1e7
MAX_RUN_SWATHS = 10  # swaths in the shorter of two runs that are swapped; any number may be reversed
MAX_MOVE_SWATHS = 40  # swaths in both together
MIN_GAIN_S = 1e-7
MAX_STARTS = 3
# NumPy's numbers: for every Python constant passed on, the called function would be compiled once more.
PLACE_0: Any = np.int64(0)
NOWHERE: Any = np.int64(-1)
NOT_REVERSED: Any = np.int64(0)  # how two runs are swapped: `_swap_runs`
SECOND_REVERSED: Any = np.int64(2)


@compile_function
def _time_step_to_swath(v0, v1, p, q, turns):  # type: ignore[no-untyped-def]
    """Seconds at both directions of swath q, from seconds (v0, v1) at those of swath p."""
    return (
        min(v0 + turns[2 * p, 2 * q], v1 + turns[2 * p + 1, 2 * q]),
        min(v0 + turns[2 * p, 2 * q + 1], v1 + turns[2 * p + 1, 2 * q + 1]),
    )


@compile_function
def _traverse_run(v0, v1, run):  # type: ignore[no-untyped-def]
    """Seconds at the far end of a run from those at its beginning; `run` (2, 2) is from `update_run_tables`."""
    return min(v0 + run[0, 0], v1 + run[1, 0]), min(v0 + run[0, 1], v1 + run[1, 1])


@compile_function
def update_run_tables(  # type: ignore[no-untyped-def]
    order, low, high, turns, first, last, onward, backward, shortest, head, tail
):
    """Bring the tables up to date with an order whose places low..high have changed.

    Least seconds from place i to place i + w (`onward[i, w]`) and from there back to i (`backward[i, w]`), each (2, 2)
    by direction, for w below MAX_MOVE_SWATHS; the least of either over directions (`shortest[i, w]`, (2,)); from the
    start to a place (`head`) and from a place to the end (`tail`).
    """
    n, most = len(order), onward.shape[1]
    for i in range(max(low - most + 1, 0), high + 1):
        for w in range(max(low - i, 0), min(most, n - i)):
            for d in range(2):
                if w == 0:
                    for e in range(2):
                        onward[i, 0, d, e] = backward[i, 0, d, e] = 0.0 if d == e else 2.0 * UNREACHABLE_S
                    shortest[i, 0, 1] = 0.0
                    continue
                a, b = onward[i, w - 1, d, 0], onward[i, w - 1, d, 1]
                onward[i, w, d, 0], onward[i, w, d, 1] = _time_step_to_swath(
                    a, b, order[i + w - 1], order[i + w], turns
                )
            shortest[i, w, 0] = onward[i, w].min()
    for j in range(low, min(high + most, n)):
        for i in range(min(j - 1, high), max(j - most, -1), -1):
            for d in range(2):
                a, b = backward[i + 1, j - i - 1, d, 0], backward[i + 1, j - i - 1, d, 1]
                backward[i, j - i, d, 0], backward[i, j - i, d, 1] = _time_step_to_swath(
                    a, b, order[i + 1], order[i], turns
                )
            shortest[i, j - i, 1] = backward[i, j - i].min()
    for k in range(low, n):
        if k == 0:
            head[0, 0], head[0, 1] = first[2 * order[0]], first[2 * order[0] + 1]
        else:
            head[k, 0], head[k, 1] = _time_step_to_swath(head[k - 1, 0], head[k - 1, 1], order[k - 1], order[k], turns)
    for k in range(high, -1, -1):
        for d in range(2):
            p = 2 * order[k] + d
            if k == n - 1:
                tail[k, d] = last[p]
            else:
                q = 2 * order[k + 1]
                tail[k, d] = min(turns[p, q] + tail[k + 1, 0], turns[p, q + 1] + tail[k + 1, 1])


@compile_function
def _time_swath_entry(order, k, q, turns, first, head):  # type: ignore[no-untyped-def]
    """Seconds at swath q when it follows place k of the order, or comes first (k = -1)."""
    if k < 0:
        return first[2 * q], first[2 * q + 1]
    return _time_step_to_swath(head[k, 0], head[k, 1], order[k], q, turns)


@compile_function
def _time_order_finish(v0, v1, order, p, k, turns, last, tail):  # type: ignore[no-untyped-def]
    """Seconds of the whole order when swath p, reached at (v0, v1), is followed by place k, or is the last (k = n)."""
    if k >= len(order):
        return min(v0 + last[2 * p], v1 + last[2 * p + 1])
    w0, w1 = _time_step_to_swath(v0, v1, p, order[k], turns)
    return min(w0 + tail[k, 0], w1 + tail[k, 1])


@compile_function
def _time_swap(order, i, j, m, reversal, turns, first, last, onward, backward, head, tail):  # type: ignore[no-untyped-def]
    """Seconds when the neighbouring runs i..j and j+1..m swap places; `reversal` as in `_swap_runs`."""
    second_run, back = onward[j + 1, m - j - 1], j + 1
    end = m
    if reversal >= 2:
        second_run, back, end = backward[j + 1, m - j - 1], m, j + 1
    v0, v1 = _time_swath_entry(order, i - 1, order[back], turns, first, head)
    v0, v1 = _traverse_run(v0, v1, second_run)
    begin, stop, first_run = i, j, onward[i, j - i]
    if reversal % 2 == 1:
        begin, stop, first_run = j, i, backward[i, j - i]
    v0, v1 = _time_step_to_swath(v0, v1, order[end], order[begin], turns)
    v0, v1 = _traverse_run(v0, v1, first_run)
    return _time_order_finish(v0, v1, order, order[stop], m + 1, turns, last, tail)


@compile_function
def _swap_runs(order, i, j, m, reversal):  # type: ignore[no-untyped-def]
    """Swap the runs i..j and j+1..m; `reversal` 1 and 3 reverse the first run, 2 and 3 the second."""
    a, b = order[i : j + 1].copy(), order[j + 1 : m + 1].copy()
    copy_row(b[::-1] if reversal >= 2 else b, order[i : i + len(b)])
    copy_row(a[::-1] if reversal % 2 == 1 else a, order[i + len(b) : m + 1])


@compile_function
def _get_least_step(order, p, q, least) -> float:  # type: ignore[no-untyped-def]
    """Least seconds of a step from place p to place q; p may be -1 and q n."""
    n = len(order)
    return least[order[p] if p >= 0 else n, order[q] if q < n else n]  # type: ignore[no-any-return]


@compile_function
def _apply_best_move(i, order, turns, first, last, onward, backward, shortest, head, tail, least):  # type: ignore[no-untyped-def]
    """Carry out the best move of runs that begin at place i; returns the last place it changed, -1 if none helps.

    The tables must be those of `order`. A move is timed exactly only if the least seconds of its runs and its new
    steps, each over all directions, do not rule it out.
    """
    n = len(order)
    z = order[n - 1]
    best = min(head[n - 1, 0] + last[2 * z], head[n - 1, 1] + last[2 * z + 1])
    best_j, best_m, best_reversal = NOWHERE, NOWHERE, NOT_REVERSED
    begun_s = min(head[i - 1, 0], head[i - 1, 1]) if i > 0 else 0.0
    back = np.array([[0.0, 2.0 * UNREACHABLE_S], [2.0 * UNREACHABLE_S, 0.0]])  # from place m back to i
    for m in range(i + 1, n):
        for e in range(2):
            p, q = 2 * order[m], 2 * order[m - 1]
            from_forward, from_backward = back[0, e], back[1, e]
            back[0, e] = min(turns[p, q] + from_forward, turns[p, q + 1] + from_backward)
            back[1, e] = min(turns[p + 1, q] + from_forward, turns[p + 1, q + 1] + from_backward)
        outer_s = begun_s + (min(tail[m + 1, 0], tail[m + 1, 1]) if m + 1 < n else 0.0)
        outer_s += _get_least_step(order, i - 1, m, least) + _get_least_step(order, i, m + 1, least)
        if outer_s + min(min(back[0, 0], back[0, 1]), min(back[1, 0], back[1, 1])) >= best - MIN_GAIN_S:
            continue
        v0, v1 = _time_swath_entry(order, i - 1, order[m], turns, first, head)
        v0, v1 = _traverse_run(v0, v1, back)
        reversed_s = _time_order_finish(v0, v1, order, order[i], m + 1, turns, last, tail)
        if reversed_s < best - MIN_GAIN_S:
            best, best_j, best_m, best_reversal = reversed_s, i - 1, m, SECOND_REVERSED
    for m in range(i + 1, min(i + MAX_MOVE_SWATHS, n)):
        outer_s = begun_s + (min(tail[m + 1, 0], tail[m + 1, 1]) if m + 1 < n else 0.0)
        for j in range(i, m):
            if j - i >= MAX_RUN_SWATHS and m - j > MAX_RUN_SWATHS:
                continue
            for reversal in range(4):
                begin, end = (m, j + 1) if reversal >= 2 else (j + 1, m)
                start, stop = (j, i) if reversal % 2 == 1 else (i, j)
                new_steps_s = _get_least_step(order, i - 1, begin, least) + _get_least_step(order, end, start, least)
                new_steps_s += _get_least_step(order, stop, m + 1, least)
                if (
                    outer_s + new_steps_s + shortest[i, j - i, reversal % 2] + shortest[j + 1, m - j - 1, reversal // 2]
                    >= best - MIN_GAIN_S
                ):
                    continue
                cost = _time_swap(order, i, j, m, reversal, turns, first, last, onward, backward, head, tail)
                if cost < best - MIN_GAIN_S:
                    best, best_j, best_m, best_reversal = cost, j, m, reversal
    if best_m >= 0:
        _swap_runs(order, i, best_j, best_m, best_reversal)
    return best_m


@compile_function
def _improve_order(order, turns, first, last, onward, backward, shortest, head, tail, due, least):  # type: ignore[no-untyped-def]
    """Apply moves until none helps; returns the seconds of the order then.

    `due` (n,) marks the places whose moves are to be evaluated: after a move those that reach into what it changed.
    """
    n = len(order)
    quiet_count = i = PLACE_0
    update_run_tables(order, PLACE_0, n - 1, turns, first, last, onward, backward, shortest, head, tail)
    while quiet_count < n:
        changed = -1
        if due[i]:
            changed = _apply_best_move(i, order, turns, first, last, onward, backward, shortest, head, tail, least)
        if changed >= 0:
            update_run_tables(order, i, changed, turns, first, last, onward, backward, shortest, head, tail)
            due[max(i - MAX_MOVE_SWATHS, 0) : min(changed + 2, n)] = True
            quiet_count = 0
        else:
            due[i] = False
            quiet_count += 1
            i = (i + 1) % n
    z = order[n - 1]
    return min(head[n - 1, 0] + last[2 * z], head[n - 1, 1] + last[2 * z + 1])


@compile_function
def search_tour(start, turns, first, last, between):  # type: ignore[no-untyped-def]
    """The order (n,) of swaths found from `start` when no move helps any more, and its seconds.

    `between` (n + 1, n + 1) is from `compute_least_between_s`.
    """
    n = len(start)
    onward, backward = np.empty((n, min(n, MAX_MOVE_SWATHS), 2, 2)), np.empty((n, min(n, MAX_MOVE_SWATHS), 2, 2))
    shortest, head, tail = np.empty((n, min(n, MAX_MOVE_SWATHS), 2)), np.empty((n, 2)), np.empty((n, 2))
    order, due = start.copy(), np.ones(n, dtype=np.bool_)
    seconds = _improve_order(order, turns, first, last, onward, backward, shortest, head, tail, due, between)
    return order, seconds


@compile_function
def sum_order_s(order, turns, first, last) -> float:  # type: ignore[no-untyped-def]
    """Least seconds of an order of swaths (n,) over all directions."""
    v0, v1 = first[2 * order[0]], first[2 * order[0] + 1]
    for k in range(1, len(order)):
        v0, v1 = _time_step_to_swath(v0, v1, order[k - 1], order[k], turns)
    z = 2 * order[len(order) - 1]
    return min(v0 + last[z], v1 + last[z + 1])  # type: ignore[no-any-return]


def compute_least_between_s(turns: Floats, first: Floats, last: Floats) -> Floats:
    """Least seconds between any two of n swaths and the node of start and end, symmetric (n + 1, n + 1)."""
    n = len(first) // 2
    blocks = turns.reshape(n, 2, n, 2).min(axis=(1, 3))
    least_s = np.full((n + 1, n + 1), np.inf)
    least_s[:n, :n] = np.minimum(blocks, blocks.T)
    end_times_s = np.minimum(first, last).reshape(n, 2).min(axis=1)
    least_s[n, :n] = least_s[:n, n] = end_times_s
    np.fill_diagonal(least_s, np.inf)
    return least_s


def find_best_order(turns: Floats, first: Floats, last: Floats, starts: list[list[int]]) -> tuple[Ints, float]:
    """The best order (n,) of swaths found from the most promising of some starts, and its seconds."""
    # Contiguous arrays only: the search is compiled for every memory layout it is given.
    turns, first, last = (np.ascontiguousarray(given) for given in (turns, first, last))
    between = compute_least_between_s(turns, first, last)
    promising = sorted((np.array(start) for start in starts), key=lambda start: sum_order_s(start, turns, first, last))
    orders = [search_tour(start, turns, first, last, between) for start in promising[:MAX_STARTS]]
    order, seconds = min(orders, key=lambda result: result[1])
    return order, float(seconds)
