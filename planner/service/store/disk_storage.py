"""Bytes on the disk by SHA-256, and errors of a full disk as one refusal.

Bytes of files and results in a folder, each under its SHA-256: written whole or not at all, and never changed.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import os
import re
import secrets
import shutil
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import sqlalchemy as sa

from planner.service.errors import NotFoundError, StorageError

DISK_FULL = "No room is left on the disk of the service; delete what is not needed there, then ask again."
DISK_FULL_ERRNOS = (errno.ENOSPC, errno.EDQUOT)
POSTGRESQL_DISK_FULL = "53100"
SHA256_TEXT = re.compile(r"[0-9a-f]{64}")
NO_SPACE_BYTES = 2**16  # less than this is none


def is_disk_full(error: BaseException | None, folder: Path | None = None) -> bool:
    """Whether an error, or its cause, is a full disk; where it is not certain, the disk of `folder` is checked."""
    while error is not None:
        if isinstance(error, StorageError) or (isinstance(error, OSError) and error.errno in DISK_FULL_ERRNOS):
            return True
        if isinstance(error, sa.exc.DBAPIError) and _is_driver_disk_full(error.orig, folder):
            return True
        error = error.__cause__ or error.__context__
    return False


def _is_driver_disk_full(error: BaseException | None, folder: Path | None) -> bool:
    """Whether an error of a database driver is a full disk."""
    if getattr(error, "sqlstate", None) == POSTGRESQL_DISK_FULL:
        return True
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_IOERR):  # a full disk can cause them: no log file is written
        return folder is not None and folder.is_dir() and shutil.disk_usage(folder).free < NO_SPACE_BYTES
    return code == sqlite3.SQLITE_FULL


def check_disk_space(folder: Path, size_bytes: int, reserve_bytes: int) -> None:
    """Raise StorageError where a file of this size would leave less free than the reserve.

    The reserve is for the database, so that stops can still be recorded and jobs cancelled.
    """
    existing_folder = next((each for each in (folder, *folder.parents) if each.exists()), None)
    if existing_folder is not None and shutil.disk_usage(existing_folder).free < size_bytes + reserve_bytes:
        raise StorageError(DISK_FULL)


@contextmanager
def translate_disk_full(folder: Path | None = None) -> Iterator[None]:
    """Turn errors of the body that mean a full disk into StorageError."""
    try:
        yield
    except StorageError:
        raise
    except (OSError, sa.exc.DBAPIError) as error:
        if is_disk_full(error, folder):
            raise StorageError(DISK_FULL) from error
        raise


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, on the disk when this returns, or leave what was there; its folder is made."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = path.with_name(f".{secrets.token_hex(8)}")
    try:
        with open(draft, "xb") as stream:
            stream.write(content)
            stream.flush()
            os.fsync(stream.fileno())
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def hash_bytes(content: bytes) -> str:
    """The SHA-256 by which bytes are named."""
    return hashlib.sha256(content).hexdigest()


class BlobStore:
    """Bytes in one folder, by SHA-256; `reserve_bytes` stay free on its disk.

    What is not in the folder `read_elsewhere` may have.
    """

    def __init__(self, folder: Path, reserve_bytes: int = 0) -> None:
        self._folder, self._reserve_bytes = folder, reserve_bytes
        self.read_elsewhere: Callable[[str], bytes | None] = lambda sha256: None

    def put_bytes(self, content: bytes) -> str:
        """Store bytes and return their SHA-256. Raises StorageError, and stores nothing, where the disk is too full."""
        name = hash_bytes(content)
        blob_path = self.get_path(name)
        if blob_path.exists():
            # Bytes that nobody names are swept away once they are old; these are about to be named.
            with contextlib.suppress(OSError):
                os.utime(blob_path)
                return name
        self.check_disk_space(len(content))
        with translate_disk_full():
            write_whole(blob_path, content)
        return name

    def check_disk_space(self, size_bytes: int) -> None:
        """Raise StorageError where there is no room for this many bytes."""
        check_disk_space(self._folder, size_bytes, self._reserve_bytes)

    def read_bytes(self, sha256: str) -> bytes:
        """The bytes of a SHA-256; raises NotFoundError."""
        path = self.get_path(sha256)
        for _ in range(2):  # it may come to the folder meanwhile
            with contextlib.suppress(OSError):
                return path.read_bytes()
            if (content := self.read_elsewhere(sha256)) is not None:
                return content
        raise NotFoundError(f"The bytes {sha256[:12]} are gone from the folder of the service.")

    def list_paths(self) -> list[Path]:
        """Every file in the folder, with the remains of broken writes."""
        return [path for path in self._folder.rglob("*") if path.is_file()]

    def get_path(self, sha256: str) -> Path:
        """The path of the bytes of a SHA-256."""
        if not SHA256_TEXT.fullmatch(sha256):
            raise NotFoundError("What is not a SHA-256 names no bytes.")
        return self._folder / sha256[:2] / sha256
