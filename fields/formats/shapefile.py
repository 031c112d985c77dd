"""Shapefiles: one file, a folder or a ZIP archive of them; where no .prj says the system, it must be given."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from fields.document import UNKNOWN, Document, Format
from fields.errors import FieldError
from fields.formats.archive import Members, members_around
from fields.formats.features import document_of
from fields.formats.vector import Layers, named_lines, read_layers

PARTS = (".shp", ".shx", ".dbf", ".prj", ".cpg")


def _read(path: str, label: str) -> Document:
    place = Path(path)
    members, names = shapefiles_at(place)
    if members.path != place:
        _complete(members, place.stem, label)
    found = _of_members(members, names, label)
    return document_of(
        named_lines(found.features), label, crs=found.crs or UNKNOWN, source="Shapefile", notes=tuple(found.notes)
    )


def shapefiles_at(place: Path) -> tuple[Members, list[str]]:
    """The .shp files of a folder or archive, or the one of this name, whatever its case, with what is beside them."""
    members = members_around(place)
    names = [one for one in members if one.lower().endswith(".shp")]
    if members.path != place:
        names = [one for one in names if PurePosixPath(one).stem.lower() == place.stem.lower()]
    return members, names


def _of_members(members: Members, names: Sequence[str], label: str) -> Layers:
    """Features of these Shapefiles of a folder or archive, copied to a place that is removed again."""
    whole = Layers()
    systems = set()
    for name in names:
        stem = PurePosixPath(name).stem
        if members.beside(name, f"{stem}.shx") is None:
            raise _lacks([f"{stem}.shx"], label)
        with tempfile.TemporaryDirectory() as folder:
            for ending in PARTS:
                content = members.beside(name, stem + ending)
                if content is not None:
                    (Path(folder) / f"fields{ending}").write_bytes(content)
            found = read_layers(Path(folder) / "fields.shp", label, "a Shapefile")
        whole.features += found.features
        whole.notes += found.notes
        systems.add(found.crs)
    if len(systems) > 1:
        raise FieldError(f"{label} holds Shapefiles in different coordinate systems; name one of them alone.")
    whole.crs = systems.pop() if systems else None
    return whole


def _complete(members: Members, stem: str, label: str) -> None:
    """Refuse a Shapefile without its geometry or its index."""
    missing = [stem + ending for ending in (".shp", ".shx") if not members.named(stem + ending)]
    if missing:
        raise _lacks(missing, label)


def _lacks(missing: list[str], label: str) -> FieldError:
    return FieldError(
        f"{label} lacks {' and '.join(missing)}; a Shapefile is .shp, .shx, .dbf and .prj together in one folder."
    )


FORMAT = Format(
    "Shapefile", (".shp", ".shx", ".dbf", ".prj"), _read, lambda names: any(n.endswith(".shp") for n in names)
)
