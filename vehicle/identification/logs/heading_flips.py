"""Headings that flip: they turn by half a circle from one row to the next, as of a receiver at a standstill.

No tractor turns so fast, and a wrong gear leaves the heading as it is. Between two flips the heading points backwards
in every row or in none, and the course over ground tells which, with the gear. Where it does not, nothing is left out.
"""

from __future__ import annotations

import numpy as np

from vehicle.identification.logs.gating import find_decreasing_entries
from vehicle.identification.logs.raw_motion import RawMotion, build_raw_motion
from vehicle.identification.logs.schema import Array, Mask, Rows, find_file_line
from vehicle.identification.logs.table import Columns

HEADING_FLIPPED = "heading flipped: heading_deg points backwards until it turns by 180 degrees between two rows"
_NEAR_DEG = 30.0  # chosen: noise of both rows and what a tractor turns between them
_LONGEST_FLIP_S = 2.0  # chosen: within a longer time a small vehicle may turn round
_HELD_S = 1.0  # chosen: a slower instrument holds its value no longer
_AGREEING_COSINE = 0.7  # between heading and direction of travel
_CLEAR_SHARE, _MOST_OPPOSITE_SHARE = 0.9, 0.5
_FEWEST_ROWS, _LEAST_CLEAR_S = 50, 5.0  # chosen: less driving may be one change of gear


def find_flipped_headings(columns: Columns) -> Rows:
    """Return the rows of the file whose heading points backwards between flips, where path and gear say so clearly."""
    if "heading_deg" not in columns:
        return np.empty(0, dtype=np.int64)
    rows = _select_rows(columns)
    if len(rows) < _FEWEST_ROWS:
        return rows[:0]
    time, heading = columns["time_s"][rows], columns["heading_deg"][rows]
    changes, between = find_flips(time, heading)
    if not len(changes):
        return rows[:0]
    is_second = np.cumsum(np.isin(np.arange(len(rows)), changes)) % 2 == 1
    gear = np.sign(columns["shuttle"][rows]) if "shuttle" in columns else np.ones(len(rows))
    flipped = _choose_flipped(build_raw_motion(columns, rows), heading, gear, is_second)
    if flipped is None:
        return rows[:0]
    flipped[between] = True
    return rows[flipped | _find_held_before(time, heading, changes)]


def describe_flips(time: Array, heading: Array, rows: Rows) -> str:
    """Return words on flips in these rows of a log, "" without any."""
    changes, _ = find_flips(time[rows], heading[rows])
    if not len(changes):
        return ""
    times = "once" if len(changes) == 1 else f"{len(changes)} times"
    return f"it turns by 180 degrees between two rows {times}, first in line {find_file_line(rows[changes])}"


def find_flips(time: Array, heading: Array) -> tuple[Rows, Rows]:
    """Return the first rows after flips of a heading (deg), and rows between the two sides of a flip."""
    changes: list[int] = []
    between: list[int] = []
    is_flip = [
        (np.abs(_wrap(heading[lag:] - heading[:-lag])) > 180.0 - _NEAR_DEG)
        & (time[lag:] - time[:-lag] <= _LONGEST_FLIP_S)
        for lag in (1, 2)
    ]
    near = np.abs(_wrap(np.diff(heading))) <= _NEAR_DEG
    for row in range(len(heading) - 1):
        if is_flip[0][row]:
            changes.append(row + 1)
        elif row < len(is_flip[1]) and is_flip[1][row] and not (near[row] or near[row + 1] or is_flip[0][row + 1]):
            changes.append(row + 2)
            between.append(row + 1)
    return np.array(changes, dtype=np.int64), np.array(between, dtype=np.int64)


def _select_rows(columns: Columns) -> Rows:
    known = [columns[name] for name in ("time_s", "easting_m", "northing_m", "heading_deg")]
    rows = np.flatnonzero(np.all(np.isfinite(known), axis=0))
    return rows[~find_decreasing_entries(columns["time_s"][rows])]


def _choose_flipped(motion: RawMotion, heading: Array, gear: Array, is_second: Mask) -> Mask | None:
    """Return which rows (k,) are flipped: those of one side of the flips, `is_second` or not; None where neither is
    clear, and where they are those in reverse, as of a course over ground."""
    clear = np.isfinite(motion.course) & (gear != 0.0)
    agreement = np.where(clear, np.cos(np.radians(heading) - motion.course) * gear, 0.0)
    for flipped in (is_second, ~is_second):
        if motion.count_rows(_LEAST_CLEAR_S) > np.count_nonzero(clear & ~flipped):
            continue
        if _is_clear(agreement[clear & ~flipped]) and _is_clear(-agreement[clear & flipped]):
            is_course = _is_all(flipped[clear & (gear < 0.0)]) and _is_all(~flipped[clear & (gear > 0.0)])
            return flipped if np.mean(flipped) <= _MOST_OPPOSITE_SHARE and not is_course else None
    return None


def _is_clear(agreement: Array) -> bool:
    return not len(agreement) or float(np.mean(agreement > _AGREEING_COSINE)) >= _CLEAR_SHARE


def _is_all(mask: Mask) -> bool:
    return len(mask) > 0 and float(np.mean(mask)) >= _CLEAR_SHARE


def _find_held_before(time: Array, heading: Array, changes: Rows) -> Mask:
    """Mark rows (k,) that hold the value before a flip: what lies between it and the next one is interpolated."""
    held = np.zeros(len(time), dtype=np.bool_)
    for change in changes:
        row = change - 1
        while row > 0 and heading[row - 1] == heading[row] and time[change] - time[row - 1] <= _HELD_S:
            held[row] = True
            row -= 1
    return held


def _wrap(angle_deg: Array) -> Array:
    return (angle_deg + 180.0) % 360.0 - 180.0
