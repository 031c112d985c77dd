"""What the name of a field means: a sample or a file, its format, and which of its fields."""

from __future__ import annotations

import codecs
import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath

from fields.errors import FieldError, join_first, suggest_name
from fields.formats import geojson, isoxml, shapefile
from fields.formats.archive import ArchiveMembers, is_archive, list_names
from fields.formats.format_records import list_records
from fields.raw_document import (
    SHAPE_NAME,
    UNKNOWN_CRS,
    FieldDocument,
    FieldFormat,
    GeoShape,
    is_shape_text,
    write_shape_text,
)
from fields.sample_fields import list_sample_names, read_sample_text
from fields.text_files import quote_path

FIELD_FORMATS = list_records(FieldFormat, first=("geojson", "shapefile", "kml", "geopackage", "gpx", "isoxml"))
"""In the order in which a folder or archive is tried; a file with an unknown extension is taken for the first."""
JSON_BEGIN_BYTES = 4096  # read of a file with an unknown extension; GeoJSON begins with a bracket after its spaces
SINGLE_FILE_FORMATS = {
    extension: field_format
    for field_format in FIELD_FORMATS
    for extension in field_format.extensions
    if field_format.parse is not None and extension != ".json"
}
"""By extension; a .json file in a folder is usually something else."""
FOREIGN_EXTENSIONS = {
    ".gml": "GML",
    ".parquet": "Parquet",
    ".dxf": "DXF",
    ".dwg": "DWG",
    ".csv": "CSV",
    ".gdb": "a geodatabase",
    ".tif": "a picture",
    ".pdf": "a PDF",
    ".toml": "TOML, as files of tractors, farms and days are",
}
"""Extensions of files that may contain fields, for the refusal of those that no format reads."""


def read_single_file(path: str, label: str) -> FieldDocument | None:
    """The content of the only field file in a folder or archive; None if there is none.

    Raises FieldError where there are several, or the file cannot be read.
    """
    members = ArchiveMembers(path)
    names = [name for name in members if PurePosixPath(name).suffix.lower() in SINGLE_FILE_FORMATS]
    if not names:
        return None
    if len(names) > 1:
        raise FieldError(
            f"{quote_path(path)} holds {len(names)} field files ({join_first(names)}); "
            f"{'name one of them' if members.path.is_dir() else 'unpack it and name one of them'}."
        )
    field_format = SINGLE_FILE_FORMATS[PurePosixPath(names[0]).suffix.lower()]
    if members.path.is_dir():
        return field_format.read(str(members.path / names[0]), label)
    return None if field_format.parse is None else field_format.parse(members[names[0]], label)


@dataclass(frozen=True)
class FieldReference:
    """The parts of the name of a field.

    Attributes:
        place: name of a sample, path of a file, or the text of a shape.
        key: the text after the "#" that ends the place, which chooses one of several fields, or None.
        is_sample: whether `place` is a sample.
        is_shape: whether `place` is the text of a shape.
    """

    place: str
    key: str | None
    is_sample: bool
    is_shape: bool = False

    @property
    def name(self) -> str:
        """What a field without a name of its own is called: the file without its ending."""
        return SHAPE_NAME if self.is_shape else Path(self.place).stem or Path(self.place).resolve().name

    @property
    def label(self) -> str:
        """Its name in messages, in quotes: that of the file as it stands in its folder."""
        return f"'{SHAPE_NAME if self.is_shape else Path(self.place).name or self.name}'"

    def check_exists(self) -> None:
        """Raise FieldError for what is neither a sample, a shape nor a file or folder."""
        if not (self.is_sample or self.is_shape or os.path.exists(self.place)) and self.place:
            raise FieldError(_explain_missing_file(self.place))

    def read_document(self) -> FieldDocument:
        """Its content, unchecked.

        Raises FieldError where it is neither a sample nor a readable file of a supported format.
        """
        label = self.label
        if self.is_sample:
            return geojson.parse_geojson(read_sample_text(self.place), label)
        if self.is_shape:  # only files are in degrees where they do not say so
            shape = geojson.parse_geojson(self.place, label)
            return replace(shape, crs=shape.crs or (None if shape.frame else UNKNOWN_CRS), is_shape=True)
        self.check_exists()
        if os.path.isfile(self.place) and not os.path.getsize(self.place):
            raise FieldError(f"{quote_path(self.place)} is empty; save it again, or name another file.")
        field_format = find_field_format(self.place)
        if field_format is not None:
            return field_format.read(self.place, label)
        is_container = os.path.isdir(self.place) or is_archive(self.place)
        document = read_single_file(self.place, label) if is_container else None
        if document is None:
            raise FieldError(_explain_foreign_file(self.place))
        return document


def parse_field_reference(where: str | Path | GeoShape) -> FieldReference:
    """The sample, file or shape that a name means; a "#" is part of the file name if such a file exists."""
    where = write_shape_text(where) if isinstance(where, GeoShape) else str(where)
    if is_shape_text(where) and not os.path.exists(where):
        return FieldReference(where, None, False, is_shape=True)
    if "#" not in where or os.path.exists(where):
        return FieldReference(where, None, where in list_sample_names())
    marks = [position for position, letter in enumerate(where) if letter == "#"]
    splits = [(where[:mark], where[mark + 1 :]) for mark in reversed(marks)]
    found = [split for split in splits if split[0] in list_sample_names() or os.path.exists(split[0])]
    place, key = (found or splits)[0]
    return FieldReference(place, key, place in list_sample_names())


def list_field_files(where: str) -> tuple[Path, ...]:
    """Every file that a field of this name may be read from, empty for samples and shapes; they need not exist.

    All files of a folder; for a Shapefile its parts with the same stem, for ISOXML the other XML files of its folder.
    """
    source = parse_field_reference(where)
    file = None if source.is_sample or source.is_shape else Path(source.place)
    if file is None:
        return ()
    if os.path.isdir(file):
        return tuple(file / name for name in ArchiveMembers(file))
    extension, files = file.suffix.lower(), [file]
    with suppress(OSError):
        if extension in shapefile.FIELD_FORMAT.extensions:
            files = [one for one in file.parent.iterdir() if one.stem.lower() == file.stem.lower() and one.is_file()]
        elif extension in isoxml.FIELD_FORMAT.extensions:
            files = [one for one in file.parent.iterdir() if one.suffix.lower() == extension and one.is_file()]
    return tuple(sorted({file, *files}))


def _explain_foreign_file(place: str) -> str:
    """The refusal of a file, folder or archive in an unsupported format."""
    names = ", ".join(one.name for one in FIELD_FORMATS[:-1]) + f" and {FIELD_FORMATS[-1].name}"
    if os.path.isdir(place) or is_archive(place):
        kind = "a folder" if os.path.isdir(place) else "an archive"
        return (
            f"{quote_path(place)} is {kind} without a field file such as TASKDATA.XML, Field.txt or a .shp; supported "
            f"are {names}, so name {kind} that contains one of these, or the file itself."
        )
    foreign = FOREIGN_EXTENSIONS.get(Path(place).suffix.lower(), "in an unknown format")
    return (
        f"{quote_path(place)} is {foreign}, but fields are read from {names}; name one of these, or convert it, "
        f"for instance with ogr2ogr -t_srs EPSG:4326 {Path(place).stem}.geojson {Path(place).name} or in QGIS."
    )


def _explain_missing_file(place: str) -> str:
    """The refusal of a name that is neither a sample nor a file; a single word may be a misspelt sample."""
    if os.path.lexists(place):
        return f"{quote_path(place)} is a symbolic link to a missing file; repair the link or name a file."
    if Path(place).suffix or os.path.basename(place) != place:
        return f"There is no field file {quote_path(place)}; check its name and its folder."
    names = list_sample_names()
    hint = suggest_name(place, names)
    return f"There is no field file {quote_path(place)}{hint}; name a field file or a sample: {', '.join(names)}."


def find_field_format(path: str) -> FieldFormat | None:
    """The format of a file, folder or archive, by its content or else its extension.

    None for a foreign format; the first of FIELD_FORMATS for an unknown extension whose content may be JSON.

    Raises FieldError where an archive cannot be opened, or not safely.
    """
    names, place = list_names(path), Path(path)
    extension = place.suffix.lower()
    field_format = next((form for form in FIELD_FORMATS if form.holds(names or frozenset({place.name.lower()}))), None)
    if field_format is None:
        field_format = next((form for form in FIELD_FORMATS if extension in form.extensions), None)
    is_foreign = names or extension in FOREIGN_EXTENSIONS or (path and (place.is_dir() or not _may_be_json(place)))
    return field_format or (None if is_foreign else FIELD_FORMATS[0])


def _may_be_json(place: Path) -> bool:
    """Whether a file begins as GeoJSON does; also one that is empty or cannot be read, which its reader says."""
    try:
        with place.open("rb") as file:
            begin = file.read(JSON_BEGIN_BYTES).removeprefix(codecs.BOM_UTF8).lstrip()
    except OSError:
        return True
    return begin[:1] in (b"", b"{", b"[")
