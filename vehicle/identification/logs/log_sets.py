"""Logs of one set held against each other: those that show nothing, and copies of one drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vehicle.identification.logs.column_quality import describe_silent_steering
from vehicle.identification.logs.schema import SHORTEST_SEGMENT_S, Log

STANDING_M = 0.3  # spread of antenna noise
# Of a log whose own speed says that it stands: a receiver without corrections wanders this far, m, and no faster, m/s.
_WANDER_M, _STANDING_MPS = 5.0, 0.1
_COPY_SHARE = 0.95  # chosen, of the rows of the shorter log: a copy may be cut or have a few damaged rows
_SAME_S, _SAME_M = 2e-3, 2e-3  # chosen: one digit of rounding; no drive repeats another one this closely


def is_parked(log: Log) -> bool:
    """Whether the tractor stands all the time: its positions stay within the noise of a receiver.

    A receiver without corrections wanders by metres; such a log is parked if its own speed says so.
    """
    rows = log.used
    moved = float(np.hypot(np.ptp(log.easting_m[rows]), np.ptp(log.northing_m[rows])))
    seconds = float(np.ptp(log.time_s[rows]))
    if moved == 0.0 or (moved < STANDING_M and seconds >= SHORTEST_SEGMENT_S):
        return True
    stands = log.speed_mps is not None and float(np.max(log.speed_mps[rows])) < _STANDING_MPS
    return stands and moved < min(_WANDER_M, _STANDING_MPS * seconds)


def leave_out_useless_logs(logs: Sequence[Log]) -> list[Log]:
    """Return the logs that move and show the steering; the first of them says which were left out, and why.

    All logs where no other is left: they are refused with their reason.
    """
    parked = [log for log in logs if is_parked(log)]
    names = {log.name for log in parked}
    silent = {log.name: words for log in logs if log.name not in names and (words := describe_silent_steering(log))}
    kept = [log for log in logs if log.name not in names | silent.keys()]
    if not kept or len(kept) == len(logs):
        return list(logs)
    were = "it was" if len(parked) == 1 else "they were"
    remarks = [f"{', '.join(log.name for log in parked)}: the tractor never moves, so {were} left out."] * bool(parked)
    remarks += [f"{words}; it was left out." for words in silent.values()]
    return [replace(kept[0], set_remarks=(*kept[0].set_remarks, *remarks)), *kept[1:]]


def merge_copies(logs: Sequence[Log]) -> list[Log]:
    """Return each drive once; `other_names` of the log that is used name its copies.

    A copy has the same times and positions, whatever its name and its other columns; the longer one is used.
    """
    used: list[Log] = []
    for log in logs:
        place = next((place for place, other in enumerate(used) if _is_same_drive(log, other)), None)
        if place is None:
            used.append(log)
            continue
        first = used[place]
        longer, shorter = (log, first) if len(log.time_s) > len(first.time_s) else (first, log)
        names = (*longer.other_names, shorter.name, *shorter.other_names)
        used[place] = replace(longer, other_names=names, set_remarks=(*first.set_remarks, *log.set_remarks))
    return used


def _is_same_drive(log: Log, other: Log) -> bool:
    """Whether nearly all rows of the shorter log are in the longer one: same time, same place."""
    shorter, longer = sorted((log, other), key=lambda one: one.rows_used)
    rows, longer_rows = np.flatnonzero(shorter.used), np.flatnonzero(longer.used)
    near = np.searchsorted(longer.time_s[longer_rows], shorter.time_s[rows] - _SAME_S)
    near_rows = longer_rows[np.minimum(near, len(longer_rows) - 1)]
    is_same = np.abs(longer.time_s[near_rows] - shorter.time_s[rows]) <= _SAME_S
    for axis in ("easting_m", "northing_m"):
        is_same &= np.abs(getattr(longer, axis)[near_rows] - getattr(shorter, axis)[rows]) <= _SAME_M
    return float(np.mean(is_same)) >= _COPY_SHARE
