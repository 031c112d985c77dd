"""GeoPackage (OGC 12-128) and FlatGeobuf: one file with its coordinate system in it."""

from __future__ import annotations

from fields.document import UNKNOWN, Document, Format
from fields.formats.features import document_of
from fields.formats.vector import named_lines, read_layers


def _read(path: str, label: str) -> Document:
    found = read_layers(path, label, "a GeoPackage or FlatGeobuf")
    return document_of(
        named_lines(found.features), label, crs=found.crs or UNKNOWN, source="GeoPackage", notes=tuple(found.notes)
    )


FORMAT = Format("GeoPackage", (".gpkg", ".fgb"), _read)
