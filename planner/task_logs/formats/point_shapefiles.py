"""Shapefiles of timed points, as exported by John Deere Operations Center (columns IsoTime or Time, SWATHWIDTH).

Machines log such points while they work. Where a rate or yield column is 0, the implement was lifted; gaps in time were
not logged.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import shapely

from fields.arrays import Flags, Floats
from fields.formats.archive import ArchiveMembers
from fields.formats.gdal import SHAPEFILE_DRIVER, read_tables
from fields.formats.shapefile import find_component_files, find_shapefiles, pack_component_files
from fields.geometry.geodesy import DEGREES_CRS, is_wgs84_longitude_latitude, project
from fields.text_files import parse_number
from planner.task_logs.formats.log_format import LogFormat, read_each, remove_unusable_rows
from planner.task_logs.runs.run_records import LogContents, LoggedRun
from vehicle.identification.errors import LogError

METADATA_SUFFIX = "-Deere-Metadata.json"
LATIN1_NOTE = "names do not match the declared encoding; they are read as Latin-1"
RATE_COLUMNS = ("appliedrate", "vryieldvol", "wetmass", "drymass", "vryieldmas", "seedrate")
MAX_DBF_NAME_LETTERS = 10  # longest column name of dBASE; some exports write longer ones
UNIT_LENGTHS_M = {"ft": 0.3048, "m": 1.0, "in": 0.0254, "cm": 0.01}
TIME_COLUMNS, ELEVATION_COLUMN, WIDTH_COLUMN = ("isotime", "time"), "elevation", "swathwidth"
TIME_FORMATS = ("%m/%d/%Y %I:%M:%S %p", "%Y-%m-%d %H:%M:%S", "%Y/%m/%d %H:%M:%S", "%d.%m.%Y %H:%M:%S")
UNIX_EPOCH = datetime(1970, 1, 1)


def _read_point_shapefiles(path: str, label: str) -> LogContents:
    members, names = find_shapefiles(Path(path))
    return read_each(
        ((PurePosixPath(name).name, partial(_read_run, members, name)) for name in names),
        f"{label} has no Shapefile; name the .shp file, its folder or a ZIP archive of it.",
    )


def _read_run(members: ArchiveMembers, name: str) -> LoggedRun:
    stem = PurePosixPath(name).stem
    columns, lonlat, encoding_note = _read_columns(members, name)
    time_s = _parse_times(columns)
    content = members.read_member_beside(name, stem + METADATA_SUFFIX)
    try:
        metadata = json.loads(content.decode("utf-8-sig")) if content else {}
    except (ValueError, RecursionError):
        metadata = {}
    metadata = metadata if isinstance(metadata, dict) else {}
    notes = [encoding_note] if encoding_note else []
    works, elevation_m = _find_work_state(columns, notes), _find_elevation_m(columns, metadata, notes)
    run = LoggedRun(
        name=stem,
        log_format="Shapefile",
        lonlat=lonlat,
        time_s=time_s,
        is_working=works,
        width_m=_compute_median_width_m(columns, metadata, notes),
        field=str(metadata.get("FieldName") or stem),
        notes=tuple(notes),
        elevation_m=elevation_m,
    )
    return remove_unusable_rows(run.select_rows(np.argsort(time_s, kind="stable")), UNIX_EPOCH)


def _read_columns(members: ArchiveMembers, name: str) -> tuple[Mapping[str, Sequence[Any]], Floats, str]:
    """Columns by lower-case names, positions in degrees, and a note on the encoding; raises FieldError, LogError."""
    parts = pack_component_files(find_component_files(members, name, "it"))
    (table,) = read_tables(parts, "it", "a Shapefile", (SHAPEFILE_DRIVER,), with_heights=False)
    points = shapely.from_wkb(table.shapes, on_invalid="ignore")
    if {one.geom_type for one in points if one is not None} != {"Point"}:
        raise LogError("its shapes are not points; name the Shapefile of logged points.")
    lonlat = np.column_stack([shapely.get_x(points), shapely.get_y(points)])
    if table.crs is None:
        raise LogError("it has no .prj with its coordinate system; export it with one.")
    if not is_wgs84_longitude_latitude(table.crs):
        is_finite = np.isfinite(lonlat).all(axis=1)
        lonlat[is_finite] = project(lonlat[is_finite], table.crs, DEGREES_CRS)
    return table.columns, lonlat, LATIN1_NOTE if table.is_latin1 else ""


def _parse_times(columns: Mapping[str, Sequence[Any]]) -> Floats:
    """Seconds (n,) since UNIX_EPOCH."""
    name = next((one for one in TIME_COLUMNS if one in columns), None)
    if name is None:
        raise LogError(f"it has no column IsoTime or Time (it has: {', '.join(columns)}); export the points with time.")
    stamps = np.array([parse_timestamp(value) for value in columns[name]])
    if not np.isfinite(stamps).any():
        raise LogError(f"its column {name} has no time such as 2020-01-02T17:30:20; export the points with time.")
    return stamps


def parse_timestamp(value: Any) -> float:
    """A date and time as seconds since UNIX_EPOCH, in any of the formats of exports; NaN for anything else."""
    text = str(value).strip()
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        for clock in TIME_FORMATS:
            try:
                when = datetime.strptime(text, clock)
                break
            except ValueError:
                continue
        else:
            return math.nan
    try:
        return (when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp()
    except (OverflowError, ValueError):
        return math.nan


def _find_work_state(columns: Mapping[str, Sequence[Any]], notes: list[str]) -> Flags | None:
    """Working where a rate column is above 0; None without such a column."""
    name = next(
        (one for rate in RATE_COLUMNS for one in columns if one == rate or one == rate[:MAX_DBF_NAME_LETTERS]), None
    )
    if name is None:
        return None
    notes.append(f"the work state is from column {name}: working if above 0")
    values = np.array([parse_number(value) for value in columns[name]])
    return np.asarray(values > 0.0)


def _compute_median_width_m(
    columns: Mapping[str, Sequence[Any]], metadata: dict[str, Any], notes: list[str]
) -> float | None:
    """The median of SWATHWIDTH in metres, by the unit in the metadata, in feet without it; None for another unit."""
    values = np.array([parse_number(value) for value in columns.get(WIDTH_COLUMN, ())])
    values = values[np.isfinite(values) & (values > 0.0)]
    if not len(values):
        return None
    unit = _find_unit(metadata, WIDTH_COLUMN)
    if not unit:
        notes.append("the width is taken to be in feet, as its unit is not stated")
    elif unit not in UNIT_LENGTHS_M:
        notes.append(f"the width is not used, as its unit {unit!r} is unknown")
        return None
    return float(np.median(values)) * UNIT_LENGTHS_M[unit or "ft"]


def _find_elevation_m(
    columns: Mapping[str, Sequence[Any]], metadata: dict[str, Any], notes: list[str]
) -> Floats | None:
    """Heights of the column Elevation in metres, by the unit in the metadata; without a unit they are not used."""
    if ELEVATION_COLUMN not in columns:
        return None
    unit_m = UNIT_LENGTHS_M.get(_find_unit(metadata, ELEVATION_COLUMN))
    if unit_m is None:
        notes.append("heights of the column Elevation are not used, as their unit is not stated")
        return None
    return unit_m * np.array([parse_number(value) for value in columns[ELEVATION_COLUMN]])


def _find_unit(metadata: dict[str, Any], column: str) -> str:
    """The unit that the metadata give a column, "" without one."""
    attributes = [one for one in metadata.get("DataAttributes") or () if isinstance(one, dict)]
    return str(next((one.get("Unit") for one in attributes if str(one.get("Name")).lower() == column), None) or "")


LOG_FORMAT = LogFormat(
    "a Shapefile", (".shp",), _read_point_shapefiles, lambda names: any(one.endswith(".shp") for one in names)
)
