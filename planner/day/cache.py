"""Simulated field times kept on disk by what they are made of; they only save time and may be deleted at any moment."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import platform
import secrets
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import shapely
from pydantic import BaseModel

ROOMS = ("fields", "vehicle", "strategies", "planner", "reports")
LIBRARIES = ("numba", "numpy", "ortools", "pymunk", "scipy", "shapely")
ELSEWHERE = "HEADLAND_CACHE"
KINDS = (".py", ".toml", ".csv")


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


def digest(*parts: Any) -> str:
    """A name for content: of plain values, dataclasses, models and geometries, and of the code that works on them."""
    text = json.dumps([_plain(part) for part in parts], sort_keys=True, allow_nan=True)
    return hashlib.sha256(f"{code_version()}\n{text}".encode()).hexdigest()


@cache
def code_version() -> str:
    """A digest of the sources that decide a field time, and the versions of what they stand on."""
    root, found = Path(__file__).parents[2], hashlib.sha256()
    for room in ROOMS:
        for path in sorted(path for path in (root / room).rglob("*") if path.suffix in KINDS):
            found.update(path.relative_to(root).as_posix().encode())
            found.update(path.read_bytes())
    for library in LIBRARIES:
        try:
            found.update(f"{library} {version(library)}".encode())
        except PackageNotFoundError:
            found.update(library.encode())
    found.update(f"{platform.machine()} {platform.python_version()}".encode())
    return found.hexdigest()


@dataclasses.dataclass(frozen=True)
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


def _plain(value: Any) -> Any:
    """A value as JSON has it, the same for the same content."""
    if isinstance(value, shapely.Geometry):
        return shapely.to_wkb(value, hex=True)
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {each.name: _plain(getattr(value, each.name)) for each in dataclasses.fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value if value is None or isinstance(value, str | int | float | bool) else repr(value)
