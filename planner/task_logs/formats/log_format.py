"""Formats of task logs, and the cleaning of runs: only rows with position and increasing time are kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np

from fields.arrays import Flags, Floats
from fields.errors import FieldError
from fields.raw_document import FileFormat
from fields.text_files import count_noun
from fields.units import DAY_S
from planner.task_logs.runs.run_records import LogContents, LoggedRun
from vehicle.identification.errors import LogError
from vehicle.identification.logs.gating import find_jumps
from vehicle.identification.logs.series import find_decreasing_entries
from vehicle.model.gnss import project_to_metres

MIN_ROWS = 10
EPOCHS = (datetime(1970, 1, 1), datetime(1980, 1, 1), datetime(1980, 1, 6))
"""Of Unix, ISOXML and GPS: what a receiver counts from until it knows the day."""
UNDATED_S = (-DAY_S, 7 * DAY_S)
"""From an epoch, in any time zone, for as long as a receiver may count before it knows the day."""

LogFormat = FileFormat[LogContents]


def read_each(logs: Iterable[tuple[str, Callable[[], LoggedRun]]], nothing_found: str) -> LogContents:
    """The runs of logs, each with its name; a note says why one that cannot be read is skipped.

    Raises LogError with the sentence `nothing_found` where there are no logs.
    """
    runs, notes = list[LoggedRun](), list[str]()
    for name, read in logs:
        try:
            runs.append(read())
        except (FieldError, LogError) as refusal:
            notes.append(f"{name} is skipped: {refusal}")
    if not runs and not notes:
        raise LogError(nothing_found)
    return LogContents(tuple(runs), tuple(notes))


def remove_unusable_rows(run: LoggedRun, epoch: datetime | None = None) -> LoggedRun:
    """The run without unusable rows, its time from 0; notes give the number of dropped rows by reason.

    `epoch` is when the times of the run were 0; None if unknown, as is its start then and where no row has a known
    day. Raises LogError if fewer than MIN_ROWS rows remain.
    """
    lon, lat = run.lonlat.T
    has_position = np.isfinite(run.lonlat).all(axis=1) & (np.abs(lat) < 90.0) & (np.abs(lon) <= 180.0)
    has_position &= (np.abs(lat) > 1e-6) | (np.abs(lon) > 1e-6)  # receivers without a position log 0, 0
    dropped = [(int((~has_position).sum()), "without a position")]
    has_time = has_position & np.isfinite(run.time_s)
    dropped.append((int(has_position.sum() - has_time.sum()), "without a time"))
    rows = np.flatnonzero(has_time & find_dated_rows(run.time_s, epoch))
    dropped.append((int(has_time.sum()) - len(rows), "whose day the receiver did not know"))
    is_late = find_decreasing_entries(run.time_s[rows])
    rows = rows[~is_late]
    dropped.append((int(is_late.sum()), "out of order in time"))
    if len(rows):
        place_m = project_to_metres(run.lonlat[rows], np.median(run.lonlat[rows], axis=0))
        is_jump = find_jumps(run.time_s[rows], *place_m.T)
        rows = rows[~is_jump]
        dropped.append((int(is_jump.sum()), "with an impossible jump of position"))
    if len(rows) < MIN_ROWS:
        count = count_noun(len(rows), "row")
        raise LogError(f"only {count} of {len(run.time_s)} usable; a run needs {MIN_ROWS} with time and position.")
    notes = [f"{count_noun(count, 'row')} {why} skipped" for count, why in dropped if count]
    run = run.select_rows(rows)
    first_s = float(run.time_s[0])
    is_undated = bool(_are_near_epochs(run.time_s[:1], epoch)[0])
    start = "" if epoch is None or is_undated else format_time(epoch, first_s)
    return replace(run, time_s=run.time_s - first_s, start=start, notes=(*run.notes, *notes))


def find_dated_rows(time_s: Floats, epoch: datetime | None) -> Flags:
    """Whether each row (n,) has a time on a known day; where none has, whether it has a time.

    `epoch` is when the times were 0; None if unknown, as are their days then.
    """
    has_time = np.isfinite(time_s)
    is_dated = has_time & ~_are_near_epochs(time_s, epoch)
    return is_dated if is_dated.any() else has_time


def _are_near_epochs(time_s: Floats, epoch: datetime | None) -> Flags:
    """Whether times are on the days that receivers log that do not know the day: those of an epoch."""
    starts_s = [] if epoch is None else [(one - epoch).total_seconds() for one in EPOCHS]
    near = [(time_s >= start_s + UNDATED_S[0]) & (time_s < start_s + UNDATED_S[1]) for start_s in starts_s]
    return np.asarray(np.any([np.zeros(len(time_s), dtype=np.bool_), *near], axis=0))


def format_time(epoch: datetime, seconds: float) -> str:
    """A time as "2020-01-02T17:30:20"; "" if out of range."""
    try:
        return (epoch + timedelta(seconds=round(seconds))).isoformat()
    except OverflowError:
        return ""
