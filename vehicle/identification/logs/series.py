"""What all checks of columns need: rows in order of time, spans, chords between two times, robust spread."""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping

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
    """Return the robust standard deviation of values (k,) about 0: of a normal distribution, 1.48 times the median."""
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
