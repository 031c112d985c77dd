"""The store of the service: its parts in one, with the tables of fleets, recordings of their tractors, and events."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Any

import sqlalchemy as sa

from fields.documents.sources import FIELD_FORMATS
from fields.formats.shapefile import PART_EXTENSIONS
from fields.terrain.point_files import POINT_SUFFIXES
from fields.terrain.rasters import RASTER_SUFFIXES
from planner.fleet.session.frame_timing import format_utc
from planner.service.errors import ConflictError, NotFoundError, ServiceError
from planner.service.settings import ServiceSettings
from planner.service.store.database import describe_version, migrate_database
from planner.service.store.job_queue import JobStore
from planner.service.store.store_part import StorePart, check_name, find_media, is_found, is_storable_text
from planner.service.store.tables import EventRow, FileRow, FleetRow, Owner, RecordingRow, TokenRow, WriteCheckRow
from planner.service.store.token_table import TokenStore

SUFFIXES_BY_KIND = {
    "field": (*(end for form in FIELD_FORMATS if form.has_lone_files for end in form.extensions), ".zip"),
    "tractor": (".toml",),
    "farm": (".toml",),
    "log": (".csv",),
    "table": (".csv",),
    # of a shapefile all files are needed: they come in a .zip
    "elevation": (*RASTER_SUFFIXES, *(end for end in POINT_SUFFIXES if end not in PART_EXTENSIONS)),
}
MOST_EVENTS = 1000


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


def build_taken_name_error(kind: str, name: str) -> ConflictError:
    """The refusal of a new name that another file has."""
    return ConflictError(
        f"There is {choose_article(kind)} {kind} {name!r} already; choose another name.", parameter="name"
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
        row = FileRow(kind=kind, name=name, created=format_utc(), **values)
        row.owner, row.owner_identity = owner or (None, None)
        try:
            with self.database.open_write_session() as session:
                session.add(row)
        except sa.exc.IntegrityError:
            existing = self.get_file(kind, name)
            if existing.sha256 != row.sha256:
                raise build_other_content_error(kind, name) from None
            if existing.options != row.options:
                self.database.change_rows(
                    sa.update(FileRow).where(FileRow.id == existing.id).values(options=row.options)
                )
            return self.get_file(kind, name)
        return row

    def get_file(self, kind: str, name: str) -> FileRow:
        """The file of a kind and name; raises NotFoundError."""
        query = sa.select(FileRow).where(FileRow.kind == kind, FileRow.name == name)
        row = self.database.find_row(query) if is_storable_text(name) else None
        if row is None:
            raise NotFoundError(f"There is no {kind} {name[:60]!r}; the list shows all.", parameter=kind)
        return row

    def list_files(self, kind: str, search: str = "") -> list[FileRow]:
        """All files of a kind whose names have every word of the search, by name."""
        rows = self.database.list_rows(sa.select(FileRow).where(FileRow.kind == kind).order_by(FileRow.name))
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
        values = {"suffix": suffix, "media": find_media(suffix), "options": dict(options or {})}
        return values | {"sha256": self.blobs.put_bytes(content), "size": len(content)}

    def rename_file(self, kind: str, name: str, new_name: str) -> FileRow:
        """Give a file another name; raises NotFoundError, ServiceError, or ConflictError where the name is taken."""
        existing, new_name = self.get_file(kind, name), check_name(new_name)
        try:
            return self._update_file(existing, {"name": new_name})
        except sa.exc.IntegrityError:
            raise build_taken_name_error(kind, new_name) from None

    def _update_file(self, row: FileRow, values: Mapping[str, Any]) -> FileRow:
        """Change columns of a file; raises NotFoundError where it was deleted meanwhile."""
        change = sa.update(FileRow).where(FileRow.id == row.id).values(**values, changed=format_utc())
        self.database.change_rows(change)
        return self.get_file(row.kind, values.get("name", row.name))

    def delete_file(self, kind: str, name: str) -> None:
        """Delete a file; jobs that use it keep their copy. Raises NotFoundError."""
        self.database.change_rows(sa.delete(FileRow).where(FileRow.id == self.get_file(kind, name).id))


class Store(TokenStore, FileStore, JobStore):
    """All stored data; every method may be called from any thread and any process.

    An older database is brought up to date. Raises DatabaseError where it cannot be reached, is newer than this
    software or belongs to another program.
    """

    def __init__(self, settings: ServiceSettings) -> None:
        super().__init__(settings)
        try:
            migrate_database(self.database.engine)
            self.database.keep_to_file()
        except BaseException:
            self.close()
            raise

    def check_write(self) -> None:
        """Write something. Raises SQLAlchemyError, StorageError where nothing can be written."""
        with self.database.open_write_session() as session:
            session.merge(WriteCheckRow(id=1, time=format_utc(), version=describe_version()))

    def save_fleet(self, id: str, name: str, plan_text: str, settings: Mapping[str, Any]) -> str:
        """Store a new fleet; returns when it was made."""
        row = FleetRow(id=id, name=check_name(name), plan=plan_text, settings=dict(settings), progress={})
        row.created = format_utc()
        with self.database.open_write_session() as session:
            session.add(row)
        return row.created

    def save_fleet_setting(self, id: str, key: str, value: Any) -> None:
        """Store one setting of a fleet; raises NotFoundError."""
        with self.database.open_write_session() as session:
            row = session.get(FleetRow, id)
            if row is None:
                raise _build_no_fleet_error(id)
            row.settings = {**row.settings, key: value}

    def list_fleets(self) -> list[FleetRow]:
        """All fleets, the oldest first."""
        return self.database.list_rows(sa.select(FleetRow).order_by(FleetRow.created, FleetRow.id))

    def get_fleet(self, id: str) -> FleetRow:
        """One fleet; raises NotFoundError."""
        query = sa.select(FleetRow).where(FleetRow.id == id)
        row = self.database.find_row(query) if is_storable_text(id) else None
        if row is None:
            raise _build_no_fleet_error(id)
        return row

    def save_progress(self, id: str, progress: Mapping[str, Any]) -> None:
        """Store what a fleet needs to continue after a restart; raises NotFoundError."""
        if not self.database.change_rows(sa.update(FleetRow).where(FleetRow.id == id).values(progress=dict(progress))):
            raise _build_no_fleet_error(id)

    def delete_fleet(self, id: str) -> None:
        """Delete a fleet, its recordings and its robots' tokens; its events stay. Raises NotFoundError."""
        with self.database.open_write_session() as session:
            session.execute(sa.delete(TokenRow).where(TokenRow.fleet == id))
            if not self.database.execute_change(session, sa.delete(FleetRow).where(FleetRow.id == id)):
                raise _build_no_fleet_error(id)

    def add_recording(self, fleet: str, tractor: int, rows: Sequence[Sequence[Any]]) -> None:
        """Store further reports of a tractor, some seconds at a time."""
        packed = zlib.compress(json.dumps(rows, separators=(",", ":")).encode())
        with self.database.open_write_session() as session:
            session.add(RecordingRow(fleet=fleet, tractor=tractor, rows=packed))

    def read_recording(self, fleet: str, tractor: int) -> list[list[Any]]:
        """All recorded rows of a tractor, in order."""
        query = sa.select(RecordingRow.rows).where(RecordingRow.fleet == fleet, RecordingRow.tractor == tractor)
        pieces = self.database.list_rows(query.order_by(RecordingRow.id))
        return [row for piece in pieces for row in json.loads(zlib.decompress(piece))]

    def list_recorded_tractors(self, fleet: str) -> list[int]:
        """The tractors of a fleet that have reported, counted from 0."""
        return sorted(
            self.database.list_rows(sa.select(RecordingRow.tractor).where(RecordingRow.fleet == fleet).distinct())
        )

    def add_event(self, fleet: str | None, who: str, what: str, data: Mapping[str, Any] | None = None) -> int:
        """Record who did what; returns the number of the event."""
        row = EventRow(time=format_utc(), fleet=fleet, who=who[:120], what=what[:200], data=dict(data or {}))
        with self.database.open_write_session() as session:
            session.add(row)
        return row.id

    def list_events(self, since: int = 0, fleet: str | None = None) -> list[EventRow]:
        """Events after a number, the oldest first, of one fleet or of all, at most `MOST_EVENTS`."""
        query = sa.select(EventRow).where(EventRow.id > since)
        if fleet is not None and not is_storable_text(fleet):
            return []
        if fleet is not None:
            query = query.where(EventRow.fleet == fleet)
        return self.database.list_rows(query.order_by(EventRow.id).limit(MOST_EVENTS))


def open_store(settings: ServiceSettings) -> closing[Store]:
    """A store that is closed at the end of a `with` statement."""
    return closing(Store(settings))


def _build_no_fleet_error(id: str) -> NotFoundError:
    return NotFoundError(f"There is no fleet {id[:60]!r}; the list shows all.", parameter="id")
