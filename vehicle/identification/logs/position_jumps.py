"""Positions that jump once and stay displaced: another base station, or a receiver that converges anew.

Replays compare positions with each other inside a segment, so what follows a jump is as good as what was before: it is
moved back, and the rows about the jump are left out, which ends the segment there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.logs.column_faults import POSITION_FROZEN, ColumnFault, find_scattered_groups
from vehicle.identification.logs.gating import find_decreasing_entries
from vehicle.identification.logs.raw_motion import build_raw_motion
from vehicle.identification.logs.schema import GAP_SAMPLES, Array, LogFault, Rows
from vehicle.identification.logs.table import Columns

POSITION_JUMP = "position_jump"
_MOST_JUMP_S = 1.0  # chosen: a receiver that takes longer scatters, or drifts
_MOST_THAW_S = 2.0  # chosen: between the last position that is frozen and the first that is not
# Chosen: time before and after a jump that shows how the tractor moves, and its fewest positions.
_WINDOW_S, _FEWEST_SIDE = 1.0, 4
_LEAST_JUMP_M, _LEAST_NOISES = 0.5, 8.0  # chosen: smaller steps are those of clods and of a poor receiver


@dataclass(frozen=True, eq=False)
class _Jump:
    """A jump between two rows (indices of the log) by `size_m` (2,) to the east and the north."""

    last_before: int
    first_after: int
    size_m: Array


def correct_position_jumps(columns: Columns, name: str) -> tuple[Columns, list[ColumnFault]]:
    """Return the columns (units of the contract) with positions after each jump moved back, and the jumps as faults of
    the log `name`."""
    time, east, north = columns["time_s"], columns["easting_m"], columns["northing_m"]
    rows = np.flatnonzero(np.isfinite(time) & np.isfinite(east) & np.isfinite(north))
    rows = rows[~find_decreasing_entries(time[rows])]
    if len(rows) < 2 * _FEWEST_SIDE or not 0.0 < float(np.median(np.diff(time[rows]))) <= _WINDOW_S:
        return columns, []
    jumps = _find_jumps(columns, rows)
    if not jumps:
        return columns, []
    moved, faults = dict(columns), []
    for jump in jumps:
        for axis, size_m in zip(("easting_m", "northing_m"), jump.size_m, strict=True):
            values = moved[axis].copy()
            values[jump.first_after :] -= size_m
            moved[axis] = values
        fault = LogFault(POSITION_JUMP, name, float(time[jump.first_after]), None, _describe_jump(jump.size_m))
        faults.append(ColumnFault(fault, _choose_rows(jump, len(time))))
    return moved, faults


def join_thaws(jumps: Sequence[ColumnFault], faults: Sequence[ColumnFault]) -> list[ColumnFault]:
    """Return jumps and other faults; a jump at the end of frozen positions belongs to these."""
    left, joined = list(jumps), list[ColumnFault]()
    for one in faults:
        is_frozen, to_s = one.fault.id == POSITION_FROZEN, one.fault.to_s
        thaws = [
            jump for jump in left if is_frozen and to_s is not None and abs(jump.fault.from_s - to_s) < _MOST_THAW_S
        ]
        left = [jump for jump in left if jump not in thaws]
        joined.append(replace(one, rows=np.unique(np.concatenate([one.rows, *(jump.rows for jump in thaws)]))))
    return [*left, *joined]


def _choose_rows(jump: _Jump, count: int) -> Rows:
    """Return the rows about a jump whose absence is a gap between segments."""
    missing = math.ceil(GAP_SAMPLES) + 1 - (jump.first_after - jump.last_before - 1)
    side = max(math.ceil(0.5 * missing), 1)
    return np.arange(max(jump.last_before - side + 1, 0), min(jump.first_after + side, count))


def _find_jumps(columns: Columns, rows: Rows) -> list[_Jump]:
    motion = build_raw_motion(columns, rows)
    fresh = motion.find_fresh_positions()
    time, place = motion.time_s[fresh], motion.positions[:, fresh]
    jumps = []
    for group in find_scattered_groups(motion):
        first, last = (int(np.searchsorted(fresh, row)) for row in (group[0], group[-1]))
        if time[last] - time[first] > _MOST_JUMP_S:
            continue
        # Rows on both sides of a step are far from the middle of their neighbours: the step is between them.
        jump = _measure_jump(time, place, first, last)
        if jump is not None:
            jumps.append(_Jump(int(rows[fresh[first]]), int(rows[fresh[last]]), jump))
    return jumps


def _measure_jump(time: Array, place: Array, first: int, last: int) -> Array | None:
    """Return by how much (2, m) positions are displaced from row `last` on, against rows up to `first`.

    Straight lines through both sides meet in the middle of the step: what bends them is the same on both sides.
    """
    middle_s = 0.5 * (time[first] + time[last])
    ends, noises = [], []
    for side in (
        (time <= time[first]) & (time > time[first] - _WINDOW_S),
        (time >= time[last]) & (time < time[last] + _WINDOW_S),
    ):
        if np.count_nonzero(side) < _FEWEST_SIDE:
            return None
        line = np.stack([np.ones(np.count_nonzero(side)), time[side] - middle_s], axis=1)
        theta = np.linalg.lstsq(line, place[:, side].T, rcond=None)[0]
        noises.append(float(np.median(np.abs(place[:, side].T - line @ theta))))
        ends.append(theta[0])
    size_m: Array = ends[1] - ends[0]
    least = max(_LEAST_JUMP_M, _LEAST_NOISES * 1.4826 * max(noises))
    return size_m if float(np.hypot(*size_m)) > least else None


def _describe_jump(size_m: Array) -> str:
    points = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
    towards = points[round(math.atan2(size_m[0], size_m[1]) / (0.25 * math.pi)) % 8]
    return (
        f"the positions jump by {math.hypot(*size_m):.1f} m to the {towards} and stay there: the receiver converged "
        "anew, or its base station changed"
    )
