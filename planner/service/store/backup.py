"""Backups, made while the service runs and restored completely or not at all, and the deletion of unused bytes.

A backup has a manifest of sizes and SHA-256; it is restored into SQLite or PostgreSQL.
"""

from __future__ import annotations

import hashlib
import json
import re
import secrets
import sqlite3
import tempfile
import time
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import sqlalchemy as sa
from pydantic import BaseModel, Field, ValidationError, field_validator
from sqlalchemy.orm import Session

from fields.units import HOUR_S
from planner.fleet.session.frame_timing import format_utc
from planner.request.validation import describe_fault, format_location
from planner.service.errors import ConflictError, NotFoundError, ServiceError, StorageError
from planner.service.settings import DATABASE_FILE, LIMITS, MEGABYTE_BYTES, find_version
from planner.service.store.database import (
    SELECT_VERSION,
    Database,
    get_current_version,
    lift_timeouts,
    migrate_database,
    shorten_error,
)
from planner.service.store.disk_storage import SHA256_TEXT, is_disk_full, translate_disk_full
from planner.service.store.service_store import Store
from planner.service.store.store_part import BYTES_FOLDER
from planner.service.store.tables import COPIED_TABLES, FileRow, FleetRow, JobRow, ResultRow, TokenRow

MANIFEST_FILE = "manifest.json"
BYTES_NAME = re.compile(rf"{BYTES_FOLDER}/([0-9a-f]{{2}})/(\1[0-9a-f]{{62}})")
COPY_BATCH_ROWS = 500
SWEEP_MIN_AGE_S = HOUR_S
"""Newer bytes may belong to a row that is being written."""
SET_SEQUENCE = "SELECT setval(pg_get_serial_sequence('{table}', '{column}'), (SELECT max({column}) FROM {table}))"
COMPRESSION_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
SELECT_STRANGE_OBJECTS = "SELECT type || ' ' || name FROM sqlite_master WHERE type NOT IN ('table', 'index')"
USE_ANOTHER_BACKUP = "use another backup"


class ManifestEntry(BaseModel):
    """One file of a backup."""

    size: Annotated[int, Field(ge=0, strict=True)]
    sha256: Annotated[str, Field(pattern=f"^{SHA256_TEXT.pattern}$")]


class BackupManifest(BaseModel):
    """The files of a backup by name, and the version (`migration`) of its tables."""

    form: Literal[1]
    migration: str
    headland: str
    made: str
    files: dict[str, ManifestEntry]

    @field_validator("files")
    @classmethod
    def _check_names(cls, files: dict[str, ManifestEntry]) -> dict[str, ManifestEntry]:
        """Bytes are named by their SHA-256, so that no name is a path elsewhere."""
        for name, entry in files.items():
            match = BYTES_NAME.fullmatch(name)
            if match is not None and match[2] != entry.sha256:
                raise ValueError(f"it gives no SHA-256 of {name}")
            if match is None and name != DATABASE_FILE:
                raise ValueError(f"it names {name[:60]!r}, which is no part of a backup")
        if DATABASE_FILE not in files:
            raise ValueError(f"it names no {DATABASE_FILE}")
        return files


def parse_manifest(text: bytes) -> BackupManifest:
    """Read a manifest; raises ValueError with the reason where it cannot be used."""
    try:
        return BackupManifest.model_validate_json(text)
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        raise ValueError(describe_fault(fault, format_location(fault["loc"]) or "it").rstrip(".")) from None


def back_up(store: Store, file: Path) -> int:
    """Write a zip file with the database and all bytes it names; returns the number of files of bytes.

    The file is complete or not there at all. Unpacked, it is a folder for `--data` with an SQLite database. Raises
    ServiceError where bytes are missing or damaged, StorageError where there is no room.
    """
    draft = file.with_name(f".headland-{secrets.token_hex(4)}")
    try:
        with translate_disk_full(), tempfile.TemporaryDirectory() as folder:
            copy = Path(folder) / DATABASE_FILE
            names = _copy_database(store, copy)
            with zipfile.ZipFile(draft, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
                _pack_archive(store, archive, copy, names)
            draft.replace(file)
    finally:
        draft.unlink(missing_ok=True)
    return len(names)


def _pack_archive(store: Store, archive: zipfile.ZipFile, copy: Path, names: list[str]) -> None:
    """Add the database, the bytes and then the manifest to an archive; raises ServiceError."""
    files = {DATABASE_FILE: _add_to_archive(archive, copy, DATABASE_FILE)}
    for sha256 in names:
        name = format_bytes_name(sha256)
        try:
            path = store.blobs.get_path(sha256)
            if not path.exists():  # a result that the service has not fetched yet
                store.blobs.put_bytes(store.blobs.read_bytes(sha256))
            files[name] = _add_to_archive(archive, path, name)
        except (FileNotFoundError, NotFoundError):
            raise _describe_missing_bytes(store, sha256, "gone") from None
        if files[name].sha256 != sha256:
            raise _describe_missing_bytes(store, sha256, "damaged")
    manifest = BackupManifest(
        form=1, migration=get_current_version(), headland=find_version(), made=format_utc(), files=files
    )
    archive.writestr(MANIFEST_FILE, json.dumps(manifest.model_dump(), indent=1, sort_keys=True))


def _add_to_archive(archive: zipfile.ZipFile, path: Path, name: str) -> ManifestEntry:
    """Add a file to an archive; returns its size and SHA-256."""
    digest, size = hashlib.sha256(), 0
    with open(path, "rb") as source, archive.open(name, "w", force_zip64=True) as target:
        while part := source.read(MEGABYTE_BYTES):
            digest.update(part)
            size += len(part)
            target.write(part)
    return ManifestEntry(size=size, sha256=digest.hexdigest())


def _describe_missing_bytes(store: Store, sha256: str, condition: str) -> ServiceError:
    """The refusal of a backup for missing or damaged bytes."""
    with store.database.open_read_session() as session:
        file = session.scalar(sa.select(FileRow).where(FileRow.sha256 == sha256))
        of_result = (
            sa.select(JobRow.id).join(ResultRow, ResultRow.job == JobRow.number).where(ResultRow.sha256 == sha256)
        )
        job = session.scalar(of_result)
    user = f"the {file.kind} {file.name!r}" if file is not None else f"the job {job}" if job else "a job or a fleet"
    return ServiceError(
        f"The bytes {sha256[:12]} of {user} are {condition} in the folder of the service, so a backup would not be "
        f"whole; delete {user} or bring the bytes back."
    )


def sweep_unnamed_bytes(store: Store) -> int:
    """Delete bytes that no file, result or job names; returns their number."""
    limit, deleted_count = time.time() - SWEEP_MIN_AGE_S, 0
    old = [path for path in store.blobs.list_paths() if path.stat().st_mtime < limit]
    with store.database.open_read_session() as session:
        named = set(list_named_bytes(session.connection()))
    for path in old:
        if path.name not in named:
            with suppress(OSError):
                path.unlink()
                deleted_count += 1
    return deleted_count


def _copy_database(store: Store, copy: Path) -> list[str]:
    """Copy every row, as of one moment, into a new SQLite database; returns the SHA-256 they name, each once."""
    target = Database(f"sqlite:///{copy}")
    migrate_database(target.engine)
    waiting = set(store.revocations.list_waiting())  # listed before too: one that is written meanwhile waits no more
    snapshot = store.database.engine.connect()
    if snapshot.dialect.name == "postgresql":
        snapshot = snapshot.execution_options(isolation_level="REPEATABLE READ")
    with snapshot as source, target.open_write_session() as session:
        for table in COPIED_TABLES:
            copy_rows(table, source, session)
        waiting |= set(store.revocations.list_waiting())
        session.execute(sa.delete(TokenRow).where(TokenRow.sha256.in_(waiting)))
        names = sorted(set(list_named_bytes(source)))
    with target.engine.connect() as connection:
        connection.exec_driver_sql("COMMIT")
        connection.exec_driver_sql("PRAGMA journal_mode=DELETE")
        connection.exec_driver_sql("BEGIN")
    target.close()
    return names


def copy_rows(table: sa.Table, source: sa.Connection, session: Session) -> None:
    """Copy all rows of a table into another database, some at a time."""
    rows = source.execution_options(yield_per=COPY_BATCH_ROWS).execute(sa.select(table)).mappings()
    for part in rows.partitions(COPY_BATCH_ROWS):
        session.execute(sa.insert(table), [dict(row) for row in part])


def format_bytes_name(sha256: str) -> str:
    """The name of bytes in a backup, as they lie in the folder of the service."""
    return f"{BYTES_FOLDER}/{sha256[:2]}/{sha256}"


def list_named_bytes(connection: sa.Connection) -> list[str]:
    """The SHA-256 of all bytes that rows name."""
    names = list(connection.scalars(sa.union_all(sa.select(FileRow.sha256), sa.select(ResultRow.sha256))))
    for inputs in connection.scalars(sa.select(JobRow.inputs)):
        names += inputs.values()
    for settings in connection.scalars(sa.select(FleetRow.settings)):
        names += [sha256 for _, sha256 in settings.get("files", {}).values()]
    return names


def restore_backup(store: Store, file: Path) -> int:
    """Put a backup into an empty store; returns the number of files of bytes.

    All of it is checked before anything is written: parts and hashes by its manifest, the database by SQLite itself.
    Raises ServiceError for a file that is not a complete backup, NotFoundError without a file, ConflictError for a
    store that is not empty, DatabaseError for a backup of a newer Headland, StorageError where there is no room.
    """
    with store.database.open_read_session() as session:
        for table in COPIED_TABLES:
            if session.execute(sa.select(sa.literal(1)).select_from(table).limit(1)).first() is not None:
                raise ConflictError(
                    f"The database has {table.name} already, and nothing is written over; give another --data or "
                    "--database.",
                    parameter="data",
                )
    data = store.settings.data
    try:
        with zipfile.ZipFile(file) as archive, tempfile.TemporaryDirectory(dir=data, prefix=".restore-") as folder:
            backup = _OpenBackup(file, archive, _read_checked_manifest(archive, file))
            store.blobs.check_disk_space(sum(entry.size for entry in backup.manifest.files.values()))
            copy = Path(folder) / DATABASE_FILE
            with open(copy, "wb") as stream:
                backup.read_part(DATABASE_FILE, stream.write)
            for name in backup.list_bytes():
                backup.read_part(name, len)
            _check_sqlite_file(copy, file)
            return _restore_checked(store, backup, copy)
    except FileNotFoundError:
        raise NotFoundError(f"There is no file {file}; give the name of a backup.", parameter="file") from None
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        if is_disk_full(error, data):
            raise StorageError(f"No room is left in {data} to bring {file} back; make some.") from None
        raise ServiceError(f"{file} cannot be read as a backup: {error}.".replace("..", ".")) from None


@dataclass(frozen=True)
class _OpenBackup:
    """A backup whose manifest is checked."""

    file: Path
    archive: zipfile.ZipFile
    manifest: BackupManifest

    def list_bytes(self) -> list[str]:
        """The names of all parts but the database."""
        return [name for name in self.manifest.files if name != DATABASE_FILE]

    def read_part(self, name: str, consume: Callable[[bytes], object]) -> None:
        """Hand on the bytes of a part, at most as many as the manifest names; raises ServiceError for others."""
        entry, digest, size = self.manifest.files[name], hashlib.sha256(), 0
        with self.archive.open(name) as source:
            while part := source.read(min(MEGABYTE_BYTES, entry.size - size + 1)):
                size += len(part)
                if size > entry.size:
                    break
                digest.update(part)
                consume(part)
        if size != entry.size or digest.hexdigest() != entry.sha256:
            raise _build_refusal(self.file, f"damaged: its part {name} has other bytes")


def _build_refusal(file: Path, fault: str) -> ServiceError:
    return ServiceError(f"{file} is {fault}; {USE_ANOTHER_BACKUP}.")


def _read_checked_manifest(archive: zipfile.ZipFile, file: Path) -> BackupManifest:
    """The manifest of an archive with exactly the parts that it names; raises ServiceError."""
    parts = {info.filename: info for info in archive.infolist()}
    if DATABASE_FILE not in parts and MANIFEST_FILE not in parts:
        raise ServiceError(
            f"{file} is no backup of Headland: it has no {DATABASE_FILE}; give one that headland backup made."
        )
    if MANIFEST_FILE not in parts:
        raise ServiceError(
            f"{file} has no {MANIFEST_FILE}, so nothing tells whether it is whole; unpack it into an empty folder, "
            "begin headland serve --data with that, and make a new backup of it."
        )
    duplicate = next((name for name, times in Counter(archive.namelist()).items() if times > 1), None)
    if duplicate is not None:
        raise _build_refusal(file, f"damaged: it has the part {duplicate[:60]!r} twice")
    odd = next((info for info in parts.values() if info.compress_type not in COMPRESSION_METHODS), None)
    if odd is not None:
        raise _build_refusal(file, f"no backup of Headland: {odd.filename[:60]!r} is packed another way")
    if parts[MANIFEST_FILE].file_size > LIMITS.most_manifest_bytes:
        raise _build_refusal(file, f"damaged: its {MANIFEST_FILE} has {parts[MANIFEST_FILE].file_size} bytes")
    try:
        manifest = parse_manifest(archive.read(MANIFEST_FILE))
    except ValueError as error:
        why = shorten_error(error, 120)
        raise _build_refusal(file, f"damaged: its {MANIFEST_FILE} cannot be used, {why}") from None
    present, named = set(parts) - {MANIFEST_FILE}, set(manifest.files)
    if missing := sorted(named - present):
        raise _build_refusal(file, f"not whole: its part {missing[0]} is missing")
    if strange := sorted(present - named):
        raise _build_refusal(file, f"damaged: its {MANIFEST_FILE} does not name {strange[0][:60]!r}")
    return manifest


def _check_sqlite_file(copy: Path, file: Path) -> None:
    """Let SQLite check all pages and keys of a database; raises ServiceError where it is damaged."""
    if not copy.read_bytes()[:16].startswith(b"SQLite format 3"):
        raise _build_refusal(file, f"damaged: its {DATABASE_FILE} is no database")
    try:
        with closing(sqlite3.connect(f"{copy.resolve().as_uri()}?mode=ro", uri=True)) as connection:
            connection.execute("PRAGMA trusted_schema=OFF")
            (integrity,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
            orphan = connection.execute("PRAGMA foreign_key_check").fetchone()
            strange = connection.execute(SELECT_STRANGE_OBJECTS).fetchone()
    except sqlite3.DatabaseError as error:
        raise _build_refusal(file, f"damaged: its {DATABASE_FILE} cannot be read ({error})") from None
    if integrity != "ok":
        why = shorten_error(integrity, 120)
        raise _build_refusal(file, f"damaged: its {DATABASE_FILE} does not hold together ({why})")
    if orphan is not None:
        raise _build_refusal(file, f"damaged: rows of its table {orphan[0]} belong to none of {orphan[2]}")
    if strange is not None:
        raise _build_refusal(file, f"no backup of Headland: its {DATABASE_FILE} has a {strange[0][:60]}")


def _restore_checked(store: Store, backup: _OpenBackup, copy: Path) -> int:
    """Store the bytes, then all rows at once; delete the bytes again where that fails."""
    source, file, manifest = Database(f"sqlite:///{copy}"), backup.file, backup.manifest
    try:
        with source.engine.connect() as connection:
            version = connection.scalar(sa.text(SELECT_VERSION))
        if version != manifest.migration:
            fault = f"damaged: its {DATABASE_FILE} is not of the version in its {MANIFEST_FILE}"
            raise _build_refusal(file, fault)
        migrate_database(source.engine)
        with source.open_read_session() as session:
            named = set(map(format_bytes_name, list_named_bytes(session.connection())))
        if missing := sorted(named - set(backup.list_bytes())):
            raise _build_refusal(file, f"not whole: its database names {missing[0][:90]}, which is missing")
        if unused := sorted(set(backup.list_bytes()) - named):
            raise _build_refusal(file, f"no backup of Headland: nothing in its database names {unused[0]}")
        with ExitStack() as undo:
            for name in backup.list_bytes():
                path = store.blobs.get_path(manifest.files[name].sha256)
                if not path.exists():
                    undo.callback(path.unlink, missing_ok=True)
                parts: list[bytes] = []
                backup.read_part(name, parts.append)
                store.blobs.put_bytes(b"".join(parts))
            _copy_all_rows(store, source)
            undo.pop_all()
    except ServiceError:
        raise
    except (ValueError, TypeError, AttributeError, LookupError):
        raise _build_refusal(file, f"damaged: rows of its {DATABASE_FILE} cannot be read") from None
    except sa.exc.DBAPIError as error:
        why = shorten_error(error.orig, 120)
        raise ServiceError(
            f"{file} cannot be brought back: {why}; {USE_ANOTHER_BACKUP}, or see to the database."
        ) from None
    finally:
        source.close()
    return len(manifest.files) - 1


def _copy_all_rows(store: Store, source: Database) -> None:
    """Copy all rows of a database at once."""
    with (
        translate_disk_full(store.settings.data),
        source.engine.connect() as old,
        store.database.open_write_session() as session,
        lift_timeouts(session.connection()),
    ):
        for table in COPIED_TABLES:
            copy_rows(table, old, session)
            _advance_sequence(session.connection(), table)


def _advance_sequence(connection: sa.Connection, table: sa.Table) -> None:
    """Let PostgreSQL number new rows after the restored ones."""
    column = next(iter(table.primary_key.columns))
    if connection.dialect.name == "postgresql" and isinstance(column.type, sa.Integer):
        connection.execute(sa.text(SET_SEQUENCE.format(table=table.name, column=column.name)))
