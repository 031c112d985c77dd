"""Stretches of a log driven in one gear without a gap: what a replay can use, and what is too short for it."""

from __future__ import annotations

import numpy as np

from vehicle.measured.logs.record import Log, Rows

SHORTEST_S = 5.0  # one piece of the 5 s horizon, the one that errors are compared over


def driven_stretches(log: Log) -> tuple[list[Rows], list[Rows]]:
    """Rows of each stretch driven forward, or in reverse, without a gap: those long enough to replay, and the rest."""
    long: list[Rows] = []
    short: list[Rows] = []
    rows = np.flatnonzero(log.used)
    # A few rows left out are no gap, unless the gear was changed in them.
    change = (np.diff(log.segment[rows]) != 0) | (np.diff(_gears(log)[rows]) != 0)
    for whole in np.split(rows, np.flatnonzero(change) + 1):
        part = _measured(log, whole)
        if len(part):
            enough = log.time_s[part[-1]] - log.time_s[part[0]] >= SHORTEST_S
            (long if enough else short).append(part)
    return long, short


def _measured(log: Log, rows: Rows) -> Rows:
    """Rows from the first to the last in which the position was measured."""
    if log.fresh is None:
        return rows
    fresh = np.flatnonzero(log.fresh[rows])
    return rows[fresh[0] : fresh[-1] + 1] if len(fresh) else rows[:0]


def _gears(log: Log) -> Rows:
    """Number of the gear changes up to each row, of those that the log tells."""
    told = np.isfinite(log.shuttle)
    gear = np.sign(log.shuttle[told])
    number = np.zeros(len(log.shuttle), dtype=np.int64)
    number[told] = np.cumsum(np.diff(gear, prepend=gear[:1]) != 0.0)
    return number
