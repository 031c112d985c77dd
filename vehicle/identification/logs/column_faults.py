"""Columns that freeze and positions that lose their fix during a run, from the raw values before any row is gated.

A frozen column repeats one value much longer than it ever holds one, while another column shows that it should have
changed, or while its noise stopped. A receiver that lost its fix scatters or jumps from row to row as no tractor moves.

Whether the tractor moves, turns and changes its pace is told by the other raw columns: course and pace over chords of a
second or more, as long as the noise of the receiver asks for.

Positions that jump once and stay displaced, by another base station or a receiver that converges anew, are moved back:
replays compare positions with each other inside a segment, and the rows about the jump end it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from fields.arrays import Floats, Integers
from fields.units import name_compass_point
from vehicle.identification.logs.motion import RawMotion, build_raw_motion
from vehicle.identification.logs.schema import ColumnFault, Columns, LogFault, list_gap_rows
from vehicle.identification.logs.series import find_new_rows, find_spans, mark_spans, measure_spread, select_timed_rows
from vehicle.identification.logs.standing_columns import (
    POSITION_FROZEN,
    SPEED_FROZEN,
    STILL_READINGS,
    find_standing_spans,
)
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    FEWEST_EVENTS,
    FEWEST_PARTS,
    FEWEST_ROWS,
    FEWEST_TIMES,
    HOLDS,
    JUMP_M,
    LASTING_S,
    MAJORITY,
    MOMENT_S,
    READING_S,
)

POSITION_LOST, SPEED_THRESHOLD = "position_lost", "speed_threshold"
LOST_WORDS = "the positions scatter or jump as no tractor moves: the receiver lost its fix"

# Chosen: share of rows of nearly any other 3 s in which a noisy value changes, and changes its direction; a value
# without noise does so in hardly any row. A tractor speeds up in a tenth of them; six windows show what is usual, and
# four do beside a standstill of six.
_CALM_SHARE = 0.15

Span = tuple[int, int]  # first and last index of the rows in use

# Chosen, m and m/s2: no clod moves an antenna so far from the middle of its neighbours, and no tractor accelerates so.
_LEAST_ASIDE_M, _LARGEST_ACCELERATION_MPS2 = 0.5 * JUMP_M, 3.0
# Chosen, times the median of a receiver's noise, however poor it is. The median comes from the lowest seventh, as of a
# Rayleigh distribution, because a fix may be lost for most of a log.
_LEAST_NOISES = 8.0
_MEDIAN_OF_QUANTILE = math.sqrt(math.log(0.5) / math.log(1.0 - _CALM_SHARE))
_SAME_FAULT_S = 16.0  # chosen: jumps are one fault up to here from each other
_WANDER_S = 0.5 * READING_S  # in which a tractor turns and brakes little, and a receiver without a fix moves far

POSITION_JUMP = "position_jump"


def find_column_faults(columns: Columns, name: str) -> list[ColumnFault]:
    """Return the faults of positions, heading, speed and wheel angle of the log `name`, in units of the contract."""
    time, rows = columns["time_s"], select_timed_rows(columns)
    if len(rows) < FEWEST_ROWS or not 0.0 < float(np.median(np.diff(time[rows]))) <= 2.0:
        return []
    motion = build_raw_motion(columns, rows)
    # Positions that are far from the middle of their neighbours again and again; a receiver may wander smoothly from
    # row to row, and half a second shows that no tractor drives so.
    near, wide = find_scattered_rows(motion, 1), find_scattered_rows(motion, motion.count_rows(_WANDER_S))
    lost = []
    for group in _group_rows(motion, np.union1d(near, wide)):
        for some in (near, wide):
            own = group[np.isin(group, some)]
            if len(own) >= FEWEST_TIMES and motion.time_s[own[-1]] - motion.time_s[own[0]] >= MOMENT_S:
                is_near_end = motion.time_s[-1] - motion.time_s[group[-1]] < _SAME_FAULT_S
                lost.append((int(group[0]), len(motion.time_s) - 1 if is_near_end else int(group[-1])))
                break
    faults = [_build_fault(name, motion, rows, span, POSITION_LOST, LOST_WORDS) for span in lost]
    found = [] if lost else _find_still_faults(name, motion, rows, "position")
    ends = [np.searchsorted(rows, fault.rows[[0, -1]]) for fault in found]
    motion = motion.without_positions([*lost, *[(int(first), int(last)) for first, last in ends]])
    faults += found
    for column in [column for column in STILL_READINGS if column != "position"]:
        faults += _find_still_faults(name, motion, rows, column, lost)
    # A speed of 0 at a pace at which the sensor never shows any is its threshold, as radars have one.
    words = "speed_mps is 0 while the tractor creeps, slower than its sensor shows"
    for place, one in enumerate(faults):
        if one.fault.id == SPEED_FROZEN and _is_too_slow(motion, np.searchsorted(rows, one.rows)):
            faults[place] = replace(one, fault=replace(one.fault, id=SPEED_THRESHOLD, words=words))
    return faults


def _is_too_slow(motion: RawMotion, inside: Integers) -> bool:
    """Whether a speed of 0 in some rows is at paces below those at which it shows any."""
    assert motion.speed is not None
    shown = motion.pace[(motion.speed > 0.0) & np.isfinite(motion.pace)]
    hidden = motion.pace[inside][np.isfinite(motion.pace[inside])]
    if np.any(motion.speed[inside] > 0.0) or len(shown) < FEWEST_ROWS or not len(hidden):
        return False
    return float(np.quantile(hidden, 0.95)) <= float(np.quantile(shown, 0.05))


def _find_still_faults(
    name: str, motion: RawMotion, rows: Integers, column: str, lost: Sequence[Span] = ()
) -> list[ColumnFault]:
    """Return the spans in which a column repeats one value, and else those in which it stands within its noise. Where
    the fix is lost, positions already wander, and what they say of a column that stands is no evidence."""
    reading = STILL_READINGS[column]
    spans = _find_frozen_spans(motion, column)
    faults = [_build_fault(name, motion, rows, span, reading.fault_id, reading.words) for span in spans]
    for begin, end, shown in find_standing_spans(motion, column):
        if any(begin <= last and first <= end for first, last in [*spans, *lost]):
            continue
        found = _build_fault(name, motion, rows, (begin, end), reading.fault_id, reading.standing_words)
        first_s, shown_s = float(motion.time_s[begin]), float(motion.time_s[shown])
        if shown_s - first_s >= MOMENT_S:  # a column that stands does not show when it began
            fault = replace(found.fault, from_s=0.5 * (first_s + shown_s), between_s=(first_s, shown_s))
            found = replace(found, fault=fault)
        faults.append(found)
    return faults


def _build_fault(name: str, motion: RawMotion, rows: Integers, span: Span, fault_id: str, words: str) -> ColumnFault:
    first, last = span
    end_s = None if last >= len(rows) - 1 - motion.count_rows(READING_S) else float(motion.time_s[last])
    fault = LogFault(fault_id, name, float(motion.time_s[first]), end_s, words)
    return ColumnFault(fault, rows[first : (len(rows) if end_s is None else last + 1)])


def collect_fault_rows(faults: Sequence[ColumnFault]) -> dict[str, Integers]:
    """Return the rows of the faults by the rule that excludes them."""
    rows: dict[str, Integers] = {}
    for column_fault in faults:
        rule = column_fault.fault.rule
        rows[rule] = np.concatenate([rows.get(rule, np.empty(0, dtype=np.int64)), column_fault.rows])
    return rows


# --- one value again and again -----------------------------------------------------------------------------------


def _find_frozen_spans(motion: RawMotion, column: str) -> list[Span]:
    """Return spans in which a column repeats its value although it should have changed."""
    values = motion.get_column(column)
    if values is None:
        return []
    starts = find_new_rows(values)
    ends = np.append(starts[1:], values.shape[1]) - 1
    seconds, moving = motion.measure_spans(starts, ends)
    if np.count_nonzero(moving) < FEWEST_EVENTS:
        return []  # a column of few values, such as the directions of rows, shows no standstill
    usual_s = float(np.quantile(seconds[moving], ALMOST_ALL_SHARE))  # one long hold does not count
    is_long = moving & (seconds >= max(LASTING_S, HOLDS * usual_s))
    is_long &= seconds < ALMOST_ALL_SHARE * motion.total_s
    long_spans = list(zip(starts[is_long].tolist(), ends[is_long].tolist(), strict=True))
    if not long_spans:
        return []
    noisy = column != "position" and _is_noisy_elsewhere(motion, values, long_spans)
    return [span for span in long_spans if noisy or motion.is_contradicted(column, span)]


def _is_noisy_elsewhere(motion: RawMotion, values: Floats, spans: Sequence[Span]) -> bool:
    """Whether the value changes to and fro in every other 3 s of driving, so that a standstill is no steady drive.

    Noise below a digit flips between two values where what is measured lies between them and stands still where it
    does not: only noise beyond one digit counts.
    """
    outside = motion.moving & ~mark_spans(len(motion.moving), spans)
    steps = np.diff(values[0])
    changed, turned = np.zeros(len(outside)), np.zeros(len(outside))
    changed[1:] = steps != 0.0
    digit = np.abs(steps[steps != 0.0]).min()
    turned[1:-1] = (steps[1:] * steps[:-1] < 0.0) & (np.abs(steps[1:] - steps[:-1]) > 2.5 * digit)
    width = motion.count_rows(LASTING_S)
    windows = [
        slice(start, start + width)
        for first, last in find_spans(outside)
        for start in range(first, last - width + 2, width)
    ]
    is_long = max(last - first + 1 for first, last in spans) >= FEWEST_PARTS * width
    if len(windows) < (FEWEST_TIMES if is_long else FEWEST_PARTS) or width < FEWEST_EVENTS:
        return False
    shares = (
        float(np.quantile([np.mean(what[window]) for window in windows], _CALM_SHARE)) for what in (changed, turned)
    )
    return all(share >= least for share, least in zip(shares, (MAJORITY, _CALM_SHARE), strict=True))


# --- a fix that is lost ------------------------------------------------------------------------------------------


def _group_rows(motion: RawMotion, rows: Integers) -> list[Integers]:
    """Return rows in groups of those that are near each other in time."""
    parts = np.split(rows, np.flatnonzero(np.diff(motion.time_s[rows]) > _SAME_FAULT_S) + 1)
    return [part for part in parts if len(part)]


def find_scattered_rows(motion: RawMotion, lag: int) -> Integers:
    """Return the rows whose position is far from the middle of the ones `lag` new positions before and after it.

    A bend that speed and heading show as well is driven, however tight and fast, as by a model car.
    """
    fresh = find_new_rows(motion.positions)
    if len(fresh) < max(FEWEST_ROWS, 4 * lag):
        return np.empty(0, dtype=np.int64)
    time, place = motion.time_s[fresh], motion.positions[:, fresh]
    weight = (time[lag:-lag] - time[: -2 * lag]) / (time[2 * lag :] - time[: -2 * lag])
    middle = place[:, : -2 * lag] + weight * (place[:, 2 * lag :] - place[:, : -2 * lag])
    aside = place[:, lag:-lag] - middle
    apart = np.hypot(*aside)
    step_s = 0.5 * (time[2 * lag :] - time[: -2 * lag])
    usual = _MEDIAN_OF_QUANTILE * float(np.quantile(apart, _CALM_SHARE))
    limit = np.maximum(_LEAST_ASIDE_M + 0.5 * _LARGEST_ACCELERATION_MPS2 * step_s**2, _LEAST_NOISES * usual)
    # Across a gap any bend is far from the middle of its neighbours.
    far = (apart > limit) & (step_s <= 2.5 * float(np.median(step_s)))
    if far.any() and motion.speed is not None and motion.heading is not None:
        heading = np.radians(motion.heading[fresh])
        pace = motion.speed[fresh] * np.array([np.sin(heading), np.cos(heading)])
        steps = 0.5 * (pace[:, 1:] + pace[:, :-1]) * np.diff(time)
        driven = np.concatenate([np.zeros((2, 1)), np.cumsum(steps, axis=1)], axis=1)
        middle = driven[:, : -2 * lag] + weight * (driven[:, 2 * lag :] - driven[:, : -2 * lag])
        shown = driven[:, lag:-lag] - middle
        far &= np.fmin(np.hypot(*(aside - shown)), np.hypot(*(aside + shown))) > limit  # in either gear
    return np.asarray(fresh[lag:-lag][far])


def correct_position_jumps(columns: Columns, name: str) -> tuple[Columns, list[ColumnFault]]:
    """Return the columns (units of the contract) with positions moved back after jumps, and these as faults."""
    time, rows = columns["time_s"], select_timed_rows(columns)
    if len(rows) < 2 * FEWEST_TIMES or not 0.0 < float(np.median(np.diff(time[rows]))) <= READING_S:
        return columns, []
    motion, moved, faults = build_raw_motion(columns, rows), dict(columns), list[ColumnFault]()
    fresh = find_new_rows(motion.positions)
    for group in _group_rows(motion, find_scattered_rows(motion, 1)):
        # Rows on both sides of a step are far from the middle of their neighbours: the step is between them.
        first, last = (int(np.searchsorted(fresh, row)) for row in (group[0], group[-1]))
        size_m = _measure_jump(motion.time_s[fresh], motion.positions[:, fresh], first, last)
        if size_m is None:
            continue
        last_before, first_after = int(rows[fresh[first]]), int(rows[fresh[last]])
        for axis, metres in zip(("easting_m", "northing_m"), size_m, strict=True):
            values = moved[axis].copy()
            values[first_after:] -= metres
            moved[axis] = values
        towards = name_compass_point(math.degrees(math.atan2(size_m[0], size_m[1])))
        words = (
            f"the positions jump by {math.hypot(*size_m):.1f} m to the {towards} and stay there: the receiver "
            "converged anew, or its base station changed"
        )
        fault = LogFault(POSITION_JUMP, name, float(time[first_after]), None, words)
        faults.append(ColumnFault(fault, list_gap_rows(last_before, first_after, len(time))))
    return moved if faults else columns, faults


def join_thaws(jumps: Sequence[ColumnFault], faults: Sequence[ColumnFault]) -> list[ColumnFault]:
    """Return jumps and other faults; a jump at the end of frozen positions belongs to these."""
    left, joined = list(jumps), list[ColumnFault]()
    for one in faults:
        is_frozen, to_s = one.fault.id == POSITION_FROZEN, one.fault.to_s
        thaws = [jump for jump in left if is_frozen and to_s is not None and abs(jump.fault.from_s - to_s) < MOMENT_S]
        left = [jump for jump in left if jump not in thaws]
        joined.append(replace(one, rows=np.unique(np.concatenate([one.rows, *(jump.rows for jump in thaws)]))))
    return [*left, *joined]


def _measure_jump(time: Floats, place: Floats, first: int, last: int) -> Floats | None:
    """Return by how much (2, m) positions are displaced from row `last` on, against rows up to `first`. Straight lines
    through both sides meet in the middle of the step: what bends them is the same on both sides."""
    if time[last] - time[first] > READING_S:
        return None
    middle_s = 0.5 * (time[first] + time[last])
    ends, noises = [], []
    for side in (
        (time <= time[first]) & (time > time[first] - READING_S),
        (time >= time[last]) & (time < time[last] + READING_S),
    ):
        if np.count_nonzero(side) < FEWEST_TIMES:
            return None
        line = np.stack([np.ones(np.count_nonzero(side)), time[side] - middle_s], axis=1)
        theta = np.linalg.lstsq(line, place[:, side].T, rcond=None)[0]
        noises.append(measure_spread(place[:, side].T - line @ theta))
        ends.append(theta[0])
    size_m: Floats = ends[1] - ends[0]
    least = max(JUMP_M, _LEAST_NOISES * max(noises))
    return size_m if float(np.hypot(*size_m)) > least else None
