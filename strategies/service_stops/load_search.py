"""Orders of swaths cut into loads, exactly for a given order, and searched over all orders.

Passes are numbered as in sequencing.tour_search: pass 2 i is swath i along its bearing, 2 i + 1 against it. `turns[p,
q]` are the seconds from the end of pass p to the beginning of q, `detours[p, q]` the same by way of the service point,
including the stop; `first` and `last` the seconds before the first pass and after the last. A swath needs `need` (n,)
of a load, no load is above `capacity`; the first load is `first_load`.

For a given order, dynamic programming over the places at which a load may begin finds the directions and cuts of least
time (the split of Beasley, Omega 11 (1983), and Prins, Computers & Operations Research 31 (2004), with two directions
at every place).

Moves of the search go across the borders of loads: a run of swaths is reversed (2-opt), two
neighbouring runs are swapped in either direction (or-opt and longer), and two swaths are swapped. Only the part of the
split that a move touches is recomputed. When no move helps, two runs are swapped at random, until a number of evaluated
moves is used up: the result depends on no clock.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from vehicle.jit import compile_function
from vehicle.model.gnss import draw_uniform

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

UNREACHABLE_S, MIN_GAIN_S = 1e7, 1e-7
# NumPy's numbers: for every Python constant passed on, the called function would be compiled once more.
PLACE_0: Any = np.int64(0)
NOWHERE: Any = np.int64(-1)
LOAD_TOLERANCE = 1e-9  # relative rounding of sums


@dataclass(frozen=True, eq=False)
class LoadOrderingTask:
    """An order to be found: seconds and needs as in this module."""

    turns: Floats
    detours: Floats
    first: Floats
    last: Floats
    need: Floats
    first_load: float
    capacity: float


@dataclass(frozen=True, eq=False)
class LoadedOrder:
    """An order in loads: passes (n,), the places (from 0) of the order before which the tank is refilled, seconds."""

    passes: Ints
    cuts: tuple[int, ...]
    seconds: float


@compile_function
def compute_load_begins(order, low, turns, detours, first, need, first_load, capacity, begun_s):  # type: ignore[no-untyped-def]
    """Least seconds at which a load can begin with each place in each direction, `begun_s` (n, 2), from `low` on.

    What `begun_s` holds before `low` must be that of the same order. The first load begins with place 0.
    """
    n = len(order)
    begun_s[low:] = UNREACHABLE_S * n
    if low == 0:
        begun_s[0, 0], begun_s[0, 1] = first[2 * order[0]], first[2 * order[0] + 1]
    for start in range(n - 1):
        v0, v1 = begun_s[start, 0], begun_s[start, 1]
        remaining_load = first_load if start == 0 else capacity
        remaining_load = remaining_load * (1.0 + LOAD_TOLERANCE) - need[order[start]]
        if remaining_load < 0.0:
            continue
        for k in range(start, n - 1):
            p, q = 2 * order[k], 2 * order[k + 1]
            if k + 1 >= low:
                for d in range(2):
                    cost = min(v0 + detours[p, q + d], v1 + detours[p + 1, q + d])
                    if cost < begun_s[k + 1, d]:
                        begun_s[k + 1, d] = cost
            remaining_load -= need[order[k + 1]]
            if remaining_load < 0.0:
                break
            v0, v1 = (
                min(v0 + turns[p, q], v1 + turns[p + 1, q]),
                min(v0 + turns[p, q + 1], v1 + turns[p + 1, q + 1]),
            )


@compile_function
def compute_load_remainders(order, turns, detours, last, need, capacity, to_end_s):  # type: ignore[no-untyped-def]
    """Least seconds from the beginning of a load at each place in each direction to the end, `to_end_s` (n, 2)."""
    n = len(order)
    for start in range(n - 1, -1, -1):
        for d in range(2):
            to_end_s[start, d] = UNREACHABLE_S * n
            v0, v1 = (0.0, UNREACHABLE_S) if d == 0 else (UNREACHABLE_S, 0.0)
            remaining_load = capacity * (1.0 + LOAD_TOLERANCE) - need[order[start]]
            for k in range(start, n):
                if remaining_load < 0.0:
                    break
                p = 2 * order[k]
                if k == n - 1:
                    to_end_s[start, d] = min(to_end_s[start, d], v0 + last[p], v1 + last[p + 1])
                    break
                q = 2 * order[k + 1]
                for e in range(2):
                    cost = min(v0 + detours[p, q + e], v1 + detours[p + 1, q + e]) + to_end_s[k + 1, e]
                    to_end_s[start, d] = min(to_end_s[start, d], cost)
                remaining_load -= need[order[k + 1]]
                v0, v1 = (
                    min(v0 + turns[p, q], v1 + turns[p + 1, q]),
                    min(v0 + turns[p, q + 1], v1 + turns[p + 1, q + 1]),
                )


@compile_function
def compute_move_seconds(  # type: ignore[no-untyped-def]
    order, low, high, longest, turns, detours, last, need, first_load, capacity, begun_s, to_end_s, spare
):
    """Least seconds of an order that differs only at places `low` to `high` from that of `begun_s` and `to_end_s`.

    `longest` is the greatest number of swaths in a load; `spare` (n, 2) is overwritten. `begun_s[0]` must be right for
    this order if `low` is 0.
    """
    n = len(order)
    best = UNREACHABLE_S * n
    for k in range(low, min(high + 1, n)):
        spare[k, 0] = spare[k, 1] = UNREACHABLE_S * n
    if low == 0:
        spare[0, 0], spare[0, 1] = begun_s[0, 0], begun_s[0, 1]
    for start in range(max(low - longest, 0), min(high + 1, n)):
        v0, v1 = (spare[start, 0], spare[start, 1]) if start >= low else (begun_s[start, 0], begun_s[start, 1])
        remaining_load = first_load if start == 0 else capacity
        remaining_load = remaining_load * (1.0 + LOAD_TOLERANCE) - need[order[start]]
        for k in range(start, n):
            if remaining_load < 0.0:
                break
            p = 2 * order[k]
            if k == n - 1:
                best = min(best, v0 + last[p], v1 + last[p + 1])
                break
            q = 2 * order[k + 1]
            if k + 1 >= low:
                c0 = min(v0 + detours[p, q], v1 + detours[p + 1, q])
                c1 = min(v0 + detours[p, q + 1], v1 + detours[p + 1, q + 1])
                if k + 1 <= high:
                    spare[k + 1, 0], spare[k + 1, 1] = min(spare[k + 1, 0], c0), min(spare[k + 1, 1], c1)
                else:
                    best = min(best, c0 + to_end_s[k + 1, 0], c1 + to_end_s[k + 1, 1])
            remaining_load -= need[order[k + 1]]
            v0, v1 = (
                min(v0 + turns[p, q], v1 + turns[p + 1, q]),
                min(v0 + turns[p, q + 1], v1 + turns[p + 1, q + 1]),
            )
    return best


def split_into_loads(order: Ints, task: LoadOrderingTask) -> LoadedOrder:
    """The order in loads and directions of least seconds; seconds of UNREACHABLE_S and more if there is none."""
    n = len(order)
    begun_s = np.full((n, 2), UNREACHABLE_S * n)
    begun_s[0] = task.first[2 * order[0] : 2 * order[0] + 2]
    came_from: dict[tuple[int, int], tuple[int, int]] = {}
    best, end = np.inf, (0, 0)
    for start in range(n):
        for k, (cost, _) in _time_load_places(order, start, begun_s[start], task):
            if k == n - 1:
                ending = cost + task.last[2 * order[k] : 2 * order[k] + 2]
                if ending.min() < best:
                    best, end = float(ending.min()), (start, int(ending.argmin()))
                continue
            times_s = cost[:, None] + _get_block(task.detours, order[k], order[k + 1])
            for d in range(2):
                if times_s[:, d].min() < begun_s[k + 1, d]:
                    begun_s[k + 1, d], came_from[k + 1, d] = times_s[:, d].min(), (start, int(times_s[:, d].argmin()))
    if not np.isfinite(best):
        return LoadedOrder(2 * order, (), UNREACHABLE_S * n)
    return _trace_loads(order, begun_s, came_from, end, best, task)


def _time_load_places(
    order: Ints, start: int, begun: Floats, task: LoadOrderingTask
) -> Iterator[tuple[int, tuple[Floats, Ints]]]:
    """Place after place of a load begun at `start`: least seconds (2,), and the direction before."""
    remaining_load = (task.first_load if start == 0 else task.capacity) * (1.0 + LOAD_TOLERANCE)
    cost, before = begun, np.zeros(2, dtype=np.int64)
    for k in range(start, len(order)):
        remaining_load -= task.need[order[k]]
        if remaining_load < 0.0:
            return
        if k > start:
            times_s = cost[:, None] + _get_block(task.turns, order[k - 1], order[k])
            cost, before = times_s.min(axis=0), times_s.argmin(axis=0)
        yield k, (cost, before)


def _get_block(seconds: Floats, a: int, b: int) -> Floats:
    return seconds[2 * a : 2 * a + 2, 2 * b : 2 * b + 2]


def _trace_loads(
    order: Ints,
    begun: Floats,
    came_from: dict[tuple[int, int], tuple[int, int]],
    end: tuple[int, int],
    best: float,
    task: LoadOrderingTask,
) -> LoadedOrder:
    """The passes and cuts of the least seconds, from the end back."""
    passes, cuts, last, (start, d) = np.empty(len(order), dtype=np.int64), list[int](), len(order) - 1, end
    while True:
        chain = {k: before for k, (_, before) in _time_load_places(order, start, begun[start], task)}
        for k in range(last, start - 1, -1):
            passes[k] = 2 * order[k] + d
            d = int(chain[k][d]) if k > start else d
        if start == 0:
            return LoadedOrder(passes, tuple(reversed(cuts)), best)
        cuts.append(start)
        last, (start, d) = start - 1, came_from[start, d]


SEARCH_EFFORT_STEPS = 40_000_000  # steps of the split in one search, about 0.5 s
MAX_MOVE_PLACES = 40  # places that a move may span
MAX_REVERSED_PLACES = 80  # places in a run that is reversed
MAX_SHORT_RUN = 4  # swaths in the shorter of two runs that are swapped
MAX_STARTS = 4


@compile_function
def _write_move(order, scratch, i, j, m, kind):  # type: ignore[no-untyped-def]
    """Write a move of places i to m into `scratch`: the part of the order there, in its new sequence."""
    if kind == 0:  # reversed
        for k in range(i, m + 1):
            scratch[k] = order[i + m - k]
        return
    if kind == 5:  # the two at the ends are swapped
        for k in range(i, m + 1):
            scratch[k] = order[k]
        scratch[i], scratch[m] = order[m], order[i]
        return
    reverses_first, reverses_second = (kind - 1) % 2 == 1, (kind - 1) >= 2
    b = m - j
    for k in range(b):
        scratch[i + k] = order[m - k] if reverses_second else order[j + 1 + k]
    for k in range(j + 1 - i):
        scratch[i + b + k] = order[j - k] if reverses_first else order[i + k]


@compile_function
def _evaluate_order(order, last, begun, to_end_s, turns, detours, first, need, first_load, capacity) -> float:  # type: ignore[no-untyped-def]
    """Fill the tables of an order; returns its least seconds."""
    compute_load_begins(order, 0, turns, detours, first, need, first_load, capacity, begun)
    compute_load_remainders(order, turns, detours, last, need, capacity, to_end_s)
    n = len(order)
    spare = np.empty((n, 2))
    return float(
        compute_move_seconds(
            order, 0, n - 1, n, turns, detours, last, need, first_load, capacity, begun, to_end_s, spare
        )
    )


@compile_function
def improve_loaded_order(order, turns, detours, first, last, need, first_load, capacity, longest, effort):  # type: ignore[no-untyped-def]
    """Apply moves until none helps or the effort is used up; returns the seconds of `order` and the effort left."""
    n = len(order)
    begun, to_end_s, spare = np.empty((n, 2)), np.empty((n, 2)), np.empty((n, 2))
    scratch, saved_begin = order.copy(), np.empty(2)
    current_s = _evaluate_order(order, last, begun, to_end_s, turns, detours, first, need, first_load, capacity)
    quiet_count = i = PLACE_0
    while quiet_count < n and effort > 0:
        best, best_j, best_m, best_kind = current_s - MIN_GAIN_S, NOWHERE, NOWHERE, NOWHERE
        for m in range(i + 1, min(i + MAX_REVERSED_PLACES, n)):
            for j in range(i, m):
                is_short = min(j - i + 1, m - j) <= MAX_SHORT_RUN and m - i < MAX_MOVE_PLACES
                if j > i and not is_short:
                    continue
                for kind in range(6):
                    if kind == 0 and j > i:
                        continue
                    if kind == 5 and (j > i or m - i >= MAX_MOVE_PLACES):
                        continue
                    if 0 < kind < 5 and not is_short:
                        continue
                    if (kind - 1) % 2 == 1 and 0 < kind < 5 and j == i:
                        continue  # a single swath has no reverse
                    if (kind == 3 or kind == 4) and m == j + 1:
                        continue
                    _write_move(order, scratch, i, j, m, kind)
                    saved_begin[:] = begun[0]
                    if i == 0:
                        begun[0, 0], begun[0, 1] = first[2 * scratch[0]], first[2 * scratch[0] + 1]
                    cost = compute_move_seconds(
                        scratch, i, m, longest, turns, detours, last, need, first_load, capacity, begun, to_end_s, spare
                    )
                    begun[0] = saved_begin
                    effort -= (m - i + 1 + longest) * longest
                    if cost < best:
                        best, best_j, best_m, best_kind = cost, j, m, kind
            scratch[i : m + 1] = order[i : m + 1]
        if best_kind >= 0:
            _write_move(order, scratch, i, best_j, best_m, best_kind)
            order[i : best_m + 1] = scratch[i : best_m + 1]
            current_s = _evaluate_order(order, last, begun, to_end_s, turns, detours, first, need, first_load, capacity)
            quiet_count = 0
        else:
            quiet_count += 1
            i = (i + 1) % n
    return current_s, effort


@compile_function
def search_with_kicks(start, turns, detours, first, last, need, first_load, capacity, longest, effort, seed):  # type: ignore[no-untyped-def]
    """The best order found from `start` with this effort, and its seconds."""
    n = len(start)
    order, best_order = start.copy(), start.copy()
    best_s, kick = np.inf, 0
    while True:
        cost, effort = improve_loaded_order(
            order, turns, detours, first, last, need, first_load, capacity, longest, effort
        )
        if cost < best_s - MIN_GAIN_S:
            best_s = cost
            best_order[:] = order
        else:
            order[:] = best_order
        if n < 4 or effort <= 0:
            return best_order, best_s
        for _ in range(1 + kick % 2):
            i = int(draw_uniform(seed, 4 * kick) * (n - 2))
            j = i + int(draw_uniform(seed, 4 * kick + 1) * min(MAX_MOVE_PLACES, n - 2 - i))
            m = j + 1 + int(draw_uniform(seed, 4 * kick + 2) * min(MAX_MOVE_PLACES, n - 1 - j))
            a, b = order[i : j + 1].copy(), order[j + 1 : m + 1].copy()
            order[i : i + len(b)] = b
            order[i + len(b) : m + 1] = a
            kick += 1


def count_swaths_of_load(task: LoadOrderingTask) -> int:
    """The greatest number of swaths that one load is enough for, plus one."""
    return int(np.searchsorted(np.cumsum(np.sort(task.need)), max(task.first_load, task.capacity) * (1.0 + 1e-9))) + 1


def order_in_loads(
    task: LoadOrderingTask, starts: Sequence[Sequence[int]], seed: int = 1, effort: int = SEARCH_EFFORT_STEPS
) -> LoadedOrder:
    """The best order found from several starts, in loads; the same for the same input and seed."""
    arrays = task.turns, task.detours, task.first, task.last, task.need, task.first_load, task.capacity
    start_orders = [np.array(start, dtype=np.int64) for start in starts]
    promising = sorted(start_orders, key=lambda order: round(split_into_loads(order, task).seconds, 6))[:MAX_STARTS]
    longest_load, results = count_swaths_of_load(task), list[tuple[float, Ints]]()
    for order in promising:
        best, seconds = search_with_kicks(order, *arrays, longest_load, effort // len(promising), seed)
        results.append((float(seconds), best))
    order = min(results, key=lambda result: round(result[0], 6))[1]
    return split_into_loads(order, task) if results else LoadedOrder(start_orders[0], (), UNREACHABLE_S)
