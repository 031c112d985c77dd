"""The logs as they are replayed: copies merged, and what single columns show of their own faults corrected.

Where an instrument is slower than the log, a logger repeats the last value between measurements, or a converter draws a
straight line to the next one. Both carry nothing new: a measured column is interpolated between its knots and counts
there alone. A repeated command may be what the controller really held; it counts as stale only where the wheels move
before it does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.signal import lfilter

from fields.arrays import Floats, Integers
from vehicle.identification.diagnosis.onsets import mark_onset_faults
from vehicle.identification.diagnosis.other_vehicles import drop_course_headings
from vehicle.identification.faults.level_steps import correct_heading_jumps, mark_level_step
from vehicle.identification.logs.column_quality import (
    drop_columns_coarse_elsewhere,
    drop_commands_not_logged,
    merge_copies,
)
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.sensor_checks import correct_sensors_like_others, drop_commands_not_driven
from vehicle.identification.logs.series import find_changes, find_new_rows, interpolate_between
from vehicle.identification.logs.thresholds import FEWEST_EVENTS, HOLDS, MAJORITY, MOST_SHARE, STANDING_FACTOR
from vehicle.model.tractor import Tractor

_STRAIGHT_SHARE, _SLOPE_TOLERANCE = 0.6, 1e-6  # chosen, of the rows that move; and of the median slope, by rounding
_LAGS_S = np.arange(0.0, 1.6, 0.1)
_FILTERS_S = (0.0, 0.15, 0.3, 0.6, 1.0)
MEASURED_COLUMNS = ("steering_deg", "speed_mps")
PLACE_COLUMNS = ("easting_m", "northing_m", "heading_deg")


def correct_logs(logs: Sequence[Log], tractor: Tractor) -> list[Log]:
    """Return the logs as they are replayed: each drive once, without coarse columns, courses for headings, commanded
    speeds that were not driven and rows of faults that begin, with sensors corrected."""
    logs = drop_commands_not_logged(drop_columns_coarse_elsewhere(merge_copies(logs)))
    # Steps of a level go first: wheels that stand elsewhere than they say look as if they did not follow.
    logs = mark_onset_faults(mark_level_step(correct_heading_jumps(drop_course_headings(logs, tractor))))
    return mark_stale_columns_of_set(drop_commands_not_driven(correct_sensors_like_others(logs)))


def mark_stale_columns(log: Log, moving: frozenset[str] = frozenset()) -> Log:
    """Return the log with slower columns interpolated between their measured rows, which `measured_rows` marks.

    Columns of `moving` change from row to row in other logs of the set, so that none of them is held.
    """
    rows = np.flatnonzero(log.used)
    if len(rows) < 2 * FEWEST_EVENTS:
        return log
    time, command = log.time_s[rows], log.steering_command_deg
    for name in MEASURED_COLUMNS:
        values = getattr(log, name)
        find = find_line_knots if name in moving else find_knots
        knots = None if values is None else find(time, values[rows])
        if knots is not None:
            log = _mark_knots(log, name, rows, knots)
    knots = None if command is None else find_knots(time, command[rows])
    if knots is not None and _is_command_stale(log, rows, knots):
        log = _mark_knots(log, "steering_command_deg", rows, knots)
    # The rows in which interpolated positions or headings were measured.
    time, fresh, measured_rows = log.time_s[rows], log.fresh, dict(log.measured_rows)
    for name in PLACE_COLUMNS:
        values = getattr(log, name)
        if values is None:
            continue
        shown = np.unwrap(values[rows], period=360.0) if name == "heading_deg" else values[rows]
        knots = find_line_knots(time, shown)
        if knots is not None:
            mask = np.isin(np.arange(len(log.used)), rows[knots])
            measured_rows.setdefault("heading_deg" if name == "heading_deg" else "easting_m", mask)
            fresh = mask if fresh is None or np.count_nonzero(mask) < np.count_nonzero(fresh) else fresh
    is_same = fresh is log.fresh and len(measured_rows) == len(log.measured_rows)
    return log if is_same else replace(log, fresh=fresh, measured_rows=measured_rows)


def mark_stale_columns_of_set(logs: Sequence[Log]) -> list[Log]:
    """Return the logs of mark_stale_columns; what is stale in some is so in those whose few changes cannot tell."""
    moving = set()
    for name in MEASURED_COLUMNS:
        columns = [getattr(log, name)[log.used] for log in logs if getattr(log, name) is not None]
        counts = np.concatenate([np.zeros(0, dtype=np.int64), *map(_count_rows_before_clear_changes, columns)])
        if np.count_nonzero(counts >= 2) < MAJORITY * len(counts):
            moving.add(name)  # most clear changes, in all logs together, are of values that were not held before
    marked_logs = [mark_stale_columns(log, frozenset(moving)) for log in logs]
    for name in (*MEASURED_COLUMNS, "steering_command_deg"):
        holds = [
            float(np.median(np.diff(log.time_s[log.used & log.measured_rows[name]])))
            for log in marked_logs
            if name in log.measured_rows and np.count_nonzero(log.measured_rows[name] & log.used) > 1
        ]
        if holds:
            hold_s = float(np.median(holds))
            marked_logs = [_mark_like_others(log, name, hold_s) for log in marked_logs]
    return [_share_readings(log, marked) for log, marked in zip(logs, marked_logs, strict=True)]


def _count_rows_before_clear_changes(values: Floats) -> Integers:
    """Return for every clear change of values (k,) in how many rows the value before it stands."""
    changes = find_changes(values[None])
    return changes.counts[changes.is_clear]


def _share_readings(log: Log, marked: Log) -> Log:
    """Mark a held command where the wheel angle was read, if logged together: its noise shows every reading."""
    wheel_rows, command = marked.measured_rows.get("steering_deg"), log.steering_command_deg
    if wheel_rows is None or command is None or "steering_command_deg" not in marked.measured_rows:
        return marked
    rows = np.flatnonzero(log.used)
    changed = rows[1:][np.diff(command[rows]) != 0.0]
    if not len(changed) or float(np.mean(wheel_rows[changed])) < MOST_SHARE:
        return marked
    knots = np.flatnonzero(wheel_rows[rows] | np.isin(rows, changed))
    return _mark_knots(replace(marked, steering_command_deg=command), "steering_command_deg", rows, knots)


def _mark_like_others(log: Log, name: str, hold_s: float) -> Log:
    """Mark the changes of a column that is stale in other logs, where they are as rare here."""
    values, rows = getattr(log, name), np.flatnonzero(log.used)
    if values is None or name in log.measured_rows or len(rows) < 2:
        return log
    time, count = log.time_s[rows], max(round(hold_s / log.step_s), 1)
    held, lines = find_new_rows(values[rows]), _find_bends(time, values[rows])
    for knots, marked in ((held, _add_last_known_rows(held, len(rows), count)), (lines, lines)):
        if len(knots) > 1 and float(np.median(np.diff(time[knots]))) >= 0.5 * hold_s:
            return _mark_knots(log, name, rows, marked)
    return log


def _mark_knots(log: Log, name: str, rows: Integers, knots: Integers) -> Log:
    """Return the log with a column that was measured in the knots of its rows (k,), and straight between them."""
    column: dict[str, Any] = {name: interpolate_between(getattr(log, name), log.time_s, rows, knots)}
    measured_rows = {**log.measured_rows, name: np.isin(np.arange(len(log.used)), rows[knots])}
    return replace(log, measured_rows=measured_rows, **column)


def find_knots(time: Floats, values: Floats) -> Integers | None:
    """Return the indices at which values (k,) were measured; None where they are neither held nor interpolated."""
    held = find_held_knots(values)
    return find_line_knots(time, values) if held is None else held


def find_held_knots(values: Floats) -> Integers | None:
    """Return the indices at which held values (k,) change; None where they are not held between changes."""
    new_rows = find_new_rows(values)
    counts = _count_rows_before_clear_changes(values)
    if len(new_rows) <= FEWEST_EVENTS or len(counts) < FEWEST_EVENTS:
        return None
    usual = float(np.median(counts))
    if usual < 2.0 or np.count_nonzero(counts >= 2) < MAJORITY * len(counts):
        return None
    return _add_last_known_rows(new_rows, len(values), round(usual))


def _add_last_known_rows(new_rows: Integers, count: int, usual: int) -> Integers:
    """Add the last row at which a value at rest is known, the usual hold before it changes, and the last of all."""
    ends = np.append(new_rows[1:], count)
    is_standing = ends - new_rows > STANDING_FACTOR * usual
    return np.unique(np.concatenate([new_rows, ends[is_standing] - usual, [count - 1]]))


def find_line_knots(time: Floats, values: Floats) -> Integers | None:
    """Return the indices at which values (k,) on straight lines change their slope; None where they are no lines."""
    moving = np.abs(np.diff(values)) > 0.0
    if np.count_nonzero(moving) < FEWEST_EVENTS:
        return None
    both_move = moving[1:] & moving[:-1]
    knots = _find_bends(time, values)
    is_knot = np.isin(np.arange(1, len(values) - 1), knots)
    gaps = np.diff(knots)
    if len(knots) < FEWEST_EVENTS or not both_move.any() or float(np.median(gaps)) < 2.0:
        return None
    is_straight = float(np.mean(~is_knot[both_move])) >= _STRAIGHT_SHARE
    return knots if is_straight and np.quantile(gaps, 0.9) <= HOLDS * np.median(gaps) else None


def _find_bends(time: Floats, values: Floats) -> Integers:
    """Return the indices at which the slope of values (k,) changes by more than rounding, with the first and last."""
    slopes = np.diff(values) / np.diff(time)
    moving = np.abs(slopes) > 0.0
    tolerance = _SLOPE_TOLERANCE * float(np.median(np.abs(slopes[moving]))) if moving.any() else 0.0
    bends = np.flatnonzero(np.abs(np.diff(slopes)) > tolerance) + 1
    return np.concatenate([[0], bends, [len(values) - 1]])


def _is_command_stale(log: Log, rows: Integers, knots: Integers) -> bool:
    """Whether a held command was only logged late: with the wheel angle, or because the wheels move before it does."""
    wheel = log.steering_deg
    if wheel is None or log.steering_command_deg is None:
        return False
    shown = np.ones(len(rows), dtype=np.bool_)
    if "steering_deg" in log.measured_rows:
        shown = log.measured_rows["steering_deg"][rows]
        if float(np.mean(shown[knots])) >= MOST_SHARE:
            return True
    time, command = log.time_s[rows], log.steering_command_deg[rows]
    shown = shown & (time >= time[0] + _LAGS_S[-1])
    if np.count_nonzero(shown) < FEWEST_EVENTS:
        return False
    drawn, readings = np.interp(time, time[knots], command[knots]), (time[shown], wheel[rows][shown])
    return _measure_misfit(time, drawn, *readings) < MOST_SHARE * _measure_misfit(time, command, *readings)


def _measure_misfit(time: Floats, command: Floats, shown_s: Floats, angle: Floats) -> float:
    """Return the least variance that a late, low-passed command (k,) leaves of angles (j,) at `shown_s` (j, s)."""
    grid, left = np.arange(time[0], time[-1], _LAGS_S[1]), np.inf
    held = command[np.minimum(np.searchsorted(time, grid, side="right") - 1, len(time) - 1)]
    for filter_s in _FILTERS_S:
        share = 1.0 - np.exp(-_LAGS_S[1] / filter_s) if filter_s > 0.0 else 1.0
        smoothed = lfilter([share], [1.0, share - 1.0], held, zi=[(1.0 - share) * held[0]])[0]
        for lag_s in _LAGS_S:
            late = np.interp(shown_s - lag_s, grid, smoothed)
            slope, level = np.polyfit(late, angle, 1) if float(np.ptp(late)) > 0.0 else (0.0, float(angle.mean()))
            left = min(left, float(np.var(angle - slope * late - level)))
    return left
