"""Steering that stops following its commands in logs whose steering columns change only every few seconds.

Such columns say nothing of the time between two readings, but a wheel that stays where it is for reading after reading,
far from commands that differ from each other, does not follow. Gaps between rows do not matter.
"""

from __future__ import annotations

import numpy as np

from vehicle.identification.logs.column_faults import ColumnFault
from vehicle.identification.logs.schema import Array, LogFault, Mask, Rows
from vehicle.identification.logs.table import Columns

STEERING_LOOSE, STEERING_STUCK = "steering_loose", "steering_stuck"
STEERING_WORDS = {
    STEERING_LOOSE: "the wheels do not follow the steering commands",
    STEERING_STUCK: "the wheels run to one side and stay there whatever is commanded",
}

SPARSE_S = 1.0  # chosen: columns that change more often have other checks
_FEWEST_READINGS = 20  # of a log, to show that the wheels usually follow
# Chosen: readings one after the other, how long (s) and how far the wheels move in them.
_FEWEST_STILL, _LEAST_STILL_S, _STILL_DEG = 4, 20.0, 1.5
# Chosen, deg: commands that differ by so much in these readings, and how far the wheels are from most of them.
_COMMANDS_DEG, _APART_DEG, _APART_SHARE = 10.0, 5.0, 0.6
_LEAST_FOLLOWING = 0.7  # correlation of the other readings with their commands
_END_SHARE = 0.9  # chosen, of the largest angle to that side in other readings: the end of the travel
_JOIN_READINGS = 3  # chosen: nearer faults are one
Span = tuple[int, int]  # first and last reading


def find_sparse_steering_faults(columns: Columns, name: str) -> list[ColumnFault]:
    """Return when the wheels of the log `name` stay far from the commands, from sparse columns in units of the
    contract, with the rows; empty for columns that change in most rows."""
    readings = _find_readings(columns)
    if len(readings) < _FEWEST_READINGS:
        return []
    time, command, wheel = (columns[key][readings] for key in ("time_s", "steering_command_deg", "steering_deg"))
    if float(np.median(np.diff(time))) < SPARSE_S:
        return []
    spans = _find_still_spans(time, command, wheel)
    inside = np.zeros(len(readings), dtype=np.bool_)
    for first, last in spans:
        inside[first : last + 1] = True
    if not spans or not _follows(command[~inside], wheel[~inside]):
        return []
    end_s = float(np.nanmax(columns["time_s"]))
    faults = [_build_fault(name, time, wheel, inside, span, end_s) for span in spans]
    return [ColumnFault(fault, _find_fault_rows(columns["time_s"], fault)) for fault in faults]


def _find_fault_rows(time: Array, fault: LogFault) -> Rows:
    from_s = fault.from_s if fault.between_s is None else fault.between_s[0]
    return np.flatnonzero((time > from_s) & (time <= (np.inf if fault.to_s is None else fault.to_s)))


def _find_readings(columns: Columns) -> Rows:
    """Return the rows in which a steering column has a new value, where both are known."""
    if "steering_command_deg" not in columns or "steering_deg" not in columns:
        return np.empty(0, dtype=np.int64)
    values = np.stack([columns[key] for key in ("time_s", "steering_command_deg", "steering_deg")])
    rows = np.flatnonzero(np.isfinite(values).all(axis=0))
    rows = rows[np.append(True, np.diff(values[0, rows]) > 0.0)] if len(rows) else rows
    changes = (np.diff(values[1:, rows], axis=1) != 0.0).any(axis=0)
    return rows[np.append(True, changes)] if len(rows) else rows


def _find_still_spans(time: Array, command: Array, wheel: Array) -> list[Span]:
    """Return spans of readings (k,) in which the wheels stay, far from commands that differ; near ones as one."""
    spans: list[Span] = []
    first = 0
    while first + _FEWEST_STILL <= len(wheel):
        apart_from_first = np.abs(wheel[first:] - wheel[first]) > _STILL_DEG
        count = int(np.argmax(apart_from_first)) if apart_from_first.any() else len(wheel) - first
        part = slice(first, first + count)
        is_fault = (
            count >= _FEWEST_STILL
            and abs(command[first] - wheel[first]) > _APART_DEG
            and time[first + count - 1] - time[first] >= _LEAST_STILL_S
            and float(np.ptp(command[part])) > _COMMANDS_DEG
            and float(np.mean(np.abs(command[part] - wheel[part]) > _APART_DEG)) >= _APART_SHARE
        )
        if is_fault:
            if spans and first - spans[-1][1] <= _JOIN_READINGS:
                spans[-1] = spans[-1][0], first + count - 1
            else:
                spans.append((first, first + count - 1))
        first += count if is_fault else 1
    return spans


def _follows(command: Array, wheel: Array) -> bool:
    if len(wheel) < _FEWEST_READINGS or np.std(command) == 0.0 or np.std(wheel) == 0.0:
        return False
    return float(np.corrcoef(command, wheel)[0, 1]) > _LEAST_FOLLOWING


def _build_fault(name: str, time: Array, wheel: Array, inside: Mask, span: Span, end_s: float) -> LogFault:
    """Build a fault: it began between the last reading that followed and the first that did not."""
    first, last = span
    # Commands near the angle at which the wheels stay look followed.
    away = np.flatnonzero(np.abs(wheel[:first] - wheel[first]) > _STILL_DEG)
    before_s, shown_s = float(time[away[-1] if len(away) else 0]), float(time[first])
    angle = float(np.median(wheel[first : first + _FEWEST_STILL]))
    others = np.sign(angle) * wheel[~inside]
    is_at_end = abs(angle) > _END_SHARE * float(np.quantile(others, 0.99))
    fault_id = STEERING_STUCK if is_at_end else STEERING_LOOSE
    to_s = None if last == len(time) - 1 else float(time[last])
    if to_s is not None and end_s - to_s < float(np.median(np.diff(time))):
        to_s = None
    return LogFault(
        fault_id, name, 0.5 * (before_s + shown_s), to_s, STEERING_WORDS[fault_id], between_s=(before_s, shown_s)
    )
