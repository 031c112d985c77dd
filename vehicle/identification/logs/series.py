"""What all checks of columns need: rows in order of time, spans, chords between two times, robust spread, noise.

Wheel angles are denoised for the play of the steering, which would follow the extremes of noise: one-sided local means,
each the widest that agrees with all narrower ones within their noise (intersection of confidence intervals:
Goldenshluger and Nemirovski 1997; directional windows: Katkovnik, Egiazarian and Astola 2006).
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.logs.thresholds import DOUBT_SIGMAS

WIDEST_WINDOW_S = 4.0  # chosen: noise averaged over this long is below any last digit
WINDOW_GROWTH = 1.5  # chosen: ratio of the widths of windows
# Chosen: closer values are equal up to rounding, larger differences are no last digit.
DIGIT_RANGE_RAD = 1e-6, math.radians(0.5)
DIGITS = 9  # decimals used: below them is rounding of the computation
# Chosen, times the least change: smaller changes may be those of the last digit.
_CLEAR_CHANGE_FACTOR = 3.0
_LEAST_STEP_QUANTILE = 0.05  # nearly the least, which by itself may be rounding


def select_timed_rows(columns: Mapping[str, Floats], *names: str) -> Integers:
    """Return the rows with a time and a position, and the named columns, without which time increases."""
    known = [columns[name] for name in ("time_s", "easting_m", "northing_m", *names)]
    rows = np.flatnonzero(np.isfinite(known).all(axis=0))
    return rows[~find_decreasing_entries(columns["time_s"][rows])]


def find_decreasing_entries(values: Floats) -> Flags:
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


def find_spans(mask: Flags) -> list[tuple[int, int]]:
    """Return first and last index of each span in which a mask (k,) is true."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]])))
    return [(int(first), int(end) - 1) for first, end in zip(edges[::2], edges[1::2], strict=True)]


def mark_spans(count: int, spans: Iterable[tuple[int, int]]) -> Flags:
    """Mark the rows, of so many, in spans of first and last index."""
    inside = np.zeros(count, dtype=np.bool_)
    for first, last in spans:
        inside[first : last + 1] = True
    return inside


def measure_spread(values: Floats) -> float:
    """Return the robust standard deviation of values (k,) about 0, as of a normal distribution with their median."""
    return 1.4826 * float(np.median(np.abs(values)))


def measure_noise(values: Floats) -> float:
    """Return the robust standard deviation of the noise of values (..., k) from row to row, without their motion."""
    return measure_spread(np.diff(values, 2)) / math.sqrt(6.0)


def wrap_degrees(angle_deg: Floats) -> Floats:
    """Return angles within half a circle."""
    return (angle_deg + 180.0) % 360.0 - 180.0


def compute_change(time: Floats, values: Floats, starts: Floats, ends: Floats) -> Floats:
    """Return by how much values (k,) at times (k,) change from start times to end times (n,)."""
    return np.asarray(np.interp(ends, time, values) - np.interp(starts, time, values))


def interpolate_between(
    column: Floats, time: Floats, rows: Integers, knots: Integers, values: Floats | None = None
) -> Floats:
    """Return a column (n,) that runs straight, in these rows (k,) of it, between the knots (indices of `rows`), or
    `values` (k,) in its place, such as angles without steps of a circle."""
    out = column.copy()
    shown = column[rows] if values is None else values
    out[rows] = np.interp(time[rows], time[rows][knots], shown[knots])
    return out


def turn_path(path: Floats, turned: Floats) -> Floats:
    """Return a path (k, 2) whose steps are turned by angles (k,), rad to the left."""
    steps = np.diff(path, axis=0)
    cosine, sine = np.cos(turned[:-1]), np.sin(turned[:-1])
    out = np.repeat(path[:1], len(path), axis=0)
    out[1:, 0] += np.cumsum(steps[:, 0] * cosine - steps[:, 1] * sine)
    out[1:, 1] += np.cumsum(steps[:, 0] * sine + steps[:, 1] * cosine)
    return out


def find_new_rows(values: Floats) -> Integers:
    """Return the rows in which values (k,) or (c, k) are other ones than in the row before, and the first row."""
    return np.append(0, np.flatnonzero((np.diff(np.atleast_2d(values)) != 0.0).any(axis=0)) + 1)


class Changes(NamedTuple):
    """Rows of new values (n,), the first row among them; and of each change to the next of them (n - 1,): how many rows
    the value before it stands, how far it goes, and whether that is more than a last digit."""

    new_rows: Integers
    counts: Integers
    jumps: Floats
    is_clear: Flags


def find_changes(values: Floats) -> Changes:
    """Find the changes of values (c, k); each column has its own last digit."""
    steps, new_rows = np.diff(values, axis=1), find_new_rows(values)
    changes = steps[:, new_rows[1:] - 1]
    least = np.zeros((len(steps), 1))  # nearly the least change, or difference of two changes: the last digit
    for place, own in enumerate(steps):
        sizes = np.unique(np.round(np.abs(own[own != 0.0]), DIGITS))
        if len(sizes):
            least[place] = np.quantile(np.concatenate([sizes, np.diff(sizes)]), _LEAST_STEP_QUANTILE)
    is_clear = np.asarray((np.abs(changes) > _CLEAR_CHANGE_FACTOR * least).any(axis=0))
    return Changes(new_rows, np.diff(new_rows), np.sqrt((changes**2).sum(axis=0)), is_clear)


def denoise_angles(time: Floats, values: Floats) -> Floats:
    """Remove white noise from angles (k, rad) at times (k, s) without delaying or smoothing steps."""
    noise = estimate_angle_noise(values)
    if noise == 0.0:
        return values
    most_rows = min(int(WIDEST_WINDOW_S / float(np.median(np.diff(time)))), len(values) - 1)
    count = math.ceil(math.log(max(most_rows, 1), WINDOW_GROWTH)) + 1
    widths = [int(width) for width in np.unique(np.round(WINDOW_GROWTH ** np.arange(count))) if width <= most_rows]
    mean_before, count_before = _compute_one_sided_means(values, widths, noise)
    mean_after, count_after = _compute_one_sided_means(values[::-1], widths, noise)
    mean_after, count_after = mean_after[::-1], count_after[::-1]
    # The row itself is in both means.
    out: Floats = (mean_before * count_before + mean_after * count_after - values) / (count_before + count_after - 1.0)
    return out


def estimate_angle_noise(values: Floats) -> float:
    """Return the standard deviation of white noise on angles (k, rad) that move smoothly in most rows, not below the
    rounding to their last digit."""
    if len(values) < 3:
        return 0.0
    spread = measure_noise(values)
    spacings = np.diff(np.unique(values))
    digit = float(np.min(spacings[(spacings > DIGIT_RANGE_RAD[0]) & (spacings < DIGIT_RANGE_RAD[1])], initial=np.inf))
    return max(spread, digit / math.sqrt(12.0)) if math.isfinite(digit) else spread


def _compute_one_sided_means(values: Floats, widths: list[int], noise: float) -> tuple[Floats, Floats]:
    """Return the mean (k,) of each row and those before it, and the number of rows in each mean."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    ends = np.arange(1, len(values) + 1)
    mean, count = values.copy(), np.ones(len(values))
    low, high = values - DOUBT_SIGMAS * noise, values + DOUBT_SIGMAS * noise
    agree = np.ones(len(values), dtype=np.bool_)
    for width in widths:
        starts = np.maximum(ends - width - 1, 0)
        window_rows = (ends - starts).astype(np.float64)
        window_mean = (sums[ends] - sums[starts]) / window_rows
        error = DOUBT_SIGMAS * noise / np.sqrt(window_rows)
        low, high = np.maximum(low, window_mean - error), np.minimum(high, window_mean + error)
        agree &= low <= high
        mean, count = np.where(agree, window_mean, mean), np.where(agree, window_rows, count)
    return mean, count
