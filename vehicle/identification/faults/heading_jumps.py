"""Headings that jump once and stay off, of an instrument that was reset or turned on its mount, are turned back.

No tractor turns so far between two rows, and the course over ground shows that it did not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vehicle.identification.faults.steering_evidence import COURSE_TURN_S, STEP_S, build_run_evidence, shift
from vehicle.identification.logs.directions import FLIP_DEG
from vehicle.identification.logs.schema import Array, Log, LogFault, list_gap_rows
from vehicle.identification.logs.series import measure_spread, wrap_degrees
from vehicle.identification.logs.thresholds import (
    CLEARLY_APART_DEG,
    FEWEST_TIMES,
    MAJORITY,
    MOMENT_S,
    PART_S,
    STEADY_SHARE,
    WINDOW_S,
)

HEADING_JUMP = "heading_jump"
_MOST_DEG = 180.0 - FLIP_DEG  # more is a heading that points backwards, less than CLEARLY_APART_DEG is its noise
_LEAST_NOISES = 12.0  # chosen, of the scatter of a heading from row to row
# Chosen: how near to the level of its side a heading must be (deg, share of the jump), and how far the jumps by heading
# and by course may differ.
_NEAR_DEG, _NEAR_SHARE = 1.5, 0.3


def correct_heading_jumps(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with headings beside a jump turned back, the jump in `faults`, and no rows about it.

    A heading that often leaps is noise, or of another fault.
    """
    corrected = []
    for log in logs:
        jumps = _list_candidates(log)
        levels = _measure_levels(log, *jumps[0]) if len(jumps) == 1 else None
        corrected.append(log if levels is None else _turn_back(log, *jumps[0][:2], *levels))
    return corrected


def _list_candidates(log: Log) -> list[tuple[int, int, float]]:
    """Return the rows on both sides of the steps of the heading that no tractor turns, and by how much (deg)."""
    measured = log.place_rows.get("heading")
    rows = np.flatnonzero(log.used if measured is None else log.used & measured)
    if log.heading_deg is None or len(rows) < 4 * FEWEST_TIMES:
        return []
    time, turn = log.time_s[rows], np.diff(np.unwrap(np.radians(log.heading_deg[rows])))
    step_s = np.diff(time)
    rate = np.degrees(turn) / np.maximum(step_s, 1e-6)
    changes = np.abs(np.diff(np.degrees(turn)))
    least = max(CLEARLY_APART_DEG, _LEAST_NOISES * float(np.median(changes)))
    jumps = []
    for row in np.flatnonzero((np.abs(np.degrees(turn)) > 0.5 * least) & (step_s <= MOMENT_S)):
        before = np.flatnonzero((time[1:] <= time[row]) & (time[:-1] >= time[row] - MOMENT_S))
        after = np.flatnonzero((time[:-1] >= time[row + 1]) & (time[1:] <= time[row + 1] + MOMENT_S))
        if min(len(before), len(after)) < FEWEST_TIMES:
            continue
        # What it turned about a step is between the rates of both sides.
        near = np.median(rate[before]), np.median(rate[after])
        most = [float(np.max(np.abs(rate[side] * step_s[row]))) for side in (before, after)]
        size_deg = math.degrees(turn[row]) - 0.5 * float(near[0] + near[1]) * float(step_s[row])
        if least + max(most) < abs(size_deg) < _MOST_DEG:
            jumps.append((int(rows[row]), int(rows[row + 1]), size_deg))
    return jumps


def _measure_levels(log: Log, last_before: int, first_after: int, size_deg: float) -> tuple[float, float] | None:
    """Return heading minus course (deg) before and after a jump; None where it does not step by as much, and stay."""
    error, time = _collect_errors(log)
    after = time >= log.time_s[first_after]
    levels = []
    for side in (~after & (time <= log.time_s[last_before]), after):
        if np.count_nonzero(side) * STEP_S < WINDOW_S:
            return None
        level = float(np.median(error[side]))
        if not _is_flat(time[side], error[side] - level, abs(size_deg)):
            return None
        levels.append(level)
    apart = levels[1] - levels[0]
    alike = max(_NEAR_DEG, _NEAR_SHARE * abs(size_deg))
    return (levels[0], levels[1]) if abs(apart - size_deg) < alike else None


def _is_flat(time: Array, error: Array, size_deg: float) -> bool:
    """Whether headings of a side (k, deg about their level) stay at it, in each part of the time."""
    near = np.abs(error) < _NEAR_SHARE * size_deg + _NEAR_DEG
    if float(np.mean(near)) < STEADY_SHARE:
        return False
    parts = ((time - time[0]) // (2.0 * WINDOW_S)).astype(np.int64)
    levels = [
        float(np.median(error[parts == part])) for part in np.unique(parts) if np.sum(parts == part) > PART_S / STEP_S
    ]
    return len(levels) == 0 or float(np.max(np.abs(levels))) < 2.0 * _NEAR_SHARE * size_deg


def _collect_errors(log: Log) -> tuple[Array, Array]:
    """Return heading minus course (k, deg) of a log and its times, without what the antenna swings in bends."""
    run, half = build_run_evidence(log, math.inf), round(0.5 * COURSE_TURN_S / STEP_S)
    if run is None or run.heading is None:
        return np.empty(0), np.empty(0)
    known = np.isfinite(run.bends[1])
    course = np.arctan2(*(np.sign(run.gear) * (shift(run.place, half) - shift(run.place, -half))))
    error = wrap_degrees(np.degrees(run.heading - course)[known])
    time, curvature = run.time_s[known], run.bends[1][known]
    columns = np.stack([curvature, np.abs(curvature)], axis=1)
    # The changes from bend to bend, not the level that jumps, say how far an antenna swings.
    lag = round(3.0 / STEP_S)
    if len(error) > 3 * lag:
        turned, apart = columns[lag:] - columns[:-lag], error[lag:] - error[:-lag]
        small = np.abs(apart) < max(4.0 * measure_spread(apart), 3.0)
        if np.count_nonzero(small) > lag:
            error = error - columns @ np.linalg.lstsq(turned[small], apart[small], rcond=None)[0]
    return error, time


def _turn_back(log: Log, last_before: int, first_after: int, before_deg: float, after_deg: float) -> Log:
    """Return a log whose headings on the side that is further from the course are turned back by the jump."""
    assert log.heading_deg is not None
    size_deg = after_deg - before_deg
    is_before_wrong = abs(before_deg) - abs(after_deg) > MAJORITY * abs(size_deg)
    heading = log.heading_deg.copy()
    if is_before_wrong:
        heading[: last_before + 1] += size_deg
    else:
        heading[first_after:] -= size_deg
    words = (
        f"heading_deg jumps by {abs(size_deg):.1f} deg to the {'right' if size_deg > 0.0 else 'left'} and stays there "
        "while the course goes on: the instrument was reset, or moved on its mount"
    )
    fault = LogFault(HEADING_JUMP, log.name, float(log.time_s[first_after]), None, words)
    faults, rows = (*log.faults, fault), list_gap_rows(last_before, first_after, len(log.time_s))
    return log.exclude_rows(
        f"heading jump: {words}", np.isin(np.arange(len(log.time_s)), rows), heading_deg=heading % 360.0, faults=faults
    )
