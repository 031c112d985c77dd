"""Columns that stand still: an instrument that is off, or one that nobody connected.

A column of one value says nothing where the tractor shows that it should have moved, and is taken as not logged. Where
it is the only steering there is, the log is refused: nothing of the steering could be told from it.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.motion import Motion, motion
from vehicle.measured.logs.record import Array, Log

_TURNED_DEG = 30.0  # of the course: more than wind, drift and noise turn it on a straight drive
_BENT_RAD = math.radians(15.0)  # off one steady bend: no drive along a circle or a line, drift and soil included
_MOVED_DEG = 2.0  # of the other steering column: beyond the noise of a sensor
_PACE_CHANGED = 0.3  # of the median pace, between the slower and the faster tenth of the drive
_FEWEST = 8  # chords


def without_constant(log: Log) -> Log:
    """The log without columns that stand still while the tractor does not; `doubts` say which.

    Raises LogError where the only steering stands still while the path bends.
    """
    chords = motion(log)
    if chords is None or len(chords.row) < _FEWEST:
        return log
    log = _drop(log, "heading_deg", _turned_deg(chords) > _TURNED_DEG, "the path turns")
    course = _course_deg(chords)
    log = _drop(log, "heading_deg", _off_course(log, course), f"the path goes towards {course:.0f} degrees")
    log = _drop(log, "speed_mps", _pace_changes(log, chords), "the tractor's pace changes")
    return _steering(log, chords)


def _drop(log: Log, name: str, contradicted: bool, why: str) -> Log:
    values = getattr(log, name)
    if values is None or not contradicted or not _still(values, log):
        return log
    said = f"{name} is {values[log.used][0]:g} in every row while {why}; it counts as not logged"
    changed: dict[str, Any] = {name: None}
    return replace(log, doubts=(*log.doubts, said), **changed)


def _steering(log: Log, chords: Motion) -> Log:
    bends = _bent_rad(chords) > _BENT_RAD
    for name, other in (("steering_command_deg", "steering_deg"), ("steering_deg", "steering_command_deg")):
        values, rest = getattr(log, name), getattr(log, other)
        if values is None or not _still(values, log):
            continue
        moves = rest is not None and float(np.ptp(rest[log.used])) > _MOVED_DEG
        if moves and (bends or name == "steering_command_deg"):
            return _drop(log, name, True, f"{other} moves")
        if bends and not moves:
            raise LogError(
                f"{log.name}: {name} is {values[log.used][0]:g} in every row while the path bends to both sides, so "
                "nothing of the steering can be told; log the wheel angle or the command."
            )
    return log


def _still(values: Array, log: Log) -> bool:
    return float(np.ptp(values[log.used])) == 0.0


def _turned_deg(chords: Motion) -> float:
    """How far the course leaves its first direction at most, degrees."""
    return float(np.degrees(np.ptp(np.unwrap(chords.course))))


def _course_deg(chords: Motion) -> float:
    """Mean direction of travel, degrees clockwise from north."""
    east, north = float(np.sin(chords.course).sum()), float(np.cos(chords.course).sum())
    return math.degrees(math.atan2(east, north)) % 360.0


def _off_course(log: Log, course_deg: float) -> bool:
    """Whether a heading that stands still is no direction of this drive, read as degrees in any convention."""
    if log.heading_deg is None:
        return False
    heading = float(log.heading_deg[log.used][0])
    readings = (heading, -heading, 90.0 - heading, heading + 180.0)
    return all(abs((one - course_deg + 180.0) % 360.0 - 180.0) > _TURNED_DEG for one in readings)


def _bent_rad(chords: Motion) -> float:
    """How far the course leaves that of one steady bend, from one side to the other."""
    way = np.cumsum(chords.speed) * chords.span_s * 0.5
    course = np.unwrap(chords.course)
    return float(np.ptp(course - np.polyval(np.polyfit(way, course, 1), way)))


def _pace_changes(log: Log, chords: Motion) -> bool:
    """The positions change their pace, or move at all where the sensor says 0."""
    if log.speed_mps is not None and float(np.max(log.speed_mps[log.used])) == 0.0:
        return True
    slow, middle, fast = np.quantile(chords.speed, (0.1, 0.5, 0.9))
    return bool(fast - slow > _PACE_CHANGED * middle)
