"""KML (OGC 12-007) and KMZ: always in longitude and latitude."""

from __future__ import annotations

import tempfile
from pathlib import Path, PurePosixPath

from fields.document import Document, Format
from fields.errors import FieldError
from fields.formats.archive import Members, is_archive
from fields.formats.features import document_of
from fields.formats.markup import refuse_entities
from fields.formats.vector import WGS84, named_lines, read_layers
from fields.reading import read_bytes

ROOT = "doc.kml"


def _read(path: str, label: str) -> Document:
    texts = _unpacked(path, label) if is_archive(path) else [read_bytes(path, "a KML file", FieldError)]
    features, notes = [], []
    for content in texts:
        refuse_entities(content, label)
        with tempfile.TemporaryDirectory() as folder:
            place = Path(folder) / "fields.kml"
            place.write_bytes(content)
            found = read_layers(place, label, "KML")
        features += found.features
        notes += found.notes
    return document_of(named_lines(features), label, crs=WGS84, source="KML", notes=tuple(notes))


def _unpacked(path: str, label: str) -> list[bytes]:
    """Every document of a KMZ, the one that viewers show first."""
    members = Members(path)
    names = [name for name in members if name.lower().endswith(".kml")]
    if not names:
        raise FieldError(f"{label} holds no KML; give a KMZ with a doc.kml in it.")
    names.sort(key=lambda name: PurePosixPath(name).name.lower() != ROOT)
    return [members[name] for name in names]


FORMAT = Format("KML", (".kml", ".kmz"), _read, lambda names: ROOT in names)
