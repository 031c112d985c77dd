"""Which segments of two trajectories are in each other's way, and with what head start they are not.

All segments and hold points of a fleet are numbered through: those of tractor `t` from `base[t]` on, its segment `n`
and the hold point before it by the same number, the end of the trajectory last. Head starts are collected in compiled
code in the order of the first trajectory's poses: a span that overlaps the last one of the same two segments only
extends it, so few are left to be sorted.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
import numpy.typing as npt

from planner.traffic.deadlock_search import find_first_place_row
from planner.traffic.trajectories import SoloTrajectory, TrajectoryCache
from vehicle.copying import copy_row
from vehicle.jit import compile_function
from vehicle.sim.path_conflicts import find_conflicting_poses

AnyArray = npt.NDArray[Any]
PLACE_KINDS = 4  # a place inside a segment or at its end, on either trajectory


class ConflictCollector:
    """The encounters of pairs of trajectories, collected for a whole fleet."""

    def __init__(self) -> None:
        """Start empty."""
        self._apart: list[AnyArray] = [np.zeros((0, 3), dtype=np.int64)]
        self._apart_s: list[AnyArray] = [np.zeros((0, 2))]
        self._stands: list[AnyArray] = [np.zeros((0, 2), dtype=np.int64)]
        self._stands_s: list[AnyArray] = [np.zeros((0, 2))]

    def add(
        self, encounters: tuple[AnyArray, AnyArray, AnyArray, AnyArray, AnyArray, AnyArray], base_a: int, base_b: int
    ) -> None:
        """Add what `find_encounters` found for two trajectories, given the numbers at which their places begin."""
        apart, apart_s, by_a, by_a_s, by_b, by_b_s = encounters
        self._apart.append(apart + np.array([base_a, base_b, 0]))
        self._stands += [by_a + np.array([base_a, base_b]), by_b + np.array([base_b, base_a])]
        self._apart_s.append(apart_s)
        self._stands_s += [by_a_s, by_b_s]

    def merge_exclusions(self, together_s: float) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Segments, other segments and time spans between them; spans nearer than `together_s` are merged."""
        keys, spans = np.concatenate(self._apart), np.concatenate(self._apart_s)
        order = np.lexsort((spans[:, 0], keys[:, 2], keys[:, 1], keys[:, 0]))
        keys, spans = np.ascontiguousarray(keys[order]), np.ascontiguousarray(spans[order])
        count = _merge_spans(keys, spans, together_s)
        return keys[:count, 0], keys[:count, 1], spans[:count]

    def list_passings(self) -> tuple[AnyArray, AnyArray, AnyArray]:
        """Hold points, segments that pass them, and when."""
        keys = np.concatenate(self._stands)
        return keys[:, 0], keys[:, 1], np.concatenate(self._stands_s)


def find_encounters(
    meeting_rows: AnyArray, time_a: AnyArray, time_b: AnyArray, holds_a: AnyArray, holds_b: AnyArray
) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray, AnyArray, AnyArray]:
    """How two trajectories interact where they meet, rows as from vehicle.sim.path_conflicts.

    Rows (segment, other segment, kind) with time spans; then, for hold points of the first and of the second
    trajectory, rows (hold point, other's segment) with the first and last time it passes since that segment began.
    """
    apart, apart_s, count = _find_head_start_spans(meeting_rows, time_a, time_b, holds_a, holds_b)
    by_a, by_a_s, standing_a = _find_passings_of_first(meeting_rows, time_b, holds_a, holds_b)
    by_b, by_b_s, standing_b = _find_passings_of_second(meeting_rows, time_a, holds_a, holds_b)
    return (
        apart[:count],
        apart_s[:count],
        by_a[:standing_a],
        by_a_s[:standing_a],
        by_b[:standing_b],
        by_b_s[:standing_b],
    )


@compile_function
def mark_conflicting_poses(meeting_rows, used_a, used_b) -> None:  # type: ignore[no-untyped-def]
    """Mark the poses of two trajectories that are in the other's way."""
    for row in range(len(meeting_rows)):
        used_a[meeting_rows[row, 0]] = True
        for place in range(meeting_rows[row, 1], meeting_rows[row, 2] + 1):
            used_b[place] = True


@compile_function
def _find_hold_point_before(holds, place):  # type: ignore[no-untyped-def]
    """Number of the last hold point that is not after a place."""
    return find_first_place_row(holds, np.int64(0), len(holds), place + 1) - 1


@compile_function
def _double_row_capacity(keys, spans):  # type: ignore[no-untyped-def]
    """The same rows with twice the room."""
    grown_keys, grown_spans = np.empty((2 * len(keys), keys.shape[1]), dtype=np.int64), np.empty((2 * len(keys), 2))
    for row in range(len(keys)):
        copy_row(keys[row], grown_keys[row])
        copy_row(spans[row], grown_spans[row])
    return grown_keys, grown_spans


@compile_function
def _add_span_row(keys, spans, count, latest, s, u, kind, since, until):  # type: ignore[no-untyped-def]
    """The rows with one more span of two segments; one that overlaps the last of these only widens it."""
    latest_row = latest[kind, u]
    if latest_row >= 0 and keys[latest_row, 0] == s and since <= spans[latest_row, 1] and until >= spans[latest_row, 0]:
        spans[latest_row, 0] = min(spans[latest_row, 0], since)
        spans[latest_row, 1] = max(spans[latest_row, 1], until)
        return keys, spans, count
    if count == len(keys):
        keys, spans = _double_row_capacity(keys, spans)
    keys[count, 0], keys[count, 1], keys[count, 2] = s, u, kind
    spans[count, 0], spans[count, 1] = since, until
    latest[kind, u] = count
    return keys, spans, count + 1


@compile_function
def _find_head_start_spans(meeting_rows, time_a, time_b, holds_a, holds_b):  # type: ignore[no-untyped-def]
    """Rows of two segments and a kind, spans of head starts between them, and the number of rows.

    A place lies in the segment that it begins or is inside, and a hold point also at the end of the one before.
    """
    keys, spans, count = np.empty((64, 3), dtype=np.int64), np.empty((64, 2)), np.int64(0)
    latest = np.full((PLACE_KINDS, len(holds_b)), -1)
    for row in range(len(meeting_rows)):
        i, first, last = meeting_rows[row, 0], meeting_rows[row, 1], meeting_rows[row, 2]
        s = inner = _find_hold_point_before(holds_a, i)
        while s >= 0 and (s == inner or holds_a[s + 1] == i):
            if s < len(holds_a) - 1:
                at_end = np.int64(0 if s == inner else 2)
                a_from = time_a[i] - time_a[holds_a[s]]
                a_to = time_a[min(i + 1, holds_a[s + 1])] - time_a[holds_a[s]]
                u = max(0, _find_hold_point_before(holds_b, first) - 1)
                while u < len(holds_b) - 1 and holds_b[u] <= last:
                    began, end = time_b[holds_b[u]], holds_b[u + 1]
                    low, high = max(first, holds_b[u]), min(last, end - 1)
                    if low <= high:
                        since, until = time_b[low] - began - a_to, time_b[high + 1] - began - a_from
                        keys, spans, count = _add_span_row(keys, spans, count, latest, s, u, at_end, since, until)
                    if first <= end <= last:
                        since, until = time_b[end] - began - a_to, time_b[end] - began - a_from
                        keys, spans, count = _add_span_row(keys, spans, count, latest, s, u, at_end + 1, since, until)
                    u += 1
            s -= 1
    return keys, spans, count


@compile_function
def _merge_spans(keys, spans, together):  # type: ignore[no-untyped-def]
    """Merge rows of the same key whose spans overlap or nearly do, in place; returns the number of rows left."""
    count = 0
    for row in range(len(keys)):
        same = count > 0
        for column in range(3):
            same = same and keys[row, column] == keys[count - 1, column]
        if same and spans[row, 0] <= spans[count - 1, 1] + together:
            spans[count - 1, 1] = max(spans[count - 1, 1], spans[row, 1])
            continue
        copy_row(keys[row], keys[count])
        copy_row(spans[row], spans[count])
        count += 1
    return count


@compile_function
def _add_passing_rows(keys, times, count, latest, hold, segment, first, last, time, holds):  # type: ignore[no-untyped-def]
    """The rows with places `first` to `last` of a segment, in order, that pass a hold point."""
    began = time[holds[segment]]
    until = time[min(last + 1, holds[segment + 1])] - began
    for k in range(2):
        latest_row = latest[hold, k]
        if latest_row >= 0 and keys[latest_row, 1] == segment:
            times[latest_row, 1] = until
            return keys, times, count
    if count == len(keys):
        keys, times = _double_row_capacity(keys, times)
    keys[count, 0], keys[count, 1] = hold, segment
    times[count, 0], times[count, 1] = time[first] - began, until
    latest[hold, 0], latest[hold, 1] = latest[hold, 1], count
    return keys, times, count + 1


@compile_function
def _find_passings_of_first(meeting_rows, time_b, holds_a, holds_b):  # type: ignore[no-untyped-def]
    """Which segments of the second trajectory pass the hold points of the first, when, and the number of rows."""
    keys, times, count = np.empty((16, 2), dtype=np.int64), np.empty((16, 2)), np.int64(0)
    latest = np.full((len(holds_a), 2), -1)
    for row in range(len(meeting_rows)):
        i, first, last = meeting_rows[row, 0], meeting_rows[row, 1], meeting_rows[row, 2]
        hold = _find_hold_point_before(holds_a, i)
        while hold >= 0 and holds_a[hold] == i:
            u = max(0, _find_hold_point_before(holds_b, first) - 1)
            while u < len(holds_b) - 1 and holds_b[u] <= last:
                low, high = max(first, holds_b[u]), min(last, holds_b[u + 1])
                if low <= high:
                    keys, times, count = _add_passing_rows(
                        keys, times, count, latest, hold, u, low, high, time_b, holds_b
                    )
                u += 1
            hold -= 1
    return keys, times, count


@compile_function
def _find_passings_of_second(meeting_rows, time_a, holds_a, holds_b):  # type: ignore[no-untyped-def]
    """Which segments of the first trajectory pass the hold points of the second, when, and the number of rows."""
    keys, times, count = np.empty((16, 2), dtype=np.int64), np.empty((16, 2)), np.int64(0)
    latest = np.full((len(holds_b), 2), -1)
    for row in range(len(meeting_rows)):
        i, inner = meeting_rows[row, 0], _find_hold_point_before(holds_a, meeting_rows[row, 0])
        hold = _find_hold_point_before(holds_b, meeting_rows[row, 1] - 1) + 1
        while hold < len(holds_b) and holds_b[hold] <= meeting_rows[row, 2]:
            first = inner
            while first > 0 and holds_a[first] == i:
                first -= 1
            for s in range(first, min(inner + 1, len(holds_a) - 1)):
                keys, times, count = _add_passing_rows(keys, times, count, latest, hold, s, i, i, time_a, holds_a)
            hold += 1
    return keys, times, count


EXTRA_CLEARANCE_M = 0.3  # added to the clearance, because poses are POSE_STEP_M apart
MERGE_GAP_S = 2.0  # spans of head starts nearer than this are merged
Ints = npt.NDArray[np.int64]
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ConflictTable:
    """How each of the numbered places interacts with others: rows as in a sparse matrix.

    Rows `start[p]` up to `start[p + 1]` belong to place `p`, in the order of the other places in `at` (k,); `span_s`
    (k, 2) are times in s.
    """

    start: Ints
    at: Ints
    span_s: Floats

    @classmethod
    def from_rows(cls, rows: Ints, at: Ints, span_s: Floats, places: int) -> ConflictTable:
        """From rows in any order."""
        order = np.lexsort((span_s[:, 1], span_s[:, 0], at, rows))
        start = np.concatenate(([0], np.cumsum(np.bincount(rows, minlength=places))))
        return cls(start.astype(np.int64), at[order].astype(np.int64), np.ascontiguousarray(span_s[order]))


@dataclass(frozen=True, eq=False)
class ConflictZones:
    """Which parts of the trajectories of a fleet cannot be driven at once.

    `base` (n + 1,) as in this module, `begins_s` when each segment begins and each trajectory ends. In `apart` a
    segment has spans (from, to) against others: it must not begin later than the other by a time within a span. In
    `stands` a hold point has the segments that pass it, with the first and last time after they were begun; `blockers`
    is the same by segments. `interacts` (n, n) tells which tractors have any of these.
    """

    trajectories: list[SoloTrajectory]
    base: Ints
    begins_s: Floats
    apart: ConflictTable
    stands: ConflictTable
    blockers: ConflictTable
    interacts: npt.NDArray[np.bool_]


def find_conflict_zones(
    trajectories: Sequence[SoloTrajectory],
    models: npt.NDArray[np.void],
    clearance_m: float,
    beside_m: float,
    gated: list[set[int]],
    cache: TrajectoryCache | None = None,
) -> ConflictZones:
    """All conflict zones; hold points before segments without conflicts are dropped, except before `gated` legs.

    `models` is as in vehicle.sim.path_conflicts, the clearances are those of the rules; `cache` must be for the same
    ones.
    """
    cache = cache or TrajectoryCache()
    pair_meetings: dict[tuple[int, int], Ints] = {}
    for i, j in combinations(range(len(trajectories)), 2):
        a, b = trajectories[i], trajectories[j]
        if (a, b, beside_m) not in cache.meetings:
            cache.meetings[a, b, beside_m] = find_conflicting_poses(
                a.trail, b.trail, models, clearance_m + EXTRA_CLEARANCE_M, beside_m
            )
        if len(cache.meetings[a, b, beside_m]):
            pair_meetings[i, j] = cache.meetings[a, b, beside_m]
    used_poses = [np.zeros(len(trajectory.poses), dtype=np.bool_) for trajectory in trajectories]
    for (i, j), meeting_rows in pair_meetings.items():
        mark_conflicting_poses(meeting_rows, used_poses[i], used_poses[j])
    return _build_zones(
        [_drop_idle_holds(*trajectory_parts) for trajectory_parts in zip(trajectories, used_poses, gated, strict=True)],
        pair_meetings,
    )


def _drop_idle_holds(trajectory: SoloTrajectory, used: npt.NDArray[np.bool_], gated: set[int]) -> SoloTrajectory:
    """The trajectory without hold points before segments that are in nobody's way."""
    counts = np.add.reduceat(np.append(used, False), np.asarray(trajectory.holds), dtype=np.int64)
    ends = used[np.asarray(trajectory.holds[1:])]
    idle = {
        n
        for n in range(1, trajectory.segment_count)
        if counts[n] == 0 and not ends[n] and trajectory.hold_legs[n] not in gated
    }
    return trajectory.drop_holds(idle)


def _build_zones(trajectories: list[SoloTrajectory], pair_meetings: dict[tuple[int, int], Ints]) -> ConflictZones:
    """The conflict zones of all meetings."""
    holds = [np.asarray(trajectory.holds, dtype=np.int64) for trajectory in trajectories]
    base = np.concatenate(([0], np.cumsum([len(own_holds) for own_holds in holds]))).astype(np.int64)
    interacts = np.zeros((len(trajectories), len(trajectories)), dtype=np.bool_)
    collector = ConflictCollector()
    for (i, j), meeting_rows in pair_meetings.items():
        interacts[i, j] = interacts[j, i] = True
        a, b = trajectories[i], trajectories[j]
        collector.add(find_encounters(meeting_rows, a.time_s, b.time_s, holds[i], holds[j]), int(base[i]), int(base[j]))
    places = int(base[-1])
    segment, other_segment, span_s = collector.merge_exclusions(MERGE_GAP_S)
    hold, passing_segment, passing_s = collector.list_passings()
    is_standing = np.array(
        [trajectory.is_on_field_at(n) for trajectory in trajectories for n in range(trajectory.segment_count + 1)],
        dtype=np.bool_,
    )
    hold, passing_segment, passing_s = (
        hold[is_standing[hold]],
        passing_segment[is_standing[hold]],
        passing_s[is_standing[hold]],
    )
    return ConflictZones(
        trajectories,
        base,
        np.concatenate(
            [
                trajectory.time_s[trajectory_holds]
                for trajectory, trajectory_holds in zip(trajectories, holds, strict=True)
            ]
        ),
        ConflictTable.from_rows(
            np.concatenate([segment, other_segment]),
            np.concatenate([other_segment, segment]),
            np.concatenate([span_s, -span_s[:, ::-1]]),
            places,
        ),
        ConflictTable.from_rows(hold, passing_segment, passing_s, places),
        ConflictTable.from_rows(passing_segment, hold, passing_s, places),
        interacts,
    )
