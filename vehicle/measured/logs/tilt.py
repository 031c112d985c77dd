"""The slope of the ground across the way, from roll that was measured; where that cannot be had, a sentence why.

A roll sensor shows the ground, how it is mounted, and how the tractor leans in bends. Mounting and lean are the same
wherever the tractor is and whichever way it goes, the ground is not: there and back it changes its sign. So they are
told apart by all logs of a tractor together, with the ground as a height that is smooth over the field.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vehicle.measured.logs.motion import motion
from vehicle.measured.logs.record import Array, Fix, Log, asking

STEEPEST_DEG = 60.0  # a tractor on such a slope has rolled over
WIDTHS_S = (0.3, 0.6, 1.0, 1.6, 2.5, 4.0)  # to smooth over: a tractor drives its own length in 2 to 4 s
_LEAST_TRUE = 0.9  # of the variance of the slope: noise that is left makes a drift per slope read that much too low
_LEAST_SLOPE = 0.004  # root mean square: less moves no tractor aside by what can be seen
_BLOCK_S, _FEWEST_BLOCKS = 5.0, 6  # rows of one block tell of the ground once
_SURE_MOUNTING = 0.3  # of the slope: what the mounting may be unsure by
_SURE, _UPHILL = 5.0, 3.0  # standard errors: a lean that is taken off, a drift that a slope not used may cost
_STRAIGHT_PER_M = 0.03
_COMPASS_RAD = 0.004  # a quarter of a degree, which a heading drifts by from run to run
_LEAST_DRIFT = 0.03  # m/m per slope; tyres give way by about a tenth of the slope, soil by more
# What is expected of mounting (slope), lean (slope per m/s2: an accelerometer shows 1 / g) and ground (slope).
_MOUNTING, _LEAN, _GROUND = 0.1, 0.1, 0.15


@dataclass(frozen=True, eq=False)
class Tilt:
    """Slope of the ground to the right (m/m, right side lower is positive) per row of each log, in the logs' order.

    `east`, `north` are the fall of the ground per metre that way in the mean of the drives, `usual` the root mean
    square of the slope across the way. `remarks` are sentences.
    """

    across: tuple[Array, ...] = ()
    east: float = 0.0
    north: float = 0.0
    usual: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def plane(self) -> tuple[float, float, float]:
        """The mean fall (m/m), the bearing it falls to (deg, clockwise from north) and the usual slope across."""
        bearing = float(np.degrees(np.arctan2(self.east, self.north))) % 360.0
        return float(np.hypot(self.east, self.north)), bearing, self.usual

    @property
    def known(self) -> bool:
        """Whether the slope can be used."""
        return bool(self.across)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Rows in use of all logs: the slope shown, side acceleration (m/s2), place (m), heading, block and log."""

    shown: Array
    side: Array
    east: Array
    north: Array
    heading: Array
    block: Array
    log: Array


def tilt(logs: Sequence[Log]) -> Tilt:
    """The slope across the way of all logs, or only a remark where roll was logged and cannot be used."""
    having = [log for log in logs if log.roll_deg is not None]
    if not having:
        return Tilt()
    if len(having) < len(logs):
        return _unused(f"it is logged in {len(having)} of {len(logs)} logs only")
    if any(log.heading_deg is None for log in logs):
        return _unused("a heading is needed beside it")
    if all(np.ptp(_shown(log)) == 0.0 for log in logs):
        return _unused("it is the same in every row, a sensor that is off or ground without a slope")
    width, noise = _width(logs)
    smoothed = [_smoothed(log, _shown(log), width) for log in logs]
    rows = _rows(logs, smoothed)
    found = _levelled(rows)
    if found is None:
        return _unused("the drives do not tell the ground from the mounting of the sensor, as there and back would")
    mounting, lean = found
    across = rows.shown - mounting - lean * rows.side
    usual = float(np.sqrt(np.mean(across**2)))
    if usual < _LEAST_SLOPE or noise > (1.0 - _LEAST_TRUE) * usual**2:
        return _unused("it holds no slope above its noise, flat ground or a sensor that is off")
    return _told(logs, rows, across, mounting, usual)


def _unused(why: str) -> Tilt:
    return Tilt(remarks=(f"roll_deg is not used: {why}. A plane stands in for the slope of the ground.",))


def _told(logs: Sequence[Log], rows: _Rows, across: Array, mounting: float, usual: float) -> Tilt:
    """The slope as it is used, unless the tractor drifts uphill on it."""
    drift, error = _drift(logs, rows, across)
    if drift < -max(_LEAST_DRIFT, _UPHILL * error):
        return _unused(
            "it grows where the tractor drifts to the left, and none drifts uphill; where it counts up with the left "
            f"side lower, give {asking(Fix.ROLL_LEFT)}"
        )
    told = (
        f"roll_deg gives the slope across the way, {100.0 * usual:.1f} % in the root mean square, after its mounting "
        f"({float(np.degrees(np.arctan(mounting))):+.1f} degrees) and the lean in bends were taken off."
    )
    sides = np.stack([np.cos(rows.heading), -np.sin(rows.heading)], axis=1)
    east, north = np.linalg.lstsq(sides, across, rcond=None)[0]
    parts = []
    for number, log in enumerate(logs):
        whole = np.zeros(len(log.used))
        whole[log.used] = across[rows.log == number]
        parts.append(whole)
    return Tilt(tuple(parts), float(east), float(north), usual, (told,))


def _shown(log: Log) -> Array:
    """Slope that the sensor shows in the rows in use; a line stands in where it is missing or impossible."""
    assert log.roll_deg is not None
    roll, time = log.roll_deg[log.used], log.time_s[log.used]
    good = np.abs(roll) <= STEEPEST_DEG
    if not good.any():
        return np.zeros(len(roll))
    out: Array = np.tan(np.radians(np.interp(time, time[good], roll[good])))
    return out


def _smoothed(log: Log, values: Array, width_s: float) -> Array:
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


def _width(logs: Sequence[Log]) -> tuple[float, float]:
    """Width (s) whose means foretell rows that had no part in them best, and the variance of noise that is left."""
    best = (np.inf, 0.0, 0.0)
    for width in WIDTHS_S:
        off, rows, shares = 0.0, 0, 0.0
        for log in logs:
            values = _shown(log)
            mean, count = _means(log, values, width)
            many = count > 1.0
            # A row's own part in its mean is 1 / count: without it the row is off by count / (count - 1) as much.
            off += float(np.sum(((values - mean)[many] * count[many] / (count[many] - 1.0)) ** 2))
            rows, shares = rows + int(np.count_nonzero(many)), shares + float(np.sum(1.0 / count[many]))
        if rows and off / rows < best[0]:
            share = shares / rows
            best = (off / rows, width, off / rows * share / (1.0 + share))
    return best[1], best[2]


def _rows(logs: Sequence[Log], smoothed: Sequence[Array]) -> _Rows:
    parts = []
    for number, (log, shown) in enumerate(zip(logs, smoothed, strict=True)):
        time, used = log.time_s[log.used], log.used
        assert log.heading_deg is not None
        heading = np.unwrap(np.radians(log.heading_deg[used]))
        speed = np.hypot(*(np.gradient(axis[used], time) for axis in (log.easting_m, log.northing_m)))
        way = _smoothed(log, speed, 1.0) * np.where(log.shuttle[used] < 0.0, -1.0, 1.0)
        side = way * np.gradient(_smoothed(log, heading, 1.0), time)
        block = np.floor((time - time[0]) / _BLOCK_S)
        parts.append(
            (shown, side, log.easting_m[used], log.northing_m[used], heading, block, np.full(len(time), number))
        )
    shown, side, east, north, heading, block, log_of = (np.concatenate(column) for column in zip(*parts, strict=True))
    return _Rows(shown, side, east, north, heading, block + 1e6 * log_of, log_of)


def _levelled(rows: _Rows) -> tuple[float, float] | None:
    """Mounting (slope) and lean (slope per m/s2) of the sensor; None where the drives do not tell the first well.

    Least squares with what is expected of each number: what the drives do not tell stays as unsure as before.
    """
    columns = np.concatenate([np.ones((len(rows.shown), 1)), rows.side[:, None], _ground(rows)], axis=1)
    spread = np.concatenate([[_MOUNTING, _LEAN], np.full(columns.shape[1] - 2, _GROUND)])
    blocks = len(np.unique(rows.block))
    noise = float(np.var(rows.shown))
    for _ in range(3):
        weight = blocks / (len(rows.shown) * max(noise, 1e-8))
        square = weight * columns.T @ columns + np.diag(1.0 / spread**2)
        at = np.linalg.solve(square, weight * columns.T @ rows.shown)
        noise = float(np.mean((rows.shown - columns @ at) ** 2))
    error = np.sqrt(np.diag(np.linalg.inv(square)))
    slope = float(np.sqrt(np.mean((rows.shown - at[0] - at[1] * rows.side) ** 2)))
    if error[0] > max(_SURE_MOUNTING * slope, _LEAST_SLOPE):
        return None
    return float(at[0]), float(at[1]) if abs(at[1]) > _SURE * error[1] else 0.0


def _ground(rows: _Rows) -> Array:
    """Slope to the right of ground whose height is a polynomial of the place, per coefficient (n, 9)."""
    size = max(float(np.std(rows.east)), float(np.std(rows.north)), 1.0)
    east, north = ((axis - float(np.mean(axis))) / size for axis in (rows.east, rows.north))
    to_east, to_north = np.cos(rows.heading), -np.sin(rows.heading)
    columns = []
    for degree in (1, 2, 3):
        for p in range(degree + 1):
            q = degree - p
            along = p * east ** max(p - 1, 0) * north**q * to_east + q * east**p * north ** max(q - 1, 0) * to_north
            columns.append(along / degree)
    return np.stack(columns, axis=1)


def _drift(logs: Sequence[Log], rows: _Rows, across: Array) -> tuple[float, float]:
    """Drift to the right per metre and slope, and its standard error, from course and heading on straight chords."""
    slopes, crabs, blocks = [], [], []
    for number, log in enumerate(logs):
        chords = motion(log)
        if chords is None:
            continue
        mine = np.full(len(log.used), np.nan)
        mine[log.used] = across[rows.log == number]
        heading, block = mine.copy(), mine.copy()
        heading[log.used], block[log.used] = rows.heading[rows.log == number], rows.block[rows.log == number]
        use = (np.abs(chords.curvature) < _STRAIGHT_PER_M) & (log.shuttle[chords.row] > 0.0) & (chords.speed > 0.3)
        crab = chords.course - heading[chords.row]
        slopes.append(mine[chords.row][use])
        crabs.append(np.arctan2(np.sin(crab), np.cos(crab))[use])
        blocks.append(block[chords.row][use])
    x, y, block = (np.concatenate(one) if one else np.zeros(0) for one in (slopes, crabs, blocks))
    x, y = x - (x.mean() if len(x) else 0.0), y - (np.median(y) if len(y) else 0.0)
    spread = float(x @ x)
    if len(np.unique(block)) < _FEWEST_BLOCKS or spread == 0.0:
        return 0.0, np.inf
    drift = float(x @ y) / spread
    left = x * (y - y.mean() - drift * x)
    sums = np.array([left[block == one].sum() for one in np.unique(block)])
    compass = _COMPASS_RAD / (np.sqrt(len(slopes)) * float(np.std(x)))
    return drift, float(np.hypot(np.sqrt(sums @ sums) / spread, compass))
