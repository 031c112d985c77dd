"""Revocations that wait for the database, one file each: they hold before they are in it, and after a restart."""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import sys
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from planner.service.store.disk_storage import translate_disk_full

_SHA256 = re.compile("[0-9a-f]{64}")


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
        draft = self._folder / f".{secrets.token_hex(8)}"
        with translate_disk_full():
            self._folder.mkdir(mode=0o700, exist_ok=True)
            self._give_to_service(self._folder)
            try:
                with open(draft, "x", encoding="utf-8") as stream:
                    self._give_to_service(draft)
                    json.dump(asdict(revocation), stream)
                    stream.flush()
                    os.fsync(stream.fileno())
                draft.replace(self._folder / revocation.sha256)
            finally:
                draft.unlink(missing_ok=True)

    def list_waiting(self) -> Mapping[str, Revocation]:
        """The revocations that wait, by SHA-256; other files in the folder are none."""
        found = {}
        with contextlib.suppress(FileNotFoundError):
            for path in sorted(one for one in self._folder.iterdir() if _SHA256.fullmatch(one.name)):
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
            os.chown(path, owner.st_uid, owner.st_gid, follow_symlinks=False)
