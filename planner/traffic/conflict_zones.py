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

import numpy as np

from fields.arrays import Flags, Floats, Integers
from planner.traffic.deadlock_search import find_first_place_row
from planner.traffic.trajectories import SoloTrajectory, TrajectoryCache
from vehicle.copying import copy_row
from vehicle.jit import compile_function
from vehicle.sim.path_conflicts import ClearanceCheck

MERGE_GAP_S = 2.0  # spans of head starts nearer than this are merged
PLACE_KINDS = 4  # a place inside a segment or at its end, on either trajectory
NO_ENCOUNTERS = np.zeros((0, 3), np.int64), np.zeros((0, 2)), np.zeros((0, 2), np.int64), np.zeros((0, 2))


def find_encounters(
    meeting_rows: Integers, times: tuple[Floats, Floats], holds: tuple[Integers, Integers], bases: tuple[int, int]
) -> tuple[Integers, Floats, Integers, Floats]:
    """How two trajectories interact where they meet, rows as from vehicle.sim.path_conflicts.

    Rows (segment, other segment, kind) with time spans; then rows (hold point, segment of the other) with the first and
    last time it passes since that segment began. `bases` are the numbers at which their places begin.
    """
    (time_a, time_b), (holds_a, holds_b), (base_a, base_b) = times, holds, bases
    place, first, last = meeting_rows.T
    apart, apart_s, count = _find_head_start_spans(meeting_rows, time_a, time_b, holds_a, holds_b)
    by_a, by_a_s = _find_passings(_list_visits(holds_a, place, place, first, last), len(holds_a), time_b, holds_b)
    by_b, by_b_s = _find_passings(_list_visits(holds_b, first, last, place, place), len(holds_b), time_a, holds_a)
    stands = np.concatenate([by_a + np.array([base_a, base_b]), by_b + np.array([base_b, base_a])])
    return apart[:count] + np.array([base_a, base_b, 0]), apart_s[:count], stands, np.concatenate([by_a_s, by_b_s])


def _list_visits(holds: Integers, low: Integers, high: Integers, first: Integers, last: Integers) -> Integers:
    """Rows (hold point, first and last place of another trajectory there) for all hold points from `low` to `high`."""
    begins = np.searchsorted(holds, low)
    counts = np.searchsorted(holds, high, side="right") - begins
    rows = np.repeat(np.arange(len(low)), counts)
    numbers = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.column_stack([begins[rows] + numbers, first[rows], last[rows]])


def _merge_exclusions(keys: Integers, spans: Floats) -> tuple[Integers, Integers, Floats]:
    """Segments, other segments and time spans between them; spans nearer than MERGE_GAP_S are merged."""
    order = np.lexsort((spans[:, 0], keys[:, 2], keys[:, 1], keys[:, 0]))
    keys, spans = np.ascontiguousarray(keys[order]), np.ascontiguousarray(spans[order])
    count = _merge_spans(keys, spans, MERGE_GAP_S)
    return keys[:count, 0], keys[:count, 1], spans[:count]


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
def _find_passings(visits, hold_count, time, holds):  # type: ignore[no-untyped-def]
    """Rows (hold point, segment that passes it) and when, from `_list_visits` along a trajectory with `holds`."""
    keys, times, count = np.empty((16, 2), dtype=np.int64), np.empty((16, 2)), np.int64(0)
    latest = np.full((hold_count, 2), -1)
    for row in range(len(visits)):
        hold, first, last = visits[row, 0], visits[row, 1], visits[row, 2]
        segment = max(0, _find_hold_point_before(holds, first - 1))
        while segment < len(holds) - 1 and holds[segment] <= last:
            low, high = max(first, holds[segment]), min(last, holds[segment + 1])
            if low <= high:
                keys, times, count = _add_passing_rows(
                    keys, times, count, latest, hold, segment, low, high, time, holds
                )
            segment += 1
    return keys[:count], times[:count]


@dataclass(frozen=True, eq=False)
class ConflictTable:
    """How each of the numbered places interacts with others: rows as in a sparse matrix.

    Rows `start[p]` up to `start[p + 1]` belong to place `p`, in the order of the other places in `at` (k,); `span_s`
    (k, 2) are times in s.
    """

    start: Integers
    at: Integers
    span_s: Floats

    @classmethod
    def from_rows(cls, rows: Integers, at: Integers, span_s: Floats, places: int) -> ConflictTable:
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
    base: Integers
    begins_s: Floats
    apart: ConflictTable
    stands: ConflictTable
    blockers: ConflictTable
    interacts: Flags


def find_conflict_zones(
    trajectories: Sequence[SoloTrajectory],
    check: ClearanceCheck,
    gated: list[set[int]],
    cache: TrajectoryCache | None = None,
) -> ConflictZones:
    """All conflict zones; hold points before segments without conflicts are dropped, except before `gated` legs.

    `cache` may hold results for checks that differ only in the clearance beside each other.
    """
    cache = cache or TrajectoryCache()
    pair_meetings: dict[tuple[int, int], Integers] = {}
    for i, j in combinations(range(len(trajectories)), 2):
        a, b = trajectories[i], trajectories[j]
        key = a, b, check.beside_clearance_m
        if key not in cache.meetings:
            find = check.find_meetings if a.is_on_field_at(0) and b.is_on_field_at(0) else check.find_blocked_parts
            cache.meetings[key] = find(a.trail, b.trail)
        if len(cache.meetings[key]):
            pair_meetings[i, j] = cache.meetings[key]
    used_poses = [np.zeros(len(trajectory.poses), dtype=np.bool_) for trajectory in trajectories]
    for (i, j), meeting_rows in pair_meetings.items():
        mark_conflicting_poses(meeting_rows, used_poses[i], used_poses[j])
    return _build_zones(
        [_drop_idle_holds(*trajectory_parts) for trajectory_parts in zip(trajectories, used_poses, gated, strict=True)],
        pair_meetings,
    )


def _drop_idle_holds(trajectory: SoloTrajectory, used: Flags, gated: set[int]) -> SoloTrajectory:
    """The trajectory without hold points before segments that are in nobody's way."""
    counts = np.add.reduceat(np.append(used, False), np.asarray(trajectory.holds), dtype=np.int64)
    ends = used[np.asarray(trajectory.holds[1:])]
    idle = {
        n
        for n in range(1, trajectory.segment_count)
        if counts[n] == 0 and not ends[n] and trajectory.hold_legs[n] not in gated
    }
    return trajectory.drop_holds(idle)


def _build_zones(trajectories: list[SoloTrajectory], pair_meetings: dict[tuple[int, int], Integers]) -> ConflictZones:
    """The conflict zones of all meetings."""
    holds = [np.asarray(trajectory.holds, dtype=np.int64) for trajectory in trajectories]
    base = np.concatenate(([0], np.cumsum([len(own_holds) for own_holds in holds]))).astype(np.int64)
    interacts = np.zeros((len(trajectories), len(trajectories)), dtype=np.bool_)
    found = [NO_ENCOUNTERS]
    for (i, j), meeting_rows in pair_meetings.items():
        interacts[i, j] = interacts[j, i] = True
        times = trajectories[i].time_s, trajectories[j].time_s
        found.append(find_encounters(meeting_rows, times, (holds[i], holds[j]), (int(base[i]), int(base[j]))))
    apart, apart_s, stands, passing_s = map(np.concatenate, zip(*found, strict=True))
    segment, other_segment, span_s = _merge_exclusions(apart, apart_s)
    is_on_field = [one.is_on_field_at(hold) for one in trajectories for hold in range(one.segment_count + 1)]
    is_standing = np.array(is_on_field, dtype=np.bool_)[stands[:, 0]]
    (hold, passing_segment), passing_s, places = stands[is_standing].T, passing_s[is_standing], int(base[-1])
    return ConflictZones(
        trajectories,
        base,
        np.concatenate([one.time_s[own_holds] for one, own_holds in zip(trajectories, holds, strict=True)]),
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
