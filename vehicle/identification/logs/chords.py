"""Course, speed and curvature of the path from positions alone, and the steering compared with them, chord by chord."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import Array, Log

_SPANS_S = (2.0, 1.0, 0.5, 0.25, 0.1)  # long chords have less noise, short ones follow the bends of small fast vehicles
_LEAST_STRAIGHTNESS = 0.93  # chord over two half chords: an arc of about 86 degrees
_MOVING_SHARE = 0.3  # of the median chord: slower ones have no reliable direction
_FEWEST_CHORDS = 3


@dataclass(frozen=True, eq=False)
class PathChords:
    """Chords of the path, one value each.

    `row` is the row of the log at the middle, `span_s` the duration of a chord; `course` (rad, clockwise from north) is
    the direction of travel, `speed` in m/s, `curvature` (1/m) positive to the right of the travel.
    """

    row: npt.NDArray[np.int64]
    span_s: float
    course: Array
    speed: Array
    curvature: Array


def compute_path_chords(log: Log) -> PathChords | None:
    """Compute chords as long in time as the bends of the path allow; None when the log hardly moves or is too short."""
    best = None
    for span in _SPANS_S:
        chords = _compute_chords(log, max(span, 2.0 * log.step_s))
        if chords is None:
            continue
        best, straightness = chords
        if straightness >= _LEAST_STRAIGHTNESS:
            return best
    return best


def _compute_chords(log: Log, span: float) -> tuple[PathChords, float] | None:
    """Compute chords of a time span, half before and half after the middle row, and the straightness of the most bent
    tenth."""
    parts = [_compute_segment_chords(log, number, span) for number in range(log.segment_count)]
    row, first, second = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(row) < _FEWEST_CHORDS:
        return None
    length = np.hypot(*(first + second).T)
    halves = np.hypot(*first.T) + np.hypot(*second.T)
    moving = length > _MOVING_SHARE * np.median(halves[halves > 0.0]) if (halves > 0.0).any() else length > 0.0
    if np.count_nonzero(moving) < _FEWEST_CHORDS:
        return None
    row, first, second, length, halves = row[moving], first[moving], second[moving], length[moving], halves[moving]
    turn = np.arctan2(first[:, 1] * second[:, 0] - first[:, 0] * second[:, 1], (first * second).sum(axis=1))
    chord = first + second
    chords = PathChords(row, span, np.arctan2(chord[:, 0], chord[:, 1]), halves / span, 2.0 * turn / halves)
    return chords, float(np.quantile(length / halves, 0.1))


def _compute_segment_chords(log: Log, number: int, span: float) -> tuple[npt.NDArray[np.int64], Array, Array]:
    """Return middle rows every half span of one segment, and the (east, north) steps before and after them."""
    rows = np.flatnonzero(log.segment == number)
    time = log.time_s[rows]
    middle_times = np.arange(time[0] + 0.5 * span, time[-1] - 0.5 * span + 1e-9, 0.5 * span)
    middle_rows = np.unique(np.minimum(np.searchsorted(time, middle_times - 1e-9), len(rows) - 1))
    middle = time[middle_rows]
    middle_rows = middle_rows[(middle - 0.5 * span >= time[0] - 1e-9) & (middle + 0.5 * span <= time[-1] + 1e-9)]
    middle = time[middle_rows]
    place = [
        np.stack([np.interp(middle + shift * span, time, axis[rows]) for axis in (log.easting_m, log.northing_m)], 1)
        for shift in (-0.5, 0.0, 0.5)
    ]
    return rows[middle_rows], place[1] - place[0], place[2] - place[1]


CLEAR_STEERING_DEG = 3.0  # more than any offset, slope or draft of usual size
_FEWEST_BEND_CHORDS = 5  # chords: fewer bends may be one swerve
_FEWEST_ROWS = 20  # needed to find that two columns contradict each other
_MIRRORED_SHARE = 0.8  # of the clear bends: some are misjudged where the steering is changing


_ALIKE_SHARE, _ALIKE_S = 0.3, 3.0  # chosen: of an angle, and for how long, two columns show the same one
_CLEAR_CORRELATION, _PARTS = 0.7, 5  # chosen: of two columns that hold one angle, and parts of a run to look at


def _correlate(one: Array, other: Array) -> float:
    """Return the correlation of two columns (k,), 0 where one of them is constant."""
    spread = float(np.std(one)) * float(np.std(other))
    return float(np.mean((one - one.mean()) * (other - other.mean()))) / spread if spread > 0.0 else 0.0


def select_chord_steering(log: Log) -> Array:
    """Return the steering (deg) to compare with: the sensor if there is one, else the command.

    Raises LogError for two columns that contradict each other.
    """
    command, sensor = log.steering_command_deg, log.steering_deg
    if sensor is None or command is None:
        angle = command if sensor is None else sensor
        assert angle is not None
        return angle
    commanded, measured = command[log.used], sensor[log.used]
    if len(commanded) < _FEWEST_ROWS:
        return sensor
    correlation = _correlate(commanded, measured)
    if correlation < -_CLEAR_CORRELATION and float(np.std(commanded)) > 0.03 and not _stand_alike(log):
        # Wheels that stop following during a run follow before or after.
        parts = zip(np.array_split(commanded, _PARTS), np.array_split(measured, _PARTS), strict=True)
        if not any(_correlate(*part) > _CLEAR_CORRELATION for part in parts):
            raise LogError(
                f"{log.name}: steering_command_deg and steering_deg have opposite signs (correlation "
                f"{correlation:.2f}); make both positive to the right."
            )
    if correlation > _CLEAR_CORRELATION:
        ratio = float(np.std(commanded)) / float(np.std(measured))
        if not 1.0 / 20.0 < ratio < 20.0:
            raise LogError(
                f"{log.name}: steering_command_deg moves {ratio:.3g} times as far as steering_deg; one is in radians, "
                "write both in degrees."
            )
    return sensor


def _stand_alike(log: Log) -> bool:
    """Whether the wheels stand at their command for seconds, to a side: those of opposite signs only pass by."""
    assert log.steering_command_deg is not None and log.steering_deg is not None
    command, wheel = log.steering_command_deg[log.used], log.steering_deg[log.used]
    apart, away = np.abs(command - wheel), np.minimum(command * np.sign(wheel), np.abs(wheel))
    alike = apart < _ALIKE_SHARE * away
    edges = np.flatnonzero(np.diff(np.concatenate([[False], alike, [False]])))
    time = log.time_s[log.used]
    return any(time[end - 1] - time[first] > _ALIKE_S for first, end in zip(edges[::2], edges[1::2], strict=True))


def find_largest_steering(log: Log) -> float:
    """Return the largest absolute steering angle (deg)."""
    return float(np.abs(select_chord_steering(log)[log.used]).max())


def compute_bends(log: Log) -> tuple[Array, Array, Array] | None:
    """Per chord: mean steering, curvature of the path (1/m, to the right in a forward gear), and gear (-1, 0 or 1).

    None when the log has no chords.
    """
    chords = compute_path_chords(log)
    if chords is None:
        return None
    rows = np.flatnonzero(log.used)
    time, values = log.time_s[rows], select_chord_steering(log)[rows]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    middle = log.time_s[chords.row]
    ends = [np.interp(middle + shift * chords.span_s, time, total) for shift in (-0.5, 0.5)]
    gear = np.sign(log.shuttle[chords.row])
    return (ends[1] - ends[0]) / chords.span_s, chords.curvature * gear, gear


def select_clear_bends(logs: Sequence[Log], gear: float = 0.0) -> tuple[Array, Array]:
    """Return steering and curvature of the chords with clear steering, of one gear if it is not 0."""
    angles, curvatures = [np.empty(0)], [np.empty(0)]
    for log in logs:
        bends = compute_bends(log)
        if bends is not None:
            clear = (np.abs(bends[0]) >= CLEAR_STEERING_DEG) & ((bends[2] == gear) | (gear == 0.0))
            angles.append(bends[0][clear])
            curvatures.append(bends[1][clear])
    return np.concatenate(angles), np.concatenate(curvatures)


def is_steering_mirrored(angle: Array, curvature: Array) -> bool | None:
    """Whether the path turns away from the steering; None with too few bends.

    Only clear steering counts, where no offset, slope or draft can turn the tractor the other way.
    """
    if len(angle) < _FEWEST_BEND_CHORDS:
        return None
    correlation = float(angle @ curvature) / math.sqrt(float(angle @ angle) * float(curvature @ curvature) + 1e-30)
    return correlation <= -0.5 and float(np.mean(angle * curvature < 0.0)) >= _MIRRORED_SHARE
