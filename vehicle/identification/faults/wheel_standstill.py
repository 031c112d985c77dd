"""Wheels that stand still while their commands ask them to move, as they nowhere else do.

A loose wire leaves the valve shut. Effects of the catalogue make wheels late, slow or wrong by a share, and only a dead
band makes them stand: then they stand at every command as small as that. So a standstill is a fault where commands as
large were followed in the same run and in nearly all others.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from vehicle.identification.faults.steering_evidence import STEP_S, SteeringEvidence
from vehicle.identification.faults.thresholds import FAULT_LEAST_S, FAULT_TOLERANCE_DEG
from vehicle.identification.logs.schema import Array, Mask, Rows

_WINDOW_S, _STRIDE_S = 3.0, 0.5  # of commands that are compared with a standstill
_STILL_S, _LEAST_STILL_DEG, _STILL_SIGMAS = 1.0, 0.2, 8.0  # chosen: a wheel moves that moves this far within this time
_LEAST_LEVEL_DEG = 1.0  # chosen: dead bands of good valves and the steps of sensors are less
_CLEAR_BANDS = 2.0  # chosen, of the noise of a wheel that stands
_MOVED_SHARE = 0.3  # chosen, of what a command asks for: wheels that move less do not follow it
_ALIKE_SHARE = 0.5  # chosen: commands that differ from those of a standstill by less than this share are as large
# Chosen: shares of the commands as large that other times follow, all together and in the same run, and how many show
# it: a dead band follows none of them, a wire that comes loose now and then misses few.
_FOLLOWED_SHARE, _FOLLOWED_IN_RUN_SHARE, _FEWEST_WINDOWS = 0.85, 0.5, 6
_USUAL_QUANTILE = 0.75  # chosen, of what commands ask for
_REST_QUANTILE = 0.9  # chosen: faults are less of the time
# Chosen, s and deg: commands that stay so long within so little are steady.
_STEADY_S, _STEADY_DEG = 1.0, 1.0
# Chosen, of what wheels miss of steady commands: long faults do not count; and the same of a normal distribution.
_UNREST_QUANTILE, _NORMAL_QUANTILE = 0.3, 0.385
_UNREST_SIGMAS = 4.0  # chosen: in an hour a hand goes no further from where it usually is
_LEAST_PACE_MPS = 0.25  # most steering is switched off where the tractor stands
_PASSES, _INLIER_DEG, _LEAST_CORRELATION, _FEWEST_ROWS = 4, 3.0, 0.7, 100


@dataclass(frozen=True)
class Standstill:
    """A wheel that stands from row `first` to row `last` of a segment's grid, `level_deg` from what is asked of it.

    Commands ask it to move from row `shown` on: what holds it broke in between.
    """

    first: int
    last: int
    shown: int
    level_deg: float


@dataclass(frozen=True, eq=False)
class _Windows:
    """Windows of one segment (k,): first row, how far the wheel is asked to move (deg), whether it does."""

    rows: Rows
    demands: Array
    moved: Mask


@dataclass(frozen=True)
class WheelCalibration:
    """The angle a sensor shows (deg) at 0 and per degree of the command, the ends of the wheels' travel, and how far
    from their command wheels usually rest (deg)."""

    at_zero: float
    per_degree: float
    least: float
    most: float
    rest_deg: float = 0.0

    def compute_angle(self, steered_deg: Array) -> Array:
        """Return the angle (k, deg) that the sensor shows of wheels that follow their commands so far."""
        return np.clip(self.at_zero + self.per_degree * steered_deg, self.least, self.most)

    def compute_limits(self, segment: SteeringEvidence) -> tuple[Array, Array]:
        """Return the angles (k, deg) between which the sensor shows a steering that is as fast as a usual one or
        faster, inside the travel of the wheels."""
        assert segment.command is not None
        command, usual = self.compute_angle(segment.command), self.compute_angle(segment.usual)
        return np.minimum(command, usual), np.maximum(command, usual)


def _measure_demand(low: Array, high: Array, shown: Array) -> Array:
    """Return how far (deg) a wheel that is `shown` somewhere is asked to move."""
    demand: Array = np.maximum(np.maximum(low - shown, shown - high), 0.0)
    return demand


def measure_unrest(segments: Sequence[SteeringEvidence]) -> float:
    """Return how far (deg) wheels go from steady commands now and then, as where a hand disturbs them; 0 without both
    columns, or without steady commands."""
    both = [segment for segment in segments if _has_both(segment)]
    calibration = calibrate_wheels(both) or WheelCalibration(0.0, 1.0, -math.inf, math.inf)
    misses = np.concatenate([np.empty(0), *[_measure_steady_misses(segment, calibration) for segment in both]])
    if len(misses) < _FEWEST_ROWS:
        return 0.0
    apart = np.abs(misses - np.median(misses))
    return _UNREST_SIGMAS * float(np.quantile(apart, _UNREST_QUANTILE)) / _NORMAL_QUANTILE


def _measure_steady_misses(segment: SteeringEvidence, calibration: WheelCalibration) -> Array:
    """Return what the wheel misses (deg) of a command that has been steady, and followed by a usual steering."""
    assert segment.wheel is not None and segment.command is not None
    width = round(_STEADY_S / STEP_S) + 1
    if len(segment.time_s) < width:
        return np.empty(0)
    steady = np.zeros(len(segment.time_s), dtype=np.bool_)
    steady[width - 1 :] = np.ptp(np.lib.stride_tricks.sliding_window_view(segment.command, width), axis=1) < _STEADY_DEG
    steady &= (np.abs(segment.usual - segment.command) < _STEADY_DEG) & (segment.pace > _LEAST_PACE_MPS)
    misses: Array = (segment.wheel - calibration.compute_angle(segment.usual))[steady]
    return misses


def find_faulty_standstills(
    segments: Sequence[Sequence[SteeringEvidence]], unrest_deg: float = 0.0
) -> list[list[list[Standstill]]]:
    """Return the standstills that are faults, by run and segment; none without a sensor that follows the commands.

    Wheels that go `unrest_deg` from steady commands by themselves show none by less.
    """
    calibration = calibrate_wheels([part for parts in segments for part in parts if _has_both(part)])
    if calibration is None:
        return [[[] for _ in parts] for parts in segments]
    windows = [[_measure_windows(part, calibration) for part in parts] for parts in segments]
    return [
        [
            [
                standstill
                for standstill in _list_standstills(part, calibration)
                if standstill.level_deg > unrest_deg and _is_fault(standstill, run, number, windows)
            ]
            for number, part in enumerate(parts)
        ]
        for run, parts in enumerate(segments)
    ]


def _has_both(segment: SteeringEvidence) -> bool:
    return segment.wheel is not None and segment.command is not None


def calibrate_wheels(segments: Sequence[SteeringEvidence]) -> WheelCalibration | None:
    """Fit the sensor's angle over the command; rows far from the line, as of a fault, do not count."""
    if not segments:
        return None
    usual = np.concatenate([segment.usual for segment in segments])
    wheel = np.concatenate([segment.wheel for segment in segments if segment.wheel is not None])
    # As the columns say it at first: a long fault tilts a line through all rows.
    kept, slope, at_zero = np.abs(wheel - usual - np.median(wheel - usual)) < _INLIER_DEG, 1.0, 0.0
    for _ in range(_PASSES):
        if np.count_nonzero(kept) < _FEWEST_ROWS or float(np.std(usual[kept])) == 0.0:
            return None
        slope, at_zero = (float(value) for value in np.polyfit(usual[kept], wheel[kept], 1))
        kept = np.abs(wheel - at_zero - slope * usual) < _INLIER_DEG
    if np.count_nonzero(kept) < _FEWEST_ROWS or float(np.std(wheel[kept])) == 0.0:
        return None
    if slope <= 0.0 or float(np.corrcoef(usual[kept], wheel[kept])[0, 1]) < _LEAST_CORRELATION:
        return None
    calibration = WheelCalibration(at_zero, slope, float(np.min(wheel[kept])), float(np.max(wheel[kept])))
    resting = [
        _measure_demand(*calibration.compute_limits(segment), segment.wheel)[part]
        for segment in segments
        if segment.wheel is not None
        for part in _find_still_parts(segment.wheel)
    ]
    every = np.concatenate([np.empty(0), *resting])
    return replace(calibration, rest_deg=float(np.quantile(every, _REST_QUANTILE)) if len(every) else 0.0)


def _measure_windows(segment: SteeringEvidence, calibration: WheelCalibration) -> _Windows:
    """Measure what the commands ask of the wheel in windows of driving: the angle that they exceed for FAULT_LEAST_S
    from where the wheel is at first."""
    width, none = round(_WINDOW_S / STEP_S), np.empty(0, dtype=np.int64)
    if not _has_both(segment) or len(segment.time_s) < width:
        return _Windows(none, np.empty(0), np.empty(0, dtype=np.bool_))
    assert segment.wheel is not None
    rows = np.arange(0, len(segment.time_s) - width + 1, round(_STRIDE_S / STEP_S))
    windows = np.lib.stride_tricks.sliding_window_view
    low, high, shown, pace = (
        windows(values, width)[rows] for values in (*calibration.compute_limits(segment), segment.wheel, segment.pace)
    )
    demands = np.sort(_measure_demand(low, high, shown[:, :1]), axis=1)[:, width - round(FAULT_LEAST_S / STEP_S)]
    moved = np.max(np.abs(shown - shown[:, :1]), axis=1) > np.maximum(
        _MOVED_SHARE * demands, 0.5 * _measure_still_band(segment.wheel)
    )
    driven = np.min(pace, axis=1) > _LEAST_PACE_MPS
    return _Windows(rows[driven], demands[driven], moved[driven])


def _measure_still_band(wheel: Array) -> float:
    """Return how far (deg) a sensor moves whose wheel stands: its noise and its steps."""
    steps = np.abs(np.diff(wheel))
    return max(_LEAST_STILL_DEG, _STILL_SIGMAS * 1.4826 * float(np.median(steps)) / math.sqrt(2.0))


def _find_still_parts(wheel: Array) -> list[slice]:
    """Return the parts in which a wheel (k, deg) moves no further within _STILL_S than the noise of its sensor."""
    reach = round(_STILL_S / STEP_S)
    if len(wheel) <= reach:
        return []
    windows, band = np.lib.stride_tricks.sliding_window_view(wheel, reach + 1), _measure_still_band(wheel)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], np.ptp(windows, axis=1) <= band, [False]])))
    parts = list[slice]()
    for first, end in zip(edges[::2].tolist(), (edges[1::2] + reach).tolist(), strict=True):
        # A rare value of the noise does not end a standstill.
        end_deg = np.median(wheel[parts[-1].stop - reach : parts[-1].stop]) if parts else np.inf
        if parts and first <= parts[-1].stop and abs(np.median(wheel[first : first + reach]) - end_deg) <= 0.5 * band:
            parts[-1] = slice(parts[-1].start, end)
        else:
            parts.append(slice(first, end))
    return parts


def _list_standstills(segment: SteeringEvidence, calibration: WheelCalibration) -> list[Standstill]:
    """Return the standstills of a segment at which commands ask for more than _LEAST_LEVEL_DEG for FAULT_LEAST_S."""
    if not _has_both(segment):
        return []
    assert segment.wheel is not None
    band = _measure_still_band(segment.wheel)
    demand_deg = _measure_demand(*calibration.compute_limits(segment), segment.wheel)
    found = []
    for part in _find_still_parts(segment.wheel):
        level = _measure_level(demand_deg[part][segment.pace[part] > _LEAST_PACE_MPS], segment.hold_s)
        # A sensor that swings by as much as is asked of the wheel does not show whether it stands.
        if level > max(_LEAST_LEVEL_DEG, _CLEAR_BANDS * band):
            shown = part.start + _find_first_demand(
                demand_deg[part], min(_MOVED_SHARE * level, calibration.rest_deg + band)
            )
            since = part.start + _find_last_movement(segment.wheel[part], shown - part.start, band)
            found.append(Standstill(since, part.stop - 1, shown, level))
    return found


def _find_first_demand(demand_deg: Array, least_deg: float) -> int:
    """Return the first row (of k) from which a wheel is asked to move for as long as usual ones take to do so."""
    width = round(_STILL_S / STEP_S)
    lasting = np.lib.stride_tricks.sliding_window_view(demand_deg, min(width, len(demand_deg))).min(axis=1) > least_deg
    return int(np.argmax(lasting if lasting.any() else demand_deg > least_deg))


def _find_last_movement(wheel: Array, shown: int, band: float) -> int:
    """Return the row of a standstill (k,) from which the wheel is where it is in row `shown`: valves leak slowly, and
    small commands are small movements."""
    level = float(np.median(wheel[shown : shown + round(_STILL_S / STEP_S)]))
    width = 2 * round(0.25 * _STILL_S / STEP_S) + 1
    smooth = np.convolve(np.pad(wheel, width // 2, mode="edge"), np.full(width, 1.0 / width), mode="valid")
    elsewhere = np.flatnonzero(np.abs(smooth[: shown + 1] - level) > band)
    return min(int(elsewhere[-1]) + 1, shown) if len(elsewhere) else 0


def _measure_level(demand_deg: Array, hold_s: float) -> float:
    """Return the angle (deg) that `demand_deg` exceeds for FAULT_LEAST_S, beside the time that a column may hold."""
    rank = round((FAULT_LEAST_S + 2.0 * hold_s) / STEP_S)
    return float(np.sort(demand_deg)[-rank]) if len(demand_deg) >= rank else 0.0


def _is_fault(standstill: Standstill, run: int, number: int, windows: Sequence[Sequence[_Windows]]) -> bool:
    """Whether commands as large as in a standstill are followed at other times, in its run and in all."""
    reach, others = round(_WINDOW_S / STEP_S), list[tuple[bool, Array, Mask]]()
    for other, parts in enumerate(windows):
        for place, part in enumerate(parts):
            outside = np.ones(len(part.rows), dtype=np.bool_)
            if (other, place) == (run, number):
                outside = (part.rows + reach < standstill.shown) | (part.rows > standstill.last)
            others.append((other == run, part.demands[outside], part.moved[outside]))
    demands = np.concatenate([demands for _, demands, _ in others])
    # What holds a wheel at a large command holds it at the smaller ones that are usual, too.
    large = demands[demands > _LEAST_LEVEL_DEG]
    if not len(large):
        return False
    size_deg = min(standstill.level_deg, float(np.quantile(large, _USUAL_QUANTILE)))
    alike = [
        (is_own, moved[np.abs(demand_deg - size_deg) < _ALIKE_SHARE * size_deg]) for is_own, demand_deg, moved in others
    ]
    every = np.concatenate([moved for _, moved in alike])
    own = np.concatenate([moved for is_own, moved in alike if is_own])
    if len(every) < _FEWEST_WINDOWS or float(np.mean(every)) < _FOLLOWED_SHARE:
        return False
    if not len(own):
        return standstill.level_deg > FAULT_TOLERANCE_DEG
    return float(np.mean(own)) >= _FOLLOWED_IN_RUN_SHARE
