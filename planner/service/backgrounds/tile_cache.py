"""Tiles kept on the disk of the service: at most so many bytes, those used longest ago go first."""

from __future__ import annotations

import contextlib
import hashlib
import os
import secrets
import threading
import time
from collections.abc import Callable
from pathlib import Path

from planner.service.backgrounds.tile_grid import Tile
from planner.service.errors import StorageError
from planner.service.store.disk_storage import check_disk_space

CACHE_FOLDER = "background-tiles"
KEPT_SHARE = 0.9
"""Share of the limit that is left after tiles were deleted, so that this is not done for every tile."""


class TileCache:
    """Tiles of one background in a folder; a tile that cannot be stored is simply not kept.

    Args:
        folder: folder of all backgrounds; the limit holds for it as a whole.
        background: what names the background; others have folders of their own.
        most_bytes: the limit; 0 keeps nothing.
        reserve_bytes: bytes that stay free on the disk.
    """

    def __init__(
        self,
        folder: Path,
        background: str,
        most_bytes: int,
        reserve_bytes: int = 0,
        clock: Callable[[], float] = time.time,
    ) -> None:
        self._folder, self._most_bytes, self._reserve_bytes, self._clock = folder, most_bytes, reserve_bytes, clock
        self._own_folder = folder / hashlib.sha256(background.encode()).hexdigest()[:16]
        self._lock = threading.Lock()
        self._total_bytes: int | None = None

    def read_tile(self, tile: Tile) -> tuple[bytes, float] | None:
        """The bytes of a tile and its age in seconds; None where it is not kept."""
        path = self._get_path(tile)
        try:
            content, status = path.read_bytes(), path.stat()
        except OSError:
            return None
        with contextlib.suppress(OSError):
            os.utime(path, (self._clock(), status.st_mtime))  # read last now, fetched when it was
        return content, self._clock() - status.st_mtime

    def keep_tile(self, tile: Tile, content: bytes) -> None:
        """Keep a tile, and delete those used longest ago where the limit is passed."""
        if len(content) > self._most_bytes:
            return
        path = self._get_path(tile)
        with self._lock, contextlib.suppress(OSError, StorageError):
            check_disk_space(self._folder, len(content), self._reserve_bytes)
            path.parent.mkdir(parents=True, exist_ok=True)
            before = path.stat().st_size if path.exists() else 0
            draft = path.with_name(f".{secrets.token_hex(8)}")
            draft.write_bytes(content)
            os.utime(draft, (self._clock(), self._clock()))
            draft.replace(path)
            self._total_bytes = self._measure_total_bytes() + (
                0 if self._total_bytes is None else len(content) - before
            )
            if self._total_bytes > self._most_bytes:
                self._delete_oldest()

    def _measure_total_bytes(self) -> int:
        """Bytes of all tiles, counted once."""
        if self._total_bytes is not None:
            return self._total_bytes
        return sum(path.stat().st_size for path in self._folder.rglob("*") if path.is_file())

    def _delete_oldest(self) -> None:
        kept = [(path, path.stat()) for path in self._folder.rglob("*") if path.is_file()]
        total = sum(status.st_size for _, status in kept)
        for path, status in sorted(kept, key=lambda one: one[1].st_atime):
            if total <= KEPT_SHARE * self._most_bytes:
                break
            path.unlink(missing_ok=True)
            total -= status.st_size
        self._total_bytes = total

    def _get_path(self, tile: Tile) -> Path:
        return self._own_folder / str(tile.zoom) / f"{tile.column}-{tile.row}"
