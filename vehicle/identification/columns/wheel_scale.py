"""A wheel sensor of the wrong scale, told from wheels that do not reach their command.

In steady bends both read alike: wheel angles that are one multiple of the commands. Where the path bends as the
commands say and not as the sensor does, by that same multiple, the sensor is wrong.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vehicle.identification.cause_selection.refit import build_weighted_residual_model
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.identification.replay.drive_segments import build_dataset
from vehicle.identification.replay.rig import build_rig
from vehicle.identification.residuals.residual_model import ResidualModel
from vehicle.model.effects import PATH
from vehicle.model.tractor import Tractor

_STEADY_S, _SAME_DEG, _LEAST_ANGLE_DEG = 3.0, 0.3, 3.0  # chosen: after a step from lock to lock wheels have arrived
_FEWEST_ROWS, _LEAST_SPREAD_DEG = 50, 5.0
_LEAST_DIFFERENCE, _SURE_SIGMAS = 0.04, 5.0  # chosen: less is within the linearity of wheel sensors
_ALIKE_SHARE = 0.5  # chosen, of the difference from 1: with less the sensor is nearer to wrong than to right
_TRIAL_GAIN, _ITERATIONS = 0.05, 2
_BLOCKS = 30  # chosen: steady rows of one bend are not independent


def correct_wheel_scale(logs: Sequence[Log], tractor: Tractor, ground: str) -> list[Log]:
    """Return the logs with the scale of the wheel sensor taken out, where commands and path agree about it."""
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
    return scale if abs(scale - 1.0) > max(_LEAST_DIFFERENCE, _SURE_SIGMAS * error) else None


def _fit_slope(command: Array, wheel: Array) -> float:
    return float(np.polyfit(command, wheel, 1)[0])


def _collect_steady_pairs(log: Log) -> tuple[Array, Array] | None:
    """Return commands and wheel angles (deg) of rows in which a clear command has been the same for long."""
    if log.steering_deg is None or log.steering_command_deg is None:
        return None
    steady = log.used & (np.abs(log.steering_command_deg) > _LEAST_ANGLE_DEG) & _find_steady_rows(log)
    for measured in log.measured_rows.values():
        steady = steady & measured
    return log.steering_command_deg[steady], log.steering_deg[steady]


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
