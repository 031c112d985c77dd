"""The forms of field files that are read: one module each with the record FORMAT, and the line here that names it.

`lone` reads a folder or archive that has one field file in it.
"""

from __future__ import annotations

from pathlib import Path

from fields.document import Format
from fields.formats import agopengps, geojson, geopackage, gpx, isoxml, kml, shapefile
from fields.formats.archive import names_in

FORMATS: tuple[Format, ...] = (
    geojson.FORMAT, shapefile.FORMAT, kml.FORMAT, geopackage.FORMAT, gpx.FORMAT, isoxml.FORMAT, agopengps.FORMAT,
)  # fmt: skip
FOREIGN = {
    ".gml": "GML", ".parquet": "Parquet", ".dxf": "DXF", ".dwg": "DWG", ".csv": "CSV", ".gdb": "a geodatabase",
    ".tif": "a picture", ".pdf": "a PDF",
}  # fmt: skip
"""Endings of files that hold fields in a form that is not read."""


def format_of(path: str) -> Format | None:
    """The form of a file, folder or archive: by what is in it, else by its ending.

    None for a foreign one; the first of FORMATS for an ending nobody knows.

    Raises:
        FieldError: an archive cannot be opened, or is not safe to.
    """
    names = names_in(path)
    if names:
        return next((form for form in FORMATS if form.holds(names)), None) or _only(names, path)
    ending = Path(path).suffix.lower()
    if Path(path).name.lower() == agopengps.FIELD:
        return agopengps.FORMAT
    known = next((form for form in FORMATS if ending in form.endings), None)
    return known or (None if ending in FOREIGN or (path and Path(path).is_dir()) else FORMATS[0])


def _only(names: frozenset[str], path: str) -> Format | None:
    """The form of an archive such as a KMZ that is known by its ending alone."""
    return next((form for form in FORMATS if Path(path).suffix.lower() in form.endings), None)
