"""Rows of a log that can be used: with a position, in order of time; the others are left out and counted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fields.reading import some
from planner.works.record import Logged
from vehicle.measured.errors import LogError
from vehicle.measured.logs.gating import jumps, outside_longest_increase

FEWEST = 10
EARTH_M = 6_371_008.8


def cleaned(run: Logged) -> Logged:
    """A run without the rows that cannot be used, its time from 0; every kind left out is a note with its count.

    Raises LogError: fewer than ten rows are left.
    """
    lon, lat = run.lonlat.T
    here = np.isfinite(run.lonlat).all(axis=1) & (np.abs(lat) < 90.0) & (np.abs(lon) <= 180.0)
    here &= (np.abs(lat) > 1e-6) | (np.abs(lon) > 1e-6)  # 0, 0 is what receivers say that have no position
    told = [(int((~here).sum()), "without a position")]
    rows = np.flatnonzero(here & np.isfinite(run.time_s))
    told.append((int(here.sum()) - len(rows), "without a time"))
    late = outside_longest_increase(run.time_s[rows])
    rows = rows[~late]
    told.append((int(late.sum()), "whose time does not rise"))
    if len(rows):
        shrunk = float(np.cos(np.radians(np.median(lat[rows]))))
        east, north = np.radians(lon[rows]) * EARTH_M * shrunk, np.radians(lat[rows]) * EARTH_M
        far = jumps(run.time_s[rows], east, north)
        rows = rows[~far]
        told.append((int(far.sum()), "at a place nobody drives to in that time"))
    if len(rows) < FEWEST:
        count = some(len(rows), "row")
        raise LogError(f"only {count} of {len(run.time_s)} can be used; a run needs {FEWEST} with time and position.")
    notes = [f"{some(count, 'row')} {why} left out" for count, why in told if count]
    return replace(
        run,
        lonlat=run.lonlat[rows],
        time_s=run.time_s[rows] - run.time_s[rows[0]],
        speed_mps=None if run.speed_mps is None else run.speed_mps[rows],
        works=None if run.works is None else run.works[rows],
        notes=(*run.notes, *notes),
    )
