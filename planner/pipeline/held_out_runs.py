"""Which logs of a diagnosis are held out, as a user names them.

A held-out log has no part in what is found; what was found is then measured on it (`verdict.holdout`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace
from fnmatch import fnmatchcase
from pathlib import PurePath
from typing import Any

import numpy as np

from fields.arrays import Flags
from vehicle.identification.errors import LogError
from vehicle.identification.logs.schema import SHORTEST_SEGMENT_S, Log

AUTO = "auto"
LOG_SUFFIXES = (".csv", ".parquet", ".pq")
HELD_OUT_SHARE = 0.25  # of the runs: enough stay to find causes in
SHORTEST_PART_S = 4.0 * SHORTEST_SEGMENT_S  # one piece of the longest horizon
HeldOut = str | int | Sequence[str]
"""Names or patterns of runs, #1 for the first of them; or how many runs, or AUTO: they are then chosen here."""


HeldOutSplit = tuple[list[Log], list[Log], str]
"""Logs for the diagnosis, logs that are held out, and a sentence that says how they were chosen."""


def split_held_out_runs(logs: Sequence[Log], held_out: HeldOut | None) -> HeldOutSplit:
    """Split logs into those to diagnose and those that are held out, none without being asked.

    With AUTO, a quarter of the runs, spread evenly over them; of a single run, its last quarter. Raises LogError for a
    name that is no run, a count that leaves none, and a single run that is too short.
    """
    if held_out is None:
        return list(logs), [], ""
    words = [str(held_out)] if isinstance(held_out, str | int) else [str(word) for word in held_out]
    parts = [part.strip() for word in words for part in word.split(",") if part.strip()]
    if not parts:
        raise LogError(f"No run is held out; give names of runs, how many, or {AUTO}.")
    names = [log.name for log in logs]
    count = _read_count(parts, names)
    if count is None:
        chosen = sorted({number for part in parts for number in _find_runs(part, names)})
        reason = "as asked"
    elif len(logs) == 1 and parts == [AUTO]:
        return _split_single_run(logs[0])
    else:
        chosen = _spread_evenly(round(HELD_OUT_SHARE * len(logs)) or 1 if count == 0 else count, len(logs))
        reason = "chosen evenly over all runs"
    if len(chosen) >= len(logs):
        runs = "1 run" if len(logs) == 1 else f"{len(logs)} runs"
        raise LogError(f"{len(chosen)} of {runs} held out leave no run to diagnose; hold out fewer or add logs.")
    return (
        [log for number, log in enumerate(logs) if number not in chosen],
        [logs[number] for number in chosen],
        f"Held out, {reason}: {', '.join(names[number] for number in chosen)}.",
    )


def _read_count(parts: Sequence[str], names: Sequence[str]) -> int | None:
    """Return how many runs to choose, 0 for AUTO, None for names; a run of that name comes first."""
    (part, *others) = parts
    if others or part in names:
        return None
    if part == AUTO:
        return 0
    if not part.isdecimal():
        return None
    if int(part) == 0:
        raise LogError("0 runs held out say nothing; give 1 or more.")
    return int(part)


def _find_runs(pattern: str, names: Sequence[str]) -> list[int]:
    """Return the runs that a name, a file or a pattern means; raises LogError where there is none."""
    if pattern.startswith("#") and pattern[1:].isdecimal() and 1 <= int(pattern[1:]) <= len(names):
        return [int(pattern[1:]) - 1]
    path = PurePath(pattern)
    wanted = (pattern, path.stem if path.suffix.lower() in LOG_SUFFIXES else path.name)
    found = [number for number, name in enumerate(names) if name in wanted]
    found = found or [number for number, name in enumerate(names) if any(fnmatchcase(name, one) for one in wanted)]
    if not found:
        known = f"#1 to #{len(names)}" if len(names) > 6 else ", ".join(names)
        raise LogError(f"{pattern!r} is none of the runs ({known}); hold out runs that are among the logs.")
    return found


def _spread_evenly(count: int, runs: int) -> list[int]:
    """Return the middle run of each of `count` equal parts."""
    if count >= runs:
        return list(range(runs))
    return [math.floor((number + 0.5) * runs / count) for number in range(count)]


def _split_single_run(log: Log) -> HeldOutSplit:
    """Hold out the last part of a run."""
    first_s, last_s = (float(log.time_s[log.used][end]) for end in (0, -1))
    from_s = last_s - HELD_OUT_SHARE * (last_s - first_s)
    if last_s - from_s < SHORTEST_PART_S:
        raise LogError(
            f"{log.name} lasts {last_s - first_s:.0f} s; a part of a single run can be held out from "
            f"{SHORTEST_PART_S / HELD_OUT_SHARE:.0f} s on; log a second run."
        )
    is_late = log.time_s >= from_s
    return (
        [_slice_log(log, ~is_late, log.name)],
        [replace(_slice_log(log, is_late, f"{log.name} (last quarter)"), gated=())],
        f"Held out, as there is one run only: the last {last_s - from_s:.0f} s of {log.name}.",
    )


def _slice_log(log: Log, rows: Flags, name: str) -> Log:
    """Return the log of some rows, its segments numbered from 0."""
    columns: dict[str, Any] = {
        each.name: column[rows]
        for each in fields(log)
        if isinstance(column := getattr(log, each.name), np.ndarray) and len(column) == len(rows)
    }
    part = replace(log, name=name, **columns)
    numbers = np.unique(part.segment[part.segment >= 0])
    segment = np.where(part.segment >= 0, np.searchsorted(numbers, part.segment), -1)
    return replace(part, segment=segment)
