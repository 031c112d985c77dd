"""The table of uploaded files: fields, tractors, farms, logs, heights, tables of rain and of GNSS errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa

from fields.documents.sources import FIELD_FORMATS
from planner.service.errors import ConflictError, NotFoundError, ServiceError
from planner.service.store.store_part import StorePart, check_name, format_utc_now_ms, is_found, is_storable_text
from planner.service.store.tables import FileRow, Owner

SUFFIXES_BY_KIND = {
    "field": (*(end for form in FIELD_FORMATS if form.has_lone_files for end in form.extensions), ".zip"),
    "tractor": (".toml",),
    "farm": (".toml",),
    "log": (".csv",),
    "table": (".csv",),
    "elevation": (
        ".tif", ".tiff", ".asc", ".csv", ".txt", ".geojson", ".json", ".kml", ".kmz", ".gpx", ".zip", ".gpkg",
    ),
}  # fmt: skip
MEDIA_BY_SUFFIX = {
    ".geojson": "application/geo+json",
    ".json": "application/json",
    ".toml": "application/toml",
    ".csv": "text/csv; charset=utf-8",
    ".zip": "application/zip",
    ".kml": "application/vnd.google-earth.kml+xml",
    ".kmz": "application/vnd.google-earth.kmz",
    ".gpkg": "application/geopackage+sqlite3",
    ".gpx": "application/gpx+xml",
    ".xml": "application/xml",
    ".tif": "image/tiff",
    ".tiff": "image/tiff",
    ".asc": "text/plain; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".png": "image/png",
}
"""Of uploads and of results of jobs; all others are bytes."""
BYTES = "application/octet-stream"


def choose_article(kind: str) -> str:
    """The article of a kind of file: a field, an elevation."""
    return "an" if kind[:1] in "aeiou" else "a"


def check_suffix(kind: str, suffix: str) -> str:
    """The suffix of a file in lower case; raises ServiceError where its kind does not have it."""
    if suffix not in SUFFIXES_BY_KIND[kind]:
        raise ServiceError(
            f"{choose_article(kind).capitalize()} {kind} does not end in {suffix[:20]!r}; give a file that ends in "
            f"{' or '.join(SUFFIXES_BY_KIND[kind])}.",
            parameter="file",
        )
    return suffix


def build_other_content_error(kind: str, name: str) -> ConflictError:
    """The refusal of a file whose name another one has."""
    return ConflictError(
        f"There is {choose_article(kind)} {kind} {name!r} with other content; replace it or choose another name.",
        parameter="name",
    )


class FileStore(StorePart):
    """Uploaded files."""

    def add_file(
        self,
        kind: str,
        name: str,
        content: bytes,
        suffix: str = "",
        options: Mapping[str, Any] | None = None,
        owner: Owner | None = None,
    ) -> FileRow:
        """Store a file under its name, with the options for reading it.

        The same bytes again under the same name are read as is said now. Raises ServiceError for a name or ending that
        cannot be, ConflictError where other bytes have the name.
        """
        name, suffix = check_name(name), check_suffix(kind, suffix or SUFFIXES_BY_KIND[kind][0])
        values = self._put_content(content, suffix, options)
        row = FileRow(kind=kind, name=name, created=format_utc_now_ms(), **values)
        row.owner, row.owner_identity = owner or (None, None)
        try:
            with self.database.open_write_session() as session:
                session.add(row)
        except sa.exc.IntegrityError:
            existing = self.get_file(kind, name)
            if existing.sha256 != row.sha256:
                raise build_other_content_error(kind, name) from None
            if existing.options != row.options:
                with self.database.open_write_session() as session:
                    session.execute(sa.update(FileRow).where(FileRow.id == existing.id).values(options=row.options))
            return self.get_file(kind, name)
        return row

    def get_file(self, kind: str, name: str) -> FileRow:
        """The file of a kind and name; raises NotFoundError."""
        query = sa.select(FileRow).where(FileRow.kind == kind, FileRow.name == name)
        with self.database.open_read_session() as session:
            row = session.scalar(query) if is_storable_text(name) else None
        if row is None:
            raise NotFoundError(f"There is no {kind} {name[:60]!r}; the list shows all.", parameter=kind)
        return row

    def list_files(self, kind: str, search: str = "") -> list[FileRow]:
        """All files of a kind whose names have every word of the search, by name."""
        with self.database.open_read_session() as session:
            rows = session.scalars(sa.select(FileRow).where(FileRow.kind == kind).order_by(FileRow.name))
            return [row for row in rows if is_found(row.name, search)]

    def replace_file(
        self, kind: str, name: str, content: bytes, suffix: str, options: Mapping[str, Any] | None = None
    ) -> FileRow:
        """Give a file other bytes, ending and options; jobs keep what they were asked for with.

        Raises NotFoundError, ServiceError.
        """
        existing, suffix = self.get_file(kind, name), check_suffix(kind, suffix)
        return self._update_file(existing, self._put_content(content, suffix, options))

    def _put_content(self, content: bytes, suffix: str, options: Mapping[str, Any] | None) -> dict[str, Any]:
        """Store the bytes of a file; returns the columns that describe them."""
        values = {"suffix": suffix, "media": MEDIA_BY_SUFFIX.get(suffix, BYTES), "options": dict(options or {})}
        return values | {"sha256": self.blobs.put_bytes(content), "size": len(content)}

    def rename_file(self, kind: str, name: str, new_name: str) -> FileRow:
        """Give a file another name; raises NotFoundError, ServiceError, or ConflictError where the name is taken."""
        existing, new_name = self.get_file(kind, name), check_name(new_name)
        try:
            return self._update_file(existing, {"name": new_name})
        except sa.exc.IntegrityError:
            raise ConflictError(
                f"There is {choose_article(kind)} {kind} {new_name!r} already; choose another name.", parameter="name"
            ) from None

    def _update_file(self, row: FileRow, values: Mapping[str, Any]) -> FileRow:
        """Change columns of a file; raises NotFoundError where it was deleted meanwhile."""
        change = sa.update(FileRow).where(FileRow.id == row.id).values(**values, changed=format_utc_now_ms())
        with self.database.open_write_session() as session:
            session.execute(change)
        return self.get_file(row.kind, values.get("name", row.name))

    def delete_file(self, kind: str, name: str) -> None:
        """Delete a file; jobs that use it keep their copy. Raises NotFoundError."""
        existing = self.get_file(kind, name)
        with self.database.open_write_session() as session:
            session.execute(sa.delete(FileRow).where(FileRow.id == existing.id))
