"""Stretches of a log that were driven forward without a gap: what a replay can use, and what is too short for it."""

from __future__ import annotations

import numpy as np

from vehicle.measured.logs.record import Log, Rows

SHORTEST_S = 5.0  # one piece of the 5 s horizon, the one that errors are compared over


def forward_stretches(log: Log) -> tuple[list[Rows], list[Rows]]:
    """Rows of each stretch driven forward without a gap: those long enough to replay, and those too short."""
    long: list[Rows] = []
    short: list[Rows] = []
    # A few rows left out are no gap, unless the gear was changed in them.
    seen = np.flatnonzero(log.used | (log.shuttle <= 0.0))
    number = np.where(log.used & (log.shuttle > 0.0), log.segment, -1)[seen]
    for rows in np.split(seen, np.flatnonzero(np.diff(number) != 0) + 1):
        if len(rows) and log.used[rows[0]] and log.shuttle[rows[0]] > 0.0:
            enough = log.time_s[rows[-1]] - log.time_s[rows[0]] >= SHORTEST_S
            (long if enough else short).append(rows)
    return long, short
