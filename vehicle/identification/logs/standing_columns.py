"""Columns that stand within their noise while the others show that they should have changed.

A receiver or a bus that freezes may add noise to the value it repeats. What stands is told by the means of seconds, and
that it should not by the other columns: a speed that drives away from positions, a course that leaves a heading, a pace
that leaves a speed. A tractor that stands or drives straight contradicts none of them.

Steering columns may change only every few seconds and say nothing of the time between two readings; but a wheel that
stays where it is for reading after reading, far from commands that differ from each other, does not follow.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.logs.motion import LEAST_TURN_DEG, PACE_CHANGE_MPS, RawMotion
from vehicle.identification.logs.schema import STEERING_COLUMNS, ColumnFault, Columns, LogFault
from vehicle.identification.logs.series import find_new_rows, mark_spans, measure_noise
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    ALMOST_ALL_SHARE,
    CLEAR_CORRELATION,
    CLEAR_SIGMAS,
    CLEARLY_APART_DEG,
    FEWEST_EVENTS,
    FEWEST_READINGS,
    FEWEST_TIMES,
    HOLDS,
    LASTING_S,
    MAJORITY,
    MOMENT_S,
    MOST_SHARE,
    MOVING_MPS,
    NEARLY_SHARE,
    READING_S,
    STEERING_SPREAD_DEG,
    WINDOW_S,
)

POSITION_FROZEN, HEADING_FROZEN = "position_frozen", "heading_frozen"
SPEED_FROZEN, WHEEL_SENSOR_FROZEN = "speed_frozen", "wheel_sensor_frozen"

_LEAST_STANDING_S = 2.0 * LASTING_S  # of a standstill
_NOISE_ERRORS = 2.0 * CLEAR_SIGMAS  # by which means of a value that stands may differ, up and down
_LEAST_DRIVEN_M = 5.0  # chosen: a speed sensor drives so far while positions stay
_LEAST_SPEED_MPS = 1.0  # chosen: a pace that no sensor shows at rest
# Chosen, deg: an antenna swings by half of this. From LEAST_TURN_DEG on a heading is doubted.
_COURSE_APART_DEG = 20.0
_STOPPED_MPS = 0.5 * MOVING_MPS  # a pace that is a halt

_Shown = tuple[int, int, int] | None

STEERING_LOOSE, STEERING_STUCK = "steering_loose", "steering_stuck"
STEERING_WORDS = {
    STEERING_LOOSE: "the wheels do not follow the steering commands",
    STEERING_STUCK: "the wheels run to one side and stay there whatever is commanded",
}

Span = tuple[int, int]  # first and last reading


@dataclass(frozen=True, eq=False)
class _Blocks:
    """Means over seconds (n,): times, and speed, target, pace (m/s), heading, heading minus course (deg, folded so that
    gears do not matter), NaN where not known."""

    time_s: Floats
    speed: Floats
    target: Floats
    pace: Floats
    heading: Floats
    apart: Floats


def find_standing_spans(motion: RawMotion, column: str) -> list[tuple[int, int, int]]:
    """Return the spans in which position, heading or speed stands within its noise although others change: first and
    last row, and the first row in which others show it."""
    values = motion.get_column(column)
    reading = STILL_READINGS[column]
    if values is None or reading.check is None:
        return []
    if column == "heading":
        values = np.degrees(np.unwrap(np.radians(values)))
    # The first row of each second that has rows, and how far means of a value that stands may be from each other.
    starts = np.append(0, np.flatnonzero(np.diff(np.floor((motion.time_s - motion.time_s[0]) / READING_S)) > 0.0) + 1)
    limit = reading.wanders + _NOISE_ERRORS * measure_noise(values) / math.sqrt(motion.count_rows(READING_S))
    changes = np.flatnonzero((np.diff(values, axis=1) != 0.0).any(axis=0) & motion.moving[1:])
    gaps_s = np.diff(motion.time_s[changes])
    hold_s = float(np.quantile(gaps_s, ALMOST_ALL_SHARE)) if len(gaps_s) else math.inf
    if len(starts) < FEWEST_READINGS or limit > reading.most:
        return []
    none = np.full(len(motion.time_s), np.nan)
    speed, target = (none if own is None else own for own in (motion.speed, motion.target))
    heading, folded = none, none
    if motion.heading is not None:
        heading = np.degrees(np.unwrap(np.radians(motion.heading)))
        folded = np.exp(2j * (np.radians(heading) - motion.course))
    apart = 0.5 * np.degrees(np.angle(_average(folded, starts)))
    speed, target, pace, heading = (_average(own, starts) for own in (speed, target, motion.pace, heading))
    blocks = _Blocks(motion.time_s[starts], speed, target, pace, heading, apart)
    means = np.stack([_average(axis, starts) for axis in values])
    found = list[tuple[int, int, int]]()
    for first, last in _list_still_blocks(means, blocks.time_s, limit, max(_LEAST_STANDING_S, HOLDS * hold_s)):
        if blocks.time_s[last] - blocks.time_s[first] > ALMOST_ALL_SHARE * motion.total_s:
            continue
        shown = reading.check(blocks, first, last)
        if shown is not None:
            edges = np.append(starts, values.shape[1])
            begin, limit_row = int(edges[max(shown[0] - 1, 0)]), int(edges[min(shown[1] + 2, len(edges) - 1)])
            begins, end = int(edges[shown[0]]), int(edges[shown[1] + 1])
            level = np.median(values[:, begins:end], axis=1)[:, None]
            moves: Flags = np.max(np.abs(values - level), axis=0) > limit
            before, after = np.flatnonzero(moves[begin:begins]), np.flatnonzero(moves[end:limit_row])
            start = begin + (int(before[-1]) + 1 if len(before) else 0)
            stop = end + int(after[0]) if len(after) else limit_row
            found.append((start, stop - 1, start if shown[2] == shown[0] else int(edges[shown[2]])))
    return sorted(found)


def _average(values: Floats, starts: Integers) -> Floats:
    counts = np.diff(np.append(starts, len(values)))
    return np.asarray(np.add.reduceat(values, starts) / counts)


def _list_still_blocks(means: Floats, time: Floats, limit: float, least_s: float) -> list[tuple[int, int]]:
    """Return spans of blocks whose means (c, n) are no further apart than a limit, the longest first, none twice."""
    ends, last = np.zeros(len(time), dtype=np.int64), 0
    for first in range(len(time)):
        last = max(last, first)
        while last + 1 < len(time) and float(np.max(np.ptp(means[:, first : last + 2], axis=1))) <= limit:
            last += 1
        ends[first] = last
    taken, spans = np.zeros(len(time), dtype=np.bool_), list[tuple[int, int]]()
    for first in np.argsort(time - time[ends], kind="stable").tolist():
        free = np.flatnonzero(taken[first : ends[first] + 1])
        end = int(ends[first] if not len(free) else first + free[0] - 1)
        if end > first and time[end] - time[first] >= least_s:
            taken[first : end + 1] = True
            spans.append((first, end))
    return spans


# --- what contradicts a column that stands: each returns its first and last block, and the first that shows it --------


def _check_position(blocks: _Blocks, first: int, last: int) -> _Shown:
    """Positions stay while a measured speed that agrees with them elsewhere drives on, and something else says so."""
    part = slice(first, last + 1)
    driven = np.flatnonzero(blocks.speed[part] > MOVING_MPS)
    if not len(driven) or not _agrees_outside(blocks, first, last):
        return None
    first, last = first + int(driven[0]), first + int(driven[-1])
    part = slice(first, last + 1)
    seconds = np.diff(blocks.time_s[first : last + 1])
    if float(np.sum(np.minimum(seconds, 2.0 * READING_S) * blocks.speed[first:last])) < _LEAST_DRIVEN_M:
        return None
    speed, target = blocks.speed[part], blocks.target[part]
    moving = speed > MOVING_MPS
    if np.isfinite(target).all():
        is_driven = float(np.mean(target[moving] > MOVING_MPS)) >= MOST_SHARE
    else:
        turns = np.isfinite(blocks.heading[part]).all() and float(np.ptp(blocks.heading[part])) > LEAST_TURN_DEG
        is_fast = float(np.median(speed)) > _LEAST_SPEED_MPS and float(np.ptp(speed)) > PACE_CHANGE_MPS
        is_driven = float(np.mean(moving)) >= MOST_SHARE and (turns or is_fast)
    return (first, last, first) if is_driven else None


def _agrees_outside(blocks: _Blocks, first: int, last: int) -> bool:
    """Whether speed and pace are alike in most of the blocks of driving outside a span."""
    outside = (
        ~mark_spans(len(blocks.pace), [(max(first - 1, 0), last + 1)])
        & np.isfinite(blocks.pace)
        & np.isfinite(blocks.speed)
    )
    pace, speed = blocks.pace[outside], blocks.speed[outside]
    driven = np.maximum(pace, speed) > MOVING_MPS
    if np.count_nonzero(driven) < FEWEST_EVENTS:
        return False
    return float(np.mean(~_is_other_pace(pace, speed)[driven])) >= MOST_SHARE


def _is_other_pace(pace: Floats, speed: Floats) -> Flags:
    return np.asarray(np.abs(pace - speed) > np.maximum(PACE_CHANGE_MPS, ALIKE_SHARE * speed))


def _check_heading(blocks: _Blocks, first: int, last: int) -> _Shown:
    """A heading stays while the course leaves it, which it follows elsewhere."""
    outside = ~mark_spans(len(blocks.apart), [(max(first - 1, 0), last + 1)]) & np.isfinite(blocks.apart)
    if np.count_nonzero(outside) < FEWEST_EVENTS:
        return None
    folded = np.exp(2j * np.radians(blocks.apart))
    middle = complex(np.median(folded[outside].real), np.median(folded[outside].imag))
    apart = np.abs(0.5 * np.degrees(np.angle(folded * np.conj(middle))))
    if float(np.median(apart[outside])) > 0.5 * _COURSE_APART_DEG:
        return None
    left = np.abs(0.5 * np.degrees(np.angle(folded * np.conj(folded[first]))))  # a crab's course stays as it is
    with np.errstate(invalid="ignore"):
        far = np.minimum(apart, left)[first : last + 1] > _COURSE_APART_DEG
        if np.count_nonzero(far) * READING_S < LASTING_S:
            return None
        doubted = np.flatnonzero(apart[first : last + 1] > LEAST_TURN_DEG)
    return first, last, first + int(doubted[0])


def _check_speed(blocks: _Blocks, first: int, last: int) -> _Shown:
    """A speed stays while the tractor stops and goes on, drives faster, or drives at the pace of another target."""
    part = slice(first, last + 1)
    speed, pace, target = float(np.mean(blocks.speed[part])), blocks.pace[part], blocks.target[part]
    other = _is_other_pace(pace, np.full(len(pace), speed))
    shown = first + int(np.argmax(other))
    if speed < PACE_CHANGE_MPS or not other.any() or not _agrees_outside(blocks, shown, last):
        return None
    moving = pace > MOVING_MPS
    other &= _is_other_pace(pace, np.full(len(pace), pace[0]))  # a sensor that reads low does so from the start
    targeted = other & moving & (np.abs(pace - target) < 0.5 * np.abs(pace - speed))
    faster = other & (pace > speed)
    is_other = bool(max(np.count_nonzero(faster), np.count_nonzero(targeted)) * READING_S >= LASTING_S)
    # A tractor that moves stops as it is told to, and moves again; positions that freeze look like it.
    halts = np.flatnonzero(pace < _STOPPED_MPS)
    if not is_other and len(halts) * READING_S >= MOMENT_S:
        goes_on = moving[: halts[0]].any() and moving[halts[0] :].any()
        is_other = bool(goes_on) and float(np.mean(target[halts] < MOVING_MPS)) > 0.5
    return (first, last, shown) if is_other else None


class StillReading(NamedTuple):
    """A column that may stand still: id and words of the fault, for one value and for one but for its noise; what else
    shows that it should not; and how far means of a value that stands may differ.

    They differ by what `wanders` slowly in the column (chosen: m, deg, m/s) and by its noise; more than `most` is no
    standstill that could be told. A column without a check stands by repeating a value only.
    """

    fault_id: str
    words: str
    standing_words: str = ""
    check: Callable[[_Blocks, int, int], _Shown] | None = None
    wanders: float = 0.0
    most: float = 0.0


STILL_READINGS = {
    "position": StillReading(
        POSITION_FROZEN,
        "the positions repeat one value while the tractor drives",
        "the positions stay at one place but for their noise while the tractor drives",
        _check_position, 0.1, 0.3,
    ),
    "heading": StillReading(
        HEADING_FROZEN,
        "heading_deg repeats one value while the tractor turns",
        "heading_deg stays at one value but for its noise while the tractor turns",
        _check_heading, 0.5, 3.0,
    ),
    "speed": StillReading(
        SPEED_FROZEN,
        "speed_mps repeats one value while the tractor drives on",
        "speed_mps stays at one value but for its noise while the tractor drives on at others",
        _check_speed, 0.03, 0.2,
    ),
    "wheel": StillReading(WHEEL_SENSOR_FROZEN, "steering_deg repeats one value while the tractor steers on"),
}  # fmt: skip
"""A fault of a further column is one more entry, and what contradicts it one more case of RawMotion."""


def find_sparse_steering_faults(columns: Columns, name: str) -> list[ColumnFault]:
    """Return when the wheels of the log `name` stay far from the commands, from sparse columns in units of the
    contract, with the rows; empty for columns that change in most rows."""
    names = ("time_s", *STEERING_COLUMNS)
    if not all(name in columns for name in names):
        return []
    values = np.stack([columns[key] for key in names])
    rows = np.flatnonzero(np.isfinite(values).all(axis=0))
    rows = rows[np.append(True, np.diff(values[0, rows]) > 0.0)] if len(rows) else rows
    readings = rows[find_new_rows(values[1:, rows])] if len(rows) else rows  # a steering column has a new value
    if len(readings) < FEWEST_READINGS:
        return []
    time, command, wheel = values[:, readings]
    if float(np.median(np.diff(time))) < READING_S:
        return []
    spans = _find_still_spans(time, command, wheel)
    inside = mark_spans(len(readings), spans)
    others = np.stack([command[~inside], wheel[~inside]])
    if not spans or others.shape[1] < FEWEST_READINGS or (np.std(others, axis=1) == 0.0).any():
        return []
    if float(np.corrcoef(others[0], others[1])[0, 1]) <= CLEAR_CORRELATION:
        return []
    every_s = columns["time_s"]
    found, end_s = [], float(np.nanmax(every_s))
    for first, last in spans:
        # It began between the last reading that followed and the first that did not. Commands near the angle at which
        # the wheels stay look followed.
        away = np.flatnonzero(np.abs(wheel[:first] - wheel[first]) > STEERING_SPREAD_DEG)
        before_s, shown_s = float(time[away[-1] if len(away) else 0]), float(time[first])
        angle = float(np.median(wheel[first : first + FEWEST_TIMES]))
        is_at_end = abs(angle) > NEARLY_SHARE * float(np.quantile(np.sign(angle) * wheel[~inside], 0.99))
        fault_id = STEERING_STUCK if is_at_end else STEERING_LOOSE
        to_s = None if last == len(time) - 1 else float(time[last])
        if to_s is not None and end_s - to_s < float(np.median(np.diff(time))):
            to_s = None
        words, from_s = STEERING_WORDS[fault_id], 0.5 * (before_s + shown_s)
        fault = LogFault(fault_id, name, from_s, to_s, words, between_s=(before_s, shown_s))
        bad = (every_s > before_s) & (every_s <= (np.inf if to_s is None else to_s))
        found.append(ColumnFault(fault, np.flatnonzero(bad)))
    return found


def _find_still_spans(time: Floats, command: Floats, wheel: Floats) -> list[Span]:
    """Return spans of readings (k,) in which the wheels stay, far from commands that differ; near ones as one."""
    spans: list[Span] = []
    first = 0
    while first + FEWEST_TIMES <= len(wheel):
        apart_from_first = np.abs(wheel[first:] - wheel[first]) > STEERING_SPREAD_DEG
        count = int(np.argmax(apart_from_first)) if apart_from_first.any() else len(wheel) - first
        part = slice(first, first + count)
        is_fault = (
            count >= FEWEST_TIMES
            and abs(command[first] - wheel[first]) > CLEARLY_APART_DEG
            and time[first + count - 1] - time[first] >= 2.0 * WINDOW_S
            and float(np.ptp(command[part])) > 2.0 * CLEARLY_APART_DEG
            and float(np.mean(np.abs(command[part] - wheel[part]) > CLEARLY_APART_DEG)) >= MAJORITY
        )
        if is_fault:
            if spans and first - spans[-1][1] <= FEWEST_TIMES:
                spans[-1] = spans[-1][0], first + count - 1
            else:
                spans.append((first, first + count - 1))
        first += count if is_fault else 1
    return spans
