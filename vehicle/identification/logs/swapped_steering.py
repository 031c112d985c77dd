"""A commanded and a measured steering angle under each other's names, told by which of them follows the other.

Wheels move towards their command, at the rate of a valve; commands jump, and do not wait for the wheels. A clock that
is wrong shifts one column against the other and makes neither of them jump.
"""

from __future__ import annotations

import math

import numpy as np

from vehicle.identification.logs.schema import Array, Log

_AHEAD_S = 0.3  # chosen: within which wheels move towards a command
_GAP_DEG, _FEWEST_ROWS = 0.7, 10  # chosen: rows with larger gaps show who follows whom
# Chosen, correlations of movement with the gap before it: from which a column follows, and up to which it does not.
_FOLLOWS, _FOLLOWS_MORE = 0.6, 0.2
_STEEPEST_ROWS = 2  # chosen: one may be an outlier
_STEEPER = 1.5  # chosen: times the steepest movement of the column that follows


def find_swapped_steering(log: Log) -> str | None:
    """Return how the two steering columns show that each has the name of the other; None where they do not."""
    if log.steering_deg is None or log.steering_command_deg is None or log.rows_used < _FEWEST_ROWS:
        return None
    wheel_follows = _measure_following(log, log.steering_deg, log.steering_command_deg)
    command_follows = _measure_following(log, log.steering_command_deg, log.steering_deg)
    if wheel_follows is None or command_follows is None:
        return None
    steepness = [_measure_steepest_deg_per_s(log, values) for values in (log.steering_deg, log.steering_command_deg)]
    follows = command_follows > max(_FOLLOWS, wheel_follows + _FOLLOWS_MORE)
    if not follows or steepness[0] < _STEEPER * steepness[1]:
        return None
    return (
        f"steering_command_deg moves towards steering_deg at up to {steepness[1]:.0f} deg/s, and steering_deg jumps "
        "without following it"
    )


def _measure_following(log: Log, follower: Array, leader: Array) -> float | None:
    """Return the correlation of the movement of a column with how far the other one is ahead; None without gaps."""
    rows = np.flatnonzero(log.used)
    ahead = max(round(_AHEAD_S / log.step_s), 1)
    start, end = rows[:-ahead], rows[ahead:]
    near = (log.segment[start] == log.segment[end]) & (log.time_s[end] - log.time_s[start] < 2.0 * ahead * log.step_s)
    if np.count_nonzero(near) < _FEWEST_ROWS:
        return None
    start, end = start[near], end[near]
    gap, movement = leader[start] - follower[start], follower[end] - follower[start]
    # An offset of the sensor is no gap.
    gap = gap - np.median(gap)
    clear = np.abs(gap) > _GAP_DEG
    if np.count_nonzero(clear) < _FEWEST_ROWS:
        return None
    squares = float(gap[clear] @ gap[clear]) * float(movement[clear] @ movement[clear])
    return float(gap[clear] @ movement[clear]) / math.sqrt(squares) if squares > 0.0 else 0.0


def _measure_steepest_deg_per_s(log: Log, values: Array) -> float:
    """Return the mean rate (deg/s) of the steepest rows."""
    rows = np.flatnonzero(log.used)
    rates = np.sort(np.abs(np.diff(values[rows])) / np.maximum(np.diff(log.time_s[rows]), 0.5 * log.step_s))
    return float(np.mean(rates[-_STEEPEST_ROWS:]))
