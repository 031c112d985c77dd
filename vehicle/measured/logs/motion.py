"""What the positions of a log alone say: course, speed and curvature of the path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.measured.logs.record import Array, Log

_SPANS_S = (2.0, 1.0, 0.5, 0.25, 0.1)  # long ones have less noise, short ones follow the bends of fast small vehicles
_STRAIGHTEST = 0.93  # chord over two half chords: an arc of about 86 degrees
_MOVING_SHARE = 0.3  # of the median chord: slower ones have no direction
_FEWEST = 3


@dataclass(frozen=True, eq=False)
class Motion:
    """Chords of the path, one value each.

    `row` is the log's row at the middle, `span_s` the time the chord takes; `course` (rad, clockwise from north) is the
    direction of travel, `speed` in m/s, `curvature` (1/m) positive to the right of the travel.
    """

    row: npt.NDArray[np.int64]
    span_s: float
    course: Array
    speed: Array
    curvature: Array


def motion(log: Log) -> Motion | None:
    """Chords as long in time as the path's bends allow; None when the log hardly moves or is too short."""
    best = None
    for span in _SPANS_S:
        chords = _chords(log, max(span, 2.0 * log.step_s))
        if chords is None:
            continue
        best, straightness = chords
        if straightness >= _STRAIGHTEST:
            return best
    return best


def _chords(log: Log, span: float) -> tuple[Motion, float] | None:
    """Chords of a time span from the mid row's position back and forth, and the straightness of the bent tenth."""
    parts = [_segment_chords(log, number, span) for number in range(log.segments)]
    row, first, second = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(row) < _FEWEST:
        return None
    length = np.hypot(*(first + second).T)
    halves = np.hypot(*first.T) + np.hypot(*second.T)
    moving = length > _MOVING_SHARE * np.median(halves[halves > 0.0]) if (halves > 0.0).any() else length > 0.0
    if np.count_nonzero(moving) < _FEWEST:
        return None
    row, first, second, length, halves = row[moving], first[moving], second[moving], length[moving], halves[moving]
    turn = np.arctan2(first[:, 1] * second[:, 0] - first[:, 0] * second[:, 1], (first * second).sum(axis=1))
    both = first + second
    chords = Motion(row, span, np.arctan2(both[:, 0], both[:, 1]), halves / span, 2.0 * turn / halves)
    return chords, float(np.quantile(length / halves, 0.1))


def _segment_chords(log: Log, number: int, span: float) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Middle rows every half span of one stretch, and the (east, north) steps before and after them."""
    rows = np.flatnonzero(log.segment == number)
    time = log.time_s[rows]
    wanted = np.arange(time[0] + 0.5 * span, time[-1] - 0.5 * span + 1e-9, 0.5 * span)
    near = np.unique(np.minimum(np.searchsorted(time, wanted - 1e-9), len(rows) - 1))
    middle = time[near]
    near = near[(middle - 0.5 * span >= time[0] - 1e-9) & (middle + 0.5 * span <= time[-1] + 1e-9)]
    middle = time[near]
    place = [
        np.stack([np.interp(middle + shift * span, time, axis[rows]) for axis in (log.easting_m, log.northing_m)], 1)
        for shift in (-0.5, 0.0, 0.5)
    ]
    return rows[near], place[1] - place[0], place[2] - place[1]
