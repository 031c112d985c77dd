"""Which stretches of two courses are in each other's way, and with what head start they are not."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
import numpy.typing as npt

from planner.yielding.courses import Course
from vehicle.meetings import meetings

SPARE_M = 0.3  # beyond the clearance: poses are looked at STEP_M apart
TOGETHER_S = 2.0  # head starts nearer to each other than this count as one span
Array = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]
Stretch = tuple[int, int]
"""(tractor, number of the stretch)."""


@dataclass
class Crossings:
    """What of the courses of a fleet cannot be driven at once.

    `apart[one][other]` are spans (from, to) in s: `one` must not begin later than `other` by a time within a span.
    `stands[tractor, hold][other]` tells when, since that stretch was begun, the first and the last part of it comes
    by who stands at a hold point (before the stretch of that number). `near[tractor]` are those it has to do with.
    """

    courses: list[Course]
    apart: dict[Stretch, dict[Stretch, list[tuple[float, float]]]] = field(default_factory=dict)
    stands: dict[Stretch, dict[Stretch, tuple[float, float]]] = field(default_factory=dict)
    blockers: dict[Stretch, dict[Stretch, tuple[float, float]]] = field(default_factory=dict)
    near: list[set[int]] = field(default_factory=list)


def crossings_of(
    courses: Sequence[Course], models: npt.NDArray[np.void], clearance_m: float, beside_m: float, gated: list[set[int]]
) -> Crossings:
    """All crossings; hold points from which nothing is crossed are given up, but for those before `gated` legs.

    `models` is as in vehicle.meetings, the clearances are those that the rules ask for.
    """
    pairs = list(combinations(range(len(courses)), 2))
    met = [meetings(courses[i].poses, courses[j].poses, models, clearance_m + SPARE_M, beside_m) for i, j in pairs]
    places: list[list[Array]] = [[] for _ in courses]
    for (i, j), found in zip(pairs, met, strict=True):
        places[i].append(found[:, 0])
        places[j].append(found[:, 1])
    kept = [_needed(*three) for three in zip(courses, places, gated, strict=True)]
    table = Crossings(kept, near=[set() for _ in kept])
    for (i, j), found in zip(pairs, met, strict=True):
        if len(found):
            table.near[i].add(j)
            table.near[j].add(i)
            _enter(table, i, j, found)
    for others in table.apart.values():
        for spans in others.values():
            spans.sort()
    return table


def _needed(course: Course, places: list[Array], gated: set[int]) -> Course:
    """The course without hold points before stretches that are in nobody's way."""
    used = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *places]))
    counts = np.searchsorted(used, np.asarray(course.holds[1:]), "right") - np.searchsorted(used, course.holds[:-1])
    idle = {n for n in range(1, course.stretches) if counts[n] == 0 and course.hold_legs[n] not in gated}
    return course.without(idle)


def _enter(table: Crossings, i: int, j: int, found: Array) -> None:
    """Write what two tractors have to do with each other into the table."""
    a, b = table.courses[i], table.courses[j]
    for at_a, at_b in ((0, 0), (0, 1), (1, 0), (1, 1)):
        rows, s, u = _within(a, b, found, at_a, at_b)
        if not len(rows):
            continue
        lo, hi = _head_starts(a, b, found[rows], s, u)
        for first, second, low, high in _merged(s, u, lo, hi):
            _add(table.apart, (i, first), (j, second), (low, high))
            _add(table.apart, (j, second), (i, first), (-high, -low))
    _stand(table, i, j, found)
    _stand(table, j, i, found[:, ::-1])


def _within(a: Course, b: Course, found: Array, at_a: int, at_b: int) -> tuple[Array, Array, Array]:
    """Rows of pairs with the stretches they lie in; a hold point lies at the end (1) of one and begins another (0)."""
    stretches, ok = [], np.ones(len(found), dtype=np.bool_)
    for course, column, end in ((a, found[:, 0], at_a), (b, found[:, 1], at_b)):
        holds = np.asarray(course.holds)
        stretch = np.searchsorted(holds, column, "left" if end else "right") - 1
        if end:
            ok &= holds[np.minimum(stretch + 1, len(holds) - 1)] == column
        ok &= (stretch >= 0) & (stretch < course.stretches)
        stretches.append(stretch)
    rows = np.flatnonzero(ok)
    return rows, stretches[0][rows], stretches[1][rows]


def _head_starts(a: Course, b: Course, found: Array, s: Array, u: Array) -> tuple[Floats, Floats]:
    """From and to how much later (s) a stretch must not be begun than another, for each pair of places."""
    spans = []
    for course, place, stretch in ((a, found[:, 0], s), (b, found[:, 1], u)):
        holds = np.asarray(course.holds)
        begin = course.time_s[holds[stretch]]
        until = np.minimum(np.minimum(place + 1, holds[stretch + 1]), len(course.time_s) - 1)
        spans.append((course.time_s[place] - begin, course.time_s[until] - begin))
    (a_from, a_to), (b_from, b_to) = spans
    return b_from - a_to, b_to - a_from


def _merged(s: Array, u: Array, lo: Floats, hi: Floats) -> list[tuple[int, int, float, float]]:
    """Spans of each pair of stretches, those that overlap or nearly do made one."""
    key = s * (int(u.max()) + 1) + u
    order = np.lexsort((lo, key))
    key, lo, hi = key[order], lo[order], hi[order]
    far = 1e7 * (np.cumsum(np.concatenate(([0], np.diff(key) != 0))))
    reach = np.maximum.accumulate(hi + far)
    starts = np.concatenate(([0], np.flatnonzero(lo[1:] + far[1:] > reach[:-1] + TOGETHER_S) + 1))
    ends = np.concatenate((starts[1:], [len(lo)])) - 1
    firsts, seconds = s[order][starts], u[order][starts]
    columns = (firsts.tolist(), seconds.tolist(), lo[starts].tolist(), (reach[ends] - far[ends]).tolist())
    return list(zip(*columns, strict=True))


def _add(
    table: dict[Stretch, dict[Stretch, list[tuple[float, float]]]], one: Stretch, other: Stretch,
    span: tuple[float, float],
) -> None:  # fmt: skip
    table.setdefault(one, {}).setdefault(other, []).append(span)


def _stand(table: Crossings, i: int, j: int, found: Array) -> None:
    """Note which stretches of j lead by the hold points of i."""
    holds = np.asarray(table.courses[i].holds)
    for hold in np.flatnonzero(np.isin(holds, found[:, 0])).tolist():
        if not table.courses[i].stands_at(hold):
            continue
        places = found[found[:, 0] == holds[hold], 1]
        b = table.courses[j]
        ends = np.asarray(b.holds)
        touched = np.concatenate([np.searchsorted(ends, places, side) - 1 for side in ("left", "right")])
        for u in sorted(set(touched.tolist()) & set(range(b.stretches))):
            inside = places[(places >= ends[u]) & (places <= ends[u + 1])]
            if len(inside):
                last = min(int(inside.max()) + 1, int(ends[u + 1]))
                times = float(b.time_s[inside.min()]) - b.begins_s(u), float(b.time_s[last]) - b.begins_s(u)
                table.stands.setdefault((i, hold), {})[j, u] = times
                table.blockers.setdefault((j, u), {})[i, hold] = times
