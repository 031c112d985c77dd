"""Reading measured logs: the door of this package."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vehicle.measured.errors import LogError
from vehicle.measured.logs.coarse import without_coarse
from vehicle.measured.logs.constant import without_constant
from vehicle.measured.logs.conventions import apply_fixes, conventions, first_place
from vehicle.measured.logs.gating import RowRules, gate_rows, segments
from vehicle.measured.logs.held import SLOWEST_S, released
from vehicle.measured.logs.record import Fix, Gated, Log, Suspicion
from vehicle.measured.logs.remarks import remarks
from vehicle.measured.logs.sensors import set_right
from vehicle.measured.logs.stretches import SHORTEST_S
from vehicle.measured.logs.table import Columns, columns_of, read_frame

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Fix", "Gated", "Log", "LogError", "Suspicion", "conventions", "log_files", "log_from_frame", "read_log",
    "read_logs", "remarks",
]  # fmt: skip

_FASTEST_HZ = 250.0  # above the 100 Hz of the contract with room for uneven steps; beyond it time is in another unit
_REFUSED_SHARE = 0.5  # of the rows: more lost to one rule is a column that is wrong, not a row
_SHOWN_RULES = 4
_STANDING_M = 0.3  # antenna noise spreads this far
_POSITION_FIXES = (Fix.POSITION_DEGREES, Fix.POSITION_KM)
_SPEED_FIXES = (Fix.SPEED_KMH, Fix.SPEED_MEASURED_KMH, Fix.SPEED_COMMAND_KMH)


def read_log(
    path: str | Path,
    fixes: Iterable[Fix | str] = (),
    wheelbase_m: float | None = None,
    reference: tuple[float, float] | None = None,
) -> Log:
    """One run from a CSV or Parquet file.

    `fixes` name conventions to convert from (values of Fix); `wheelbase_m` sharpens the check for radians;
    `reference` is the longitude and latitude (deg) of the origin for positions in degrees.
    Raises LogError, in one sentence, for a file that is no log, a log without a usable stretch, and a convention that
    looks wrong and is not among the fixes.
    """
    path = Path(path)
    return log_from_frame(read_frame(path), path.stem, fixes, wheelbase_m, reference)


def read_logs(
    paths: str | Path | Iterable[str | Path], fixes: Iterable[Fix | str] = (), wheelbase_m: float | None = None
) -> list[Log]:
    """Runs from files and glob patterns, in the order given and sorted within a pattern, each file once.

    Positions in degrees share one origin: the first position of the first file. Raises LogError as read_log does, and
    when a pattern matches no file.
    """
    wanted = fix_set(fixes)
    logs: list[Log] = []
    reference = None
    files = log_files([paths] if isinstance(paths, str | Path) else paths)
    for (path, again), name in zip(files.items(), _names(list(files)), strict=True):
        frame = read_frame(path)
        if reference is None and Fix.POSITION_DEGREES in wanted:
            columns = columns_of(frame, name)[0]
            reference = first_place(apply_fixes(columns, wanted & {Fix.EAST_NORTH_SWAPPED}))
        log = log_from_frame(frame, name, wanted, wheelbase_m, reference, check=False)
        logs.append(replace(log, given_again=again))
    for log in logs:
        _check(log, wanted, wheelbase_m, [other for other in logs if other is not log])
    return [set_right(log) for log in logs]


def log_from_frame(
    frame: pd.DataFrame,
    name: str,
    fixes: Iterable[Fix | str] = (),
    wheelbase_m: float | None = None,
    reference: tuple[float, float] | None = None,
    check: bool = True,
) -> Log:
    """One run from a table; as read_log. Without `check`, only constant columns and rows are judged."""
    given = fix_set(fixes)
    raw, others = columns_of(frame, name)
    columns, fresh, doubts = released(apply_fixes(raw, given, reference), name, raw)
    rules = gate_rows(columns)
    columns = _without_negative_noise(columns)
    _refuse_unusable(columns, rules, name)
    log = replace(_assemble(columns, rules, name, others), fresh=fresh, doubts=doubts)
    log = without_constant(without_coarse(log))
    if not check:
        return log
    _check(log, given, wheelbase_m)
    return set_right(log)


def _without_negative_noise(columns: Columns) -> Columns:
    """Speeds with the sensor's noise about standstill cut off at zero; larger negative ones are gated."""
    speeds = {name: np.maximum(columns[name], 0.0) for name in columns if name.startswith("speed")}
    return columns | speeds


def fix_set(fixes: Iterable[Fix | str]) -> frozenset[Fix]:
    """Conversions by their names; raises LogError for one that is none, and for two that contradict each other."""
    try:
        given = frozenset(Fix(fix) for fix in ([fixes] if isinstance(fixes, str) else fixes))
    except ValueError as error:
        raise LogError(f"{error}; the fixes are: {', '.join(Fix)}.", parameter="fixes") from error
    speeds = [str(fix) for fix in _SPEED_FIXES if fix in given]
    if len(speeds) > 1:
        raise LogError(
            f"The fixes {' and '.join(speeds)} would convert a speed twice or say the same; give one of them.",
            parameter="fixes",
        )
    return given


def log_files(paths: Iterable[str | Path]) -> dict[Path, tuple[str, ...]]:
    """Files of names and glob patterns, each once, with the further names under which it was given.

    Raises LogError when a pattern matches no file and when there is no name at all.
    """
    files: dict[Path, list[Path]] = {}
    for one in paths:
        text = str(one)
        matches = [Path(text)]
        if any(mark in text for mark in "*?[") and not Path(text).exists():
            matches = sorted(Path(match) for match in glob.glob(text, recursive=True))
            if not matches:
                raise LogError(f"{text} matches no file; check the pattern.")
        for path in matches:
            files.setdefault(Path(os.path.realpath(path)), []).append(path)
    if not files:
        raise LogError("No log was given; name at least one file or pattern, for example runs/*.csv.")
    return {first: tuple(map(str, again)) for first, *again in files.values()}


def _names(files: list[Path]) -> list[str]:
    """Stems, or whole paths where two files share a stem."""
    stems = [path.stem for path in files]
    return [stem if stems.count(stem) == 1 else str(path) for stem, path in zip(stems, files, strict=True)]


def _refuse_unusable(columns: Columns, rules: RowRules, name: str) -> None:
    backwards = next((one for one in rules.gated if one.rule == "time not increasing"), None)
    if backwards is not None and backwards.rows > _REFUSED_SHARE * len(rules.used):
        stands = np.count_nonzero(np.diff(columns["time_s"]) == 0.0) > 0.5 * backwards.rows
        raise LogError(
            f"{name}: time_s does not increase in {backwards.rows} of {len(rules.used)} rows (first in line "
            f"{backwards.first_line}); {'log times with enough decimals' if stands else 'sort the rows by time'}."
        )
    lost = next(
        (one for one in rules.gated if one.rows > _REFUSED_SHARE * len(rules.used) and "missing" in one.rule), None
    )
    if lost is not None and np.count_nonzero(rules.used) >= 2:
        raise LogError(
            f"{name}: {lost.rows} of {len(rules.used)} rows are lost to: {lost.rule} (first in line "
            f"{lost.first_line}); fill the column, or leave it out where it is not needed."
        )
    if np.count_nonzero(rules.used) < 2:
        largest = sorted(rules.gated, key=lambda one: -one.rows)[:_SHOWN_RULES]
        why = "; ".join(f"{one.rule}: {one.rows} rows from line {one.first_line}" for one in largest)
        raise LogError(f"{name} has fewer than two usable rows of {len(rules.used)} ({why}); correct the log.")


def _assemble(columns: Columns, rules: RowRules, name: str, others: tuple[str, ...]) -> Log:
    rows = len(rules.used)
    return Log(
        name=name,
        time_s=columns["time_s"],
        easting_m=columns["easting_m"],
        northing_m=columns["northing_m"],
        heading_deg=columns.get("heading_deg"),
        speed_mps=columns.get("speed_mps"),
        speed_command_mps=columns.get("speed_command_mps"),
        steering_command_deg=columns.get("steering_command_deg"),
        steering_deg=columns.get("steering_deg"),
        shuttle=columns.get("shuttle", np.ones(rows)),
        implement=columns.get("implement", np.zeros(rows)),
        roll_deg=columns.get("roll_deg"),
        pitch_deg=columns.get("pitch_deg"),
        used=rules.used,
        segment=segments(columns["time_s"], rules.used),
        gated=tuple(rules.gated),
        ignored_columns=others,
    )


def _check(log: Log, given: frozenset[Fix], wheelbase_m: float | None, others: Sequence[Log] = ()) -> None:
    """Refuse wrong conventions, a tractor that never moves, and a rate of no log."""
    suspicions = conventions(log, wheelbase_m, others)
    _refuse_standing(log, suspicions)
    again = [one for one in suspicions if one.fix in given]
    if again:
        raise LogError(f"{log.name}: after the fix {again[0].fix} {again[0].why}; leave that fix out.")
    if suspicions:
        raise LogError(f"{log.name}: it seems that {'; and that '.join(one.sentence() for one in suspicions)}.")
    _refuse_rate(log)


def _refuse_standing(log: Log, suspicions: Sequence[Suspicion]) -> None:
    """Positions in a wrong unit seem to stand still as well; what they are is said instead."""
    if any(one.fix in _POSITION_FIXES for one in suspicions):
        return
    moved = float(np.hypot(np.ptp(log.easting_m[log.used]), np.ptp(log.northing_m[log.used])))
    seconds = float(np.ptp(log.time_s[log.used]))
    if moved == 0.0 or (moved < _STANDING_M and seconds >= SHORTEST_S):
        raise LogError(
            f"{log.name}: its positions stay within {moved:.2g} m for {seconds:.0f} s, the tractor never moves; leave "
            "this log out, or correct the columns easting_m and northing_m."
        )


def _refuse_rate(log: Log) -> None:
    if not 1.0 / _FASTEST_HZ <= log.step_s <= SLOWEST_S:
        raise LogError(
            f"{log.name}: its rows are {log.step_s:g} s apart; logs of 1 to 100 Hz can be used, check the unit of "
            "time_s or log at another rate."
        )
