"""The slope of the ground from a sensor of roll or pitch; where that cannot be had, why.

Such a sensor shows the ground, how it is mounted, and how the tractor leans where it turns or speeds up. Mounting and
lean are the same wherever the tractor is and whichever way it goes, the ground is not: there and back it changes its
sign. So they are told apart by all logs of a tractor together, with the ground as a height that is smooth over the
field.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.measured.logs.record import Array, Log

STEEPEST_DEG = 60.0  # a tractor on such a slope has rolled over
WIDTHS_S = (0.3, 0.6, 1.0, 1.6, 2.5, 4.0)  # to smooth over: a tractor drives its own length in 2 to 4 s
SURE = 5.0  # standard errors: what is taken off, or claimed
BLOCK_S = 5.0  # rows of one block tell of the ground once
_LEAST_TRUE = 0.9  # of the variance of the slope: noise that is left makes what depends on it read that much too low
_LEAST_SLOPE = 0.004  # root mean square: less changes no drive by what can be seen
_SURE_MOUNTING = 0.3  # of the slope: what the mounting may be unsure by
# What is expected of mounting (slope), lean (slope per m/s2: an accelerometer shows 1 / g) and ground (slope).
_MOUNTING, _LEAN, _GROUND = 0.1, 0.1, 0.15


@dataclass(frozen=True, eq=False)
class Level:
    """Rows in use of all logs, one after another: the fall of the ground that way, and what belongs to it.

    `fall` (m/m) is positive where the ground falls to the right (of roll, positive with the right side lower) or ahead
    (of pitch, positive nose up). `heading` is in rad, clockwise from north; `block` numbers stretches of BLOCK_S, `log`
    the logs. `usual` is the root mean square of the fall, `mounting_deg` what was taken off the sensor.
    """

    fall: Array
    heading: Array
    block: Array
    log: Array
    usual: float
    mounting_deg: float


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows in use of all logs: the fall shown, acceleration that way (m/s2), place (m), its direction, block, log."""

    shown: Array
    push: Array
    east: Array
    north: Array
    way: Array
    block: Array
    log: Array


def levelled(logs: Sequence[Log], column: str) -> Level | str:
    """The fall of the ground by `roll_deg` or `pitch_deg`, which some log has; or why it cannot be told, a clause."""
    having = [log for log in logs if getattr(log, column) is not None]
    if len(having) < len(logs):
        return f"it is logged in {len(having)} of {len(logs)} logs only"
    if any(log.heading_deg is None for log in logs):
        return "a heading is needed beside it"
    shown = [_shown(log, column) for log in logs]
    if all(np.ptp(one) == 0.0 for one in shown):
        return "it is the same in every row, a sensor that is off or ground without a slope"
    width, noise = _width(logs, shown)
    rows = _rows(logs, [smoothed(log, one, width) for log, one in zip(logs, shown, strict=True)], column)
    found = _mounted(rows)
    if found is None:
        return "the drives do not tell the ground from the mounting of the sensor, as there and back would"
    mounting, lean = found
    fall = rows.shown - mounting - lean * rows.push
    usual = float(np.sqrt(np.mean(fall**2)))
    if usual < _LEAST_SLOPE or noise > (1.0 - _LEAST_TRUE) * usual**2:
        return "it holds no slope above its noise, flat ground or a sensor that is off"
    heading = rows.way - (0.5 * math.pi if column == "roll_deg" else 0.0)
    degrees = math.degrees(math.atan(mounting)) * (1.0 if column == "roll_deg" else -1.0)
    return Level(fall, heading, rows.block, rows.log, usual, degrees)


def per_row(logs: Sequence[Log], level: Level, values: Array) -> tuple[Array, ...]:
    """Values of the rows in use as one array per log with all its rows, 0 in those that are not used."""
    parts = []
    for number, log in enumerate(logs):
        whole = np.zeros(len(log.used))
        whole[log.used] = values[level.log == number]
        parts.append(whole)
    return tuple(parts)


def _shown(log: Log, column: str) -> Array:
    """Fall that the sensor shows in the rows in use; a line stands in where it is missing or impossible."""
    angle, time = getattr(log, column)[log.used], log.time_s[log.used]
    good = np.abs(angle) <= STEEPEST_DEG
    if not good.any():
        return np.zeros(len(angle))
    out: Array = np.tan(np.radians(np.interp(time, time[good], angle[good])))
    return out if column == "roll_deg" else -out


def smoothed(log: Log, values: Array, width_s: float) -> Array:
    """Mean over `width_s` about every row of its own stretch."""
    return _means(log, values, width_s)[0]


def _means(log: Log, values: Array, width_s: float) -> tuple[Array, Array]:
    """Mean over `width_s` about every row of its own stretch, and of how many rows."""
    out, count = np.empty_like(values), np.ones(len(values))
    segment, time = log.segment[log.used], log.time_s[log.used]
    for number in range(log.segments):
        mine = segment == number
        when, total = time[mine], np.concatenate([[0.0], np.cumsum(values[mine])])
        first = np.searchsorted(when, when - 0.5 * width_s - 1e-9)
        end = np.searchsorted(when, when + 0.5 * width_s + 1e-9)
        count[mine] = end - first
        out[mine] = (total[end] - total[first]) / count[mine]
    return out, count


def _width(logs: Sequence[Log], shown: Sequence[Array]) -> tuple[float, float]:
    """Width (s) whose means foretell rows that had no part in them best, and the variance of noise that is left."""
    best = (np.inf, 0.0, 0.0)
    for width in WIDTHS_S:
        off, rows, shares = 0.0, 0, 0.0
        for log, values in zip(logs, shown, strict=True):
            mean, count = _means(log, values, width)
            many = count > 1.0
            # A row's own part in its mean is 1 / count: without it the row is off by count / (count - 1) as much.
            off += float(np.sum(((values - mean)[many] * count[many] / (count[many] - 1.0)) ** 2))
            rows, shares = rows + int(np.count_nonzero(many)), shares + float(np.sum(1.0 / count[many]))
        if rows and off / rows < best[0]:
            share = shares / rows
            best = (off / rows, width, off / rows * share / (1.0 + share))
    return best[1], best[2]


def _rows(logs: Sequence[Log], shown_of: Sequence[Array], column: str) -> _Rows:
    parts = []
    for number, (log, shown) in enumerate(zip(logs, shown_of, strict=True)):
        time, used = log.time_s[log.used], log.used
        assert log.heading_deg is not None
        heading = np.unwrap(np.radians(log.heading_deg[used]))
        speed = np.hypot(*(np.gradient(axis[used], time) for axis in (log.easting_m, log.northing_m)))
        pace = smoothed(log, speed, 1.0) * np.where(log.shuttle[used] < 0.0, -1.0, 1.0)
        if column == "roll_deg":
            push, way = pace * np.gradient(smoothed(log, heading, 1.0), time), heading + 0.5 * math.pi
        else:
            push, way = np.gradient(pace, time), heading
        block = np.floor((time - time[0]) / BLOCK_S)
        parts.append((shown, push, log.easting_m[used], log.northing_m[used], way, block, np.full(len(time), number)))
    shown, push, east, north, way, block, log_of = (np.concatenate(one) for one in zip(*parts, strict=True))
    return _Rows(shown, push, east, north, way, block + 1e6 * log_of, log_of)


def _mounted(rows: _Rows) -> tuple[float, float] | None:
    """Mounting (slope) and lean (slope per m/s2) of the sensor; None where the drives do not tell the first well.

    Least squares with what is expected of each number: what the drives do not tell stays as unsure as before.
    """
    columns = np.concatenate([np.ones((len(rows.shown), 1)), rows.push[:, None], _ground(rows)], axis=1)
    spread = np.concatenate([[_MOUNTING, _LEAN], np.full(columns.shape[1] - 2, _GROUND)])
    blocks = len(np.unique(rows.block))
    noise = float(np.var(rows.shown))
    for _ in range(3):
        weight = blocks / (len(rows.shown) * max(noise, 1e-8))
        square = weight * columns.T @ columns + np.diag(1.0 / spread**2)
        at = np.linalg.solve(square, weight * columns.T @ rows.shown)
        noise = float(np.mean((rows.shown - columns @ at) ** 2))
    error = np.sqrt(np.diag(np.linalg.inv(square)))
    slope = float(np.sqrt(np.mean((rows.shown - at[0] - at[1] * rows.push) ** 2)))
    if error[0] > max(_SURE_MOUNTING * slope, _LEAST_SLOPE):
        return None
    return float(at[0]), float(at[1]) if abs(at[1]) > SURE * error[1] else 0.0


def _ground(rows: _Rows) -> Array:
    """Fall that way of ground whose height is a polynomial of the place, per coefficient (n, 9)."""
    size = max(float(np.std(rows.east)), float(np.std(rows.north)), 1.0)
    east, north = ((axis - float(np.mean(axis))) / size for axis in (rows.east, rows.north))
    to_east, to_north = np.sin(rows.way), np.cos(rows.way)
    columns = []
    for degree in (1, 2, 3):
        for p in range(degree + 1):
            q = degree - p
            along = p * east ** max(p - 1, 0) * north**q * to_east + q * east**p * north ** max(q - 1, 0) * to_north
            columns.append(along / degree)
    return np.stack(columns, axis=1)
