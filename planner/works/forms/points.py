"""Shapefiles of points in time, as John Deere's Operations Center exports them: columns IsoTime or Time, SWATHWIDTH.

Machines log such points while they work. A column of a rate or a yield that is 0 says that the implement was up; what
lies between points far apart in time was not logged.
"""

from __future__ import annotations

import json
import math
import tempfile
import warnings
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from fields.errors import FieldError
from fields.formats.archive import Members
from fields.formats.shapefile import PARTS, shapefiles_at
from fields.projection import is_longitude_latitude, project
from planner.works.forms.form import Form
from planner.works.forms.rows import cleaned
from planner.works.metres import WGS84
from planner.works.record import Array, Found, Logged, Mask
from vehicle.measured.errors import LogError

METADATA = "-Deere-Metadata.json"
RATES = ("appliedrate", "vryieldvol", "wetmass", "drymass", "vryieldmas", "seedrate")
DBF_NAME = 10  # letters that a column's name has room for; some exports write one more
LENGTHS_M = {"ft": 0.3048, "m": 1.0, "in": 0.0254, "cm": 0.01}
TIMES = ("isotime", "time")
CLOCKS = ("%m/%d/%Y %I:%M:%S %p", "%Y-%m-%d %H:%M:%S", "%Y/%m/%d %H:%M:%S")


def _read(path: str, label: str) -> Found:
    members, names = shapefiles_at(Path(path))
    runs, notes = [], []
    for name in names:
        try:
            runs.append(_run(members, name))
        except (FieldError, LogError) as refusal:
            notes.append(f"{PurePosixPath(name).name} is left out: {refusal}")
    if not names:
        raise LogError(f"{label} is no Shapefile that is there; name the .shp file, its folder or a zip of it.")
    return Found(tuple(runs), tuple(notes))


def _run(members: Members, name: str) -> Logged:
    stem = PurePosixPath(name).stem
    columns, lonlat, odd = _columns(members, name)
    time_s, start = _times(columns)
    told = _metadata(members, name, stem)
    notes = [odd] if odd else []
    works = _works(columns, notes)
    if len(time_s) and not np.isfinite(time_s).any():
        raise LogError("no time is in its column IsoTime or Time; export the points with their time.")
    order = np.argsort(time_s, kind="stable")
    run = Logged(
        stem, "Shapefile", lonlat[order], time_s[order], works=None if works is None else works[order],
        width_m=_width_m(columns, told), start=start, field=str(told.get("FieldName") or stem), notes=tuple(notes),
    )  # fmt: skip
    return cleaned(run)


def _columns(members: Members, name: str) -> tuple[dict[str, Sequence[Any]], Array, str]:
    """Columns by their names in lower case, positions in degrees, and a remark on the encoding."""
    import shapely
    from pyogrio.errors import DataLayerError, DataSourceError
    from pyogrio.raw import read

    stem, odd = PurePosixPath(name).stem, ""
    with tempfile.TemporaryDirectory() as folder:
        for ending in PARTS:
            content = members.beside(name, stem + ending)
            if content is not None:
                (Path(folder) / f"run{ending}").write_bytes(content)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # numbers that GDAL cannot read are those of no row that counts
                try:
                    meta, _, shapes, values = read(Path(folder) / "run.shp", force_2d=True)
                except UnicodeDecodeError:
                    meta, _, shapes, values = read(Path(folder) / "run.shp", force_2d=True, encoding="ISO-8859-1")
                    odd = "names are not in the encoding the file says; they are read as Latin-1"
        except (DataSourceError, DataLayerError, ValueError, RuntimeError, OSError):
            raise LogError("it cannot be read as a Shapefile; export it again.") from None
    found = shapely.from_wkb(shapes if shapes is not None else [], on_invalid="ignore")
    kinds = {one.geom_type for one in found if one is not None}
    if kinds != {"Point"}:
        raise LogError("it holds no points but other shapes; name the Shapefile of logged points.")
    lonlat = np.column_stack([shapely.get_x(found), shapely.get_y(found)])
    if meta["crs"] is None:
        raise LogError("no .prj says its coordinate system; export it with one.")
    if not is_longitude_latitude(meta["crs"]):
        lonlat = _degrees(lonlat, meta["crs"])
    return {str(one).lower(): column for one, column in zip(meta["fields"], values, strict=True)}, lonlat, odd


def _degrees(points: Array, crs: str) -> Array:
    whole = np.isfinite(points).all(axis=1)
    points[whole] = project(points[whole], crs, WGS84)
    return points


def _times(columns: dict[str, Sequence[Any]]) -> tuple[Array, str]:
    """Seconds (n,) from the first moment that is one, and that moment as text."""
    name = next((one for one in TIMES if one in columns), None)
    if name is None:
        raise LogError(f"it has no column IsoTime or Time (it has: {', '.join(columns)}); export the points with time.")
    stamps = np.array([stamp(value) for value in columns[name]])
    known = stamps[np.isfinite(stamps)]
    if not len(known):
        raise LogError(f"its column {name} has no moment such as 2020-01-02T17:30:20; export the points with time.")
    first = float(known.min())
    return stamps - first, datetime.fromtimestamp(first, UTC).strftime("%Y-%m-%dT%H:%M:%S")


def stamp(value: Any) -> float:
    """A moment as seconds since 1970, in any of the ways that exports write it; NaN for anything else."""
    text = str(value).strip()
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        for clock in CLOCKS:
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


def _works(columns: dict[str, Sequence[Any]], notes: list[str]) -> Mask | None:
    """At work is where the column of a rate is above 0; None without one."""
    name = next((one for rate in RATES for one in columns if one == rate or one == rate[:DBF_NAME]), None)
    if name is None:
        return None
    notes.append(f"at work is where its column {name} is above 0")
    values = np.array([_number(value) for value in columns[name]])
    return np.asarray(values > 0.0)


def _width_m(columns: dict[str, Sequence[Any]], told: dict[str, Any]) -> float | None:
    """The median of SWATHWIDTH by the unit that the metadata say; feet without."""
    if "swathwidth" not in columns:
        return None
    said = [one for one in told.get("DataAttributes") or () if isinstance(one, dict)]
    unit = next((one.get("Unit") for one in said if str(one.get("Name")).lower() == "swathwidth"), "ft")
    values = np.array([_number(value) for value in columns["swathwidth"]])
    values = values[np.isfinite(values) & (values > 0.0)]
    return float(np.median(values)) * LENGTHS_M.get(str(unit), LENGTHS_M["ft"]) if len(values) else None


def _number(value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError):
        return math.nan


def _metadata(members: Members, name: str, stem: str) -> dict[str, Any]:
    content = members.beside(name, stem + METADATA)
    try:
        told = json.loads(content.decode("utf-8-sig")) if content else {}
    except (ValueError, RecursionError):
        return {}
    return told if isinstance(told, dict) else {}


FORM = Form("a Shapefile", (".shp",), _read, lambda names: any(one.endswith(".shp") for one in names))
