"""Shapefiles: one file, a folder or a ZIP archive of them; where no .prj says the system, it must be given."""

from __future__ import annotations

import tempfile
from pathlib import Path, PurePosixPath

from fields.document import UNKNOWN, Document, Format
from fields.errors import FieldError
from fields.formats.archive import Members, is_archive
from fields.formats.features import document_of
from fields.formats.vector import Layers, named_lines, read_layers

PARTS = (".shp", ".shx", ".dbf", ".prj", ".cpg")


def _read(path: str, label: str) -> Document:
    place = Path(path)
    if place.is_dir() or is_archive(place):
        found = _of_members(Members(place), label)
    else:
        _complete(place.parent, place.stem, {one.name.lower() for one in place.parent.iterdir()}, label)
        found = read_layers(place.with_suffix(".shp"), label, "a Shapefile")
    return document_of(
        named_lines(found.features), label, crs=found.crs or UNKNOWN, source="Shapefile", notes=tuple(found.notes)
    )


def _of_members(members: Members, label: str) -> Layers:
    """Features of every Shapefile of a folder or archive, unpacked to a place that is removed again."""
    whole = Layers()
    systems = set()
    for name in [one for one in members if one.lower().endswith(".shp")]:
        stem = PurePosixPath(name).stem
        with tempfile.TemporaryDirectory() as folder:
            for ending in PARTS:
                content = members.beside(name, stem + ending)
                if content is not None:
                    (Path(folder) / (stem + ending)).write_bytes(content)
            found = read_layers(Path(folder) / f"{stem}.shp", label, "a Shapefile")
        whole.features += found.features
        whole.notes += found.notes
        systems.add(found.crs)
    if len(systems) > 1:
        raise FieldError(f"{label} holds Shapefiles in different coordinate systems; name one of them alone.")
    whole.crs = systems.pop() if systems else None
    return whole


def _complete(folder: Path, stem: str, names: set[str], label: str) -> None:
    """Refuse a Shapefile without its geometry or its index."""
    missing = [stem + ending for ending in (".shp", ".shx") if (stem + ending).lower() not in names]
    if missing:
        raise FieldError(
            f"{label} lacks {' and '.join(missing)}; a Shapefile is .shp, .shx, .dbf and .prj together in one folder."
        )


FORMAT = Format(
    "Shapefile", (".shp", ".shx", ".dbf", ".prj"), _read, lambda names: any(n.endswith(".shp") for n in names)
)
