"""Head starts with which two stretches meet, and who passes a hold point when: from places to times, compiled.

What is found in the order of the first course's places is put together at once: a span that overlaps the last one of
the same two stretches only makes that longer. Few are left to be sorted.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from planner.yielding.ways_home import copied, first_row
from vehicle.jit import compiled

Array = npt.NDArray[Any]
KINDS = 4  # a place in the middle of a stretch or at its end, on either course


class Encounters:
    """What two courses at a time have to do with each other, collected for a whole fleet."""

    def __init__(self) -> None:
        """Of nobody yet."""
        self._apart: list[Array] = [np.zeros((0, 3), dtype=np.int64)]
        self._apart_s: list[Array] = [np.zeros((0, 2))]
        self._stands: list[Array] = [np.zeros((0, 2), dtype=np.int64)]
        self._stands_s: list[Array] = [np.zeros((0, 2))]

    def add(self, met: tuple[Array, Array, Array, Array, Array, Array], base_a: int, base_b: int) -> None:
        """What `meet` found of two courses whose places are numbered from here on."""
        apart, apart_s, by_a, by_a_s, by_b, by_b_s = met
        self._apart.append(apart + np.array([base_a, base_b, 0]))
        self._stands += [by_a + np.array([base_a, base_b]), by_b + np.array([base_b, base_a])]
        self._apart_s.append(apart_s)
        self._stands_s += [by_a_s, by_b_s]

    def apart(self, together_s: float) -> tuple[Array, Array, Array]:
        """Stretches, other stretches and spans of time between them, those nearer to each other than this made one."""
        keys, spans = np.concatenate(self._apart), np.concatenate(self._apart_s)
        order = np.lexsort((spans[:, 0], keys[:, 2], keys[:, 1], keys[:, 0]))
        keys, spans = np.ascontiguousarray(keys[order]), np.ascontiguousarray(spans[order])
        count = _joined(keys, spans, together_s)
        return keys[:count, 0], keys[:count, 1], spans[:count]

    def stands(self) -> tuple[Array, Array, Array]:
        """Hold points, stretches that lead by them, and when."""
        keys = np.concatenate(self._stands)
        return keys[:, 0], keys[:, 1], np.concatenate(self._stands_s)


def meet(
    found: Array, time_a: Array, time_b: Array, holds_a: Array, holds_b: Array
) -> tuple[Array, Array, Array, Array, Array, Array]:
    """What two courses have to do with each other where they meet, rows as of vehicle.meetings.

    Rows (stretch, other stretch, kind) with spans of time; and twice, for hold points of the first course and of the
    second, rows (hold point, other's stretch) with when, since that stretch began, it comes by first and last.
    """
    apart, apart_s, count = _spans(found, time_a, time_b, holds_a, holds_b)
    by_a, by_a_s, standing_a = _passed_first(found, time_b, holds_a, holds_b)
    by_b, by_b_s, standing_b = _passed_second(found, time_a, holds_a, holds_b)
    return (
        apart[:count], apart_s[:count], by_a[:standing_a], by_a_s[:standing_a], by_b[:standing_b], by_b_s[:standing_b]
    )  # fmt: skip


@compiled
def mark_used(found, used_a, used_b) -> None:  # type: ignore[no-untyped-def]
    """Mark the places of two courses that are in somebody's way."""
    for row in range(len(found)):
        used_a[found[row, 0]] = True
        for place in range(found[row, 1], found[row, 2] + 1):
            used_b[place] = True


@compiled
def _before(holds, place):  # type: ignore[no-untyped-def]
    """Number of the last hold point that is not after a place."""
    return first_row(holds, np.int64(0), len(holds), place + 1) - 1


@compiled
def _grown(keys, spans):  # type: ignore[no-untyped-def]
    """The same rows with room for as many again."""
    more, longer = np.empty((2 * len(keys), keys.shape[1]), dtype=np.int64), np.empty((2 * len(keys), 2))
    for row in range(len(keys)):
        copied(keys[row], more[row])
        copied(spans[row], longer[row])
    return more, longer


@compiled
def _widened(keys, spans, count, latest, s, u, kind, since, until):  # type: ignore[no-untyped-def]
    """The rows with one more span of two stretches; one that overlaps the last of these only makes that wider."""
    known = latest[kind, u]
    if known >= 0 and keys[known, 0] == s and since <= spans[known, 1] and until >= spans[known, 0]:
        spans[known, 0] = min(spans[known, 0], since)
        spans[known, 1] = max(spans[known, 1], until)
        return keys, spans, count
    if count == len(keys):
        keys, spans = _grown(keys, spans)
    keys[count, 0], keys[count, 1], keys[count, 2] = s, u, kind
    spans[count, 0], spans[count, 1] = since, until
    latest[kind, u] = count
    return keys, spans, count + 1


@compiled
def _spans(found, time_a, time_b, holds_a, holds_b):  # type: ignore[no-untyped-def]
    """Rows of two stretches and a kind, spans of head starts between them, and how many there are.

    A place lies in the stretch that it begins or is inside of, and a hold point also at the end of the one before.
    """
    keys, spans, count = np.empty((64, 3), dtype=np.int64), np.empty((64, 2)), np.int64(0)
    latest = np.full((KINDS, len(holds_b)), -1)
    for row in range(len(found)):
        i, first, last = found[row, 0], found[row, 1], found[row, 2]
        s = inner = _before(holds_a, i)
        while s >= 0 and (s == inner or holds_a[s + 1] == i):
            if s < len(holds_a) - 1:
                at_end = np.int64(0 if s == inner else 2)
                a_from = time_a[i] - time_a[holds_a[s]]
                a_to = time_a[min(i + 1, holds_a[s + 1])] - time_a[holds_a[s]]
                u = max(0, _before(holds_b, first) - 1)
                while u < len(holds_b) - 1 and holds_b[u] <= last:
                    began, end = time_b[holds_b[u]], holds_b[u + 1]
                    low, high = max(first, holds_b[u]), min(last, end - 1)
                    if low <= high:
                        since, until = time_b[low] - began - a_to, time_b[high + 1] - began - a_from
                        keys, spans, count = _widened(keys, spans, count, latest, s, u, at_end, since, until)
                    if first <= end <= last:
                        since, until = time_b[end] - began - a_to, time_b[end] - began - a_from
                        keys, spans, count = _widened(keys, spans, count, latest, s, u, at_end + 1, since, until)
                    u += 1
            s -= 1
    return keys, spans, count


@compiled
def _joined(keys, spans, together):  # type: ignore[no-untyped-def]
    """Put together rows of the same key whose spans overlap or nearly do, in place; returns how many are left."""
    count = 0
    for row in range(len(keys)):
        same = count > 0
        for column in range(3):
            same = same and keys[row, column] == keys[count - 1, column]
        if same and spans[row, 0] <= spans[count - 1, 1] + together:
            spans[count - 1, 1] = max(spans[count - 1, 1], spans[row, 1])
            continue
        copied(keys[row], keys[count])
        copied(spans[row], spans[count])
        count += 1
    return count


@compiled
def _noted(keys, times, count, latest, hold, stretch, first, last, time, holds):  # type: ignore[no-untyped-def]
    """The rows with places `first` to `last` of a stretch, in order, that lead by a hold point."""
    began = time[holds[stretch]]
    until = time[min(last + 1, holds[stretch + 1])] - began
    for k in range(2):
        known = latest[hold, k]
        if known >= 0 and keys[known, 1] == stretch:
            times[known, 1] = until
            return keys, times, count
    if count == len(keys):
        keys, times = _grown(keys, times)
    keys[count, 0], keys[count, 1] = hold, stretch
    times[count, 0], times[count, 1] = time[first] - began, until
    latest[hold, 0], latest[hold, 1] = latest[hold, 1], count
    return keys, times, count + 1


@compiled
def _passed_first(found, time_b, holds_a, holds_b):  # type: ignore[no-untyped-def]
    """Which stretches of the second course lead by the hold points of the first, when, and how many rows those are."""
    keys, times, count = np.empty((16, 2), dtype=np.int64), np.empty((16, 2)), np.int64(0)
    latest = np.full((len(holds_a), 2), -1)
    for row in range(len(found)):
        i, first, last = found[row, 0], found[row, 1], found[row, 2]
        hold = _before(holds_a, i)
        while hold >= 0 and holds_a[hold] == i:
            u = max(0, _before(holds_b, first) - 1)
            while u < len(holds_b) - 1 and holds_b[u] <= last:
                low, high = max(first, holds_b[u]), min(last, holds_b[u + 1])
                if low <= high:
                    keys, times, count = _noted(keys, times, count, latest, hold, u, low, high, time_b, holds_b)
                u += 1
            hold -= 1
    return keys, times, count


@compiled
def _passed_second(found, time_a, holds_a, holds_b):  # type: ignore[no-untyped-def]
    """Which stretches of the first course lead by the hold points of the second, when, and how many rows those are."""
    keys, times, count = np.empty((16, 2), dtype=np.int64), np.empty((16, 2)), np.int64(0)
    latest = np.full((len(holds_b), 2), -1)
    for row in range(len(found)):
        i, inner = found[row, 0], _before(holds_a, found[row, 0])
        hold = _before(holds_b, found[row, 1] - 1) + 1
        while hold < len(holds_b) and holds_b[hold] <= found[row, 2]:
            first = inner
            while first > 0 and holds_a[first] == i:
                first -= 1
            for s in range(first, min(inner + 1, len(holds_a) - 1)):
                keys, times, count = _noted(keys, times, count, latest, hold, s, i, i, time_a, holds_a)
            hold += 1
    return keys, times, count
