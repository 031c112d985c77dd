"""What a reader should know about a log beside its numbers: columns and rows that were not used, and why."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

import numpy as np

from vehicle.measured.logs.gating import FIRST_ROW_LINE
from vehicle.measured.logs.levelling import STEEPEST_DEG
from vehicle.measured.logs.record import COLUMNS, Log, Rows
from vehicle.measured.logs.stretches import SHORTEST_S, driven_stretches

_SHOWN = 3  # names of logs that say the same
_NEAR = 0.7  # of difflib's likeness: speed_ms is speed_mps, rpm is nothing


def remarks(log: Log) -> list[str]:
    """Every remark on a log, one sentence each, starting with its name.

    The rows named in "left out" and "not used" are all rows of the file that no replay sees, but for those in which a
    slower instrument repeats itself.
    """
    told = [*_given(log), *_columns(log), *log.doubts, *_tilt(log)]
    told += [f"{_rows(one.rows)} left out: {one.rule} (first in line {one.first_line})" for one in log.gated]
    return [f"{log.name}: {one}." for one in [*told, *_stretches(log)]]


def remarks_of(logs: Sequence[Log]) -> list[str]:
    """The remarks on many logs, those that are alike told once with the names of their logs."""
    names: dict[str, list[str]] = {}
    for log in logs:
        for one in remarks(log):
            names.setdefault(one.removeprefix(f"{log.name}: "), []).append(log.name)
    return [f"{_listed(mine)}: {one}" for one, mine in names.items()]


def _listed(names: Sequence[str]) -> str:
    """Names, the first of many."""
    if len(names) <= _SHOWN + 1:
        return ", ".join(names)
    return f"{', '.join(names[:_SHOWN])} and {len(names) - _SHOWN} more"


def _rows(count: int) -> str:
    return "1 row" if count == 1 else f"{count} rows"


def _given(log: Log) -> list[str]:
    if not log.given_again:
        return []
    names = ", ".join(log.given_again)
    return [f"the file was given {len(log.given_again) + 1} times (also as {names}) and counts once"]


def _columns(log: Log) -> list[str]:
    absent = [name for name in COLUMNS if getattr(log, name) is None]
    unset = (("shuttle", log.shuttle == 1.0), ("implement", log.implement == 0.0))
    absent += [name for name, default in unset if default.all()]
    told = []
    for name in log.ignored_columns:
        near = [one for one in absent if one.startswith(f"{name.lower()}_")]
        near = near or difflib.get_close_matches(name.lower(), absent, 1, _NEAR)
        hint = f"; rename it {near[0]} if that is what it holds" if near else ""
        told.append(f"column {name!r} is not known and was ignored{hint}")
    return told


def _tilt(log: Log) -> list[str]:
    """Roll and pitch that cannot be: no row is lost for them, as the ground does not change from row to row."""
    told = []
    for name, values in (("roll_deg", log.roll_deg), ("pitch_deg", log.pitch_deg)):
        if values is not None:
            bad = np.flatnonzero(~(np.abs(values) <= STEEPEST_DEG))
            if len(bad):
                told.append(
                    f"{name} is missing or beyond {STEEPEST_DEG:g} deg in {_rows(len(bad))} (first in line "
                    f"{_line(bad)}); the rows about them stand in"
                )
    return told


def _stretches(log: Log) -> list[str]:
    long, short = driven_stretches(log)
    if not short:
        return []
    rows = np.concatenate(short)
    where = f"in stretches shorter than {SHORTEST_S:g} s" if long else f"no stretch reaches {SHORTEST_S:g} s"
    return [f"{_rows(len(rows))} not used: {where} (first in line {_line(rows)})"]


def _line(rows: Rows) -> int:
    return int(rows[0]) + FIRST_ROW_LINE
