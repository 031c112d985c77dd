"""What all checks of columns need: rows in order of time, spans, chords between two times, robust spread."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from vehicle.identification.logs.schema import Array, Mask, Rows


def select_timed_rows(columns: Mapping[str, Array], *names: str) -> Rows:
    """Return the rows with a time and a position, and the named columns, without which time increases."""
    known = [columns[name] for name in ("time_s", "easting_m", "northing_m", *names)]
    rows = np.flatnonzero(np.isfinite(known).all(axis=0))
    return rows[~find_decreasing_entries(columns["time_s"][rows])]


def find_decreasing_entries(values: Array) -> Mask:
    """Mark the entries outside one longest strictly increasing subsequence (patience sorting)."""
    bad = np.ones(len(values), dtype=np.bool_)
    if len(values) == 0 or bool((np.diff(values) > 0.0).all()):
        return ~bad
    tails: list[float] = []
    tail_rows: list[int] = []
    before = np.full(len(values), -1)
    for row, value in enumerate(values.tolist()):
        place = bisect_left(tails, value)
        before[row] = tail_rows[place - 1] if place else -1
        if place == len(tails):
            tails.append(value)
            tail_rows.append(row)
        else:
            tails[place], tail_rows[place] = value, row
    row = tail_rows[-1]
    while row >= 0:
        bad[row] = False
        row = int(before[row])
    return bad


def find_spans(mask: Mask) -> list[tuple[int, int]]:
    """Return first and last index of each span in which a mask (k,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def measure_spread(values: Array) -> float:
    """Return the robust standard deviation of values (k,) about 0, that of a normal distribution with their median."""
    return 1.4826 * float(np.median(np.abs(values)))


def measure_noise(values: Array) -> float:
    """Return the robust standard deviation of the noise of values (..., k) from row to row, without their motion."""
    return measure_spread(np.diff(values, 2)) / math.sqrt(6.0)


def wrap_degrees(angle_deg: Array) -> Array:
    """Return angles within half a circle."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def compute_change(time: Array, values: Array, starts: Array, ends: Array) -> Array:
    """Return by how much values (k,) at times (k,) change from start times to end times (n,)."""
    change: Array = np.interp(ends, time, values) - np.interp(starts, time, values)
    return change


DIGITS = 9  # decimals used: below them is rounding of the computation
# Chosen, times the least change: smaller changes may be those of the last digit.
_CLEAR_CHANGE_FACTOR = 3.0
_LEAST_STEP_QUANTILE = 0.05  # nearly the least, which by itself may be rounding


class Changes(NamedTuple):
    """Rows of new values (n,), the first row among them; and of each change to the next of them (n - 1,): how many rows
    the value before it stands, how far it goes, and whether that is more than a last digit."""

    new_rows: Rows
    counts: Rows
    jumps: Array
    is_clear: Mask


def find_changes(values: Array) -> Changes:
    """Find the changes of values (c, k); each column has its own last digit."""
    steps = np.diff(values, axis=1)
    new_rows = np.append(0, np.flatnonzero((steps != 0.0).any(axis=0)) + 1)
    changes = steps[:, new_rows[1:] - 1]
    least = np.array([[_find_least_step(column_steps)] for column_steps in steps])
    is_clear = np.asarray((np.abs(changes) > _CLEAR_CHANGE_FACTOR * least).any(axis=0))
    return Changes(new_rows, np.diff(new_rows), np.sqrt((changes**2).sum(axis=0)), is_clear)


def _find_least_step(steps: Array) -> float:
    """Return nearly the least change of values (k - 1,), or difference of two changes: their last digit."""
    sizes = np.unique(np.round(np.abs(steps[steps != 0.0]), DIGITS))
    candidates = np.concatenate([sizes, np.diff(sizes)])
    return float(np.quantile(candidates, _LEAST_STEP_QUANTILE)) if len(candidates) else 0.0
