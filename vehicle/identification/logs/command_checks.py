"""Commanded speeds that were not driven, so that they are not mistaken for slip.

Wheels that slip lose speed. A tractor that is faster than commanded by one factor in every direction, at every speed,
working or not, was commanded by another number than the log has. One that changes its pace under a constant command was
not driven by it. A factor below 1 looks like slip in every column and is left alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.logs.chords import compute_path_chords
from vehicle.identification.logs.schema import Array, Log, Mask
from vehicle.model.effects import DRIVE_LINE_SLIP

_LEAST_FACTOR, _SURE_SIGMAS, _ALIKE_SHARE = 1.0 + DRIVE_LINE_SLIP, 5.0, 0.03  # the first as for the speed sensor
_STRAIGHT_PER_M = 0.03  # in bends the antenna is faster than the tractor
_STEADY_S, _SAME_MPS = 6.0, 0.02  # of constant command: longer than any drive line takes to follow
_PACE_CHANGED = 0.3  # of the median pace, from the slowest to the fastest tenth
_FEWEST_CHORDS = 12  # chords


def correct_commanded_speeds(logs: Sequence[Log]) -> list[Log]:
    """Drop or scale commanded speeds that were not driven, over a set of logs; `corrections` say which and why."""
    alone = [_drop_constant_command(log) for log in logs]
    return _scale_commanded_speeds([_drop_command_constant_elsewhere(log, alone) for log in alone])


def _describe_constant_command(log: Log) -> str | None:
    """Describe a command that is constant over the log; None if it is not."""
    values = log.speed_command_mps
    if values is None or not log.used.any() or float(np.ptp(values[log.used])) > 0.0:
        return None
    return f"speed_command_mps is {values[log.used][0]:g} in every row"


def _drop_constant_command(log: Log) -> Log:
    description, chords = _describe_constant_command(log), compute_path_chords(log)
    if description is None or chords is None:
        return log
    segment_start_s = np.array([log.time_s[log.segment == number][0] for number in range(log.segment_count)])
    under_way = log.time_s[chords.row] - segment_start_s[log.segment[chords.row]] > _STEADY_S
    for working in (0.0, 1.0):
        pace = chords.speed[under_way & (log.implement[chords.row] == working)]
        if len(pace) >= _FEWEST_CHORDS and _has_pace_change(pace):
            return _drop_command(log, f"{description} although the tractor's pace changes")
    return log


def _has_pace_change(pace: Array) -> bool:
    slow, middle, fast = np.quantile(pace, (0.1, 0.5, 0.9))
    return bool(fast - slow > _PACE_CHANGED * middle)


def _drop_command_constant_elsewhere(log: Log, other_logs: Sequence[Log]) -> Log:
    """Drop the command where it has the constant value that was dropped in another log."""
    description = _describe_constant_command(log)
    same_log = next(
        (
            candidate_log
            for candidate_log in other_logs
            if description and any(doubt.startswith(description) for doubt in candidate_log.corrections)
        ),
        None,
    )
    return log if same_log is None else _drop_command(log, f"{description}, as in {same_log.name}")


def _drop_command(log: Log, why: str) -> Log:
    return log.correct_columns(
        f"{why}: the tractor was not driven by it; the column is ignored", speed_command_mps=None
    )


@dataclass(frozen=True, eq=False)
class _CommandPaces:
    """Chords driven straight under a constant command, each (k,): `ratio` of pace to command, command (m/s), course
    (rad) and implement."""

    ratio: Array
    command: Array
    course: Array
    working: Array

    def split_by_conditions(self) -> list[Mask]:
        """Split the chords by direction of travel, by implement and by speed; parts that are too small are dropped."""
        east, north, slow = np.sin(self.course), np.cos(self.course), self.command <= np.median(self.command)
        parts = [east > 0.5, east < -0.5, north > 0.5, north < -0.5, slow, ~slow]
        parts += [self.working > 0.5, self.working <= 0.5]
        return [part for part in parts if np.count_nonzero(part) >= _FEWEST_CHORDS]


def _scale_commanded_speeds(logs: list[Log]) -> list[Log]:
    """Multiply the commands by the factor by which all logs are driven faster, if there is one."""
    measured_paces = [paces for log in logs if (paces := _collect_paces(log)) is not None]
    if not measured_paces:
        return logs
    columns = (
        np.concatenate([getattr(paces, name) for paces in measured_paces]) for name in _CommandPaces.__annotations__
    )
    factor = _find_pace_factor(_CommandPaces(*columns))
    if factor is None:
        return logs
    message = (
        f"the tractor drives {100.0 * (factor - 1.0):.0f} % faster than speed_command_mps in every direction, "
        f"at every speed, working or not: a wrong scale, not slip; the column is multiplied by {factor:.3f}"
    )
    return [
        log
        if log.speed_command_mps is None
        else log.correct_columns(message, speed_command_mps=factor * log.speed_command_mps)
        for log in logs
    ]


def _find_pace_factor(paces: _CommandPaces) -> float | None:
    """Return pace over command; None where it is not clearly above 1, or not the same in all parts."""
    ratio = paces.ratio
    if len(ratio) < _FEWEST_CHORDS:
        return None
    factor = float(np.median(ratio))
    spread = 1.4826 * float(np.median(np.abs(ratio - factor)))
    error = 1.25 * spread * math.sqrt(2.0 / len(ratio))  # chords overlap by half, so two count as one
    is_same_everywhere = all(
        abs(float(np.median(ratio[part])) - factor) < _ALIKE_SHARE * factor for part in paces.split_by_conditions()
    )
    return factor if is_same_everywhere and factor > max(_LEAST_FACTOR, 1.0 + _SURE_SIGMAS * error) else None


def _collect_paces(log: Log) -> _CommandPaces | None:
    chords = compute_path_chords(log)
    if log.speed_command_mps is None or chords is None:
        return None
    command = log.speed_command_mps[chords.row]
    steady = _measure_steady_time_s(log)[chords.row] >= _STEADY_S
    use = steady & (command > 0.3) & (np.abs(chords.curvature) < _STRAIGHT_PER_M)
    return _CommandPaces(
        chords.speed[use] / command[use], command[use], chords.course[use], log.implement[chords.row][use]
    )


def _measure_steady_time_s(log: Log) -> Array:
    """Return how long (s) the command of each row has been constant, from the start of its segment."""
    assert log.speed_command_mps is not None
    since, out = 0, np.zeros(len(log.time_s))
    for row in range(1, len(out)):
        moved = abs(log.speed_command_mps[row] - log.speed_command_mps[row - 1]) > _SAME_MPS
        if moved or log.segment[row] != log.segment[row - 1] or log.shuttle[row] != log.shuttle[row - 1]:
            since = row
        out[row] = log.time_s[row] - log.time_s[since]
    return out
