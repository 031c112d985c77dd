"""A folder or archive with one field file of a form that is one file: a zipped GeoJSON, KML, GeoPackage or GPX."""

from __future__ import annotations

import tempfile
from pathlib import Path, PurePosixPath

from fields.document import Document
from fields.errors import FieldError
from fields.formats import geojson, geopackage, gpx, kml
from fields.formats.archive import Members
from fields.reading import shown

FORMS = {
    ending: form for form in (geojson.FORMAT, kml.FORMAT, geopackage.FORMAT, gpx.FORMAT) for ending in form.endings
    if ending != ".json"
}  # fmt: skip
"""By ending; JSON in a folder is usually something else."""
SHOWN = 4


def read_lone(path: str, label: str) -> Document | None:
    """What the one field file of a folder or archive holds; None where there is none.

    Raises:
        FieldError: it holds several, or the one cannot be read.
    """
    members = Members(path)
    names = [name for name in members if PurePosixPath(name).suffix.lower() in FORMS]
    if not names:
        return None
    if len(names) > 1:
        some = ", ".join(names[:SHOWN]) + (f" and {len(names) - SHOWN} more" if len(names) > SHOWN else "")
        raise FieldError(
            f"{shown(path)} holds {len(names)} field files ({some}); "
            f"{'name one of them' if members.path.is_dir() else 'unpack it and name one of them'}."
        )
    form = FORMS[PurePosixPath(names[0]).suffix.lower()]
    if members.path.is_dir():
        return form.read(str(members.path / names[0]), label)
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / f"fields{PurePosixPath(names[0]).suffix.lower()}"
        place.write_bytes(members[names[0]])
        return form.read(str(place), label)
