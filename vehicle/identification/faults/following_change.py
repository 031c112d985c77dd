"""Steering that from a moment on follows its commands less than before, and than in all other runs.

A linkage that wears out leaves small differences, a valve that clogs is slow: the wheels still move, so no standstill
shows it. What is compared is how far the wheel angle is from the steering that follows best in the whole set, over
windows in which that moves. Steering that is late, slow or coarse from the start, in all runs, or wherever a run goes
as fast and turns as far with its implement as it was, is no fault.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.identification.faults.steering_evidence import STEP_S, SteeringEvidence, follow_command
from vehicle.identification.faults.wheel_standstill import WheelCalibration, calibrate_wheels
from vehicle.identification.logs.schema import Array, Log, Mask, Rows

# Of the steering that follows best: dead time (s), rate (deg/s) and lag (s).
_LATES_S, _RATES_DEG_PER_S, _LAGS_S = (0.0, 0.15, 0.3, 0.45, 0.6), (5.0, 7.5, 11.0, 16.0, 24.0), (0.1, 0.2, 0.4)
_LEAST_MISS_DEG = 0.05  # chosen: noise of a wheel sensor
_SLACK_S = 0.2  # chosen: clocks of two columns, and a dead time between those of the grid
_SETTLING_S = 3.0  # chosen: until wheels follow that stood elsewhere when a segment began
# Chosen: windows that are compared, and how far (deg) the steering moves in their first half, so that misses show.
_WINDOW_S, _LEAST_DEMAND_DEG = 3.0, 8.0
_LEAST_PACE_MPS = 0.25  # most steering is switched off where the tractor stands
# Chosen: a mean miss beyond these (deg, share of the movement, times what nine of ten other windows show) is a bad one.
_BAD_DEG, _BAD_SHARE, _BAD_TIMES, _USUAL_QUANTILE = 1.0, 0.05, 3.0, 0.9
# Chosen: bad windows of a fault and the time from first to last, their share, and good ones between two of them.
_FEWEST_BAD, _LEAST_FAULT_S, _BAD_WINDOWS_SHARE, _MOST_GOOD_BETWEEN = 6, 12.0, 0.8, 2
_FEWEST_BEFORE, _FEWEST_ALIKE, _GOOD_SHARE = 4, 6, 0.9  # chosen: windows before it, and others alike, that follow
# Chosen: misses that grow from window to window are no onset; alike are windows of about the pace and movement.
_FULL_SHARE, _EARLY_SHARE, _ALIKE_PACE_SHARE, _ALIKE_DEMAND = 0.5, 0.25, 0.3, 2.0


@dataclass(frozen=True)
class FollowingChange:
    """Rows of a segment's grid from the first to the last in which the wheels follow less."""

    first: int
    last: int


@dataclass(frozen=True, eq=False)
class _FollowingWindows:
    """Windows of all segments in which the steering moves (k,): run, segment, first row, miss and movement (deg), pace
    (m/s), and whether the implement works."""

    run: Rows
    segment: Rows
    rows: Rows
    misses: Array
    demands: Array
    paces: Array
    implement: Array

    def count(self) -> int:
        """Return the number of windows."""
        return len(self.rows)


def find_following_changes(
    logs: Sequence[Log], segments: Sequence[Sequence[SteeringEvidence]], unrest_deg: float = 0.0
) -> list[list[list[FollowingChange]]]:
    """Return the changes by run and segment; `unrest_deg` is how far wheels go from their commands by themselves."""
    found: list[list[list[FollowingChange]]] = [[[] for _ in parts] for parts in segments]
    every = [part for parts in segments for part in parts if part.wheel is not None and part.command is not None]
    calibration = calibrate_wheels(every)
    if calibration is None:
        return found
    steering = _fit_steering(every, calibration)
    windows = _measure_windows(logs, segments, steering, calibration)
    if windows is None:
        return found
    for span in _list_bad_spans(windows, _find_bad(windows, np.ones(windows.count(), np.bool_), unrest_deg)):
        outside = np.ones(windows.count(), dtype=np.bool_)
        outside[max(span[0] - 1, 0) : span[-1] + 2] = False
        bad = _find_bad(windows, outside, unrest_deg)
        if _is_change(windows, span, bad, outside):
            run, number = int(windows.run[span[0]]), int(windows.segment[span[0]])
            found[run][number].append(_find_change_rows(windows, span, bad, segments[run][number]))
    return found


_Steering = tuple[float, float, float]


def _fit_steering(segments: Sequence[SteeringEvidence], calibration: WheelCalibration) -> _Steering:
    """Return the dead time, rate and lag by which wheels miss least in most segments."""

    def measure(steering: _Steering) -> float:
        """Return the sum of the logarithms of the usual misses: a segment with a fault does not decide."""
        misses = [
            np.abs(_expect(part, steering, calibration) - part.wheel) for part in segments if part.wheel is not None
        ]
        return sum(math.log(float(np.mean(np.minimum(miss, 10.0))) + _LEAST_MISS_DEG) for miss in misses)

    return min(itertools.product(_LATES_S, _RATES_DEG_PER_S, _LAGS_S), key=measure)


def _expect(part: SteeringEvidence, steering: _Steering, calibration: WheelCalibration) -> Array:
    """Return the angle (k, deg) that the sensor shows of a steering."""
    assert part.command is not None
    start_deg = None if part.wheel is None else (float(part.wheel[0]) - calibration.at_zero) / calibration.per_degree
    return calibration.compute_angle(follow_command(part.command, *steering, start_deg))


def _measure_windows(
    logs: Sequence[Log],
    segments: Sequence[Sequence[SteeringEvidence]],
    steering: _Steering,
    calibration: WheelCalibration,
) -> _FollowingWindows | None:
    rows = [
        _measure_segment(log, run, number, part, _expect(part, steering, calibration))
        for run, (log, parts) in enumerate(zip(logs, segments, strict=True))
        for number, part in enumerate(parts)
        if part.wheel is not None and part.command is not None
    ]
    table = np.concatenate([np.zeros((7, 0)), *rows], axis=1)
    if not table.shape[1]:
        return None
    run, segment, first = table[:3].astype(np.int64)
    return _FollowingWindows(run, segment, first, *table[3:])


def _measure_segment(log: Log, run: int, number: int, part: SteeringEvidence, expected: Array) -> Array:
    """Return the windows (7, k) of a segment in which the steering moves while the tractor drives."""
    width, half = round(_WINDOW_S / STEP_S), round(0.5 * _WINDOW_S / STEP_S)
    if len(expected) < width:
        return np.zeros((7, 0))
    miss = _measure_misses(part, expected)
    implement = np.interp(part.time_s, log.time_s[log.used], log.implement[log.used])
    found = []
    for first in range(round(_SETTLING_S / STEP_S), len(expected) - width + 1, half):
        window = slice(first, first + width)
        demand = float(np.ptp(expected[first : first + half]))
        if demand >= _LEAST_DEMAND_DEG and float(np.min(part.pace[window])) > _LEAST_PACE_MPS:
            means = (float(np.mean(values[window])) for values in (miss, part.pace, implement))
            mean_miss, pace, works = means
            found.append((run, number, first, mean_miss, demand, pace, round(works)))
    return np.array(found, dtype=np.float64).T if found else np.zeros((7, 0))


def _measure_misses(part: SteeringEvidence, expected: Array) -> Array:
    """Return how far (k, deg) the wheel is from what is expected within _SLACK_S."""
    assert part.wheel is not None
    reach = round(_SLACK_S / STEP_S)
    near = np.lib.stride_tricks.sliding_window_view(np.pad(expected, reach, mode="edge"), 2 * reach + 1)
    misses: Array = np.maximum(np.maximum(near.min(axis=1) - part.wheel, part.wheel - near.max(axis=1)), 0.0)
    return misses


def _find_bad(windows: _FollowingWindows, usual: Mask, unrest_deg: float) -> Mask:
    """Return the windows that miss clearly more than the `usual` ones."""
    level = float(np.quantile(windows.misses[usual], _USUAL_QUANTILE)) if usual.any() else 0.0
    if usual.all():
        level = 0.0  # nothing is known to be a fault yet
    bad: Mask = windows.misses > np.maximum(
        max(_BAD_DEG, _BAD_TIMES * level, 0.5 * unrest_deg), _BAD_SHARE * windows.demands
    )
    return bad


def _list_bad_spans(windows: _FollowingWindows, bad: Mask) -> list[Rows]:
    """Return the bad windows of a segment that are near each other, where they are enough for a fault."""
    places = np.flatnonzero(bad)
    if not len(places):
        return []
    key = windows.run * 10_000 + windows.segment
    apart = (np.diff(places) > _MOST_GOOD_BETWEEN + 1) | (np.diff(key[places]) != 0)
    return [group for group in np.split(places, np.flatnonzero(apart) + 1) if len(group) >= _FEWEST_BAD]


def _is_change(windows: _FollowingWindows, span: Rows, bad: Mask, outside: Mask) -> bool:
    """Whether a span of bad windows began at a moment, and windows alike follow at all other times."""
    inside = np.arange(span[0], span[-1] + 1)
    seconds = STEP_S * float(windows.rows[inside[-1]] - windows.rows[inside[0]])
    if seconds < _LEAST_FAULT_S or float(np.mean(bad[inside])) < _BAD_WINDOWS_SHARE:
        return False
    own = windows.run == windows.run[span[0]]
    before = np.flatnonzero(own & outside & (np.arange(windows.count()) < span[0]))
    if len(before) < _FEWEST_BEFORE or float(np.mean(bad[before])) > 1.0 - _GOOD_SHARE:
        return False
    shares = windows.misses / windows.demands
    level = float(np.median(shares[inside]))
    early, late = shares[inside[:_FEWEST_BEFORE]], shares[before[-_FEWEST_BEFORE:]]
    if float(np.median(early)) < _FULL_SHARE * level or float(np.median(late)) > _EARLY_SHARE * level:
        return False
    return _are_others_good(windows, inside, bad, outside)


def _are_others_good(windows: _FollowingWindows, inside: Rows, bad: Mask, outside: Mask) -> bool:
    """Whether windows outside follow, those of other runs and those of the implement, pace and movement inside."""
    if float(np.mean(bad[outside])) > 1.0 - _GOOD_SHARE:
        return False
    pace, demand = float(np.median(windows.paces[inside])), float(np.median(windows.demands[inside]))
    alike = outside & (windows.implement == round(float(np.median(windows.implement[inside]))))
    alike &= np.abs(windows.paces - pace) < _ALIKE_PACE_SHARE * pace
    alike &= (windows.demands > demand / _ALIKE_DEMAND) & (windows.demands < demand * _ALIKE_DEMAND)
    return bool(np.count_nonzero(alike) >= _FEWEST_ALIKE) and float(np.mean(~bad[alike])) >= _GOOD_SHARE


def _find_change_rows(windows: _FollowingWindows, span: Rows, bad: Mask, part: SteeringEvidence) -> FollowingChange:
    """Return the rows from the first bad window on to the next that follows, or to the end of the segment."""
    width = round(_WINDOW_S / STEP_S)
    same = (windows.run == windows.run[span[0]]) & (windows.segment == windows.segment[span[0]])
    after = np.flatnonzero(same & ~bad & (np.arange(windows.count()) > span[-1]))
    last = int(windows.rows[after[0]]) if len(after) else len(part.time_s) - 1
    # The first of two overlapping windows is bad by its second half.
    return FollowingChange(int(windows.rows[span[0]]) + width // 3, last)
