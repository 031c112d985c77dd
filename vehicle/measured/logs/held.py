"""Instruments slower than the log: a receiver of 2 Hz shows each position in five rows of a log of 10 Hz.

Only the first of such rows is a measurement. Those behind it are older than they say, by a different time each, which
looks like a late receiver or an antenna that stands elsewhere. They are laid on the line to the next measurement, and
`fresh` tells them apart: steering and speed are still taken from all rows.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.gating import outside_longest_increase
from vehicle.measured.logs.record import Array, Mask, Rows
from vehicle.measured.logs.table import Columns

SLOWEST_S = 2.0  # twice the slowest rate of the contract, 1 Hz
_SHARE = 0.1  # chosen, of the changes: a row that came late now and then is no slower instrument
_MOST = 0.5  # chosen: where few changes are clear, noise in coarse steps repeats the value before 0.2 of these
_FEWEST = 10  # changes that tell
_CLEAR = 3.0  # chosen, of the least changes: smaller ones are those of the last digit, between which a value may stand
_LEAST = 0.05  # quantile: nearly the least, which alone may be rounding
DIGITS = 9  # decimals kept: below them is what computing adds
_STANDS = 2.0  # chosen, of the usual rows and the usual change: what stays longer is not held, and where it then hardly
# moves the tractor stands


class Released(NamedTuple):
    """Columns without held values, the rows that were measured (None: all), and what is to be said of it."""

    columns: Columns
    fresh: Mask | None = None
    doubts: tuple[str, ...] = ()


def released(columns: Columns, name: str, logged: Columns | None = None) -> Released:
    """Columns in which positions and headings that a slower instrument held lie on the line between measurements.

    `logged` are the columns before they were converted (None: these), as only those have the last digits of degrees.
    Raises LogError for positions that are measured too rarely; such a heading is left out.
    """
    time, east, north = columns["time_s"], columns["easting_m"], columns["northing_m"]
    rows = np.flatnonzero(np.isfinite(time) & np.isfinite(east) & np.isfinite(north))
    rows = rows[~outside_longest_increase(time[rows])]
    if len(rows) < _FEWEST:
        return Released(columns)
    new, out, doubts = list[Rows](), dict(columns), list[str]()
    place = _measured(np.stack([(logged or columns)[axis][rows] for axis in _AXES]))
    if place is not None:
        every_s = _every_s(time[rows], place)
        if every_s > SLOWEST_S:
            raise LogError(f"{name}: its positions are new only every {every_s:.2g} s; log them at 1 Hz or faster.")
        new.append(rows[place])
        doubts.append(_said("the positions are", "the receiver", every_s, time[rows]))
    turned, heading = _heading(columns, rows)
    if heading is not None:
        every_s = _every_s(time[turned], heading)
        if every_s > SLOWEST_S:
            del out["heading_deg"]
            doubts.append(f"heading_deg is new only every {every_s:.2g} s; it counts as not logged")
        else:
            new.append(turned[heading])
            doubts.append(_said("heading_deg is", "the compass", every_s, time[turned]))
            plain = np.unwrap(columns["heading_deg"][turned], period=360.0)
            out["heading_deg"] = np.mod(_between(columns["heading_deg"], time, turned, heading, plain), 360.0)
    if not new:
        return Released(out, None, tuple(doubts))
    if place is not None:
        out |= {axis: _between(columns[axis], time, rows, place, columns[axis][rows]) for axis in _AXES}
    fresh = np.zeros(len(time), dtype=np.bool_)
    fresh[min(new, key=len)] = True
    return Released(out, fresh, tuple(doubts))


_AXES = ("easting_m", "northing_m")


def _heading(columns: Columns, rows: Rows) -> tuple[Rows, Rows | None]:
    """Those of the rows that have a heading, and the places among them at which it is new (None: all, or none is)."""
    if "heading_deg" not in columns:
        return rows, None
    having = rows[np.isfinite(columns["heading_deg"][rows])]
    return having, _measured(np.unwrap(columns["heading_deg"][having], period=360.0)[None])


def _measured(values: Array) -> Rows | None:
    """Places among rows at which values (c, k) are new, where a good part of them is held; None where they are not."""
    if values.shape[1] < _FEWEST:
        return None
    steps = np.diff(values, axis=1)
    new = np.append(0, np.flatnonzero((steps != 0.0).any(axis=0)) + 1)
    changes, count = steps[:, new[1:] - 1], np.diff(new)
    jumps = np.sqrt((changes**2).sum(axis=0))
    # Each column has a last digit of its own: that of a degree of longitude is shorter than that of latitude.
    clear = (np.abs(changes) > _CLEAR * np.array([[_least(one)] for one in steps])).any(axis=0)
    # What stays much longer than usual is a straight drive's heading or a standing tractor's place.
    usual = float(np.median(count[clear])) if clear.any() else 0.0
    held = clear & (count >= 2) & (count <= _STANDS * usual)
    share = _SHARE if np.count_nonzero(clear) >= _MOST * len(count) else _MOST
    if np.count_nonzero(held) < max(_FEWEST, share * np.count_nonzero(clear)):
        return None
    stands = jumps <= _STANDS * float(np.median(jumps[clear]))
    every = max(math.ceil(_STANDS * float(np.median(count[held]))), 1)
    return _with_standing(new, values.shape[1], np.append(stands, False), every)


def _least(steps: Array) -> float:
    """Nearly the least by which values change (k - 1,), or by which two changes differ: their last digit."""
    sizes = np.unique(np.round(np.abs(steps[steps != 0.0]), DIGITS))
    both = np.concatenate([sizes, np.diff(sizes)])
    return float(np.quantile(both, _LEAST)) if len(both) else 0.0


def _with_standing(new: Rows, rows: int, stands: Mask, every: int) -> Rows:
    """New places, and others `every` so many rows between those where the tractor `stands` (a value per new place)."""
    ends = np.append(new[1:], rows)
    # The last before a change may be one that has only just begun to be old.
    between = [
        np.arange(one + every, end, every)[:-1] for one, end, still in zip(new, ends, stands, strict=True) if still
    ]
    return np.unique(np.concatenate([new, *between]))


def _every_s(time: Array, places: Rows) -> float:
    """Median time from measurement to measurement (s)."""
    return float(np.median(np.diff(time[places])))


def _said(what: str, who: str, every_s: float, time: Array) -> str:
    apart = float(np.median(np.diff(time)))
    return (
        f"{what} new only every {every_s:.2g} s where rows are {apart:.2g} s apart: {who} is slower than the log, and "
        "what it repeats is not used"
    )


def _between(column: Array, time: Array, rows: Rows, places: Rows, plain: Array) -> Array:
    """A column with what is not measured on the line between what is."""
    out = column.copy()
    out[rows] = np.interp(time[rows], time[rows][places], plain[places])
    return out
