"""Sensors that do not say what they seem to: recognised by what no tractor does, and set right in words.

Each check compares two instruments of one log. What is set right here would pass for a fault of the tractor: a speed
read too high for wheel slip, clocks that part for a dead time that grows, an angle that stands still for no grip.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from vehicle.measured.logs.bends import bends, steering
from vehicle.measured.logs.gating import FIRST_ROW_LINE, segments
from vehicle.measured.logs.motion import Motion, motion
from vehicle.measured.logs.record import Array, Gated, Log, Mask, Rows

# Speed: no slope that tractors work on carries them along by so much, and it does so one way only.
_LEAST_FACTOR, _SURE = 1.05, 5.0
_STRAIGHT_PER_M, _ALIKE = 0.03, 0.02
_NEARER = 0.4  # of a factor told of another log: nearer to that than to none, as no antenna ahead of the axle makes it
_FEWEST = 12
# Clocks: s. Windows hold several changes of the steering; lags beyond the search are no clock's.
_WINDOW_S, _SEARCH_S, _GRID_S, _SMOOTH_S = 20.0, 2.5, 0.1, 0.6
_LEAST_WINDOWS, _LEAST_DRIFT_S, _MATCHES = 5, 0.3, 0.75
# Shorter logs do not tell of two clocks: with windows of 10 s one honest log in ten seems to have them.
CLOCKS_FROM_S = _LEAST_WINDOWS * _WINDOW_S
# A wheel sensor that is off repeats one value for long; what the path says it should be is averaged over that.
_NOTHING = "steering_deg has nothing to do with the bends of the path"
_STRAY, _FOLLOWS = 0.3, 0.9  # correlations with the bends of the path: an honest sensor has no less than the second
_ALL_NOISE = 0.9  # of the spread: between two rows, over the square root of 2, it is 1 for white noise
_STILL_S, _OFF_DEG, _MOVES_DEG, _RUN_CHORDS, _OFF_SHARE = 4.0, 3.0, 2.0, 5, 0.4


def set_right(log: Log) -> Log:
    """The log with what its sensors got wrong set right, and a sentence for each in `doubts`."""
    for check in (_stray_sensor, _off_sensor, _speed_factor, _clocks):
        log = check(log)
    return log


def _speed_factor(log: Log) -> Log:
    """A measured speed that is the same multiple of the positions' pace in all directions, working or not."""
    chords = motion(log)
    if log.speed_mps is None or chords is None:
        return log
    said = log.speed_mps[chords.row]
    use = _straight(chords, said)
    if np.count_nonzero(use) < _FEWEST:
        return log
    ratio, course = said[use] / chords.speed[use], chords.course[use]
    factor = float(np.median(ratio))
    spread = 1.4826 * float(np.median(np.abs(ratio - factor)))
    # Chords overlap by half: two of them are one observation.
    error = 1.25 * spread * math.sqrt(2.0 / len(ratio))
    parts = [ratio[part] for part in _parts(course, log.implement[chords.row][use])]
    same = all(abs(float(np.median(part)) - factor) < max(_ALIKE, 3.0 * error) for part in parts)
    if max(factor, 1.0 / factor) < _LEAST_FACTOR or abs(factor - 1.0) < _SURE * error or not same:
        return log
    what = "more" if factor > 1.0 else "less"
    told = (
        f"speed_mps reads {100.0 * abs(factor - 1.0):.0f} % {what} than the positions move, alike in every direction: "
        f"the sensor's factor, not slip; it is divided by {factor:.3f}"
    )
    return replace(log, speed_mps=log.speed_mps / factor, speed_factor=factor, doubts=(*log.doubts, told))


def set_right_together(logs: Sequence[Log]) -> list[Log]:
    """Logs of a set, those that cannot tell by themselves set right as others of the set were.

    Bends alone tell a factor of the speed roughly; where that is the one that straight driving told of another log, it
    is taken. Straight driving does not tell that a wheel angle moves with nothing; where bends did, it is left out.
    """
    stray = next((one for one in logs if one.stray_deg > 0.0), None)
    if stray is not None:
        logs = [_without_stray(log, stray) for log in logs]
    told = [log for log in logs if log.speed_factor != 1.0]
    return [_as_others(log, told) for log in logs] if told else list(logs)


def _without_stray(log: Log, other: Log) -> Log:
    """A log without a wheel angle that moves and does not bend the path, as in the `other` log."""
    if log.steering_deg is None or log.steering_command_deg is None:
        return log
    moves = float(np.std(log.steering_deg[log.used])) >= min(_MOVES_DEG, 0.5 * other.stray_deg)
    if not moves or abs(_followed(replace(log, steering_command_deg=None))) > 2.0 * _STRAY:
        return log
    told = f"{_NOTHING}, as in {other.name}; it counts as not logged"
    return replace(log, steering_deg=None, stray_deg=other.stray_deg, doubts=(*log.doubts, told))


def _as_others(log: Log, told: Sequence[Log]) -> Log:
    """A log whose speed reads by about a factor that was told of others, divided by the one that is nearest."""
    chords = motion(log)
    if log.speed_mps is None or log.speed_factor != 1.0 or chords is None or len(chords.row) < _FEWEST // 2:
        return log
    said = log.speed_mps[chords.row]
    if np.count_nonzero(_straight(chords, said)) >= _FEWEST:
        return log  # it has told by itself that there is no factor, or slip in its place
    ratio = float(np.median(said / np.maximum(chords.speed, 0.05)))
    like = min(told, key=lambda other: abs(math.log(max(ratio, 1e-3) / other.speed_factor)))
    factor = like.speed_factor
    if abs(math.log(max(ratio, 1e-3) / factor)) > _NEARER * abs(math.log(factor)):
        return log
    what = (
        f"speed_mps reads about {100.0 * abs(ratio - 1.0):.0f} % {'more' if ratio > 1.0 else 'less'} than the "
        f"positions move, as in {like.name}: the same sensor; it is divided by {factor:.3f}"
    )
    return replace(log, speed_mps=log.speed_mps / factor, speed_factor=factor, doubts=(*log.doubts, what))


def _straight(chords: Motion, said: Array) -> Mask:
    """Chords that a factor of the speed `said` there can be told from."""
    straight: Mask = (np.abs(chords.curvature) < _STRAIGHT_PER_M) & (chords.speed > 0.3) & (said > 0.1)
    return straight


def _parts(course: Array, working: Array) -> list[Mask]:
    """Chords by direction of travel and by implement, those parts that hold enough."""
    east, north = np.sin(course), np.cos(course)
    parts = [east > 0.5, east < -0.5, north > 0.5, north < -0.5, working > 0.5, working <= 0.5]
    return [part for part in parts if np.count_nonzero(part) >= _FEWEST // 2]


def _clocks(log: Log) -> Log:
    """Positions stamped by a clock that runs faster or slower than that of the steering."""
    lags = _lags(log)
    if lags is None or len(lags[0]) < _LEAST_WINDOWS:
        return log
    when, lag = lags
    rate, error = _line(when, lag)
    drift = rate * float(np.ptp(when))
    if abs(drift) < _LEAST_DRIFT_S or abs(rate) < _SURE * error:
        return log
    start = float(log.time_s[log.used][0])
    slide = rate * (log.time_s - start)
    told = (
        f"the positions come {abs(60.0 * rate):.2f} s a minute {'later' if rate > 0.0 else 'earlier'} against the "
        f"steering, {abs(drift):.1f} s over the log: two clocks, not a dead time; the positions are moved back"
    )
    return replace(_moved(log, slide), doubts=(*log.doubts, told))


def _moved(log: Log, slide: Array) -> Log:
    """Position and heading as they were `slide` seconds later in the log."""
    rows = np.flatnonzero(log.used)
    time, wanted = log.time_s[rows], (log.time_s + slide)[rows]
    changed: dict[str, Any] = {}
    for name in ("easting_m", "northing_m", "heading_deg"):
        values = getattr(log, name)
        if values is None:
            continue
        plain = np.unwrap(values[rows], period=360.0) if name == "heading_deg" else values[rows]
        moved = values.copy()
        moved[rows] = np.interp(wanted, time, plain)
        changed[name] = np.mod(moved, 360.0) if name == "heading_deg" else moved
    return replace(log, **changed)


def _lags(log: Log) -> tuple[Array, Array] | None:
    """Per window: its middle (s) and how much later than the steering the path turns (s)."""
    rows = np.flatnonzero(log.used & (log.shuttle > 0.0))
    span = float(np.ptp(log.time_s[rows])) if len(rows) else 0.0
    if span < CLOCKS_FROM_S:
        return None
    grid = np.arange(log.time_s[rows[0]], log.time_s[rows[-1]], _GRID_S)
    turning, angle = _turning(log, rows, grid), np.interp(grid, log.time_s[rows], steering(log)[rows])
    pace = np.interp(grid, log.time_s[rows], _pace(log, rows))
    wheel = _smooth(angle * pace)
    width, reach = round(_WINDOW_S / _GRID_S), round(_SEARCH_S / _GRID_S)
    when, found = [], []
    for first in range(reach, len(grid) - width - reach, width):
        lag = _best_lag(wheel[first : first + width], turning[first - reach : first + width + reach], reach)
        if lag is not None:
            when.append(grid[first] + 0.5 * _WINDOW_S)
            found.append(lag * _GRID_S)
    return np.array(when), np.array(found)


def _turning(log: Log, rows: Rows, grid: Array) -> Array:
    """Turning rate by heading, or by the course where there is none, smoothed as the steering is."""
    time = log.time_s[rows]
    if log.heading_deg is not None:
        angle = np.interp(grid, time, np.unwrap(log.heading_deg[rows], period=360.0))
    else:
        east, north = (_smooth(np.interp(grid, time, axis[rows])) for axis in (log.easting_m, log.northing_m))
        angle = np.degrees(np.unwrap(np.arctan2(np.gradient(east), np.gradient(north))))
    return _smooth(np.gradient(angle, _GRID_S))


def _pace(log: Log, rows: Rows) -> Array:
    if log.speed_mps is not None:
        return log.speed_mps[rows]
    pace: Array = np.hypot(*(np.gradient(axis[rows], log.time_s[rows]) for axis in (log.easting_m, log.northing_m)))
    return pace


def _smooth(values: Array) -> Array:
    width = 2 * round(0.5 * _SMOOTH_S / _GRID_S) + 1
    padded = np.pad(values, width // 2, mode="edge")
    out: Array = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return out


def _best_lag(wheel: Array, turning: Array, reach: int) -> float | None:
    """Steps of the grid by which `turning`, which reaches further at both ends, follows; None where it does not."""
    one = wheel - wheel.mean()
    if float(np.std(one)) < 1.0:  # deg m/s: hardly steered
        return None
    scores = np.empty(2 * reach + 1)
    for shift in range(len(scores)):
        two = turning[shift : shift + len(wheel)]
        two = two - two.mean()
        scores[shift] = float(one @ two) / math.sqrt(float(one @ one) * float(two @ two) + 1e-30)
    top = int(np.argmax(scores))
    if scores[top] < _MATCHES or not 0 < top < len(scores) - 1:
        return None
    low, mid, high = scores[top - 1 : top + 2]
    bow = low - 2.0 * mid + high
    return float(top - reach + (0.5 * (low - high) / bow if bow < 0.0 else 0.0))


def _line(x: Array, y: Array) -> tuple[float, float]:
    """Slope of y over x by the median of all pairs, and its standard error from what is left."""
    first, second = np.triu_indices(len(x), 1)
    slope = float(np.median((y[second] - y[first]) / (x[second] - x[first])))
    left = y - slope * x
    spread = max(1.4826 * float(np.median(np.abs(left - np.median(left)))), 0.01)
    return slope, spread / (math.sqrt(len(x)) * float(np.std(x)))


def _off_sensor(log: Log) -> Log:
    """Rows taken out in which the wheel angle repeats one value while the path bends another way."""
    bent, chords = (None, None) if log.steering_deg is None else (bends(log), motion(log))
    if log.steering_deg is None or bent is None or chords is None:
        return log
    runs = _standing(log.time_s, log.steering_deg, log.used)
    angle, curvature, _ = bent
    moving = ~np.isin(chords.row, np.concatenate([np.empty(0, dtype=np.int64), *runs]))
    line = _steers(angle[moving], curvature[moving])
    if line is None:
        return log
    off = [run for run in runs if _is_off(angle, curvature, np.isin(chords.row, run), line)]
    if not off:
        return log
    rows = np.concatenate(off)
    used = log.used.copy()
    used[rows] = False
    rule = f"steering_deg stands still for {_STILL_S:g} s and more while the path bends: the sensor is off"
    gated = (*log.gated, Gated(rule, len(rows), int(rows[0]) + FIRST_ROW_LINE))
    return replace(log, used=used, segment=segments(log.time_s, used), gated=gated)


def _stray_sensor(log: Log) -> Log:
    """A wheel angle taken as not logged that moves with nothing: the command bends the path and it does not."""
    if log.steering_deg is None or log.steering_command_deg is None:
        return log
    by_sensor = _followed(replace(log, steering_command_deg=None))
    by_command = _followed(replace(log, steering_deg=None))
    clear = float(np.std(log.steering_deg[log.used])) >= _MOVES_DEG and by_command >= _FOLLOWS
    if abs(by_sensor) > _STRAY or not (clear or _passed_over(log)):
        return log
    told = f"{_NOTHING} (correlation {by_sensor:.2f}, that of the command {by_command:.2f}); it counts as not logged"
    return replace(log, steering_deg=None, stray_deg=float(np.std(log.steering_deg[log.used])),
                   doubts=(*log.doubts, told))  # fmt: skip


def _passed_over(log: Log) -> bool:
    """Whether the command bends the path for certain, and the wheel angle between hardly moves with it or is all noise.

    All noise: it differs as much from row to row as over the log, which wheels do not, and more than the command moves.
    """
    by_sensor, by_command = bends(replace(log, steering_command_deg=None)), bends(replace(log, steering_deg=None))
    if by_sensor is None or by_command is None or len(by_command[0]) < 2 * _FEWEST:
        return False
    command, path, wheel = by_command[0], _by_heading(log, by_command[2]), by_sensor[0]
    bent, doubt = _share_of(command, by_command[1] if path is None else path)
    moved, unsure = _share_of(command, wheel)
    rows = log.steering_deg[log.used], log.steering_command_deg[log.used]  # type: ignore[index]
    from_row_to_row = float(np.std(np.diff(rows[0]))) / math.sqrt(2.0)
    noise = from_row_to_row > max(_ALL_NOISE * float(np.std(rows[0])), float(np.std(rows[1])))
    return bent > _SURE * doubt and (noise or moved + _SURE * unsure < _STRAY)


def _by_heading(log: Log, gear: Array) -> Array | None:
    """Curvature (1/m) per chord as the heading has it, of less noise than that of positions; None without one."""
    chords = motion(log)
    if log.heading_deg is None or chords is None:
        return None
    rows = np.flatnonzero(log.used)
    time, heading = log.time_s[rows], np.unwrap(np.radians(log.heading_deg[rows]))
    middle = log.time_s[chords.row]
    start, end = (np.interp(middle + shift * chords.span_s, time, heading) for shift in (-0.5, 0.5))
    curvature: Array = gear * (end - start) / (chords.speed * chords.span_s)
    return curvature


def _share_of(one: Array, other: Array) -> tuple[float, float]:
    """How much of `one` the `other` moves by, and the standard error of that; chords overlap by half."""
    centred = one - one.mean()
    square = float(centred @ centred)
    if square == 0.0:
        return 0.0, math.inf
    share = float(centred @ other) / square
    left = other - other.mean() - share * centred
    return share, math.sqrt(2.0 * float(left @ left) / (len(one) - 2) / square)


def _followed(log: Log) -> float:
    """Correlation of the steering with the bends of the path, 1 where there are too few of them to say."""
    bent = bends(log)
    if bent is None or len(bent[0]) < 2 * _FEWEST or min(float(np.std(one)) for one in bent[:2]) == 0.0:
        return 1.0
    return float(np.corrcoef(bent[0], bent[1])[0, 1])


def _standing(time: Array, values: Array, used: Mask) -> list[Rows]:
    """Runs of rows with one and the same value that last long."""
    rows = np.flatnonzero(used)
    runs = np.split(rows, np.flatnonzero(np.diff(values[rows]) != 0.0) + 1)
    return [run for run in runs if len(run) and time[run[-1]] - time[run[0]] >= _STILL_S]


def _steers(angle: Array, curvature: Array) -> tuple[float, float, float] | None:
    """Curvature per degree and at 0, and what a chord scatters about that, from chords in which the angle moves.

    None where they do not tell it well.
    """
    if len(angle) < 2 * _FEWEST or float(np.std(angle)) < _MOVES_DEG:
        return None
    slope, at_zero = np.polyfit(angle, curvature, 1)
    left = curvature - slope * angle - at_zero
    scatter = float(np.std(left))
    error = scatter / (float(np.std(angle)) * math.sqrt(0.5 * len(angle)))
    return (float(slope), float(at_zero), scatter) if slope > 2.0 * _SURE * error else None


def _is_off(angle: Array, curvature: Array, run: Mask, line: tuple[float, float, float]) -> bool:
    """Whether the path of a run is that of other angles. Tyres that slide lose a share of theirs, and are not off."""
    if np.count_nonzero(run) < _RUN_CHORDS:
        return False
    slope, at_zero, scatter = line
    shown = angle[run]
    off = np.abs((curvature[run] - at_zero) / slope - shown) - 0.5 * np.abs(shown)
    return float(np.mean(off > _OFF_DEG + 2.0 * scatter / slope)) > _OFF_SHARE
