"""A commanded speed that is not what was driven: told in words, so that it does not pass for slip.

Wheels that slip lose speed. A tractor that is faster than commanded by one factor, whichever way, however fast and
whether it works or not, was commanded by another number than the log has; and one that changes its pace while the
command stands still was not driven by it. A factor the other way looks like slip in every column and stays one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.effects import OF_ANY_DRIVE_LINE
from vehicle.measured.logs.motion import motion
from vehicle.measured.logs.record import Array, Log, Mask

_LEAST_FACTOR, _SURE, _ALIKE = 1.0 + OF_ANY_DRIVE_LINE, 5.0, 0.03  # the first as of the speed sensor
_STRAIGHT_PER_M = 0.03  # in bends the antenna is faster than the tractor
_STEADY_S, _SAME_MPS = 6.0, 0.02  # of the command before: longer than any drive line takes
_PACE_CHANGED = 0.3  # of the median pace, between the slower and the faster tenth of the drive
_FEWEST = 12  # chords


def commands_set_right(logs: Sequence[Log]) -> list[Log]:
    """Logs of a set with commanded speeds that were not driven left out or multiplied; `doubts` say which and why."""
    alone = [_without_still(log) for log in logs]
    return _multiplied([_as_still(log, alone) for log in alone])


def _said(log: Log) -> str | None:
    """How a command that is one value throughout is told; None where it is not."""
    values = log.speed_command_mps
    if values is None or not log.used.any() or float(np.ptp(values[log.used])) > 0.0:
        return None
    return f"speed_command_mps is {values[log.used][0]:g} in every row"


def _without_still(log: Log) -> Log:
    said, chords = _said(log), motion(log)
    if said is None or chords is None:
        return log
    begun = np.array([log.time_s[log.segment == number][0] for number in range(log.segments)])
    under_way = log.time_s[chords.row] - begun[log.segment[chords.row]] > _STEADY_S
    for working in (0.0, 1.0):
        pace = chords.speed[under_way & (log.implement[chords.row] == working)]
        if len(pace) >= _FEWEST and _changes(pace):
            return _left_out(log, f"{said} while the tractor's pace changes")
    return log


def _changes(pace: Array) -> bool:
    slow, middle, fast = np.quantile(pace, (0.1, 0.5, 0.9))
    return bool(fast - slow > _PACE_CHANGED * middle)


def _as_still(log: Log, others: Sequence[Log]) -> Log:
    """A log without its command where that is the one value that stood still in another log."""
    said = _said(log)
    other = next((one for one in others if said and any(doubt.startswith(said) for doubt in one.doubts)), None)
    return log if other is None else _left_out(log, f"{said}, as in {other.name}")


def _left_out(log: Log, why: str) -> Log:
    told = f"{why}: not what was driven; it counts as not logged"
    return replace(log, speed_command_mps=None, doubts=(*log.doubts, told))


@dataclass(frozen=True, eq=False)
class _Paces:
    """Chords driven straight under a steady command: pace over command, command, course and implement, each (k,)."""

    ratio: Array
    command: Array
    course: Array
    working: Array

    def parts(self) -> list[Mask]:
        """Chords by direction of travel, by implement and by speed, those parts that hold enough."""
        east, north, slow = np.sin(self.course), np.cos(self.course), self.command <= np.median(self.command)
        parts = [east > 0.5, east < -0.5, north > 0.5, north < -0.5, slow, ~slow]
        parts += [self.working > 0.5, self.working <= 0.5]
        return [part for part in parts if np.count_nonzero(part) >= _FEWEST]


def _multiplied(logs: list[Log]) -> list[Log]:
    """Logs with their commands multiplied by the factor that all of them are driven faster by, if there is one."""
    driven = [one for log in logs if (one := _paces(log)) is not None]
    if not driven:
        return logs
    columns = (np.concatenate([getattr(one, name) for one in driven]) for name in _Paces.__annotations__)
    factor = _factor(_Paces(*columns))
    if factor is None:
        return logs
    told = (
        f"the tractor drives {100.0 * (factor - 1.0):.0f} % faster than speed_command_mps, alike in every direction, "
        f"at every speed, working or not: not what was commanded, no slip; it is multiplied by {factor:.3f}"
    )
    return [
        log if log.speed_command_mps is None
        else replace(log, speed_command_mps=factor * log.speed_command_mps, doubts=(*log.doubts, told))
        for log in logs
    ]  # fmt: skip


def _factor(paces: _Paces) -> float | None:
    """What the pace is of the command; None where it is not faster for certain, or not alike in all parts."""
    ratio = paces.ratio
    if len(ratio) < _FEWEST:
        return None
    factor = float(np.median(ratio))
    spread = 1.4826 * float(np.median(np.abs(ratio - factor)))
    error = 1.25 * spread * math.sqrt(2.0 / len(ratio))  # chords overlap by half: two of them are one observation
    same = all(abs(float(np.median(ratio[part])) - factor) < _ALIKE * factor for part in paces.parts())
    return factor if same and factor > max(_LEAST_FACTOR, 1.0 + _SURE * error) else None


def _paces(log: Log) -> _Paces | None:
    chords = motion(log)
    if log.speed_command_mps is None or chords is None:
        return None
    command = log.speed_command_mps[chords.row]
    steady = _steady_s(log)[chords.row] >= _STEADY_S
    use = steady & (command > 0.3) & (np.abs(chords.curvature) < _STRAIGHT_PER_M)
    return _Paces(
        chords.speed[use] / command[use], command[use], chords.course[use], log.implement[chords.row][use]
    )


def _steady_s(log: Log) -> Array:
    """For how long the command of each row has been what it is (s), counted from the start of its segment."""
    assert log.speed_command_mps is not None
    since, out = 0, np.zeros(len(log.time_s))
    for row in range(1, len(out)):
        moved = abs(log.speed_command_mps[row] - log.speed_command_mps[row - 1]) > _SAME_MPS
        if moved or log.segment[row] != log.segment[row - 1] or log.shuttle[row] != log.shuttle[row - 1]:
            since = row
        out[row] = log.time_s[row] - log.time_s[since]
    return out
