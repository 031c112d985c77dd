"""What the name of a field stands for: a sample or a file, and which of the fields in it."""

from __future__ import annotations

import difflib
import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from fields.document import Document
from fields.errors import FieldError
from fields.formats import FOREIGN, FORMATS, format_of, geojson, isoxml, shapefile
from fields.formats.archive import Members, is_archive
from fields.formats.lone import read_lone
from fields.reading import shown
from fields.samples_index import sample_names, sample_text


@dataclass(frozen=True)
class Source:
    """A name taken apart.

    Attributes:
        place: name of a sample, or path of a file.
        key: what stands behind the last "#", choosing one of several fields, or None.
        sample: whether `place` is a sample.
    """

    place: str
    key: str | None
    sample: bool

    @property
    def name(self) -> str:
        """What messages call it."""
        return Path(self.place).stem or Path(self.place).resolve().name

    def document(self) -> Document:
        """What it holds.

        Raises:
            FieldError: it is neither a sample nor a file that can be read, or a file of another form.
        """
        label = f"'{self.name}'"
        if self.sample:
            return geojson.parse(sample_text(self.place), label)
        if not os.path.exists(self.place) and self.place:
            raise FieldError(_missing(self.place))
        form = format_of(self.place)
        if form is not None:
            return form.read(self.place, label)
        whole = os.path.isdir(self.place) or is_archive(self.place)
        found = read_lone(self.place, label) if whole else None
        if found is None:
            raise FieldError(_foreign(self.place))
        return found


def source_of(where: str) -> Source:
    """Which sample or file a name means; a "#" belongs to the file's name where a file of that name exists."""
    if "#" in where and not os.path.exists(where):
        place, _, key = where.rpartition("#")
        return Source(place, key, place in sample_names())
    return Source(where, None, where in sample_names())


def field_file(where: str) -> Path | None:
    """The file that the name of a field stands for, None for a sample."""
    source = source_of(where)
    return None if source.sample else Path(source.place)


def field_files(where: str) -> tuple[Path, ...]:
    """Every file that a field of this name may be read from: of a folder all in it, of a file those beside it too.

    The parts of a Shapefile have one name, and ISOXML keeps fields in other XML files of its folder. None for a sample;
    a file that is not there is named all the same.
    """
    file = field_file(where)
    if file is None:
        return ()
    if os.path.isdir(file):
        return tuple(file / name for name in Members(file))
    kind, near = file.suffix.lower(), [file]
    with suppress(OSError):
        if kind in shapefile.FORMAT.endings:
            near = [one for one in file.parent.iterdir() if one.stem.lower() == file.stem.lower() and one.is_file()]
        elif kind in isoxml.FORMAT.endings:
            near = [one for one in file.parent.iterdir() if one.suffix.lower() == kind and one.is_file()]
    return tuple(sorted({file, *near}))


def _foreign(place: str) -> str:
    """What to say about a file, folder or archive that holds fields in no form that is read."""
    names = ", ".join(one.name for one in FORMATS[:-1]) + f" and {FORMATS[-1].name}"
    if os.path.isdir(place) or is_archive(place):
        kind = "a folder" if os.path.isdir(place) else "an archive"
        return (
            f"{shown(place)} is {kind} without a field file in it, such as a TASKDATA.XML, a Field.txt or a .shp; "
            f"{names} are read, so name one that holds such, or a file itself."
        )
    foreign = FOREIGN.get(Path(place).suffix.lower(), "of no known form")
    return (
        f"{shown(place)} is {foreign}, and fields are read from {names}; convert it, for instance with "
        f"ogr2ogr -t_srs EPSG:4326 {Path(place).stem}.geojson {Path(place).name}, or save it so from QGIS."
    )


def _missing(place: str) -> str:
    """What to say about a name that is neither a sample nor a file; a plain word may be a sample misspelt."""
    if os.path.lexists(place):
        return f"{shown(place)} is a symbolic link that leads to no file; mend the link or name a file."
    if os.path.basename(place) != place or Path(place).suffix or len(place) > 30:
        return f"There is no field file {shown(place)}; check its name and its folder."
    names = sample_names()
    near = difflib.get_close_matches(place.lower(), names, n=1, cutoff=0.0)[0]
    return f"There is no field file {shown(place)}; the nearest of the samples {', '.join(names)} is '{near}'."
