"""Steering against the bends of the path, chord by chord."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.motion import motion
from vehicle.measured.logs.record import Array, Log

CLEAR_STEERING_DEG = 3.0  # beyond any offset, slope or draft of the catalogue at its usual size
_FEWEST = 5  # chords: fewer bends may be one swerve
_FEWEST_ROWS = 20  # of two columns, before they contradict each other
_MOST = 0.8  # of the clear bends: a few are read wrong where the steering just changes


def steering(log: Log) -> Array:
    """The steering (deg) to judge by: the sensor before the command.

    Raises LogError for two columns that contradict each other.
    """
    command, sensor = log.steering_command_deg, log.steering_deg
    if sensor is None or command is None:
        angle = command if sensor is None else sensor
        assert angle is not None
        return angle
    one, two = command[log.used], sensor[log.used]
    if len(one) < _FEWEST_ROWS:
        return sensor
    spread, other = float(np.std(one)), float(np.std(two))
    if spread > 0.0 and other > 0.0:
        together = float(np.mean((one - one.mean()) * (two - two.mean()))) / (spread * other)
        if together < -0.7 and spread > 0.03:
            raise LogError(
                f"{log.name}: steering_command_deg and steering_deg have opposite signs (correlation "
                f"{together:.2f}); make both positive to the right."
            )
        if together > 0.7 and not 1.0 / 20.0 < spread / other < 20.0:
            raise LogError(
                f"{log.name}: steering_command_deg moves {spread / other:.3g} times as far as steering_deg; "
                "one is in radians, write both in degrees."
            )
    return sensor


def largest_steering(log: Log) -> float:
    """Largest angle of the steering to judge by."""
    return float(np.abs(steering(log)[log.used]).max())


def bends(log: Log) -> tuple[Array, Array, Array] | None:
    """Per chord: the steering averaged over it, the path's curvature (1/m) to the right of a forward gear, the gear.

    The gear is -1, 0 or 1. None when the log has no chords.
    """
    chords = motion(log)
    if chords is None:
        return None
    rows = np.flatnonzero(log.used)
    time, values = log.time_s[rows], steering(log)[rows]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    middle = log.time_s[chords.row]
    ends = [np.interp(middle + shift * chords.span_s, time, total) for shift in (-0.5, 0.5)]
    gear = np.sign(log.shuttle[chords.row])
    return (ends[1] - ends[0]) / chords.span_s, chords.curvature * gear, gear


def clear_bends(logs: Sequence[Log], gear: float = 0.0) -> tuple[Array, Array]:
    """Steering and curvature of the chords with clear steering; of one gear only when it is not 0."""
    angles, curvatures = [np.empty(0)], [np.empty(0)]
    for log in logs:
        bent = bends(log)
        if bent is not None:
            clear = (np.abs(bent[0]) >= CLEAR_STEERING_DEG) & ((bent[2] == gear) | (gear == 0.0))
            angles.append(bent[0][clear])
            curvatures.append(bent[1][clear])
    return np.concatenate(angles), np.concatenate(curvatures)


def is_mirrored(angle: Array, curvature: Array) -> bool | None:
    """Whether the path turns away from the steering; None with too few bends to say.

    Judged on clear steering only, where no offset, slope or draft can turn the tractor the other way.
    """
    if len(angle) < _FEWEST:
        return None
    together = float(angle @ curvature) / math.sqrt(float(angle @ angle) * float(curvature @ curvature) + 1e-30)
    return together <= -0.5 and float(np.mean(angle * curvature < 0.0)) >= _MOST
