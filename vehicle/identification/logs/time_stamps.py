"""Time stamps that jitter: rows taken evenly and stamped when they came, as loggers on a busy computer do.

Where a line holds rows back, several come at once. The last row of such a bundle has waited least.

A tractor moves on by as much as the time between two rows. Where positions advance evenly from row to row, whatever the
time between them, it is the stamps that are wrong, by centimetres along the path at walking pace.
"""

from __future__ import annotations

import numpy as np

from vehicle.identification.logs.schema import Array, Mask, Rows
from vehicle.identification.logs.table import Columns

_WINDOW_ROWS = 21  # chosen: the clock of a logger keeps its rate over so many rows
_FEWEST_ROWS = 100  # chosen, that move: fewer do not tell whether positions follow the stamps
_LEAST_JITTER_SHARE = 0.1  # chosen, of a step: less is worth no more than the noise of a receiver
_GAP_STEPS = 3.0  # chosen: so many steps are rows that are lost
_LEAST_MOVED_M = 0.03  # chosen, between rows: beyond the noise of a receiver
_FRESH_SHARE = 0.95  # chosen, of the rows that move: a held position does not follow any stamp
# Chosen, of the mean step: usual steps within bundles, and the least one between two of them; a bundle that is late by
# so many steps comes after lost rows; more of those are no rate.
_AT_ONCE_SHARE, _WAIT_SHARE, _LOST_STEPS, _MOST_BREAKS_SHARE = 0.2, 0.5, 0.75, 0.2
_FEWEST_BUNDLES = 10  # chosen: fewer do not tell a rate
_EVEN_SHARE, _CLEAR_SIGMAS = 0.3, 3.0  # between 0 (evenly taken) and 1 (taken when stamped)


def even_time_stamps(columns: Columns) -> tuple[Columns, tuple[str, ...]]:
    """Return the columns with evened time stamps and a sentence on them, where the stamps jitter; else as they are."""
    time, east, north = (columns.get(name) for name in ("time_s", "easting_m", "northing_m"))
    if time is None or east is None or north is None or len(time) < _FEWEST_ROWS:
        return columns, ()
    if not np.all(np.isfinite(time)) or np.any(np.diff(time) < 0.0):
        return columns, ()
    if is_bundled(time):
        return _even_bundles(columns)
    step_s = float(np.median(np.diff(time)))
    evened = _smooth_stamps(time, step_s)
    jitter_s = float(np.std(time - evened))
    if not jitter_s > _LEAST_JITTER_SHARE * step_s or np.any(np.diff(evened) <= 0.0):
        return columns, ()
    share, error = measure_followed_share(time, evened, np.hypot(np.diff(east), np.diff(north)))
    if not share + _CLEAR_SIGMAS * error < _EVEN_SHARE:
        return columns, ()
    taken_s = float(np.median(np.diff(evened)))
    sentence = (
        f"time_s jitters by {1000.0 * jitter_s:.0f} ms: positions advance evenly from row to row whatever the time "
        f"between them, so rows were taken every {taken_s:.2g} s; the times are evened"
    )
    return {**columns, "time_s": evened}, (sentence,)


def is_bundled(time: Array) -> bool:
    """Whether most rows follow the one before them at once, as they do where several come together."""
    steps = np.diff(time)
    return len(steps) > 0 and float(np.median(steps)) < _AT_ONCE_SHARE * float(np.mean(steps))


def _even_bundles(columns: Columns) -> tuple[Columns, tuple[str, ...]]:
    """Return columns with the rows of bundles spread evenly, and a sentence, where positions advance so."""
    time = columns["time_s"]
    evened = spread_bundles(time)
    if evened is None or np.any(np.diff(evened) <= 0.0):
        return columns, ()
    moved_m = np.hypot(np.diff(columns["easting_m"]), np.diff(columns["northing_m"]))
    share, error = measure_followed_share(time, evened, moved_m)
    if not share + _CLEAR_SIGMAS * error < _EVEN_SHARE:
        return columns, ()
    bundles = np.count_nonzero(_find_waits(time)) + 1
    sentence = (
        f"rows come in bundles of about {len(time) / bundles:.0f}, stamped on arrival, while positions advance "
        f"evenly from row to row, so rows were taken every {float(np.median(np.diff(evened))):.2g} s; the times are "
        "evened"
    )
    return {**columns, "time_s": evened}, (sentence,)


def _find_waits(time: Array) -> Mask:
    """Mark the steps (k - 1,) between bundles; all others are steps within one."""
    steps = np.diff(time)
    waits: Mask = steps > _WAIT_SHARE * np.mean(steps)
    return waits


def spread_bundles(time: Array) -> Array | None:
    """Return stamps (k,) on a line through the last rows of bundles, part by part between lost rows; None where the
    bundles do not come at the rate of their rows."""
    last = np.append(np.flatnonzero(_find_waits(time)), len(time) - 1)
    if len(last) < _FEWEST_BUNDLES:
        return None
    step_s = float(np.median(np.diff(time[last]) / np.diff(last)))
    late = time[last] - step_s * last
    breaks = np.flatnonzero(np.abs(np.diff(late)) > _LOST_STEPS * step_s) + 1
    if len(breaks) > _MOST_BREAKS_SHARE * len(last):
        return None
    evened, first_row = np.empty(len(time)), 0
    for part in np.split(np.arange(len(last)), breaks):
        rows = np.arange(first_row, last[part[-1]] + 1)
        is_long = len(part) >= _FEWEST_BUNDLES
        line = np.polyfit(last[part], time[last[part]], 1) if is_long else (step_s, float(np.median(late[part])))
        evened[rows], first_row = np.polyval(line, rows), int(last[part[-1]]) + 1
    return evened


def _smooth_stamps(time: Array, step_s: float) -> Array:
    """Return stamps (k,) on the lines that they scatter about, part by part between gaps."""
    evened = time.copy()
    if not step_s > 0.0:
        return evened
    for part in _split_at_gaps(time, step_s):
        if len(part) >= _WINDOW_ROWS:
            even = step_s * np.arange(len(part))
            evened[part] = even + _fit_lines(time[part] - even)
    return evened


def _fit_lines(values: Array) -> Array:
    """Return values (k,) on the line through the window about each of them; at the ends through the first or last."""
    half, rows = _WINDOW_ROWS // 2, np.arange(_WINDOW_ROWS)
    middle = np.convolve(values, np.full(_WINDOW_ROWS, 1.0 / _WINDOW_ROWS), mode="valid")
    first, last = (np.polyval(np.polyfit(rows, end, 1), rows) for end in (values[: len(rows)], values[-len(rows) :]))
    return np.concatenate([first[:half], middle, last[half + 1 :]])


def _split_at_gaps(time: Array, step_s: float) -> list[Rows]:
    gaps = np.flatnonzero(np.diff(time) > _GAP_STEPS * step_s) + 1
    return np.split(np.arange(len(time)), gaps)


def measure_followed_share(time: Array, evened: Array, moved_m: Array) -> tuple[float, float]:
    """Return how far positions follow the stamps (1) and not the row (0), and its standard error.

    `moved_m` (k - 1,) is driven between rows. The error is infinite where too few rows move, or positions are held.
    """
    usual = np.convolve(moved_m, np.full(_WINDOW_ROWS, 1.0 / _WINDOW_ROWS), mode="same")
    steps = np.diff(evened)
    moving = np.isfinite(usual) & (usual > _LEAST_MOVED_M)
    moving &= np.abs(moved_m - usual) < usual  # a jump of the receiver is no step
    if np.count_nonzero(moving) < _FEWEST_ROWS or np.mean(moved_m[moving] > 0.0) < _FRESH_SHARE:
        return 0.0, np.inf
    longer = (usual * (np.diff(time) / steps - 1.0))[moving]
    further = (moved_m - usual)[moving]
    squares = float(longer @ longer)
    if squares <= 0.0:
        return 0.0, np.inf
    share = float(longer @ further) / squares
    return share, float(np.std(further - share * longer)) / float(np.sqrt(squares))
