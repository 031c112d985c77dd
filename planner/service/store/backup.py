"""Backups, made while the service runs, with a manifest of sizes and SHA-256; and the deletion of unused bytes."""

from __future__ import annotations

import hashlib
import json
import re
import secrets
import tempfile
import time
import zipfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import sqlalchemy as sa
from sqlalchemy.orm import Session

from planner.service.errors import ServiceError
from planner.service.settings import DATABASE_FILE, find_version
from planner.service.store.database import Database, get_current_version, migrate_database
from planner.service.store.disk_storage import translate_disk_full
from planner.service.store.service_store import Store
from planner.service.store.store_part import BYTES_FOLDER, format_utc_now_ms
from planner.service.store.tables import COPIED_TABLES, FileRow, FleetRow, JobRow, ResultRow, TokenRow

MANIFEST_FILE, MANIFEST_VERSION = "manifest.json", 1
MOST_MANIFEST_BYTES = 64 * 2**20
BYTES_NAME = re.compile(rf"{BYTES_FOLDER}/([0-9a-f]{{2}})/(\1[0-9a-f]{{62}})")
SHA256_TEXT = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True)
class ManifestEntry:
    """One file of a backup."""

    size: int
    sha256: str


@dataclass
class BackupManifest:
    """The files of a backup by name, and the version (`migration`) of its tables."""

    migration: str
    headland: str = field(default_factory=find_version)
    made: str = field(default_factory=format_utc_now_ms)
    files: dict[str, ManifestEntry] = field(default_factory=dict)

    @property
    def total_bytes(self) -> int:
        """Bytes of all files together."""
        return sum(entry.size for entry in self.files.values())


def parse_manifest(text: bytes) -> BackupManifest:
    """Read a manifest; raises ValueError with the reason where it cannot be used."""
    try:
        values = json.loads(text)
    except RecursionError:
        raise ValueError("it is nested too deep") from None
    if not isinstance(values, dict) or values.get("form") != MANIFEST_VERSION:
        raise ValueError(f"its form is not {MANIFEST_VERSION}")
    words = [values.get(key) for key in ("migration", "headland", "made")]
    files = values.get("files")
    if not all(isinstance(word, str) for word in words) or not isinstance(files, dict):
        raise ValueError("it does not name the version, the time and the files")
    entries = {name: _parse_entry(name, given) for name, given in files.items()}
    if DATABASE_FILE not in entries:
        raise ValueError(f"it names no {DATABASE_FILE}")
    return BackupManifest(str(words[0]), str(words[1]), str(words[2]), entries)


def _parse_entry(name: str, values: Any) -> ManifestEntry:
    """Check one entry; bytes are named by their SHA-256, so that no name is a path elsewhere."""
    match = BYTES_NAME.fullmatch(name)
    size = values.get("size") if isinstance(values, Mapping) else None
    sha256 = values.get("sha256") if isinstance(values, Mapping) else None
    if name != DATABASE_FILE and match is None:
        raise ValueError(f"it names {name[:60]!r}, which is no part of a backup")
    if not isinstance(size, int) or isinstance(size, bool) or size < 0:
        raise ValueError(f"it gives no size of {name}")
    if not isinstance(sha256, str) or not SHA256_TEXT.fullmatch(sha256) or (match is not None and match[2] != sha256):
        raise ValueError(f"it gives no SHA-256 of {name}")
    return ManifestEntry(size, sha256)


COPY_BATCH_ROWS, PART_BYTES = 500, 2**20
SWEEP_MIN_AGE_S = 3600.0
"""Newer bytes may belong to a row that is being written."""


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
    manifest = BackupManifest(get_current_version())
    manifest.files[DATABASE_FILE] = _add_to_archive(archive, copy, DATABASE_FILE)
    for sha256 in names:
        name = format_bytes_name(sha256)
        try:
            manifest.files[name] = _add_to_archive(archive, store.blobs.get_path(sha256), name)
        except FileNotFoundError:
            raise _describe_missing_bytes(store, sha256, "gone") from None
        if manifest.files[name].sha256 != sha256:
            raise _describe_missing_bytes(store, sha256, "damaged")
    values = {"form": MANIFEST_VERSION, **asdict(manifest)}
    archive.writestr(MANIFEST_FILE, json.dumps(values, indent=1, sort_keys=True))


def _add_to_archive(archive: zipfile.ZipFile, path: Path, name: str) -> ManifestEntry:
    """Add a file to an archive; returns its size and SHA-256."""
    digest, size = hashlib.sha256(), 0
    with open(path, "rb") as source, archive.open(name, "w", force_zip64=True) as target:
        while part := source.read(PART_BYTES):
            digest.update(part)
            size += len(part)
            target.write(part)
    return ManifestEntry(size, digest.hexdigest())


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
    snapshot = store.database.engine.connect()
    if snapshot.dialect.name == "postgresql":
        snapshot = snapshot.execution_options(isolation_level="REPEATABLE READ")
    with snapshot as source, target.open_write_session() as session:
        for table in COPIED_TABLES:
            copy_rows(table, source, session)
        session.execute(sa.delete(TokenRow).where(TokenRow.sha256.in_(store.revocations.list_waiting())))
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
