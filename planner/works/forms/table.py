"""CSV files of positions in time, with a mapping that says what their columns hold.

A mapping is a TOML file:

    [columns]                 # ours = "theirs"
    time = "Timestamp"        # a moment, or seconds
    longitude = "Lon"
    latitude = "Lat"
    speed_kmh = "Speed"       # or speed_mps
    works = "Implement"       # 1, true, on, yes for at work
    [values]
    width_m = 3.0
    field = "Long acre"

Without a mapping columns are found by usual names.
"""

from __future__ import annotations

import csv
import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from fields.reading import brief, parse_fault, read_bytes, read_text, shown
from planner.errors import nearest
from planner.works.forms.form import Form
from planner.works.forms.points import stamp
from planner.works.forms.rows import cleaned
from planner.works.record import Array, Found, Logged, Mask
from vehicle.measured.errors import LogError

USUAL: dict[str, tuple[str, ...]] = {
    "time": ("time", "timestamp", "time_s", "datetime", "isotime", "utc"),
    "longitude": ("longitude", "lon", "lng", "long"),
    "latitude": ("latitude", "lat"),
    "speed_kmh": ("speed_kmh", "kmh"),
    "speed_mps": ("speed_mps",),
    "works": ("works", "implement", "working", "work_state"),
}
"""What columns are called by themselves."""
NEEDED = ("time", "longitude", "latitude")
TRUE = frozenset(("1", "1.0", "true", "on", "yes", "working", "down"))
KMH = 1.0 / 3.6
MARKS = ",;\t"


@dataclass(frozen=True)
class _Mapped:
    """Which column holds what, and what holds for the whole file."""

    columns: dict[str, str]
    width_m: float | None = None
    field: str = ""


def read_mapped(path: str, mapping: str | None) -> Found:
    """The run of a CSV file, by a mapping file or by usual names of columns; raises FieldError, LogError."""
    rows, odd = _rows(path)
    header = [cell.strip() for cell in rows[0]]
    mapped = _usual(header, path) if mapping is None else _mapping(mapping, header, path)
    cells = {
        name: [row[header.index(column)] if header.index(column) < len(row) else "" for row in rows[1:]]
        for name, column in mapped.columns.items()
    }
    time_s, start = _times(cells["time"])
    comma = "," if any("," in one for one in cells["longitude"]) else "."
    lonlat = np.column_stack([_numbers(cells[name], comma) for name in ("longitude", "latitude")])
    run = Logged(
        Path(path).stem, "CSV", lonlat, time_s, _speed(cells, comma), _works(cells.get("works")), mapped.width_m, start,
        mapped.field or Path(path).stem, notes=(odd,) if odd else (),
    )  # fmt: skip
    return Found((cleaned(run),))


def _read(path: str, label: str) -> Found:
    return read_mapped(path, None)


def _rows(path: str) -> tuple[list[list[str]], str]:
    """The cells of the file, and a remark on its encoding."""
    content, odd = read_bytes(path, "a CSV file", LogError), ""
    if b"\0" in content:
        raise LogError(f"{shown(path)} is not a CSV file: it holds binary data; save it as text.")
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text, odd = content.decode("latin-1"), "the file is not UTF-8; it is read as Latin-1"
    first = text.split("\n", 1)[0]
    mark = max(MARKS, key=first.count)
    try:
        rows = [row for row in csv.reader(text.splitlines(), delimiter=mark) if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise LogError(f"{shown(path)} is not a CSV file ({error}); save it as comma-separated text.") from None
    if len(rows) < 3:
        raise LogError(f"{shown(path)} has fewer than two rows below its header; give a log with positions in time.")
    return rows, odd


def _usual(header: list[str], path: str) -> _Mapped:
    """Columns by their usual names; raises LogError that shows how to name them."""
    lower = [cell.lower() for cell in header]
    found = {}
    for name, usual in USUAL.items():
        place = next((lower.index(one) for one in usual if one in lower), None)
        if place is not None:
            found[name] = header[place]
    lacks = [name for name in NEEDED if name not in found]
    if lacks:
        raise LogError(
            f"{shown(path)} has no column known as {lacks[0]} (it has: {brief(', '.join(header), 120)}); say which one "
            'it is in a mapping file: [columns], then for instance time = "Timestamp".'
        )
    return _Mapped(found)


def _mapping(mapping: str, header: list[str], path: str) -> _Mapped:
    text = read_text(mapping, "a mapping file (TOML)", LogError)
    try:
        told = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        raise LogError(f"The mapping {shown(mapping)} is not TOML: {parse_fault(error)}.") from None
    columns, values = told.get("columns"), told.get("values", {})
    if not isinstance(columns, dict) or not isinstance(values, dict):
        raise LogError(
            f"The mapping {shown(mapping)} has no table [columns]; write one, as headland logs import --help says."
        )
    _check_mapping(columns, values, header, f"The mapping {shown(mapping)}", path)
    width = values.get("width_m")
    return _Mapped(dict(columns), None if width is None else float(width), str(values.get("field", "")))


def _check_mapping(
    columns: Mapping[str, Any], values: Mapping[str, Any], header: list[str], label: str, path: str
) -> None:
    for name, column in columns.items():
        if name not in USUAL:
            raise LogError(f"{label} has {name!r} in [columns]{nearest(name, USUAL)}; use of: {', '.join(USUAL)}.")
        if column not in header:
            close = nearest(str(column), header)
            raise LogError(f"{label}: {shown(path)} has no column {brief(column)}{close} for {name}; name one it has.")
    lacks = [name for name in NEEDED if name not in columns]
    if lacks:
        raise LogError(f"{label} does not say which column holds {lacks[0]}; add it to [columns].")
    odd = sorted(values.keys() - {"width_m", "field"})
    if odd:
        raise LogError(f"{label} has {odd[0]!r} in [values]; use width_m and field.")
    width = values.get("width_m")
    if width is not None and not (isinstance(width, int | float) and 0.1 <= width <= 100.0):
        raise LogError(f"{label}: width_m is {brief(width)}; use 0.1 to 100 m.")


def _times(cells: list[str]) -> tuple[Array, str]:
    """Seconds (n,), and the first moment as text where the cells are moments."""
    plain = _numbers(cells, ",")
    if np.isfinite(plain).mean() > 0.5:
        return plain, ""
    stamps = np.array([stamp(cell) for cell in cells])
    known = stamps[np.isfinite(stamps)]
    if not len(known):
        raise LogError(f"the column of time begins with {brief(cells[0])}; write seconds, or 2020-01-02T17:30:20.")
    return stamps - known[0], datetime.fromtimestamp(float(known[0]), UTC).strftime("%Y-%m-%dT%H:%M:%S")


def _speed(cells: Mapping[str, list[str]], comma: str) -> Array | None:
    if "speed_mps" in cells:
        return _numbers(cells["speed_mps"], comma)
    return _numbers(cells["speed_kmh"], comma) * KMH if "speed_kmh" in cells else None


def _works(cells: list[str] | None) -> Mask | None:
    return None if cells is None else np.array([cell.strip().lower() in TRUE for cell in cells])


def _numbers(cells: list[str], comma: str) -> Array:
    """Numbers (n,), NaN for other text."""
    return np.array([_number(cell.replace(",", ".") if comma == "," else cell) for cell in cells])


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


FORM = Form("CSV", (".csv", ".txt"), _read, lambda names: False)
