"""The base of the parts of the store: database, bytes, waiting revocations, times and names."""

from __future__ import annotations

import contextlib
import json
import os
import re
import sys
import unicodedata
from collections.abc import Collection, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from fields.text_files import WINDOWS_DEVICE
from planner.service.errors import ServiceError
from planner.service.settings import MEGABYTE_BYTES, ServiceSettings
from planner.service.store.database import Database
from planner.service.store.disk_storage import SHA256_TEXT, BlobStore, translate_disk_full, write_whole

LONGEST_NAME_CHARS = 100
BYTES_FOLDER, REVOCATIONS_FOLDER = "bytes", "revoked"
COPY_SUFFIX_CHARS = 10  # room for " copy 9999"
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
    ".agr": "text/plain; charset=utf-8",
    ".txt": "text/plain; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".png": "image/png",
}
"""Of uploads and of results of jobs."""


@dataclass(frozen=True)
class Revocation:
    """The revocation of a token by SHA-256, with its name; `who` revoked it, None where nobody is to be recorded."""

    sha256: str
    name: str
    who: str | None


class RevocationFolder:
    """Waiting revocations; every method may be called from any process."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def add(self, revocation: Revocation) -> None:
        """Keep a revocation, on the disk when this returns. Raises StorageError, OSError where it cannot be kept."""
        with translate_disk_full():
            write_whole(self._folder / revocation.sha256, json.dumps(asdict(revocation)).encode())
        self._give_to_service(self._folder / revocation.sha256)
        self._give_to_service(self._folder)

    def list_waiting(self) -> Mapping[str, Revocation]:
        """The revocations that wait, by SHA-256; other files in the folder are none."""
        found = {}
        with contextlib.suppress(FileNotFoundError):
            for path in sorted(one for one in self._folder.iterdir() if SHA256_TEXT.fullmatch(one.name)):
                with contextlib.suppress(FileNotFoundError):  # another process has written it to the database
                    found[path.name] = Revocation(**json.loads(path.read_text(encoding="utf-8")))
        return found

    def remove(self, revocation: Revocation) -> None:
        """Forget a revocation that is in the database."""
        (self._folder / revocation.sha256).unlink(missing_ok=True)

    def _give_to_service(self, path: Path) -> None:
        """Give what root made, never what a link names, to the owner of the data folder, as whom the service runs."""
        if sys.platform != "win32" and os.geteuid() == 0:
            owner = self._folder.parent.stat()
            with contextlib.suppress(FileNotFoundError):  # the service has written it to the database
                os.chown(path, owner.st_uid, owner.st_gid, follow_symlinks=False)


class StorePart:
    """A part of the store."""

    def __init__(self, settings: ServiceSettings) -> None:
        settings.data.mkdir(parents=True, exist_ok=True, mode=0o700)
        self.settings = settings
        self.blobs = BlobStore(settings.data / BYTES_FOLDER, settings.reserve_mb * MEGABYTE_BYTES)
        self.revocations = RevocationFolder(settings.data / REVOCATIONS_FOLDER)
        self.database = Database(settings.url)

    def close(self) -> None:
        """Close the database."""
        self.database.close()


def find_media(suffix: str) -> str:
    """The media type of an upload or a result by its ending; others are bytes."""
    return MEDIA_BY_SUFFIX.get(suffix, "application/octet-stream")


def is_storable_text(text: str) -> bool:
    """Whether every database can hold a text: PostgreSQL takes no NUL, and no database takes a lone surrogate."""
    return not any(one == "\0" or "\ud800" <= one <= "\udfff" for one in text)


def check_name(name: str, parameter: str = "name") -> str:
    """A checked name in normalised Unicode.

    It begins with a letter or digit and has only letters, digits, spaces and `._()+-`, so it is never a path.
    Raises ServiceError.
    """
    name = unicodedata.normalize("NFC", name)
    if WINDOWS_DEVICE.match(name.strip()):
        raise ServiceError(f"{name!r} is what Windows calls a device; choose another name.", parameter=parameter)
    is_plain = re.fullmatch(r"\w[\w ._()+-]*", name) and ".." not in name and name == name.strip()
    if not is_plain or len(name) > LONGEST_NAME_CHARS:
        shown = name if len(name) <= 40 else name[:40] + "..."
        raise ServiceError(
            f"The name {shown!r} cannot be used; begin with a letter or digit, then letters, digits, spaces and "
            f"._()+- (no two dots), at most {LONGEST_NAME_CHARS}.",
            parameter=parameter,
        )
    return name


def choose_copy_name(name: str, taken: Collection[str] = ()) -> str:
    """A name for a copy that is not taken: "north copy", then "north copy 2"."""
    base = f"{name[: LONGEST_NAME_CHARS - COPY_SUFFIX_CHARS].rstrip(' .')} copy"
    number = 1
    while (chosen := base if number == 1 else f"{base} {number}") in taken:
        number += 1
    return chosen


def is_found(name: str, search: str) -> bool:
    """Whether a name has every word of a search, in any case."""
    folded_name = unicodedata.normalize("NFC", name).casefold()
    return all(word in folded_name for word in unicodedata.normalize("NFC", search).casefold().split())
