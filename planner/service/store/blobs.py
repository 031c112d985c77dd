"""Bytes of files and results in a folder, each under its SHA-256: written whole or not at all, and never changed."""

from __future__ import annotations

import contextlib
import hashlib
import os
import re
import secrets
from pathlib import Path

from planner.service.errors import MissingError


class Blobs:
    """The bytes below one folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def put(self, content: bytes) -> str:
        """Keep bytes; their SHA-256."""
        name = hashlib.sha256(content).hexdigest()
        place = self.path(name)
        if place.exists():
            # Bytes that nobody names are swept away once they are old; these are about to be named.
            with contextlib.suppress(OSError):
                os.utime(place)
                return name
        place.parent.mkdir(parents=True, exist_ok=True)
        draft = place.with_name(f".{secrets.token_hex(8)}")
        try:
            with open(draft, "xb") as stream:
                stream.write(content)
                stream.flush()
                os.fsync(stream.fileno())
            draft.replace(place)
        finally:
            draft.unlink(missing_ok=True)
        return name

    def get(self, sha256: str) -> bytes:
        """The bytes of a SHA-256; raises MissingError."""
        try:
            return self.path(sha256).read_bytes()
        except OSError:
            raise MissingError(f"The bytes {sha256[:12]} are gone from the folder of the service.") from None

    def all(self) -> list[Path]:
        """Every file below the folder, drafts of broken writes among them."""
        return [path for path in self._folder.rglob("*") if path.is_file()]

    def path(self, sha256: str) -> Path:
        """Where the bytes of a SHA-256 are."""
        if not re.fullmatch(r"[0-9a-f]{64}", sha256):
            raise MissingError("What is not a SHA-256 names no bytes.")
        return self._folder / sha256[:2] / sha256
