"""The forms of field files that are read: one module each with the record FORMAT, and the line here that names it."""

from __future__ import annotations

from pathlib import Path

from fields.document import Format
from fields.formats import geojson

FORMATS: tuple[Format, ...] = (geojson.FORMAT,)
FOREIGN = {
    ".kml": "KML", ".kmz": "KML", ".gml": "GML", ".gpx": "GPX", ".xml": "XML", ".shp": "a Shapefile",
    ".shx": "part of a Shapefile", ".dbf": "part of a Shapefile", ".prj": "part of a Shapefile",
    ".gpkg": "a GeoPackage", ".fgb": "FlatGeobuf", ".parquet": "Parquet", ".dxf": "DXF", ".dwg": "DWG",
    ".zip": "a ZIP archive", ".csv": "CSV", ".gdb": "a geodatabase",
}  # fmt: skip
"""Endings of files that hold fields in a form that is not read."""


def format_of(path: str) -> Format | None:
    """The form of a file by its ending; the first of FORMATS for an ending nobody knows, None for a foreign one."""
    ending = Path(path).suffix.lower()
    known = next((form for form in FORMATS if ending in form.endings), None)
    return known or (None if ending in FOREIGN else FORMATS[0])
