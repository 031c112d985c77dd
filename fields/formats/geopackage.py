"""GeoPackage (OGC 12-128) and FlatGeobuf: one file that names its coordinate system.

A GeoPackage is an SQLite database, and an untrusted database can run code: views and computed columns run SQL when they
are read, virtual tables call extensions. Field files need none of these, so SQLite checks the schema, without running
any of it, before GDAL opens the file.
"""

from __future__ import annotations

import os
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from fields.errors import FieldError
from fields.formats.features import replace_unprintable
from fields.formats.gdal import FLATGEOBUF_DRIVER, GEOPACKAGE_DRIVER, build_layer_document, read_layers
from fields.raw_document import FieldDocument, FieldFormat
from fields.text_files import MAX_BYTES, read_bytes, read_start

FORMAT_NAME = "a GeoPackage or FlatGeobuf"
GEOPACKAGE_SUFFIX = ".gpkg"
SQLITE_MAGIC, FLATGEOBUF_MAGIC = b"SQLite format 3\0", b"fgb\x03fgb"
"""First bytes of the two formats."""
JOURNAL_BYTES = slice(18, 20)  # of the header: 2, 2 for a write-ahead log, which in-memory databases cannot have
NO_WRITE_AHEAD_LOG = b"\x01\x01"
INDEX_SQL = re.compile(r"\s*CREATE\s+VIRTUAL\s+TABLE\s+\S.*\sUSING\s+rtree\s*\(", re.IGNORECASE | re.DOTALL)
COMPUTED_COLUMN_KINDS = (2, 3)  # values of `hidden` in pragma_table_xinfo
MAX_TABLES = 10_000


def _read_geopackage(path: str, label: str) -> FieldDocument:
    is_database = read_start(path, len(SQLITE_MAGIC), "a GeoPackage", FieldError) == SQLITE_MAGIC
    if not is_database or (os.path.getsize(path) <= MAX_BYTES and not _has_pending_journal(path)):
        return parse_geopackage(read_bytes(path, "a GeoPackage", FieldError), label)
    with _convert_sqlite_errors(label), closing(_open_database(Path(path))) as database:
        _refuse_active_content(database, label)
    return _read_gdal_document(Path(path), label, GEOPACKAGE_DRIVER)


def parse_geopackage(content: bytes, label: str) -> FieldDocument:
    """Parse a GeoPackage or FlatGeobuf, recognised by its first bytes; raises FieldError."""
    if content.startswith(FLATGEOBUF_MAGIC):
        return _read_gdal_document(content, label, FLATGEOBUF_DRIVER)
    if not content.startswith(SQLITE_MAGIC):
        raise FieldError(
            f"{label} cannot be read as {FORMAT_NAME} (its first bytes are wrong); save it again as {FORMAT_NAME}."
        )
    content = content[: JOURNAL_BYTES.start] + NO_WRITE_AHEAD_LOG + content[JOURNAL_BYTES.stop :]
    with _convert_sqlite_errors(label), closing(sqlite3.connect(":memory:")) as database:
        database.deserialize(content)
        _refuse_active_content(database, label)
    return _read_gdal_document(content, label, GEOPACKAGE_DRIVER)


def _read_gdal_document(source: Path | bytes, label: str, driver: str) -> FieldDocument:
    return build_layer_document(read_layers(source, label, FORMAT_NAME, (driver,)), label, "GeoPackage")


def _has_pending_journal(path: str) -> bool:
    """Whether recent changes are still in a journal beside the file, as while another program has it open."""
    return any(os.path.exists(path + ending) and os.path.getsize(path + ending) for ending in ("-wal", "-journal"))


def _open_database(path: Path) -> sqlite3.Connection:
    # a database at rest is opened without files beside it, which a folder for reading only could not hold
    rest = "" if _has_pending_journal(str(path)) else "&immutable=1"
    return sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro{rest}", uri=True)


def list_package_contents(path: str, label: str) -> dict[str, str]:
    """The tables of a GeoPackage that hold data, by name, with their kind: "features", "tiles", "2d-gridded-coverage".

    Raises FieldError where there is no such file, it is no GeoPackage, or it holds more than plain tables.
    """
    if read_start(path, len(SQLITE_MAGIC), "a GeoPackage", FieldError) != SQLITE_MAGIC:
        raise FieldError(f"{label} is not a GeoPackage (its first bytes are wrong); save it again as one.")
    with _convert_sqlite_errors(label), closing(_open_database(Path(path))) as database:
        _refuse_active_content(database, label)
        rows = database.execute("SELECT table_name, data_type FROM gpkg_contents").fetchall()
    return {str(name): str(kind) for name, kind in rows}


@contextmanager
def _convert_sqlite_errors(label: str) -> Iterator[None]:
    """Convert errors of SQLite to FieldError."""
    try:
        yield
    except (sqlite3.Error, ValueError, OverflowError) as error:
        reason = str(error).splitlines()[0][:120] if str(error) else type(error).__name__
        raise FieldError(
            f"{label} cannot be read as {FORMAT_NAME} ({reason}); save it again as {FORMAT_NAME}."
        ) from None


def _refuse_active_content(database: sqlite3.Connection, label: str) -> None:
    """Raise FieldError for a database with more than plain tables and spatial indexes.

    Triggers are allowed: every GeoPackage has some, and they run on writing only.
    """
    database.execute("PRAGMA trusted_schema = OFF")
    database.execute("PRAGMA cell_size_check = ON")
    rows = database.execute(f"SELECT type, name, sql FROM sqlite_master LIMIT {MAX_TABLES + 1}").fetchall()
    if len(rows) > MAX_TABLES:
        raise FieldError(f"{label} has more than {MAX_TABLES} tables; extract those of the farm first.")
    for kind, name, sql in rows:
        shown_name = replace_unprintable(str(name)[:40])
        virtual = kind == "table" and not re.match(r"\s*CREATE\s+TABLE\b", str(sql), re.IGNORECASE)
        if kind == "view" or (virtual and not INDEX_SQL.match(str(sql))):
            kind_name = "view" if kind == "view" else "virtual table"
            raise FieldError(_explain_active_content(label, f"the {kind_name} '{shown_name}'"))
        if kind != "table" or virtual:
            continue
        columns = database.execute("SELECT hidden FROM pragma_table_xinfo(?)", (str(name),))
        if any(hidden in COMPUTED_COLUMN_KINDS for (hidden,) in columns):
            raise FieldError(_explain_active_content(label, f"a computed column in '{shown_name}'"))


def _explain_active_content(label: str, reason: str) -> str:
    return f"{label} contains {reason}, which runs SQL when it is read; export its fields as a plain table."


FIELD_FORMAT = FieldFormat("GeoPackage", (GEOPACKAGE_SUFFIX, ".fgb"), _read_geopackage, parse=parse_geopackage)
