"""What every part of the store works with: the database, the bytes, the time as it is written down."""

from __future__ import annotations

import re
import unicodedata
from datetime import UTC, datetime

from planner.service.errors import ServiceError
from planner.service.settings import Settings
from planner.service.store.blobs import Blobs
from planner.service.store.database import Database

MOST_NAME = 100
FOLDER = "bytes"
DEVICES = {"con", "prn", "aux", "nul", *(f"{port}{number}" for port in ("com", "lpt") for number in range(1, 10))}


class Part:
    """A part of the store."""

    def __init__(self, settings: Settings) -> None:
        settings.data.mkdir(parents=True, exist_ok=True, mode=0o700)
        self.settings = settings
        self.blobs = Blobs(settings.data / FOLDER)
        self.database = Database(settings.url)


def now() -> str:
    """The time in UTC to the millisecond: "2026-05-01T06:10:00.123Z"."""
    return datetime.now(UTC).isoformat(timespec="milliseconds").removesuffix("+00:00") + "Z"


def is_text(text: str) -> bool:
    """Whether every database can hold a text: PostgreSQL has none with a NUL, and none can write half a character."""
    return not any(one == "\0" or "\ud800" <= one <= "\udfff" for one in text)


def checked_name(name: str, what: str = "name") -> str:
    """A name for something in the store, in one form of Unicode.

    It begins with a letter or digit and has letters, digits, spaces and `._()+-` alone, so that it is never a path.
    Raises ServiceError.
    """
    name = unicodedata.normalize("NFC", name)
    if name.partition(".")[0].strip().lower() in DEVICES:
        raise ServiceError(f"{name!r} is what Windows calls a device; choose another name.", parameter=what)
    if len(name) > MOST_NAME or ".." in name or not re.fullmatch(r"\w[\w ._()+-]*", name) or name != name.strip():
        shown = name if len(name) <= 40 else name[:40] + "..."
        raise ServiceError(
            f"The name {shown!r} cannot be used; begin with a letter or digit, then letters, digits, spaces and "
            f"._()+- (no two dots), at most {MOST_NAME}.",
            parameter=what,
        )
    return name
