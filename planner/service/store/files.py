"""Files that were given to the service: fields, tractors, farms, logs, tables of rain and of GNSS errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import sqlalchemy as sa

from planner.service.errors import MissingError, ServiceError, TakenError
from planner.service.store.base import Part, checked_name, is_text, now
from planner.service.store.models import File

SUFFIXES = {
    "field": (".geojson", ".json", ".zip", ".kml", ".kmz", ".gpkg", ".fgb", ".gpx", ".xml"),
    "tractor": (".toml",),
    "farm": (".toml",),
    "log": (".csv",),
    "table": (".csv",),
}
MEDIA = {
    ".geojson": "application/geo+json", ".json": "application/json", ".toml": "application/toml",
    ".csv": "text/csv; charset=utf-8", ".zip": "application/zip", ".kml": "application/vnd.google-earth.kml+xml",
    ".kmz": "application/vnd.google-earth.kmz", ".gpkg": "application/geopackage+sqlite3",
    ".fgb": "application/octet-stream", ".gpx": "application/gpx+xml", ".xml": "application/xml",
}  # fmt: skip


def checked_suffix(kind: str, suffix: str) -> str:
    """The ending of a file of a kind; raises ServiceError for one of others."""
    if suffix not in SUFFIXES[kind]:
        raise ServiceError(
            f"A {kind} does not end in {suffix[:20]!r}; give a file that ends in {' or '.join(SUFFIXES[kind])}.",
            parameter="file",
        )
    return suffix


class Files(Part):
    """The files."""

    def add_file(
        self, kind: str, name: str, content: bytes, suffix: str = "", options: Mapping[str, Any] | None = None
    ) -> File:
        """Keep a file under a name of its own, with how it is to be read.

        The same bytes again under the same name are read as is said now. Raises ServiceError for a name or ending that
        cannot be, TakenError where other bytes have the name.
        """
        name, suffix = checked_name(name), checked_suffix(kind, suffix or SUFFIXES[kind][0])
        row = File(
            kind=kind, name=name, suffix=suffix, sha256=self.blobs.put(content), size=len(content), media=MEDIA[suffix],
            created=now(), options=dict(options or {}),
        )  # fmt: skip
        try:
            with self.database.writes() as session:
                session.add(row)
        except sa.exc.IntegrityError:
            there = self.file(kind, name)
            if there.sha256 != row.sha256:
                raise TakenError(
                    f"There is a {kind} {name!r} with other content; choose another name or delete it first.",
                    parameter="name",
                ) from None
            if there.options != row.options:
                with self.database.writes() as session:
                    session.execute(sa.update(File).where(File.id == there.id).values(options=row.options))
            return self.file(kind, name)
        return row

    def file(self, kind: str, name: str) -> File:
        """The file of a kind and name; raises MissingError."""
        wanted = sa.select(File).where(File.kind == kind, File.name == name)
        with self.database.reads() as session:
            row = session.scalar(wanted) if is_text(name) else None
        if row is None:
            raise MissingError(f"There is no {kind} {name[:60]!r}; the list shows all.", parameter=kind)
        return row

    def files(self, kind: str) -> list[File]:
        """All files of a kind by name."""
        with self.database.reads() as session:
            return list(session.scalars(sa.select(File).where(File.kind == kind).order_by(File.name)))

    def delete_file(self, kind: str, name: str) -> None:
        """Take a file off the list; jobs that were asked for with it still have it. Raises MissingError."""
        there = self.file(kind, name)
        with self.database.writes() as session:
            session.execute(sa.delete(File).where(File.id == there.id))
