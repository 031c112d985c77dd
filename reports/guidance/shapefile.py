"""Shapefiles in longitude and latitude (EPSG:4326): boundary, obstacles, headland, entrance and lines, a file each.

Columns have names of at most ten letters, as dBASE wants them.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from reports.guidance.form import Files, Form
from reports.guidance.lines import Area, Guidance
from reports.guidance.markup import clean

ENDINGS = (".shp", ".shx", ".dbf", ".prj", ".cpg")
NO_DAY = "1980-01-01"
"""A dBASE table says when it was written; the same plan gives the same bytes."""
TEXT_BYTES = 254
"""The longest text of a dBASE table."""

Columns = Mapping[str, Sequence[Any]]


def _write(guidance: Guidance) -> Files:
    files: dict[str, bytes] = {}
    if guidance.boundary is not None:
        files |= _layer("boundary", [_polygon(guidance.boundary)], {"name": [guidance.field], "role": ["boundary"]})
    if guidance.obstacles:
        names = [area.name for area in guidance.obstacles]
        areas = [_polygon(area) for area in guidance.obstacles]
        files |= _layer("obstacles", areas, {"name": names, "role": ["obstacle"] * len(names)})
    edges = [shapely.linestrings(np.concatenate([r, r[:1]])) for area in guidance.inside_headland for r in area.rings]
    if edges:
        files |= _layer("headland", edges, {"role": ["headland"] * len(edges)})
    if guidance.entrance is not None:
        files |= _layer("entrance", [shapely.Point(guidance.entrance)], {"role": ["entrance"]})
    return files | _lines(guidance)


def _lines(guidance: Guidance) -> dict[str, bytes]:
    lines = guidance.lines
    if not lines:
        return {}
    columns: dict[str, list[Any]] = {
        "name": [line.name for line in lines],
        "role": ["guidance" for _ in lines],
        "tractor": [line.tractor for line in lines],
        "order": [line.order for line in lines],
        "kind": [line.kind for line in lines],
        "what": [line.words for line in lines],
        "bearing": [round(line.bearing_deg, 6) for line in lines],
        "length_m": [round(line.length_m, 3) for line in lines],
    }
    return _layer("lines", [shapely.linestrings(line.points) for line in lines], columns)


def _polygon(area: Area) -> shapely.Polygon:
    return shapely.Polygon(area.rings[0], area.rings[1:])


def _layer(name: str, shapes: Sequence[shapely.Geometry], columns: Columns) -> dict[str, bytes]:
    """The files of one Shapefile."""
    from pyogrio.raw import write

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"{name}.shp"
        write(
            place,
            shapely.to_wkb(np.array(shapes, dtype=object)),
            [_column(values) for values in columns.values()],
            list(columns),
            geometry_type=shapes[0].geom_type,
            crs="EPSG:4326",
            driver="ESRI Shapefile",
            encoding="UTF-8",
            DBF_DATE_LAST_UPDATE=NO_DAY,
        )
        parts = [place.with_suffix(ending) for ending in ENDINGS]
        return {part.name: part.read_bytes() for part in parts if part.exists()}


def _column(values: Sequence[Any]) -> Any:
    kind = type(values[0])
    if kind is str:
        values = [clean(value).encode("utf-8")[:TEXT_BYTES].decode("utf-8", "ignore") for value in values]
    return np.array(values, dtype={int: np.int32, float: np.float64}.get(kind, object))


FORM = Form("shapefile", "Shapefile", _write)
