"""Course, speed and curvature of the path from positions alone, and the steering compared with them, chord by chord."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import Columns, Log
from vehicle.identification.logs.series import compute_change, find_spans, mark_spans, measure_noise
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    CLEAR_CORRELATION,
    FEWEST_BEND_CHORDS,
    FEWEST_READINGS,
    FEWEST_ROWS,
    FEWEST_TIMES,
    GAP_STEPS,
    LASTING_S,
    MAJORITY,
    MOST_SHARE,
    MOVING_MPS,
    READING_S,
)

_SPANS_S = (2.0, 1.0, 0.5, 0.25, 0.1)  # long chords have less noise, short ones follow the bends of small fast vehicles
_LEAST_STRAIGHTNESS = 0.93  # chord over two half chords: an arc of about 86 degrees
CLEAR_STEERING_DEG = 3.0  # more than any offset, slope or draft of usual size
_SAME_MPS = 0.02  # chosen: commands that differ by less are one
_PARTS = 5  # chosen: of a run to look at
_CHORDS_S, _NOISE_LENGTHS = (1.0, 2.0, 4.0, 8.0), 20.0  # chosen: three degrees of course by noise
_LEAST_DRIVEN_M = 2.0  # chosen, of positions that stay: more than wheels turn while a tractor starts
LEAST_TURN_DEG = 12.0  # chosen, of the course: four times its noise
# Chosen, of the pace from its slower to its faster twentieth: more than slip, and than a lever in bends.
PACE_CHANGE_MPS = 0.35
# Chosen: the path needs another angle by this much (deg, and share of the angle, which sliding tyres lose), this long.
_OTHER_ANGLE_DEG, _SLIDING_SHARE, _OTHER_ANGLE_S = 4.0, MAJORITY, 1.5 * READING_S


@dataclass(frozen=True, eq=False)
class PathChords:
    """Chords of the path, one value each.

    `row` is the row of the log at the middle, `span_s` the duration of a chord; `course` (rad, clockwise from north) is
    the direction of travel, `speed` in m/s, `curvature` (1/m) positive to the right of the travel.
    """

    row: Integers
    span_s: float
    course: Floats
    speed: Floats
    curvature: Floats


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
    """Compute chords, half before and half after their middle row, and the straightness of the most bent tenth."""
    parts = []
    for number in range(log.segment_count):  # middle rows every half span, and the steps before and after them
        rows = np.flatnonzero(log.segment == number)
        time = log.time_s[rows]
        middle_times = np.arange(time[0] + 0.5 * span, time[-1] - 0.5 * span + 1e-9, 0.5 * span)
        middle_rows = np.unique(np.minimum(np.searchsorted(time, middle_times - 1e-9), len(rows) - 1))
        middle = time[middle_rows]
        middle_rows = middle_rows[(middle - 0.5 * span >= time[0] - 1e-9) & (middle + 0.5 * span <= time[-1] + 1e-9)]
        middle = time[middle_rows]
        place = [
            np.stack(
                [np.interp(middle + shift * span, time, axis[rows]) for axis in (log.easting_m, log.northing_m)], 1
            )
            for shift in (-0.5, 0.0, 0.5)
        ]
        parts.append((rows[middle_rows], place[1] - place[0], place[2] - place[1]))
    row, first, second = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(row) < FEWEST_TIMES:
        return None
    length = np.hypot(*(first + second).T)
    halves = np.hypot(*first.T) + np.hypot(*second.T)
    moving = length > ALIKE_SHARE * np.median(halves[halves > 0.0]) if (halves > 0.0).any() else length > 0.0
    if np.count_nonzero(moving) < FEWEST_TIMES:
        return None
    row, first, second, length, halves = row[moving], first[moving], second[moving], length[moving], halves[moving]
    turn = np.arctan2(first[:, 1] * second[:, 0] - first[:, 0] * second[:, 1], (first * second).sum(axis=1))
    chord = first + second
    chords = PathChords(row, span, np.arctan2(chord[:, 0], chord[:, 1]), halves / span, 2.0 * turn / halves)
    return chords, float(np.quantile(length / halves, 0.1))


def _correlate(one: Floats, other: Floats) -> float:
    """Return the correlation of two columns (k,), 0 where one of them is constant."""
    spread = float(np.std(one)) * float(np.std(other))
    return float(np.mean((one - one.mean()) * (other - other.mean()))) / spread if spread > 0.0 else 0.0


def select_chord_steering(log: Log) -> Floats:
    """Return the sensor's angle (deg), else the command; raises LogError where these two contradict each other."""
    command, sensor = log.steering_command_deg, log.steering_deg
    if sensor is None or command is None:
        angle = command if sensor is None else sensor
        assert angle is not None
        return angle
    commanded, measured = command[log.used], sensor[log.used]
    if len(commanded) < FEWEST_READINGS:
        return sensor
    correlation = _correlate(commanded, measured)
    if correlation < -CLEAR_CORRELATION and float(np.std(commanded)) > 0.03:
        # Wheels that stand at their command for seconds, to a side, are no mirror, which only passes by them; and those
        # that stop following during a run follow before or after.
        away = np.minimum(commanded * np.sign(measured), np.abs(measured))
        spans, time = find_spans(np.abs(commanded - measured) < ALIKE_SHARE * away), log.time_s[log.used]
        stands_alike = any(time[last] - time[first] > LASTING_S for first, last in spans)
        parts = zip(np.array_split(commanded, _PARTS), np.array_split(measured, _PARTS), strict=True)
        if not stands_alike and not any(_correlate(*part) > CLEAR_CORRELATION for part in parts):
            raise LogError(
                f"{log.name}: steering_command_deg and steering_deg have opposite signs (correlation "
                f"{correlation:.2f}); make both positive to the right."
            )
    if correlation > CLEAR_CORRELATION:
        ratio = float(np.std(commanded)) / float(np.std(measured))
        if not 1.0 / 20.0 < ratio < 20.0:
            raise LogError(
                f"{log.name}: steering_command_deg moves {ratio:.3g} times as far as steering_deg; one is in radians, "
                "write both in degrees."
            )
    return sensor


def has_pace_change(pace: Floats) -> bool:
    """Whether paces (k,) differ by more than slip from the slower to the faster tenth."""
    slow, middle, fast = np.quantile(pace, (0.1, 0.5, 0.9))
    return bool(fast - slow > ALIKE_SHARE * middle)


def measure_steady_time_s(log: Log) -> Floats:
    """Return how long (s) the commanded speed of each row has been constant, from the start of its segment."""
    assert log.speed_command_mps is not None
    changed = np.abs(np.diff(log.speed_command_mps)) > _SAME_MPS
    changed |= (np.diff(log.segment) != 0) | (np.diff(log.shuttle) != 0.0)
    since = np.maximum.accumulate(np.where(np.append(True, changed), np.arange(len(log.time_s)), 0))
    return np.asarray(log.time_s - log.time_s[since])


def find_largest_steering(log: Log) -> float:
    """Return the largest absolute steering angle (deg)."""
    return float(np.abs(select_chord_steering(log)[log.used]).max())


def compute_bends(log: Log) -> tuple[Floats, Floats, Floats] | None:
    """Per chord: mean steering, curvature (1/m, to the right in a forward gear), gear (-1, 0, 1); None without any."""
    chords = compute_path_chords(log)
    if chords is None:
        return None
    rows = np.flatnonzero(log.used)
    time, values = log.time_s[rows], select_chord_steering(log)[rows]
    total = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))])
    middle = log.time_s[chords.row]
    turned = compute_change(time, total, middle - 0.5 * chords.span_s, middle + 0.5 * chords.span_s)
    gear = np.sign(log.shuttle[chords.row])
    return turned / chords.span_s, chords.curvature * gear, gear


def fit_chords(regressor: Floats, response: Floats) -> tuple[float, float]:
    """Return how values (k,) of chords change with others, and its error; chords overlap, so two count as one."""
    centred = regressor - regressor.mean()
    square = float(centred @ centred)
    if square == 0.0:
        return 0.0, math.inf
    slope = float(centred @ response) / square
    residuals = response - response.mean() - slope * centred
    return slope, math.sqrt(2.0 * float(residuals @ residuals) / (len(regressor) - 2) / square)


def select_clear_bends(logs: Sequence[Log], gear: float = 0.0) -> tuple[Floats, Floats]:
    """Return steering and curvature of the chords with clear steering, of one gear if it is not 0."""
    parts = [np.empty((2, 0))]
    for bends in filter(None, map(compute_bends, logs)):
        clear = (np.abs(bends[0]) >= CLEAR_STEERING_DEG) & ((bends[2] == gear) | (gear == 0.0))
        parts.append(np.stack(bends[:2])[:, clear])
    angle, curvature = np.concatenate(parts, axis=1)
    return angle, curvature


def is_steering_mirrored(angle: Floats, curvature: Floats) -> bool | None:
    """Whether the path turns away from clear steering, as no offset or slope makes it; None with too few bends."""
    if len(angle) < FEWEST_BEND_CHORDS:
        return None
    correlation = float(angle @ curvature) / math.sqrt(float(angle @ angle) * float(curvature @ curvature) + 1e-30)
    return correlation <= -0.5 and float(np.mean(angle * curvature < 0.0)) >= MOST_SHARE


@dataclass(frozen=True, eq=False)
class RawMotion:
    """Columns of the rows in use (k,), angles in degrees, with pace and course by chords, NaN where not known."""

    time_s: Floats
    positions: Floats
    heading: Floats | None
    speed: Floats | None
    wheel: Floats | None
    target: Floats | None
    stated_speed: Floats | None
    pace: Floats
    course: Floats

    @cached_property
    def moving(self) -> Flags:
        """Whether the tractor moves, by row."""
        moving: Flags = np.nan_to_num(self.pace) > MOVING_MPS
        return moving if self.stated_speed is None else moving | (self.stated_speed > MOVING_MPS)

    @property
    def total_s(self) -> float:
        """Time from the first row to the last."""
        return float(self.time_s[-1] - self.time_s[0])

    def get_column(self, name: str) -> Floats | None:
        """Return the values (c, k) of position, heading, speed or wheel; None for a column that is not logged."""
        if name == "position":
            return self.positions
        values: Floats | None = getattr(self, name)
        return None if values is None else values[None]

    def count_rows(self, seconds: float) -> int:
        """Return the rows of a time at the usual rate, at least one."""
        return max(round(seconds / float(np.median(np.diff(self.time_s)))), 1)

    def measure_spans(self, starts: Integers, ends: Integers) -> tuple[Floats, Flags]:
        """Return the time (s) in the rows of spans, without gaps, and whether the tractor moves in most of each."""
        steps = np.diff(self.time_s)
        driven_s = np.concatenate([[0.0], np.cumsum(np.minimum(steps, GAP_STEPS * np.median(steps)))])
        seconds = driven_s[ends] - driven_s[starts]
        moved = np.concatenate([[0.0], np.cumsum(self.moving)])
        return seconds, (moved[ends + 1] - moved[starts]) / (ends + 1 - starts) > 0.5

    def without_positions(self, spans: Sequence[tuple[int, int]]) -> RawMotion:
        """Return the motion without what the positions of these spans seem to show."""
        if not spans:
            return self
        known = ~mark_spans(len(self.time_s), spans)
        if np.count_nonzero(known) < FEWEST_ROWS:
            known[:] = True
        # The noise of a receiver that lost its fix asks for longer chords than the rest needs.
        pace, course, chord_s = _compute_chord_motion(self.time_s, self.positions, known)
        margin = self.count_rows(0.5 * chord_s) + 1
        near = mark_spans(len(self.time_s), ((max(first - margin, 0), last + margin) for first, last in spans))
        pace[near] = course[near] = np.nan
        return replace(self, pace=pace, course=course)

    def is_contradicted(self, column: str, span: tuple[int, int]) -> bool:
        """Whether other columns show that a column that repeats its value in a span should have changed."""
        rows = slice(span[0], span[1] + 1)
        pace, course = (values[rows][np.isfinite(values[rows])] for values in (self.pace, self.course))
        if column == "position":
            if self.stated_speed is None:
                return False
            speed = self.stated_speed[rows][:-1]
            driven_m = float(np.sum(np.where(speed > MOVING_MPS, speed, 0.0) * np.diff(self.time_s[rows])))
            return driven_m > _LEAST_DRIVEN_M
        if column == "heading":
            # A gear change turns the course by half a circle and the heading by nothing.
            return len(course) > 1 and float(np.ptp(0.5 * np.unwrap(2.0 * course))) > math.radians(LEAST_TURN_DEG)
        if column == "wheel":
            return self._needs_other_angle(rows)
        if self.speed is None or len(pace) < self.count_rows(_OTHER_ANGLE_S):
            return False
        slow, middle, fast = np.quantile(pace, (0.05, 0.5, 0.95))
        if self.speed[rows.start] == 0.0:
            elsewhere = np.delete(self.speed, np.arange(rows.start, rows.stop))
            return bool(middle > PACE_CHANGE_MPS) and len(elsewhere) > 0 and float(np.max(elsewhere)) > MOVING_MPS
        return bool(fast - slow > max(PACE_CHANGE_MPS, ALIKE_SHARE * middle))

    def _needs_other_angle(self, rows: slice) -> bool:
        """Whether the path of a span needs another wheel angle than the repeated one, by the bends outside it."""
        if self.wheel is None:
            return False
        curvature = self.curvature
        outside = np.isfinite(curvature)
        outside[rows] = False
        if np.count_nonzero(outside) < FEWEST_ROWS:
            return False
        if np.ptp(self.wheel[outside]) == 0.0 or np.ptp(curvature[outside]) == 0.0:
            return False
        if np.corrcoef(self.wheel[outside], curvature[outside])[0, 1] ** 2 < CLEAR_CORRELATION**2:
            return False
        slope, at_zero = np.polyfit(self.wheel[outside], curvature[outside], 1)
        repeated = float(self.wheel[rows.start])
        needed = (curvature[rows] - at_zero) / slope
        scatter = float(np.std((curvature[outside] - at_zero) / slope - self.wheel[outside]))
        excess = np.abs(needed - repeated) - _SLIDING_SHARE * abs(repeated) - 2.0 * scatter
        return int(np.count_nonzero(excess > _OTHER_ANGLE_DEG)) >= self.count_rows(_OTHER_ANGLE_S)

    @cached_property
    def curvature(self) -> Floats:
        """The curvature (rad/m) to the right per row, NaN where the tractor does not clearly move."""
        angle = self.course if self.heading is None else np.unwrap(np.radians(self.heading))
        half = max(self.count_rows(0.5 * _CHORDS_S[0]), 1)
        out = np.full(len(angle), np.nan)
        turn = angle[2 * half :] - angle[: -2 * half]
        turn = (turn + math.pi) % (2.0 * math.pi) - math.pi
        seconds = self.time_s[2 * half :] - self.time_s[: -2 * half]
        pace = self.pace[half:-half]
        ok = np.isfinite(pace) & (pace > MOVING_MPS) & np.isfinite(turn)
        out[half:-half][ok] = turn[ok] / (pace[ok] * seconds[ok])
        return out


def build_raw_motion(columns: Columns, rows: Integers) -> RawMotion:
    """Build the motion of the rows in use; missing cells of optional columns are filled with the value before."""
    time = columns["time_s"][rows]
    positions = np.stack([columns["easting_m"][rows], columns["northing_m"][rows]])
    filled: dict[str, Floats] = {}
    for name in ("heading_deg", "speed_mps", "steering_deg", "speed_command_mps"):
        values = columns[name][rows] if name in columns else np.empty(0)
        finite = np.flatnonzero(np.isfinite(values))
        if len(finite):
            place = np.searchsorted(finite, np.arange(len(values)), side="right") - 1
            filled[name] = values[finite[np.maximum(place, 0)]]
    heading, speed, wheel, target = map(filled.get, ("heading_deg", "speed_mps", "steering_deg", "speed_command_mps"))
    pace, course, _ = _compute_chord_motion(time, positions, np.ones(len(time), dtype=np.bool_))
    stated = target if speed is None or float(np.max(speed)) == 0.0 else speed
    return RawMotion(time, positions, heading, speed, wheel, target, stated, pace, course)


def _compute_chord_motion(time: Floats, positions: Floats, known: Flags) -> tuple[Floats, Floats, float]:
    """Return pace (m/s) and course (rad, clockwise from north) per row, NaN where the path is too short for one, and
    the time (s) that chords take by the noise of the `known` rows."""
    noise = measure_noise(positions[:, known])
    for span_s in _CHORDS_S:
        before, after = np.maximum(time - 0.5 * span_s, time[0]), np.minimum(time + 0.5 * span_s, time[-1])
        step = np.stack([compute_change(time, axis, before, after) for axis in positions])
        length = np.hypot(*step)
        if float(np.median(length[known])) >= _NOISE_LENGTHS * noise:
            break
    course = np.arctan2(step[0], step[1])
    course[length < max(_NOISE_LENGTHS * noise, 0.5 * MOVING_MPS * span_s)] = np.nan
    return length / (after - before), course, span_s
