"""Which stretches of two courses are in each other's way, and with what head start they are not.

All of a fleet's stretches and hold points are numbered through: those of tractor `t` from `base[t]` on, its stretch `n`
and the hold point before it by the same number, the end of all last.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import numpy.typing as npt

from planner.yielding.courses import Course, Known
from planner.yielding.spans import Encounters, mark_used, meet
from vehicle.meetings import meetings

SPARE_M = 0.3  # beyond the clearance: poses are looked at STEP_M apart
TOGETHER_S = 2.0  # head starts nearer to each other than this count as one span
Array = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Table:
    """What each of the numbered places has to do with others: rows as in a sparse matrix.

    Of place `p` these are `start[p]` up to `start[p + 1]`, in the order of the other places in `at` (k,); `span_s`
    (k, 2) are times in s.
    """

    start: Array
    at: Array
    span_s: Floats

    @classmethod
    def of(cls, rows: Array, at: Array, span_s: Floats, places: int) -> Table:
        """From rows in any order."""
        order = np.lexsort((span_s[:, 1], span_s[:, 0], at, rows))
        start = np.concatenate(([0], np.cumsum(np.bincount(rows, minlength=places))))
        return cls(start.astype(np.int64), at[order].astype(np.int64), np.ascontiguousarray(span_s[order]))


@dataclass(frozen=True, eq=False)
class Crossings:
    """What of the courses of a fleet cannot be driven at once.

    `base` (n + 1,) as above, `begins_s` when each stretch begins and each course ends. In `apart` a stretch has spans
    (from, to) beside others: it must not begin later than the other by a time within a span. In `stands` a hold point
    has the stretches that lead by it, with when, since that stretch was begun, its first and last part comes by;
    `blockers` is the same by stretches. `near` (n, n) tells who has to do with whom.
    """

    courses: list[Course]
    base: Array
    begins_s: Floats
    apart: Table
    stands: Table
    blockers: Table
    near: npt.NDArray[np.bool_]


def crossings_of(
    courses: Sequence[Course],
    models: npt.NDArray[np.void],
    clearance_m: float,
    beside_m: float,
    gated: list[set[int]],
    known: Known | None = None,
) -> Crossings:
    """All crossings; hold points from which nothing is crossed are given up, but for those before `gated` legs.

    `models` is as in vehicle.meetings, the clearances are those that the rules ask for; `known` is of the same ones.
    """
    known = known or Known()
    met: dict[tuple[int, int], Array] = {}
    for i, j in combinations(range(len(courses)), 2):
        pair = courses[i], courses[j]
        if pair not in known.met:
            known.met[pair] = meetings(pair[0].trail, pair[1].trail, models, clearance_m + SPARE_M, beside_m)
        if len(known.met[pair]):
            met[i, j] = known.met[pair]
    used = [np.zeros(len(course.poses), dtype=np.bool_) for course in courses]
    for (i, j), found in met.items():
        mark_used(found, used[i], used[j])
    return _tables([_needed(*three) for three in zip(courses, used, gated, strict=True)], met)


def unhindered(courses: Sequence[Course]) -> Crossings:
    """The courses as if nobody were in anybody's way."""
    return _tables(list(courses), {})


def _needed(course: Course, used: npt.NDArray[np.bool_], gated: set[int]) -> Course:
    """The course without hold points before stretches that are in nobody's way."""
    counts = np.add.reduceat(np.append(used, False), np.asarray(course.holds), dtype=np.int64)
    ends = used[np.asarray(course.holds[1:])]
    idle = {
        n for n in range(1, course.stretches)
        if counts[n] == 0 and not ends[n] and course.hold_legs[n] not in gated
    }  # fmt: skip
    return course.without(idle)


def _tables(courses: list[Course], met: dict[tuple[int, int], Array]) -> Crossings:
    """What is written of all meetings, sorted."""
    holds = [np.asarray(course.holds, dtype=np.int64) for course in courses]
    base = np.concatenate(([0], np.cumsum([len(each) for each in holds]))).astype(np.int64)
    near = np.zeros((len(courses), len(courses)), dtype=np.bool_)
    met_all = Encounters()
    for (i, j), found in met.items():
        near[i, j] = near[j, i] = True
        a, b = courses[i], courses[j]
        met_all.add(meet(found, a.time_s, b.time_s, holds[i], holds[j]), int(base[i]), int(base[j]))
    places = int(base[-1])
    one, other, span_s = met_all.apart(TOGETHER_S)
    hold, stretch, passing_s = met_all.stands()
    there = np.array([course.stands_at(n) for course in courses for n in range(course.stretches + 1)], dtype=np.bool_)
    hold, stretch, passing_s = hold[there[hold]], stretch[there[hold]], passing_s[there[hold]]
    return Crossings(
        courses, base, np.concatenate([course.time_s[own] for course, own in zip(courses, holds, strict=True)]),
        Table.of(
            np.concatenate([one, other]), np.concatenate([other, one]), np.concatenate([span_s, -span_s[:, ::-1]]),
            places,
        ),
        Table.of(hold, stretch, passing_s, places),
        Table.of(stretch, hold, passing_s, places),
        near,
    )  # fmt: skip
