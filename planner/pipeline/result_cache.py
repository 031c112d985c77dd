"""Results kept on disk between runs: the folder of this system, and files in it by the hash of what they answer.

A cache only saves time, and may be deleted at any moment.
"""

from __future__ import annotations

import hashlib
import json
import os
import secrets
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

CACHE_VARIABLE = "HEADLAND_CACHE"
MOST_BYTES = 200_000_000


def find_cache_folder() -> Path:
    """The cache folder of this system, of temporary files for a user without a home; HEADLAND_CACHE names another."""
    if os.environ.get(CACHE_VARIABLE):
        return Path(os.environ[CACHE_VARIABLE])
    try:
        home = Path.home()
    except RuntimeError:
        home = Path(tempfile.gettempdir())
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local") / "headland" / "Cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "headland"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "headland"


@dataclass(frozen=True)
class ResultCache:
    """Files by name in a folder, each the SHA-256 of an object's JSON and then that; None disables the cache.

    A file that is not as it was written counts as missing.
    """

    folder: Path | None

    def read(self, name: str) -> dict[str, Any] | None:
        """A cached object, None if it is missing or damaged."""
        if self.folder is None:
            return None
        path = self.folder / f"{name}.json"
        try:
            digest, text = path.read_text(encoding="utf-8").split("\n")
        except (OSError, ValueError):
            return None
        with suppress(OSError):  # of another user
            os.utime(path)
        content: dict[str, Any] | None = json.loads(text) if digest == _hash_text(text) else None
        return content

    def read_all(self, begin: str) -> list[dict[str, Any]]:
        """The cached objects whose names begin so, in the order of their names; damaged ones are left out."""
        names = sorted(path.stem for path in self._list_files() if path.name.startswith(begin))
        return [content for name in names if (content := self.read(name)) is not None]

    def _list_files(self) -> list[Path]:
        """The files of cached objects; none where the folder cannot be read."""
        try:
            return [] if self.folder is None else [*self.folder.glob("*.json")]
        except OSError:
            return []

    def write(self, name: str, content: Mapping[str, Any]) -> bool:
        """Store an object atomically; returns whether this succeeded."""
        if self.folder is None:
            return True
        draft = self.folder / f".{name[:16]}-{secrets.token_hex(4)}"
        try:
            text = json.dumps(content, allow_nan=False)
            self.folder.mkdir(parents=True, exist_ok=True)
            draft.write_text(f"{_hash_text(text)}\n{text}", encoding="utf-8")
            os.replace(draft, self.folder / f"{name}.json")
        except (OSError, ValueError):  # a number that is not finite is not JSON
            with suppress(OSError):
                draft.unlink(missing_ok=True)
            return False
        return True

    def remove_oldest(self, most_bytes: int = MOST_BYTES) -> None:
        """Remove the files that were not used for the longest time until the rest has no more than so many bytes."""
        found = list[tuple[float, int, Path]]()
        for path in self._list_files():
            with suppress(OSError):  # another process may have removed it
                status = path.stat()
                found.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in found)
        for _, size, path in sorted(found):
            if total <= most_bytes:
                return
            with suppress(OSError):
                path.unlink()
            total -= size


def _hash_text(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


NO_CACHE = ResultCache(None)
