"""When a drive with constant steering is unstable: one criterion, used everywhere.

A drive settles when the slip of the rear axle stays below 30 degrees throughout, and its mean over the last quarter
of the drive is at most half a degree larger than over the quarter before. Otherwise the side-slip grows without
settling: oversteer. (Section 4.3.1: the rear slip "continues to increase" and cannot be "converged".)
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.trials.drive import Trace

LOST_DEG, GROWTH_DEG = 30.0, 0.5


def settles(track: Trace) -> bool:
    """Whether the side-slip of a drive settles; see the criterion above."""
    size = np.degrees(np.abs(track.slips()[1]))
    if size.max() > LOST_DEG:
        return False
    quarter = len(size) // 4
    growth = size[-quarter:].mean() - size[-2 * quarter : -quarter].mean()
    return bool(growth <= GROWTH_DEG)


def settled_radius(track: Trace, ahead_m: float) -> float:
    """Turning radius (m) of a point over the last eighth of a drive; nan when the drive does not settle."""
    if not settles(track):
        return math.nan
    radius = track.radius(ahead_m)
    return float(radius[-max(1, len(radius) // 8) :].mean())
