"""Clocks: positions stamped by another one that runs faster or slower, and time stamps that jitter or come in bundles.

Only kinematics can tell: positions move as fast as the measured speed says and where the heading points, whatever the
steering does. A lead or lag against the steering is no evidence, as a controller in the loop makes the steering follow
the path. So the mismatch of positions with speed, and with heading, is tabulated over lags in windows of time, and a
lag that grows evenly must explain it better than a constant one: in both halves of the log, in windows that had no part
in the estimate, and better than with the windows in any other order.

Rows taken evenly may be stamped when they came, as loggers on a busy computer do; where a line holds rows back, several
come at once, of which the last one has waited least. A tractor moves on by as much as the time between two rows. Where
positions advance evenly from row to row, whatever the time between them, it is the stamps that are wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from fields.arrays import Flags, Floats, Integers
from vehicle.identification.logs.schema import Columns, Log
from vehicle.identification.logs.series import compute_change
from vehicle.identification.logs.thresholds import (
    ALIKE_SHARE,
    ALMOST_ALL_SHARE,
    CLEAR_SIGMAS,
    FEW_SHARE,
    FEWEST_CHORDS,
    FEWEST_EVENTS,
    FEWEST_LINE_ROWS,
    GAP_STEPS,
    GRID_S,
    MAJORITY,
    MOVING_MPS,
    NEARLY_SHARE,
    POSITION_NOISE_M,
    READING_S,
    WINDOW_S,
)

_SEARCH_S, _FINE_S = 2.5, 0.02
_HALF_CHORD_S = 0.5 * READING_S  # one centimetre of antenna noise is 1.4 cm/s over one second
_LEAST_DRIFT_S = 0.3
# Shorter logs cannot show two clocks.
CLOCKS_FROM_S = 10.0 * WINDOW_S
_NULL_ORDERS = 100  # chosen, other orders of the windows, all of which must gain less than the true one

Drift = tuple[float, float]
"""A lag (s) that grows evenly: at the start of the log, and per second."""

_WINDOW_ROWS = 2 * FEWEST_EVENTS + 1  # chosen: the clock of a logger keeps its rate over so many rows
# Chosen, of the mean step: usual steps within bundles, and the least one between two of them; a bundle that is late by
# so many steps comes after lost rows; more of those are no rate.
_AT_ONCE_SHARE, _LOST_STEPS = 0.2, 0.75


@dataclass(frozen=True, eq=False)
class LagTable:
    """Mismatch of two instruments per window and lag: `middle_s` (w,) and `losses` (w, lags), by steps of `_FINE_S`."""

    middle_s: Floats
    losses: Floats

    def select_windows(self, windows: Integers) -> LagTable:
        """The table of some windows."""
        return LagTable(self.middle_s[windows], self.losses[windows])


def correct_position_clock(log: Log) -> Log:
    """Correct positions, or positions and heading, whose clock drifts against that of the other instruments."""
    against_speed, against_heading = measure_speed_lags(log), measure_heading_lags(log)
    speed_drift, heading_drift = find_drift(against_speed), find_drift(against_heading)
    drift = speed_drift or heading_drift
    if drift is None:
        return log
    rate, is_heading_along = drift[1], heading_drift is None and log.heading_deg is not None
    if is_heading_along and against_heading is not None:
        lag, loss = _fit_constant(against_heading)
        moving = (lag - rate * float(against_heading.middle_s.mean()), rate)
        if not loss < _compute_line_loss(against_heading, moving):
            return log  # speed and heading contradict each other about the positions
    rows = np.flatnonzero(log.used)
    since_start_s = log.time_s - log.time_s[rows[0]]
    what = "positions and headings" if is_heading_along else "positions"
    other = "the measured speed" if speed_drift is not None else "the heading"
    message = (
        f"the {what} get {abs(60.0 * rate):.2f} s a minute {'later' if rate > 0.0 else 'earlier'} against {other}, "
        f"{abs(rate) * float(since_start_s[rows[-1]]):.1f} s over the log: two clocks; they are shifted back"
    )
    time, shifted_s = log.time_s[rows], (log.time_s + rate * since_start_s)[rows]
    changed: dict[str, Any] = {}
    for name in ("easting_m", "northing_m", *(("heading_deg",) if is_heading_along else ())):
        values = getattr(log, name)
        if values is None:
            continue
        unwrapped = np.unwrap(values[rows], period=360.0) if name == "heading_deg" else values[rows]
        shifted = values.copy()
        shifted[rows] = np.interp(shifted_s, time, unwrapped)
        changed[name] = np.mod(shifted, 360.0) if name == "heading_deg" else shifted
    return log.correct_columns(message, **changed)


def measure_speed_lags(log: Log) -> LagTable | None:
    """Tabulate how badly positions, so much later, move at the measured speed; None for logs that cannot show it."""
    grid = None if log.speed_mps is None else _resample_motion(log)
    if grid is None:
        return None
    pace = np.hypot(grid.east_mps, grid.north_mps)

    def compute_losses(window: Integers, moved: Integers) -> Floats:
        return _sum_unexplained_squares(pace[moved], grid.speed[window])

    return _tabulate_losses(grid, compute_losses)


def measure_heading_lags(log: Log) -> LagTable | None:
    """Tabulate how badly positions, so much later, move where the heading points; None for logs that cannot show it.

    An antenna ahead of the axle moves sideways with the turning rate, and one that is biased with the pace; both are
    left to every window.
    """
    grid = None if log.heading_deg is None else _resample_motion(log)
    if grid is None:
        return None
    cosine, sine = np.cos(grid.heading), np.sin(grid.heading)
    # How far the antenna is ahead of the point without side slip (m), from all of the log at no lag.
    aside_mps, square = grid.east_mps * cosine - grid.north_mps * sine, float(grid.turning @ grid.turning)
    lever = float(aside_mps @ grid.turning) / square if square > 0.0 else 0.0

    def compute_losses(window: Integers, moved: Integers) -> Floats:
        east, north = grid.east_mps[moved], grid.north_mps[moved]
        aside = east * cosine[window] - north * sine[window] - lever * grid.turning[window]
        along = east * sine[window] + north * cosine[window]
        return _sum_unexplained_squares(aside, along)

    return _tabulate_losses(grid, compute_losses)


@dataclass(frozen=True, eq=False)
class _Motion:
    """Motion on an even grid of `GRID_S`: velocity of the positions, speed, heading (rad, clockwise), turning rate.

    `moving` marks where the tractor drives forward in used rows.
    """

    time_s: Floats
    east_mps: Floats
    north_mps: Floats
    speed: Floats
    heading: Floats
    turning: Floats
    moving: Floats


def _resample_motion(log: Log) -> _Motion | None:
    rows = np.flatnonzero(log.used)
    if len(rows) < 2 or float(np.ptp(log.time_s[rows])) < CLOCKS_FROM_S:
        return None
    time = log.time_s[rows]
    grid = np.arange(time[0] + _HALF_CHORD_S, time[-1] - _HALF_CHORD_S, GRID_S)

    def compute_slope(values: Floats) -> Floats:
        return compute_change(time, values, grid - _HALF_CHORD_S, grid + _HALF_CHORD_S) / (2.0 * _HALF_CHORD_S)

    def compute_mean(values: Floats) -> Floats:
        return compute_slope(np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(time))]))

    heading = np.zeros(len(rows)) if log.heading_deg is None else np.unwrap(np.radians(log.heading_deg[rows]))
    speed = np.zeros(len(rows)) if log.speed_mps is None else log.speed_mps[rows]
    moving = np.interp(grid, time, (log.shuttle[rows] > 0.0).astype(np.float64)) == 1.0
    return _Motion(
        grid, compute_slope(log.easting_m[rows]), compute_slope(log.northing_m[rows]), compute_mean(speed),
        compute_mean(heading), compute_slope(heading), moving.astype(np.float64),
    )  # fmt: skip


def _sum_unexplained_squares(values: Floats, regressor: Floats) -> Floats:
    """Return the sums of squares (l,) that multiples of a regressor, (l, k) or (k,), leave of values (l, k)."""
    share = (regressor * values).sum(axis=1) / ((regressor * regressor).sum(axis=-1) + 1e-12)
    return np.asarray(((values - regressor * share[:, None]) ** 2).sum(axis=1))


def _tabulate_losses(grid: _Motion, compute_losses: Callable[[Integers, Integers], Floats]) -> LagTable | None:
    """Tabulate losses over windows in motion and lags; None with too few windows. `compute_losses` gets the steps of a
    window (k,) and those of the window moved by every lag (l, k)."""
    from scipy.interpolate import CubicSpline

    width, reach = round(WINDOW_S / GRID_S), round(_SEARCH_S / GRID_S)
    lags = np.arange(-reach, reach + 1)
    pace = np.hypot(grid.east_mps, grid.north_mps)
    middles_s, losses = [], []
    for first in range(reach, len(grid.time_s) - width - reach + 1, width):
        window = np.arange(first, first + width)
        around = slice(first - reach, first + width + reach)
        if grid.moving[around].min() == 0.0 or float(np.median(pace[around])) < MOVING_MPS:
            continue
        middles_s.append(float(grid.time_s[window].mean() - grid.time_s[0]))
        losses.append(compute_losses(window, window + lags[:, None]) / width)
    if len(middles_s) < FEWEST_CHORDS:
        return None
    fine = np.arange(-_SEARCH_S, _SEARCH_S + 0.5 * _FINE_S, _FINE_S)
    table = CubicSpline(lags * GRID_S, np.array(losses), axis=1)(fine)
    return LagTable(np.array(middles_s), table)


def find_drift(table: LagTable | None) -> Drift | None:
    """Find a lag that grows evenly over the log; None unless it passes every test of the module's head."""
    if table is None:
        return None
    drift, loss = _fit_line(table)
    span_s = float(np.ptp(table.middle_s))
    constant_loss = _fit_constant(table)[1]
    if abs(drift[1]) * span_s < _LEAST_DRIFT_S or loss > NEARLY_SHARE * constant_loss:
        return None
    count = len(table.middle_s)
    numbers = np.arange(count)
    for half in (numbers[: count // 2], numbers[count // 2 :]):
        share = _fit_line(table.select_windows(half))[0][1] / drift[1]
        if not MAJORITY <= share <= 1.0 + MAJORITY:  # with a fifth of a window of error either way
            return None
    # The line of every other window leaves less mismatch in the others than their constant lag.
    by_line = by_constant = 0.0
    for parity in (0, 1):
        fitted, other = (table.select_windows(numbers[numbers % 2 == rest]) for rest in (parity, 1 - parity))
        by_line += _compute_line_loss(other, _fit_line(fitted)[0])
        by_constant += _compute_line_loss(other, (_fit_constant(fitted)[0], 0.0))
    if not by_line < NEARLY_SHARE * by_constant:
        return None
    rng = np.random.default_rng(0)
    for _ in range(_NULL_ORDERS):
        shuffled = LagTable(table.middle_s, table.losses[rng.permutation(count)])
        if constant_loss - loss <= _fit_constant(shuffled)[1] - _fit_line(shuffled)[1]:
            return None
    return drift


def _fit_constant(table: LagTable) -> tuple[float, float]:
    """Return the constant lag (s) of least mismatch, and the mismatch."""
    total = table.losses.sum(axis=0)
    best = int(np.argmin(total))
    return best * _FINE_S - _SEARCH_S, float(total[best])


def _fit_line(table: LagTable) -> tuple[Drift, float]:
    """Return the evenly growing lag of least mismatch, and the mismatch: a coarse search, then a fine one around it."""
    first_s, span_s = float(table.middle_s[0]), max(float(np.ptp(table.middle_s)), GRID_S)
    coarse = np.arange(-_SEARCH_S, _SEARCH_S + 0.5 * GRID_S, GRID_S)
    start, end, _ = _search_lines(table, coarse, coarse)
    near = np.arange(-GRID_S, GRID_S + 0.5 * _FINE_S, _FINE_S)
    start, end, loss = _search_lines(table, start + near, end + near)
    rate = (end - start) / span_s
    return (start - rate * first_s, rate), loss


def _search_lines(table: LagTable, starts: Floats, ends: Floats) -> tuple[float, float, float]:
    """Return the lags at the first and last window of least mismatch, and the mismatch."""
    share = (table.middle_s - table.middle_s[0]) / max(float(np.ptp(table.middle_s)), GRID_S)
    total = np.zeros((len(starts), len(ends)))
    for place, losses in zip(share, table.losses, strict=True):
        lag = (1.0 - place) * starts[:, None] + place * ends[None, :]
        total += losses[_find_columns(lag, len(losses))]
    best = np.unravel_index(int(np.argmin(total)), total.shape)
    return float(starts[best[0]]), float(ends[best[1]]), float(total[best])


def _compute_line_loss(table: LagTable, drift: Drift) -> float:
    columns = _find_columns(drift[0] + drift[1] * table.middle_s, table.losses.shape[1])
    return float(table.losses[np.arange(len(columns)), columns].sum())


def _find_columns(lag: Floats, count: int) -> Integers:
    """Return the columns of a table that lags (s) are nearest to."""
    return np.asarray(np.clip(np.round((lag + _SEARCH_S) / _FINE_S), 0, count - 1).astype(np.int64))


def even_time_stamps(columns: Columns) -> tuple[Columns, tuple[str, ...]]:
    """Return the columns with evened time stamps and a sentence on them, where the stamps jitter or come in bundles
    while positions advance evenly; else as they are."""
    time, east, north = (columns.get(name) for name in ("time_s", "easting_m", "northing_m"))
    if time is None or east is None or north is None or len(time) < FEWEST_LINE_ROWS:
        return columns, ()
    if not np.all(np.isfinite(time)) or np.any(np.diff(time) < 0.0):
        return columns, ()
    bundled, step_s = is_bundled(time), float(np.median(np.diff(time)))
    evened = spread_bundles(time) if bundled else _smooth_stamps(time, step_s)
    if evened is None or np.any(np.diff(evened) <= 0.0):
        return columns, ()
    jitter_s = float(np.std(time - evened))
    if not bundled and not jitter_s > FEW_SHARE * step_s:
        return columns, ()
    share, error = measure_followed_share(time, evened, np.hypot(np.diff(east), np.diff(north)))
    if not share + CLEAR_SIGMAS * error < ALIKE_SHARE:
        return columns, ()
    taken_s, bundles = float(np.median(np.diff(evened))), np.count_nonzero(_find_waits(time)) + 1
    what = f"time_s jitters by {1000.0 * jitter_s:.0f} ms: positions advance evenly from row to row whatever the time "
    what += "between them"
    if bundled:
        what = f"rows come in bundles of about {len(time) / bundles:.0f}, stamped on arrival, while positions advance "
        what += "evenly from row to row"
    sentence = f"{what}, so rows were taken every {taken_s:.2g} s; the times are evened"
    return {**columns, "time_s": evened}, (sentence,)


def is_bundled(time: Floats) -> bool:
    """Whether most rows follow the one before them at once, as they do where several come together."""
    steps = np.diff(time)
    return len(steps) > 0 and float(np.median(steps)) < _AT_ONCE_SHARE * float(np.mean(steps))


def _find_waits(time: Floats) -> Flags:
    """Mark the steps (k - 1,) between bundles; all others are steps within one."""
    steps = np.diff(time)
    return np.asarray(steps > MAJORITY * np.mean(steps))


def spread_bundles(time: Floats) -> Floats | None:
    """Return stamps (k,) on a line through the last rows of bundles, part by part between lost rows; None where the
    bundles do not come at the rate of their rows."""
    last = np.append(np.flatnonzero(_find_waits(time)), len(time) - 1)
    if len(last) < FEWEST_EVENTS:
        return None
    step_s = float(np.median(np.diff(time[last]) / np.diff(last)))
    late = time[last] - step_s * last
    breaks = np.flatnonzero(np.abs(np.diff(late)) > _LOST_STEPS * step_s) + 1
    if len(breaks) > _AT_ONCE_SHARE * len(last):
        return None
    evened, first_row = np.empty(len(time)), 0
    for part in np.split(np.arange(len(last)), breaks):
        rows = np.arange(first_row, last[part[-1]] + 1)
        is_long = len(part) >= FEWEST_EVENTS
        line = np.polyfit(last[part], time[last[part]], 1) if is_long else (step_s, float(np.median(late[part])))
        evened[rows], first_row = np.polyval(line, rows), int(last[part[-1]]) + 1
    return evened


def _smooth_stamps(time: Floats, step_s: float) -> Floats:
    """Return stamps (k,) on the lines through the windows about each of them, part by part between gaps; at the ends
    through the first or last window."""
    evened, half, rows = time.copy(), _WINDOW_ROWS // 2, np.arange(_WINDOW_ROWS)
    for part in np.split(np.arange(len(time)), np.flatnonzero(np.diff(time) > GAP_STEPS * step_s) + 1):
        if len(part) >= _WINDOW_ROWS and step_s > 0.0:
            even = step_s * np.arange(len(part))
            late = time[part] - even
            middle = np.convolve(late, np.full(_WINDOW_ROWS, 1.0 / _WINDOW_ROWS), mode="valid")
            ends = late[:_WINDOW_ROWS], late[-_WINDOW_ROWS:]
            first, last = (np.polyval(np.polyfit(rows, end, 1), rows) for end in ends)
            evened[part] = even + np.concatenate([first[:half], middle, last[half + 1 :]])
    return evened


def measure_followed_share(time: Floats, evened: Floats, moved_m: Floats) -> tuple[float, float]:
    """Return how far positions follow the stamps (1) and not the row (0), and its standard error.

    `moved_m` (k - 1,) is driven between rows. The error is infinite where too few rows move, or positions are held.
    """
    usual = np.convolve(moved_m, np.full(_WINDOW_ROWS, 1.0 / _WINDOW_ROWS), mode="same")
    steps = np.diff(evened)
    moving = np.isfinite(usual) & (usual > POSITION_NOISE_M)
    moving &= np.abs(moved_m - usual) < usual  # a jump of the receiver is no step
    if np.count_nonzero(moving) < FEWEST_LINE_ROWS or np.mean(moved_m[moving] > 0.0) < ALMOST_ALL_SHARE:
        return 0.0, np.inf
    longer = (usual * (np.diff(time) / steps - 1.0))[moving]
    further = (moved_m - usual)[moving]
    squares = float(longer @ longer)
    if squares <= 0.0:
        return 0.0, np.inf
    share = float(longer @ further) / squares
    return share, float(np.std(further - share * longer)) / float(np.sqrt(squares))
