"""An order of tracks cut into loads, exactly.

Passes are numbered as in `strategies.orders.tours`: pass 2 i is track i along its bearing, 2 i + 1 against it.
`turns[p, q]` are the seconds from the end of pass p to the beginning of q, `detours[p, q]` the same by way of the place
where the tank is made good, the stop there included; `first` and `last` the seconds before the first pass and after the
last. A track takes `need` (n,) of a load, no load is above `capacity`; the first begins with what is left, `room`.

For a given order the directions and the cuts of least time come from dynamic programming over the places of the order
at which a load may begin (the split of Beasley, Omega 11 (1983), and Prins, Computers & Operations Research 31 (2004),
with two directions to every place).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from strategies.orders.tours import FAR_S
from vehicle.jit import compiled

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]

SLACK = 1e-9  # of a load: rounding of sums


@dataclass(frozen=True, eq=False)
class Task:
    """An order to be found: seconds and needs as in this module."""

    turns: Floats
    detours: Floats
    first: Floats
    last: Floats
    need: Floats
    room: float
    capacity: float


@dataclass(frozen=True, eq=False)
class Loads:
    """An order in loads: passes (n,), the places (from 0) of the order before which the tank is made good, seconds."""

    passes: Ints
    cuts: tuple[int, ...]
    seconds: float


@compiled
def forwards(order, low, turns, detours, first, need, room, capacity, begun):  # type: ignore[no-untyped-def]
    """Least seconds at which a load can begin with each place in each direction, `begun` (n, 2), from `low` on.

    What `begun` holds before `low` must be that of the same order. The first load begins with place 0.
    """
    n = len(order)
    begun[low:] = FAR_S * n
    if low == 0:
        begun[0, 0], begun[0, 1] = first[2 * order[0]], first[2 * order[0] + 1]
    for start in range(n - 1):
        v0, v1 = begun[start, 0], begun[start, 1]
        left = room if start == 0 else capacity
        left = left * (1.0 + SLACK) - need[order[start]]
        if left < 0.0:
            continue
        for k in range(start, n - 1):
            p, q = 2 * order[k], 2 * order[k + 1]
            if k + 1 >= low:
                for d in range(2):
                    cost = min(v0 + detours[p, q + d], v1 + detours[p + 1, q + d])
                    if cost < begun[k + 1, d]:
                        begun[k + 1, d] = cost
            left -= need[order[k + 1]]
            if left < 0.0:
                break
            v0, v1 = (
                min(v0 + turns[p, q], v1 + turns[p + 1, q]),
                min(v0 + turns[p, q + 1], v1 + turns[p + 1, q + 1]),
            )


@compiled
def backwards(order, turns, detours, last, need, capacity, rest):  # type: ignore[no-untyped-def]
    """Least seconds from the beginning of a load at each place in each direction to the end, `rest` (n, 2)."""
    n = len(order)
    for start in range(n - 1, -1, -1):
        for d in range(2):
            rest[start, d] = FAR_S * n
            v0, v1 = (0.0, FAR_S) if d == 0 else (FAR_S, 0.0)
            left = capacity * (1.0 + SLACK) - need[order[start]]
            for k in range(start, n):
                if left < 0.0:
                    break
                p = 2 * order[k]
                if k == n - 1:
                    rest[start, d] = min(rest[start, d], v0 + last[p], v1 + last[p + 1])
                    break
                q = 2 * order[k + 1]
                for e in range(2):
                    cost = min(v0 + detours[p, q + e], v1 + detours[p + 1, q + e]) + rest[k + 1, e]
                    rest[start, d] = min(rest[start, d], cost)
                left -= need[order[k + 1]]
                v0, v1 = (
                    min(v0 + turns[p, q], v1 + turns[p + 1, q]),
                    min(v0 + turns[p, q + 1], v1 + turns[p + 1, q + 1]),
                )


@compiled
def joined(order, low, high, longest, turns, detours, last, need, room, capacity, begun, rest, spare):  # type: ignore[no-untyped-def]
    """Least seconds of an order that differs only at places `low` to `high` from the one of `begun` and `rest`.

    `longest` is the greatest number of tracks in a load; `spare` (n, 2) is overwritten. `begun[0]` must be right for
    this order where `low` is 0.
    """
    n = len(order)
    best = FAR_S * n
    for k in range(low, min(high + 1, n)):
        spare[k, 0] = spare[k, 1] = FAR_S * n
    if low == 0:
        spare[0, 0], spare[0, 1] = begun[0, 0], begun[0, 1]
    for start in range(max(low - longest, 0), min(high + 1, n)):
        v0, v1 = (spare[start, 0], spare[start, 1]) if start >= low else (begun[start, 0], begun[start, 1])
        left = room if start == 0 else capacity
        left = left * (1.0 + SLACK) - need[order[start]]
        for k in range(start, n):
            if left < 0.0:
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
                    best = min(best, c0 + rest[k + 1, 0], c1 + rest[k + 1, 1])
            left -= need[order[k + 1]]
            v0, v1 = (
                min(v0 + turns[p, q], v1 + turns[p + 1, q]),
                min(v0 + turns[p, q + 1], v1 + turns[p + 1, q + 1]),
            )
    return best


def split(order: Ints, task: Task) -> Loads:
    """The order in loads and directions of least seconds; seconds of FAR_S and more where there is none."""
    n = len(order)
    begun = np.full((n, 2), FAR_S * n)
    begun[0] = task.first[2 * order[0] : 2 * order[0] + 2]
    came: dict[tuple[int, int], tuple[int, int]] = {}
    best, end = np.inf, (0, 0)
    for start in range(n):
        for k, (cost, _) in _load(order, start, begun[start], task):
            if k == n - 1:
                ending = cost + task.last[2 * order[k] : 2 * order[k] + 2]
                if ending.min() < best:
                    best, end = float(ending.min()), (start, int(ending.argmin()))
                continue
            ways = cost[:, None] + _block(task.detours, order[k], order[k + 1])
            for d in range(2):
                if ways[:, d].min() < begun[k + 1, d]:
                    begun[k + 1, d], came[k + 1, d] = ways[:, d].min(), (start, int(ways[:, d].argmin()))
    if not np.isfinite(best):
        return Loads(2 * order, (), FAR_S * n)
    return _traced(order, begun, came, end, best, task)


def _load(
    order: Ints, start: int, begun: Floats, task: Task
) -> Iterator[tuple[int, tuple[Floats, Ints]]]:
    """Place after place of a load begun at `start`: least seconds (2,), and from which direction before."""
    left = (task.room if start == 0 else task.capacity) * (1.0 + SLACK)
    cost, before = begun, np.zeros(2, dtype=np.int64)
    for k in range(start, len(order)):
        left -= task.need[order[k]]
        if left < 0.0:
            return
        if k > start:
            ways = cost[:, None] + _block(task.turns, order[k - 1], order[k])
            cost, before = ways.min(axis=0), ways.argmin(axis=0)
        yield k, (cost, before)


def _block(seconds: Floats, a: int, b: int) -> Floats:
    return seconds[2 * a : 2 * a + 2, 2 * b : 2 * b + 2]


def _traced(
    order: Ints, begun: Floats, came: dict[tuple[int, int], tuple[int, int]], end: tuple[int, int], best: float,
    task: Task,
) -> Loads:  # fmt: skip
    """The passes and cuts of the least seconds, from the end back."""
    passes, cuts, last, (start, d) = np.empty(len(order), dtype=np.int64), list[int](), len(order) - 1, end
    while True:
        chain = {k: before for k, (_, before) in _load(order, start, begun[start], task)}
        for k in range(last, start - 1, -1):
            passes[k] = 2 * order[k] + d
            d = int(chain[k][d]) if k > start else d
        if start == 0:
            return Loads(passes, tuple(reversed(cuts)), best)
        cuts.append(start)
        last, (start, d) = start - 1, came[start, d]
