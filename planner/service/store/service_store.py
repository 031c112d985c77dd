"""The store of the service: its parts in one, with the tables of fleets, recordings of their tractors, and events."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from contextlib import closing
from typing import Any

import sqlalchemy as sa

from planner.service.errors import NotFoundError
from planner.service.settings import ServiceSettings
from planner.service.store.carried_bytes import ServedJobStore
from planner.service.store.database import describe_version, migrate_database
from planner.service.store.file_table import FileStore
from planner.service.store.store_part import check_name, format_utc_now_ms, is_storable_text
from planner.service.store.tables import EventRow, FleetRow, RecordingRow, TokenRow, WriteCheckRow
from planner.service.store.token_table import TokenStore

MOST_EVENTS = 1000


class Store(TokenStore, FileStore, ServedJobStore):
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
            session.merge(WriteCheckRow(id=1, time=format_utc_now_ms(), version=describe_version()))

    def save_fleet(self, id: str, name: str, plan_text: str, settings: Mapping[str, Any]) -> str:
        """Store a fleet, new or in place of an old one whose progress stays; returns when it was made."""
        name = check_name(name)
        with self.database.open_write_session() as session:
            existing = session.get(FleetRow, id)
            if existing is None:
                row = FleetRow(
                    id=id, name=name, plan=plan_text, settings=dict(settings), progress={}, created=format_utc_now_ms()
                )
                session.add(row)
                return row.created
            existing.name, existing.plan, existing.settings = name, plan_text, dict(settings)
            return existing.created

    def save_fleet_setting(self, id: str, key: str, value: Any) -> None:
        """Store one setting of a fleet; raises NotFoundError."""
        with self.database.open_write_session() as session:
            row = session.get(FleetRow, id)
            if row is None:
                raise _build_no_fleet_error(id)
            row.settings = {**row.settings, key: value}

    def list_fleets(self) -> list[FleetRow]:
        """All fleets, the oldest first."""
        with self.database.open_read_session() as session:
            return list(session.scalars(sa.select(FleetRow).order_by(FleetRow.created, FleetRow.id)))

    def get_fleet(self, id: str) -> FleetRow:
        """One fleet; raises NotFoundError."""
        with self.database.open_read_session() as session:
            row = session.get(FleetRow, id) if is_storable_text(id) else None
        if row is None:
            raise _build_no_fleet_error(id)
        return row

    def save_progress(self, id: str, progress: Mapping[str, Any]) -> None:
        """Store what a fleet needs to continue after a restart; raises NotFoundError."""
        with self.database.open_write_session() as session:
            done = session.execute(sa.update(FleetRow).where(FleetRow.id == id).values(progress=dict(progress)))
            if not done.rowcount:  # type: ignore[attr-defined]
                raise _build_no_fleet_error(id)

    def delete_fleet(self, id: str) -> None:
        """Delete a fleet, its recordings and its robots' tokens; its events stay. Raises NotFoundError."""
        with self.database.open_write_session() as session:
            session.execute(sa.delete(TokenRow).where(TokenRow.fleet == id))
            done = session.execute(sa.delete(FleetRow).where(FleetRow.id == id))
            if not done.rowcount:  # type: ignore[attr-defined]
                raise _build_no_fleet_error(id)

    def add_recording(self, fleet: str, tractor: int, rows: Sequence[Sequence[Any]]) -> None:
        """Store further reports of a tractor, some seconds at a time."""
        packed = zlib.compress(json.dumps(rows, separators=(",", ":")).encode())
        with self.database.open_write_session() as session:
            session.add(RecordingRow(fleet=fleet, tractor=tractor, rows=packed))

    def read_recording(self, fleet: str, tractor: int) -> list[list[Any]]:
        """All recorded rows of a tractor, in order."""
        query = sa.select(RecordingRow.rows).where(RecordingRow.fleet == fleet, RecordingRow.tractor == tractor)
        with self.database.open_read_session() as session:
            pieces = session.scalars(query.order_by(RecordingRow.id)).all()
        return [row for piece in pieces for row in json.loads(zlib.decompress(piece))]

    def list_recorded_tractors(self, fleet: str) -> list[int]:
        """The tractors of a fleet that have reported, counted from 0."""
        query = sa.select(RecordingRow.tractor).where(RecordingRow.fleet == fleet).distinct()
        with self.database.open_read_session() as session:
            return sorted(session.scalars(query))

    def add_event(self, fleet: str | None, who: str, what: str, data: Mapping[str, Any] | None = None) -> int:
        """Record who did what; returns the number of the event."""
        row = EventRow(time=format_utc_now_ms(), fleet=fleet, who=who[:120], what=what[:200], data=dict(data or {}))
        with self.database.open_write_session() as session:
            session.add(row)
        return row.id

    def list_events(self, since: int = 0, fleet: str | None = None, limit: int = MOST_EVENTS) -> list[EventRow]:
        """Events after a number, the oldest first, of one fleet or of all, at most `limit`."""
        query = sa.select(EventRow).where(EventRow.id > since)
        if fleet is not None and not is_storable_text(fleet):
            return []
        if fleet is not None:
            query = query.where(EventRow.fleet == fleet)
        with self.database.open_read_session() as session:
            return list(session.scalars(query.order_by(EventRow.id).limit(limit)))


def open_store(settings: ServiceSettings) -> closing[Store]:
    """A store that is closed at the end of a `with` statement."""
    return closing(Store(settings))


def _build_no_fleet_error(id: str) -> NotFoundError:
    return NotFoundError(f"There is no fleet {id[:60]!r}; the list shows all.", parameter="id")
