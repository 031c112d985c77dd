"""Columns that an instrument holds between measurements, that stay constant, or that are too coarse.

A receiver of 2 Hz shows each position in five rows of a log of 10 Hz. Only the first of them is a measurement; the
others are late by a varying time, which looks like a late receiver or a shifted antenna. They are interpolated to the
next measurement, and `fresh` marks the measured rows: steering and speed are still used from all rows. A constant
column is ignored where the tractor shows that it should have changed; if it is the only steering, a log alone is
refused, and one of a set left out.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.errors import LogError
from vehicle.identification.logs.motion import PathChords, compute_path_chords, has_pace_change
from vehicle.identification.logs.schema import SHORTEST_SEGMENT_S, STEERING_COLUMNS, Columns, Log
from vehicle.identification.logs.series import (
    DIGITS,
    find_changes,
    interpolate_between,
    select_timed_rows,
    wrap_degrees,
)
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    CLEARLY_APART_DEG,
    FEW_SHARE,
    FEWEST_CHORDS,
    FEWEST_EVENTS,
    FEWEST_READINGS,
    MAJORITY,
    MOMENT_S,
    POSITION_NOISE_M,
    STANDING_FACTOR,
    STANDSTILL_MPS,
    STEERING_NOISE_DEG,
    TURNED_DEG,
)

_LEAST_BEND_RAD = math.radians(15.0)  # beyond one steady bend: more than drift and soil add on a circle or a line
_AT_COMMAND_S = 8.0  # chosen: wheels that stand straight by chance do not for so long
_POSITION_COLUMNS = ("easting_m", "northing_m")
COARSEST_POSITION_M = 0.25  # chosen: beyond it no bend shows within 5 s, over which errors are compared
# Chosen: good positions give the course over 5 s more precisely; larger steps are directions of field rows.
COARSE_HEADING_DEG = (1.5, 45.0)
_STEP_TOLERANCE = 0.02  # of a step, by which values may miss it
_UNITS = {"heading_deg": "degrees", "speed_mps": "m/s"}
STANDING_M = 10.0 * POSITION_NOISE_M  # spread of positions of a tractor that stands
_WANDER_M = 5.0  # of a log whose own speed says that it stands: a receiver without corrections wanders this far
_SAME = 2e-3  # chosen, s and m: one digit of rounding; no drive repeats another one this closely


def drop_constant_columns(log: Log) -> Log:
    """Drop columns that are constant although the tractor shows that they should change; `corrections` say which."""
    chords = compute_path_chords(log)
    if chords is None or len(chords.row) < FEWEST_CHORDS:
        return log
    turned_deg = float(np.degrees(np.ptp(np.unwrap(chords.course))))
    log = _drop_constant_column(log, "heading_deg", turned_deg > TURNED_DEG, "the path turns")
    course_deg = math.degrees(cmath.phase(complex(np.exp(1j * chords.course).sum()))) % 360.0
    if log.heading_deg is not None:  # no direction of this drive, in any convention in degrees
        heading = float(log.heading_deg[log.used][0])
        apart = wrap_degrees(np.array([heading, -heading, 90.0 - heading, heading + 180.0]) - course_deg)
        is_off = bool(np.all(np.abs(apart) > TURNED_DEG))
        log = _drop_constant_column(log, "heading_deg", is_off, f"the path runs towards {course_deg:.0f} degrees")
    is_zero = log.speed_mps is not None and float(np.max(log.speed_mps[log.used])) == 0.0  # though positions move
    is_other = is_zero or has_pace_change(chords.speed)
    log = _drop_constant_column(log, "speed_mps", is_other, "the tractor's pace changes")
    has_bends = _measure_bend_course_range_rad(chords) > _LEAST_BEND_RAD
    for name, other_name in (STEERING_COLUMNS, STEERING_COLUMNS[::-1]):
        is_command, other = name == "steering_command_deg", getattr(log, other_name)
        moves = other is not None and float(np.ptp(other[log.used])) > STEERING_NOISE_DEG
        if moves and (has_bends or is_command) and not (is_command and _leaves_command_once(log)):
            log = _drop_constant_column(log, name, True, f"{other_name} moves")
    return log


def _drop_constant_column(log: Log, name: str, contradicted: bool, why: str) -> Log:
    values = getattr(log, name)
    if values is None or not contradicted or float(np.ptp(values[log.used])) != 0.0:
        return log
    message = f"{name} is {values[log.used][0]:g} in every row while {why}; the column is ignored"
    return log.correct_columns(message, **{name: None})


def describe_silent_steering(log: Log) -> str:
    """Return why a log shows nothing about the steering: its only angle is constant while the path bends. Else ""."""
    chords = compute_path_chords(log)
    if chords is None or len(chords.row) < FEWEST_CHORDS:
        return ""
    if _measure_bend_course_range_rad(chords) <= _LEAST_BEND_RAD or _leaves_command_once(log):
        return ""
    columns = {name: getattr(log, name) for name in STEERING_COLUMNS}
    given = {name: values for name, values in columns.items() if values is not None}
    if not given or any(float(np.ptp(values[log.used])) > STEERING_NOISE_DEG for values in given.values()):
        return ""
    constant = [name for name, values in given.items() if float(np.ptp(values[log.used])) == 0.0]
    if not constant:
        return ""
    return (
        f"{log.name}: {constant[0]} is {given[constant[0]][log.used][0]:g} in every row while the path bends to both "
        "sides, so it shows nothing about the steering"
    )


def _leaves_command_once(log: Log) -> bool:
    """Whether the wheels stay at a constant command for seconds and leave it once, as when the steering breaks."""
    if log.steering_deg is None or log.steering_command_deg is None:
        return False
    rows = np.flatnonzero(log.used)
    apart = np.abs(log.steering_deg[rows] - log.steering_command_deg[rows])
    is_apart = apart > STEERING_NOISE_DEG
    leaves = np.flatnonzero(np.diff(is_apart.astype(np.int64)) > 0)
    if is_apart[0] or not len(leaves):
        return False
    clear = float(np.max(apart)) > CLEARLY_APART_DEG
    return clear and float(log.time_s[rows[leaves[0]]] - log.time_s[rows[0]]) > _AT_COMMAND_S and len(leaves) <= 2


def drop_commands_not_logged(logs: Sequence[Log]) -> list[Log]:
    """Drop commands that are constant while the wheels move, where no log of the set has a command that moves."""
    commands = [log.steering_command_deg[log.used] for log in logs if log.steering_command_deg is not None]
    if any(float(np.ptp(values)) > 0.0 for values in commands if len(values)):
        return list(logs)
    return [
        _drop_constant_column(log, "steering_command_deg", _leaves_command_once(log), "steering_deg moves")
        for log in logs
    ]


def _measure_bend_course_range_rad(chords: PathChords) -> float:
    """Return the range (rad) of the course about one steady bend."""
    distance = np.cumsum(chords.speed) * chords.span_s * 0.5
    course = np.unwrap(chords.course)
    return float(np.ptp(course - np.polyval(np.polyfit(distance, course, 1), distance)))


class FreshColumns(NamedTuple):
    """Columns without held values, the measured rows (None: all), and sentences on what was corrected.

    `measured_rows` are those of `easting_m` (and northing) and `heading_deg`, each where it is slower than the log.
    """

    columns: Columns
    fresh: Flags | None = None
    corrections: tuple[str, ...] = ()
    measured_rows: Mapping[str, Flags] = MappingProxyType({})


def interpolate_held_values(columns: Columns, name: str, logged: Columns | None = None) -> FreshColumns:
    """Interpolate positions and headings that a slower instrument held, between its measurements.

    `logged` are the columns before conversion (default: these); only they have the original last digits of degrees.
    Raises LogError for positions that are measured too rarely; such a heading is dropped.
    """
    time, rows = columns["time_s"], select_timed_rows(columns)
    if len(rows) < FEWEST_EVENTS:
        return FreshColumns(columns)
    fresh_sets, converted, doubts = dict[str, Integers](), dict(columns), list[str]()
    position_rows = _find_fresh_rows(np.stack([(logged or columns)[axis][rows] for axis in _POSITION_COLUMNS]))
    if position_rows is not None:
        every_s = float(np.median(np.diff(time[rows][position_rows])))
        if every_s > MOMENT_S:
            raise LogError(f"{name}: its positions change only every {every_s:.2g} s; log them at 1 Hz or faster.")
        fresh_sets["easting_m"] = rows[position_rows]
        doubts.append(_describe_held_values("the positions change", "the receiver", every_s, time[rows]))
        converted |= {axis: interpolate_between(columns[axis], time, rows, position_rows) for axis in _POSITION_COLUMNS}
    heading_rows, fresh_headings = rows, None
    if "heading_deg" in columns:
        heading_rows = rows[np.isfinite(columns["heading_deg"][rows])]
        unwrapped_deg = np.unwrap(columns["heading_deg"][heading_rows], period=360.0)
        fresh_headings = _find_fresh_rows(unwrapped_deg[None])
    if fresh_headings is not None:
        every_s = float(np.median(np.diff(time[heading_rows][fresh_headings])))
        if every_s > MOMENT_S:
            del converted["heading_deg"]
            doubts.append(f"heading_deg changes only every {every_s:.2g} s; the column is ignored")
        else:
            fresh_sets["heading_deg"] = heading_rows[fresh_headings]
            doubts.append(_describe_held_values("heading_deg changes", "the compass", every_s, time[heading_rows]))
            converted["heading_deg"] = np.mod(
                interpolate_between(columns["heading_deg"], time, heading_rows, fresh_headings, unwrapped_deg), 360.0
            )
    if not fresh_sets:
        return FreshColumns(converted, None, tuple(doubts))
    measured_rows = {name: np.isin(np.arange(len(time)), fresh_rows) for name, fresh_rows in fresh_sets.items()}
    fresh = measured_rows[min(fresh_sets, key=lambda name: len(fresh_sets[name]))]
    return FreshColumns(converted, fresh, tuple(doubts), measured_rows)


def _find_fresh_rows(values: Floats) -> Integers | None:
    """Return the indices at which values (c, k) were measured; None where they are not held between measurements."""
    if values.shape[1] < FEWEST_EVENTS:
        return None
    new_rows, count, jumps, is_clear = find_changes(values)
    # A value that stays much longer than usual is a straight drive's heading or a standing tractor's position.
    usual = float(np.median(count[is_clear])) if is_clear.any() else 0.0
    is_held = is_clear & (count >= 2) & (count <= STANDING_FACTOR * usual)
    share = FEW_SHARE if np.count_nonzero(is_clear) >= MAJORITY * len(count) else MAJORITY
    if np.count_nonzero(is_held) < max(FEWEST_EVENTS, share * np.count_nonzero(is_clear)):
        return None
    is_standing = jumps <= STANDING_FACTOR * float(np.median(jumps[is_clear]))
    row_step = max(math.ceil(STANDING_FACTOR * float(np.median(count[is_held]))), 1)
    # Rows between measured ones where the tractor stands; the last one before a change may be only partly held.
    pairs = zip(new_rows[:-1][is_standing], new_rows[1:][is_standing], strict=True)
    return np.unique(np.concatenate([new_rows, *(np.arange(one + row_step, end, row_step)[:-1] for one, end in pairs)]))


def _describe_held_values(what_held: str, instrument: str, every_s: float, time: Floats) -> str:
    row_step_s = float(np.median(np.diff(time)))
    return (
        f"{what_held} only every {every_s:.2g} s while rows are {row_step_s:.2g} s apart: {instrument} is slower "
        "than the log; repeated values are not used"
    )


def drop_coarse_columns(log: Log) -> Log:
    """Drop a coarse heading or speed, told in `corrections`, `coarse_columns`; raises LogError for coarse positions."""
    for name in _POSITION_COLUMNS:
        step = find_rounding_step(_select_measured_values(log, name))
        if step > COARSEST_POSITION_M:
            raise LogError(
                f"{log.name}: {name} comes in steps of {step:.2g} m, too coarse to show how a tractor steers; log "
                "positions with more digits, to 0.01 m or better."
            )
    step = 0.0 if log.heading_deg is None else find_rounding_step(_select_measured_values(log, "heading_deg"))
    if COARSE_HEADING_DEG[0] < step <= COARSE_HEADING_DEG[1]:
        log = _drop_coarse_column(log, "heading_deg", step)
    if log.speed_mps is not None:
        moving = log.speed_mps[log.used & (log.speed_mps > 0.0)]
        # Moving rows only: a tractor that starts and stops abruptly has steps in its speed. Positions give the speed
        # over some seconds more precisely than a tenth of it.
        step = find_rounding_step(moving)
        if len(moving) and step > FEW_SHARE * float(np.median(moving)):
            log = _drop_coarse_column(log, "speed_mps", step)
    return log


def drop_columns_coarse_elsewhere(logs: Sequence[Log]) -> list[Log]:
    """Drop columns that come in the same coarse steps as in another log of the set."""
    coarse = {name: (step, log.name) for log in logs for name, step in log.coarse_columns.items()}
    out = list(logs)
    for name, (step, coarse_log) in coarse.items():
        for place, log in enumerate(out):
            if getattr(log, name) is not None and _is_multiple_of_step(_select_measured_values(log, name), step):
                out[place] = _drop_coarse_column(log, name, step, f", as in {coarse_log}")
    return out


def _select_measured_values(log: Log, name: str) -> Floats:
    """Return the measured values of a column."""
    rows = log.used if log.fresh is None or name == "speed_mps" else log.used & log.fresh
    return np.asarray(getattr(log, name)[rows])


def _drop_coarse_column(log: Log, name: str, step: float, source: str = "") -> Log:
    message = f"{name} comes in steps of {step:.2g} {_UNITS[name]}{source}, too coarse to be of use"
    coarse_columns = {**log.coarse_columns, name: step}
    return log.correct_columns(f"{message}; the column is ignored", coarse_columns=coarse_columns, **{name: None})


def find_rounding_step(values: Floats) -> float:
    """Return the step to which values (k,), row by row, are rounded; 0 where there is none.

    All values are multiples of it, up to one offset, and the number of steps from row to row varies: a constant number
    is an even motion, not rounding.
    """
    apart = np.diff(np.unique(np.round(values, DIGITS)))
    if not len(apart):
        return 0.0
    step = float(apart.min())
    if not _is_multiple_of_step(values, step):
        return 0.0
    uneven = np.count_nonzero(np.diff(np.round(np.diff(values) / step)))
    return step if uneven >= FEWEST_READINGS else 0.0


def _is_multiple_of_step(values: Floats, step: float) -> bool:
    """Whether values (k,) are whole numbers of steps apart; a single value is."""
    steps = np.diff(np.unique(np.round(values, DIGITS))) / step
    return bool((np.abs(steps - np.round(steps)) < _STEP_TOLERANCE).all())


def is_parked(log: Log) -> bool:
    """Whether positions stay within the noise of a receiver, or where the speed says so, within its wander."""
    rows = log.used
    moved = float(np.hypot(np.ptp(log.easting_m[rows]), np.ptp(log.northing_m[rows])))
    seconds = float(np.ptp(log.time_s[rows]))
    if moved == 0.0 or (moved < STANDING_M and seconds >= SHORTEST_SEGMENT_S):
        return True
    stands = log.speed_mps is not None and float(np.max(log.speed_mps[rows])) < STANDSTILL_MPS
    return stands and moved < min(_WANDER_M, STANDSTILL_MPS * seconds)


def leave_out_useless_logs(logs: Sequence[Log]) -> list[Log]:
    """Return the logs that move and show the steering, the first telling of the others; all, where none does."""
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
    """Return each drive once, of those with the same times and positions the longest; `other_names` are the others."""
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
    near = np.searchsorted(longer.time_s[longer_rows], shorter.time_s[rows] - _SAME)
    near_rows = longer_rows[np.minimum(near, len(longer_rows) - 1)]
    is_same = np.abs(longer.time_s[near_rows] - shorter.time_s[rows]) <= _SAME
    for axis in _POSITION_COLUMNS:
        is_same &= np.abs(getattr(longer, axis)[near_rows] - getattr(shorter, axis)[rows]) <= _SAME
    return float(np.mean(is_same)) >= ALMOST_ALL_SHARE
