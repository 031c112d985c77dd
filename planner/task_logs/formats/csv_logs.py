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
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from fields.text_files import quote_path, read_table_rows
from planner.errors import shorten_value, suggest_name
from planner.task_logs.formats.log_format import LogFormat, remove_unusable_rows
from planner.task_logs.formats.point_shapefiles import parse_timestamp
from planner.task_logs.runs.run_records import Array, LogContents, LoggedRun, Mask
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
TRUE_TEXTS = frozenset(("1", "1.0", "true", "on", "yes", "working", "down"))


def read_csv_log(path: str, mapping: str | None) -> LogContents:
    """The run of a CSV file, by a mapping file or usual column names; raises LogError."""
    rows = _read_rows(path)
    header = [cell.strip() for cell in rows[0]]
    columns, values = (_find_usual_columns(header, path), {}) if mapping is None else read_mapping_file(mapping)
    if mapping is not None:
        _check_mapping(columns, values, header, f"The mapping {quote_path(mapping)}", path)
    cells = {
        name: [row[header.index(column)] if header.index(column) < len(row) else "" for row in rows[1:]]
        for name, column in columns.items()
    }
    time_s, start = _parse_times(cells["time"])
    lonlat = np.column_stack([_parse_numbers(cells[name]) for name in ("longitude", "latitude")])
    run = LoggedRun(
        Path(path).stem,
        "CSV",
        lonlat,
        time_s,
        _find_numbers(cells, "speed_mps"),
        _parse_work_states(cells.get("works")),
        float(values["width_m"]) if "width_m" in values else None,
        start,
        str(values.get("field", "")) or Path(path).stem,
        elevation_m=_find_numbers(cells, "elevation_m"),
    )
    return LogContents((remove_unusable_rows(run),))


def _read_csv_by_usual_names(path: str, label: str) -> LogContents:
    return read_csv_log(path, None)


def _read_rows(path: str) -> list[list[str]]:
    """The cells of the file; raises LogError."""
    rows = read_table_rows(path, "a CSV file", LogError)
    if len(rows) < 3:
        raise LogError(f"{quote_path(path)} has fewer than two rows below its header; give a log with timed positions.")
    return rows


def _find_usual_columns(header: list[str], path: str) -> dict[str, str]:
    """Columns by their usual names; raises LogError for a missing column."""
    lower = [cell.lower() for cell in header]
    columns = {}
    for name, usual in USUAL_COLUMNS.items():
        place = next((lower.index(one) for one in usual if one in lower), None)
        if place is not None:
            columns[name] = header[place]
    lacks = [name for name in REQUIRED_COLUMNS if name not in columns]
    if lacks:
        raise LogError(
            f"{quote_path(path)} has no column {lacks[0]} (it has: {shorten_value(', '.join(header), 120)}); name it "
            'in a mapping file: [columns], then for instance time = "Timestamp".'
        )
    return columns


def _check_mapping(
    columns: Mapping[str, str], values: Mapping[str, Any], header: list[str], label: str, path: str
) -> None:
    for name, column in columns.items():
        if name not in USUAL_COLUMNS:
            raise LogError(
                f"{label} has {name!r} in [columns]{suggest_name(name, USUAL_COLUMNS)}; use only "
                f"{', '.join(USUAL_COLUMNS)}."
            )
        if column not in header:
            close = suggest_name(str(column), header)
            raise LogError(
                f"{label}: {quote_path(path)} has no column {shorten_value(column)}{close} for {name}; name an "
                "existing one."
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


def _parse_times(cells: list[str]) -> tuple[Array, str]:
    """Seconds (n,), and the first date and time as text unless the cells are seconds."""
    seconds = _parse_numbers(cells)
    if np.isfinite(seconds).mean() > 0.5:
        return seconds, ""
    stamps = np.array([parse_timestamp(cell) for cell in cells])
    known_stamps = stamps[np.isfinite(stamps)]
    if not len(known_stamps):
        raise LogError(f"the time column begins with {shorten_value(cells[0])}; write seconds, or 2020-01-02T17:30:20.")
    return stamps - known_stamps[0], datetime.fromtimestamp(float(known_stamps[0]), UTC).strftime("%Y-%m-%dT%H:%M:%S")


def _find_numbers(cells: Mapping[str, list[str]], column: str) -> Array | None:
    """The numbers of the first that has those of a column, in its unit: those of speed_kmh for speed_mps."""
    targets = {key: target for key in cells if (target := read_name(key)) is not None and target.column == column}
    return next((_parse_numbers(cells[key]) * target.factor for key, target in targets.items()), None)


def _parse_work_states(cells: list[str] | None) -> Mask | None:
    return None if cells is None else np.array([cell.strip().lower() in TRUE_TEXTS for cell in cells])


def _parse_numbers(cells: list[str]) -> Array:
    """Numbers (n,), NaN for other text."""
    return np.array([_parse_number(cell) for cell in cells])


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


LOG_FORMAT = LogFormat("CSV", (".csv", ".txt"), _read_csv_by_usual_names, lambda names: False)
