"""What rows of logs say of the steering: the angles that commands allow, and the angle that the path needs.

Commands allow every angle between that of an immediate steering and that of one slower than any fault of the catalogue
makes it; the path needs an angle by its curvature, on the scale of the angles of the whole set of logs.

Headings that jump once and stay off, of an instrument that was reset or turned on its mount, are turned back: no
tractor turns so far between two rows, and the course over ground shows that it did not.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.logs.schema import (
    Array,
    Log,
    LogFault,
    Rows,
    list_gap_rows,
)
from vehicle.identification.logs.series import compute_change, measure_spread, wrap_degrees
from vehicle.identification.logs.thresholds import (
    ALMOST_ALL_SHARE,
    CLEAR_CORRELATION,
    CLEAR_SIGMAS,
    FEWEST_LINE_ROWS,
    LOCK_QUANTILE,
    MAJORITY,
    MOMENT_S,
    PART_S,
    PATH_MPS,
    STEADY_SHARE,
    STEERING_SPREAD_DEG,
    WINDOW_S,
)
from vehicle.jit import compile_function

STEP_S = 0.1  # chosen: of the grid on which evidence is compared
# Late (s), rate (deg/s) and lag (s). As the simulation steers by default, later by what valves usually are; a middling
# one, as where commands swing to and fro it is not always between an immediate and a slow one; and slower than any
# steering of the catalogue (0.25 s late, 9 deg/s, and clocks of two columns).
STEERINGS = ((0.1, 16.0, 0.15), (0.3, 9.0, 0.3), (0.6, 5.0, 0.6))
EITHER_WAY_S = 0.6  # chosen: clocks of two columns are so far apart at most, with what stands still in them
TURN_S = 1.0  # over which curvature is taken
COURSE_TURN_S = 2.0  # chosen: the course of the antenna is noisier
_HISTORY_S = 8.0  # chosen: until wheels have followed any command
_MOST_HOLD_S = 20.0  # chosen: columns that change more rarely show no fault
_PASSES = 6


@dataclass(frozen=True, eq=False)
class SteeringEvidence:
    """One segment of a log on an even grid (k,), angles in degrees to the right, NaN where a value is not known.

    `low` and `high` bound the angle that commands (or, without them, the sensor) allow, `usual` is that of a usual
    steering; `pace` in m/s, `curvature` in 1/m to the right; `hold_s` is how rarely a steering column changes, 0 where
    it does so in its rows. Curvature is `by_heading`, or by the course of the antenna, which swings ahead of the axle;
    `course_curvature` is that of the course in both cases, and `heading_error` (deg) is heading minus course within
    half a circle; NaN without a heading.
    """

    time_s: Array
    pace: Array
    curvature: Array
    command: Array | None
    wheel: Array | None
    low: Array
    high: Array
    usual: Array
    hold_s: float
    by_heading: bool
    course_curvature: Array
    heading_error: Array


@dataclass(frozen=True)
class PathScale:
    """Curvature (1/m) per degree of the wheels and at 0, and the scatter of the angle needed (deg), of many logs."""

    per_degree: float
    at_zero: float
    sigma_deg: float

    def compute_needed_angle(self, curvature: Array) -> Array:
        """Return the wheel angle (deg) that a curvature needs."""
        return (curvature - self.at_zero) / self.per_degree


def find_largest_angles(logs: Sequence[Log]) -> tuple[float, float]:
    """Return how far the wheels turn to the left and to the right (deg, both positive); infinite without a sensor."""
    angles = [log.steering_deg[log.used] for log in logs if log.steering_deg is not None]
    if not angles:
        return math.inf, math.inf
    values = np.concatenate(angles)
    return float(-np.quantile(values, 1.0 - LOCK_QUANTILE)), float(np.quantile(values, LOCK_QUANTILE))


def build_evidence_segments(log: Log, locks: tuple[float, float]) -> list[SteeringEvidence]:
    """Return the segments of a log in one gear, on even grids; commands beyond the locks (deg) ask for the locks."""
    rows = np.flatnonzero(log.used)
    cuts = np.flatnonzero((np.diff(log.segment[rows]) != 0) | (np.diff(log.shuttle[rows]) != 0.0)) + 1
    parts = [
        part
        for part in np.split(rows, cuts)
        if len(part) > 20 and log.time_s[part[-1]] - log.time_s[part[0]] >= WINDOW_S
    ]
    hold_s = max(
        _measure_hold_s(log.time_s[log.used], values[log.used])
        for values in (log.steering_deg, log.steering_command_deg)
        if values is not None
    )
    return [_build_segment(log, part, locks, hold_s) for part in parts]


def _build_segment(log: Log, rows: Rows, locks: tuple[float, float], hold_s: float) -> SteeringEvidence:
    row_time = log.time_s[rows]
    time = np.arange(row_time[0], row_time[-1] + 1e-9, STEP_S)
    wheel = None if log.steering_deg is None else np.interp(time, row_time, log.steering_deg[rows])
    # What was commanded just before is followed still, also where other columns are not usable.
    history = _list_rows_before(log, int(rows[0]))
    steps_before = math.ceil((row_time[0] - log.time_s[history[0]]) / STEP_S) if len(history) else 0
    long_time = np.concatenate([time[0] - STEP_S * np.arange(steps_before, 0, -1), time])
    long_rows = np.concatenate([history, rows])
    if log.steering_command_deg is None:
        assert log.steering_deg is not None
        source = np.interp(long_time, log.time_s[long_rows], log.steering_deg[long_rows])
    else:
        long_row_time = log.time_s[long_rows]
        nearest = np.searchsorted(0.5 * (long_row_time[1:] + long_row_time[:-1]), long_time)
        source = np.clip(log.steering_command_deg[long_rows][nearest], -locks[0], locks[1])
    command = None if log.steering_command_deg is None else source[steps_before:]
    # After a gap the wheels may be far from the command still.
    start_deg = None if log.steering_deg is None else float(log.steering_deg[long_rows[0]])
    follows = [follow_command(source, *steering, start_deg)[steps_before:] for steering in STEERINGS]
    allowed = np.stack([source[steps_before:], *follows])
    reach = round((EITHER_WAY_S + hold_s) / STEP_S)
    pace, curvature = _measure_path(log, rows, time)
    course_curvature, heading_error = _compare_heading_and_course(log, rows, time)
    return SteeringEvidence(
        time, pace, curvature, command, wheel,
        slide_minimum(allowed.min(axis=0), reach), -slide_minimum(-allowed.max(axis=0), reach),
        follows[0], hold_s, log.heading_deg is not None, course_curvature, heading_error,
    )  # fmt: skip


def _list_rows_before(log: Log, row: int) -> Rows:
    """Return the rows just before a row in which the steering columns are known, used or not."""
    with np.errstate(invalid="ignore"):
        known = (log.time_s[:row] >= log.time_s[row] - _HISTORY_S) & (log.time_s[:row] < log.time_s[row])
    for values in (log.steering_deg, log.steering_command_deg):
        if values is not None:
            known &= np.isfinite(values[:row])
    rows = np.flatnonzero(known)
    time = log.time_s[rows]
    return rows[time > np.maximum.accumulate(np.append(-np.inf, time[:-1]))] if len(rows) else rows


def _measure_hold_s(time: Array, values: Array) -> float:
    """Return the time (s) that a column usually takes to change, if it changes more slowly than its rows."""
    changes = np.flatnonzero(np.diff(values) != 0.0)
    if len(changes) < 20:
        return 0.0
    holds = np.diff(time[changes])
    usual = float(np.median(holds))
    # Steps of a command are no hold: a slow column changes at an even rate.
    even = usual > 2.5 * float(np.median(np.diff(time)))
    return min(float(np.quantile(holds, ALMOST_ALL_SHARE)), _MOST_HOLD_S) if even else 0.0


def _measure_path(log: Log, rows: Rows, time: Array) -> tuple[Array, Array]:
    """Return pace (m/s) and curvature (1/m, in the sense of a forward gear) on a grid, over TURN_S."""
    row_time, half = log.time_s[rows], 0.5 * TURN_S
    before, after = np.maximum(time - half, time[0]), np.minimum(time + half, time[-1])
    step = [compute_change(row_time, axis[rows], before, after) for axis in (log.easting_m, log.northing_m)]
    pace = np.hypot(*step) / (after - before)
    gear = float(np.sign(log.shuttle[rows[0]]))
    if log.heading_deg is not None:
        heading = np.unwrap(np.radians(log.heading_deg[rows]))
        turn = gear * compute_change(row_time, heading, before, after)
    else:
        course = np.unwrap(np.arctan2(*step))
        turn = compute_change(time, course, before, after)
    curvature = np.full(len(time), np.nan)
    clear = (pace > PATH_MPS) & (after - before > 0.9 * TURN_S)
    curvature[clear] = turn[clear] / (pace * (after - before))[clear]
    return pace, curvature


def _compare_heading_and_course(log: Log, rows: Rows, time: Array) -> tuple[Array, Array]:
    """Return the curvature (1/m) of the course, and heading minus course (deg); NaN at low pace."""
    row_time, half = log.time_s[rows], 0.5 * COURSE_TURN_S
    middle = np.array([np.interp(time, row_time, axis[rows]) for axis in (log.easting_m, log.northing_m)])
    ahead, behind = (
        np.array([np.interp(time + shift, row_time, axis[rows]) for axis in (log.easting_m, log.northing_m)])
        for shift in (half, -half)
    )
    first, second = middle - behind, ahead - middle
    length = 0.5 * (np.hypot(*first) + np.hypot(*second))
    clear = (length > PATH_MPS * half) & (time - half >= row_time[0]) & (time + half <= row_time[-1])
    turn = np.arctan2(second[0] * first[1] - second[1] * first[0], np.sum(first * second, axis=0))
    curvature, error = np.full((2, len(time)), np.nan)
    gear = float(np.sign(log.shuttle[rows[0]]))
    curvature[clear] = gear * turn[clear] / length[clear]
    if log.heading_deg is not None and clear.any():
        heading = np.interp(time, row_time, np.unwrap(np.radians(log.heading_deg[rows])))
        course = np.arctan2(gear * (ahead - behind)[0], gear * (ahead - behind)[1])
        error[clear] = wrap_degrees(np.degrees(heading - course)[clear])
    return curvature, error


@compile_function
def _follow_steps(source, late, most_step, share, out) -> None:  # type: ignore[no-untyped-def]
    """Write what follows `source` (k,) `late` steps later from out[0] on, by a share of the gap and at most so far, per
    step."""
    for k in range(1, len(source)):
        step = share * (source[max(k - late, 0)] - out[k - 1])
        out[k] = out[k - 1] + min(max(step, -most_step), most_step)


def follow_command(
    source: Array, late_s: float, rate_deg_per_s: float, lag_s: float, start_deg: float | None = None
) -> Array:
    """Return what follows commands (k, deg) so late, at such a rate (deg/s), with such a time constant.

    It starts at the first command where `start_deg` is None.
    """
    out = np.empty(len(source))
    out[0] = source[0] if start_deg is None else start_deg
    share = 1.0 - math.exp(-STEP_S / lag_s)
    _follow_steps(np.ascontiguousarray(source), round(late_s / STEP_S), rate_deg_per_s * STEP_S, share, out)
    return out


def slide_minimum(values: Array, reach: int) -> Array:
    """Return the least value (k,) within `reach` steps to both sides."""
    padded = np.pad(values, reach, mode="edge")
    least: Array = np.lib.stride_tricks.sliding_window_view(padded, 2 * reach + 1).min(axis=1)
    return least


def fit_path_scale(segments: Sequence[SteeringEvidence]) -> PathScale | None:
    """Fit curvature over the wheel angle (without a sensor, over that of a usual steering); None without a clear line.

    Rows far from the line, as of a fault, do not count.
    """
    known = [segment for segment in segments if len(segment.time_s)]
    if not known:
        return None
    angle = np.concatenate([segment.usual if segment.wheel is None else segment.wheel for segment in known])
    curvature = np.concatenate([segment.curvature for segment in known])
    finite = np.isfinite(curvature) & np.isfinite(angle)
    angle, curvature = angle[finite], curvature[finite]
    if len(angle) < FEWEST_LINE_ROWS or float(np.std(angle)) < STEERING_SPREAD_DEG:
        return None
    inliers = np.ones(len(angle), dtype=np.bool_)
    slope = at_zero = sigma = 0.0
    for _ in range(_PASSES):
        slope, at_zero = (float(value) for value in np.polyfit(angle[inliers], curvature[inliers], 1))
        if slope <= 0.0:
            return None
        apart = np.abs((curvature - at_zero) / slope - angle)
        sigma = measure_spread(apart)
        inliers = apart <= max(CLEAR_SIGMAS * sigma, 1.0)
        if np.count_nonzero(inliers) < FEWEST_LINE_ROWS or float(np.std(angle[inliers])) == 0.0:
            return None
    if float(np.corrcoef(angle[inliers], curvature[inliers])[0, 1]) < CLEAR_CORRELATION:
        return None
    return PathScale(slope, at_zero, sigma)


def average_over_turn(values: Array) -> Array:
    """Return the mean (k,) over the time over which curvature is taken."""
    width = 2 * round(0.5 * TURN_S / STEP_S) + 1
    padded = np.pad(values, width // 2, mode="edge")
    mean: Array = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return mean


HEADING_JUMP = "heading_jump"
_LEAST_DEG, _MOST_DEG = 5.0, 150.0  # chosen: less is noise of a compass, more is a heading that points backwards
_LEAST_NOISES = 12.0  # chosen, of the scatter of a heading from row to row
_MOST_STEP_S = 1.5  # chosen: in a longer time a tractor turns that far
_FEWEST_SIDE = 3  # measured headings on a side
# Chosen: how near to the level of its side a heading must be (deg, share of the jump), and how far the jumps by heading
# and by course may differ.
_NEAR_DEG, _NEAR_SHARE = 1.5, 0.3
_PART_S = 20.0  # chosen: parts of a side, each of which must show the level


@dataclass(frozen=True)
class _HeadingStep:
    """A heading that turns by `size_deg` between two rows (indices of the log)."""

    last_before: int
    first_after: int
    size_deg: float


def correct_heading_jumps(logs: Sequence[Log]) -> list[Log]:
    """Return the logs with headings beside a jump turned back, the jump in `faults`, and no rows about it."""
    return [_correct_log(log) for log in logs]


def _correct_log(log: Log) -> Log:
    if log.heading_deg is None or np.count_nonzero(log.used) < 2:
        return log
    candidates = _list_candidates(log)
    if len(candidates) != 1:
        return log  # a heading that often leaps is noise, or of another fault
    levels = _measure_levels(log, candidates[0])
    return log if levels is None else _turn_back(log, candidates[0], *levels)


def _list_candidates(log: Log) -> list[_HeadingStep]:
    """Return the steps of the heading from one measurement to the next that no tractor turns."""
    assert log.heading_deg is not None
    measured = log.place_rows.get("heading")
    rows = np.flatnonzero(log.used if measured is None else log.used & measured)
    if len(rows) < 4 * _FEWEST_SIDE:
        return []
    time, turn = log.time_s[rows], np.diff(np.unwrap(np.radians(log.heading_deg[rows])))
    step_s = np.diff(time)
    rate = np.degrees(turn) / np.maximum(step_s, 1e-6)
    changes = np.abs(np.diff(np.degrees(turn)))
    least = max(_LEAST_DEG, _LEAST_NOISES * float(np.median(changes)))
    jumps = []
    for row in np.flatnonzero((np.abs(np.degrees(turn)) > 0.5 * least) & (step_s <= _MOST_STEP_S)):
        before = np.flatnonzero((time[1:] <= time[row]) & (time[:-1] >= time[row] - MOMENT_S))
        after = np.flatnonzero((time[:-1] >= time[row + 1]) & (time[1:] <= time[row + 1] + MOMENT_S))
        if min(len(before), len(after)) < _FEWEST_SIDE:
            continue
        # What it turned about a step is between the rates of both sides.
        near = np.median(rate[before]), np.median(rate[after])
        most = [float(np.max(np.abs(rate[side] * step_s[row]))) for side in (before, after)]
        size_deg = math.degrees(turn[row]) - 0.5 * float(near[0] + near[1]) * float(step_s[row])
        if least + max(most) < abs(size_deg) < _MOST_DEG:
            jumps.append(_HeadingStep(int(rows[row]), int(rows[row + 1]), size_deg))
    return jumps


def _measure_levels(log: Log, jump: _HeadingStep) -> tuple[float, float] | None:
    """Return heading minus course (deg) before and after a jump; None where it does not step by as much, and stay."""
    error, time = _collect_errors(log)
    after = time >= log.time_s[jump.first_after]
    levels = []
    for side in (~after & (time <= log.time_s[jump.last_before]), after):
        if np.count_nonzero(side) * STEP_S < WINDOW_S:
            return None
        level = float(np.median(error[side]))
        if not _is_flat(time[side], error[side] - level, abs(jump.size_deg)):
            return None
        levels.append(level)
    apart = levels[1] - levels[0]
    alike = max(_NEAR_DEG, _NEAR_SHARE * abs(jump.size_deg))
    return (levels[0], levels[1]) if abs(apart - jump.size_deg) < alike else None


def _is_flat(time: Array, error: Array, size_deg: float) -> bool:
    """Whether headings of a side (k, deg about their level) stay at it, in each part of the time."""
    near = np.abs(error) < _NEAR_SHARE * size_deg + _NEAR_DEG
    if float(np.mean(near)) < STEADY_SHARE:
        return False
    parts = ((time - time[0]) // _PART_S).astype(np.int64)
    levels = [
        float(np.median(error[parts == part])) for part in np.unique(parts) if np.sum(parts == part) > PART_S / STEP_S
    ]
    return len(levels) == 0 or float(np.max(np.abs(levels))) < 2.0 * _NEAR_SHARE * size_deg


def _collect_errors(log: Log) -> tuple[Array, Array]:
    """Return heading minus course (k, deg) of a log and its times, without what the antenna swings in bends."""
    assert log.heading_deg is not None
    segments = build_evidence_segments(log, (math.inf, math.inf))
    if not segments:
        return np.empty(0), np.empty(0)
    error, time, curvature = (
        np.concatenate([getattr(segment, name) for segment in segments])
        for name in ("heading_error", "time_s", "course_curvature")
    )
    known = np.isfinite(error) & np.isfinite(curvature)
    error, time, curvature = error[known], time[known], curvature[known]
    columns = np.stack([curvature, np.abs(curvature)], axis=1)
    # The changes from bend to bend, not the level that jumps, say how far an antenna swings.
    lag = round(3.0 / STEP_S)
    if len(error) > 3 * lag:
        turned, apart = columns[lag:] - columns[:-lag], error[lag:] - error[:-lag]
        small = np.abs(apart) < max(4.0 * measure_spread(apart), 3.0)
        if np.count_nonzero(small) > lag:
            error = error - columns @ np.linalg.lstsq(turned[small], apart[small], rcond=None)[0]
    return error, time


def _turn_back(log: Log, jump: _HeadingStep, before_deg: float, after_deg: float) -> Log:
    """Return a log whose headings on the side that is further from the course are turned back by the jump."""
    assert log.heading_deg is not None
    size_deg = after_deg - before_deg
    is_before_wrong = abs(before_deg) - abs(after_deg) > MAJORITY * abs(size_deg)
    heading = log.heading_deg.copy()
    if is_before_wrong:
        heading[: jump.last_before + 1] += size_deg
    else:
        heading[jump.first_after :] -= size_deg
    words = describe_heading_jump(size_deg)
    fault = LogFault(HEADING_JUMP, log.name, float(log.time_s[jump.first_after]), None, words)
    faults, rows = (*log.faults, fault), list_gap_rows(jump.last_before, jump.first_after, len(log.time_s))
    return log.exclude_rows(
        f"heading jump: {words}", np.isin(np.arange(len(log.time_s)), rows), heading_deg=heading % 360.0, faults=faults
    )


def describe_heading_jump(size_deg: float) -> str:
    """Return words on a heading that jumps by so much (positive: to the right)."""
    side = "right" if size_deg > 0.0 else "left"
    return (
        f"heading_deg jumps by {abs(size_deg):.1f} deg to the {side} and stays there while the course goes on: the "
        "instrument was reset, or moved on its mount"
    )
