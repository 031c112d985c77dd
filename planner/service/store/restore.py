"""Restores a backup completely or not at all, into SQLite or PostgreSQL."""

from __future__ import annotations

import hashlib
import sqlite3
import tempfile
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import sqlalchemy as sa

from planner.service.errors import ConflictError, NotFoundError, ServiceError, StorageError
from planner.service.settings import DATABASE_FILE
from planner.service.store.backup import (
    MANIFEST_FILE,
    MOST_MANIFEST_BYTES,
    BackupManifest,
    list_named_bytes,
    parse_manifest,
)
from planner.service.store.database import Database, lift_timeouts, migrate_database
from planner.service.store.disk_storage import is_disk_full, translate_disk_full
from planner.service.store.service_store import Store
from planner.service.store.store_part import BYTES_FOLDER
from planner.service.store.tables import TableBase

RESTORE_BATCH_ROWS, RESTORE_PART_BYTES = 500, 2**20
SET_SEQUENCE = "SELECT setval(pg_get_serial_sequence('{table}', '{column}'), (SELECT max({column}) FROM {table}))"
COMPRESSION_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
SELECT_STRANGE_OBJECTS = "SELECT type || ' ' || name FROM sqlite_master WHERE type NOT IN ('table', 'index')"
USE_ANOTHER_BACKUP = "use another backup"


def restore_backup(store: Store, file: Path) -> int:
    """Put a backup into an empty store; returns the number of files of bytes.

    All of it is checked before anything is written: parts and hashes by its manifest, the database by SQLite itself.
    Raises ServiceError for a file that is not a complete backup, NotFoundError without a file, ConflictError for a
    store that is not empty, DatabaseError for a backup of a newer Headland, StorageError where there is no room.
    """
    _check_empty(store)
    try:
        with zipfile.ZipFile(file) as archive, _create_temporary_folder(store) as folder:
            manifest = _read_checked_manifest(archive, file)
            store.check_disk_space(manifest.total_bytes)
            copy = Path(folder) / DATABASE_FILE
            _check_parts(archive, manifest, file, copy)
            _check_sqlite_file(copy, file)
            return _restore_checked(store, archive, manifest, copy, file)
    except FileNotFoundError:
        raise NotFoundError(f"There is no file {file}; give the name of a backup.", parameter="file") from None
    except (OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError, RuntimeError) as error:
        if is_disk_full(error, store.settings.data):
            raise StorageError(f"No room is left in {store.settings.data} to bring {file} back; make some.") from None
        raise ServiceError(f"{file} cannot be read as a backup: {error}.".replace("..", ".")) from None


def _create_temporary_folder(store: Store) -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(dir=store.settings.data, prefix=".restore-")


def _check_empty(store: Store) -> None:
    with store.database.open_read_session() as session:
        for table in TableBase.metadata.sorted_tables:
            if session.execute(sa.select(sa.literal(1)).select_from(table).limit(1)).first() is not None:
                raise ConflictError(
                    f"The database has {table.name} already, and nothing is written over; give another --data or "
                    "--database.",
                    parameter="data",
                )


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
            "begin "
            "headland serve --data with that, and make a new backup of it."
        )
    duplicate = next((name for name, times in Counter(archive.namelist()).items() if times > 1), None)
    if duplicate is not None:
        raise ServiceError(f"{file} is damaged: it has the part {duplicate[:60]!r} twice; {USE_ANOTHER_BACKUP}.")
    odd = next((info for info in parts.values() if info.compress_type not in COMPRESSION_METHODS), None)
    if odd is not None:
        raise ServiceError(
            f"{file} is no backup of Headland: {odd.filename[:60]!r} is packed another way; {USE_ANOTHER_BACKUP}."
        )
    if parts[MANIFEST_FILE].file_size > MOST_MANIFEST_BYTES:
        raise ServiceError(
            f"{file} is damaged: its {MANIFEST_FILE} has {parts[MANIFEST_FILE].file_size} bytes; {USE_ANOTHER_BACKUP}."
        )
    try:
        manifest = parse_manifest(archive.read(MANIFEST_FILE))
    except ValueError as error:
        why = " ".join(str(error).split())[:120]
        raise ServiceError(
            f"{file} is damaged: its {MANIFEST_FILE} cannot be used, {why}; {USE_ANOTHER_BACKUP}."
        ) from None
    _check_part_names(set(parts) - {MANIFEST_FILE}, manifest, file)
    return manifest


def _check_part_names(names: set[str], manifest: BackupManifest, file: Path) -> None:
    missing = next(iter(sorted(set(manifest.files) - names)), None)
    if missing is not None:
        raise ServiceError(f"{file} is not whole: its part {missing} is missing; {USE_ANOTHER_BACKUP}.")
    strange = next(iter(sorted(names - set(manifest.files))), None)
    if strange is not None:
        raise ServiceError(
            f"{file} is damaged: its {MANIFEST_FILE} does not name {strange[:60]!r}; {USE_ANOTHER_BACKUP}."
        )


def _check_parts(archive: zipfile.ZipFile, manifest: BackupManifest, file: Path, copy: Path) -> None:
    """Read every part once, the database into a file; raises ServiceError for a part with a wrong SHA-256."""
    with open(copy, "wb") as stream:
        _read_part(archive, manifest, DATABASE_FILE, file, stream.write)
    for name in manifest.files:
        if name != DATABASE_FILE:
            _read_part(archive, manifest, name, file, len)


def _read_part(
    archive: zipfile.ZipFile, manifest: BackupManifest, name: str, file: Path, consume: Callable[[bytes], object]
) -> None:
    """Yield the bytes of a part, at most as many as the manifest names; raises ServiceError for others."""
    entry, digest, size = manifest.files[name], hashlib.sha256(), 0
    with archive.open(name) as source:
        while part := source.read(min(RESTORE_PART_BYTES, entry.size - size + 1)):
            size += len(part)
            if size > entry.size:
                break
            digest.update(part)
            consume(part)
    if size != entry.size or digest.hexdigest() != entry.sha256:
        raise ServiceError(f"{file} is damaged: its part {name} has other bytes; {USE_ANOTHER_BACKUP}.")


def _check_sqlite_file(copy: Path, file: Path) -> None:
    """Let SQLite check all pages and keys of a database; raises ServiceError where it is damaged."""
    if not copy.read_bytes()[:16].startswith(b"SQLite format 3"):
        raise ServiceError(f"{file} is damaged: its {DATABASE_FILE} is no database; {USE_ANOTHER_BACKUP}.")
    try:
        with closing(sqlite3.connect(f"{copy.resolve().as_uri()}?mode=ro", uri=True)) as connection:
            connection.execute("PRAGMA trusted_schema=OFF")
            (integrity,) = connection.execute("PRAGMA integrity_check(1)").fetchone()
            orphan = connection.execute("PRAGMA foreign_key_check").fetchone()
            strange = connection.execute(SELECT_STRANGE_OBJECTS).fetchone()
    except sqlite3.DatabaseError as error:
        raise ServiceError(
            f"{file} is damaged: its {DATABASE_FILE} cannot be read ({error}); {USE_ANOTHER_BACKUP}."
        ) from None
    if integrity != "ok":
        why = " ".join(str(integrity).split())[:120]
        raise ServiceError(
            f"{file} is damaged: its {DATABASE_FILE} does not hold together ({why}); {USE_ANOTHER_BACKUP}."
        )
    if orphan is not None:
        raise ServiceError(
            f"{file} is damaged: rows of its table {orphan[0]} belong to none of {orphan[2]}; {USE_ANOTHER_BACKUP}."
        )
    if strange is not None:
        raise ServiceError(
            f"{file} is no backup of Headland: its {DATABASE_FILE} has a {strange[0][:60]}; {USE_ANOTHER_BACKUP}."
        )


def _restore_checked(store: Store, archive: zipfile.ZipFile, manifest: BackupManifest, copy: Path, file: Path) -> int:
    """Store the bytes, then all rows at once; delete the bytes again where that fails."""
    source = Database(f"sqlite:///{copy}")
    try:
        with source.engine.connect() as connection:
            version = connection.scalar(sa.text("SELECT version_num FROM alembic_version"))
        if version != manifest.migration:
            raise ServiceError(
                f"{file} is damaged: its {DATABASE_FILE} is not of the version in its {MANIFEST_FILE}; "
                f"{USE_ANOTHER_BACKUP}."
            )
        migrate_database(source.engine)
        _check_named_bytes(source, manifest, file)
        with _delete_new_bytes_on_error(store) as fresh:
            for name in manifest.files:
                if name != DATABASE_FILE:
                    _store_part(store, archive, name, manifest, file, fresh)
            _copy_rows(store, source)
    except ServiceError:
        raise
    except (ValueError, TypeError, AttributeError, LookupError):
        raise ServiceError(
            f"{file} is damaged: rows of its {DATABASE_FILE} cannot be read; {USE_ANOTHER_BACKUP}."
        ) from None
    except sa.exc.DBAPIError as error:
        why = " ".join(str(error.orig).split())[:120]
        raise ServiceError(
            f"{file} cannot be brought back: {why}; {USE_ANOTHER_BACKUP}, or see to the database."
        ) from None
    finally:
        source.close()
    return len(manifest.files) - 1


def _check_named_bytes(source: Database, manifest: BackupManifest, file: Path) -> None:
    """Check that the archive has exactly the bytes that its database names; raises ServiceError."""
    with source.open_read_session() as session:
        named = {f"{BYTES_FOLDER}/{sha256[:2]}/{sha256}" for sha256 in list_named_bytes(session.connection())}
    _check_same_byte_names(named, set(manifest.files) - {DATABASE_FILE}, file)


def _check_same_byte_names(named: set[str], present: set[str], file: Path) -> None:
    missing = next(iter(sorted(named - present)), None)
    if missing is not None:
        raise ServiceError(
            f"{file} is not whole: its database names {missing[:90]}, which is missing; {USE_ANOTHER_BACKUP}."
        )
    unused = next(iter(sorted(present - named)), None)
    if unused is not None:
        raise ServiceError(
            f"{file} is no backup of Headland: nothing in its database names {unused}; {USE_ANOTHER_BACKUP}."
        )


@contextmanager
def _delete_new_bytes_on_error(store: Store) -> Iterator[list[str]]:
    """A list for bytes that are new to a store; they are deleted where the body raises."""
    new_digests: list[str] = []
    try:
        yield new_digests
    except BaseException:
        for sha256 in new_digests:
            store.blobs.get_path(sha256).unlink(missing_ok=True)
        raise


def _store_part(
    store: Store, archive: zipfile.ZipFile, name: str, manifest: BackupManifest, file: Path, new_digests: list[str]
) -> None:
    """Store the bytes of one part."""
    sha256 = manifest.files[name].sha256
    if not store.blobs.get_path(sha256).exists():
        new_digests.append(sha256)
    parts: list[bytes] = []
    _read_part(archive, manifest, name, file, parts.append)
    store.blobs.put_bytes(b"".join(parts))


def _copy_rows(store: Store, source: Database) -> None:
    """Copy all rows of a database."""
    with (
        translate_disk_full(store.settings.data),
        source.engine.connect() as old,
        store.database.open_write_session() as session,
        lift_timeouts(session.connection()),
    ):
        for table in TableBase.metadata.sorted_tables:
            rows = old.execution_options(yield_per=RESTORE_BATCH_ROWS).execute(sa.select(table)).mappings()
            for part in rows.partitions(RESTORE_BATCH_ROWS):
                session.execute(sa.insert(table), [dict(row) for row in part])
            _advance_sequence(session.connection(), table)


def _advance_sequence(connection: sa.Connection, table: sa.Table) -> None:
    """Let PostgreSQL number new rows after the restored ones."""
    column = next(iter(table.primary_key.columns))
    if connection.dialect.name == "postgresql" and isinstance(column.type, sa.Integer):
        connection.execute(sa.text(SET_SEQUENCE.format(table=table.name, column=column.name)))
