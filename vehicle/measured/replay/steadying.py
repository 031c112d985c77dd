"""A measured signal without the noise of its sensor, for what remembers extremes: play keeps the largest of all noise.

Local means over windows to both sides of a row, each as long as the signal lets it be: the widest that agrees with all
narrower ones within their noise (intersection of confidence intervals: Goldenshluger and Nemirovski 1997; directional
windows: Katkovnik, Egiazarian and Astola 2006). Where the wheels rest it averages for long, at a step it stays sharp.
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.measured.logs.record import Array

WIDEST_S = 4.0  # chosen: what noise is left of rows over so long lies below any last digit
GROWS, STEPS = 1.5, 20  # chosen: of windows, each against the next narrower; up to 2000 rows
AGREES = 2.0  # chosen, in standard errors: of wider means the bias shows before it grows past the noise taken away
DIGITS_RAD = (1e-6, math.radians(0.5))  # chosen: values nearer are one but for rounding, farther apart no last digit


def steadied(time: Array, values: Array) -> Array:
    """Angles (k, rad) at times (k, s) without the white noise they have, no later and no slower at steps."""
    noise = noise_of(values)
    if noise == 0.0:
        return values
    most = min(int(WIDEST_S / float(np.median(np.diff(time)))), len(values) - 1)
    widths = [int(width) for width in np.unique(np.round(GROWS ** np.arange(STEPS))) if width <= most]
    back, before = _one_sided(values, widths, noise)
    ahead, after = _one_sided(values[::-1], widths, noise)
    ahead, after = ahead[::-1], after[::-1]
    # The row itself is in both.
    out: Array = (back * before + ahead * after - values) / (before + after - 1.0)
    return out


def noise_of(values: Array) -> float:
    """Standard deviation of white noise on angles (k, rad) that move smoothly in most rows.

    Not below what rounding to their last digit makes, where second differences are 0 in most rows.
    """
    if len(values) < 3:
        return 0.0
    spread = 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6.0)
    apart = np.diff(np.unique(values))
    digit = float(np.min(apart[(apart > DIGITS_RAD[0]) & (apart < DIGITS_RAD[1])], initial=np.inf))
    return max(spread, digit / math.sqrt(12.0)) if math.isfinite(digit) else spread


def _one_sided(values: Array, widths: list[int], noise: float) -> tuple[Array, Array]:
    """Means (k,) of each row and those before it, and how many rows each is of."""
    sums = np.concatenate([[0.0], np.cumsum(values)])
    ends = np.arange(1, len(values) + 1)
    mean, count = values.copy(), np.ones(len(values))
    low, high = values - AGREES * noise, values + AGREES * noise
    agree = np.ones(len(values), dtype=np.bool_)
    for width in widths:
        starts = np.maximum(ends - width - 1, 0)
        wide = (ends - starts).astype(np.float64)
        one = (sums[ends] - sums[starts]) / wide
        error = AGREES * noise / np.sqrt(wide)
        low, high = np.maximum(low, one - error), np.minimum(high, one + error)
        agree &= low <= high
        mean, count = np.where(agree, one, mean), np.where(agree, wide, count)
    return mean, count
