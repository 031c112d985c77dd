"""KML (OGC 12-007) and KMZ: always in longitude and latitude."""

from __future__ import annotations

import tempfile
from pathlib import Path

from fields.document import Document, Format
from fields.errors import FieldError
from fields.formats.archive import Members, is_archive
from fields.formats.features import document_of
from fields.formats.markup import refuse_entities
from fields.formats.vector import WGS84, named_lines, read_layers
from fields.reading import read_bytes, shown


def _read(path: str, label: str) -> Document:
    content = _unpacked(path) if is_archive(path) else read_bytes(path, "a KML file", FieldError)
    refuse_entities(content, label)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "fields.kml"
        place.write_bytes(content)
        found = read_layers(place, label, "KML")
    return document_of(named_lines(found.features), label, crs=WGS84, source="KML", notes=tuple(found.notes))


def _unpacked(path: str) -> bytes:
    """The document of a KMZ: doc.kml, or else the first KML in it."""
    members = Members(path)
    names = [name for name in members if name.lower().endswith(".kml")]
    if not names:
        raise FieldError(f"{shown(path)} holds no KML; give a KMZ with a doc.kml in it.")
    return members[next(iter(members.named("doc.kml")), names[0])]


FORMAT = Format("KML", (".kml", ".kmz"), _read, lambda names: "doc.kml" in names)
