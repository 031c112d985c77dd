"""The tables: tokens, files, jobs with their results, fleets, recordings, events and checks of writing.

Times are texts in UTC, "2026-05-01T06:10:00.123Z", which order as they follow each other; a lease is in seconds since
1970. `sha256` names bytes in the folder (planner.service.store.disk_storage); in here are only those that are under way
to a worker on another machine or back.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from sqlalchemy import JSON, Float, ForeignKey, Index, Integer, LargeBinary, String, Text, UniqueConstraint, text
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column, relationship

NAMING_CONVENTION = {
    "ix": "ix_%(column_0_label)s",
    "uq": "uq_%(table_name)s_%(column_0_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s_%(referred_table_name)s",
    "pk": "pk_%(table_name)s",
}
SHA256_TYPE, NAME_TYPE, IDENTITY_TYPE = String(64), String(120), String(32)


class Owner(NamedTuple):
    """The token that something belongs to: its name, for people, and its identity, which no later token has."""

    name: str
    identity: str


class TableBase(DeclarativeBase):
    """All tables."""


TableBase.metadata.naming_convention = NAMING_CONVENTION


class TokenRow(TableBase):
    """A token and its rights; only its SHA-256 is stored.

    `identity` is drawn at random and no other token's, ever; a name may be used again. `scopes` are separated by
    spaces. A robot's token is bound to one `tractor`, counted from 1, of one `fleet`. One that `expires` is worth
    nothing from then on.
    """

    __tablename__ = "tokens"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    name: Mapped[str] = mapped_column(NAME_TYPE, unique=True)
    identity: Mapped[str] = mapped_column(IDENTITY_TYPE, unique=True)
    scopes: Mapped[str] = mapped_column(String(80))
    sha256: Mapped[str] = mapped_column(SHA256_TYPE, unique=True)
    created: Mapped[str] = mapped_column(String(32))
    fleet: Mapped[str | None] = mapped_column(String(32), default=None)
    tractor: Mapped[int | None] = mapped_column(Integer, default=None)
    expires: Mapped[str | None] = mapped_column(String(32), default=None)


class FileRow(TableBase):
    """An uploaded file: a field, tractor, farm, log, or table of rain or of GNSS errors.

    `options` say how it is read where the file does not: `crs`, `swap_axes` and `local` of a field. `owner` is the name
    of the token that added it, None for files of before there were owners, and `owner_identity` its identity, None
    where that token is gone since before there were identities.
    """

    __tablename__ = "files"
    __table_args__ = (UniqueConstraint("kind", "name"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    kind: Mapped[str] = mapped_column(String(16))
    name: Mapped[str] = mapped_column(NAME_TYPE)
    suffix: Mapped[str] = mapped_column(String(16))
    sha256: Mapped[str] = mapped_column(SHA256_TYPE)
    size: Mapped[int] = mapped_column(Integer)
    media: Mapped[str] = mapped_column(String(80))
    created: Mapped[str] = mapped_column(String(32))
    options: Mapped[dict[str, Any]] = mapped_column(JSON, default=dict, server_default=text("'{}'"))
    owner: Mapped[str | None] = mapped_column(NAME_TYPE, default=None)
    owner_identity: Mapped[str | None] = mapped_column(IDENTITY_TYPE, default=None)
    changed: Mapped[str | None] = mapped_column(String(32), default=None)


class JobRow(TableBase):
    """A job: queued, running, done, failed or cancelled.

    `request` is what was asked for, `work` the same as it is worked on, and `inputs` are the files it reads, as they
    were when it was asked for: place in its folder, to SHA-256. While it runs `worker` is who does it, until `lease`;
    `tries` counts how often it was begun. `owner` and `owner_identity` are of the token that asked for it, as of files.
    """

    __tablename__ = "jobs"
    __table_args__ = (Index("ix_jobs_status_tries_number", "status", "tries", "number"),)
    number: Mapped[int] = mapped_column(Integer, primary_key=True)
    id: Mapped[str] = mapped_column(String(32), unique=True)
    kind: Mapped[str] = mapped_column(String(16))
    name: Mapped[str] = mapped_column(NAME_TYPE)
    status: Mapped[str] = mapped_column(String(16))
    request: Mapped[dict[str, Any]] = mapped_column(JSON)
    work: Mapped[dict[str, Any]] = mapped_column(JSON)
    inputs: Mapped[dict[str, str]] = mapped_column(JSON)
    done: Mapped[int] = mapped_column(Integer, default=0)
    all: Mapped[int] = mapped_column(Integer, default=0)
    words: Mapped[str] = mapped_column(String(200), default="")
    error: Mapped[str | None] = mapped_column(Text, default=None)
    created: Mapped[str] = mapped_column(String(32))
    finished: Mapped[str | None] = mapped_column(String(32), default=None)
    worker: Mapped[str | None] = mapped_column(String(80), default=None)
    lease: Mapped[float | None] = mapped_column(Float, default=None)
    tries: Mapped[int] = mapped_column(Integer, default=0)
    owner: Mapped[str | None] = mapped_column(NAME_TYPE, default=None)
    owner_identity: Mapped[str | None] = mapped_column(IDENTITY_TYPE, default=None)
    results: Mapped[list[ResultRow]] = relationship(
        cascade="all, delete-orphan", passive_deletes=True, order_by="ResultRow.name", lazy="selectin"
    )


class ResultRow(TableBase):
    """One result of a job."""

    __tablename__ = "results"
    __table_args__ = (UniqueConstraint("job", "name"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"))
    name: Mapped[str] = mapped_column(NAME_TYPE)
    sha256: Mapped[str] = mapped_column(SHA256_TYPE)
    size: Mapped[int] = mapped_column(Integer)
    media: Mapped[str] = mapped_column(String(80))


class FleetRow(TableBase):
    """A fleet with its plan; `progress` is what must survive a restart."""

    __tablename__ = "fleets"
    id: Mapped[str] = mapped_column(String(32), primary_key=True)
    name: Mapped[str] = mapped_column(NAME_TYPE)
    plan: Mapped[str] = mapped_column(Text)
    settings: Mapped[dict[str, Any]] = mapped_column(JSON)
    progress: Mapped[dict[str, Any]] = mapped_column(JSON)
    created: Mapped[str] = mapped_column(String(32))


class RecordingRow(TableBase):
    """A part of the reports of a tractor, in order."""

    __tablename__ = "recordings"
    __table_args__ = (Index("ix_recordings_fleet_tractor", "fleet", "tractor"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    fleet: Mapped[str] = mapped_column(ForeignKey("fleets.id", ondelete="CASCADE"))
    tractor: Mapped[int] = mapped_column(Integer)
    rows: Mapped[bytes] = mapped_column(LargeBinary)


class EventRow(TableBase):
    """Who did what, and when; it stays when the fleet is deleted."""

    __tablename__ = "events"
    __table_args__ = (Index("ix_events_fleet_id", "fleet", "id"),)
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    time: Mapped[str] = mapped_column(String(32))
    fleet: Mapped[str | None] = mapped_column(String(32), default=None)
    who: Mapped[str] = mapped_column(NAME_TYPE)
    what: Mapped[str] = mapped_column(String(200))
    data: Mapped[dict[str, Any]] = mapped_column(JSON)


class JobBytesRow(TableBase):
    """Bytes of an input of an unfinished job, or of a result that the service has not fetched yet (PostgreSQL only).

    Of a result in a store there are no bytes here but its `address`.
    """

    __tablename__ = "job_bytes"
    sha256: Mapped[str] = mapped_column(SHA256_TYPE, primary_key=True)
    job: Mapped[int] = mapped_column(ForeignKey("jobs.number", ondelete="CASCADE"), primary_key=True)
    content: Mapped[bytes] = mapped_column(LargeBinary)
    address: Mapped[str | None] = mapped_column(Text, default=None)


class TurnRow(TableBase):
    """When the last job of an owner was begun, counted in jobs; "" owns what belongs to nobody."""

    __tablename__ = "turns"
    owner_identity: Mapped[str] = mapped_column(IDENTITY_TYPE, primary_key=True)
    turn: Mapped[int] = mapped_column(Integer)


class WriteCheckRow(TableBase):
    """The one row that the service writes to see whether a write goes through, with its version."""

    __tablename__ = "write_checks"
    id: Mapped[int] = mapped_column(Integer, primary_key=True)
    time: Mapped[str] = mapped_column(String(32))
    version: Mapped[str | None] = mapped_column(String(80), default=None)


_UNCOPIED_TABLES = (JobBytesRow.__table__, TurnRow.__table__, WriteCheckRow.__table__)
COPIED_TABLES = tuple(table for table in TableBase.metadata.sorted_tables if table not in _UNCOPIED_TABLES)
"""What a backup holds, in an order in which rows can be added."""
