"""Reading measured logs: files to checked logs, and remarks on unused rows and columns."""

from __future__ import annotations

import glob
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from fields.arrays import Flags
from fields.errors import MAX_NAMED
from fields.text_files import count_noun
from vehicle.identification.errors import LogError
from vehicle.identification.logs.clocks import even_time_stamps, is_bundled
from vehicle.identification.logs.column_faults import (
    SPEED_THRESHOLD,
    collect_fault_rows,
    correct_position_jumps,
    find_column_faults,
    join_thaws,
)
from vehicle.identification.logs.column_quality import (
    describe_silent_steering,
    drop_coarse_columns,
    drop_constant_columns,
    interpolate_held_values,
    is_parked,
    leave_out_useless_logs,
    merge_copies,
)
from vehicle.identification.logs.conventions import find_convention_errors
from vehicle.identification.logs.directions import HEADING_FLIPPED, drop_course_heading, find_flipped_headings
from vehicle.identification.logs.gating import gate_rows
from vehicle.identification.logs.readings import (
    SPEED_UNITS,
    LogConvention,
    convert_columns,
    find_first_place,
)
from vehicle.identification.logs.schema import (
    COLUMNS,
    SHORTEST_SEGMENT_S,
    Columns,
    GatedRows,
    Log,
    find_file_line,
    number_segments,
    split_drive_segments,
)
from vehicle.identification.logs.sensor_checks import correct_sensors
from vehicle.identification.logs.standing_columns import find_sparse_steering_faults
from vehicle.identification.logs.table import (
    MappingSource,
    NamedColumn,
    extract_columns,
    guess_column,
    map_columns,
    parse_mapping,
    read_log_table,
)
from vehicle.identification.logs.thresholds import FEW_SHARE, MAJORITY, MOMENT_S, STEEPEST_DEG

if TYPE_CHECKING:
    import pandas as pd


SAMPLE_LOG = "sample"  # made as planner/guide/diagnosis.md says, with an effect to find
_SHORT_SEGMENTS = f"in segments shorter than {SHORTEST_SEGMENT_S:g} s"
_REPEATED = "positions repeat the row before"
_LARGE_SHARE = 0.25  # chosen, of the rows of a log: so many are told with its name
_FASTEST_HZ = 250.0  # above the contract's 100 Hz, with room for uneven steps; beyond it the unit of time is wrong
_MOST_HELD_S = 0.55  # between messages of commands: at 2 Hz; after longer gaps nothing is said of them
# What to do where a rule excludes most rows, by a word of the rule.
_ADVICE = {
    "missing": "fill the column, or remove it if it is optional",
    "position jumps": "give positions in metres and times in seconds",
}
_POSITION_FIXES = (LogConvention.POSITION_DEGREES, LogConvention.POSITION_KM)
_SPEED_FIXES = [{fix for both, *one in SPEED_UNITS for fix in (both, one[place])} for place in (0, 1)]


def list_remarks(log: Log) -> list[str]:
    """Return every remark on a log, one sentence each, starting with its name.

    Rows counted as "left out" or "not used" are all rows of the file that no replay uses, apart from repeated values of
    a slower instrument. Impossible roll and pitch exclude no row, as the ground hardly changes from row to row.
    """
    messages = []
    if log.other_names:
        names = ", ".join(log.other_names)
        messages.append(f"the file was given {len(log.other_names) + 1} times (also as {names}) and counts once")
    unset = (("shuttle", log.shuttle == 1.0), ("implement", log.implement == 0.0))
    absent = [name for name in COLUMNS if getattr(log, name) is None] + [name for name, is_set in unset if is_set.all()]
    for name in log.ignored_columns:
        target = guess_column(name)
        hint = f"; map it to {target.key} if that is what it holds" if target and target.column in absent else ""
        messages.append(f"column {name!r} is unknown and was ignored{hint}")
    messages += log.corrections
    for name, values in (("roll_deg", log.roll_deg), ("pitch_deg", log.pitch_deg)):
        bad = np.flatnonzero(~(np.abs(values) <= STEEPEST_DEG)) if values is not None else np.empty(0, dtype=np.int64)
        if len(bad):
            messages.append(
                f"{name} is missing or beyond {STEEPEST_DEG:g} deg in {count_noun(len(bad), 'row')} (first in line "
                f"{find_file_line(bad)}); values are interpolated there"
            )
    messages += [
        f"{count_noun(message.rows, 'row')} left out: {message.rule} (first in line {message.first_line})"
        for message in log.gated
    ]
    long_segments, short_segments = split_drive_segments(log)
    if short_segments:
        rows = np.concatenate(short_segments)
        reason = _SHORT_SEGMENTS if long_segments else f"no segment lasts {SHORTEST_SEGMENT_S:g} s"
        line = find_file_line(rows)
        messages.append(f"{count_noun(len(rows), 'row')} not used: {reason} (first in line {line})")
    return [f"{log.name}: {message}." for message in messages]


def list_shared_remarks(logs: Sequence[Log]) -> list[str]:
    """Return the remarks on many logs; one that several logs share appears once, with (the first of) their names."""
    names: dict[str, list[str]] = {}
    for log in logs:
        for message in list_remarks(log):
            names.setdefault(message.removeprefix(f"{log.name}: "), []).append(log.name)
    remarks = list(dict.fromkeys(remark for log in logs for remark in log.set_remarks))
    for message, own in names.items():
        more = f" and {len(own) - MAX_NAMED} more" if len(own) > MAX_NAMED + 1 else ""
        remarks.append(f"{', '.join(own[:MAX_NAMED] if more else own)}{more}: {message}")
    return remarks


def count_rows_left_out(logs: Sequence[Log], rows_used: int) -> dict[str, int]:
    """Return how many rows no replay uses by reason, most first; `rows_used` are those of the replayed segments."""
    counts: dict[str, int] = {}
    for log in logs:
        short = sum(map(len, split_drive_segments(log)[1]))
        for rule, rows in [*((each.rule, each.rows) for each in log.gated), (_SHORT_SEGMENTS, short)]:
            if len(logs) > 1 and rows > _LARGE_SHARE * len(log.used):
                rule = f"{rule}, in {log.name} {100.0 * rows / len(log.used):.0f} % of all rows"
            counts[rule] = counts.get(rule, 0) + rows
    counts[_REPEATED] = sum(len(log.used) for log in logs) - rows_used - sum(counts.values())
    return dict(sorted(((rule, rows) for rule, rows in counts.items() if rows > 0), key=lambda pair: -pair[1]))


def read_log(
    path: str | Path,
    fixes: Iterable[LogConvention | str] = (),
    wheelbase_m: float | None = None,
    mapping: MappingSource = None,
) -> Log:
    """Read one run from a CSV or Parquet file.

    `fixes` are conventions to convert from (values of LogConvention); `wheelbase_m` sharpens the check for radians;
    `mapping` names the columns of the file. Raises LogError, in one sentence, for a file that is no log, a log without
    a usable segment, and a convention that looks wrong and is not among the fixes; ColumnError where columns are
    missing, with a mapping.
    """
    path, columns = resolve_log_path(path), parse_mapping(mapping)
    fix_set = parse_conventions(fixes, columns.values())
    return build_log(map_columns(read_log_table(path), columns, path.stem), path.stem, fix_set, wheelbase_m)


def read_logs(
    paths: str | Path | Iterable[str | Path],
    fixes: Iterable[LogConvention | str] = (),
    wheelbase_m: float | None = None,
    mapping: MappingSource = None,
) -> list[Log]:
    """Read runs from files and glob patterns, in the given order and sorted within a pattern, each file once.

    `mapping` names columns that every file has. Positions in degrees share one origin: the first position of the first
    file. Raises LogError as read_log does, and when a pattern matches no file.
    """
    columns = parse_mapping(mapping)
    fix_set = parse_conventions(fixes, columns.values())
    logs: list[Log] = []
    reference = None
    files = find_log_files([paths] if isinstance(paths, str | Path) else paths)
    stems = [path.stem for path in files]
    for path, other_paths in files.items():
        name = path.stem if stems.count(path.stem) == 1 else str(path)
        frame = map_columns(read_log_table(path), columns, name)
        log = build_log(frame, name, fix_set, wheelbase_m, reference, check=False)
        reference = log.origin_deg
        logs.append(replace(log, other_names=other_paths))
    logs = merge_copies(leave_out_useless_logs(logs))
    for log in logs:
        _check_log(log, fix_set, wheelbase_m, [other_log for other_log in logs if other_log is not log])
    return [correct_sensors(log) for log in logs]


def build_log(
    frame: pd.DataFrame,
    name: str,
    fixes: Iterable[LogConvention | str] = (),
    wheelbase_m: float | None = None,
    reference: tuple[float, float] | None = None,
    check: bool = True,
) -> Log:
    """Build one run from a table, as read_log. Without `check`, only constant columns and rows are judged."""
    fix_set = parse_conventions(fixes)
    raw_columns, ignored = extract_columns(frame, name)
    if LogConvention.POSITION_DEGREES in fix_set and reference is None:
        reference = find_first_place(convert_columns(raw_columns, fix_set & {LogConvention.EAST_NORTH_SWAPPED}))
    converted = convert_columns(raw_columns, fix_set, reference)
    converted, stamps = even_time_stamps(converted)
    converted, jumps = correct_position_jumps(converted, name)
    column_faults = join_thaws(jumps, find_column_faults(converted, name))
    column_faults += find_sparse_steering_faults(converted, name)
    converted, gaps = _hold_commands(converted)
    columns, fresh, doubts, measured_rows = interpolate_held_values(converted, name, raw_columns)
    fault_rows = {HEADING_FLIPPED: find_flipped_headings(converted), **collect_fault_rows(column_faults)}
    used, gated = gate_rows(columns, fault_rows)
    # Of negative speeds only the noise of sensors at rest was not excluded.
    columns = columns | {key: np.maximum(values, 0.0) for key, values in columns.items() if key.startswith("speed")}
    _refuse_unusable_rows(columns, used, gated, name)
    defaults = {"shuttle": np.ones(len(used)), "implement": np.zeros(len(used))}
    values: dict[str, Any] = {key: columns.get(key, defaults.get(key)) for key in COLUMNS}
    log = Log(
        name=name,
        **values,
        used=used,
        segment=number_segments(columns["time_s"], used),
        gated=tuple(gated),
        ignored_columns=ignored,
        fresh=fresh,
        measured_rows=measured_rows,
        corrections=(*stamps, *gaps, *doubts),
        # A limit of the instrument is no fault that began.
        faults=tuple(one.fault for one in column_faults if one.fault.id != SPEED_THRESHOLD),
        origin_deg=reference if LogConvention.POSITION_DEGREES in fix_set else None,
    )
    log = drop_coarse_columns(log)
    if log.step_s < LogConvention.TIME_MS.ratios[0] and not is_parked(log):
        log = drop_course_heading(drop_constant_columns(log))
    if not check:
        return log
    _check_log(log, fix_set, wheelbase_m)
    return correct_sensors(log)


def _hold_commands(columns: Columns) -> tuple[Columns, tuple[str, ...]]:
    """Commands hold from one message to the next where these come more rarely than rows; longer gaps stay empty.

    A commanded speed that is still empty in many rows, as of a tractor that pauses or is driven by hand, is dropped:
    all else in these rows is known.
    """
    held = dict(columns)
    for name in ("speed_command_mps", "steering_command_deg"):
        values = columns.get(name)
        if values is None or np.isfinite(values).all() or not np.isfinite(values).any():
            continue
        known, rows = np.flatnonzero(np.isfinite(values)), np.arange(len(values))
        last = known[np.maximum(np.searchsorted(known, rows, side="right") - 1, 0)]
        following = known[np.minimum(np.searchsorted(known, rows), len(known) - 1)]
        is_short = columns["time_s"][following] - columns["time_s"][last] <= _MOST_HELD_S
        held[name] = np.where(is_short & (last <= rows), values[last], values)
    command = held.get("speed_command_mps", np.empty(0))
    empty = np.flatnonzero(~np.isfinite(command))
    if len(empty) <= FEW_SHARE * len(command):
        return held, ()
    message = (
        f"speed_command_mps is empty in {len(empty)} of {len(command)} rows (first in line "
        f"{find_file_line(empty)}); the column is ignored and the rows are used"
    )
    return {name: values for name, values in held.items() if name != "speed_command_mps"}, (message,)


def parse_conventions(
    fixes: Iterable[LogConvention | str], mapped: Iterable[NamedColumn] = ()
) -> frozenset[LogConvention]:
    """Parse names, add that of mapped longitudes; raises LogError for an unknown one and two that contradict."""
    try:
        names = [fixes] if isinstance(fixes, str) else list(fixes)
        given = frozenset(LogConvention(fix) for fix in names)  # type: ignore[call-arg]
    except ValueError:
        unknown = next(str(name) for name in names if name not in set(LogConvention))
        raise LogError(
            f"{unknown!r} is no fix; the fixes are: {', '.join(LogConvention)}.", parameter="fixes"
        ) from None
    converted = ([str(fix) for fix in LogConvention if fix in fixes & given] for fixes in _SPEED_FIXES)
    speeds = next((names for names in converted if len(names) > 1), [])
    if speeds:
        raise LogError(
            f"The fixes {' and '.join(speeds)} convert the same speed; give only one of them.", parameter="fixes"
        )
    return given | {LogConvention.POSITION_DEGREES for column in mapped if column.key.startswith("longitude")}


def resolve_log_path(path: str | Path) -> Path:
    """Return the path of a log; the name SAMPLE_LOG is the log of Headland unless a file of that name exists."""
    if str(path) != SAMPLE_LOG or Path(path).exists():
        return Path(path)
    return Path(str(resources.files("vehicle") / "data" / "sample_log.csv"))


def find_log_files(paths: Iterable[str | Path]) -> dict[Path, tuple[str, ...]]:
    """Resolve names and patterns to files, each once, with its further names; raises LogError where there is none."""
    files: dict[Path, list[Path]] = {}
    for pattern in paths:
        text = str(pattern)
        matches = [resolve_log_path(pattern)]
        if any(mark in text for mark in "*?[") and not Path(text).exists():
            matches = sorted(Path(match) for match in glob.glob(text, recursive=True))
            if not matches:
                raise LogError(f"{text} matches no file; check the pattern.")
        for path in matches:
            files.setdefault(Path(os.path.realpath(path)), []).append(path)
    if not files:
        raise LogError("No log was given; name at least one file or pattern, for example runs/*.csv.")
    return {first: tuple(map(str, other_paths)) for first, *other_paths in files.values()}


def _refuse_unusable_rows(columns: Columns, used: Flags, gated: Sequence[GatedRows], name: str) -> None:
    backwards = next((one for one in gated if one.rule == "time not increasing"), None)
    if backwards is not None and backwards.rows > MAJORITY * len(used):
        stands = np.count_nonzero(np.diff(columns["time_s"]) == 0.0) > 0.5 * backwards.rows
        raise LogError(
            f"{name}: time_s does not increase in {backwards.rows} of {len(used)} rows (first in line "
            f"{backwards.first_line}); {'log times with enough decimals' if stands else 'sort the rows by time'}."
        )
    lost = [(one, advice) for one in gated for word, advice in _ADVICE.items()
            if word in one.rule and one.rows > MAJORITY * len(used)]  # fmt: skip
    if lost and np.count_nonzero(used) >= 2:
        rows, advice = lost[0]
        raise LogError(
            f"{name}: {rows.rows} of {len(used)} rows are unusable: {rows.rule} (first in line "
            f"{rows.first_line}); {advice}."
        )
    if np.count_nonzero(used) < 2:
        largest = sorted(gated, key=lambda one: -one.rows)[:MAX_NAMED]
        why = "; ".join(f"{one.rule}: {one.rows} rows from line {one.first_line}" for one in largest)
        raise LogError(f"{name} has fewer than two usable rows of {len(used)} ({why}); correct the log.")


def _check_log(
    log: Log, fix_set: frozenset[LogConvention], wheelbase_m: float | None, other_logs: Sequence[Log] = ()
) -> None:
    """Refuse wrong conventions, a tractor that never moves, and an impossible rate."""
    suspicions = find_convention_errors(log, wheelbase_m, other_logs)
    rows, name = log.used, log.name
    if is_parked(log) and not any(suspicion.fix in _POSITION_FIXES for suspicion in suspicions):
        moved = float(np.hypot(np.ptp(log.easting_m[rows]), np.ptp(log.northing_m[rows])))
        raise LogError(
            f"{name}: its positions stay within {moved:.2g} m for {float(np.ptp(log.time_s[rows])):.0f} s, so the "
            "tractor never moves; leave this log out, or correct the columns easting_m and northing_m."
        )
    contradicted = [suspicion for suspicion in suspicions if suspicion.fix in fix_set]
    if contradicted:
        raise LogError(f"{name}: after the fix {contradicted[0].fix} {contradicted[0].why}; remove that fix.")
    if suspicions:
        raise LogError(f"{name}: it seems that {'; and that '.join(one.format_sentence() for one in suspicions)}.")
    if log.step_s < 1.0 / _FASTEST_HZ and is_bundled(log.time_s[rows]):
        mean_s = float(np.mean(np.diff(log.time_s[rows])))
        raise LogError(
            f"{name}: its rows come in bundles, {log.step_s:g} s apart within one and {mean_s:.2g} s on average, as "
            "where rows are stamped on arrival; write in time_s when each row was measured."
        )
    if not 1.0 / _FASTEST_HZ <= log.step_s <= MOMENT_S:
        raise LogError(
            f"{name}: its rows are {log.step_s:g} s apart; logs must have 1 to 100 Hz; check the unit of time_s or log "
            "at another rate."
        )
    if silent := describe_silent_steering(log):
        raise LogError(f"{silent}; log the wheel angle or the command.")
