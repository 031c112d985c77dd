"""CSV files of positions in time, with an optional mapping file (TOML) that describes their columns:

    [columns]                 # our name = "name in the file"
    time = "Timestamp"        # a date and time, or seconds
    longitude = "Lon"
    latitude = "Lat"
    speed_kmh = "Speed"       # or speed_mps
    works = "Implement"       # 1, true, on or yes while working
    elevation_m = "Altitude"  # or elevation_ft
    [values]
    width_m = 3.0
    field = "Long acre"

Without a mapping, columns are found by usual names.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from fields.arrays import Flags, Floats
from fields.text_files import CellTable, parse_number, quote_path, read_table
from fields.units import DAY_S, KILO, MINUTE_S
from planner.errors import shorten_value, suggest_name
from planner.task_logs.formats.log_format import LogFormat, remove_unusable_rows
from planner.task_logs.formats.point_shapefiles import UNIX_EPOCH, parse_timestamp
from planner.task_logs.runs.run_records import LogContents, LoggedRun
from vehicle.identification.errors import LogError
from vehicle.identification.logs.table import read_mapping_file, read_name

USUAL_COLUMNS: dict[str, tuple[str, ...]] = {
    "time": ("time", "timestamp", "time_s", "datetime", "isotime", "utc"),
    "longitude": ("longitude", "lon", "lng", "long"),
    "latitude": ("latitude", "lat"),
    "speed_mps": ("speed_mps",),
    "speed_kmh": ("speed_kmh", "kmh"),
    "works": ("works", "implement", "working", "work_state"),
    "elevation_m": ("elevation_m", "altitude_m"),
    "elevation_ft": ("elevation_ft", "altitude_ft"),
}
"""Usual names of columns, in lower case."""
REQUIRED_COLUMNS = ("time", "longitude", "latitude")
TRUE_TEXTS = ("true", "on", "yes", "working", "down")
FALSE_TEXTS = ("", "false", "off", "no", "not working", "up", "nan", "null", "none", "n/a", "-")
MAX_SECONDS = 1e10  # in the year 2286, since 1970
WEEK_S = 7 * DAY_S
MIN_STEP_MS = 50.0  # between the rows of a receiver
TIME_HINT = "write seconds, or 2020-01-02T17:30:20"


def read_csv_log(path: str, mapping: str | None) -> LogContents:
    """The run of a CSV file, by a mapping file or usual column names; raises LogError."""
    table = read_table(path, "a CSV file", LogError)
    if len(table.rows) < 2:
        raise LogError(f"{quote_path(path)} has fewer than two rows below its header; give a log with timed positions.")
    columns, values = (_find_usual_columns(table), {}) if mapping is None else read_mapping_file(mapping)
    if mapping is not None:
        _check_mapping(columns, values, table, f"The mapping {quote_path(mapping)}")
    time_s, epoch = _parse_times(table, columns["time"])
    run = LoggedRun(
        name=Path(path).stem,
        log_format="CSV",
        lonlat=np.column_stack([table.list_numbers(columns[name]) for name in ("longitude", "latitude")]),
        time_s=time_s,
        speed_mps=_find_numbers(table, columns, "speed_mps"),
        is_working=_parse_work_state(table, columns["works"]) if "works" in columns else None,
        width_m=float(values["width_m"]) if "width_m" in values else None,
        field=str(values.get("field", "")) or Path(path).stem,
        elevation_m=_find_numbers(table, columns, "elevation_m"),
    )
    return LogContents((remove_unusable_rows(run, epoch),))


def _find_usual_columns(table: CellTable) -> dict[str, str]:
    """Columns by their usual names; raises LogError for a missing column."""
    columns = {name: column for name, usual in USUAL_COLUMNS.items() if (column := table.find_column(usual))}
    lacks = [name for name in REQUIRED_COLUMNS if name not in columns]
    if lacks:
        raise LogError(
            f"{table.label} has no column {lacks[0]} (it has: {shorten_value(', '.join(table.header), 120)}); name it "
            'in a mapping file: [columns], then for instance time = "Timestamp".'
        )
    return columns


def _check_mapping(columns: Mapping[str, str], values: Mapping[str, Any], table: CellTable, label: str) -> None:
    for name, column in columns.items():
        if name not in USUAL_COLUMNS:
            raise LogError(
                f"{label} has {name!r} in [columns]{suggest_name(name, USUAL_COLUMNS)}; use only "
                f"{', '.join(USUAL_COLUMNS)}."
            )
        if column not in table.header:
            close = suggest_name(str(column), table.header)
            raise LogError(
                f"{label}: {table.label} has no column {shorten_value(column)}{close} for {name}; name an existing one."
            )
    lacks = [name for name in REQUIRED_COLUMNS if name not in columns]
    if lacks:
        raise LogError(f"{label} does not name the column of {lacks[0]}; add it to [columns].")
    unknown_keys = sorted(values.keys() - {"width_m", "field"})
    if unknown_keys:
        raise LogError(f"{label} has {unknown_keys[0]!r} in [values]; use width_m and field.")
    width = values.get("width_m")
    if width is not None and not (isinstance(width, int | float) and 0.1 <= width <= 100.0):
        raise LogError(f"{label}: width_m is {shorten_value(width)}; use 0.1 to 100 m.")


def _parse_work_state(table: CellTable, column: str) -> Flags:
    """Whether the implement works (n,), not where a cell is empty; raises LogError for a cell that says neither."""
    works = []
    for row, cell in enumerate(map(str.lower, table.list_cells(column))):
        number = parse_number(cell)
        if math.isnan(number) and cell not in (*TRUE_TEXTS, *FALSE_TEXTS):
            raise LogError(
                f"{table.describe_cell(row, column)}; write 1, true, on or yes while the implement works, and 0, "
                "false, off or no otherwise."
            )
        works.append(cell in TRUE_TEXTS or number > 0.0)
    return np.array(works)


def _parse_times(table: CellTable, column: str) -> tuple[Floats, datetime | None]:
    """Seconds (n,), and when they were 0; None if the cells are seconds. Raises LogError for other numbers."""
    seconds, first = np.array(table.list_numbers(column)), shorten_value(table.get_cell(0, column))
    if np.isfinite(seconds).mean() > 0.5:
        known = seconds[np.isfinite(seconds)]
        if np.abs(known).max() > MAX_SECONDS or _are_times_of_day(known) or _are_milliseconds_of_week(known):
            raise LogError(f"the time column begins with {first}, which is not in seconds; {TIME_HINT}.")
        return seconds, None
    stamps = np.array([parse_timestamp(cell) for cell in table.list_cells(column)])
    if not np.isfinite(stamps).any():
        raise LogError(f"the time column begins with {first}; {TIME_HINT}.")
    return stamps, UNIX_EPOCH


def _are_times_of_day(numbers: Floats) -> bool:
    """Whether numbers are hours, minutes and seconds in one, as 173020: neither of these says more than 59."""
    whole = np.floor(numbers)
    is_dense = np.ptp(whole) > 100.0 and float(np.median(np.diff(whole))) < 40.0  # seconds would say 60 to 99 too
    return bool(is_dense and whole.min() >= 0.0 and max((whole % 100.0).max(), (whole // 100.0 % 100.0).max()) < 60.0)


def _are_milliseconds_of_week(numbers: Floats) -> bool:
    """Whether numbers are milliseconds of a GPS week: too far apart for seconds, unless these are whole minutes."""
    is_in_week = numbers.min() >= 0.0 and WEEK_S < numbers.max() <= KILO * WEEK_S
    step = float(np.median(np.diff(numbers))) if len(numbers) > 1 else 0.0
    return bool(is_in_week and (numbers % 1.0 == 0.0).all() and step >= MIN_STEP_MS and step % MINUTE_S != 0.0)


def _find_numbers(table: CellTable, columns: Mapping[str, str], name: str) -> Floats | None:
    """The numbers of the first column that has those of a name, in its unit: those of speed_kmh for speed_mps."""
    for key, column in columns.items():
        target = read_name(key)
        if target is not None and target.column == name:
            return np.array(table.list_numbers(column)) * target.factor
    return None


LOG_FORMAT = LogFormat("CSV", (".csv", ".txt"), lambda path, label: read_csv_log(path, None))
