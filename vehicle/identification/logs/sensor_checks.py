"""Faulty sensors and commands that were not driven, detected by what no tractor does, corrected and reported.

Each check compares two instruments of one log. Uncorrected, these errors would look like faults of the tractor: a speed
that reads high like wheel slip, drifting clocks like a growing dead time, a stuck angle like missing grip.

A measured speed that is one multiple of the pace in every direction, at every speed, working or not, has a wrong scale.
A command that is one looks like slip, so the diagnosis measures it. A command that is constant while the
pace changes was not driven.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fields.arrays import Flags, Floats
from vehicle.identification.logs.clocks import correct_position_clock
from vehicle.identification.logs.motion import (
    PathChords,
    compute_bends,
    compute_path_chords,
    fit_chords,
    has_pace_change,
)
from vehicle.identification.logs.schema import Log
from vehicle.identification.logs.series import compute_change, measure_spread
from vehicle.identification.logs.thresholds import (
    FEWEST_LINE_CHORDS,
    LASTING_S,
    MEASURED_SIGMAS,
    NEAR_SHARE,
    NEARLY_SHARE,
    STEERING_NOISE_DEG,
    STRAIGHT_PER_M,
    STRAY_CORRELATION,
)

# Speed: no slip or slope changes it this much, working or not; smaller factors compete with other causes in the
# diagnosis (speed_scale).
_LEAST_SENSOR_FACTOR = 1.25
_SAME_SHARE = 0.03  # by which factors of parts may differ
_STRAY_MESSAGE = "steering_deg is unrelated to the bends of the path"

_STEADY_S = 2.0 * LASTING_S  # of constant command: longer than any drive line takes to follow


def correct_sensors(log: Log) -> Log:
    """Return the log with sensor errors corrected, and a sentence for each in `corrections`."""
    for check in (_drop_unrelated_wheel_angle, _correct_speed_factor, correct_position_clock):
        log = check(log)
    return log


def _correct_speed_factor(log: Log) -> Log:
    """Correct a measured speed that is the same multiple of the positions' pace in all directions, working or not."""
    chords = compute_path_chords(log)
    if log.speed_mps is None or chords is None:
        return log
    straight = _select_straight_chords(chords, log.speed_mps[chords.row])
    factor = _find_common_factor(_collect_ratios(log, chords, log.speed_mps, straight))
    if factor is None or max(factor, 1.0 / factor) < _LEAST_SENSOR_FACTOR:
        return log
    direction = "more" if factor > 1.0 else "less"
    message = (
        f"speed_mps reads {100.0 * abs(factor - 1.0):.0f} % {direction} than the positions move, in every direction: "
        f"a scale error of the sensor, not slip; the column is divided by {factor:.3f}"
    )
    return log.correct_columns(message, speed_mps=log.speed_mps / factor, speed_factor=factor)


def _collect_ratios(log: Log, chords: PathChords, stated: Floats, chosen: Flags) -> Floats:
    """Return of chosen chords stated speed over pace, stated speed (m/s), course (rad) and implement (4, k)."""
    rows = chords.row[chosen]
    ratio = stated[rows] / chords.speed[chosen]
    return np.asarray(np.stack([ratio, stated[rows], chords.course[chosen], log.implement[rows]]))


def _find_common_factor(ratios: Floats) -> float | None:
    """Return stated speed over pace; None where it may be 1, or differs by direction of travel, implement or speed."""
    ratio, stated, course, working = ratios
    if len(ratio) < FEWEST_LINE_CHORDS:
        return None
    factor = float(np.median(ratio))
    # Chords overlap by half, so two count as one observation.
    error = 1.25 * measure_spread(ratio - factor) * math.sqrt(2.0 / len(ratio))
    conditions = (np.sin(course) > 0.5, np.sin(course) < -0.5, np.cos(course) > 0.5, np.cos(course) < -0.5)
    slow = stated <= np.median(stated)
    parts = [*conditions, slow, ~slow, working > 0.5, working <= 0.5]
    levels = [float(np.median(ratio[part])) for part in parts if np.count_nonzero(part) >= FEWEST_LINE_CHORDS // 2]
    alike = max(_SAME_SHARE * factor, 3.0 * error)
    is_clear = abs(factor - 1.0) >= MEASURED_SIGMAS * error
    return factor if is_clear and all(abs(level - factor) < alike for level in levels) else None


def correct_sensors_like_others(logs: Sequence[Log]) -> list[Log]:
    """Correct logs that cannot show an error by themselves as other logs of the set were.

    Bends show a speed factor only roughly; where it is near one that straight driving showed in another log, that one
    is used. Straight driving cannot show that a wheel angle is unrelated to the path; where bends of another log did,
    one that varies without bending the path is dropped.
    """
    stray = next((log for log in logs if log.stray_steering_deg > 0.0), None)
    kept = []
    for log in logs:
        if stray is not None and log.steering_deg is not None and log.steering_command_deg is not None:
            least_deg = min(STEERING_NOISE_DEG, 0.5 * stray.stray_steering_deg)
            is_moving = float(np.std(log.steering_deg[log.used])) >= least_deg
            by_sensor = _correlate_with_bends(replace(log, steering_command_deg=None)) if is_moving else 1.0
            if not abs(by_sensor) > 2.0 * STRAY_CORRELATION:
                message = f"{_STRAY_MESSAGE}, as in {stray.name}; the column is ignored"
                log = log.correct_columns(message, steering_deg=None, stray_steering_deg=stray.stray_steering_deg)
        kept.append(log)
    logs_with_factor = [log for log in kept if log.speed_factor != 1.0]
    return [_correct_speed_as_others(log, logs_with_factor) for log in kept] if logs_with_factor else kept


def _correct_speed_as_others(log: Log, logs_with_factor: Sequence[Log]) -> Log:
    """Divide a speed by the nearest factor found in other logs, where it reads by about that factor."""
    chords = compute_path_chords(log)
    if log.speed_mps is None or log.speed_factor != 1.0 or chords is None or len(chords.row) < FEWEST_LINE_CHORDS // 2:
        return log
    stated_mps = log.speed_mps[chords.row]
    if np.count_nonzero(_select_straight_chords(chords, stated_mps)) >= FEWEST_LINE_CHORDS:
        return log  # this log shows by itself that there is no factor, or slip instead
    ratio = float(np.median(stated_mps / np.maximum(chords.speed, 0.05)))
    nearest_log = min(logs_with_factor, key=lambda other: abs(math.log(max(ratio, 1e-3) / other.speed_factor)))
    factor = nearest_log.speed_factor
    if abs(math.log(max(ratio, 1e-3) / factor)) > NEAR_SHARE * abs(math.log(factor)):
        return log
    message = (
        f"speed_mps reads about {100.0 * abs(ratio - 1.0):.0f} % {'more' if ratio > 1.0 else 'less'} than the "
        f"positions move, as in {nearest_log.name}: the same sensor; the column is divided by {factor:.3f}"
    )
    return log.correct_columns(message, speed_mps=log.speed_mps / factor, speed_factor=factor)


def _select_straight_chords(chords: PathChords, stated_mps: Floats) -> Flags:
    """Select the chords that can show a factor of the stated speed."""
    return np.asarray((np.abs(chords.curvature) < STRAIGHT_PER_M) & (chords.speed > 0.3) & (stated_mps > 0.1))


def _drop_unrelated_wheel_angle(log: Log) -> Log:
    """Drop a wheel angle that is unrelated to the path while the command explains it."""
    if log.steering_deg is None or log.steering_command_deg is None:
        return log
    by_sensor = _correlate_with_bends(replace(log, steering_command_deg=None))
    by_command = _correlate_with_bends(replace(log, steering_deg=None))
    is_clear = float(np.std(log.steering_deg[log.used])) >= STEERING_NOISE_DEG and by_command >= NEARLY_SHARE
    if abs(by_sensor) > STRAY_CORRELATION or not (is_clear or _is_wheel_angle_bypassed(log)):
        return log
    message = f"{_STRAY_MESSAGE} (correlation {by_sensor:.2f}, of the command {by_command:.2f}); the column is ignored"
    spread_deg = float(np.std(log.steering_deg[log.used]))
    return log.correct_columns(message, steering_deg=None, stray_steering_deg=spread_deg)


def _is_wheel_angle_bypassed(log: Log) -> bool:
    """Whether the command clearly bends the path while the wheel angle hardly moves with it or is all noise.

    All noise: it varies as much from row to row as over the log, which wheels do not, and more than the command. The
    heading, if there is one, shows the curvature with less noise than positions.
    """
    by_sensor = compute_bends(replace(log, steering_command_deg=None))
    by_command = compute_bends(replace(log, steering_deg=None))
    chords = compute_path_chords(log)
    if by_sensor is None or by_command is None or len(by_command[0]) < 2 * FEWEST_LINE_CHORDS:
        return False
    command, path, wheel = by_command[0], by_command[1], by_sensor[0]
    if log.heading_deg is not None and chords is not None:
        rows, middles = np.flatnonzero(log.used), log.time_s[chords.row]
        heading = np.unwrap(np.radians(log.heading_deg[rows]))
        ends = middles - 0.5 * chords.span_s, middles + 0.5 * chords.span_s
        path = by_command[2] * compute_change(log.time_s[rows], heading, *ends) / (chords.speed * chords.span_s)
    command_share, command_error = fit_chords(command, path)
    sensor_share, sensor_error = fit_chords(command, wheel)
    measured, commanded = log.steering_deg[log.used], log.steering_command_deg[log.used]  # type: ignore[index]
    from_row_to_row = float(np.std(np.diff(measured))) / math.sqrt(2.0)
    noise = from_row_to_row > max(NEARLY_SHARE * float(np.std(measured)), float(np.std(commanded)))
    return command_share > MEASURED_SIGMAS * command_error and (
        noise or sensor_share + MEASURED_SIGMAS * sensor_error < STRAY_CORRELATION
    )


def _correlate_with_bends(log: Log) -> float:
    """Return the correlation of the steering with the bends of the path, 1 with too few bends."""
    bends = compute_bends(log)
    if (
        bends is None
        or len(bends[0]) < 2 * FEWEST_LINE_CHORDS
        or min(float(np.std(column)) for column in bends[:2]) == 0.0
    ):
        return 1.0
    return float(np.corrcoef(bends[0], bends[1])[0, 1])


def drop_commands_not_driven(logs: Sequence[Log]) -> list[Log]:
    """Drop commanded speeds that were not driven, over a set of logs; `corrections` say which and why.

    A constant one is also dropped where it has the value that was dropped in another log.
    """

    def drop_command(log: Log, why: str) -> Log:
        said = f"{why}: the tractor was not driven by it; the column is ignored"
        return log.correct_columns(said, speed_command_mps=None)

    descriptions, alone, kept = [], list[Log](), list[Log]()
    for log in logs:
        values, said = log.speed_command_mps, ""
        if values is not None and log.used.any() and not float(np.ptp(values[log.used])) > 0.0:
            said = f"speed_command_mps is {values[log.used][0]:g} in every row"
        descriptions.append(said)
        is_other = bool(said) and _changes_pace(log)
        alone.append(drop_command(log, f"{said} although the tractor's pace changes") if is_other else log)
    for log, said in zip(alone, descriptions, strict=True):
        others = alone if said and log.speed_command_mps is not None else ()
        same = next((one for one in others if any(doubt.startswith(said) for doubt in one.corrections)), None)
        kept.append(log if same is None else drop_command(log, f"{said}, as in {same.name}"))
    return kept


def _changes_pace(log: Log) -> bool:
    """Whether the pace under way changes, with the implement lifted or working, as under one command it does not."""
    chords = compute_path_chords(log)
    if chords is None:
        return False
    segment_start_s = np.array([log.time_s[log.segment == number][0] for number in range(log.segment_count)])
    under_way = log.time_s[chords.row] - segment_start_s[log.segment[chords.row]] > _STEADY_S
    paces = [chords.speed[under_way & (log.implement[chords.row] == working)] for working in (0.0, 1.0)]
    return any(len(pace) >= FEWEST_LINE_CHORDS and has_pace_change(pace) for pace in paces)
