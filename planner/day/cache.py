"""Simulated field times kept on disk by what they are made of; they only save time and may be deleted at any moment."""

from __future__ import annotations

import json
import os
import secrets
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ELSEWHERE = "HEADLAND_CACHE"


def user_folder() -> Path:
    """Where this system keeps what programs may lose; HEADLAND_CACHE names another folder."""
    if os.environ.get(ELSEWHERE):
        return Path(os.environ[ELSEWHERE])
    home = Path.home()
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local") / "headland" / "Cache"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "headland"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache") / "headland"


@dataclass(frozen=True)
class Cache:
    """Texts by name in a folder; None keeps nothing. What cannot be read or written is as if it were not there."""

    folder: Path | None

    def read(self, name: str) -> dict[str, Any] | None:
        """What is kept, None for nothing or for what is not whole."""
        if self.folder is None:
            return None
        try:
            kept = json.loads((self.folder / f"{name}.json").read_text(encoding="utf-8"))
        except (OSError, ValueError, RecursionError):
            return None
        return kept if isinstance(kept, dict) else None

    def write(self, name: str, content: Mapping[str, Any]) -> bool:
        """Keep something, whole or not at all; whether that could be done."""
        if self.folder is None:
            return True
        draft = self.folder / f".{name[:16]}-{secrets.token_hex(4)}"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            draft.write_text(json.dumps(content, allow_nan=False), encoding="utf-8")
            os.replace(draft, self.folder / f"{name}.json")
        except OSError:
            with_no_trace(draft)
            return False
        return True


def with_no_trace(draft: Path) -> None:
    """Take a half-written file away, as far as that can be done."""
    try:
        draft.unlink(missing_ok=True)
    except OSError:
        return
