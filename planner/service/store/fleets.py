"""Fleets that are driven, what their tractors reported, and who did what."""

from __future__ import annotations

import json
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import sqlalchemy as sa

from planner.service.errors import MissingError
from planner.service.store.base import Part, checked_name, is_text, now
from planner.service.store.models import Event, Fleet, Recording

MOST_EVENTS = 1000


class Fleets(Part):
    """Fleets, recordings and events."""

    def save_fleet(self, id: str, name: str, plan_text: str, settings: Mapping[str, Any]) -> None:
        """Keep a fleet with its plan; one that is there takes the new ones and keeps its progress."""
        name = checked_name(name)
        with self.database.writes() as session:
            there = session.get(Fleet, id)
            if there is None:
                row = Fleet(id=id, name=name, plan=plan_text, settings=dict(settings), progress={}, created=now())
                session.add(row)
            else:
                there.name, there.plan, there.settings = name, plan_text, dict(settings)

    def fleets(self) -> list[Fleet]:
        """All fleets, the oldest first."""
        with self.database.reads() as session:
            return list(session.scalars(sa.select(Fleet).order_by(Fleet.created, Fleet.id)))

    def fleet(self, id: str) -> Fleet:
        """One fleet; raises MissingError."""
        with self.database.reads() as session:
            row = session.get(Fleet, id) if is_text(id) else None
        if row is None:
            raise MissingError(f"There is no fleet {id[:60]!r}; the list shows all.", parameter="id")
        return row

    def save_progress(self, id: str, progress: Mapping[str, Any]) -> None:
        """Keep what a fleet needs to go on after a restart; raises MissingError."""
        with self.database.writes() as session:
            done = session.execute(sa.update(Fleet).where(Fleet.id == id).values(progress=dict(progress)))
            if not done.rowcount:  # type: ignore[attr-defined]
                raise MissingError(f"There is no fleet {id[:60]!r}; the list shows all.", parameter="id")

    def delete_fleet(self, id: str) -> None:
        """Forget a fleet and its recording; its events stay. Raises MissingError."""
        with self.database.writes() as session:
            done = session.execute(sa.delete(Fleet).where(Fleet.id == id))
            if not done.rowcount:  # type: ignore[attr-defined]
                raise MissingError(f"There is no fleet {id[:60]!r}; the list shows all.", parameter="id")

    def add_recording(self, fleet: str, tractor: int, rows: Sequence[Sequence[Any]]) -> None:
        """Keep more rows of what a tractor reported; some seconds of them at a time."""
        packed = zlib.compress(json.dumps(rows, separators=(",", ":")).encode())
        with self.database.writes() as session:
            session.add(Recording(fleet=fleet, tractor=tractor, rows=packed))

    def recording(self, fleet: str, tractor: int) -> list[list[Any]]:
        """All rows of a tractor in the order in which they came."""
        wanted = sa.select(Recording.rows).where(Recording.fleet == fleet, Recording.tractor == tractor)
        with self.database.reads() as session:
            pieces = session.scalars(wanted.order_by(Recording.id)).all()
        return [row for piece in pieces for row in json.loads(zlib.decompress(piece))]

    def add_event(self, fleet: str | None, who: str, what: str, data: Mapping[str, Any] | None = None) -> int:
        """Write down who did what; the number of the event."""
        row = Event(time=now(), fleet=fleet, who=who[:120], what=what[:200], data=dict(data or {}))
        with self.database.writes() as session:
            session.add(row)
        return row.id

    def events(self, since: int = 0, fleet: str | None = None, most: int = MOST_EVENTS) -> list[Event]:
        """Events after a number, the oldest first: of one fleet or of all, the first so many."""
        wanted = sa.select(Event).where(Event.id > since)
        if fleet is not None and not is_text(fleet):
            return []
        if fleet is not None:
            wanted = wanted.where(Event.fleet == fleet)
        with self.database.reads() as session:
            return list(session.scalars(wanted.order_by(Event.id).limit(most)))
