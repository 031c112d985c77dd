"""A wheel sensor of the wrong scale or that saturates, told from wheels that do not reach their command.

In steady bends both read alike: wheel angles that are one multiple of the commands. Where the path bends as the
commands say and not as the sensor does, by that same multiple, the sensor is wrong. A scale is one at small and large
angles alike; a sensor with play reads less by one angle everywhere, and one that saturates by nothing up to its limit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vehicle.identification.cause_selection.refit import build_weighted_residual_model
from vehicle.identification.logs.chords import compute_path_chords
from vehicle.identification.logs.gating import FIRST_ROW_LINE, number_segments
from vehicle.identification.logs.schema import Array, GatedRows, Log, Mask, Rows
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.identification.replay.rig import build_rig
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.effects import PATH
from vehicle.model.tractor import Tractor

_STEADY_S, _SAME_DEG, _LEAST_ANGLE_DEG = 3.0, 0.3, 3.0  # chosen: after a step from lock to lock wheels have arrived
_FEWEST_ROWS, _LEAST_SPREAD_DEG = 50, 5.0
_LEAST_DIFFERENCE, _SURE_SIGMAS = 0.04, 5.0  # chosen: less is within the linearity of wheel sensors
_ALIKE_SHARE = 0.5  # chosen, of the difference from 1: with less the sensor is nearer to wrong than to right
_HALF_PLAYS_DEG = np.arange(0.25, 3.1, 0.25)  # chosen: no linkage of a sensor is looser
_TRIAL_GAIN, _ITERATIONS = 0.05, 2
_BLOCKS = 30  # chosen: steady rows of one bend are not independent


def correct_wheel_scale(logs: Sequence[Log], tractor: Tractor, ground: str) -> list[Log]:
    """Return the logs with the scale of the wheel sensor taken out, where commands and path agree about it.

    What a sensor at its limit reads is left out.
    """
    logs = leave_out_saturated_angles(logs)
    scale = measure_wheel_scale(logs)
    if scale is None:
        return list(logs)
    dataset = build_dataset(logs, (tractor.antenna_forward_m, tractor.antenna_right_m))
    residual_model = build_weighted_residual_model(dataset, build_rig(tractor, ground, dataset.origin), {})
    if abs(_estimate_path_gain(residual_model) * scale - 1.0) > _ALIKE_SHARE * abs(scale - 1.0):
        return list(logs)
    message = (
        f"steering_deg reads {100.0 * abs(scale - 1.0):.0f} % {'more' if scale > 1.0 else 'less'} than commanded in "
        f"steady bends, and the path bends as commanded: a scale error of the wheel sensor; the column is divided by "
        f"{scale:.3f}"
    )
    return [
        log
        if log.steering_deg is None
        else replace(
            log, steering_deg=log.steering_deg / scale, steering_factor=scale, corrections=(*log.corrections, message)
        )
        for log in logs
    ]


def measure_wheel_scale(logs: Sequence[Log]) -> float | None:
    """Return wheel angle over command in steady bends; None where it is not clearly other than 1, or not known."""
    pairs = [pair for log in logs if (pair := _collect_steady_pairs(log)) is not None]
    if not pairs:
        return None
    command, wheel = (np.concatenate(column) for column in zip(*pairs, strict=True))
    if len(command) < _FEWEST_ROWS or float(np.std(command)) < _LEAST_SPREAD_DEG:
        return None
    scale = _fit_slope(command, wheel)
    parts = [part for part in np.array_split(np.arange(len(command)), _BLOCKS) if np.ptp(command[part]) >= 0.0]
    left_out = [_fit_slope(np.delete(command, part), np.delete(wheel, part)) for part in parts]
    error = float(np.sqrt((len(parts) - 1) * np.var(left_out)))
    is_clear = abs(scale - 1.0) > max(_LEAST_DIFFERENCE, _SURE_SIGMAS * error)
    return scale if is_clear and not _is_play(logs, command, wheel) else None


def _is_play(logs: Sequence[Log], command: Array, wheel: Array) -> bool:
    """Whether play between wheels and sensor explains the angles (deg) of steady rows better than a scale does.

    Play is one angle at small and large angles; it shows as less where wheels come from straight ahead.
    """
    with_scale = float(np.sum((wheel - np.polyval(np.polyfit(command, wheel, 1), command)) ** 2))
    for half_deg in _HALF_PLAYS_DEG:
        read = np.concatenate([_read_with_play(log, half_deg) for log in logs])
        if float(np.sum((wheel - read - np.mean(wheel - read)) ** 2)) < with_scale:
            return True
    return False


def _read_with_play(log: Log, half_deg: float) -> Array:
    """Return what a sensor with play reads in the steady rows of a log whose wheels stand as commanded (deg)."""
    command, steady = log.steering_command_deg, _find_pair_rows(log)
    if command is None or steady is None:
        return np.zeros(0)
    read, last = np.zeros(len(command)), float(command[0])
    for row, angle in enumerate(command.tolist()):
        if np.isfinite(angle):
            last = min(max(last, angle - half_deg), angle + half_deg)
        read[row] = last
    return read[steady]


def _fit_slope(command: Array, wheel: Array) -> float:
    return float(np.polyfit(command, wheel, 1)[0])


def _collect_steady_pairs(log: Log) -> tuple[Array, Array] | None:
    """Return commands and wheel angles (deg) of rows in which a clear command has been the same for long."""
    steady = _find_pair_rows(log)
    if steady is None or log.steering_deg is None or log.steering_command_deg is None:
        return None
    return log.steering_command_deg[steady], log.steering_deg[steady]


def _find_pair_rows(log: Log) -> Mask | None:
    """Mark the rows in which a clear command has been the same for long; None without both columns."""
    if log.steering_deg is None or log.steering_command_deg is None:
        return None
    steady: Mask = log.used & (np.abs(log.steering_command_deg) > _LEAST_ANGLE_DEG) & _find_steady_rows(log)
    for measured in log.measured_rows.values():
        steady = steady & measured
    return steady


def _find_steady_rows(log: Log) -> Mask:
    """Mark rows whose command has been the same for _STEADY_S."""
    assert log.steering_command_deg is not None
    steady, since = np.zeros(len(log.time_s), dtype=np.bool_), 0
    for row in range(1, len(steady)):
        if abs(log.steering_command_deg[row] - log.steering_command_deg[since]) > _SAME_DEG or not log.used[row]:
            since = row
        steady[row] = log.time_s[row] - log.time_s[since] > _STEADY_S
    return steady


def _estimate_path_gain(residual_model: ResidualModel) -> float:
    """Return the gain from measured wheel angle to path, by steps of Gauss and Newton."""
    gain = 1.0
    for _ in range(_ITERATIONS):
        base = residual_model.compute_residuals({"steering_gain": {"ratio": gain}})
        moved = residual_model.compute_change({"steering_gain": {"ratio": gain + _TRIAL_GAIN}}, base, frozenset({PATH}))
        slope = (moved - base) / _TRIAL_GAIN
        gain -= float(slope @ base) / max(float(slope @ slope), 1e-12)
    return gain


# --- a sensor at its limit ---------------------------------------------------------------------------------------

# Chosen: the share of rows that read most; how far commands are beyond it, for so long, and differ from each other; how
# near to it all that is read stays; and how few rows at the limit are left out rather than the column.
_TOP_QUANTILE, _BEYOND_DEG, _BEYOND_S, _COMMANDS_DIFFER_DEG = 0.99, 2.0, 1.0, 2.0
_NEAR_LIMIT_DEG, _MOST_NEAR_SHARE, _FEW_ROWS_SHARE = 0.5, 0.9, 0.05
_RIGHT_SHARE, _FEWEST_CHORDS = 0.1, 8  # chosen: of the slope below the limit; and chords in bends beyond it


def leave_out_saturated_angles(logs: Sequence[Log]) -> list[Log]:
    """Return the logs without wheel angles where their sensor reads right up to a limit and no more beyond it.

    Few rows at the limit are left out; with more the column is. Wheels that stop there themselves do not bend the path
    any further, and are left alone.
    """
    limit_deg = find_sensor_limit(logs)
    if limit_deg is None:
        return list(logs)
    rows = [np.flatnonzero(log.used & _find_rows_at(log, limit_deg)) for log in logs]
    few = sum(map(len, rows)) <= _FEW_ROWS_SHARE * sum(log.rows_used for log in logs)
    return [_leave_out_angles(log, limit_deg, at_limit, few) for log, at_limit in zip(logs, rows, strict=True)]


def _leave_out_angles(log: Log, limit_deg: float, at_limit: Rows, few: bool) -> Log:
    if log.steering_deg is None:
        return log
    words = f"steering_deg reads no more than {limit_deg:.1f} degrees while larger angles are commanded and driven"
    if log.steering_command_deg is not None and not few:
        message = f"{words}: its sensor is saturated; the column is ignored"
        return replace(log, steering_deg=None, corrections=(*log.corrections, message))
    if not len(at_limit):
        return log
    used = log.used.copy()
    used[at_limit] = False
    gated = GatedRows(f"{words}: saturated sensor", len(at_limit), int(at_limit[0]) + FIRST_ROW_LINE)
    return replace(log, used=used, segment=number_segments(log.time_s, used), gated=(*log.gated, gated))


def find_sensor_limit(logs: Sequence[Log]) -> float | None:
    """Return the largest angle (deg) that a wheel sensor shows, where path and commands go beyond it; else None."""
    read = [(log, log.steering_deg, log.steering_command_deg) for log in logs]
    both = [(log, wheel, command) for log, wheel, command in read if wheel is not None and command is not None]
    if not both:
        return None
    top_deg = float(np.quantile(np.concatenate([np.abs(wheel[log.used]) for log, wheel, _ in both]), _TOP_QUANTILE))
    rows = [_find_rows_beyond(log, command, top_deg) for log, _, command in both]
    at_limit = np.concatenate([np.abs(wheel[beyond]) for (_, wheel, _), beyond in zip(both, rows, strict=True)])
    commanded = np.concatenate([np.abs(command[beyond]) for (_, _, command), beyond in zip(both, rows, strict=True)])
    if len(commanded) < _FEWEST_ROWS or float(np.ptp(np.quantile(commanded, (0.1, 0.9)))) < _COMMANDS_DIFFER_DEG:
        return None
    limit_deg = float(np.median(at_limit))
    if float(np.mean(np.abs(at_limit - limit_deg) < _NEAR_LIMIT_DEG)) < _MOST_NEAR_SHARE:
        return None
    return limit_deg if _drives_beyond([log for log, _, _ in both], limit_deg) else None


def _find_rows_beyond(log: Log, command: Array, limit_deg: float) -> Mask:
    """Mark the rows in which more than a limit has been commanded to one side for _BEYOND_S."""
    side = np.where(log.used & (np.abs(command) > limit_deg + _BEYOND_DEG), np.sign(command), 0.0)
    starts = np.flatnonzero(np.diff(side, prepend=0.0) != 0.0)
    since = np.zeros(len(side), dtype=np.int64)
    since[starts] = starts
    held_s = log.time_s - log.time_s[np.maximum.accumulate(since)]
    rows: Mask = (side != 0.0) & (held_s > _BEYOND_S)
    return rows


def _find_rows_at(log: Log, limit_deg: float) -> Mask:
    """Mark the rows that read the limit of the sensor (deg)."""
    if log.steering_deg is None:
        return np.zeros(len(log.time_s), dtype=np.bool_)
    rows: Mask = np.abs(log.steering_deg) > limit_deg - _NEAR_LIMIT_DEG
    return rows


def _drives_beyond(logs: Sequence[Log], limit_deg: float) -> bool:
    """Whether the sensor reads as commanded up to a limit, and the path bends more beyond it, as commanded."""
    chords = [_collect_chords(log) for log in logs]
    command, wheel, curvature = (np.concatenate(column) for column in zip(*chords, strict=True))
    below = (np.abs(wheel) < limit_deg - _NEAR_LIMIT_DEG) & (np.abs(command) < limit_deg)
    beyond = (np.abs(command) > limit_deg + _BEYOND_DEG) & (np.abs(wheel) > limit_deg - _NEAR_LIMIT_DEG)
    if min(np.count_nonzero(below), np.count_nonzero(beyond)) < _FEWEST_CHORDS:
        return False
    bend, least = np.tan(np.radians(wheel[below])), math.tan(math.radians(_LEAST_ANGLE_DEG))
    if float(np.std(bend)) < 0.5 * least or abs(_fit_slope(command[below], wheel[below]) - 1.0) > _RIGHT_SHARE:
        return False
    slope, at_zero = np.polyfit(bend, curvature[below], 1)
    side = np.sign(command[beyond])
    driven = side * np.degrees(np.arctan((curvature[beyond] - at_zero) / slope))
    return float(np.median((driven - limit_deg) / (np.abs(command[beyond]) - limit_deg))) > _ALIKE_SHARE


def _collect_chords(log: Log) -> tuple[Array, Array, Array]:
    """Return command and wheel angle (deg), and the curvature (1/m) to the side of the steering, per chord."""
    chords = compute_path_chords(log)
    if chords is None or log.steering_command_deg is None or log.steering_deg is None:
        return np.zeros(0), np.zeros(0), np.zeros(0)
    gear = np.sign(log.shuttle[chords.row])
    return log.steering_command_deg[chords.row], log.steering_deg[chords.row], gear * chords.curvature
